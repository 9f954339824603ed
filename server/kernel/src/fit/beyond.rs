//! Rows of quads that continue a laid example to where the input ends.
//!
//! The rest of the input is an annulus about a rim of the example, or, on a closed input, a disc. It is unfolded; each
//! vertex of the rim gets a line of constant u, and rows follow at levels of v. So the rim's loops go on outward without an
//! extraordinary vertex. On a disc the last row is filled by a grid, whose four corners are the only ones. Where the disc has a
//! flat end ([`flat`](super::flat)), a row runs along its edge. A disc that ends in part where the input does is a
//! [`crescent`](super::crescent). *Ours, not the paper's.*

use super::crescent::Crescent;
use super::flat::flat_end;
use crate::compose::net::Net;
use crate::encode::index::PlanarIndex;
use crate::mesh::tri::{NONE, TriMesh, nearest_share};
use crate::mesh::{PolyMesh, Vec3};
use crate::register::Query;
use crate::topology::{Patch, Topology};
use crate::unfold::{Chart, UnfoldOptions, Uv};
use std::collections::BTreeMap;

/// Rows at most.
const ROWS_MAX: usize = 200;
/// Points at which the length of a line of constant u is measured.
const SAMPLES: usize = 65;
/// Rows along a protrusion that is thin for its rim are closer by this factor at most. *Untuned.*
const CLOSER_MAX: f64 = 3.0;
/// After so many rows along a protrusion the vertices are evenly spaced around it. *Untuned.*
const EVEN_AFTER: f64 = 2.0;
/// Share of a disc's depth that its rows take; a grid fills the rest.
const ROWS_SHARE: f64 = 0.8;

/// Continues `mesh`, which lies on one part of a `surface`, over `rest`, the part beside it. The mesh's vertices and faces stay
/// and come first; labels are continued by the last face's. `None` where the rest is neither annulus nor disc, or the mesh has no
/// rim.
pub fn continued(mesh: &PolyMesh, rest: &Patch, surface: &TriMesh) -> Option<PolyMesh> {
    if rest.topology == Topology::Disc && surface.twins.contains(&NONE) {
        let query = Query::new(rest, &UnfoldOptions::default()).ok()?;
        let crescent = Crescent::of(&query.chart, surface);
        if let Some(grown) = crescent.and_then(|it| it.filled(mesh, &Net::from_mesh(mesh).loops()?, query.index())) {
            return Some(grown);
        }
    }
    let ends = if rest.topology == Topology::Disc { flat_end(&rest.mesh) } else { None };
    let by_ends = ends.and_then(|[around, end]| continued_evenly(&continued_evenly(mesh, &around)?, &end));
    by_ends.or_else(|| continued_evenly(mesh, rest))
}

/// The same without regard to what is flat.
fn continued_evenly(mesh: &PolyMesh, rest: &Patch) -> Option<PolyMesh> {
    let rims = Net::from_mesh(mesh).loops()?;
    let query = Query::new(rest, &UnfoldOptions::default()).ok()?;
    let chart = &query.chart;
    let ground = UnfoldedRest { chart, index: query.index() };
    // Of a head that is open at its eyes, too, the neck borders on the rest.
    let borders = rims.into_iter().filter_map(|rim| Some((ground.along(mesh, &rim)?, rim)));
    let (along, rim) = borders.min_by(|(a, _), (b, _)| a.away.total_cmp(&b.away))?;
    let quads = match rest.topology {
        Topology::Annulus => ground.rows(mesh, &rim, &along, RowsEnd::Depth(1.0)),
        Topology::Disc => ground.rows(mesh, &rim, &along, RowsEnd::Depth(ROWS_SHARE)),
        Topology::Sphere | Topology::Torus => return None,
    };
    let mut grown = GrownMesh::new(mesh, rim, mesh.faces.len().saturating_sub(1));
    quads.rows.iter().for_each(|row| grown.row(row));
    if rest.topology == Topology::Disc {
        grown.close(&ground, &quads)?;
    }
    Some(grown.mesh)
}

