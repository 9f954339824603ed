//! Regular layouts for the four primitives, in the domain of the input's own chart: what a segment takes that has no
//! example, or whose example doesn't fit.
//!
//! Rings of columns stand at even heights ([`levels`]); their number follows the length of the levels, and changes by
//! strips that make two extraordinary vertices for two columns ([`rings`]). The first and the last ring stand where the
//! neighbours' vertices do, so that nothing has to be stitched there. *Disc:* the innermost ring of n columns is closed by
//! a cap of a × b quads, 2(a + b) = n, with a vertex at the pole: four vertices of three edges, and no pole with n edges.
//! *Sphere:* such a cap at each pole. *Torus:* n columns and n·m rows, m the modulus. Where it has better angles, a disc or
//! an annulus becomes a rectangle instead ([`rectangle`]). Whatever is laid comes to rest in quads of like size ([`even`]).
//! *Ours, not the paper's.*

pub mod border;
pub mod even;
pub mod frame;
pub mod levels;
pub mod ramps;
pub mod rectangle;
pub mod rings;

use super::REGULAR_QUADS;
use super::check::extraordinary;
use super::net::Net;
use super::smooth::{Plan, Target};
use crate::encode::index::PlanarIndex;
use crate::mesh::{PolyMesh, Vec3};
use crate::numerics::{in_halves, stop};
use crate::topology::Topology;
use crate::unfold::Chart;
use border::{Border, End, Unwound};
use even::even_out;
use levels::Levels;
use rectangle::{Harmonics, badness};
use rings::{Ring, counts, rings_min, strip};

/// Fewest columns of a ring that nothing prescribes, and of one that carries a cap.
const COLUMNS_MIN: usize = 8;
/// Columns that go around a tube that is thinner than as many: three make a prism with sharp edges.
const COLUMNS_OF_TUBE: f64 = 4.0;
/// Most columns of such a ring, and most rings: of a tube that is no wider than an edge as many as a whole has quads.
const COLUMNS_MAX: usize = 400;
const RINGS_MAX: usize = REGULAR_QUADS as usize;
/// The number of columns stays while edges are not longer or shorter than wanted by more than this factor.
const SLACK: f64 = 1.8;
/// A cap begins where what is left to the pole is no higher than this share of the level's length (a flat disc has
/// 1/2π), and in the upper part of the whole.
const CAP_HEIGHT: f64 = 1.0 / 6.0;
const CAP_LOWEST: f64 = 0.3;
/// Share of the way to even spacing that columns go from ring to ring.
const EVENING: f64 = 0.5;
/// Rounds of smoothing.
const ROUNDS: u32 = 12;
/// A layout of more quads than these, and of more than this factor times those that are wanted, stays as it is drawn: it stands
/// between a boundary that a few vertices thrown far off draw out, and evening it out would take minutes.
const TOO_MANY_QUADS: usize = 5000;
const TOO_MANY_TIMES: f64 = 4.0;
/// Degrees that an extraordinary vertex counts for, where rings and a rectangle are compared.
const EXTRAORDINARY_DEG: f64 = 0.03;

/// What a layout is made on.
#[derive(Clone, Copy, Debug)]
pub struct LayoutSurface<'a> {
    /// The segment's chart.
    pub chart: &'a Chart,
    /// Its index.
    pub index: &'a PlanarIndex,
    /// Its level sets.
    pub levels: &'a Levels,
    /// Its surface.
    pub target: &'a Target,
    /// Its harmonic maps onto rectangles, where it may be laid out as one.
    pub harmonics: Option<&'a Harmonics>,
}

/// Vertices on a boundary that are given, in the order of u.
#[derive(Clone, Debug, Default)]
pub struct GivenVertices {
    /// u of each, increasing over one period.
    pub u: Vec<f64>,
    /// The length of each along the chart's boundary loop, in the loop's own direction.
    pub along: Vec<f64>,
    /// Where each stands.
    pub points: Vec<Vec3>,
}

/// The vertices on the boundaries at v = 0 and v = 1; `None` where a boundary's are free, or where there is none.
pub type Ends = [Option<GivenVertices>; 2];

/// A regular layout as a net, with its vertices on the boundaries at v = 0 and v = 1 in the order in which they were
/// asked for.
#[derive(Clone, Debug, Default)]
pub struct TemplateNet {
    /// Quads.
    pub net: Net,
    /// Vertices on the boundaries.
    pub ends: [Vec<u32>; 2],
}

