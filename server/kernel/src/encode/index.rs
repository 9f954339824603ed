//! The planar index φ⁻¹: which triangle of the chart holds a point of the domain.
//!
//! A uniform grid of buckets over the square, periodic in u (tori: and in v). *Source:* paper §4 (a binary space partition; a grid is
//! faster, CRATES §3.3).

use crate::mesh::Vec3;
use crate::mesh::bvh::Closest;
use crate::mesh::tri::{NONE, next};
use crate::numerics::stop;
use crate::unfold::{Chart, Uv};

/// A place on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// Triangle of the chart's mesh.
    pub triangle: u32,
    /// Barycentric coordinates in it; they sum to 1.
    pub barycentric: [f64; 3],
}

impl From<Closest> for Location {
    fn from(near: Closest) -> Self {
        Self { triangle: near.triangle, barycentric: near.barycentric }
    }
}

impl Location {
    /// The place at a share of halfedge `h`, 0 at its tail and 1 at its head.
    pub fn on_edge(h: u32, share: f64) -> Self {
        let mut barycentric = [0.0; 3];
        (barycentric[h as usize % 3], barycentric[next(h) as usize % 3]) = (1.0 - share, share);
        Self { triangle: h / 3, barycentric }
    }

    /// The point in space.
    pub fn point(&self, chart: &Chart) -> Vec3 {
        let corners = chart.mesh.triangles[self.triangle as usize];
        (0..3).map(|k| self.barycentric[k] * chart.mesh.positions[corners[k] as usize]).sum()
    }

    /// The point of the domain; inverse of [`PlanarIndex::locate`].
    pub fn uv(&self, chart: &Chart) -> Uv {
        let corners = &chart.corners[self.triangle as usize];
        let w = self.barycentric;
        match pole_corner(chart, self.triangle) {
            Some((k, end)) => {
                let (a, b) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
                let (wa, wb) = (w[(k + 1) % 3], w[(k + 2) % 3]);
                let x = if wa + wb > 0.0 { wb / (wa + wb) } else { 0.5 };
                let base = a[1] + x * (b[1] - a[1]);
                // Area, not distance, is even in v near a pole.
                let y = 1.0 - (1.0 - w[k]) * (1.0 - w[k]);
                [(a[0] + x * (b[0] - a[0])).rem_euclid(1.0), base + y * (end - base)]
            }
            None => {
                let mean = |j: usize| (0..3).map(|k| w[k] * corners[k][j]).sum::<f64>();
                [mean(0).rem_euclid(1.0), inside_v(chart, mean(1))]
            }
        }
    }
}

/// v as the chart's topology has it: wrapped on tori, else as it is.
fn inside_v(chart: &Chart, v: f64) -> f64 {
    if chart.topology.is_periodic_v() { v.rem_euclid(1.0) } else { v }
}

/// The corner of a triangle that is a pole, and the pole's v.
pub fn pole_corner(chart: &Chart, triangle: u32) -> Option<(usize, f64)> {
    let corners = chart.mesh.triangles[triangle as usize];
    (0..3).find_map(|k| {
        chart.poles.iter().find(|p| p.vertex == corners[k]).map(|p| (k, if p.at_top { 1.0 } else { 0.0 }))
    })
}

/// Buckets of triangles over the domain.
#[derive(Clone, Debug)]
pub struct PlanarIndex {
    cells: usize,
    starts: Vec<u32>,
    /// The triangles of each cell, those at a pole with the bit [`POLAR`].
    triangles: Vec<u32>,
    /// Halfedges on the surface's boundary.
    rim: Vec<u32>,
}

/// A triangle at a pole has this bit.
const POLAR: u32 = 1 << 31;
/// A point is in a triangle whose barycentric coordinates there are no less than this.
const INSIDE: f64 = -1e-9;
/// How far beyond a triangle's box a point of it may lie by that, in the domain's units.
const BESIDE: f64 = 1e-8;

/// A point so near to the end of v is on the boundary.
const RIM: f64 = 1e-12;

/// Grid cells a side at most.
const CELLS_MAX: usize = 512;
/// The grid is made coarser while its cells have more than so many triangles for each that there is: the needles of a fan cross
/// every row of cells.
const CROSSED_MAX: usize = 64;
/// Cells a side at least.
const CELLS_MIN: usize = 4;

