//! Polygon edges with hidden ones removed, and the discs on extraordinary vertices.

use super::Picture;
use super::camera::Projected;
use super::colour::{Palette, pole_colour};
use super::raster::Frame;
use super::surface::{EdgeKind, Surface};
use nalgebra::Vector3;

/// An edge is hidden when the surface is nearer by more than this part of its depth.
const DEPTH_BIAS: f32 = 0.004;
/// Line width as a part of the mean visible edge, and its bounds in pixels.
const LINE_PART: f32 = 0.075;
const LINE_MIN: f32 = 0.55;
const LINE_MAX: f32 = 1.25;
/// Radius of a disc as a part of the mean visible edge, and its bounds in pixels.
const DISC_PART: f32 = 0.20;
const DISC_MIN: f32 = 1.7;
const DISC_MAX: f32 = 5.0;

/// Draws the polygon edges into the frame's coverage buffers.
pub(super) fn edges(frame: &mut Frame, surface: &Surface, projected: &Projected, samples: usize) {
    let mean = mean_edge(surface, projected) / samples as f32;
    let width = (LINE_PART * mean).clamp(LINE_MIN, LINE_MAX) * samples as f32;
    // Where lines are denser than some pixels they fade, lest the picture turn black.
    let strength = (mean / 5.0).clamp(0.25, 1.0);
    for edge in &surface.edges {
        let [a, b] = edge.vertices.map(|v| projected.points.get(v as usize).copied());
        if let (Some(a), Some(b)) = (a, b) {
            match edge.kind {
                EdgeKind::Interior => line(frame, &a, &b, width, strength, Layer::Lines),
                EdgeKind::Rim => line(frame, &a, &b, 1.6 * width + 0.5 * samples as f32, 1.0, Layer::Rims),
            }
        }
    }
}

#[derive(Clone, Copy)]
enum Layer {
    Lines,
    Rims,
}

/// Walks along the longer axis, one sample a step, and covers the samples across it.
fn line(frame: &mut Frame, a: &Vector3<f32>, b: &Vector3<f32>, width: f32, strength: f32, layer: Layer) {
    let d = b - a;
    let steep = d.y.abs() > d.x.abs();
    let (along, across) = if steep { (1, 0) } else { (0, 1) };
    let (start, end) = if d[along] >= 0.0 { (a, b) } else { (b, a) };
    let run = end[along] - start[along];
    let slant = d.xy().norm() / run.max(1e-6);
    let half = 0.5 * width;
    let first = (start[along] - 0.5).round().max(0.0) as usize;
    let last = (end[along] - 0.5).round().clamp(-1.0, frame.side as f32 - 1.0) as isize;
    for step in first as isize..=last {
        let t = ((step as f32 + 0.5 - start[along]) / run.max(1e-6)).clamp(0.0, 1.0);
        let centre = start[across] + (end[across] - start[across]) * t;
        let depth = start.z + (end.z - start.z) * t;
        if !visible(frame, steep, step as usize, centre, depth) {
            continue;
        }
        let reach = half * slant.min(4.0) + 1.0;
        let low = (centre - reach).floor().max(0.0) as usize;
        let high = (centre + reach).ceil().clamp(0.0, frame.side as f32 - 1.0) as usize;
        for across in low..=high {
            let distance = (across as f32 + 0.5 - centre).abs() / slant;
            let cover = (half + 0.5 - distance).clamp(0.0, 1.0) * strength;
            let at = if steep { step as usize * frame.side + across } else { across * frame.side + step as usize };
            let buffer = match layer {
                Layer::Lines => &mut frame.lines,
                Layer::Rims => &mut frame.rims,
            };
            buffer[at] = buffer[at].max((255.0 * cover) as u8);
        }
    }
}

/// Whether a point of a line shows: the farthest surface among the three samples across it is not clearly nearer.
fn visible(frame: &Frame, steep: bool, step: usize, centre: f32, depth: f32) -> bool {
    let middle = centre.floor();
    let mut farthest = f32::INFINITY;
    for offset in [-1.0, 0.0, 1.0] {
        let across = (middle + offset).clamp(0.0, frame.side as f32 - 1.0) as usize;
        let at = if steep { step * frame.side + across } else { across * frame.side + step };
        farthest = farthest.min(frame.depth[at]);
    }
    depth * (1.0 + DEPTH_BIAS) >= farthest
}

fn mean_edge(surface: &Surface, projected: &Projected) -> f32 {
    let total: f64 = surface
        .edges
        .iter()
        .map(|e| (surface.points[e.vertices[0] as usize] - surface.points[e.vertices[1] as usize]).norm())
        .sum();
    (total / surface.edges.len().max(1) as f64) as f32 * projected.scale
}

/// Draws a disc on each visible extraordinary vertex.
pub(super) fn poles(
    picture: &mut Picture,
    frame: &Frame,
    surface: &Surface,
    projected: &Projected,
    palette: &Palette,
    samples: usize,
) {
    let radius = (DISC_PART * mean_edge(surface, projected) / samples as f32).clamp(DISC_MIN, DISC_MAX);
    let ink = palette.line.map(super::colour::to_srgb);
    for &(v, valence) in &surface.poles {
        let (Some(colour), Some(p)) = (pole_colour(valence), projected.points.get(v as usize)) else { continue };
        if uncovered(frame, p) {
            let (x, y) = (p.x / samples as f32, p.y / samples as f32);
            super::caption::disc(picture, (x, y), radius + 0.7, ink, 0.8);
            super::caption::disc(picture, (x, y), radius, colour, 1.0);
        }
    }
}

fn uncovered(frame: &Frame, p: &Vector3<f32>) -> bool {
    let last = frame.side as f32 - 1.0;
    let mut farthest = f32::INFINITY;
    for k in 0..9 {
        let x = (p.x.floor() + (k % 3) as f32 - 1.0).clamp(0.0, last) as usize;
        let y = (p.y.floor() + (k / 3) as f32 - 1.0).clamp(0.0, last) as usize;
        farthest = farthest.min(frame.depth[y * frame.side + x]);
    }
    p.z * (1.0 + DEPTH_BIAS) >= farthest
}
