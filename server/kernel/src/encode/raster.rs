//! λ by exact triangle–pixel clipping.
//!
//! Each triangle of the domain spreads its share of the surface's area evenly over the pixels it covers. Coverage is
//! accumulated from the triangle's edges as signed areas and integrated along each row once for all triangles, so a
//! triangle costs what its outline costs; the picture's mean is 1 up to rounding. *Source:* METHOD §3.

use std::cell::Cell;

use super::Picture;
use crate::numerics::stop;
use crate::topology::Topology;
use crate::unfold::{Chart, Uv};

/// Periods of u that the accumulation buffer spans; corners start in the first.
const PERIODS: usize = 3;
/// Below this area (in pixels) a triangle is a point for the picture.
const POINT_AREA_PX: f64 = 1e-7;

/// Where a triangle of the surface lies in the domain.
#[derive(Clone, Copy, Debug)]
pub enum Footprint {
    /// Its corners.
    Triangle([Uv; 3]),
    /// With a pole as a corner it is the quad between its opposite edge and the pole's line.
    Pole([Uv; 4]),
}

/// A shape takes as long as so many elements of other passes, about.
const SHAPE_ELEMENTS: usize = 16;

/// The conformal factor of a chart at `side` × `side` pixels.
pub fn conformal_factor(chart: &Chart, side: usize) -> Picture {
    picture(chart.topology, side, shapes(chart))
}

/// Where each triangle of a chart lies in the domain, and its share of the surface's area.
pub fn shapes(chart: &Chart) -> impl Iterator<Item = (Footprint, f64)> + '_ {
    let areas: Vec<f64> = (0..chart.mesh.triangles.len()).map(|t| chart.mesh.area(t)).collect();
    let total: f64 = areas.iter().sum();
    let shapes = chart.mesh.triangles.iter().zip(&chart.corners).map(|(triangle, c)| {
        let pole = (0..3).find_map(|k| {
            chart.poles.iter().find(|p| p.vertex == triangle[k]).map(|p| (k, if p.at_top { 1.0 } else { 0.0 }))
        });
        match pole {
            Some((k, end)) => {
                let (a, b) = (c[(k + 1) % 3], c[(k + 2) % 3]);
                Footprint::Pole([a, b, [b[0], end], [a[0], end]])
            }
            None => Footprint::Triangle(*c),
        }
    });
    shapes.zip(areas.into_iter().map(move |area| area / total))
}

/// The picture of shapes that have certain shares of the surface's area, at `side` × `side` pixels.
pub fn picture(topology: Topology, side: usize, shapes: impl Iterator<Item = (Footprint, f64)>) -> Picture {
    let mut canvas = Canvas::new(side, topology);
    let pixels = (side * side) as f64;
    for (shape, share) in shapes {
        stop::pass(SHAPE_ELEMENTS);
        match shape {
            Footprint::Triangle(corners) => canvas.spread(&corners, share * pixels),
            Footprint::Pole(corners) => canvas.spread(&corners, share * pixels),
        }
    }
    canvas.finish()
}

thread_local! {
    /// Keeps the memory of a thread's last canvas: megabytes of fresh memory cost more in page faults than what is drawn there.
    static SPARE: Cell<[Vec<f64>; 2]> = const { Cell::new([Vec::new(), Vec::new()]) };
}

/// Signed coverage differences, one row a pixel row.
struct Canvas {
    side: usize,
    width: usize,
    /// Highest v a corner may have, and the rows below it: above 1 tori begin anew.
    v_max: f64,
    height: usize,
    differences: Vec<f64>,
    points: Vec<f64>,
}

impl Canvas {
    fn new(side: usize, topology: Topology) -> Self {
        let width = PERIODS * side + 2;
        let periods = if topology.is_periodic_v() { PERIODS } else { 1 };
        let (v_max, height) = (periods as f64, periods * side);
        let [mut differences, mut points] = SPARE.take();
        for (values, count) in [(&mut differences, side * width), (&mut points, side * side)] {
            values.clear();
            values.resize(count, 0.0);
        }
        Self { side, width, v_max, height, differences, points }
    }

