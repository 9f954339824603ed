//! A map bent by hand: points of the example are taken to places on the input, and what is around follows.
//!
//! The corners of the face that holds a point walk as far as the point is to move. Each vertex near them follows by a share of that
//! move, which falls with its distance along the surface ([`Follow`]); then faces take the shapes again that they had
//! ([`polish_within`]). No chart is asked: a map that no registration made can be bent. *Ours, not the paper's.*

mod follow;

use self::follow::{Follow, HoldingCorner, MovedPoint, shares};
use super::CrossMap;
use super::polish::{PolishOptions, polish_within};
use super::untangle::{inward, turned_in_domain, untangle_within};
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::geodesic::Marcher;
use crate::mesh::tri::{TriMesh, area_between};
use crate::unfold::Chart;

/// A move of length 1 reaches so far. The share that follows falls by at most 1.5 in that distance, so that no face loses more than
/// half of its length.
const REACH: f64 = 3.0;
/// A move reaches at least so many edges of the face that is moved.
const REACH_EDGES: f64 = 4.0;
/// Least share of a point that corners inside have to hold, for it to be moved by them.
const INSIDE_MIN: f64 = 0.2;
/// A corner that holds less of a point than this is not moved for it.
const HOLDS_MIN: f64 = 1e-3;
/// Rounds in which faces take their shapes again.
const ROUNDS: usize = 8;
/// Share of the area that moves which may be turned over: a face in two hundred, which is told and can be put right. *Untuned.*
const FOLDED: f64 = 0.005;
/// So many polygons may be, however little moves.
const FOLDED_ANYWAY: usize = 1;

/// A point of the example that goes to a point near the input's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pin {
    /// Where it is on the example's patch.
    pub on_example: Location,
    /// Where it goes.
    pub to: Vec3,
}

/// Why a map was not bent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BendError {
    /// Faces would be turned over.
    #[error(
        "expected a map without folds, found {faces} faces that it turns over; move the constraint less, or its neighbours too"
    )]
    Folds {
        /// How many more than before.
        faces: usize,
    },
    /// The boundary stays where it is.
    #[error("expected a constraint inside the segment, found one whose face lies along its boundary")]
    OnBoundary,
}

/// Tells whether a point of `mesh` can be moved: corners inside hold enough of it. `border` are the mesh's boundary vertices.
pub fn is_inside(mesh: &TriMesh, border: &[bool], at: &Location) -> bool {
    corners(mesh, border, at).is_some_and(|held| shares(&held) >= INSIDE_MIN)
}

/// The corners that hold a point of `mesh`; `None` where there is no such triangle.
fn corners(mesh: &TriMesh, border: &[bool], at: &Location) -> Option<[HoldingCorner; 3]> {
    let corners = mesh.triangles.get(at.triangle as usize)?;
    Some([0, 1, 2].map(|k| {
        let (vertex, share) = (corners[k], at.barycentric[k]);
        HoldingCorner { vertex, share, moves: !border[vertex as usize] && share > HOLDS_MIN }
    }))
}

/// The map of `mesh` (the example's patch) with its points at the pins. `mirror` is −1 for mirrored maps, `bvh` the tree of
/// the input's mesh. Boundary vertices stay, and so does what is far from the pins.
///
/// # Errors
/// [`BendError`].
pub fn bend(
    mesh: &TriMesh,
    cross: &CrossMap,
    pins: &[Pin],
    input: &Chart,
    mirror: f64,
    bvh: &Bvh,
) -> Result<CrossMap, BendError> {
    let border = mesh.boundary_vertices();
    let laid = TriMesh { positions: cross.positions.clone(), ..mesh.clone() };
    let follow = Follow { cross, input, bvh, marcher: &Marcher::new(&laid) };
    let mut moved: Vec<MovedPoint> = Vec::new();
    let mut reach = 0.0f64;
    for pin in pins {
        let Some(held) = corners(mesh, &border, &pin.on_example) else { continue };
        if shares(&held) < INSIDE_MIN {
            return Err(BendError::OnBoundary);
        }
        let at = held.map(|corner| cross.positions[corner.vertex as usize]);
        let edge = (0..3).map(|k| (at[(k + 1) % 3] - at[k]).norm()).sum::<f64>() / 3.0;
        let one = follow.moved(&held, pin.to);
        reach = reach.max(REACH * one.way.norm()).max(REACH_EDGES * edge);
        moved.push(one);
    }
    if moved.is_empty() {
        return Ok(cross.clone());
    }
    let (mut bent, targets) = follow.all(&moved, &border, reach);
    let stays = |v: usize| bent.locations[v] == cross.locations[v] || targets.contains_key(&(v as u32));
    let fixed: Vec<bool> = (0..border.len()).map(|v| border[v] || stays(v)).collect();
    let options = PolishOptions { rounds: ROUNDS, ..PolishOptions::default() };
    polish_within(mesh, cross, &mut bent, input, &fixed, &options);
    let after = folded(mesh, &bent, input, mirror);
    if after.is_empty() {
        return Ok(bent);
    }
    let before = folded(mesh, cross, input, mirror);
    let is_fresh = |f: &u32| before.binary_search(f).is_err();
    if !after.iter().any(is_fresh) {
        return Ok(bent);
    }
    untangle_within(mesh, &mut bent, input, mirror, (&fixed, bvh));
    let mut turned = folded(mesh, &bent, input, mirror);
    turned.retain(is_fresh);
    let (mut all, mut over) = (0.0, 0.0);
    for (t, corners) in mesh.triangles.iter().enumerate().filter(|(_, t)| t.iter().any(|&v| !fixed[v as usize])) {
        let area = area_between(corners.map(|v| cross.positions[v as usize]));
        all += area;
        over += if turned.binary_search(&mesh.polygon_of[t]).is_ok() { area } else { 0.0 };
    }
    if turned.len() > FOLDED_ANYWAY && over > FOLDED * all {
        Err(BendError::Folds { faces: turned.len() })
    } else {
        Ok(bent)
    }
}

