//! Mending what a settled map leaves torn or folded.
//!
//! An example settles as a body in space, and each vertex then goes to the nearest point of the input. A tip that lies beside
//! another limb goes there ([`islands`] finds it, to be spanned), and thin or crumpled pieces fold. About faces that look inward
//! vertices come to rest on the input in the shapes of the example ([`mend`]). *Ours, not the paper's.*

use crate::map::CrossMap;
use crate::map::polish::{Faces, PolishOptions, flat, settle};
use crate::map::untangle::{FaceFlaws, inward};
use crate::measure::sound::ReferenceSurface;
use crate::mesh::Vec3;
use crate::mesh::disjoint::Sets;
use crate::mesh::tri::{NONE, TriMesh, area_between};
use crate::topology::{connected, widen};
use crate::unfold::Chart;

/// A piece of the example's area up to this share that nothing but leaps and bare vertices join to the rest is an island.
const ISLAND: f64 = 0.05;
/// Rings about the faces that look inward, each tried on what the one before left.
const RINGS: [usize; 3] = [1, 3, 6];

/// Marks the vertices of small pieces that lie on the input by chance, beside those that are `bare`: edges that leap across the
/// input join them to the rest, or bare vertices do.
pub fn islands(mesh: &TriMesh, leaps: &[[u32; 2]], bare: &mut [bool]) {
    if leaps.is_empty() && !bare.contains(&true) {
        return;
    }
    let joins = |[a, b]: [u32; 2]| {
        !bare[a as usize] && !bare[b as usize] && leaps.binary_search(&[a.min(b), a.max(b)]).is_err()
    };
    let mut pieces = Sets::new(bare.len());
    edges(mesh).into_iter().filter(|edge| joins(*edge)).for_each(|[a, b]| pieces.join(a, b));
    let mut areas = vec![0.0; bare.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        for v in corners {
            areas[pieces.root(*v) as usize] += mesh.area(t) / 3.0;
        }
    }
    let all = mesh.total_area();
    for (v, bare) in (0u32..).zip(bare) {
        *bare |= areas[pieces.root(v) as usize] <= ISLAND * all;
    }
}

/// Marks as `lost` the vertices of the polygons at the rim, or beside what is lost, that have an edge which leaps: there the input
/// ends, in a hole or a bay that it is too wide for the example to span.
pub fn fray(mesh: &TriMesh, leaps: &[[u32; 2]], lost: &mut [bool]) {
    let is_leap = |h: u32| {
        let (a, b) = (mesh.tail(h), mesh.head(h));
        !mesh.phantom[h as usize] && leaps.binary_search(&[a.min(b), a.max(b)]).is_ok()
    };
    let mut torn: Vec<u32> =
        (0..mesh.twins.len() as u32).filter(|&h| is_leap(h)).map(|h| mesh.polygon_of[h as usize / 3]).collect();
    torn.sort_unstable();
    torn.dedup();
    let is_torn: Vec<bool> = mesh.polygon_of.iter().map(|f| torn.binary_search(f).is_ok()).collect();
    let was_lost = lost.to_vec();
    let ends = |h: u32| match mesh.twin(h) {
        NONE => true,
        twin => mesh.triangles[twin as usize / 3].iter().all(|&v| was_lost[v as usize]),
    };
    for set in connected(mesh, &is_torn).into_iter().filter(|set| is_torn[set[0] as usize]) {
        if set.iter().any(|t| (3 * t..3 * t + 3).any(ends)) {
            set.iter().flat_map(|&t| mesh.triangles[t as usize]).for_each(|v| lost[v as usize] = true);
        }
    }
}

/// The edges of the polygons.
fn edges(mesh: &TriMesh) -> Vec<[u32; 2]> {
    (0..mesh.twins.len() as u32)
        .filter(|&h| !mesh.phantom[h as usize] && (mesh.twin(h) == NONE || h < mesh.twin(h)))
        .map(|h| [mesh.tail(h), mesh.head(h)])
        .collect()
}

/// The edges that leap across the input, each with its lesser vertex first, in order. `positions`: of the vertices of `mesh` on the
/// input.
pub fn leaps(mesh: &TriMesh, positions: &[Vec3], grounds: &ReferenceSurface) -> Vec<[u32; 2]> {
    let mut leaps = grounds.leaps(positions, &edges(mesh));
    leaps.iter_mut().for_each(|edge| edge.sort_unstable());
    leaps.sort_unstable();
    leaps
}

