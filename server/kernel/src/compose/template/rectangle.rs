//! A disc as a rectangle of quads, its four corners on the boundary; an annulus as a rectangle with a rectangular hole.
//!
//! x and y are harmonic on the surface, Δx = Δy = 0, and on the boundary what the vertices say that stand there: from corner
//! to corner they have whole numbers along a side of [0, a] × [0, b], and what lies between two of them is spaced evenly.
//! With weights that are not negative the map of a disc is one-to-one (Radó, Kneser, Choquet), and vertex (i, j) stands
//! where (x, y) = (i, j). There is no extraordinary vertex inside, and the layout follows an elongated segment, where rings
//! about a pole or a hole are sheared. Which of the boundary's vertices become corners is tried out, each map a sum of a few
//! functions known from others ([`ramps`](super::ramps)); the hole is put first where it falls when its boundary is free.
//! *Ours, not the paper's.*

use super::super::check::quad_area;
use super::super::net::Net;
use super::super::square::mean_deviation_deg;
use super::even::unevenness;
use super::frame::{Corners, Frame, Hole, place};
use super::ramps::Ramps;
use super::{GivenVertices, TemplateNet};
use crate::mesh::Vec3;
use crate::numerics::{Factored, in_halves, stop};
use crate::topology::Topology;
use crate::unfold::Chart;
use crate::unfold::laplacian::Laplacian;

/// Places of the first corner that are tried, for each of the shares of the half boundary that the shorter side may take;
/// of a narrow rectangle as many that its shorter side has this many times the edges between them.
const TURNS: usize = 10;
const TURN_EDGES: usize = 2;
const SHORT_SIDES: [f64; 3] = [0.5, 0.35, 0.2];
/// A shorter side than these is tried where the number of quads that is wanted asks for it.
const OBLONG_MAX: f64 = 0.18;
/// One with a shorter side than this is a ribbon: no other shape is tried on it, and its turns are found by its boundary,
/// looked at in so many places.
const RIBBON_MAX: f64 = 0.01;
const RIBBON_SAMPLES: usize = 64;
/// Factor, as a power of two, by which the number of quads may miss what is wanted before such layouts are sought as have it.
const COUNT_MISSED: f64 = 0.3;
/// A vertex thrown far off makes needles of a few triangles, each of which lies across a whole rectangle, and a boundary of many
/// more edges than its area has quads. What laying a frame takes beyond so many quads, and looks at vertices, for each quad
/// that is wanted is counted in looks, and so much of it allowed to a search; usual segments have none of it.
const USUAL_QUADS: usize = 4;
const USUAL_LOOKS: u64 = 16;
const LOOKS_PER_QUAD: u64 = 300;
const UNUSUAL_LOOKS_MAX: u64 = 1 << 27;
/// How far outside a triangle a point still counts as in it.
const OUTSIDE: f64 = 1e-7;
/// Area of the smallest quad, as a share of the mean, up to which a layout is none: behind a narrow place a harmonic map
/// crowds its columns beyond what can be told apart.
const SMALLEST_SHARE: f64 = 1e-5;
/// Degrees that a whole surface passed over counts for.
const PASSED_DEG: f64 = 120.0;
/// Degrees that edges twice or half as long as they should be count for.
const UNEVEN_DEG: f64 = 20.0;

/// A segment prepared for harmonic maps onto rectangles.
#[derive(Debug)]
pub struct Harmonics {
    laplacian: Laplacian,
    /// With all boundaries given; and for annuli with one of them, by end.
    inverse: Factored,
    one_given: Vec<Factored>,
    rims: Vec<EndLoop>,
    on_rim: Vec<bool>,
    area: f64,
}

/// The boundary loop at an end: its vertices in the order of u, and the length up to each and in all.
#[derive(Clone, Debug)]
struct EndLoop {
    vertices: Vec<u32>,
    along: Vec<f64>,
    /// Where the loop of the mesh starts, if u runs against it.
    against: Option<f64>,
}

