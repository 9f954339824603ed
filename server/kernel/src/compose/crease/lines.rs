//! The sharp lines of an input that are long enough against a net's edges for it to have a chain of edges on them.
//!
//! Sharp edges ([`sharp_edges`](crate::map::snap::lines::sharp_edges)) are joined to chains between the vertices where
//! another number than two of them meet. With h the net's edge length beside a chain: loose ends shorter than
//! [`LOOSE_MIN`]·h, chains that wind ([`WINDING_MAX`]) and chains that run beside a longer one ([`BESIDE`]·h) are none,
//! so that noise and rounded edges make no lines; what is left is joined anew. A chain is cut where it turns by
//! [`CORNER_DEG`] over ±h. *Ours, not the paper's.*

use std::collections::{BTreeMap, BTreeSet};

use super::super::net::Net;
use crate::map::snap::lines::bend;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{TriMesh, nearest_share};
use crate::mesh::{Vec3, bounding_box};

/// Least length of a chain with a loose end, of one between two corners, of one with two loose ends or none, in h.
const LOOSE_MIN: f64 = 10.0;
const JOINED_MIN: f64 = 4.0;
const ALONE_MIN: f64 = 10.0;
/// Most that a chain may be longer than its chords of length h.
const WINDING_MAX: f64 = 1.2;
/// A chain that is nearer than this to longer ones, in h, for this share of its length runs beside them.
const BESIDE: f64 = 0.7;
const BESIDE_SHARE: f64 = 0.4;
/// Length at a chain's ends that is not asked for it, in h.
const BESIDE_ENDS: f64 = 1.2;
/// A chain has a corner where it turns by this over ±h, in degrees.
const CORNER_DEG: f64 = 45.0;
/// Rounds of leaving chains out and joining the rest.
const ROUNDS: usize = 6;
/// Points of a chain at which h is asked for.
const SIZE_POINTS: usize = 12;
/// A chain from which the net is farther than this on average, in h, is passed by.
const PASSED_MAX: f64 = 1.5;
/// Segments of a line that have a box together, so that those far from a point are passed over. *Untuned.*
const BLOCK: usize = 32;
/// Room for rounding in what bounds a distance, as a share of a line's length.
const ROOM: f64 = 1e-9;

/// Where lines meet, end or turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineCorner {
    /// Where.
    pub point: Vec3,
    /// The net's edge length there.
    pub edge: f64,
    /// Whether the input ends there.
    pub place: InteriorOrBorder,
}

/// Tells whether a place of the input lies inside it or on its true boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InteriorOrBorder {
    /// Inside.
    Inside,
    /// On its true boundary.
    Border,
}

/// A sharp line: a polyline with its arc length.
#[derive(Clone, Debug)]
pub struct Line {
    points: Vec<Vec3>,
    starts: Vec<f64>,
    /// The box of each [`BLOCK`] of segments.
    boxes: Vec<[Vec3; 2]>,
    /// Corners at its ends; `None` for a closed line.
    pub ends: Option<[usize; 2]>,
    /// The net's edge length along it.
    pub edge: f64,
}

/// The nearest point of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestOnLine {
    /// Arc length.
    pub at: f64,
    /// Distance.
    pub distance: f64,
}

impl Line {
    fn new(points: Vec<Vec3>, ends: Option<[usize; 2]>, edge: f64) -> Self {
        let mut starts = vec![0.0];
        for pair in points.windows(2) {
            starts.push(starts[starts.len() - 1] + (pair[1] - pair[0]).norm());
        }
        let of_block = |first: usize| {
            let block = &points[first..points.len().min(first + BLOCK + 1)];
            bounding_box(block).unwrap_or([points[first]; 2])
        };
        let boxes = (0..points.len().saturating_sub(1)).step_by(BLOCK).map(of_block).collect();
        Self { points, starts, boxes, ends, edge }
    }

    /// Its length.
    pub fn length(&self) -> f64 {
        self.starts.last().copied().unwrap_or(0.0)
    }