/// Lets the vertices about faces that look inward come to rest on the input, where fewer faces look inward or are crumpled after it.
/// `mirror` is −1 for mirrored maps. The boundary stays.
pub fn mend(mesh: &TriMesh, cross: &mut CrossMap, input: &Chart, mirror: f64) {
    let laid: f64 = mesh.triangles.iter().map(|t| area_between(t.map(|v| cross.positions[v as usize]))).sum();
    let growth = laid / mesh.total_area().max(f64::MIN_POSITIVE);
    let boundary = mesh.boundary_vertices();
    for rings in RINGS {
        let turned = inward(mesh, cross, input, mirror);
        if turned.is_empty() {
            return;
        }
        let mut inside: Vec<bool> = mesh.polygon_of.iter().map(|f| turned.binary_search(f).is_ok()).collect();
        widen(mesh, &mut inside, rings);
        let mut fixed = boundary.clone();
        for (corners, _) in mesh.triangles.iter().zip(&inside).filter(|(_, inside)| !**inside) {
            corners.iter().for_each(|&v| fixed[v as usize] = true);
        }
        let triangles: Vec<[u32; 3]> =
            mesh.triangles.iter().zip(&inside).filter(|(_, inside)| **inside).map(|(t, _)| *t).collect();
        let rest = triangles.iter().map(|t| flat(t.map(|v| mesh.positions[v as usize]), mirror)).collect();
        // The area for which the input has room is that which the example takes.
        let faces =
            Faces { triangles: &triangles, rest, heights: Vec::new(), fixed, area: input.mesh.total_area() / growth };
        let before = cross.clone();
        settle(faces, cross, input, &PolishOptions { size_freedom: 1.0, ..PolishOptions::default() });
        let after = inward(mesh, cross, input, mirror);
        let [is, was] = [FaceFlaws::of(mesh, cross, &after), FaceFlaws::of(mesh, &before, &turned)];
        // A region that did not get better by it stays as it was.
        for region in connected(mesh, &inside).into_iter().filter(|set| inside[set[0] as usize]) {
            let polygons = || region.iter().map(|t| mesh.polygon_of[*t as usize]);
            if is.among(polygons()) >= was.among(polygons()) {
                for v in region.iter().flat_map(|t| mesh.triangles[*t as usize]) {
                    cross.locations[v as usize] = before.locations[v as usize];
                    cross.positions[v as usize] = before.positions[v as usize];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::index::Location;
    use crate::mesh::bvh::Bvh;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    #[test]
    fn faces_that_are_pushed_over_each_other_come_to_rest() {
        let mesh = grid(20, 20, false, false);
        let chart =
            unfold(&whole(&grid(40, 40, false, false)).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let size = mesh.total_area().sqrt();
        let middle = mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f64;
        let pushed = |p: &Vec3| {
            let near = (1.0 - (p - middle).norm() / (0.2 * size)).max(0.0);
            bvh.closest(p + Vec3::new(0.3 * size * near, 0.0, 0.0))
        };
        let (locations, positions) =
            mesh.positions.iter().map(|p| (Location::from(pushed(p)), pushed(p).point)).unzip();
        let mut cross = CrossMap { locations, positions };
        let before = inward(&mesh, &cross, &chart, 1.0).len();
        assert!(before > 8, "{before}");
        mend(&mesh, &mut cross, &chart, 1.0);
        assert_eq!(inward(&mesh, &cross, &chart, 1.0).len(), 0);
    }

    #[test]
    fn a_tip_that_lies_on_another_limb_is_an_island_and_a_stretched_one_is_not() {
        // A sheet bent to a U, its legs .2 apart; the example is the same.
        let mut bent = grid(10, 60, false, false);
        let high = bent.positions.iter().map(|p| p.y).fold(0.0, f64::max);
        for p in &mut bent.positions {
            let along = (p.y / high - 0.5) * 2.0;
            let angle = along.clamp(-0.2, 0.2) / 0.2 * std::f64::consts::FRAC_PI_2;
            *p = Vec3::new(0.1 * angle.sin(), p.x, 0.1 * (1.0 - angle.cos()) + along.abs() - along.abs().min(0.2));
        }
        let grounds = ReferenceSurface::new(bent.clone());
        let leaps_at = |positions: &[Vec3]| leaps(&bent, positions, &grounds);
        let mut positions = bent.positions.clone();
        let far = positions.iter().map(|p| p.z).fold(0.0, f64::max);
        let tip: Vec<bool> = bent.positions.iter().map(|p| p.x < 0.0 && p.z > 0.95 * far).collect();
        for (p, _) in positions.iter_mut().zip(&tip).filter(|(_, tip)| **tip) {
            p.x = 0.1;
        }
        let mut bare = vec![false; positions.len()];
        islands(&bent, &leaps_at(&positions), &mut bare);
        assert_eq!(bare, tip);
        let mut none = vec![false; positions.len()];
        islands(&bent, &leaps_at(&bent.positions), &mut none);
        assert!(!none.contains(&true));
        // At the rim what is torn from the rest goes: the polygons that leap, and no others.
        fray(&bent, &leaps_at(&bent.positions), &mut none);
        assert!(!none.contains(&true));
        fray(&bent, &leaps_at(&positions), &mut none);
        let leaps =
            |corners: &&[u32; 3]| corners.iter().any(|&v| tip[v as usize]) && !corners.iter().all(|&v| tip[v as usize]);
        let mut beside = vec![false; positions.len()];
        bent.triangles.iter().filter(leaps).flatten().for_each(|&v| beside[v as usize] = true);
        assert!(none.contains(&true));
        assert!(none.iter().zip(&beside).all(|(lost, beside)| *beside || !*lost));
        // Inside, or surrounded by what stays, nothing frays.
        let mut inner = bent.positions.clone();
        let is_middle = |p: &Vec3| p.x < -0.09 && (0.4..0.5).contains(&p.z) && (p.y - 0.5).abs() < 1e-9;
        let middle = bent.positions.iter().position(is_middle);
        inner[middle.expect("a vertex of one leg")].x = 0.1;
        let mut none = vec![false; positions.len()];
        fray(&bent, &leaps_at(&inner), &mut none);
        assert!(!none.contains(&true));
    }
}
