//! Polygons to quads: larger polygons are cut into quads, triangles joined or resolved in pairs, doublets removed.
//!
//! A component without boundary has an even number of triangles, since 2E = 3F₃ + 4F₄; one with a boundary gives a lone
//! triangle its end there. *Source:* paper §6, Figs. 10–11. *Ours, not the paper's:* triangles that share an edge are
//! joined where that gives a quad of good shape; pairs are resolved in the order of what they cost.

use super::net::Net;
use super::surgery;
use crate::mesh::Vec3;
use crate::mesh::tri::halves_of;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Worst deviation from a right angle, or fold between them, in degrees, at which two triangles are joined to a quad.
const JOIN_DEVIATION_MAX_DEG: f64 = 65.0;

/// What resolving did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resolved {
    /// Pairs of triangles joined over an edge.
    pub joined: usize,
    /// Cuts made between triangles, or from a triangle to the boundary.
    pub cuts: usize,
    /// Quads that the cuts added.
    pub strip_quads: usize,
    /// Doublets removed.
    pub doublets: usize,
    /// Vertices that were changed.
    pub touched: Vec<u32>,
}

/// Cuts polygons with more than four corners into quads, and a triangle where their number is odd: along the longest edge
/// first. Gives the polygons for which no cut avoids an edge that is there already.
pub fn split_large(net: &mut Net) -> Vec<u32> {
    let large: Vec<u32> = net.faces().filter(|(_, c)| c.len() > 4).map(|(f, _)| f).collect();
    large.into_iter().filter(|&f| !split_polygon(net, f)).collect()
}

/// Cuts one polygon; false if it got stuck half-way.
pub(super) fn split_polygon(net: &mut Net, f: u32) -> bool {
    while net.face(f).len() > 4 {
        let corners = net.face(f).to_vec();
        let n = corners.len();
        let at = |k: usize| net.positions[corners[k % n] as usize];
        let mut edges: Vec<usize> = (0..n).collect();
        edges.sort_by(|&i, &j| (at(j + 1) - at(j)).norm_squared().total_cmp(&(at(i + 1) - at(i)).norm_squared()));
        // The quad along edge k has the corners k − 1, k, k + 1, k + 2; a pentagon leaves a triangle.
        let fits = |k: &usize| {
            let (a, d) = (corners[(k + n - 1) % n], corners[(k + 2) % n]);
            a != d && !net.joined(a, d)
        };
        let Some(k) = edges.into_iter().find(fits) else { return false };
        let quad: Vec<u32> = (0..4).map(|j| corners[(k + n - 1 + j) % n]).collect();
        let rest = (0..n - 2).map(|j| corners[(k + 2 + j) % n]).collect();
        net.set_face(f, rest);
        net.add_face(quad);
    }
    true
}

/// By how much each angle of a quad differs from 90°, in degrees; `None` where an edge has no length.
pub fn deviations_deg(p: [Vec3; 4]) -> [Option<f64>; 4] {
    [0, 1, 2, 3].map(|k| {
        let (e, f) = (p[(k + 3) % 4] - p[k], p[(k + 1) % 4] - p[k]);
        let product = e.norm() * f.norm();
        (product > 0.0).then(|| ((e.dot(&f) / product).clamp(-1.0, 1.0).acos().to_degrees() - 90.0).abs())
    })
}

/// The largest deviation of a quad's angles from 90°, in degrees; 180 where an edge has no length.
pub fn worst_deviation_deg(p: [Vec3; 4]) -> f64 {
    deviations_deg(p).into_iter().map(|d| d.unwrap_or(180.0)).fold(0.0, f64::max)
}

/// The angle between a quad's [halves](halves_of), in degrees.
fn fold_deg(p: [Vec3; 4]) -> f64 {
    let [one, two] = halves_of(p);
    one.angle(&two).to_degrees()
}

/// Joins triangles that share an edge, those first that make the best quads. Returns how many pairs.
pub fn join_triangles(net: &mut Net) -> usize {
    let mut pairs: Vec<(f64, u32, u32, [u32; 4])> = Vec::new();
    for (f, c) in net.faces().filter(|(_, c)| c.len() == 3) {
        for k in 0..3 {
            let (a, b, apex) = (c[k], c[(k + 1) % 3], c[(k + 2) % 3]);
            let Some(g) = net.face_along(b, a).filter(|&g| g > f && net.face(g).len() == 3) else { continue };
            let Some(&other) = net.face(g).iter().find(|&&v| v != a && v != b) else { continue };
            // An end with three edges would be left with two.
            let thins = [a, b].iter().any(|&v| net.at(v).len() <= 3 && !net.on_boundary(v));
            let quad = [apex, a, other, b];
            if other == apex || thins {
                continue;
            }
            let corners = quad.map(|v| net.positions[v as usize]);
            let deviation = worst_deviation_deg(corners).max(fold_deg(corners));
            if deviation <= JOIN_DEVIATION_MAX_DEG {
                pairs.push((deviation, f, g, quad));
            }
        }
    }
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    let mut joined = 0;
    for (_, f, g, quad) in pairs {
        let both_there = net.face(f).len() == 3 && net.face(g).len() == 3;
        let thins = [quad[1], quad[3]].iter().any(|&v| net.at(v).len() <= 3 && !net.on_boundary(v));
        if both_there && !thins {
            net.set_face(f, quad.to_vec());
            net.remove_face(g);
            joined += 1;
        }
    }
    joined
}