    /// The point at an arc length, from the first end; beyond the ends, of a closed line further around.
    pub fn point(&self, s: f64) -> Vec3 {
        let s = if self.ends.is_none() { s.rem_euclid(self.length().max(f64::MIN_POSITIVE)) } else { s };
        let k = self.starts.partition_point(|start| *start <= s).clamp(1, self.starts.len().max(2) - 1);
        let (Some(&a), Some(&b)) = (self.points.get(k - 1), self.points.get(k)) else {
            return self.points.first().copied().unwrap_or_default();
        };
        let span = (self.starts[k] - self.starts[k - 1]).max(f64::MIN_POSITIVE);
        a.lerp(&b, ((s - self.starts[k - 1]) / span).clamp(0.0, 1.0))
    }

    /// The nearest point to `x`, of several the first.
    pub fn nearest(&self, x: Vec3) -> NearestOnLine {
        let away = |[low, high]: &[Vec3; 2]| (low - x).sup(&(x - high)).sup(&Vec3::zeros()).norm_squared();
        let least: Vec<f64> = self.boxes.iter().map(away).collect();
        let first = (0..least.len()).min_by(|&a, &b| least[a].total_cmp(&least[b]));
        // What the block with the nearest box has bounds what is worth a look.
        let reach = first.map_or(0.0, |first| self.nearest_in(first, x).distance) + ROOM * self.length();
        let blocks = (0..least.len()).filter(|&block| least[block] <= reach * reach);
        self.nearest_of(blocks, x)
    }

    fn nearest_of(&self, blocks: impl Iterator<Item = usize>, x: Vec3) -> NearestOnLine {
        let none = NearestOnLine { at: 0.0, distance: f64::INFINITY };
        let nearest = blocks.map(|block| self.nearest_in(block, x));
        nearest.fold(none, |best, near| if near.distance < best.distance { near } else { best })
    }

    /// The nearest point to `x` of a block of segments.
    fn nearest_in(&self, block: usize, x: Vec3) -> NearestOnLine {
        let mut best = NearestOnLine { at: 0.0, distance: f64::INFINITY };
        let segments = self.points.windows(2).zip(&self.starts).skip(block * BLOCK).take(BLOCK);
        for (pair, start) in segments {
            let d = pair[1] - pair[0];
            let share = nearest_share([pair[0], pair[1]], x);
            let distance = (pair[0] + d * share - x).norm();
            if distance < best.distance {
                best = NearestOnLine { at: start + share * d.norm(), distance };
            }
        }
        best
    }

    /// The same line from another arc length on; only for closed ones.
    pub fn turned(&self, from: f64) -> Self {
        let n = self.points.len().saturating_sub(1);
        let k = self.starts.partition_point(|start| *start <= from).min(n);
        let mut points = vec![self.point(from)];
        points.extend((0..n).map(|j| self.points[(k + j) % n.max(1)]));
        points.push(points[0]);
        Self::new(points, None, self.edge)
    }

    /// The part between two arc lengths of an open line.
    pub fn part(&self, from: f64, to: f64) -> Self {
        let inner = self.points.iter().zip(&self.starts).filter(|(_, s)| **s > from && **s < to).map(|(p, _)| *p);
        let points = [self.point(from)].into_iter().chain(inner).chain([self.point(to)]).collect();
        Self::new(points, self.ends, self.edge)
    }

    fn winding(&self) -> f64 {
        let chords = (self.length() / self.edge.max(f64::MIN_POSITIVE)).clamp(1.0, 4096.0).ceil();
        let at = |k: f64| self.point((k / chords * self.length()).min(self.length() * (1.0 - 1e-12)));
        let straight: f64 = (0..chords as usize).map(|k| (at(k as f64 + 1.0) - at(k as f64)).norm()).sum();
        self.length() / straight.max(f64::MIN_POSITIVE)
    }
}

/// The lines of an input for a net.
#[derive(Clone, Debug, Default)]
pub struct Lines {
    /// Where they meet, end or turn.
    pub corners: Vec<LineCorner>,
    /// The lines.
    pub lines: Vec<Line>,
}

/// A chain of vertices joined by sharp edges; a closed one has its first vertex last, too.
type Chain = Vec<u32>;