/// The layout of edges about `edge` long, nothing prescribed.
pub fn template(chart: &Chart, index: &PlanarIndex, edge: f64) -> PolyMesh {
    let (levels, target) = (Levels::new(chart), Target::new(&chart.mesh));
    let ground = LayoutSurface { chart, index, levels: &levels, target: &target, harmonics: None };
    regular(ground, edge, [None, None]).net.into_mesh().0
}

/// The layout of edges about `edge` long between given ends. The ends of an annulus must be of like parity, that of a
/// disc even, none shorter than 3; else triangles would be needed, and the ends are taken as free.
pub fn regular(ground: LayoutSurface<'_>, edge: f64, ends: Ends) -> TemplateNet {
    stop::ask();
    let area = ground.chart.mesh.total_area();
    let edge = if edge > 0.0 && edge.is_finite() { edge } else { area.sqrt() / 16.0 };
    if ground.chart.topology == Topology::Torus {
        return torus(ground, edge);
    }
    let mut drawn = rectangles(ground, &ends, edge);
    drawn.push(Builder::new(ground, edge, ends).run());
    let evened = in_halves(&drawn, |drawn| {
        let mut laid = drawn.clone();
        if wanted_share(&laid.net, area, edge) >= 1.0 {
            even_out(&mut laid.net, ground.chart, ground.target);
        }
        let extraordinary = extraordinary(&laid.net.clone().into_mesh().0);
        let cost = badness(&laid.net, area, Some(edge)) + EXTRAORDINARY_DEG * extraordinary as f64;
        (cost, laid)
    });
    evened.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(TemplateNet::default, |best| best.1)
}

/// The quads with edges of length `edge` that an area has, as a share of those of a layout that has far more; 1 where it has not.
pub fn wanted_share(net: &Net, area: f64, edge: f64) -> f64 {
    let (quads, wanted) = (net.faces().count(), area / (edge * edge));
    if quads > TOO_MANY_QUADS && quads as f64 > TOO_MANY_TIMES * wanted { wanted / quads as f64 } else { 1.0 }
}

/// The layout of a disc of edges about `edge` long between vertices that are given all around it: lengths along the loop of its
/// `border`, and where they stand. `None` where they are too few or odd in number, or the disc has no such loop.
pub fn disc_between(
    (chart, index): (&Chart, &PlanarIndex),
    border: &Border,
    edge: f64,
    (at, points): (&[f64], Vec<Vec3>),
) -> Option<TemplateNet> {
    let Unwound { end, u, along } = border.unwound(border.only_loop()?, at)?;
    let (levels, target, harmonics) = (Levels::new(chart), Target::new(&chart.mesh), Harmonics::new(chart));
    let ground = LayoutSurface { chart, index, levels: &levels, target: &target, harmonics: harmonics.as_ref() };
    let laid = regular(ground, edge, [Some(GivenVertices { u, along, points }), None]);
    (end == End::Bottom && laid.ends[0].len() == at.len()).then_some(laid)
}

/// A disc as rectangles, an annulus as such with a hole, if the surface is prepared for that and all ends are given.
fn rectangles(ground: LayoutSurface<'_>, ends: &Ends, edge: f64) -> Vec<TemplateNet> {
    let Some(harmonics) = ground.harmonics else { return Vec::new() };
    let given: Vec<&GivenVertices> = ends.iter().flatten().collect();
    harmonics.best(ground.chart, &given, edge)
}

fn place(ground: LayoutSurface<'_>, u: f64, v: f64) -> Vec3 {
    ground.index.locate(ground.chart, [u.rem_euclid(1.0), v.clamp(0.0, 1.0)]).point(ground.chart)
}

fn torus(ground: LayoutSurface<'_>, edge: f64) -> TemplateNet {
    let modulus = ground.chart.modulus.max(1e-3);
    let around = (ground.chart.mesh.total_area() / (edge * edge) / modulus).sqrt();
    let n = 2 * ((around / 2.0).round() as usize).clamp(COLUMNS_MIN / 2, COLUMNS_MAX / 2);
    let rows = ((n as f64 * modulus).round() as usize).clamp(3, COLUMNS_MAX);
    let at = |i: usize, j: usize| ((j % rows) * n + i % n) as u32;
    let cells = (0..rows).flat_map(|j| (0..n).map(move |i| (i, j)));
    let positions = cells.clone().map(|(i, j)| place(ground, i as f64 / n as f64, j as f64 / rows as f64)).collect();
    let quads = cells.map(|(i, j)| vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]).collect();
    TemplateNet { net: Net::new(positions, quads), ends: Default::default() }
}

