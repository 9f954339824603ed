//! The primitive that a scan is meant to be: its crumbs left out and its small holes counted as filled.
//!
//! A scan has gaps where the scanner saw nothing, and specks that float beside it. A boundary loop of length ℓ encloses
//! at most ℓ²/4π; where that is little of the surface's area, or ℓ is short beside the longest loop, it is a hole and no
//! end of the surface. Of a rag with many loops all but the longest are holes. Holes are filled where the surface is unfolded, and only there: the patch keeps its own triangles.
//! A surface that is a primitive as it is stays so, whatever its loops. *Ours, not the paper's.*

use super::{Patch, Topology, TopologyError, classify, components, submesh};
use crate::mesh::tri::TriMesh;

/// Loops that could enclose at most this share of the area are holes.
const HOLE_AREA_SHARE: f64 = 0.01;
/// So are loops shorter than this share of the longest.
const HOLE_LENGTH_SHARE: f64 = 0.2;
/// A surface with more loops is a rag: only the longest of them is its end, the others are gaps.
const RAG_LOOPS: usize = 12;
/// Components beside the largest are crumbs if together they have at most this share of the area.
const CRUMB_AREA_SHARE: f64 = 0.1;

/// What to do with several components.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Components {
    /// The largest by area is taken if the others are crumbs beside it.
    #[default]
    Crumbs,
    /// The largest by area is taken.
    Largest,
    /// Several are refused.
    Refuse,
}

/// The primitive that `mesh` is, or would be without its crumbs and small holes.
///
/// # Errors
/// [`TopologyError`] where it is none even then.
pub fn primitive(mesh: &TriMesh, policy: Components) -> Result<Patch, TopologyError> {
    let (component, count) = components(mesh);
    let triangle_of: Vec<u32> = if count > 1 {
        let largest = largest(mesh, &component, count, policy)?;
        (0..mesh.triangles.len() as u32).filter(|&t| component[t as usize] == largest).collect()
    } else {
        (0..mesh.triangles.len() as u32).collect()
    };
    let (part, vertex_of) = submesh(mesh, &triangle_of);
    let (topology, holes) = match classify(&part) {
        Ok(topology) => (topology, Vec::new()),
        Err(TopologyError::Unsupported(found)) => {
            let (holes, ends) = holes(&part);
            let topology = match (found.genus, ends) {
                (0, 0) => Topology::Sphere,
                (0, 1) => Topology::Disc,
                (0, 2) => Topology::Annulus,
                (1, 0) => Topology::Torus,
                _ => return Err(TopologyError::Unsupported(found)),
            };
            (topology, holes)
        }
        Err(error) => return Err(error),
    };
    Ok(Patch { topology, mesh: part, vertex_of, triangle_of, holes, left_out: count.saturating_sub(1) })
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
        Components::Crumbs => total - areas[best] <= CRUMB_AREA_SHARE * total,
        Components::Refuse => false,
    };
    if taken { Ok(best as u32) } else { Err(TopologyError::Components { count, largest: sizes[best] }) }
}

/// The loops of a mesh that are holes, and how many are ends.
fn holes(mesh: &TriMesh) -> (Vec<Vec<u32>>, usize) {
    let edge = |h: &u32| (mesh.positions[mesh.head(*h) as usize] - mesh.positions[mesh.tail(*h) as usize]).norm();
    let loops = mesh.boundary_loops();
    let lengths: Vec<f64> = loops.iter().map(|l| l.iter().map(edge).sum()).collect();
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    let area = mesh.total_area();
    let is_rag = lengths.len() > RAG_LOOPS;
    let is_hole = |length: f64| {
        let enclosed = length * length / (4.0 * std::f64::consts::PI);
        enclosed < HOLE_AREA_SHARE * area || length < HOLE_LENGTH_SHARE * longest || (is_rag && length < longest)
    };
    let ends = lengths.iter().filter(|l| !is_hole(**l)).count();
    (loops.into_iter().zip(&lengths).filter(|(_, l)| is_hole(**l)).map(|(l, _)| l).collect(), ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::topology::tests::grid;

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
    fn what_is_a_primitive_stays_as_it_is() {
        // A closed surface with one tiny hole is a disc: its boundary may be meant.
        let patch =
            primitive(&without(&grid(20, 20, false, false), &[405]), Components::default()).expect("an annulus");
        assert_eq!((patch.topology, patch.holes.len()), (Topology::Annulus, 0));
    }

    #[test]
    fn of_a_rag_all_loops_but_the_longest_are_gaps() {
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
        let told = |pinholes: usize| of(&with(pinholes)).map(|p| (p.topology, p.holes.len()));
        assert_eq!(told(3), Ok((Topology::Annulus, 3)));
        assert_eq!(told(14), Ok((Topology::Disc, 15)));
    }

    #[test]
    fn large_openings_are_refused() {
        // Two windows, each a fifth of the sheet.
        let is_window = |t: &u32| matches!(t / 2 % 20, 2..9 | 11..18) && (4..16).contains(&(t / 40));
        let windows: Vec<u32> = (0..800).filter(is_window).collect();
        let error =
            primitive(&without(&grid(20, 20, false, false), &windows), Components::default()).map(|p| p.topology);
        assert!(matches!(error, Err(TopologyError::Unsupported(_))), "{error:?}");
    }

    #[test]
    fn crumbs_go_and_halves_are_refused_unless_asked_for() {
        let together = |scale: f64| {
            let (mut a, b) = (grid(8, 6, true, false), grid(8, 6, true, false));
            let first = a.positions.len() as u32;
            a.positions.extend(b.positions.iter().map(|p| scale * p + Vec3::new(9.0, 0.0, 0.0)));
            a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
            TriMesh::from_triangles(a.positions, a.triangles).expect("two rings")
        };
        let taken = |scale: f64, policy| primitive(&together(scale), policy).map(|p| (p.topology, p.left_out)).ok();
        assert_eq!(taken(0.1, Components::Crumbs), Some((Topology::Annulus, 1)));
        assert_eq!(taken(0.9, Components::Crumbs), None);
        assert_eq!(taken(0.9, Components::Largest), Some((Topology::Annulus, 1)));
        assert_eq!(taken(0.1, Components::Refuse), None);
    }
}