/// The vertices of the boundary of some faces, in the order in which its edges run on them; `None` unless it is one loop.
pub(super) fn only_rim<'a>(faces: impl Iterator<Item = &'a [u32]>) -> Option<Vec<u32>> {
    let mut next = BTreeMap::new();
    for face in faces {
        for (k, &a) in face.iter().enumerate() {
            let b = face[(k + 1) % face.len()];
            if next.remove(&(b, a)).is_none() {
                next.insert((a, b), ());
            }
        }
    }
    // An edge of the rim runs a → b on its only face.
    let edges: BTreeMap<u32, u32> = next.keys().map(|&(a, b)| (a, b)).collect();
    if edges.len() != next.len() {
        return None;
    }
    let (&first, _) = edges.first_key_value()?;
    let mut rim = vec![first];
    while let Some(&v) = rim.last().and_then(|v| edges.get(v)) {
        if v == first {
            break;
        }
        if rim.len() > edges.len() {
            return None;
        }
        rim.push(v);
    }
    (rim.len() == edges.len()).then_some(rim)
}

/// The unfolded rest.
pub(super) struct UnfoldedRest<'a> {
    pub(super) chart: &'a Chart,
    pub(super) index: &'a PlanarIndex,
}

/// Where rows end.
#[derive(Clone, Copy)]
pub(super) enum RowsEnd {
    /// At a share of the depth.
    Depth(f64),
    /// So many rows before the pole; rows are no farther apart than quads are wide, on average.
    BeforePole(f64),
}

/// Rows of vertices, from the rim outward.
pub(super) struct Rows {
    pub(super) rows: Vec<Vec<Vec3>>,
    /// How deep each lies, as a share of the area; the rim first.
    pub(super) depths: Vec<f64>,
    /// u of the vertices of each, the rim first.
    pub(super) u: Vec<Vec<f64>>,
}

impl Rows {
    /// Where the vertices of the last one lie in the picture about the pole.
    pub(super) fn edge(&self) -> Vec<[f64; 2]> {
        let depth = self.depths.last().copied().unwrap_or_default();
        self.u.last().into_iter().flatten().map(|&u| polar(u, depth)).collect()
    }
}

/// Tells where the rim lies on the rest: u of each of its vertices, and whether v falls from the rim on.
pub(super) struct RimOnRest {
    u: Vec<f64>,
    falls: bool,
    /// How far the rim's vertices are from the boundary, on average.
    pub(super) away: f64,
}