impl PlanarIndex {
    /// Indexes a chart.
    pub fn new(chart: &Chart) -> Self {
        let count = chart.corners.len();
        let mut cells = ((count as f64).sqrt() as usize).clamp(CELLS_MIN, CELLS_MAX);
        let mut starts = Self::counted(chart, cells);
        while cells > CELLS_MIN && starts.iter().map(|&n| n as usize).sum::<usize>() > CROSSED_MAX * count {
            cells = (cells / 2).max(CELLS_MIN);
            starts = Self::counted(chart, cells);
        }
        for c in 0..cells * cells {
            starts[c + 1] += starts[c];
        }
        let mut filled = starts.clone();
        let mut triangles = vec![0; starts[cells * cells] as usize];
        for t in 0..count as u32 {
            stop::pass(1);
            let entry = if pole_corner(chart, t).is_some() { t | POLAR } else { t };
            for_each_cell(chart, t, cells, |c| {
                triangles[filled[c] as usize] = entry;
                filled[c] += 1;
            });
        }
        let rim = (0..chart.mesh.twins.len() as u32).filter(|&h| chart.mesh.twin(h) == NONE).collect();
        Self { cells, starts, triangles, rim }
    }

    /// How many triangles each cell has, behind a zero.
    fn counted(chart: &Chart, cells: usize) -> Vec<u32> {
        let mut counts = vec![0u32; cells * cells + 1];
        for t in 0..chart.corners.len() as u32 {
            stop::pass(1);
            for_each_cell(chart, t, cells, |c| counts[c + 1] += 1);
        }
        counts
    }

    /// The place of the surface at `uv`; the nearest in its neighbourhood where rounding leaves a crack.
    pub fn locate(&self, chart: &Chart, uv: Uv) -> Location {
        let torus = chart.topology.is_periodic_v();
        let (u, v) = (uv[0].rem_euclid(1.0), if torus { uv[1].rem_euclid(1.0) } else { uv[1].clamp(0.0, 1.0) });
        if let Some(location) = self.on_rim(chart, u, v) {
            return location;
        }
        let cell = |x: f64| ((x * self.cells as f64) as isize).min(self.cells as isize - 1);
        let (cx, cy) = (cell(u), cell(v));
        let mut best: Option<(f64, Location)> = None;
        // Most triangles of a cell can be told by their boxes not to hold the point.
        for &entry in self.at(cy as usize * self.cells + cx as usize) {
            let t = entry & !POLAR;
            if !may_hold(chart, entry, [u, v]) {
                continue;
            }
            let (inside, location) = locate_in(chart, t, [u, v]);
            if best.as_ref().is_none_or(|(b, _)| inside > *b) {
                best = Some((inside, location));
            }
        }
        if let Some((inside, location)) = best.take()
            && inside >= INSIDE
        {
            return clamped(location);
        }
        for radius in 0..self.cells as isize {
            for (x, y) in ring(cx, cy, radius) {
                if !torus && (y < 0 || y >= self.cells as isize) {
                    continue;
                }
                let c = y.rem_euclid(self.cells as isize) as usize * self.cells
                    + x.rem_euclid(self.cells as isize) as usize;
                for &entry in self.at(c) {
                    let (inside, location) = locate_in(chart, entry & !POLAR, [u, v]);
                    if best.as_ref().is_none_or(|(b, _)| inside > *b) {
                        best = Some((inside, location));
                    }
                }
            }
            if best.as_ref().is_some_and(|(inside, _)| *inside >= INSIDE || radius > 0) {
                break;
            }
        }
        best.map_or(Location { triangle: 0, barycentric: [1.0, 0.0, 0.0] }, |(_, location)| clamped(location))
    }
}