    /// Spreads `share` (in pixels) over a convex polygon of the domain. What lies in one pixel is all that pixel's.
    fn spread<const N: usize>(&mut self, polygon: &[Uv; N], share: f64) {
        let scale = self.side as f64;
        let (last_x, last_y) = ((PERIODS * self.side) as f64, self.v_max * scale);
        let px = polygon.map(|p| [(p[0] * scale).clamp(0.0, last_x), (p[1] * scale).clamp(0.0, last_y)]);
        let cell = px.map(|p| [p[0] as usize, p[1] as usize]);
        if cell.iter().all(|other| *other == cell[0]) && cell[0][1] < self.height {
            self.points[cell[0][1] % self.side * self.side + cell[0][0] % self.side] += share;
            return;
        }
        let cross = |k: usize| {
            let (p, q, r) = (px[0], px[k], px[k + 1]);
            (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        };
        let area = 0.5 * (1..N - 1).map(cross).sum::<f64>();
        if area.abs() < POINT_AREA_PX {
            self.point(polygon, share);
            return;
        }
        let density = share / area;
        for k in 0..N {
            self.edge(px[k], px[(k + 1) % N], density);
        }
    }

    /// All of `share` into the pixel that holds the polygon's centre.
    fn point(&mut self, polygon: &[Uv], share: f64) {
        let mean = |k: usize| polygon.iter().map(|p| p[k]).sum::<f64>() / polygon.len() as f64;
        let cell = |x: f64| ((x * self.side as f64) as usize).min(self.side - 1);
        let at = cell(if self.v_max > 1.0 { mean(1).rem_euclid(1.0) } else { mean(1) }) * self.side
            + cell(mean(0).rem_euclid(1.0));
        self.points[at] += share;
    }

    /// Adds `density` × the area between an edge and the right end of each row it crosses; counter-clockwise outlines
    /// add up to + their area.
    fn edge(&mut self, from: [f64; 2], to: [f64; 2], density: f64) {
        if from[1] == to[1] {
            return;
        }
        // An edge that goes up has the inside on its left: it takes away what lies to its right.
        let (sign, low, high) = if from[1] < to[1] { (-density, from, to) } else { (density, to, from) };
        let slope = (high[0] - low[0]) / (high[1] - low[1]);
        let rows = low[1] as usize..(high[1].ceil() as usize).min(self.height);
        let mut x = low[0];
        for row in rows {
            let top = ((row + 1) as f64).min(high[1]);
            let dy = top - (row as f64).max(low[1]);
            let x_next = if top == high[1] { high[0] } else { low[0] + slope * (top - low[1]) };
            let at = row % self.side * self.width;
            let line = &mut self.differences[at..at + self.width];
            strip(line, x, x_next, sign * dy);
            x = x_next;
        }
    }

    /// Integrates the rows and folds the periods.
    fn finish(self) -> Picture {
        let side = self.side;
        let mut values = self.points;
        for (row, line) in self.differences.chunks_exact(self.width).enumerate() {
            let mut sum = 0.0;
            for (x, d) in line.iter().take(PERIODS * side).enumerate() {
                sum += d;
                values[row * side + x % side] += sum;
            }
        }
        let picture = Picture { side, values: values.iter().map(|x| x.max(0.0) as f32).collect() };
        SPARE.set([self.differences, values]);
        picture
    }
}

/// A strip of height `dy` (signed, times density) bounded on its left by a line from `x0` to `x1`: differences whose
/// running sum is the covered area of each pixel.
fn strip(line: &mut [f64], x0: f64, x1: f64, dy: f64) {
    let (left, right) = if x0 < x1 { (x0, x1) } else { (x1, x0) };
    let (first, last) = (left as usize, right as usize);
    if first == last {
        let inside = 0.5 * (left + right) - first as f64;
        line[first] += dy * (1.0 - inside);
        line[first + 1] += dy * inside;
        return;
    }
    let per_x = dy / (right - left);
    // Area right of the line within each pixel, as it grows from 0 to dy.
    let mut covered_before = 0.0;
    for x in first..=last {
        let (a, b) = (left.max(x as f64), right.min((x + 1) as f64));
        let height_a = (a - left) * per_x;
        let height_b = (b - left) * per_x;
        let covered = 0.5 * (height_a + height_b) * (b - a) + height_b * ((x + 1) as f64 - b);
        line[x] += covered - covered_before;
        covered_before = covered;
    }
    line[last + 1] += dy - covered_before;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_covers_each_pixel_by_its_exact_share() {
        let mut canvas = Canvas::new(4, Topology::Annulus);
        // Right triangle with legs 2 px from pixel (1, 1), area 2 px.
        canvas.spread(&[[0.25, 0.25], [0.75, 0.25], [0.25, 0.75]], 2.0);
        let picture = canvas.finish();
        let expected = [(1, 1, 1.0), (2, 1, 0.5), (1, 2, 0.5), (2, 2, 0.0), (0, 1, 0.0), (3, 1, 0.0)];
        for (x, y, value) in expected {
            assert!((picture.values[y * 4 + x] - value).abs() < 1e-7, "pixel {x}, {y}: {}", picture.values[y * 4 + x]);
        }
    }

    #[test]
    fn a_triangle_across_the_seam_comes_in_on_the_other_side() {
        let mut canvas = Canvas::new(4, Topology::Annulus);
        canvas.spread(&[[0.75, 0.0], [1.25, 0.0], [1.25, 0.25], [0.75, 0.25]], 2.0);
        let picture = canvas.finish();
        assert!((picture.values[3] - 1.0).abs() < 1e-7 && (picture.values[0] - 1.0).abs() < 1e-7);
        assert!(picture.values[1].abs() < 1e-7 && picture.values[4].abs() < 1e-7);
    }

    #[test]
    fn on_a_torus_a_triangle_above_the_top_comes_in_at_the_bottom() {
        let mut canvas = Canvas::new(4, Topology::Torus);
        canvas.spread(&[[0.0, 0.75], [0.25, 0.75], [0.25, 1.25], [0.0, 1.25]], 2.0);
        let picture = canvas.finish();
        assert!((picture.values[12] - 1.0).abs() < 1e-7 && (picture.values[0] - 1.0).abs() < 1e-7);
        assert!(picture.values[4].abs() < 1e-7 && picture.values[8].abs() < 1e-7);
    }

    #[test]
    fn orientation_does_not_matter_and_the_sum_is_kept() {
        let polygon = [[0.13, 0.21], [0.87, 0.33], [0.41, 0.97]];
        let mut canvas = Canvas::new(16, Topology::Annulus);
        canvas.spread(&polygon, 3.0);
        canvas.spread(&[polygon[0], polygon[2], polygon[1]], 3.0);
        let sum: f64 = canvas.finish().values.iter().map(|&x| f64::from(x)).sum();
        assert!((sum - 6.0).abs() < 1e-5);
    }
}