impl UnfoldedRest<'_> {
    pub(super) fn at(&self, uv: Uv) -> Vec3 {
        self.index.locate(self.chart, [uv[0].rem_euclid(1.0), uv[1]]).point(self.chart)
    }

    /// The surface's area vector at a place.
    pub(super) fn normal(&self, uv: Uv) -> Vec3 {
        let triangle = self.index.locate(self.chart, [uv[0].rem_euclid(1.0), uv[1]]).triangle;
        self.chart.mesh.area_vector(triangle as usize)
    }

    /// u of the rim's vertices, by the nearest place on the rest's boundary.
    pub(super) fn along(&self, mesh: &PolyMesh, rim: &[u32]) -> Option<RimOnRest> {
        let surface: &TriMesh = &self.chart.mesh;
        let points: Vec<Vec3> = rim.iter().map(|&v| mesh.positions[v as usize]).collect();
        let nearest = |edges: &[u32], x: Vec3| -> Option<(f64, f64)> {
            let place = |h: &u32| {
                let ends = [surface.tail(*h), surface.head(*h)].map(|v| surface.positions[v as usize]);
                let share = nearest_share(ends, x);
                ((ends[0].lerp(&ends[1], share) - x).norm(), *h, share)
            };
            let (away, h, share) = edges.iter().map(place).min_by(|a, b| a.0.total_cmp(&b.0))?;
            let [a, b] = [surface.tail(h), surface.head(h)].map(|v| self.chart.uv[v as usize][0]);
            let step = b - a - (b - a).round();
            Some((away, a + share * step))
        };
        let loops = surface.boundary_loops();
        let fits = |edges: &Vec<u32>| -> Option<(f64, Vec<f64>, bool)> {
            let found: Vec<(f64, f64)> = points.iter().map(|x| nearest(edges, *x)).collect::<Option<_>>()?;
            let away = found.iter().map(|f| f.0).sum::<f64>();
            let v = self.chart.uv[surface.tail(*edges.first()?) as usize][1];
            Some((away, found.into_iter().map(|f| f.1).collect(), v > 0.5))
        };
        let (away, u, falls) = loops.iter().filter_map(fits).min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(RimOnRest { u: untwisted(&u), falls, away: away / rim.len() as f64 })
    }

    /// Rows about as far apart as the rim's vertices.
    pub(super) fn rows(&self, mesh: &PolyMesh, rim: &[u32], along: &RimOnRest, end: RowsEnd) -> Rows {
        let (to, left) = match end {
            RowsEnd::Depth(to) => (to, 0.0),
            RowsEnd::BeforePole(left) => (1.0, left),
        };
        let n = rim.len();
        let edge = |k: usize| (mesh.positions[rim[(k + 1) % n] as usize] - mesh.positions[rim[k] as usize]).norm();
        let wanted = (0..n).map(edge).sum::<f64>() / n as f64;
        let level = |depth: f64| if along.falls { 1.0 - depth } else { depth };
        // The mean length of lines of constant u from the rim on tells where rows are evenly spaced.
        let mut lengths = vec![0.0; SAMPLES];
        let step = n.div_ceil(SAMPLES);
        let lines: Vec<f64> = along.u.iter().copied().step_by(step).collect();
        for &u in &lines {
            let mut sum = 0.0;
            let mut before = self.at([u, level(0.0)]);
            for (k, length) in lengths.iter_mut().enumerate() {
                let here = self.at([u, level(to * k as f64 / (SAMPLES - 1) as f64)]);
                sum += (here - before).norm();
                *length += sum / lines.len() as f64;
                before = here;
            }
        }
        let all = lengths.last().copied().unwrap_or(0.0);
        let wanted = match end {
            RowsEnd::Depth(_) => wanted,
            RowsEnd::BeforePole(_) => {
                let width = self.chart.mesh.total_area() / (all * n as f64).max(f64::MIN_POSITIVE);
                width.clamp(wanted / CLOSER_MAX, wanted)
            }
        };
        let all = (all - left * wanted).max(0.5 * all);
        let count = ((all / wanted.max(f64::MIN_POSITIVE)).round() as usize).clamp(1, ROWS_MAX);
        let depth = |row: usize| {
            let length = all * row as f64 / count as f64;
            let k = lengths.partition_point(|l| *l < length).clamp(1, SAMPLES - 1);
            let within = (length - lengths[k - 1]) / (lengths[k] - lengths[k - 1]).max(f64::MIN_POSITIVE);
            to * (k as f64 - 1.0 + within.clamp(0.0, 1.0)) / (SAMPLES - 1) as f64
        };
        let u_of = |k: usize| match end {
            RowsEnd::Depth(_) => along.u.clone(),
            RowsEnd::BeforePole(_) => evened(&along.u, k as f64 / EVEN_AFTER),
        };
        let row = |k: usize| u_of(k).iter().map(|&u| self.at([u, level(depth(k))])).collect();
        Rows {
            rows: (1..=count).map(row).collect(),
            depths: (0..=count).map(depth).collect(),
            u: (0..=count).map(u_of).collect(),
        }
    }
}

/// u that goes round once, drawn towards even steps by a `share`; 1 or more makes them even.
fn evened(u: &[f64], share: f64) -> Vec<f64> {
    let (n, share) = (u.len() as f64, share.min(1.0));
    let turns = if u.last() < u.first() { -1.0 } else { 1.0 };
    let even = |k: usize| turns * k as f64 / n;
    let shift = u.iter().enumerate().map(|(k, u)| u - even(k)).sum::<f64>() / n;
    u.iter().enumerate().map(|(k, u)| u + share * (even(k) + shift - u)).collect()
}