impl EndLoop {
    fn new(chart: &Chart, mut vertices: Vec<u32>, end: usize) -> Self {
        // At v = 1 u runs against the boundary.
        if end == 1 {
            vertices.reverse();
        }
        let p = |k: usize| chart.mesh.positions[vertices[k % vertices.len()] as usize];
        let mut along = vec![0.0];
        (0..vertices.len()).for_each(|k| along.push(along[k] + (p(k + 1) - p(k)).norm()));
        let against = (end == 1).then(|| along[vertices.len() - 1]);
        Self { vertices, along, against }
    }

    fn whole(&self) -> f64 {
        self.along.last().copied().unwrap_or(0.0).max(f64::MIN_POSITIVE)
    }

    /// The length up to a place of the mesh's loop.
    fn length(&self, along: f64) -> f64 {
        self.against.map_or(along, |start| start - along)
    }
}

/// The vertices of one boundary: counter-clockwise in the plane, for a hole too.
#[derive(Clone, Debug)]
struct BoundaryVertices {
    /// Vertex of the surface, and its place among the columns.
    places: Vec<(u32, f64)>,
    points: Vec<Vec3>,
}

/// The share of the half boundary of so many edges that the shorter side of a rectangle of so many quads takes, a + b = m
/// and ab = F, if that is shorter than those that are tried anyway.
fn oblong_share(quads: f64, edges: usize) -> Option<f64> {
    let square = quads * 4.0 / (edges * edges) as f64;
    (square < 0.25).then(|| 0.5 - (0.25 - square).sqrt()).filter(|share| *share < OBLONG_MAX)
}

fn areas(net: &Net) -> impl Iterator<Item = f64> {
    let area = |c: &[u32]| <[u32; 4]>::try_from(c).map_or(0.0, |c| quad_area(c.map(|v| net.positions[v as usize])));
    net.faces().map(move |(_, c)| area(c))
}

/// How bad a layout of a surface of so much area is: its mean deviation from right angles in degrees, and more for what it
/// passes over and for uneven sizes, which are compared with the edge that is wanted, or else with the mean.
pub fn badness(net: &Net, area: f64, edge: Option<f64>) -> f64 {
    let areas: Vec<f64> = areas(net).collect();
    let covered: f64 = areas.iter().sum();
    let passed = (1.0 - covered / area.max(f64::MIN_POSITIVE)).max(0.0);
    let edge = edge.unwrap_or((covered / areas.len().max(1) as f64).sqrt());
    mean_deviation_deg(net) + PASSED_DEG * passed + UNEVEN_DEG * unevenness(&areas, edge)
}

/// The smallest quad's area as a share of the mean.
fn smallest_share(net: &Net) -> f64 {
    let (sum, count, least) =
        areas(net).fold((0.0, 0.0, f64::INFINITY), |(sum, count, least), a| (sum + a, count + 1.0, a.min(least)));
    if sum > 0.0 { least * count / sum } else { 0.0 }
}

/// A frame that was tried, and how bad the layout on it is.
#[derive(Clone, Copy, Debug)]
struct TriedFrame {
    badness: f64,
    frame: Frame,
}

/// The surface that frames are laid on.
#[derive(Clone, Copy, Debug)]
struct Ground<'a> {
    chart: &'a Chart,
    area: f64,
    rings: &'a [BoundaryVertices],
}

/// The best of the frames tried.
struct Search<'a> {
    ground: Ground<'a>,
    /// Maps with all boundaries given.
    maps: Ramps<'a>,
    /// Where the hole's vertices fall, by x and y, if the outer boundary is given alone; none of a disc.
    falls: Option<Ramps<'a>>,
    /// What edges are compared with; none for their mean.
    edge: Option<f64>,
    seen: Vec<Frame>,
    best: Option<(f64, Net)>,
    /// Quads that are wanted.
    wanted: usize,
    /// What was looked at beyond what is usual.
    unusual: u64,
}