impl PlanarIndex {
    /// The triangles of a cell.
    fn at(&self, cell: usize) -> &[u32] {
        &self.triangles[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    /// The place on the boundary, for points at an end of v where there is one. On noisy scans triangles overlap in the
    /// domain, and only the boundary's own edges are sure to lie on the boundary.
    fn on_rim(&self, chart: &Chart, u: f64, v: f64) -> Option<Location> {
        if self.rim.is_empty() || (v > RIM && v < 1.0 - RIM) {
            return None;
        }
        let mut best: Option<(f64, Location)> = None;
        for &h in &self.rim {
            let (t, k) = (h / 3, h as usize % 3);
            let (a, b) = (chart.corners[t as usize][k], chart.corners[t as usize][(k + 1) % 3]);
            if (a[1] - v).abs() > 0.5 || a[0] == b[0] {
                continue;
            }
            // u is taken in the period that fits the edge's middle.
            let x = u + (0.5 * (a[0] + b[0]) - u).round();
            let along = (x - a[0]) / (b[0] - a[0]);
            let inside = along.min(1.0 - along) * (b[0] - a[0]).abs();
            if best.as_ref().is_none_or(|(most, _)| inside.min(0.0) > *most) {
                let mut barycentric = [0.0; 3];
                let along = along.clamp(0.0, 1.0);
                (barycentric[k], barycentric[(k + 1) % 3]) = (1.0 - along, along);
                best = Some((inside.min(0.0), Location { triangle: t, barycentric }));
            }
            if inside >= 0.0 {
                break;
            }
        }
        best.map(|(_, location)| location)
    }
}

/// Tells whether the box of a triangle holds a point, in some period; of one at a pole, whether what is between the sides that meet
/// there does.
fn may_hold(chart: &Chart, entry: u32, uv: Uv) -> bool {
    let triangle = entry & !POLAR;
    let [a, b, c] = &chart.corners[triangle as usize];
    let holds = |corners: [&Uv; 3], k: usize, is_periodic: bool| {
        let [x, y, z] = corners.map(|corner| corner[k]);
        let (low, high) = (x.min(y).min(z), x.max(y).max(z));
        let beyond = uv[k] - (low - BESIDE);
        let beyond = if is_periodic { beyond - beyond.floor() } else { beyond };
        (0.0..=high - low + 2.0 * BESIDE).contains(&beyond)
    };
    let pole = if entry & POLAR == 0 { None } else { pole_corner(chart, triangle) };
    match pole {
        Some((0, _)) => holds([b, b, c], 0, true),
        Some((1, _)) => holds([a, a, c], 0, true),
        Some(_) => holds([a, a, b], 0, true),
        None => holds([a, b, c], 1, chart.topology.is_periodic_v()) && holds([a, b, c], 0, true),
    }
}

/// Barycentric coordinates made non-negative.
fn clamped(mut location: Location) -> Location {
    let w = location.barycentric.map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 });
    let sum: f64 = w.iter().sum();
    location.barycentric = if sum > 0.0 { w.map(|x| x / sum) } else { [1.0 / 3.0; 3] };
    location
}

/// Cells at Chebyshev distance `radius`.
fn ring(cx: isize, cy: isize, radius: isize) -> impl Iterator<Item = (isize, isize)> {
    (-radius..=radius).flat_map(move |dy| {
        (-radius..=radius).filter(move |dx| dx.abs().max(dy.abs()) == radius).map(move |dx| (cx + dx, cy + dy))
    })
}

/// Calls `visit` with each cell that the triangle's box touches.
fn for_each_cell(chart: &Chart, t: u32, cells: usize, mut visit: impl FnMut(usize)) {
    let c = &chart.corners[t as usize];
    let (mut low, mut high) = ([c[0][0], c[0][1]], [c[0][0], c[0][1]]);
    for p in &c[1..] {
        for k in 0..2 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    if let Some((_, end)) = pole_corner(chart, t) {
        low[1] = low[1].min(end);
        high[1] = high[1].max(end);
    }
    let n = cells as f64;
    let columns = (low[0] * n) as usize..=((high[0] * n) as usize).min((low[0] * n) as usize + cells - 1);
    let (bottom, top) = ((low[1] * n) as usize, (high[1] * n) as usize);
    let rows = if chart.topology.is_periodic_v() {
        bottom..=top.min(bottom + cells - 1)
    } else {
        bottom.min(cells - 1)..=top.min(cells - 1)
    };
    for y in rows {
        for x in columns.clone() {
            visit(y % cells * cells + x % cells);
        }
    }
}

/// The smallest barycentric coordinate (≥ 0 inside) and the place, u (tori: and v) taken in the period that fits best.
fn locate_in(chart: &Chart, t: u32, uv: Uv) -> (f64, Location) {
    let c = &chart.corners[t as usize];
    let pole = pole_corner(chart, t);
    let mut best = (f64::NEG_INFINITY, Location { triangle: t, barycentric: [1.0 / 3.0; 3] });
    let high = |k: usize| c[0][k].max(c[1][k]).max(c[2][k]);
    let rows = if chart.topology.is_periodic_v() { (high(1) + 0.5 - uv[1]).max(0.0) as usize } else { 0 };
    for row in 0..=rows {
        let v = uv[1] + row as f64;
        let mut u = uv[0];
        while u <= high(0) + 0.5 {
            let barycentric = match pole {
                Some((k, end)) => in_pole_quad(c, k, end, [u, v]),
                None => in_triangle(c, [u, v]),
            };
            let inside = barycentric.iter().copied().fold(f64::INFINITY, f64::min);
            if inside > best.0 {
                best = (inside, Location { triangle: t, barycentric });
            }
            u += 1.0;
        }
    }
    best
}

fn in_triangle(c: &[Uv; 3], p: Uv) -> [f64; 3] {
    let cross = |a: Uv, b: Uv, q: Uv| (b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0]);
    let area = cross(c[0], c[1], c[2]);
    if area == 0.0 {
        return [f64::NEG_INFINITY; 3];
    }
    let (w0, w1) = (cross(c[1], c[2], p) / area, cross(c[2], c[0], p) / area);
    [w0, w1, 1.0 - w0 - w1]
}