/// u made to grow or fall all the way round once, from the first on: places on a ragged boundary may come back by a little.
fn untwisted(u: &[f64]) -> Vec<f64> {
    let n = u.len();
    // Steps in one direction, each less than a turn; in the other they make more turns in all.
    let steps = |sign: f64| -> Vec<f64> { (0..n).map(|k| (sign * (u[(k + 1) % n] - u[k])).rem_euclid(1.0)).collect() };
    let total = |steps: &[f64]| steps.iter().sum::<f64>();
    let (on, back) = (steps(1.0), steps(-1.0));
    let (sign, mut steps) = if total(&on) <= total(&back) { (1.0, on) } else { (-1.0, back) };
    // What comes back was taken for nearly a turn.
    while total(&steps) > 1.5 {
        let Some(largest) = steps.iter_mut().max_by(|a, b| a.total_cmp(b)) else { break };
        *largest -= 1.0;
    }
    // Steps forward have a tenth of what even spacing has, or more.
    steps.iter_mut().for_each(|step| *step = step.max(0.1 / n as f64));
    let all = total(&steps);
    let mut out = vec![u.first().copied().unwrap_or(0.0)];
    for k in 1..n {
        out.push(out[k - 1] + sign * steps[k - 1] / all);
    }
    out
}

/// The place of (u, v) in the picture about the pole at v = 1: the radius is √(share of the area left), the angle u.
pub(super) fn polar(u: f64, v: f64) -> [f64; 2] {
    let r = (1.0 - v).max(0.0).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
    [r * cos, r * sin]
}

/// The reverse of [`polar`].
pub(super) fn from_polar([x, y]: [f64; 2]) -> Uv {
    [y.atan2(x) / std::f64::consts::TAU, 1.0 - (x * x + y * y)]
}

/// A mesh that grows by rows of quads, and its outer loop.
pub(super) struct GrownMesh {
    pub(super) mesh: PolyMesh,
    /// Its outer loop.
    pub(super) rim: Vec<u32>,
    /// The face whose labels new faces take.
    like: usize,
}

impl GrownMesh {
    pub(super) fn new(mesh: &PolyMesh, rim: Vec<u32>, like: usize) -> Self {
        let mut mesh = mesh.clone();
        // New corners have no place in a layer of texture coordinates; the layer would end before them.
        mesh.attributes.normals = None;
        Self { mesh, rim, like }
    }

    pub(super) fn vertex(&mut self, at: Vec3) -> u32 {
        self.mesh.positions.push(at);
        if let Some(colors) = &mut self.mesh.attributes.colors {
            let color = colors.last().copied().unwrap_or_default();
            colors.push(color);
        }
        self.mesh.positions.len() as u32 - 1
    }

    pub(super) fn face(&mut self, corners: [u32; 4]) {
        self.mesh.faces.push(&corners);
        let a = &mut self.mesh.attributes;
        if let Some(uvs) = &mut a.uvs {
            // All at one point: the new faces have no texture.
            let at = uvs.values.len() as u32;
            if uvs.corners.last().is_none_or(|last| uvs.values.get(*last as usize) != Some(&[0.0; 2])) {
                uvs.values.push([0.0; 2]);
                uvs.corners.extend([at; 4]);
            } else {
                uvs.corners.extend([at - 1; 4]);
            }
        }
        for labels in [&mut a.groups, &mut a.materials].into_iter().flatten() {
            let label = labels.of_face.get(self.like).copied().unwrap_or(0);
            labels.of_face.push(label);
        }
        if let Some(segments) = &mut a.segments {
            let segment = segments.get(self.like).copied().unwrap_or(0);
            segments.push(segment);
        }
    }

    /// A row of quads beside the rim, whose edges run a → b on their faces: new ones run b → a.
    pub(super) fn row(&mut self, places: &[Vec3]) {
        let outer: Vec<u32> = places.iter().map(|&x| self.vertex(x)).collect();
        let rim = std::mem::take(&mut self.rim);
        let n = rim.len();
        for k in 0..n {
            let next = (k + 1) % n;
            self.face([rim[next], rim[k], outer[k], outer[next]]);
        }
        self.rim = outer;
    }

