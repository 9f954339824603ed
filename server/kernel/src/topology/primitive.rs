//! The primitive that a scan is meant to be: its small components left out and its small holes counted as filled.
//!
//! A scan has gaps where the scanner saw nothing, and specks that float beside it. A boundary loop of length ℓ encloses
//! at most ℓ²/4π; where that is little of the surface's area, or ℓ is short beside the longest loop, it is a hole and no
//! end of the surface. Of a ragged surface, which has many loops, all but the longest are holes. Holes are filled where the
//! surface is unfolded, and only there: the patch keeps its own triangles.
//! A tube one of whose two loops is a hole is a disc: a face with a gap. One both of whose loops are holes is closed, if it widens
//! around them: a body that is open at its eyes. Else a surface that is a primitive as it is stays so, whatever its loops; of a
//! scan, [`closed`] counts the only loop as a hole, too. *Ours, not the paper's.*

use super::holes::filled;
use super::{Patch, Topology, TopologyError, classify, components, invariants, submesh};
use crate::mesh::geodesic::Marcher;
use crate::mesh::tri::TriMesh;
use std::sync::Arc;

/// Loops that could enclose at most this share of the area are holes.
const HOLE_AREA_SHARE: f64 = 0.01;
/// So are loops shorter than this share of the longest.
const HOLE_LENGTH_SHARE: f64 = 0.2;
/// A surface with more loops is ragged: only the longest of them is its end, the others are gaps.
const RAGGED_LOOPS: usize = 12;
/// Components beside the largest are small components if together they have at most this share of the area.
const SMALL_COMPONENTS_SHARE: f64 = 0.1;
/// A surface widens around a loop if, as far from it as it is long, it has this many times the area of a square on its length: a tube
/// has once that area, and a plane 1 + π times.
const WIDENS: f64 = 2.0;

/// What to do with several components.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Components {
    /// The largest by area is taken if the others are small components beside it.
    #[default]
    SmallLeftOut,
    /// The largest by area is taken.
    Largest,
    /// Several are refused.
    Refuse,
}

/// The primitive that `mesh` is, or would be without its small components and small holes.
///
/// # Errors
/// [`TopologyError`] where it is none even then.
pub fn primitive(mesh: &TriMesh, policy: Components) -> Result<Patch, TopologyError> {
    with_most(mesh, policy, usize::MAX)
}

/// The same, where of more than two ends all but the longest two count as holes, too: a torso has four, and is a body all the same.
///
/// # Errors
/// [`TopologyError`] where it is none even then.
pub fn with_two_ends(mesh: &TriMesh, policy: Components) -> Result<Patch, TopologyError> {
    with_most(mesh, policy, 2)
}

fn with_most(mesh: &TriMesh, policy: Components, ends_max: usize) -> Result<Patch, TopologyError> {
    let (component, count) = components(mesh);
    let triangle_of: Vec<u32> = if count > 1 {
        let largest = largest(mesh, &component, count, policy)?;
        (0..mesh.triangles.len() as u32).filter(|&t| component[t as usize] == largest).collect()
    } else {
        (0..mesh.triangles.len() as u32).collect()
    };
    let (part, vertex_of) = submesh(mesh, &triangle_of);
    let (topology, holes) = match classify(&part) {
        Ok(topology) => with_gaps(&part, topology),
        Err(TopologyError::Unsupported(_)) => {
            let (mut holes, ends) = gaps(&part, &|_| false);
            if ends > ends_max {
                let mut others: Vec<Vec<u32>> = part.boundary_loops();
                others.retain(|edges| !holes.contains(edges));
                others.sort_by(|a, b| length(&part, b).total_cmp(&length(&part, a)));
                holes.extend(others.into_iter().skip(ends_max));
            }
            (with_ends(&part, ends.min(ends_max))?, holes)
        }
        Err(error) => return Err(error),
    };
    Ok(Patch { topology, mesh: Arc::new(part), vertex_of, triangle_of, holes, left_out: count.saturating_sub(1) })
}