impl Harmonics {
    /// Of a disc's or an annulus' chart; `None` for others, and where the Laplacian can't be factored.
    pub fn new(chart: &Chart) -> Option<Self> {
        let mesh = &*chart.mesh;
        let ends = match chart.topology {
            Topology::Disc => 1,
            Topology::Annulus => 2,
            Topology::Sphere | Topology::Torus => return None,
        };
        let mut rims: Vec<Option<EndLoop>> = vec![None; ends];
        for ring in mesh.boundary_loops() {
            let vertices: Vec<u32> = ring.iter().map(|&h| mesh.tail(h)).collect();
            let v = vertices.iter().filter_map(|&v| chart.uv.get(v as usize)).map(|uv| uv[1]);
            let end = usize::from(v.sum::<f64>() > 0.5 * vertices.len() as f64);
            *rims.get_mut(end)? = Some(EndLoop::new(chart, vertices, end));
        }
        let rims: Vec<EndLoop> = rims.into_iter().collect::<Option<_>>()?;
        let on_rim = mesh.boundary_vertices();
        let laplacian = Laplacian::new(mesh).ok()?;
        let factor = |fixed: &[bool]| laplacian.factor(fixed, 0.0, |_| false).ok();
        let inverse = factor(&on_rim)?;
        let of = |rim: &EndLoop| {
            let mut fixed = vec![false; on_rim.len()];
            rim.vertices.iter().for_each(|&v| fixed[v as usize] = true);
            factor(&fixed)
        };
        let one_given = if ends == 2 { rims.iter().map(of).collect::<Option<_>>()? } else { Vec::new() };
        Some(Self { laplacian, inverse, one_given, rims, on_rim, area: mesh.total_area() })
    }

    /// The best layouts between given vertices, by angles and like sizes, and if that has by far more or fewer quads than
    /// are wanted, by sizes that are near to `edge`. An even number is given at each end, of an annulus those of one end
    /// fewer by 8 at least.
    pub fn best(&self, chart: &Chart, given: &[&GivenVertices], edge: f64) -> Vec<TemplateNet> {
        let count = |end: usize| given[end].points.len();
        let is_sound =
            |end: usize| count(end) >= 4 && count(end).is_multiple_of(2) && count(end) == given[end].along.len();
        if given.len() != self.rims.len() || !(0..given.len()).all(is_sound) {
            return Vec::new();
        }
        // Seen from the end with more columns the other is the hole; seen from the top, u runs against.
        let outer = usize::from(given.len() == 2 && count(1) > count(0));
        let ring = |end: usize| {
            let n = count(end);
            let turned = |t: f64| if outer == 1 { (n as f64 - 1.0 - t).rem_euclid(n as f64) } else { t };
            let rim = &self.rims[end];
            let lengths: Vec<f64> = given[end].along.iter().map(|&s| rim.length(s)).collect();
            let at = |k: usize| turned(place(&lengths, rim.along[k], rim.whole()));
            let places = rim.vertices.iter().enumerate().map(|(k, &v)| (v, at(k))).collect();
            let mut points = given[end].points.clone();
            if outer == 1 {
                points.reverse();
            }
            BoundaryVertices { places, points }
        };
        let rings: Vec<BoundaryVertices> =
            if given.len() == 1 { vec![ring(0)] } else { vec![ring(outer), ring(1 - outer)] };
        let (n, m) = (rings[0].points.len() as u32, rings.get(1).map_or(0, |r| r.points.len()) as u32);
        let rings = &rings[..];
        let maps =
            Ramps::new(Box::new(|k, f| self.extended(self.given(&rings[k], f), |v| self.on_rim[v], &self.inverse)));
        let falls = rings.get(1).zip(self.one_given.get(outer)).map(|(hole, inverse)| {
            let mut fixed = vec![false; self.on_rim.len()];
            rings[0].places.iter().for_each(|p| fixed[p.0 as usize] = true);
            let fall = move |_, f: &dyn Fn(f64) -> f64| {
                let all = self.extended(self.given(&rings[0], f), |v| fixed[v], inverse);
                hole.places.iter().map(|p| all[p.0 as usize]).collect()
            };
            Ramps::new(Box::new(fall))
        });
        let wanted = self.area / (edge * edge);
        let (seen, best) = (Vec::new(), None);
        let mut search = Search {
            ground: Ground { chart, area: self.area, rings },
            maps,
            falls,
            edge: None,
            seen,
            best,
            wanted: wanted as usize,
            unusual: 0,
        };
        let oblong = oblong_share(wanted, rings[0].points.len());
        let mut nets: Vec<Net> = search.run(oblong).into_iter().collect();
        if nets.iter().any(|net| (net.faces().count() as f64 / wanted).log2().abs() > COUNT_MISSED) {
            search.edge = Some(edge);
            nets.extend(search.run(oblong));
        }
        let ends = if outer == 1 {
            [(n..n + m).rev().collect(), (0..n).rev().collect()]
        } else {
            [(0..n).collect(), (n..n + m).collect()]
        };
        nets.into_iter().map(|net| TemplateNet { net, ends: ends.clone() }).collect()
    }