struct Builder<'a> {
    ground: LayoutSurface<'a>,
    ends: Ends,
    /// Columns of the first and of the last ring, and the heights at which they stand.
    columns: [usize; 2],
    heights: [f64; 2],
    edge: f64,
    positions: Vec<Vec3>,
    quads: Vec<Vec<u32>>,
}

impl<'a> Builder<'a> {
    fn new(ground: LayoutSurface<'a>, edge: f64, ends: Ends) -> Self {
        let (levels, topology) = (ground.levels, ground.chart.topology);
        let total = levels.height();
        let ideal = |height: f64| levels.around(height) / edge;
        let even = |x: f64| 2 * ((x / 2.0).round() as usize).clamp(COLUMNS_MIN / 2, COLUMNS_MAX / 2);
        let steps = |from: f64, to: f64| (0..=64).map(move |k| from + (to - from) * f64::from(k) / 64.0);
        let is_low = |h: f64, left: f64| left <= CAP_HEIGHT * levels.around(h);
        let top_cap = steps(CAP_LOWEST * total, total).find(|&h| is_low(h, total - h)).unwrap_or(total);
        let low_cap = steps(0.5 * total - CAP_LOWEST * total, 0.0).find(|&h| is_low(h, h)).unwrap_or(0.0);
        let heights = match topology {
            Topology::Disc => [0.0, top_cap.min(0.98 * total)],
            Topology::Sphere => [low_cap.max(0.02 * total), top_cap.clamp(0.6 * total, 0.98 * total)],
            Topology::Annulus | Topology::Torus => [0.0, total],
        };
        let mut ends = ends;
        let n = ends.iter().map(|e| e.as_ref().map(|given| given.u.len()));
        let sound = match n.collect::<Vec<_>>()[..] {
            [Some(n), Some(m)] => n.min(m) >= 3 && n % 2 == m % 2,
            [Some(n), None] | [None, Some(n)] => n >= 3 && (topology == Topology::Annulus || n % 2 == 0),
            _ => true,
        };
        if !sound || topology == Topology::Sphere {
            ends = [None, None];
        }
        let mut columns = [0, 1].map(|k| ends[k].as_ref().map_or(even(ideal(heights[k])), |given| given.u.len()));
        match (&ends, topology) {
            ([Some(_), None], Topology::Annulus) => columns[1] += (columns[0] + columns[1]) % 2,
            ([None, Some(_)], Topology::Annulus) => columns[0] += (columns[0] + columns[1]) % 2,
            (_, Topology::Disc) => {
                let ratio = columns[0] as f64 / ideal(heights[1]).max(1.0);
                if ratio < SLACK && ratio > 1.0 / SLACK && columns[0] >= COLUMNS_MIN {
                    columns[1] = columns[0];
                }
            }
            (_, Topology::Sphere) => columns[1] = columns[0],
            _ => {}
        }
        Self { ground, ends, columns, heights, edge, positions: Vec::new(), quads: Vec::new() }
    }