/// Resolves the triangles that are left, the cheapest cut first. Some may be left where no path leads out.
pub fn cut_between_triangles(net: &mut Net, result: &mut Resolved) {
    let mut heap = BinaryHeap::new();
    for (f, _) in net.faces().filter(|(_, c)| c.len() == 3) {
        if let Some(cut) = surgery::cheapest(net, f) {
            heap.push(Reverse((cut.cost, f)));
        }
    }
    // A cut that was passed over may have become longer or shorter by those made since: it is looked for again.
    while let Some(Reverse((cost, f))) = heap.pop() {
        if net.face(f).len() != 3 {
            continue;
        }
        let Some(cut) = surgery::cheapest(net, f) else { continue };
        if cut.cost > cost && heap.peek().is_some_and(|Reverse((next, _))| *next < cut.cost) {
            heap.push(Reverse((cut.cost, f)));
            continue;
        }
        if let Some(split) = surgery::apply(net, &cut) {
            result.cuts += 1;
            result.strip_quads += split.len() / 2 - 1;
            result.touched.extend(split);
        }
    }
}

/// Removes doublets: an inner vertex with two quads goes, and the two become one.
pub fn remove_doublets(net: &mut Net, result: &mut Resolved) {
    let mut todo: Vec<u32> = (0..net.positions.len() as u32).collect();
    while let Some(v) = todo.pop() {
        let &[f, g] = net.at(v) else { continue };
        if net.on_boundary(v) || net.face(f).len() != 4 || net.face(g).len() != 4 {
            continue;
        }
        let Some([a, b]) = net.beside(f, v) else { continue };
        let across = |h: u32| net.face(h).iter().copied().find(|&c| c != v && c != a && c != b);
        let (Some(x), Some(y)) = (across(f), across(g)) else { continue };
        if x == y {
            continue;
        }
        // f runs a, v, b, x and g runs b, v, a, y.
        net.set_face(f, vec![a, y, b, x]);
        net.remove_face(g);
        result.doublets += 1;
        result.touched.extend([a, b, x, y]);
        todo.extend([a, b]);
    }
}

/// All of it, on a net of polygons. Polygons or triangles may be left over: the caller checks.
pub fn resolve(net: &mut Net) -> Resolved {
    let mut result = Resolved::default();
    remove_doublets(net, &mut result);
    split_large(net);
    result.joined = join_triangles(net);
    cut_between_triangles(net, &mut result);
    remove_doublets(net, &mut result);
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;

    #[test]
    fn a_doublet_goes_and_takes_one_quad_with_it() {
        let mut net = sheet(2, 2);
        // Cell 0 gets a vertex inside with two edges.
        let v = net.add_vertex(Vec3::new(0.5, 0.5, 0.0));
        net.set_face(0, vec![0, 1, 4, v]);
        net.add_face(vec![0, v, 4, 3]);
        let mut result = Resolved::default();
        remove_doublets(&mut net, &mut result);
        assert_eq!((result.doublets, net.faces().count()), (1, 4));
        assert!(net.at(v).is_empty());
        assert!(net.faces().all(|(_, c)| c.len() == 4));
    }

    #[test]
    fn triangles_of_a_cut_grid_are_joined_again() {
        let mut net = sheet(5, 4);
        for f in 0..20 {
            let c = net.face(f).to_vec();
            net.set_face(f, vec![c[0], c[1], c[2]]);
            net.add_face(vec![c[0], c[2], c[3]]);
        }
        assert_eq!(join_triangles(&mut net), 20);
        assert_eq!(net.faces().count(), 20);
    }

    #[test]
    fn polygons_of_any_size_become_quads() {
        for n in 5..13 {
            // A polygon in the middle, a ring of quads around it.
            let at = |k: u32, r: f64| {
                let a = std::f64::consts::TAU * f64::from(k) / f64::from(n);
                Vec3::new(r * a.cos(), r * a.sin(), 0.0)
            };
            let positions = (0..n).map(|k| at(k, 1.0)).chain((0..n).map(|k| at(k, 2.0))).collect();
            let mut faces: Vec<Vec<u32>> = (0..n).map(|k| vec![k, n + k, n + (k + 1) % n, (k + 1) % n]).collect();
            faces.push((0..n).collect());
            let mut net = Net::new(positions, faces);
            resolve(&mut net);
            assert!(net.faces().all(|(_, c)| c.len() == 4), "{n} corners");
            assert!((0..net.positions.len() as u32).all(|v| net.fan(v).is_some()));
        }
    }
}