/// Polygons that are turned over: they look into the input, and are turned in its chart. One over a crease may look inward without a
/// fold.
fn folded(mesh: &TriMesh, cross: &CrossMap, input: &Chart, mirror: f64) -> Vec<u32> {
    let mut folded = inward(mesh, cross, input, mirror);
    if !folded.is_empty() {
        let turned = turned_in_domain(mesh, cross, input, mirror);
        folded.retain(|f| turned.binary_search(f).is_ok());
    }
    folded
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};
    use std::f64::consts::PI;

    /// A sheet laid on a finer one, vertex on vertex.
    fn laid() -> (TriMesh, Chart, Bvh, CrossMap) {
        let mesh = grid(24, 24, false, false);
        let patch = whole(&grid(48, 48, false, false)).expect("a disc");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let locations: Vec<Location> = mesh.positions.iter().map(|p| bvh.closest(*p).into()).collect();
        let positions = locations.iter().map(|l| l.point(&chart)).collect();
        (mesh, chart, bvh, CrossMap { locations, positions })
    }

    #[test]
    fn a_point_goes_where_it_is_pinned_and_the_far_ones_stay() {
        let (mesh, chart, bvh, cross) = laid();
        let own = Bvh::new(&mesh).closest(Vec3::new(0.52, 0.47, 0.0));
        let on_example = own.into();
        let to = Vec3::new(0.6, 0.5, 0.0);
        let bent = bend(&mesh, &cross, &[Pin { on_example, to }], &chart, 1.0, &bvh).expect("room");
        let corners = mesh.triangles[own.triangle as usize];
        let at: Vec3 = (0..3).map(|k| bent.positions[corners[k] as usize] * own.barycentric[k]).sum();
        assert!((at - to).norm() < 1e-9, "{at}");
        for (v, p) in cross.positions.iter().enumerate() {
            let is_far = (p - Vec3::new(0.52, 0.47, 0.0)).norm() > 0.6 || mesh.boundary_vertices()[v];
            assert!(!is_far || bent.positions[v] == *p, "{p}");
        }
        assert!(inward(&mesh, &bent, &chart, 1.0).is_empty());
        assert_eq!(bend(&mesh, &cross, &[], &chart, 1.0, &bvh), Ok(cross));
    }

    #[test]
    fn a_point_goes_around_an_edge_and_faces_that_do_not_move_keep_their_shapes() {
        // A sheet that is bent about x = 0.5, its halves a tenth apart.
        let bent = |p: &Vec3| {
            let along = p.x - 0.5;
            let angle = (along / 0.05).clamp(-PI / 2.0, PI / 2.0);
            let straight = along.abs() - (0.05 * angle).abs();
            Vec3::new(0.05 * angle.cos() - straight, p.y, 0.05 * angle.sin())
        };
        let (mut mesh, mut fine) = (grid(40, 40, false, false), grid(80, 80, false, false));
        mesh.positions.iter_mut().for_each(|p| *p = bent(p));
        fine.positions.iter_mut().for_each(|p| *p = bent(p));
        let chart = unfold(&whole(&fine).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let locations: Vec<Location> = mesh.positions.iter().map(|p| bvh.closest(*p).into()).collect();
        let cross = CrossMap { positions: mesh.positions.clone(), locations };
        let tree = Bvh::new(&mesh);
        for (from, to) in [(0.42, 0.5), (0.44, 0.56), (0.3, 0.36)] {
            let own = tree.closest(bent(&Vec3::new(from, 0.49, 0.0)));
            let to = bvh.closest(bent(&Vec3::new(to, 0.52, 0.0))).point;
            let pins = [Pin { on_example: own.into(), to }];
            let bent = bend(&mesh, &cross, &pins, &chart, 1.0, &bvh).expect("room");
            let corners = mesh.triangles[own.triangle as usize];
            let at: Vec3 = (0..3).map(|k| bent.positions[corners[k] as usize] * own.barycentric[k]).sum();
            assert!((at - to).norm() < 0.005, "{at} for {to}");
            assert_eq!(folded(&mesh, &bent, &chart, 1.0), Vec::<u32>::new());
        }
        let own = tree.closest(bent(&Vec3::new(0.44, 0.49, 0.0)));
        let stays = [Pin { on_example: own.into(), to: own.point }];
        let stayed = bend(&mesh, &cross, &stays, &chart, 1.0, &bvh).expect("room");
        let moved = stayed.positions.iter().zip(&cross.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(moved < 1e-3, "{moved}");
    }

    #[test]
    fn a_point_beyond_the_others_folds_and_one_at_the_boundary_stays() {
        let (mesh, chart, bvh, cross) = laid();
        let pin = |from: Vec3, to: Vec3| Pin { on_example: Bvh::new(&mesh).closest(from).into(), to };
        let beside = pin(Vec3::new(0.9, 0.5, 0.0), Vec3::new(0.9, 0.5, 0.0));
        let beyond = pin(Vec3::new(0.6, 0.5, 0.0), Vec3::new(0.97, 0.5, 0.0));
        let folds = bend(&mesh, &cross, &[beyond, beside], &chart, 1.0, &bvh);
        assert!(matches!(folds, Err(BendError::Folds { .. })), "{folds:?}");
        let border = pin(Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.2, 0.5, 0.0));
        assert_eq!(bend(&mesh, &cross, &[border], &chart, 1.0, &bvh), Err(BendError::OnBoundary));
    }
}
