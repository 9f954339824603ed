//! The point of a triangle mesh that is closest to a given one.
//!
//! A tree of boxes over the triangles, four to a node, split at the medians along the longest axes of their centres.
//! Boxes are kept and compared in single precision, about the middle of the mesh, since a scan may lie far from the
//! origin, and rounded so that they bound from below; distances to triangles are exact in double precision. Ties go to
//! the triangle with the lowest number, so that the answer does not depend on the tree. A mesh of needles gets turned
//! boxes besides ([`oriented_box`]).

mod oriented_box;

use super::tri::{NONE, TriMesh};
use super::{Vec3, bounding_box};
use crate::numerics::{in_halves, many_in_halves, stop};
use oriented_box::OrientedBox;
use std::ops::Range;

/// Children of a node: as many as the narrowest vectors hold.
const WIDTH: usize = 4;
/// The deepest that median splits over `u32` triangles can get is 16 nodes; each leaves all children but one to do.
const STACK_SIZE: usize = 64;
/// A child that is a triangle has this bit, one that is a node has not.
const TRIANGLE: u32 = 1 << 31;
/// Triangles from which on half of the tree is built on a second thread: some milliseconds.
const MANY: usize = 1 << 14;
/// Sums of single precision may be too large by this share of them, and where they are hardly above zero, by this value.
const ROOM: f32 = 1e-6;
const LEAST: f32 = f32::MIN_POSITIVE;

/// A tree of boxes over the triangles of a mesh.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    /// A turned box for each node; none where the mesh is not of needles.
    turned: Vec<OrientedBox>,
    /// Corners of the triangles, in the order of the leaves.
    corners: Vec<[Vec3; 3]>,
    /// Number of the triangle, in the order of the leaves.
    triangle_of: Vec<u32>,
    /// Where boxes have their origin.
    middle: Vec3,
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

impl Closest {
    /// The vertex of the triangle with the greatest weight; `None` where there is no triangle.
    pub fn vertex(&self, mesh: &TriMesh) -> Option<u32> {
        let corners = mesh.triangles.get(self.triangle as usize)?;
        (0..3).max_by(|&a, &b| self.barycentric[a].total_cmp(&self.barycentric[b])).map(|most| corners[most])
    }
}

/// The boxes of a node's children, by axis, and which these are: [`NONE`], or a node, or, with the bit [`TRIANGLE`], a
/// triangle in the order of the leaves.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Node {
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
    children: [u32; WIDTH],
}

/// A triangle while the tree is built.
#[derive(Clone, Copy)]
struct Item {
    centre: [f32; 3],
    triangle: u32,
}

