//! The point of a triangle mesh that is closest to a given one.
//!
//! A binary tree of boxes over the triangles, split at the median along the longest axis of their centres. Boxes are kept
//! in single precision, rounded outwards; distances to triangles are exact in double precision. Ties go to the triangle
//! with the lowest number, so that the answer does not depend on the tree. A mesh of needles gets turned boxes besides
//! ([`turned`]).

mod turned;

use super::Vec3;
use super::tri::{NONE, TriMesh};
use crate::numerics::stop;
use turned::Turned;

/// Triangles in a leaf.
const LEAF_SIZE: usize = 4;
/// The deepest that a median split over `u32` triangles can get, with room for the pushes of one node.
const STACK_SIZE: usize = 64;

/// A tree of boxes over the triangles of a mesh.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    /// A turned box for each node; none where the mesh is not of needles.
    turned: Vec<Turned>,
    /// Corners of the triangles, in the order of the leaves.
    corners: Vec<[Vec3; 3]>,
    /// Number of the triangle, in the order of the leaves.
    triangle_of: Vec<u32>,
}

/// The closest point and where it lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// The triangle; [`NONE`] where the mesh has none or the given point is not finite.
    pub triangle: u32,
    /// Its weights of the triangle's corners; none is negative, and they sum to 1.
    pub barycentric: [f64; 3],
    /// The point itself.
    pub point: Vec3,
    /// Its distance, in the mesh's units.
    pub distance: f64,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    /// A leaf's first triangle; an inner node's second child (its first is the next node).
    link: u32,
    /// Triangles of a leaf; 0 for inner nodes.
    count: u32,
}

impl Bvh {
    /// Builds the tree.
    pub fn new(mesh: &TriMesh) -> Self {
        let corners: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
        let centres: Vec<Vec3> = corners.iter().map(|[a, b, c]| (a + b + c) / 3.0).collect();
        let mut order: Vec<u32> = (0..corners.len() as u32).collect();
        let mut nodes = Vec::with_capacity(corners.len());
        let (mut turned, has_needles) = (Vec::new(), turned::has_needles(&corners));
        // Ranges of `order` still to be made into nodes, each with the parent whose second child it is.
        let mut todo = vec![(0, order.len(), None)];
        while let Some((start, end, parent)) = todo.pop() {
            if start == end {
                continue;
            }
            if let Some(parent) = parent {
                let number = nodes.len() as u32;
                let node: &mut Node = &mut nodes[parent];
                node.link = number;
            }
            stop::pass(end - start);
            let slice = &mut order[start..end];
            let (low, high) = bounds(slice.iter().flat_map(|t| corners[*t as usize]));
            let is_leaf = slice.len() <= LEAF_SIZE;
            let count = if is_leaf { slice.len() as u32 } else { 0 };
            nodes.push(Node { low: round_down(low), high: round_up(high), link: start as u32, count });
            if has_needles {
                turned.push(Turned::of(slice.iter().map(|t| &corners[*t as usize])));
            }
            if is_leaf {
                continue;
            }
            let (low, high) = bounds(slice.iter().map(|t| centres[*t as usize]));
            let axis = (high - low).imax();
            let middle = slice.len() / 2;
            slice.select_nth_unstable_by(middle, |s, t| {
                centres[*s as usize][axis].total_cmp(&centres[*t as usize][axis]).then(s.cmp(t))
            });
            todo.push((start + middle, end, Some(nodes.len() - 1)));
            todo.push((start, start + middle, None));
        }
        let corners = order.iter().map(|t| corners[*t as usize]).collect();
        Self { nodes, turned, corners, triangle_of: order }
    }

