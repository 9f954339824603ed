//! Small handles of a scan, cut: noise joins a surface to itself, where no artist lays quads through.
//!
//! Shapes that are fused from depth pictures have such handles by the dozen, behind ears and between strands of hair. Each is cut along
//! a short loop, which leaves two small holes that lie on each other; they count as any others of a scan. All handles are found
//! at once: the loops of a tree of shortest paths and a tree of the faces that it leaves are a basis. Where one closes there is a
//! handle, and the shortest loops of what lies about that place are short if the handle is small.
//! *Source:* Erickson and Whittlesey 2005 (tree and cotree). *Ours:* many loops of one tree, and what lies about them.

use std::collections::BTreeSet;

use super::mended::by_area;
use super::opened::cut;
use super::split::{Loop, loops};
use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;
use crate::topology::{self, invariants, split_pinched};

/// A handle with a shorter loop, in √area, is noise. *Untuned:* ankles, which are not, have some .15.
const SHORT: f64 = 0.1;
/// So is one with a loop of so many edges of the usual length: it has no form. *Untuned.*
const EDGES: f64 = 5.0;
/// Radius of what is looked through about a place, in longest loops: a small handle there lies within it.
const ABOUT: f64 = 1.5;
/// Trees of the whole surface that are looked through at most: handles that lie beside each other are cut one after the other.
const TREES: usize = 24;
/// A surface of more handles is a lattice, which is meant. *Untuned.*
const HANDLES_MAX: i64 = 256;

/// The surface with the small handles of its largest component cut, and how many were; `None` where it has none. Vertices keep
/// their numbers; copies are appended.
pub fn without_small(surface: &TriMesh) -> Option<(TriMesh, usize)> {
    if surface.triangles.is_empty() {
        return None;
    }
    let (area, triangle_of) = by_area(surface).into_iter().next()?;
    let edge =
        |h: u32| (surface.positions[surface.head(h) as usize] - surface.positions[surface.tail(h) as usize]).norm();
    let edges = surface.twins.len() as u32;
    let most = (SHORT * area.sqrt()).max(EDGES * (0..edges).map(edge).sum::<f64>() / f64::from(edges));
    let mut mesh = surface.clone();
    let mut cuts = 0;
    for _ in 0..TREES {
        stop::ask();
        let (part, _) = topology::submesh(&mesh, &triangle_of);
        if !(1..=HANDLES_MAX).contains(&invariants(&part).genus) {
            break;
        }
        let of_tree = loops(&part, part.triangles[0][0]);
        let about: Vec<Loop> = of_tree.iter().flat_map(|l| about(&part, l.closes_at, ABOUT * most)).collect();
        let rings = apart(&part, of_tree.into_iter().chain(about).collect(), most);
        if rings.is_empty() {
            break;
        }
        cuts += rings.len();
        let edges = rings.iter().flat_map(|ring| (0..ring.len()).map(move |k| [ring[k], ring[(k + 1) % ring.len()]]));
        for h in cut(&part, edges) {
            mesh.twins[(3 * triangle_of[h as usize / 3] + h % 3) as usize] = NONE;
        }
        split_pinched(&mut mesh);
    }
    (cuts > 0).then_some((mesh, cuts))
}

/// The loops of the piece of a surface about a halfedge whose vertices lie within a distance of its head.
fn about(mesh: &TriMesh, halfedge: u32, reach: f64) -> Vec<Loop> {
    let at = mesh.positions[mesh.head(halfedge) as usize];
    let is_near =
        |t: u32| mesh.triangles[t as usize].iter().all(|&v| (mesh.positions[v as usize] - at).norm() <= reach);
    let mut piece = BTreeSet::from([halfedge / 3]);
    let mut todo = vec![halfedge / 3];
    while let Some(t) = todo.pop() {
        stop::pass(1);
        for other in (0..3).map(|k| mesh.twin(3 * t + k)).filter(|&g| g != NONE).map(|g| g / 3) {
            if is_near(other) && piece.insert(other) {
                todo.push(other);
            }
        }
    }
    let piece: Vec<u32> = piece.into_iter().collect();
    let (region, vertex_of) = topology::submesh(mesh, &piece);
    let Ok(own) = piece.binary_search(&(halfedge / 3)) else { return Vec::new() };
    let root = region.head(3 * own as u32 + halfedge % 3);
    let in_mesh = |found: Loop| {
        let ring = found.ring.iter().map(|&v| vertex_of[v as usize]).collect();
        Loop { ring, closes_at: 3 * piece[found.closes_at as usize / 3] + found.closes_at % 3, ..found }
    };
    loops(&region, root).into_iter().map(in_mesh).collect()
}