impl Bvh {
    /// Builds the tree.
    pub fn new(mesh: &TriMesh) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
        let middle = middle(mesh.triangles.iter().flat_map(corners));
        let item = |(t, c): (usize, &[u32; 3])| {
            let centre = corners(c).iter().sum::<Vec3>() / 3.0 - middle;
            Item { centre: [centre.x, centre.y, centre.z].map(|x| x as f32), triangle: t as u32 }
        };
        let mut items: Vec<Item> = mesh.triangles.iter().enumerate().map(item).collect();
        let corners_of = |item: &Item| corners(&mesh.triangles[item.triangle as usize]);
        let (nodes, ranges) = tree_of(&mut items, &corners_of, middle);
        let corners: Vec<[Vec3; 3]> = items.iter().map(corners_of).collect();
        let mut turned = Vec::new();
        if oriented_box::has_needles(&corners) {
            turned = ranges.into_iter().map(|range| OrientedBox::of(corners[range].iter())).collect();
        }
        Self { nodes, turned, corners, triangle_of: items.into_iter().map(|item| item.triangle).collect(), middle }
    }

    /// The closest point of the mesh.
    pub fn closest(&self, point: Vec3) -> Closest {
        stop::poll();
        let mut best = Closest { triangle: NONE, barycentric: [0.0; 3], point, distance: f64::INFINITY };
        if self.nodes.is_empty() || point.iter().any(|x| !x.is_finite()) {
            return best;
        }
        let (above, below) = (round_up(point, self.middle), round_down(point, self.middle));
        // The bar is the best in single precision, rounded up. Places in `todo` are taken modulo its length, which they never reach, so
        // that no bound is checked.
        let (mut best_squared, mut bar) = (f64::INFINITY, f32::MAX);
        let mut todo = [(0u32, 0.0f32); STACK_SIZE];
        let mut height = 0;
        let mut child = 0u32;
        loop {
            if child & TRIANGLE != 0 {
                let at = (child & !TRIANGLE) as usize;
                let (corners, triangle) = (&self.corners[at], self.triangle_of[at]);
                let barycentric = closest_on_triangle(corners, &point);
                let on = combine(corners, barycentric);
                let squared = (on - point).norm_squared();
                if squared < best_squared || (squared == best_squared && triangle < best.triangle) {
                    (best_squared, bar) = (squared, single_above(squared));
                    best = Closest { triangle, barycentric, point: on, distance: 0.0 };
                }
            } else {
                let node = &self.nodes[child as usize];
                let mut bounds = node.bounds(&above, &below);
                if !self.turned.is_empty() {
                    self.raise(&mut bounds, node, (&point, bar));
                }
                let mut nearest = 0;
                for slot in 1..WIDTH {
                    nearest = if bounds[slot] < bounds[nearest] { slot } else { nearest };
                }
                // The nearest is next. The others are put off in no order, since most are dropped unseen, and without a branch that
                // the processor would have to guess.
                for slot in 0..WIDTH {
                    todo[height % STACK_SIZE] = (node.children[slot], bounds[slot]);
                    let is_worth_it = (bounds[slot] <= bar) & (node.children[slot] != NONE) & (slot != nearest);
                    height += usize::from(is_worth_it);
                }
                if bounds[nearest] <= bar {
                    child = node.children[nearest];
                    continue;
                }
            }
            child = loop {
                if height == 0 {
                    best.distance = best_squared.sqrt();
                    return best;
                }
                height -= 1;
                let (other, bound) = todo[height % STACK_SIZE];
                if bound <= bar {
                    break other;
                }
            };
        }
    }

    /// The closest points of the mesh for many points, half of them on a second thread.
    pub fn closest_to_all(&self, points: &[Vec3]) -> Vec<Closest> {
        many_in_halves(points, |&p| self.closest(p))
    }

    /// Raises lower bounds of the squared distances from a point to a node's children by their turned boxes, where they are not
    /// above the bar already.
    fn raise(&self, bounds: &mut [f32; WIDTH], node: &Node, (point, bar): (&Vec3, f32)) {
        for (bound, &child) in bounds.iter_mut().zip(&node.children).filter(|(bound, _)| **bound <= bar) {
            let turned = self.turned.get(child as usize);
            *bound = turned.map_or(*bound, |turned| bound.max(single_below(turned.distance_squared(point))));
        }
    }
}

/// The nodes over some triangles, the root first, and the range of triangles below each.
type Subtree = (Vec<Node>, Vec<Range<usize>>);

/// The nodes over some triangles, which are sorted into the order of the leaves; half of many on a second thread.
fn tree_of(items: &mut [Item], corners: &(impl Fn(&Item) -> [Vec3; 3] + Sync), middle: Vec3) -> Subtree {
    if items.len() < MANY {
        return subtree(items, corners, middle);
    }
    stop::pass(items.len());
    let ranges = parts(items, 0..items.len());
    let built = in_halves(&ranges, |range| {
        let mut own = items[range.clone()].to_vec();
        let below = subtree(&mut own, corners, middle);
        (own, below)
    });
    let (mut nodes, mut below) = (vec![Node::EMPTY], Vec::new());
    below.push(0..items.len());
    for (slot, (range, (own, (of_part, ranges)))) in ranges.into_iter().zip(built).enumerate() {
        items[range.clone()].copy_from_slice(&own);
        let first = nodes.len() as u32;
        let Some(top) = of_part.first() else { continue };
        let box_of = top.whole();
        nodes[0].put(slot, first, box_of);
        nodes.extend(of_part.into_iter().map(|node| node.behind(first, range.start as u32)));
        below.extend(ranges.into_iter().map(|of| of.start + range.start..of.end + range.start));
    }
    (nodes, below)
}