    fn run(mut self) -> TemplateNet {
        let (levels, [n, m], [low, high]) = (self.ground.levels, self.columns, self.heights);
        let wanted = ((high - low) / self.edge).round() as usize;
        let rings = wanted.clamp(1, RINGS_MAX).max(rings_min(n, m));
        let height = |r: usize| low + (high - low) * r as f64 / rings as f64;
        let least = if self.ground.chart.topology == Topology::Annulus { COLUMNS_OF_TUBE } else { 1.0 };
        let all = counts(n, m, rings, SLACK, |r| (levels.around(height(r)) / self.edge).max(least));
        let mut ring = Ring { columns: (0..n).map(|i| i as f64 / n as f64).collect(), first: 0 };
        if let Some(given) = self.ends[0].take() {
            ring.columns = given.u;
            self.positions.extend(given.points);
        } else {
            levels.even_out(low, &mut ring.columns, 1.0);
            self.stand(&ring, levels.v(low));
        }
        let bottom: Vec<u32> = (0..n).map(|i| ring.vertex(i)).collect();
        let first = ring.clone();
        for (r, &count) in all.iter().enumerate().skip(1) {
            let start = self.positions.len() as u32;
            ring = strip(&ring, count, start, r * (count / 3 + 1), &mut self.quads);
            if r < rings || self.ends[1].is_none() {
                levels.even_out(height(r), &mut ring.columns, EVENING);
                self.stand(&ring, levels.v(height(r)));
            }
        }
        let mut top: Vec<u32> = (0..m).map(|i| ring.vertex(i)).collect();
        if let Some(given) = self.ends[1].take() {
            let turn = nearest_turn(&ring.columns, &given.u);
            self.positions.extend((0..m).map(|i| given.points[(i + turn) % m]));
            top.rotate_right(turn);
        }
        let topology = self.ground.chart.topology;
        let mut held: Vec<u32> = Vec::new();
        if topology == Topology::Annulus {
            held.extend(&top)
        }
        if topology != Topology::Sphere {
            held.extend(&bottom)
        }
        if matches!(topology, Topology::Disc | Topology::Sphere) {
            let total = levels.height();
            held.push(self.cap(&ring, |rho| levels.v(total - rho * (total - high))));
        }
        if topology == Topology::Sphere {
            // Seen from the bottom pole, u runs clockwise.
            held.push(self.cap_below(&first, |rho| levels.v(rho * low)));
        }
        let mut net = Net::new(self.positions, self.quads);
        Plan::inside(&net, &held).run(&mut net, self.ground.target, ROUNDS);
        let ends = match topology {
            Topology::Disc => [bottom, Vec::new()],
            Topology::Annulus => [bottom, top],
            Topology::Sphere | Topology::Torus => [Vec::new(), Vec::new()],
        };
        TemplateNet { net, ends }
    }

    /// Puts the vertices of a ring on the surface.
    fn stand(&mut self, ring: &Ring, v: f64) {
        self.positions.extend(ring.columns.iter().map(|&u| place(self.ground, u, v)));
    }

