//! Pieces of an example for which the input has nothing are spanned like membranes between what lies on it.
//!
//! A horn laid on an animal without horns, the inside of a mouth on a scan whose lips are shut, or what lies over a gap of a scan
//! would be drawn to the nearest surface, whatever that is: clumps, folds and edges across the body. A membrane is small and
//! even, and has no fold where its rim is a convex loop. *Source:* Tutte 1963 (each vertex the mean of its neighbours).

use crate::mesh::Vec3;
use crate::mesh::tri::{TriMesh, area_between};

/// Rounds of Gauss and Seidel at most, and the move, in √area of the mesh as it lies, below which they end.
const ROUNDS: usize = 2000;
const STILL: f64 = 1e-5;

/// Positions in which each `free` vertex is the mean of its neighbours, in the unit of `positions`. Free vertices of pieces
/// without a rim that stays are left where they are.
pub fn spanned(mesh: &TriMesh, positions: &[Vec3], free: &[bool]) -> Vec<Vec3> {
    let mut around: Vec<Vec<u32>> = vec![Vec::new(); positions.len()];
    for &[a, b, c] in &mesh.triangles {
        for (v, others) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
            if free[v as usize] {
                around[v as usize].extend(others);
            }
        }
    }
    around.iter_mut().for_each(|others| {
        others.sort_unstable();
        others.dedup();
    });
    let mut at = positions.to_vec();
    // From the rim inward, so that the start is near the end.
    let mut is_set: Vec<bool> = free.iter().map(|free| !free).collect();
    let mut order: Vec<u32> = Vec::new();
    loop {
        let bordering = |v: &u32| !is_set[*v as usize] && around[*v as usize].iter().any(|u| is_set[*u as usize]);
        let ring: Vec<u32> = (0..at.len() as u32).filter(bordering).collect();
        if ring.is_empty() {
            break;
        }
        for &v in &ring {
            let set = around[v as usize].iter().filter(|u| is_set[**u as usize]);
            let (sum, count) = set.fold((Vec3::zeros(), 0.0), |(sum, count), &u| (sum + at[u as usize], count + 1.0));
            at[v as usize] = sum / count;
        }
        ring.iter().for_each(|&v| is_set[v as usize] = true);
        order.extend(ring);
    }
    let area: f64 = mesh.triangles.iter().map(|t| triangle_area(t, positions)).sum();
    for _ in 0..ROUNDS {
        let mut moved: f64 = 0.0;
        for &v in &order {
            let others = &around[v as usize];
            let mean = others.iter().map(|&u| at[u as usize]).sum::<Vec3>() / others.len() as f64;
            moved = moved.max((mean - at[v as usize]).norm());
            at[v as usize] = mean;
        }
        if moved <= STILL * area.sqrt() {
            break;
        }
    }
    at
}

fn triangle_area(t: &[u32; 3], positions: &[Vec3]) -> f64 {
    area_between(t.map(|v| positions[v as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_spike_on_a_plane_becomes_plane_and_nothing_else_moves() {
        let mesh = grid(12, 12, false, false);
        let middle = mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f64;
        let size = mesh.total_area().sqrt();
        let free: Vec<bool> = mesh.positions.iter().map(|p| (p - middle).norm() < 0.25 * size).collect();
        assert!(free.iter().filter(|f| **f).count() > 8);
        let lifted = |(p, free): (&Vec3, &bool)| if *free { p + Vec3::new(0.3, 0.1, 2.0) * size } else { *p };
        let spiked: Vec<Vec3> = mesh.positions.iter().zip(&free).map(lifted).collect();
        let found = spanned(&mesh, &spiked, &free);
        for (v, x) in found.iter().enumerate() {
            let limit = if free[v] { 0.02 * size } else { 0.0 };
            assert!((x - mesh.positions[v]).norm() <= limit, "{v}: {x:?}");
        }
    }

    #[test]
    fn what_has_no_rim_stays() {
        let mesh = grid(6, 6, false, false);
        assert_eq!(spanned(&mesh, &mesh.positions, &vec![true; mesh.positions.len()]), mesh.positions);
    }
}
