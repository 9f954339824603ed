//! A layout that ends where the surface it lies on does.
//!
//! A closed example on a figure that was cut from its base has soles, which lie over the openings at its ankles: the base goes
//! on there. An example with open eyes and an open mouth lies on a scan that is closed there. *Ours, not the paper's.*

use super::is_on_rim;
use crate::compose::net::Net;
use crate::map::assemble::select;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh};
use crate::mesh::{PolyMesh, Vec3, prepare};
use crate::topology;

/// The largest piece of those faces of a layout that keep off the rim of the surface it lies on, of which `rim` says a vertex what
/// counts. No vertex of it is passed by the boundary twice. `None` where nothing is left.
pub fn off_rim(laid: &PolyMesh, surface: &TriMesh, rim: &[bool]) -> Option<PolyMesh> {
    let tree = Bvh::new(surface);
    let on_rim: Vec<bool> = laid.positions.iter().map(|&x| is_on_rim(surface, rim, &tree.closest(x))).collect();
    let keep: Vec<bool> = laid.faces.iter().map(|face| !face.iter().any(|&v| on_rim[v as usize])).collect();
    let mut left = largest(&select(laid, &keep))?;
    loop {
        let pinched = pinched(&left)?;
        if !pinched.contains(&true) {
            return Some(left);
        }
        let keep: Vec<bool> = left.faces.iter().map(|face| !face.iter().any(|&v| pinched[v as usize])).collect();
        left = largest(&select(&left, &keep))?;
    }
}

/// A layout without the openings that the surface it lies on does not have: of its openings as many stay as the surface has
/// loops of its rim, those next to them; the others are closed by a strip of quads. An opening of an odd number of edges stays.
/// Attributes are dropped where faces are added.
pub fn closed_within(laid: &PolyMesh, surface: &TriMesh) -> PolyMesh {
    let rims = surface.boundary_loops();
    let mut openings = openings(laid);
    if openings.len() <= rims.len() {
        return laid.clone();
    }
    let rim: Vec<Vec3> = rims.iter().flatten().map(|&h| surface.positions[surface.tail(h) as usize]).collect();
    let away = |v: u32| rim.iter().map(|x| (x - laid.positions[v as usize]).norm()).fold(f64::INFINITY, f64::min);
    let mean = |opening: &[u32]| opening.iter().map(|&v| away(v)).sum::<f64>() / opening.len() as f64;
    openings.sort_by(|a, b| mean(a).total_cmp(&mean(b)));
    let mut faces = laid.faces.clone();
    for opening in openings.split_off(rims.len()) {
        strip(&opening, &laid.positions).iter().for_each(|face| faces.push(face));
    }
    PolyMesh { positions: laid.positions.clone(), faces, ..PolyMesh::default() }
}

/// The openings of a layout, each in the direction in which a face that fills it runs; none where two meet in a vertex.
fn openings(laid: &PolyMesh) -> Vec<Vec<u32>> {
    let mut loops = Net::from_mesh(laid).loops().unwrap_or_default();
    loops.iter_mut().for_each(|ring| ring.reverse());
    loops
}

/// Quads across a loop, between each edge and the one opposite, in the direction in which their edges are shortest; none for a loop
/// of an odd number of edges.
fn strip(opening: &[u32], positions: &[Vec3]) -> Vec<[u32; 4]> {
    let n = opening.len();
    if n < 4 || n % 2 == 1 {
        return Vec::new();
    }
    let at = |k: usize| opening[k % n];
    let rung = |turn: usize, k: usize| {
        (positions[at(turn + k) as usize] - positions[at(turn + n - 1 - k) as usize]).norm_squared()
    };
    let length = |turn: usize| (0..n / 2).map(|k| rung(turn, k)).sum::<f64>();
    let turn = (0..n / 2).min_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    let quad = |k: usize| [at(turn + k), at(turn + k + 1), at(turn + n - 2 - k), at(turn + n - 1 - k)];
    (0..n / 2 - 1).map(quad).collect()
}