impl Lines {
    /// Those of a surface for a net on it; `sharp` are its sharp edges, a halfedge of each.
    pub fn of(surface: &TriMesh, sharp: &[u32], net: &Net) -> Self {
        let mut sharp: BTreeSet<[u32; 2]> = sharp.iter().map(|&h| ordered(surface.tail(h), surface.head(h))).collect();
        if sharp.is_empty() {
            return Self::default();
        }
        let size = Size::new(net);
        let border = surface.boundary_vertices();
        let mut kept = Vec::new();
        for _ in 0..ROUNDS {
            kept = chains(&sharp);
            let before = kept.len();
            let degree = degrees(&sharp);
            kept.retain(|chain| is_line(surface, chain, &size, &degree, &border));
            leave_out_beside(surface, &mut kept, &size);
            if kept.len() == before {
                break;
            }
            sharp = kept.iter().flat_map(|chain| chain.windows(2).map(|pair| ordered(pair[0], pair[1]))).collect();
        }
        Self::between_corners(surface, &kept, &size, &border)
    }

    /// Chains cut where they turn.
    fn between_corners(surface: &TriMesh, chains: &[Chain], size: &Size, border: &[bool]) -> Self {
        let mut found = Self::default();
        let mut number: BTreeMap<u32, usize> = BTreeMap::new();
        let mut corner = |v: u32, corners: &mut Vec<LineCorner>| {
            *number.entry(v).or_insert_with(|| {
                let point = surface.positions[v as usize];
                let place = if border[v as usize] { InteriorOrBorder::Border } else { InteriorOrBorder::Inside };
                corners.push(LineCorner { point, edge: size.at(point).edge, place });
                corners.len() - 1
            })
        };
        for chain in chains {
            let whole = line_of(surface, chain, size);
            let mut cuts = turns(surface, chain, &whole);
            let n = chain.len() - 1;
            let mut around = chain.clone();
            if chain[0] == chain[n] {
                let Some(&first) = cuts.first() else {
                    found.lines.push(whole);
                    continue;
                };
                around = (0..=n).map(|k| chain[(first + k) % n]).collect();
                cuts.iter_mut().for_each(|k| *k -= first);
            }
            cuts.extend([0, n]);
            cuts.sort_unstable();
            cuts.dedup();
            for pair in cuts.windows(2) {
                let points = around[pair[0]..=pair[1]].iter().map(|&v| surface.positions[v as usize]).collect();
                let ends = [around[pair[0]], around[pair[1]]].map(|v| corner(v, &mut found.corners));
                found.lines.push(Line::new(points, Some(ends), whole.edge));
            }
        }
        found
    }
}