    /// Fills the loop by a grid.
    fn close(&mut self, ground: &UnfoldedRest, rows: &Rows) -> Option<()> {
        let rim = std::mem::take(&mut self.rim);
        let n = rim.len();
        if n < 4 || n % 2 == 1 {
            return None;
        }
        let (a, b) = (n / 4, n / 2 - n / 4);
        let edge = rows.edge();
        let side = |from: usize, k: usize| edge[(from + k) % n];
        let ring = |i: usize, j: usize| -> Option<usize> {
            match (i, j) {
                (i, 0) => Some(i),
                (i, j) if i == a => Some(a + j),
                (i, j) if j == b => Some(a + b + (a - i)),
                (0, j) => Some((2 * a + b + (b - j)) % n),
                _ => None,
            }
        };
        let mut grid = vec![vec![0u32; b + 1]; a + 1];
        for (i, column) in grid.iter_mut().enumerate() {
            for (j, vertex) in column.iter_mut().enumerate() {
                if let Some(k) = ring(i, j) {
                    *vertex = rim[k];
                    continue;
                }
                let (s, t) = (i as f64 / a as f64, j as f64 / b as f64);
                let (low, high) = (side(0, i), side(a + b, a - i));
                let (left, right) = (side(2 * a + b, b - j), side(a, j));
                let corners = [side(0, 0), side(a, 0), side(a + b, 0), side(2 * a + b, 0)];
                let at = [0, 1].map(|c| {
                    (1.0 - t) * low[c] + t * high[c] + (1.0 - s) * left[c] + s * right[c]
                        - (1.0 - s) * (1.0 - t) * corners[0][c]
                        - s * (1.0 - t) * corners[1][c]
                        - s * t * corners[2][c]
                        - (1.0 - s) * t * corners[3][c]
                });
                *vertex = self.vertex(ground.at(from_polar(at)));
            }
        }
        for i in 0..a {
            for j in 0..b {
                self.face([grid[i + 1][j], grid[i][j], grid[i][j + 1], grid[i + 1][j + 1]]);
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::within;
    use crate::mesh::{Polygons, prepare};
    use crate::segment::segment_above;
    use crate::topology::tests::grid;

    /// A square of n × n quads in the middle of the unit square, about half as wide.
    fn cage(n: u32) -> PolyMesh {
        let at = |i: u32, j: u32| j * (n + 1) + i;
        let place = |k: u32| 0.26 + 0.47 * f64::from(k) / f64::from(n);
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| Vec3::new(place(i), place(j), 0.0))).collect();
        let mut faces = Polygons::default();
        (0..n * n).for_each(|k| {
            let (i, j) = (k % n, k / n);
            faces.push(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        });
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    #[test]
    fn a_cage_is_continued_to_the_end_of_the_sheet_without_an_extraordinary_vertex() {
        let (mesh, sheet) = (cage(8), grid(40, 40, false, false));
        let surface = prepare(&mesh).expect("quads").mesh;
        let field = within(&surface, &surface.positions, &sheet).expect("a rim");
        assert!(field[41 * 20 + 20] > 0.2 && field[0] < -0.3, "{} {}", field[41 * 20 + 20], field[0]);
        let rest = segment_above(&sheet, &field).expect("a cut").parts.swap_remove(1);
        let grown = continued(&mesh, &rest, &sheet).expect("an annulus");
        assert_eq!(&grown.positions[..81], &mesh.positions[..]);
        assert!(grown.faces.iter().take(64).eq(mesh.faces.iter()));
        let (rows, rest) = ((grown.faces.len() - 64) / 32, (grown.faces.len() - 64) % 32);
        assert!(rows >= 3 && rest == 0, "{rows} {rest}");
        let mut halfedges = BTreeMap::new();
        for face in grown.faces.iter() {
            (0..4).for_each(|k| *halfedges.entry((face[k], face[(k + 1) % 4])).or_insert(0) += 1);
        }
        assert!(halfedges.values().all(|count| *count == 1), "faces beside each other turn alike");
        let open: Vec<_> = halfedges.keys().filter(|(a, b)| !halfedges.contains_key(&(*b, *a))).collect();
        assert_eq!(open.len(), 32);
        let end = |v: u32| {
            let p = grown.positions[v as usize];
            p.x.min(1.0 - p.x).min(p.y).min(1.0 - p.y)
        };
        assert!(open.iter().all(|(a, _)| end(*a) < 1e-6), "the last row lies where the sheet ends");
    }

    #[test]
    fn a_cage_with_an_opening_is_continued_from_the_rim_beside_the_rest() {
        let (mut mesh, sheet) = (cage(8), grid(40, 40, false, false));
        let surface = prepare(&mesh).expect("quads").mesh;
        let field = within(&surface, &surface.positions, &sheet).expect("a rim");
        let rest = segment_above(&sheet, &field).expect("a cut").parts.swap_remove(1);
        let mut faces = Polygons::default();
        mesh.faces.iter().enumerate().filter(|(f, _)| ![27, 28].contains(f)).for_each(|(_, face)| faces.push(face));
        mesh.faces = faces;
        let grown = continued(&mesh, &rest, &sheet).expect("an annulus");
        assert_eq!((grown.faces.len() - 62) % 32, 0);
        let mut loops: Vec<usize> = Net::from_mesh(&grown).loops().expect("loops").iter().map(Vec::len).collect();
        loops.sort_unstable();
        assert_eq!(loops, [6, 32], "the opening stays");
    }

    #[test]
    fn a_row_runs_along_the_edge_of_a_flat_end() {
        // A bowl whose wall leans, so that its bottom's edge is nearer to the rim on one side than on the other.
        let mut cup = super::super::flat::tests::bowl(48, |far| 4.0 * (far - 0.5).max(0.0));
        cup.positions.iter_mut().for_each(|p| p.z *= 1.0 + 0.5 * p.x);
        let field: Vec<f64> = cup.positions.iter().map(|p| p.z - 1.5).collect();
        let parts = segment_above(&cup, &field).expect("a cut").parts;
        let rest = parts.last().expect("what lies below");
        assert_eq!(rest.topology, Topology::Disc);
        // The wall's own strip of quads.
        let n = 32;
        let at = |k: u32, up: f64| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(n);
            let on = |far: f64| Vec3::new(far * angle.cos(), far * angle.sin(), 0.0);
            let tall = |far: f64| 4.0 * (far - 0.5) * (1.0 + 0.5 * on(far).x) - up;
            // Where the wall is as high as is wanted.
            let (mut low, mut high) = (0.5, 1.5);
            (0..60).for_each(|_| {
                let middle = 0.5 * (low + high);
                if tall(middle) < 0.0 { low = middle } else { high = middle }
            });
            on(low) + Vec3::new(0.0, 0.0, up)
        };
        let positions = [1.5, 1.8].iter().flat_map(|&up| (0..n).map(move |k| at(k, up))).collect();
        let mut faces = Polygons::default();
        (0..n).for_each(|k| faces.push(&[k, (k + 1) % n, n + (k + 1) % n, n + k]));
        // The upper rim is closed by one face.
        faces.push(&(n..2 * n).collect::<Vec<_>>());
        let strip = PolyMesh { positions, faces, ..PolyMesh::default() };
        let grown = continued(&strip, rest, &cup).expect("a disc");
        let crosses = |mesh: &PolyMesh| {
            let rows = mesh.faces.iter().skip(strip.faces.len());
            let is_low = |v: &u32| mesh.positions[*v as usize].z < 1e-6;
            rows.filter(|face| face.iter().any(is_low) && !face.iter().all(is_low))
                .filter(|face| {
                    face.iter().filter(|v| is_low(v)).any(|&v| mesh.positions[v as usize].xy().norm() < 0.46)
                })
                .count()
        };
        assert_eq!(crosses(&grown), 0);
        assert!(crosses(&continued_evenly(&strip, rest).expect("a disc")) > 0, "rows cross the edge else");
    }

    #[test]
    fn u_that_comes_back_a_little_is_made_to_go_on() {
        let run = untwisted(&[0.0, 0.3, 0.29, 0.6, 0.9]);
        assert!(run.is_sorted() && run.last().is_some_and(|last| *last < 1.0), "{run:?}");
        let back = untwisted(&[0.0, 0.7, 0.71, 0.4, 0.1]);
        assert!(back.is_sorted_by(|a, b| a >= b), "{back:?}");
    }
}