fn in_pole_quad(c: &[Uv; 3], k: usize, end: f64, p: Uv) -> [f64; 3] {
    let (a, b) = (c[(k + 1) % 3], c[(k + 2) % 3]);
    let width = b[0] - a[0];
    if width == 0.0 {
        return [f64::NEG_INFINITY; 3];
    }
    let x = (p[0] - a[0]) / width;
    let base = a[1] + x * (b[1] - a[1]);
    let y = if end == base { 1.0 } else { ((p[1] - base) / (end - base)).min(1.0) };
    // Area, not distance, is even in v near a pole.
    let pole = if y >= 0.0 { 1.0 - (1.0 - y).sqrt() } else { y };
    let mut w = [0.0; 3];
    w[k] = pole;
    w[(k + 1) % 3] = (1.0 - x) * (1.0 - pole);
    w[(k + 2) % 3] = x * (1.0 - pole);
    w
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tri::TriMesh;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};
    use std::f64::consts::TAU;

    #[test]
    fn locating_undoes_unfolding() {
        for (wrap_u, wrap_v) in [(false, false), (true, false), (true, true)] {
            let patch = whole(&grid(20, 17, wrap_u, wrap_v)).expect("a primitive");
            let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
            let index = PlanarIndex::new(&chart);
            for t in (0..chart.corners.len() as u32).step_by(7) {
                let place = Location { triangle: t, barycentric: [0.2, 0.5, 0.3] };
                let found = index.locate(&chart, place.uv(&chart));
                let error = (found.point(&chart) - place.point(&chart)).norm();
                assert!(error < 1e-9, "triangle {t}: {error}");
            }
        }
    }

    #[test]
    fn the_grid_of_a_fan_of_needles_is_coarser_and_finds_them() {
        let n = 12_000u32;
        let mut positions = vec![Vec3::zeros()];
        let angles = (0..n).map(|i| TAU * f64::from(i) / f64::from(n));
        positions.extend(angles.map(|a| Vec3::new(a.cos(), a.sin(), 0.1 * (9.0 * a).sin())));
        let triangles = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
        let fan = TriMesh::from_triangles(positions, triangles).expect("a fan");
        let hub = UnfoldOptions { poles: vec![0] };
        let chart = unfold(&whole(&fan).expect("a disc"), &hub).expect("solvable");
        let most = CROSSED_MAX * chart.corners.len();
        let fine = (chart.corners.len() as f64).sqrt() as usize;
        let crossed: u32 = PlanarIndex::counted(&chart, fine).iter().sum();
        assert!(crossed as usize > most, "the needles cross every row: {crossed} of {most}");
        let index = PlanarIndex::new(&chart);
        assert!(index.triangles.len() <= most && index.cells < fine, "{} of {most}", index.triangles.len());
        for t in (0..n).step_by(97) {
            let place = Location { triangle: t, barycentric: [0.3, 0.4, 0.3] };
            let found = index.locate(&chart, place.uv(&chart));
            assert!((found.point(&chart) - place.point(&chart)).norm() < 1e-9, "needle {t}");
        }
    }
}
