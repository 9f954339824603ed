//! The quads of an integer-grid map.
//!
//! With the nearest grid point at each corner ([`UnfoldedTriangles`]) a triangle is a point, a side or half of a quad. Halves are
//! glued to each other through the sides between them; two that share a diagonal are a quad. So the faces are quads, save
//! where a diagonal ends at a boundary, and the net is a manifold, whatever the map; where that turned over a quad may be
//! folded. *Ours, not the paper's;* contracting what is nearest to a grid point is the extraction of Huang, Zhou, Niessner,
//! Shewchuk, Guibas, *QuadriFlow* (2018), §5.

use super::super::net::Net;
use super::editable::Freedom;
use super::unfolded::UnfoldedTriangles;
use crate::mesh::Vec3;
use crate::mesh::disjoint::Sets;
use crate::mesh::tri::{NONE, next, prev};
use crate::numerics::stop;

/// How fast a vertex counts less with its distance from its grid point: *untuned*.
const NEARNESS: f64 = 12.0;
/// Weight of a vertex at a singular point.
const SINGULAR_WEIGHT: f64 = 20.0;
/// Weight of the corner of a line: its place is its own.
const CORNER_WEIGHT: f64 = 1e9;

/// The net of an unfolded surface.
pub(super) fn quads(unfolded: &UnfoldedTriangles) -> Net {
    let mesh = &unfolded.mesh;
    let halves: Vec<u32> = (0..mesh.triangles.len() as u32).filter(|&t| is_half(unfolded, t)).collect();
    let mut corners = Sets::new(mesh.twins.len());
    let mut partner = vec![NONE; mesh.twins.len()];
    for h in halves.iter().flat_map(|t| 3 * t..3 * t + 3) {
        let g = across(unfolded, h);
        partner[h as usize] = g;
        if g != NONE {
            corners.join(h, next(g));
            corners.join(next(h), g);
        }
    }
    let places = places(unfolded);
    let mut number = vec![NONE; mesh.twins.len()];
    let mut net = Net::default();
    let mut vertex = |net: &mut Net, h: u32| {
        let root = corners.root(h) as usize;
        if number[root] == NONE {
            number[root] = net.add_vertex(places[mesh.tail(h) as usize]);
        }
        number[root]
    };
    for &t in &halves {
        stop::pass(4);
        let is_diagonal = |h: &u32| unfolded.span(*h).iter().all(|d| *d != 0);
        let Some(h) = (3 * t..3 * t + 3).find(is_diagonal) else { continue };
        let g = partner[h as usize];
        let corners = match g {
            NONE => vec![h, next(h), prev(h)],
            g if h < g => vec![h, prev(g), next(h), prev(h)],
            _ => continue,
        };
        let face = reduced(corners.into_iter().map(|e| vertex(&mut net, e)).collect());
        if face.len() > 2 {
            net.add_face(face);
        }
    }
    net
}

/// A face without corners that stand twice in a row, and without spurs: what is left of less than three corners is no
/// face, and the edges beside it are one.
fn reduced(mut face: Vec<u32>) -> Vec<u32> {
    while face.len() > 2 {
        let n = face.len();
        if let Some(k) = (0..n).find(|&k| face[k] == face[(k + 1) % n]) {
            face.remove(k);
        } else if let Some(k) = (0..n).find(|&k| face[k] == face[(k + 2) % n]) {
            let spur = face[(k + 1) % n];
            face.remove(k);
            face.retain(|v| *v != spur);
        } else {
            break;
        }
    }
    face
}

fn is_half(unfolded: &UnfoldedTriangles, t: u32) -> bool {
    (3 * t..3 * t + 3).all(|h| unfolded.span(h) != [0, 0])
}

/// The halfedge of another half that is glued to one, through triangles that are sides; [`NONE`] at a boundary.
fn across(unfolded: &UnfoldedTriangles, h: u32) -> u32 {
    let mut g = unfolded.mesh.twin(h);
    // Each side is passed once, so this ends.
    while g != NONE && !is_half(unfolded, g / 3) {
        stop::pass(1);
        let other = [next(g), prev(g)].into_iter().find(|&e| unfolded.span(e) != [0, 0]);
        g = other.map_or(NONE, |e| unfolded.mesh.twin(e));
    }
    g
}

/// For each vertex the place of the grid point that is nearest to it.
fn places(unfolded: &UnfoldedTriangles) -> Vec<Vec3> {
    let mesh = &unfolded.mesh;
    let n = mesh.positions.len();
    let mut sets = Sets::new(n);
    let (mut weight, mut line) = (vec![0.0; n], vec![false; n]);
    for h in 0..mesh.twins.len() as u32 {
        stop::pass(1);
        let corner = unfolded.corners[h as usize];
        let away: f64 = (0..2).map(|k| (corner.at[k] - corner.point[k] as f64).powi(2)).sum();
        weight[mesh.tail(h) as usize] = (-NEARNESS * away).exp();
        if unfolded.span(h) == [0, 0] {
            sets.join(mesh.tail(h), mesh.head(h));
        }
        if mesh.is_line(h) {
            (line[mesh.tail(h) as usize], line[mesh.head(h) as usize]) = (true, true);
        }
    }
    let mut star = Vec::new();
    for v in (0..n as u32).filter(|&v| line[v as usize]) {
        mesh.star(v, &mut star);
        if mesh.freedom(&star) == Freedom::None {
            weight[v as usize] = CORNER_WEIGHT;
        }
    }
    unfolded.singular.iter().for_each(|&v| weight[v as usize] = SINGULAR_WEIGHT);
    let mut has_line = vec![false; n];
    (0..n).filter(|&v| line[v]).for_each(|v| has_line[sets.root(v as u32) as usize] = true);
    let (mut sums, mut weights) = (vec![Vec3::zeros(); n], vec![0.0; n]);
    for v in 0..n {
        let root = sets.root(v as u32) as usize;
        if line[v] || !has_line[root] {
            sums[root] += mesh.positions[v] * weight[v];
            weights[root] += weight[v];
        }
    }
    (0..n as u32).map(|v| sets.root(v) as usize).map(|root| sums[root] / weights[root].max(f64::MIN_POSITIVE)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spurs_and_repeated_corners_go() {
        assert_eq!(reduced(vec![1, 2, 3, 4]), [1, 2, 3, 4]);
        assert_eq!(reduced(vec![1, 1, 3, 4]), [1, 3, 4]);
        assert!(reduced(vec![1, 2, 3, 2]).len() < 3);
        assert!(reduced(vec![1, 1, 3, 3]).len() < 3);
    }
}