/// The topology of a primitive once the gaps in it are filled, and these. A tube one of whose loops is a hole is a disc. A tube
/// both of whose loops are holes may be a long tube, and stays one unless it widens around both.
fn with_gaps(mesh: &TriMesh, topology: Topology) -> (Topology, Vec<Vec<u32>>) {
    match topology {
        Topology::Annulus => match gaps(mesh, &|_| false) {
            (holes, 1) => (Topology::Disc, holes),
            (holes, 0) if holes.iter().all(|hole| widens_around(mesh, hole)) => (Topology::Sphere, holes),
            _ => (topology, Vec::new()),
        },
        _ => (topology, Vec::new()),
    }
}

/// Tells whether a surface widens around a loop, as around a hole in it and not as behind the end of a tube.
fn widens_around(mesh: &TriMesh, edges: &[u32]) -> bool {
    let length = length(mesh, edges);
    let on_loop: Vec<u32> = edges.iter().map(|&h| mesh.tail(h)).collect();
    let distance = Marcher::new(mesh).distances_within(&on_loop, 2.0 * length);
    let away = |t: &usize| mesh.triangles[*t].iter().map(|&v| distance[v as usize]).sum::<f64>() / 3.0;
    let near = (0..mesh.triangles.len()).filter(|t| away(t) <= length);
    near.map(|t| mesh.area(t)).sum::<f64>() >= WIDENS * length * length
}

/// The primitive that all of a mesh is, but for gaps.
///
/// # Errors
/// [`TopologyError`] where it is none.
pub fn gapped(mesh: &TriMesh) -> Result<Patch, TopologyError> {
    let patch = super::whole(mesh)?;
    let (topology, holes) = with_gaps(&patch.mesh, patch.topology);
    Ok(Patch { topology, holes, ..patch })
}

/// A disc whose only loop is a hole is a closed surface: a body that is open at an eye ends nowhere. Any other patch stays.
pub fn closed(patch: Patch) -> Patch {
    if patch.topology != Topology::Disc || !patch.holes.is_empty() {
        return patch;
    }
    match gaps(&patch.mesh, &|_| false) {
        (holes, 0) => Patch { topology: Topology::Sphere, holes, ..patch },
        _ => patch,
    }
}

/// A patch with its holes filled, and both ends of a tube, of which examples with fewer ends may bridge one, a long slit as well as a
/// short opening; `None` where there is nothing to fill.
pub fn with_gaps_filled(patch: &Patch) -> Option<TriMesh> {
    let is_tube = patch.topology == Topology::Annulus;
    let gaps = if is_tube { patch.mesh.boundary_loops() } else { patch.holes.clone() };
    (!gaps.is_empty()).then(|| filled(&patch.mesh, &gaps))
}

/// The component of most area, if the policy lets the others go.
fn largest(mesh: &TriMesh, component: &[u32], count: usize, policy: Components) -> Result<u32, TopologyError> {
    let (mut areas, mut sizes) = (vec![0.0; count], vec![0usize; count]);
    for (t, &c) in component.iter().enumerate() {
        areas[c as usize] += mesh.area(t);
        sizes[c as usize] += 1;
    }
    // Of equals the first.
    let best = (0..count).max_by(|&a, &b| areas[a].total_cmp(&areas[b]).then(b.cmp(&a))).unwrap_or(0);
    let total: f64 = areas.iter().sum();
    let taken = match policy {
        Components::Largest => true,
        Components::SmallLeftOut => total - areas[best] <= SMALL_COMPONENTS_SHARE * total,
        Components::Refuse => false,
    };
    if taken { Ok(best as u32) } else { Err(TopologyError::Components { count, largest: sizes[best] }) }
}

/// What a connected mesh is when so many of its loops are its ends and the others are filled.
///
/// # Errors
/// [`TopologyError::Unsupported`] where that is no primitive.
pub(crate) fn with_ends(mesh: &TriMesh, ends: usize) -> Result<Topology, TopologyError> {
    super::with_ends(invariants(mesh), ends)
}