    /// What a function of the place gives on a boundary, and 0 elsewhere.
    fn given(&self, ring: &BoundaryVertices, f: &dyn Fn(f64) -> f64) -> Vec<f64> {
        let mut given = vec![0.0; self.on_rim.len()];
        ring.places.iter().for_each(|&(v, t)| given[v as usize] = f(t));
        given
    }

    /// The harmonic function with given values on some boundaries, by their factor.
    fn extended(&self, given: Vec<f64>, fixed: impl Fn(usize) -> bool, inverse: &Factored) -> Vec<f64> {
        let mut inside: Vec<f64> = self.laplacian.apply(&given).into_iter().map(|y| -y).collect();
        for (v, x) in inside.iter_mut().enumerate() {
            if fixed(v) {
                *x = 0.0;
            }
        }
        inverse.solve(&mut inside);
        given.iter().zip(&inside).map(|(g, x)| g + x).collect()
    }
}

impl Search<'_> {
    /// For each share the best of all turns, and from there on what is better beside it: the one best start may lead nowhere.
    fn run(&mut self, oblong: Option<f64>) -> Option<Net> {
        self.seen.clear();
        let m = self.ground.rings[0].points.len() / 2;
        let ribbon = oblong.filter(|share| *share < RIBBON_MAX);
        let usual = if ribbon.is_some() { &[][..] } else { &SHORT_SIDES };
        for share in usual.iter().copied().chain(oblong) {
            let a = ((share * m as f64).round() as usize).max(1);
            // Turned by half its width, all of a narrow one is sheared.
            let most = if Some(share) == oblong { a / TURN_EDGES } else { m };
            let step = (m / TURNS).min(most).max(1);
            let turns = if ribbon.is_some() { self.ribbon_turns(a) } else { (0..m).step_by(step).collect() };
            let outers = turns.into_iter().filter_map(|turn| Corners::new(turn, a, m));
            let starts = outers.filter_map(|outer| self.with_hole(outer)).collect();
            if let Some(start) = self.best_of(starts) {
                self.climb(start, (m / TURNS).max(1));
            }
        }
        self.best.take().map(|best| best.1)
    }

    /// The turns of a ribbon at which its long sides lie nearest to each other: each that is tried costs solves of the whole.
    fn ribbon_turns(&self, a: usize) -> Vec<usize> {
        let points = &self.ground.rings[0].points;
        let (round, m) = (points.len(), points.len() / 2);
        let step = (m / RIBBON_SAMPLES).max(1);
        let apart = |turn: usize| -> f64 {
            let across = |i: usize| points[(turn + a + i) % round] - points[(turn + round - i) % round];
            (0..=m - a.min(m)).step_by(step).map(|i| across(i).norm_squared()).sum()
        };
        let mut turns: Vec<(f64, usize)> = (0..m).map(|turn| (apart(turn), turn)).collect();
        turns.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        turns.truncate(TURNS);
        turns.into_iter().map(|(_, turn)| turn).collect()
    }

    fn climb(&mut self, mut now: TriedFrame, mut step: usize) {
        while step > 0 {
            let Frame { outer, hole } = now.frame;
            let moved = outer.moved(step).into_iter().flatten();
            let mut beside: Vec<Frame> = moved.filter_map(|outer| self.with_hole(outer)).collect();
            let holes = hole.map_or(Vec::new(), |hole| hole.moved(outer));
            beside.extend(holes.into_iter().map(|hole| Frame { outer, hole: Some(hole) }));
            match self.best_of(beside) {
                Some(better) if better.badness < now.badness => now = better,
                _ => step /= 2,
            }
        }
    }

    /// Counts what laying a frame of so many quads took beyond what is usual.
    fn count(&mut self, quads: usize, looks: u64) {
        let more = quads.saturating_sub(USUAL_QUADS * self.wanted) as u64;
        let usual = USUAL_LOOKS * (self.wanted + self.ground.chart.mesh.triangles.len()) as u64;
        self.unusual += LOOKS_PER_QUAD * more + looks.saturating_sub(usual);
    }

    /// A rectangle with the hole where it falls; `None` if that does not fit.
    fn with_hole(&mut self, outer: Corners) -> Option<Frame> {
        let Some(falls) = &mut self.falls else { return Some(Frame { outer, hole: None }) };
        let [x, y] = falls.map(&[(outer, [0.0; 2])]);
        let fallen: Vec<(f64, [f64; 2])> =
            self.ground.rings[1].places.iter().zip(x.into_iter().zip(y)).map(|(p, (x, y))| (p.1, [x, y])).collect();
        Some(Frame { outer, hole: Some(Hole::nearest(outer, self.ground.rings[1].points.len(), &fallen)?) })
    }

    /// Tries frames, two at a time, and returns the best; `None` if all have been tried, or fit nowhere, or too much was tried.
    fn best_of(&mut self, frames: Vec<Frame>) -> Option<TriedFrame> {
        let (ground, mut best) = (self.ground, None::<TriedFrame>);
        for pair in frames.chunks(2) {
            let mut maps: Vec<(Frame, [Vec<f64>; 2])> = Vec::new();
            for &frame in pair {
                if self.seen.contains(&frame) || self.unusual > UNUSUAL_LOOKS_MAX {
                    continue;
                }
                self.seen.push(frame);
                stop::ask();
                let hole = frame.hole.map(|hole| (hole.corners, hole.at.map(|x| x as f64)));
                let boundaries: Vec<_> = [(frame.outer, [0.0; 2])].into_iter().chain(hole).collect();
                maps.push((frame, self.maps.map(&boundaries)));
            }
            let edge = self.edge;
            let laid = in_halves(&maps, |(frame, map)| {
                let (net, looks) = ground.laid(frame, map);
                let net = net.filter(|net| smallest_share(net) > SMALLEST_SHARE);
                (net.map(|net| (badness(&net, ground.area, edge), net)), looks)
            });
            for (&(frame, _), (laid, looks)) in maps.iter().zip(laid) {
                self.count(frame.outer.a * frame.outer.b, looks);
                let Some((badness, net)) = laid else { continue };
                if self.best.as_ref().is_none_or(|b| badness < b.0) {
                    self.best = Some((badness, net));
                }
                if best.is_none_or(|b| badness < b.badness) {
                    best = Some(TriedFrame { badness, frame });
                }
            }
        }
        best
    }
}