/// The largest piece of a layout by area.
fn largest(laid: &PolyMesh) -> Option<PolyMesh> {
    let mesh = prepare(laid).ok()?.mesh;
    let area = |piece: &Vec<u32>| piece.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
    let piece = topology::pieces(&mesh).into_iter().max_by(|a, b| area(a).total_cmp(&area(b)).then(b.cmp(a)))?;
    let mut keep = vec![false; laid.faces.len()];
    piece.iter().for_each(|&t| keep[mesh.polygon_of[t as usize] as usize] = true);
    Some(select(laid, &keep))
}

/// Which vertices of a layout the boundary passes more than once.
fn pinched(laid: &PolyMesh) -> Option<Vec<bool>> {
    let prepared = prepare(laid).ok()?;
    let mesh = &prepared.mesh;
    // A vertex that preparing has copied lies in the same place as another.
    let mut passes = vec![0u32; laid.positions.len()];
    for h in (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE) {
        let face = laid.faces.face(mesh.polygon_of[h as usize / 3] as usize);
        let at = mesh.positions[mesh.tail(h) as usize];
        if let Some(&v) = face.iter().find(|&&v| laid.positions[v as usize] == at) {
            passes[v as usize] += 1;
        }
    }
    Some(passes.into_iter().map(|count| count > 1).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Polygons;
    use crate::topology::tests::grid;

    /// n × n quads over a square from (low, low) to (high, high).
    fn sheet(n: u32, low: f64, high: f64) -> PolyMesh {
        let at = |k: u32| low + (high - low) * f64::from(k) / f64::from(n);
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| Vec3::new(at(i), at(j), 0.0))).collect();
        let mut faces = Polygons::default();
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
            faces.push(&[(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| j * (n + 1) + i));
        }
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    #[test]
    fn what_reaches_over_the_rim_is_left_out_and_what_lies_within_stays() {
        let surface = grid(20, 20, false, false);
        let rim = surface.boundary_vertices();
        let within = sheet(6, 0.2, 0.8);
        assert_eq!(off_rim(&within, &surface, &rim).map(|left| left.faces.len()), Some(36));
        // A column and a row of vertices lie beyond.
        let over = sheet(6, 0.2, 1.1);
        let left = off_rim(&over, &surface, &rim).expect("what lies within");
        assert_eq!(left.faces.len(), 25);
        assert!(off_rim(&sheet(3, 2.0, 3.0), &surface, &rim).is_none());
        // Only one side of the rim counts.
        let right: Vec<bool> = surface.positions.iter().map(|x| x.x == 1.0).collect();
        let left = off_rim(&over, &surface, &right).expect("what lies within");
        assert_eq!(left.faces.len(), 30);
    }

    #[test]
    fn faces_that_meet_at_a_corner_only_are_no_piece() {
        let mut laid = sheet(4, 0.1, 0.9);
        let keep: Vec<bool> = (0..16).map(|f| matches!(f, 0 | 1 | 4 | 5 | 10 | 11 | 14 | 15)).collect();
        laid = select(&laid, &keep);
        let surface = grid(20, 20, false, false);
        let left = off_rim(&laid, &surface, &surface.boundary_vertices()).expect("one of both");
        assert_eq!(left.faces.len(), 4);
    }

    #[test]
    fn openings_that_the_surface_does_not_have_are_closed_and_the_outer_one_stays() {
        let surface = grid(20, 20, false, false);
        let whole = sheet(6, 0.0, 1.0);
        assert!(closed_within(&whole, &surface) == whole);
        // One face, and two by two: as many quads fill one, and fewer the other, whose middle vertex is gone.
        for (left_out, count) in [(&[7][..], 36), (&[14, 15, 20, 21], 35)] {
            let keep: Vec<bool> = (0..36).map(|f| !left_out.contains(&f)).collect();
            let filled = closed_within(&select(&whole, &keep), &surface);
            assert_eq!((filled.faces.len(), openings(&filled).len()), (count, 1));
            let area = prepare(&filled).expect("a sheet").mesh.total_area();
            assert!((area - 1.0).abs() < 1e-9, "each face looks the same way: {area}");
        }
    }
}
