//! Moves vertices to regions of the input that the mesh does not cover, above all the tips of protrusions.
//!
//! For each of the input's sample points x, y is the nearest point of the result. Where |x − y| is more than is allowed, the
//! corner next to x of the face that holds y is asked for; a vertex goes to the farthest x that asks for it, unless a
//! neighbour has just gone, and stays there. The vertices around follow: x_v ← π(x_v + s·(mean of its neighbours − x_v)).
//! Subdividing alone does not help, since middles of edges are put on the nearest part of the input, which is the stump.
//! *Ours, not the paper's.*

use super::net::Net;
use super::smooth::Target;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;

/// Rounds of moving vertices, and rounds in which the others follow after each.
const ROUNDS: usize = 12;
const FOLLOWING: usize = 6;
/// Edges around a moved vertex within which the others follow, and how far they go.
const REACH: usize = 4;
const STEP: f64 = 0.5;

/// Moves vertices of a net of quads to the points that are farther from it than `allowed`, in units of the mesh; tells of
/// each vertex whether it was moved.
pub fn cover(net: &mut Net, points: &[Vec3], target: &Target, allowed: f64) -> Vec<bool> {
    let mut held = vec![false; net.positions.len()];
    for _ in 0..ROUNDS {
        let drawn = farthest_asked(net, points, allowed);
        if drawn.is_empty() {
            break;
        }
        let mut moved = Vec::new();
        for (v, to) in drawn {
            if net.neighbours(v).iter().any(|w| moved.contains(w)) {
                continue;
            }
            net.positions[v as usize] = to;
            held[v as usize] = true;
            moved.push(v);
        }
        follow(net, &moved, &held, target);
    }
    held
}

/// The vertices that are asked for, each with the farthest point that asks; the farthest first.
fn farthest_asked(net: &Net, points: &[Vec3], allowed: f64) -> Vec<(u32, Vec3)> {
    let fans = net.fans();
    let bvh = Bvh::new(&fans.mesh);
    let mut asked: Vec<(f64, u32, Vec3)> = Vec::new();
    for (&x, nearest) in points.iter().zip(bvh.closest_to_all(points)) {
        let Some(&face) = fans.face.get(nearest.triangle as usize).filter(|_| nearest.distance > allowed) else {
            continue;
        };
        let apart = |v: u32| (net.positions[v as usize] - x).norm_squared();
        let free = net.face(face).iter().copied().filter(|&v| !net.on_boundary(v));
        if let Some(v) = free.min_by(|&v, &w| apart(v).total_cmp(&apart(w))) {
            asked.push((nearest.distance, v, x));
        }
    }
    asked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut seen = vec![false; net.positions.len()];
    asked.retain(|&(_, v, _)| !std::mem::replace(&mut seen[v as usize], true));
    asked.into_iter().map(|(_, v, x)| (v, x)).collect()
}

/// The vertices around those that moved follow them, but for those that are held and the boundary.
fn follow(net: &mut Net, moved: &[u32], held: &[bool], target: &Target) {
    let mut around: Vec<u32> = net.rings(moved, REACH).concat();
    around.retain(|&v| !held[v as usize] && !net.on_boundary(v));
    let beside: Vec<Vec<u32>> = around.iter().map(|&v| net.neighbours(v)).collect();
    for _ in 0..FOLLOWING {
        for (&v, neighbours) in around.iter().zip(&beside) {
            let mean =
                neighbours.iter().map(|&w| net.positions[w as usize]).sum::<Vec3>() / neighbours.len().max(1) as f64;
            let here = net.positions[v as usize];
            net.positions[v as usize] = target.onto_surface(here + (mean - here) * STEP);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::fit::MeasuredSurface;
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    #[test]
    fn a_sheet_that_passes_under_a_horn_is_drawn_out_to_its_tip() {
        // A horn of height 0.5 in the middle of a sheet of side 1.
        let mut surface = grid(60, 60, false, false);
        let height = |p: &Vec3| 0.5 * (1.0 - ((p.x - 0.5).hypot(p.y - 0.5) / 0.1)).max(0.0);
        surface.positions.iter_mut().for_each(|p| p.z = height(p));
        let mut net = sheet(10, 10);
        net.positions.iter_mut().for_each(|p| *p /= 10.0);
        let (measured, target) = (MeasuredSurface::new(&surface), Target::new(&surface));
        let before = measured.fit(&net.clone().into_mesh().0);
        assert!(cover(&mut net, measured.points(), &target, 0.02).contains(&true));
        let after = measured.fit(&net.clone().into_mesh().0);
        assert!(after.back < 0.35 * before.back, "{before:?} {after:?}");
        let top = net.positions.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!(top > 0.45, "{top}");
        assert!(!cover(&mut net, &[Vec3::zeros()], &target, 0.02).contains(&true));
    }
}