/// The length of a loop of halfedges.
pub(crate) fn length(mesh: &TriMesh, edges: &[u32]) -> f64 {
    let edge = |h: &u32| (mesh.positions[mesh.head(*h) as usize] - mesh.positions[mesh.tail(*h) as usize]).norm();
    edges.iter().map(edge).sum()
}

/// The loops of a mesh, as halfedges, that are holes, and how many are ends: those that `is_end` names are, however short.
pub(crate) fn gaps(mesh: &TriMesh, is_end: &dyn Fn(&[u32]) -> bool) -> (Vec<Vec<u32>>, usize) {
    let loops = mesh.boundary_loops();
    let lengths: Vec<f64> = loops.iter().map(|edges| length(mesh, edges)).collect();
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    let area = mesh.total_area();
    let is_ragged = lengths.len() > RAGGED_LOOPS;
    let is_hole = |(edges, length): (&Vec<u32>, f64)| {
        let enclosed = length * length / (4.0 * std::f64::consts::PI);
        let is_short = enclosed < HOLE_AREA_SHARE * area || length < HOLE_LENGTH_SHARE * longest;
        (is_short || (is_ragged && length < longest)) && !is_end(edges)
    };
    let is_filled: Vec<bool> = loops.iter().zip(lengths).map(is_hole).collect();
    let ends = is_filled.iter().filter(|is_filled| !**is_filled).count();
    (loops.into_iter().zip(is_filled).filter(|(_, is_filled)| *is_filled).map(|(edges, _)| edges).collect(), ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::topology::tests::{ball, grid};

    /// A mesh without some of its triangles.
    fn without(mesh: &TriMesh, gone: &[u32]) -> TriMesh {
        let kept: Vec<u32> = (0..mesh.triangles.len() as u32).filter(|t| !gone.contains(t)).collect();
        submesh(mesh, &kept).0
    }

    #[test]
    fn small_holes_are_no_ends() {
        let patch = primitive(&without(&grid(20, 20, false, false), &[405, 100, 651]), Components::default());
        let patch = patch.expect("a disc");
        assert_eq!((patch.topology, patch.holes.len(), patch.left_out), (Topology::Disc, 3, 0));
        let ring = without(&grid(20, 20, true, true), &[41, 301]);
        assert_eq!(
            primitive(&ring, Components::default()).map(|p| (p.topology, p.holes.len())),
            Ok((Topology::Torus, 2))
        );
    }

    #[test]
    fn a_sheet_with_a_gap_is_a_sheet_and_a_tube_stays_one() {
        let taken_as = |mesh: &TriMesh| {
            let patch = primitive(mesh, Components::default()).expect("a primitive");
            assert_eq!(gapped(mesh).map(|p| (p.topology, p.holes.clone())), Ok((patch.topology, patch.holes.clone())));
            (patch.topology, patch.holes.iter().map(Vec::len).collect::<Vec<_>>())
        };
        let sheet = grid(20, 20, false, false);
        assert_eq!(taken_as(&without(&sheet, &[405])), (Topology::Disc, vec![3]));
        assert_eq!(taken_as(&grid(20, 20, true, false)), (Topology::Annulus, vec![]));
        // A closed surface with one tiny hole is a disc: its boundary may be meant.
        assert_eq!(taken_as(&without(&ball(24), &[7])), (Topology::Disc, vec![]));
        // Both loops of a long tube are short for its area.
        let mut long = grid(20, 20, true, false);
        long.positions.iter_mut().for_each(|p| p.z *= 400.0);
        assert_eq!(taken_as(&long), (Topology::Annulus, vec![]));
        // A body that is open at both eyes is closed.
        assert_eq!(taken_as(&without(&ball(24), &[7, 500])), (Topology::Sphere, vec![3, 3]));
        let window: Vec<u32> =
            (0..800).filter(|t| matches!(t / 2 % 20, 5..14) && (4..14).contains(&(t / 40))).collect();
        assert_eq!(taken_as(&without(&sheet, &window)), (Topology::Annulus, vec![]));
    }

    #[test]
    fn a_disc_that_is_open_at_a_pinhole_is_closed_and_one_that_ends_is_not() {
        let ball = ball(24);
        let closed_without = |gone: &[u32]| {
            let patch = closed(crate::topology::whole(&without(&ball, gone)).expect("a disc"));
            (patch.topology, patch.holes.iter().map(Vec::len).collect::<Vec<_>>())
        };
        assert_eq!(closed_without(&[7]), (Topology::Sphere, vec![3]));
        let cap: Vec<u32> = (0..7 * 48).collect();
        assert_eq!(closed_without(&cap), (Topology::Disc, vec![]));
        assert_eq!(closed_without(&[]), (Topology::Sphere, vec![]));
    }

    #[test]
    fn of_a_ragged_surface_all_loops_but_the_longest_are_gaps() {
        // One window, a fifth of the sheet, alone and among pinholes.
        let window = |t: &u32| matches!(t / 2 % 20, 2..11) && (4..14).contains(&(t / 40));
        let with = |pinholes: usize| -> Vec<u32> {
            let is_pinhole = |t: &u32| {
                t.is_multiple_of(2) && matches!(t / 2 % 20, 13 | 15 | 17) && matches!(t / 40, 1 | 3 | 5 | 7 | 9 | 11)
            };
            let is_hole = |t: &u32| window(t) || is_pinhole(t);
            let mut gone: Vec<u32> = (0..800).filter(is_hole).collect();
            let small: Vec<u32> = gone.iter().copied().filter(|t| !window(t)).skip(pinholes).collect();
            gone.retain(|t| !small.contains(t));
            gone
        };
        let of = |gone: &[u32]| primitive(&without(&grid(20, 20, false, false), gone), Components::default());
        let with_pinholes = |pinholes: usize| of(&with(pinholes)).map(|p| (p.topology, p.holes.len()));
        assert_eq!(with_pinholes(3), Ok((Topology::Annulus, 3)));
        assert_eq!(with_pinholes(14), Ok((Topology::Disc, 15)));
    }

    #[test]
    fn large_openings_are_refused_unless_the_two_longest_are_meant() {
        // Two windows, each a fifth of the sheet.
        let is_window = |t: &u32| matches!(t / 2 % 20, 2..9 | 11..18) && (4..16).contains(&(t / 40));
        let windows: Vec<u32> = (0..800).filter(is_window).collect();
        let error =
            primitive(&without(&grid(20, 20, false, false), &windows), Components::default()).map(|p| p.topology);
        assert!(matches!(error, Err(TopologyError::Unsupported(_))), "{error:?}");
        let sheet = without(&grid(20, 20, false, false), &windows);
        let patch = with_two_ends(&sheet, Components::default()).expect("a tube");
        let lengths: Vec<f64> = sheet.boundary_loops().iter().map(|edges| length(&sheet, edges)).collect();
        let [hole] = &patch.holes[..] else { panic!("{:?}", patch.holes) };
        assert_eq!((patch.topology, lengths.len()), (Topology::Annulus, 3));
        assert!(lengths.iter().all(|other| length(&patch.mesh, hole) <= *other));
    }

    #[test]
    fn small_components_go_and_halves_are_refused_unless_asked_for() {
        let together = |scale: f64| {
            let (mut a, b) = (grid(8, 6, true, false), grid(8, 6, true, false));
            let first = a.positions.len() as u32;
            a.positions.extend(b.positions.iter().map(|p| scale * p + Vec3::new(9.0, 0.0, 0.0)));
            a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
            TriMesh::from_triangles(a.positions, a.triangles).expect("two rings")
        };
        let taken = |scale: f64, policy| primitive(&together(scale), policy).map(|p| (p.topology, p.left_out)).ok();
        assert_eq!(taken(0.1, Components::SmallLeftOut), Some((Topology::Annulus, 1)));
        assert_eq!(taken(0.9, Components::SmallLeftOut), None);
        assert_eq!(taken(0.9, Components::Largest), Some((Topology::Annulus, 1)));
        assert_eq!(taken(0.1, Components::Refuse), None);
    }
}