impl Ground<'_> {
    /// The net on a frame, by the map of the surface, `None` where a vertex lies in no triangle; and at how many places of
    /// vertices it looked.
    fn laid(&self, frame: &Frame, [x, y]: &[Vec<f64>; 2]) -> (Option<Net>, u64) {
        let grid = frame.grid();
        let boundary: usize = self.rings.iter().map(|ring| ring.points.len()).sum();
        let mut stands: Vec<Option<Vec3>> =
            self.rings.iter().flat_map(|ring| ring.points.iter().copied().map(Some)).collect();
        stands.resize(grid.vertices, None);
        let (a, b) = (frame.outer.a, frame.outer.b);
        let mut looks = 0;
        for t in &self.chart.mesh.triangles {
            let p = t.map(|v| [x[v as usize], y[v as usize]]);
            let range = |k: usize, most: usize| {
                let low = p.iter().map(|q| q[k]).fold(f64::INFINITY, f64::min) - OUTSIDE;
                let high = p.iter().map(|q| q[k]).fold(f64::NEG_INFINITY, f64::max) + OUTSIDE;
                low.ceil().max(1.0) as usize..high.floor().clamp(0.0, most as f64 - 1.0) as usize + 1
            };
            let (columns, rows) = (range(0, a), range(1, b));
            looks += (columns.len() * rows.len()) as u64;
            stop::pass(1);
            for j in rows {
                stop::pass(columns.len());
                for i in columns.clone() {
                    let number = grid.number(i, j) as usize;
                    if number < boundary || number >= grid.vertices || stands[number].is_some() {
                        continue;
                    }
                    let Some(w) = weights(&p, [i as f64, j as f64]) else { continue };
                    stands[number] = Some((0..3).map(|k| w[k] * self.chart.mesh.positions[t[k] as usize]).sum());
                }
            }
        }
        let stands = stands.into_iter().collect::<Option<Vec<Vec3>>>();
        (stands.map(|stands| Net::new(stands, grid.quads())), looks)
    }
}