/// The shortest loops, none longer than `most`, and none as near to another as those that go around one handle: cut along two such,
/// the surface would fall into two.
fn apart(mesh: &TriMesh, mut loops: Vec<Loop>, most: f64) -> Vec<Vec<u32>> {
    loops.retain(|found| found.length <= most);
    loops.sort_by(|a, b| a.length.total_cmp(&b.length).then(a.ring.cmp(&b.ring)));
    let mut is_taken = vec![false; mesh.positions.len()];
    let mut chosen = Vec::new();
    for Loop { ring, .. } in loops {
        if ring.iter().any(|&v| is_taken[v as usize]) {
            continue;
        }
        let at = mesh.positions[ring[0] as usize];
        let is_near = |x: &Vec3| (x - at).norm() <= most;
        is_taken.iter_mut().zip(&mesh.positions).for_each(|(taken, x)| *taken |= is_near(x));
        chosen.push(ring);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;
    use crate::topology::{Components, Topology, primitive};

    /// A sheet of n × n squares with handles: at each place one triangle of a square is joined by a tube to one of a square beside.
    fn with_handles(n: u32, places: &[(u32, u32)]) -> TriMesh {
        let sheet = grid(n, n, false, false);
        let of = |(i, j): (u32, u32)| (2 * (j * n + i)) as usize;
        let mut gone = Vec::new();
        let mut triangles = Vec::new();
        for &(i, j) in places {
            let (from, to) = (of((i, j)), of((i + 3, j)));
            gone.extend([from, to]);
            // The tube runs around one hole as the sheet does, and around the other the other way.
            let (a, [p, q, r]) = (sheet.triangles[from], sheet.triangles[to]);
            let b = [p, r, q];
            for (k, next) in [(0, 1), (1, 2), (2, 0)] {
                triangles.extend([[a[k], a[next], b[next]], [a[k], b[next], b[k]]]);
            }
        }
        let kept = (0..sheet.triangles.len()).filter(|t| !gone.contains(t)).map(|t| sheet.triangles[t]);
        triangles.extend(kept);
        TriMesh::from_triangles(sheet.positions.clone(), triangles).expect("a sheet with handles")
    }

    #[test]
    fn small_handles_are_cut_and_the_sheet_is_one_again() {
        let places: Vec<(u32, u32)> = (0..4).flat_map(|i| (0..4).map(move |j| (2 + 9 * i, 3 + 9 * j))).collect();
        let mesh = with_handles(40, &places);
        assert_eq!(invariants(&mesh).genus, 16);
        let (cut, handles) = without_small(&mesh).expect("handles");
        assert_eq!((handles, invariants(&cut).genus), (16, 0));
        assert_eq!(cut.triangles.len(), mesh.triangles.len(), "no face is lost");
        assert!(mesh.positions.iter().zip(&cut.positions).all(|(a, b)| a == b), "vertices keep their numbers");
        let patch = primitive(&cut, Components::SmallLeftOut).expect("a sheet");
        assert_eq!((patch.topology, patch.holes.len()), (Topology::Disc, 32));
    }

    #[test]
    fn what_has_no_small_handle_stays() {
        assert!(without_small(&grid(20, 20, false, false)).is_none());
        assert!(without_small(&grid(20, 20, true, true)).is_none());
    }
}