    /// A square cap inside a ring; `v` gives the level at a share of the way from the pole to the ring. Gives the vertex at
    /// the pole.
    fn cap(&mut self, ring: &Ring, v: impl Fn(f64) -> f64) -> u32 {
        let n = ring.columns.len();
        let (a, b) = (n / 4, n / 2 - n / 4);
        let mut number = vec![0u32; (a + 1) * (b + 1)];
        for y in 0..=b {
            for x in 0..=a {
                let (p, q) = (from_middle(x, a), from_middle(y, b));
                let rho = p.abs().max(q.abs());
                let around = border_place(p / rho.max(1e-12), q / rho.max(1e-12), a, b);
                number[y * (a + 1) + x] = if x == 0 || y == 0 || x == a || y == b {
                    ring.vertex(around.round() as usize)
                } else {
                    let (i, t) = (around.floor() as usize, around.fract());
                    let wrap = |i: usize| ring.columns[i % n] + (i / n) as f64;
                    self.positions.push(place(self.ground, wrap(i) + t * (wrap(i + 1) - wrap(i)), v(rho)));
                    self.positions.len() as u32 - 1
                };
            }
        }
        let at = |x: usize, y: usize| number[y * (a + 1) + x];
        for (x, y) in (0..b).flat_map(|y| (0..a).map(move |x| (x, y))) {
            self.quads.push(vec![at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
        at(a.div_ceil(2), b.div_ceil(2))
    }

    fn cap_below(&mut self, ring: &Ring, v: impl Fn(f64) -> f64) -> u32 {
        // The same cap, seen from above, and its quads turned over.
        let start = self.quads.len();
        let pole = self.cap(ring, v);
        self.quads[start..].iter_mut().for_each(|q| q.reverse());
        pole
    }
}

/// By how many places the second row is turned against the first where they lie nearest to each other.
fn nearest_turn(one: &[f64], two: &[f64]) -> usize {
    let m = one.len();
    let apart = |turn: &usize| -> f64 {
        let d = |i: usize| one[i] - two[(i + turn) % m];
        (0..m).map(|i| (d(i) - d(i).round()).powi(2)).sum()
    };
    (0..m).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(0)
}

/// Place of line x of 0..=a, from −1 to 1 with 0 at a line.
fn from_middle(x: usize, a: usize) -> f64 {
    let middle = a.div_ceil(2);
    let d = x as f64 - middle as f64;
    if x <= middle { d / middle.max(1) as f64 } else { d / (a - middle).max(1) as f64 }
}

/// Length along the border of a square of a × b columns, of a point with max(|p|, |q|) = 1, from the lower left corner.
fn border_place(p: f64, q: f64, a: usize, b: usize) -> f64 {
    // The reverse of `from_middle`, in columns.
    let along = |p: f64, a: usize| {
        let middle = a.div_ceil(2) as f64;
        if p <= 0.0 { middle * (1.0 + p) } else { middle + p * (a as f64 - middle) }
    };
    let (s, t, a, b) = (along(p, a), along(q, b), a as f64, b as f64);
    if q <= -1.0 + 1e-9 {
        s
    } else if p >= 1.0 - 1e-9 {
        a + t
    } else if q >= 1.0 - 1e-9 {
        a + b + (a - s)
    } else {
        2.0 * a + b + (b - t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{TopologyCounts, check, extraordinary};
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    const DISC: TopologyCounts = TopologyCounts { components: 1, boundary_loops: 1, euler: 1 };

    fn on(mesh: crate::mesh::tri::TriMesh, edge: f64, columns: [Option<usize>; 2]) -> (PolyMesh, [usize; 2]) {
        let chart = unfold(&whole(&mesh).expect("a primitive"), &UnfoldOptions::default()).expect("solvable");
        let index = PlanarIndex::new(&chart);
        let (levels, target) = (Levels::new(&chart), Target::new(&chart.mesh));
        let ground = LayoutSurface { chart: &chart, index: &index, levels: &levels, target: &target, harmonics: None };
        let given = |end: usize| {
            columns[end].map(|n| {
                let u: Vec<f64> = (0..n).map(|i| 0.137 + i as f64 / n as f64).collect();
                let points = u.iter().map(|&u| place(ground, u, end as f64)).collect();
                GivenVertices { u, points, ..GivenVertices::default() }
            })
        };
        let made = regular(ground, edge, [given(0), given(1)]);
        let found = made.ends.iter().map(Vec::len).collect::<Vec<_>>();
        (made.net.into_mesh().0, [found[0], found[1]])
    }

    #[test]
    fn a_disc_takes_any_even_number_of_columns_at_its_boundary() {
        for n in [4, 6, 8, 10, 22, 64] {
            let (mesh, found) = on(grid(20, 20, false, false), 0.1, [Some(n), None]);
            assert_eq!(check(&mesh, DISC), Ok(()), "{n} columns");
            assert_eq!(found[0], n);
        }
    }

    #[test]
    fn an_annulus_takes_any_two_numbers_of_like_parity() {
        let annulus = TopologyCounts { components: 1, boundary_loops: 2, euler: 0 };
        for (n, m) in [(12, 12), (12, 20), (7, 9), (4, 30), (30, 4)] {
            let (mesh, found) = on(grid(24, 16, true, false), 0.2, [Some(n), Some(m)]);
            assert_eq!(check(&mesh, annulus), Ok(()), "{n}, {m}");
            assert_eq!(found, [n, m]);
        }
        let (mesh, _) = on(grid(24, 16, true, false), 0.2, [None, None]);
        assert_eq!((check(&mesh, annulus), extraordinary(&mesh)), (Ok(()), 0));
    }

    #[test]
    fn a_torus_is_regular_throughout() {
        let (mesh, _) = on(grid(24, 16, true, true), 0.3, [None, None]);
        let torus = TopologyCounts { components: 1, boundary_loops: 0, euler: 0 };
        assert_eq!((check(&mesh, torus), extraordinary(&mesh)), (Ok(()), 0));
    }

    #[test]
    fn a_template_lies_on_its_disc_and_its_boundary_on_the_boundary() {
        let mesh = grid(24, 24, false, false);
        let patch = whole(&mesh).expect("a disc");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        let index = PlanarIndex::new(&chart);
        let made = template(&chart, &index, 0.1);
        assert!((made.faces.len() as f64 - 100.0).abs() < 100.0, "{}", made.faces.len());
        assert_eq!((check(&made, DISC), extraordinary(&made)), (Ok(()), 4));
        let net = Net::from_mesh(&made);
        for v in net.loops().expect("one").remove(0) {
            let p = net.positions[v as usize];
            assert!(p.x.min(1.0 - p.x).min(p.y).min(1.0 - p.y) < 1e-9);
        }
        // All quads look the same way.
        for (_, c) in net.faces() {
            let p = |k: usize| net.positions[c[k] as usize];
            assert!((p(2) - p(0)).cross(&(p(3) - p(1))).z > 0.0);
        }
    }
}