/// The same on one thread.
fn subtree(items: &mut [Item], corners: &impl Fn(&Item) -> [Vec3; 3], middle: Vec3) -> Subtree {
    let mut nodes: Vec<Node> = Vec::with_capacity(items.len() / 2 + 1);
    let mut ranges = Vec::with_capacity(items.len() / 2 + 1);
    // Ranges of `items` still to be made into nodes, each with the place among its parent's children.
    let mut todo = vec![(0..items.len(), None)];
    while let Some((range, parent)) = todo.pop() {
        if range.is_empty() {
            continue;
        }
        let number = nodes.len();
        if let Some((parent, slot)) = parent {
            let parent: &mut Node = &mut nodes[parent];
            parent.children[slot] = number as u32;
        }
        stop::pass(range.len());
        let mut node = Node::EMPTY;
        for (slot, part) in parts(items, range.clone()).into_iter().enumerate() {
            match part.len() {
                0 => {}
                1 => node.children[slot] = part.start as u32 | TRIANGLE,
                _ => todo.push((part, Some((number, slot)))),
            }
        }
        nodes.push(node);
        ranges.push(range);
    }
    // A node comes before its children.
    for number in (0..nodes.len()).rev() {
        for slot in 0..WIDTH {
            let child = nodes[number].children[slot];
            let box_of = match child {
                NONE => continue,
                _ if child & TRIANGLE == 0 => nodes[child as usize].whole(),
                _ => {
                    let [a, b, c] = corners(&items[(child & !TRIANGLE) as usize]);
                    (round_down(a.inf(&b).inf(&c), middle), round_up(a.sup(&b).sup(&c), middle))
                }
            };
            nodes[number].put(slot, child, box_of);
        }
    }
    (nodes, ranges)
}

/// Divides a range of triangles into up to four, twice at the median along the longest axis. Those that are more than a
/// node's, but for the last, are of a multiple of its width, so that most nodes are full.
fn parts(items: &mut [Item], range: Range<usize>) -> [Range<usize>; WIDTH] {
    if range.len() <= WIDTH {
        return std::array::from_fn(|k| (range.start + k).min(range.end)..(range.start + k + 1).min(range.end));
    }
    let middle = halve(items, range.clone());
    let (first, second) = (halve(items, range.start..middle), halve(items, middle..range.end));
    [range.start..first, first..middle, middle..second, second..range.end]
}

/// Sorts a range of triangles into two along the longest axis of their centres, and tells where the second begins.
fn halve(items: &mut [Item], range: Range<usize>) -> usize {
    if range.len() <= WIDTH {
        return range.end;
    }
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in &items[range.clone()] {
        for k in 0..3 {
            (low[k], high[k]) = (low[k].min(item.centre[k]), high[k].max(item.centre[k]));
        }
    }
    let size = [0, 1, 2].map(|k| high[k] - low[k]);
    let longest = if size[0] >= size[1] && size[0] >= size[2] { 0 } else { 1 + usize::from(size[2] > size[1]) };
    let middle = (range.len() / 2).next_multiple_of(WIDTH);
    items[range.clone()].select_nth_unstable_by(middle, |s, t| {
        s.centre[longest].total_cmp(&t.centre[longest]).then(s.triangle.cmp(&t.triangle))
    });
    range.start + middle
}

impl Node {
    const EMPTY: Self =
        Self { low: [[f32::INFINITY; WIDTH]; 3], high: [[f32::NEG_INFINITY; WIDTH]; 3], children: [NONE; WIDTH] };

    /// Takes a child with its box.
    fn put(&mut self, slot: usize, child: u32, (low, high): ([f32; 3], [f32; 3])) {
        self.children[slot] = child;
        for k in 0..3 {
            (self.low[k][slot], self.high[k][slot]) = (low[k], high[k]);
        }
    }

    /// The same behind so many other nodes and triangles.
    fn behind(mut self, nodes: u32, triangles: u32) -> Self {
        for child in self.children.iter_mut().filter(|child| **child != NONE) {
            *child += if *child & TRIANGLE == 0 { nodes } else { triangles };
        }
        self
    }