    /// The closest point of the mesh.
    pub fn closest(&self, point: Vec3) -> Closest {
        stop::poll();
        let mut best = Closest { triangle: NONE, barycentric: [0.0; 3], point, distance: f64::INFINITY };
        if self.nodes.is_empty() || point.iter().any(|x| !x.is_finite()) {
            return best;
        }
        let mut best_squared = f64::INFINITY;
        let mut stack = [(0u32, 0.0f64); STACK_SIZE];
        stack[0] = (0, self.bound(0, &point));
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (number, bound) = stack[height];
            if bound > best_squared {
                continue;
            }
            let node = &self.nodes[number as usize];
            if node.count > 0 {
                let range = node.link as usize..(node.link + node.count) as usize;
                for (corners, triangle) in self.corners[range.clone()].iter().zip(&self.triangle_of[range]) {
                    let barycentric = closest_on_triangle(corners, &point);
                    let at = combine(corners, barycentric);
                    let squared = (at - point).norm_squared();
                    if squared < best_squared || (squared == best_squared && *triangle < best.triangle) {
                        best_squared = squared;
                        best = Closest { triangle: *triangle, barycentric, point: at, distance: 0.0 };
                    }
                }
                continue;
            }
            let first = (number + 1, self.bound(number + 1, &point));
            let second = (node.link, self.bound(node.link, &point));
            let (near, far) = if first.1 <= second.1 { (first, second) } else { (second, first) };
            for child in [far, near] {
                if child.1 <= best_squared {
                    stack[height] = child;
                    height += 1;
                }
            }
        }
        best.distance = best_squared.sqrt();
        best
    }

    /// A lower bound of the squared distance from a point to what is below a node.
    #[inline]
    fn bound(&self, number: u32, point: &Vec3) -> f64 {
        let along_axes = self.nodes[number as usize].distance_squared(point);
        self.turned.get(number as usize).map_or(along_axes, |turned| along_axes.max(turned.distance_squared(point)))
    }
}

impl Node {
    /// A lower bound of the squared distance from a point to what is in the box.
    #[inline]
    fn distance_squared(&self, point: &Vec3) -> f64 {
        let mut sum = 0.0;
        for k in 0..3 {
            let outside = (f64::from(self.low[k]) - point[k]).max(point[k] - f64::from(self.high[k])).max(0.0);
            sum += outside * outside;
        }
        sum
    }
}

fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    let start = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    points.fold(start, |(low, high), p| (low.inf(&p), high.sup(&p)))
}

fn round_down(v: Vec3) -> [f32; 3] {
    [v.x, v.y, v.z].map(|x| if f64::from(x as f32) <= x { x as f32 } else { (x as f32).next_down() })
}

fn round_up(v: Vec3) -> [f32; 3] {
    [v.x, v.y, v.z].map(|x| if f64::from(x as f32) >= x { x as f32 } else { (x as f32).next_up() })
}

#[inline]
fn combine([a, b, c]: &[Vec3; 3], [u, v, w]: [f64; 3]) -> Vec3 {
    a * u + b * v + c * w
}