/// Barycentric weights of a point in a triangle that it lies in.
fn weights(p: &[[f64; 2]; 3], q: [f64; 2]) -> Option<[f64; 3]> {
    let cross = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let area = cross(p[0], p[1], p[2]);
    if area == 0.0 || !area.is_finite() {
        return None;
    }
    let w = [cross(q, p[1], p[2]) / area, cross(p[0], q, p[2]) / area, cross(p[0], p[1], q) / area];
    w.iter().all(|x| *x >= -OUTSIDE).then_some(w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{TopologyCounts, check, extraordinary};
    use crate::compose::layout::layout;
    use crate::compose::template::border::{Border, Unwound};
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    /// Layouts of a sheet of so much by 1, with vertices an edge apart on its boundary, from the middle of the first side on;
    /// and those vertices.
    fn laid(length: f64, edge: f64) -> (Vec<TemplateNet>, Vec<Vec3>) {
        let mut mesh = grid(10 * length as u32, 10, false, false);
        mesh.positions.iter_mut().for_each(|p| p.x *= length);
        let chart = unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let harmonics = Harmonics::new(&chart).expect("a disc");
        let around = |s: f64| match s.rem_euclid(2.0 * (length + 1.0)) {
            s if s < length => Vec3::new(s, 0.0, 0.0),
            s if s < length + 1.0 => Vec3::new(length, s - length, 0.0),
            s if s < 2.0 * length + 1.0 => Vec3::new(2.0 * length + 1.0 - s, 1.0, 0.0),
            s => Vec3::new(0.0, 2.0 * (length + 1.0) - s, 0.0),
        };
        let count = (2.0 * (length + 1.0) / edge) as u32;
        let points: Vec<Vec3> = (0..count).map(|k| around(0.5 * length + edge * f64::from(k))).collect();
        let found = layout(&mesh, &vec![0; mesh.triangles.len()], 1);
        let curve = &found.curves[0][0];
        let at: Vec<f64> = points.iter().map(|&p| curve.nearest(p).0).collect();
        let Unwound { u, along, .. } = Border::new(&chart).unwound(curve, &at).expect("a boundary");
        let given = GivenVertices { u, along, points: points.clone() };
        (harmonics.best(&chart, &[&given], edge), points)
    }

    #[test]
    fn an_oblong_becomes_a_grid_of_right_angles_with_its_corners_as_corners() {
        // 24 steps along the long sides, 8 along the short ones.
        let (mut all, points) = laid(3.0, 0.25);
        assert_eq!(all.len(), 1);
        let laid = all.remove(0);
        assert_eq!(laid.ends, [(0..32).collect::<Vec<u32>>(), Vec::new()]);
        let net = laid.net;
        assert!(mean_deviation_deg(&net) < 3.0, "{}", mean_deviation_deg(&net));
        assert_eq!(net.faces().count(), 48);
        let made = net.into_mesh().0;
        let disc = TopologyCounts { components: 1, boundary_loops: 1, euler: 1 };
        assert_eq!((check(&made, disc), extraordinary(&made)), (Ok(()), 0));
        assert_eq!(made.positions[..32], points[..]);
        for c in made.faces.iter() {
            let p = |k: usize| made.positions[c[k] as usize];
            assert!((p(2) - p(0)).cross(&(p(3) - p(1))).z > 0.0, "all quads look the same way");
        }
    }

    #[test]
    fn a_long_strip_is_laid_in_as_many_quads_as_are_wanted() {
        let (all, _) = laid(18.0, 0.5);
        let counts: Vec<usize> = all.iter().map(|laid| laid.net.faces().count()).collect();
        assert!(counts.contains(&72), "{counts:?}");
        let wanted = all.iter().find(|laid| laid.net.faces().count() == 72).expect("2 by 36");
        assert!(mean_deviation_deg(&wanted.net) < 3.0, "{}", mean_deviation_deg(&wanted.net));
    }
}
