//! A map bent by hand: points of the example are taken to places on the input, and what is around follows.
//!
//! The corners of the face that holds a point are moved by what the point is to be moved; the move is continued over some rings
//! of vertices, the more the longer it is ([`spread`]), and these come to rest between the moved ones and those beyond
//! ([`polish_within`]). No chart is asked: a map that no registration made can be bent. *Ours, not the paper's.*

use super::CrossMap;
use super::polish::{PolishOptions, polish_within};
use super::snap::Targets;
use super::snap::spread::{RINGS, spread};
use super::untangle::inward;
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::unfold::Chart;

/// Rings for each edge length that is moved.
const RINGS_PER_EDGE: f64 = 3.0;
const RINGS_MAX: usize = 24;
/// Least share of a point that corners inside have to hold, for it to be moved by them.
const INSIDE_MIN: f64 = 0.2;
/// A corner that holds less of a point than this is not moved for it.
const HOLDS_MIN: f64 = 1e-3;
const ROUNDS: usize = 4;

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
    let mut targets = Targets::new();
    let mut longest = 0.0f64;
    for pin in pins {
        let Some(corners) = mesh.triangles.get(pin.on_example.triangle as usize) else { continue };
        let held = pin.on_example.barycentric;
        let point: Vec3 = (0..3).map(|k| cross.positions[corners[k] as usize] * held[k]).sum();
        let moves = |k: &usize| !border[corners[*k] as usize] && held[*k] > HOLDS_MIN;
        let share: f64 = (0..3).filter(moves).map(|k| held[k]).sum();
        if share < INSIDE_MIN {
            return Err(BendError::OnBoundary);
        }
        let step = (pin.to - point) / share;
        longest = longest.max(step.norm());
        for k in (0..3).filter(moves) {
            targets.insert(corners[k], bvh.closest(cross.positions[corners[k] as usize] + step).into());
        }
    }
    if targets.is_empty() {
        return Ok(cross.clone());
    }
    let edges = mesh.triangles.iter().flat_map(|t| [0, 1, 2].map(|k| [t[k], t[(k + 1) % 3]]));
    let length = |[a, b]: [u32; 2]| (cross.positions[b as usize] - cross.positions[a as usize]).norm();
    let edge = edges.map(length).sum::<f64>() / (3 * mesh.triangles.len()).max(1) as f64;
    let more = (RINGS_PER_EDGE * longest / edge.max(f64::MIN_POSITIVE)).min(RINGS_MAX as f64) as usize;
    let mut bent = spread(mesh, cross, input, &targets, RINGS + more);
    let stays = |v: usize| bent.locations[v] == cross.locations[v] || targets.contains_key(&(v as u32));
    let fixed: Vec<bool> = (0..border.len()).map(|v| border[v] || stays(v)).collect();
    let options = PolishOptions { rounds: ROUNDS, ..PolishOptions::default() };
    polish_within(mesh, &mut bent, input, mirror, &fixed, &options);
    let turned = |cross: &CrossMap| inward(mesh, cross, input, mirror).len();
    let (before, after) = (turned(cross), turned(&bent));
    if after > before { Err(BendError::Folds { faces: after - before }) } else { Ok(bent) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

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