fn ordered(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

fn neighbours(sharp: &BTreeSet<[u32; 2]>) -> BTreeMap<u32, Vec<u32>> {
    let mut beside: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &[a, b] in sharp {
        beside.entry(a).or_default().push(b);
        beside.entry(b).or_default().push(a);
    }
    beside
}

fn degrees(sharp: &BTreeSet<[u32; 2]>) -> BTreeMap<u32, usize> {
    neighbours(sharp).into_iter().map(|(v, beside)| (v, beside.len())).collect()
}

/// Chains of edges between vertices with another number of them than two; then what is closed.
fn chains(sharp: &BTreeSet<[u32; 2]>) -> Vec<Chain> {
    let beside = neighbours(sharp);
    let mut left = sharp.clone();
    let mut found = Vec::new();
    let mut walk = |from: u32, to: u32, left: &mut BTreeSet<[u32; 2]>| {
        if !left.remove(&ordered(from, to)) {
            return;
        }
        let mut chain = vec![from, to];
        let mut end = to;
        while let Some([x, y]) = beside.get(&end).map(Vec::as_slice) {
            let Some(&next) = [x, y].into_iter().find(|&&w| left.contains(&ordered(end, w))) else { break };
            left.remove(&ordered(end, next));
            chain.push(next);
            end = next;
        }
        found.push(chain);
    };
    for (&v, around) in beside.iter().filter(|(_, around)| around.len() != 2) {
        around.iter().for_each(|&w| walk(v, w, &mut left));
    }
    while let Some(&[a, b]) = left.first() {
        walk(a, b, &mut left);
    }
    found
}

fn line_of(surface: &TriMesh, chain: &Chain, size: &Size) -> Line {
    let points: Vec<Vec3> = chain.iter().map(|&v| surface.positions[v as usize]).collect();
    let is_closed = chain.first() == chain.last();
    let mut line = Line::new(points, if is_closed { None } else { Some([0, 0]) }, 0.0);
    let (mut edge, mut away) = (0.0, 0.0);
    for k in 0..SIZE_POINTS {
        let at = size.at(line.point((k as f64 + 0.5) / SIZE_POINTS as f64 * line.length()));
        edge += at.edge / SIZE_POINTS as f64;
        away += at.distance / SIZE_POINTS as f64;
    }
    line.edge = if away <= PASSED_MAX * edge { edge } else { f64::INFINITY };
    line
}

/// Whether a chain is long and straight enough.
fn is_line(surface: &TriMesh, chain: &Chain, size: &Size, degree: &BTreeMap<u32, usize>, border: &[bool]) -> bool {
    let line = line_of(surface, chain, size);
    let is_loose = |v: &u32| degree.get(v) == Some(&1) && !border[*v as usize];
    let loose = [chain.first(), chain.last()].into_iter().flatten().filter(|v| is_loose(v)).count();
    let least = match loose {
        0 if line.ends.is_some() => JOINED_MIN,
        1 => LOOSE_MIN,
        _ => ALONE_MIN,
    };
    line.length() >= least * line.edge && line.winding() <= WINDING_MAX
}

/// Leaves out chains that run beside longer ones.
fn leave_out_beside(surface: &TriMesh, chains: &mut Vec<Chain>, size: &Size) {
    let lines: Vec<Line> = chains.iter().map(|chain| line_of(surface, chain, size)).collect();
    let mut order: Vec<usize> = (0..lines.len()).collect();
    order.sort_by(|&a, &b| lines[b].length().total_cmp(&lines[a].length()).then(a.cmp(&b)));
    let mut stays: Vec<usize> = Vec::new();
    for k in order {
        let line = &lines[k];
        let ends = if line.ends.is_none() { 0.0 } else { (BESIDE_ENDS * line.edge).min(0.25 * line.length()) };
        let count = ((line.length() / (0.5 * line.edge)) as usize).clamp(4, 256);
        let at = |j: usize| line.point(ends + (j as f64 + 0.5) / count as f64 * (line.length() - 2.0 * ends));
        let is_beside = |x: Vec3| stays.iter().any(|&o| lines[o].nearest(x).distance < BESIDE * line.edge);
        let beside = (0..count).filter(|&j| is_beside(at(j))).count();
        if (beside as f64) <= BESIDE_SHARE * count as f64 {
            stays.push(k);
        }
    }
    let stays: BTreeSet<usize> = stays.into_iter().collect();
    let mut k = 0;
    chains.retain(|_| {
        k += 1;
        stays.contains(&(k - 1))
    });
}

/// The vertices of a chain at which it turns, by their places in it.
fn turns(surface: &TriMesh, chain: &Chain, line: &Line) -> Vec<usize> {
    let (window, n) = (line.edge, chain.len() - 1);
    let is_closed = line.ends.is_none();
    let turn = |k: usize| {
        let (x, s) = (surface.positions[chain[k] as usize], line.starts[k]);
        let (before, after) =
            if is_closed { (s - window, s + window) } else { ((s - window).max(0.0), (s + window).min(line.length())) };
        bend(x - line.point(before), line.point(after) - x)
    };
    let inner = if is_closed { 0..n } else { 1..n };
    let all: Vec<(usize, f64)> = inner.map(|k| (k, turn(k))).filter(|t| t.1 >= CORNER_DEG).collect();
    let apart = |a: usize, b: usize| {
        let d = (line.starts[a] - line.starts[b]).abs();
        if is_closed { d.min(line.length() - d) } else { d }
    };
    let is_top = |&(k, own): &(usize, f64)| {
        !all.iter().any(|&(j, other)| j != k && apart(j, k) <= window && (other > own || (other == own && j < k)))
    };
    all.iter().filter(|t| is_top(t)).map(|t| t.0).collect()
}

/// How large a net's faces are, anywhere.
struct Size {
    bvh: Bvh,
    edges: Vec<f64>,
}

/// The net's edge length at a point, and how far it is.
struct SizeAt {
    edge: f64,
    distance: f64,
}

impl Size {
    fn new(net: &Net) -> Self {
        let fans = net.fans();
        let mut areas = vec![0.0; net.face_slots()];
        (0..).zip(&fans.face).for_each(|(t, &f)| areas[f as usize] += fans.mesh.area(t));
        let edges = fans.face.iter().map(|&f| f64::sqrt(areas[f as usize])).collect();
        Self { bvh: Bvh::new(&fans.mesh), edges }
    }

    fn at(&self, x: Vec3) -> SizeAt {
        let near = self.bvh.closest(x);
        SizeAt { edge: self.edges.get(near.triangle as usize).copied().unwrap_or(0.0), distance: near.distance }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;
    use crate::map::snap::lines::sharp_edges;
    use crate::topology::tests::grid;

    /// Folds what lies over the unit square upright along x = 1/2.
    pub(in crate::compose::crease) fn fold(positions: &mut [Vec3]) {
        positions.iter_mut().filter(|p| p.x > 0.5).for_each(|p| *p = Vec3::new(0.5, p.y, p.x - 0.5));
    }

    /// The lines of a fold for a net over it, whose vertices are told before they are folded: the surface, the net and these.
    pub(in crate::compose::crease) fn folded(rows: u32, moved: impl Fn(Vec3) -> Vec3) -> (TriMesh, Net, Lines) {
        let (mut surface, mut net) = (grid(24, 24, false, false), sheet(rows, rows));
        fold(&mut surface.positions);
        net.positions.iter_mut().for_each(|p| *p = moved(*p / f64::from(rows)));
        fold(&mut net.positions);
        let lines = Lines::of(&surface, &sharp_edges(&surface, &[]), &net);
        (surface, net, lines)
    }

    #[test]
    fn a_fold_is_one_line_from_border_to_border() {
        let (_, _, lines) = folded(12, |p| p);
        assert_eq!((lines.lines.len(), lines.corners.len()), (1, 2));
        let line = &lines.lines[0];
        assert!((line.length() - 1.0).abs() < 1e-12 && (line.edge - 1.0 / 12.0).abs() < 1e-9, "{line:?}");
        assert!(lines.corners.iter().all(|c| c.place == InteriorOrBorder::Border && (c.point.x - 0.5).abs() < 1e-12));
        let near = line.nearest(Vec3::new(0.6, 0.25, 0.0));
        assert!((near.distance - 0.1).abs() < 1e-12);
        assert!((line.point(near.at) - Vec3::new(0.5, 0.25, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn the_nearest_point_of_a_long_line_is_that_of_all_its_segments() {
        let at = |k: f64| Vec3::new(k.cos() * k, (0.7 * k).sin() * k, 0.3 * k);
        let points: Vec<Vec3> = (0..500).map(|k| at(0.1 * f64::from(k))).collect();
        let line = Line::new(points.clone(), Some([0, 1]), 0.1);
        let aside = |k: i32| at(0.0931 * f64::from(k)) + Vec3::new(f64::from(k % 7) - 3.0, 1.0, f64::from(k % 5));
        for x in points.iter().copied().chain((0..500).map(aside)) {
            assert_eq!(line.nearest(x), line.nearest_of(0..line.boxes.len(), x));
        }
    }

    #[test]
    fn a_fold_of_few_edges_of_the_net_is_none() {
        assert_eq!(folded(3, |p| p).2.lines.len(), 0);
    }

    #[test]
    fn a_closed_line_begins_anywhere_and_the_parts_of_an_open_one_join() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let line = Line::new(square.to_vec(), None, 0.1);
        let turned = line.turned(1.5);
        assert!((turned.length() - 4.0).abs() < 1e-12);
        assert!((turned.point(0.0) - Vec3::new(1.0, 0.5, 0.0)).norm() < 1e-12);
        assert!((turned.point(3.0) - line.point(4.5)).norm() < 1e-12);
        let open = Line::new(square.to_vec(), Some([0, 1]), 0.1);
        let [first, second] = [open.part(0.0, 1.2), open.part(1.2, 4.0)];
        assert!((first.length() + second.length() - 4.0).abs() < 1e-12);
        assert!((first.point(first.length()) - second.point(0.0)).norm() < 1e-12);
    }
}