/// Weights of the point of a triangle that is closest to `p`. *Source:* Ericson, Real-Time Collision Detection, §5.1.5.
#[inline]
fn closest_on_triangle([a, b, c]: &[Vec3; 3], p: &Vec3) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = ratio(d1, d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = ratio(d2, d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    let (along_c, along_b) = (d4 - d3, d5 - d6);
    if va <= 0.0 && along_c >= 0.0 && along_b >= 0.0 {
        let w = ratio(along_c, along_c + along_b);
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    if sum > 0.0 {
        let (v, w) = (vb / sum, vc / sum);
        [(1.0 - v - w).max(0.0), v, w]
    } else {
        [1.0, 0.0, 0.0]
    }
}

#[inline]
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bumpy sheet of `2 n²` triangles.
    fn sheet(n: usize) -> TriMesh {
        let at = |x: usize, y: usize| (y * (n + 1) + x) as u32;
        let height = |x: usize, y: usize| ((x * 7 + y * 13) % 11) as f64 / 22.0;
        let positions =
            (0..=n).flat_map(|y| (0..=n).map(move |x| Vec3::new(x as f64, y as f64, height(x, y)))).collect();
        let cells = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
        let triangles = cells
            .flat_map(|(x, y)| {
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        TriMesh::from_triangles(positions, triangles).expect("manifold")
    }

    /// Points in and around the sheet, without chance.
    fn points(n: usize, count: usize) -> impl Iterator<Item = Vec3> {
        let fraction = |k: usize, step: f64| (k as f64 * step).fract() * 1.4 - 0.2;
        (0..count).map(move |k| {
            Vec3::new(
                fraction(k, 0.618_034) * n as f64,
                fraction(k, 0.754_878) * n as f64,
                3.0 * fraction(k, 0.569_840),
            )
        })
    }

    fn by_search(mesh: &TriMesh, p: Vec3) -> (f64, u32) {
        let mut best = (f64::INFINITY, NONE);
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let corners = corners.map(|v| mesh.positions[v as usize]);
            let squared = (combine(&corners, closest_on_triangle(&corners, &p)) - p).norm_squared();
            if squared < best.0 {
                best = (squared, t as u32);
            }
        }
        (best.0.sqrt(), best.1)
    }

    #[test]
    fn the_tree_finds_what_a_search_finds() {
        let mesh = sheet(12);
        let bvh = Bvh::new(&mesh);
        for p in points(12, 500) {
            let found = bvh.closest(p);
            assert_eq!((found.distance, found.triangle), by_search(&mesh, p));
            let corners = mesh.triangles[found.triangle as usize].map(|v| mesh.positions[v as usize]);
            assert!((combine(&corners, found.barycentric) - found.point).norm() < 1e-12);
            assert!(found.barycentric.iter().all(|w| *w >= 0.0));
            assert!((found.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    /// A bumpy fan of `n` needles around one vertex.
    fn fan(n: usize) -> TriMesh {
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
        let rim = (0..n).map(|i| Vec3::new(angle(i).cos(), angle(i).sin(), 0.1 * (9.0 * angle(i)).sin()));
        let positions = std::iter::once(Vec3::zeros()).chain(rim).collect();
        let triangles = (0..n as u32).map(|i| [0, 1 + i, 1 + (i + 1) % n as u32]).collect();
        TriMesh::from_triangles(positions, triangles).expect("manifold")
    }

    #[test]
    fn among_needles_the_tree_finds_the_same_by_turned_boxes() {
        let mesh = fan(700);
        let bvh = Bvh::new(&mesh);
        assert_eq!((bvh.turned.len(), Bvh::new(&sheet(12)).turned.len()), (bvh.nodes.len(), 0));
        let around = points(1, 300).map(|p| Vec3::new(3.0 * p.x - 1.5, 3.0 * p.y - 1.5, 0.3 * (p.z - 1.5)));
        // On the vertices, too, where two needles are as close as each other, or all.
        for p in around.chain(mesh.positions.iter().copied().step_by(7)).chain([Vec3::new(0.0, 0.0, 0.2)]) {
            let found = bvh.closest(p);
            assert_eq!((found.distance, found.triangle), by_search(&mesh, p));
        }
    }

    #[test]
    fn points_on_the_mesh_are_at_no_distance_and_ties_go_to_the_lowest_triangle() {
        let mesh = sheet(9);
        let bvh = Bvh::new(&mesh);
        for (v, p) in mesh.positions.iter().enumerate() {
            let found = bvh.closest(*p);
            let lowest = mesh.triangles.iter().position(|t| t.contains(&(v as u32))).map(|t| t as u32);
            assert_eq!((found.distance, Some(found.triangle)), (0.0, lowest));
        }
    }

    #[test]
    fn no_mesh_no_number_and_no_extent_are_no_trouble() {
        assert_eq!(Bvh::new(&TriMesh::default()).closest(Vec3::zeros()).triangle, NONE);
        let mut flat = sheet(40);
        flat.positions.iter_mut().for_each(|p| *p = Vec3::new(1.0, 2.0, 3.0));
        let bvh = Bvh::new(&flat);
        let found = bvh.closest(Vec3::zeros());
        assert_eq!((found.triangle, found.distance), (0, 14f64.sqrt()));
        assert_eq!(bvh.closest(Vec3::new(f64::NAN, 0.0, 0.0)).triangle, NONE);
    }
}