    /// Lower bounds of the squared distances from a point, of which the next single-precision numbers above and below are
    /// given, to what is in the boxes.
    #[inline]
    fn bounds(&self, above: &[f32; 3], below: &[f32; 3]) -> [f32; WIDTH] {
        // Not `f32::max`, which takes care of what is no number.
        let larger = |a: f32, b: f32| if a > b { a } else { b };
        let mut sums = [0.0; WIDTH];
        for k in 0..3 {
            for (slot, sum) in sums.iter_mut().enumerate() {
                let outside = larger(larger(self.low[k][slot] - above[k], below[k] - self.high[k][slot]), 0.0);
                *sum += outside * outside;
            }
        }
        sums.map(|sum| (if sum < f32::MAX { sum } else { f32::MAX }) * (1.0 - ROOM) - LEAST)
    }

    /// The box of all children.
    fn whole(&self) -> ([f32; 3], [f32; 3]) {
        let low = self.low.map(|side| side.into_iter().fold(f32::INFINITY, f32::min));
        (low, self.high.map(|side| side.into_iter().fold(f32::NEG_INFINITY, f32::max)))
    }
}

/// The middle of the box of some points; the origin where that is not finite.
fn middle(points: impl Iterator<Item = Vec3>) -> Vec3 {
    let [low, high] = bounding_box(points).unwrap_or_default();
    let middle = 0.5 * low + 0.5 * high;
    if middle.iter().all(|x| x.is_finite()) { middle } else { Vec3::zeros() }
}

/// A vector of single precision that is no larger than v − `middle` in each coordinate. Differences are rounded, too.
fn round_down(v: Vec3, middle: Vec3) -> [f32; 3] {
    let d = v - middle;
    [d.x, d.y, d.z].map(|x| single_below(x.next_down()))
}

/// The number of single precision next to one, or above it.
#[inline]
fn single_above(x: f64) -> f32 {
    let single = x as f32;
    if f64::from(single) >= x { single } else { single.next_up() }
}

/// The same, or below it.
#[inline]
fn single_below(x: f64) -> f32 {
    let single = x as f32;
    if f64::from(single) <= x { single } else { single.next_down() }
}

/// A vector of single precision that is no smaller than v − `middle` in each coordinate.
fn round_up(v: Vec3, middle: Vec3) -> [f32; 3] {
    let d = v - middle;
    [d.x, d.y, d.z].map(|x| single_above(x.next_up()))
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

    #[test]
    fn a_tree_built_in_two_halves_finds_what_a_search_finds() {
        let mesh = sheet(96);
        assert!(mesh.triangles.len() >= MANY);
        let bvh = Bvh::new(&mesh);
        for p in points(96, 100) {
            let found = bvh.closest(p);
            assert_eq!((found.distance, found.triangle), by_search(&mesh, p));
        }
    }

    #[test]
    fn many_points_find_what_each_finds_alone_in_as_many_steps() {
        let bvh = Bvh::new(&sheet(12));
        for count in [0, 20, 513] {
            let points: Vec<Vec3> = points(12, count).collect();
            let before = stop::steps();
            let found = bvh.closest_to_all(&points);
            assert_eq!(stop::steps() - before, count as u64);
            assert!(found.iter().zip(&points).all(|(found, &p)| *found == bvh.closest(p)) && found.len() == count);
        }
    }

    #[test]
    fn far_and_tiny_meshes_find_the_same() {
        for scale in [1e-30, 1e-12, 1e12, 1e30] {
            let mut mesh = sheet(12);
            mesh.positions.iter_mut().for_each(|p| *p *= scale);
            let bvh = Bvh::new(&mesh);
            for p in points(12, 60).map(|p| p * scale) {
                let found = bvh.closest(p);
                assert_eq!((found.distance, found.triangle), by_search(&mesh, p), "{scale}");
            }
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
    fn a_mesh_far_from_the_origin_has_boxes_as_tight_as_elsewhere() {
        let mut mesh = sheet(12);
        let far = Vec3::new(5e6, -4e8, 1e9);
        let size = |mesh: &TriMesh| {
            let (low, high) = Bvh::new(mesh).nodes[1].whole();
            [0, 1, 2].map(|k| high[k] - low[k])
        };
        let near = size(&mesh);
        mesh.positions.iter_mut().for_each(|p| *p += far);
        assert!(size(&mesh).iter().zip(near).all(|(far, near)| (far - near).abs() < 1e-5), "{:?}", size(&mesh));
        let bvh = Bvh::new(&mesh);
        for p in points(12, 60).map(|p| p + far) {
            let found = bvh.closest(p);
            assert_eq!((found.distance, found.triangle), by_search(&mesh, p));
        }
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
