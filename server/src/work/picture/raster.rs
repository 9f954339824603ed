//! The sample buffers, the triangles with their studio light, and the way from samples to pixels.

use super::Picture;
use super::camera::{Paint, Projected};
use super::colour::{Palette, segment_albedo, to_srgb};
use super::surface::Surface;
use nalgebra::Vector3;

/// Samples of a square frame, row after row from the top.
pub(super) struct Frame {
    pub(super) side: usize,
    /// Inverse depth; 0 where nothing was drawn.
    pub(super) depth: Vec<f32>,
    /// Light that leaves the surface, linear.
    pub(super) light: Vec<[f32; 3]>,
    /// Coverage by polygon edges, 0–255.
    pub(super) lines: Vec<u8>,
    /// Coverage by boundary edges, 0–255.
    pub(super) rims: Vec<u8>,
}

impl Frame {
    pub(super) fn new(side: usize) -> Self {
        let n = side * side;
        Self { side, depth: vec![0.0; n], light: vec![[0.0; 3]; n], lines: vec![0; n], rims: vec![0; n] }
    }
}

/// Draws every triangle that covers a sample centre, nearest wins. They are taken from near to far, so that few
/// samples are lit twice.
pub(super) fn triangles(frame: &mut Frame, surface: &Surface, projected: &Projected, palette: &Palette, paint: Paint) {
    let corners = |t: usize| surface.triangles[t].map(|v| projected.points[v as usize]);
    let nearest = |t: usize| corners(t).iter().map(|p| p.z).fold(0.0, f32::max);
    let mut order: Vec<(f32, usize)> = (0..surface.triangles.len()).map(|t| (nearest(t), t)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (_, t) in order {
        let turned = surface.normals[t].map(|n| projected.rotation * n);
        let clay = match (paint, surface.segments.get(t)) {
            (Paint::Segments, Some(label)) => segment_albedo(*label),
            (Paint::Segment(one), Some(label)) if *label != one => palette.aside,
            _ => palette.clay,
        };
        triangle(frame, &corners(t), &turned, &Palette { clay, ..*palette });
    }
}

fn triangle(frame: &mut Frame, corners: &[Vector3<f32>; 3], normals: &[Vector3<f32>; 3], palette: &Palette) {
    let [a, b, c] = *corners;
    let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if area.abs() < 1e-9 {
        return;
    }
    let last = frame.side as f32 - 1.0;
    let low = |x: f32, y: f32, z: f32| (x.min(y).min(z) - 0.5).ceil().clamp(0.0, last) as usize;
    let high = |x: f32, y: f32, z: f32| (x.max(y).max(z) - 0.5).floor().clamp(0.0, last) as usize;
    let (x0, x1, y0, y1) = (low(a.x, b.x, c.x), high(a.x, b.x, c.x), low(a.y, b.y, c.y), high(a.y, b.y, c.y));
    // y runs down, so a front face turns clockwise: its area is negative.
    let (sense, albedo) = if area < 0.0 { (1.0, palette.clay) } else { (-1.0, palette.inside) };
    let inverse = 1.0 / area;
    for y in y0..=y1 {
        let py = y as f32 + 0.5;
        for x in x0..=x1 {
            let px = x as f32 + 0.5;
            let wa = ((b.x - px) * (c.y - py) - (b.y - py) * (c.x - px)) * inverse;
            let wb = ((c.x - px) * (a.y - py) - (c.y - py) * (a.x - px)) * inverse;
            let wc = 1.0 - wa - wb;
            if wa < 0.0 || wb < 0.0 || wc < 0.0 {
                continue;
            }
            let depth = wa * a.z + wb * b.z + wc * c.z;
            let at = y * frame.side + x;
            if depth > frame.depth[at] {
                frame.depth[at] = depth;
                let normal = normals[0] * wa + normals[1] * wb + normals[2] * wc;
                frame.light[at] = shade(normal * sense, albedo);
            }
        }
    }
}

/// Key light from the upper left, a cool fill from the right, a rim from behind, and a soft sky.
fn shade(normal: Vector3<f32>, albedo: [f32; 3]) -> [f32; 3] {
    let n = normal / normal.norm().max(1e-12);
    let wrap = |light: [f32; 3], soft: f32| {
        ((n.x * light[0] + n.y * light[1] + n.z * light[2] + soft) / (1.0 + soft)).max(0.0)
    };
    let key = wrap([-0.470, 0.620, 0.628], 0.12);
    let fill = wrap([0.823, 0.103, 0.558], 0.35);
    let sky = 0.5 + 0.5 * n.y;
    let edge = 1.0 - n.z.clamp(0.0, 1.0);
    let rim = edge * edge * edge * (0.35 + 0.65 * wrap([0.55, 0.80, -0.24], 0.2));
    // Blinn's half vector between key light and eye.
    let half = (n.x * -0.260 + n.y * 0.344 + n.z * 0.902).max(0.0);
    let gloss = half.powi(28) * 0.10;
    let tint = |k: usize| {
        let lights = key * [0.98, 0.93, 0.86][k] + fill * [0.20, 0.24, 0.31][k] + sky * [0.16, 0.18, 0.21][k] + 0.05;
        albedo[k] * lights + rim * [0.22, 0.23, 0.25][k] + gloss
    };
    [tint(0), tint(1), tint(2)]
}

/// Averages the samples of each pixel over the background, darkened where the surface is hollow.
pub(super) fn resolve(frame: &Frame, palette: &Palette, samples: usize) -> Picture {
    let side = frame.side / samples;
    let hollow = hollows(frame, side, samples);
    let curve: Vec<u8> = (0..=4096u16).map(|k| to_srgb(f32::from(k) / 4096.0)).collect();
    let mut pixels = Vec::with_capacity(3 * side * side);
    for y in 0..side {
        for x in 0..side {
            let sum = pixel_light(frame, palette, samples, (x, y), hollow[y * side + x]);
            let mean = sum.map(|s| s / (samples * samples) as f32);
            pixels.extend(mean.map(|m| curve[(4096.0 * m.clamp(0.0, 1.0)) as usize]));
        }
    }
    Picture { width: side as u32, height: side as u32, pixels }
}

fn pixel_light(frame: &Frame, palette: &Palette, samples: usize, (x, y): (usize, usize), hollow: f32) -> [f32; 3] {
    let mut sum = [0.0f32; 3];
    for k in 0..samples * samples {
        let (sx, sy) = (x * samples + k % samples, y * samples + k / samples);
        let at = sy * frame.side + sx;
        let mut colour = if frame.depth[at] > 0.0 {
            frame.light[at].map(|c| c * hollow)
        } else {
            background(palette, sx as f32 / frame.side as f32, sy as f32 / frame.side as f32)
        };
        let line = f32::from(frame.lines[at]) / 255.0 * palette.line_opacity;
        let rim = f32::from(frame.rims[at]) / 255.0;
        for c in 0..3 {
            colour[c] += (palette.line[c] - colour[c]) * line;
            colour[c] += (palette.rim[c] - colour[c]) * rim;
            sum[c] += colour[c];
        }
    }
    sum
}

fn background(palette: &Palette, x: f32, y: f32) -> [f32; 3] {
    let glow = 1.0 - 0.5 * ((x - 0.5) * (x - 0.5) + (y - 0.42) * (y - 0.42));
    let t = y * y * (3.0 - 2.0 * y);
    std::array::from_fn(|k| (palette.sky[k] * (1.0 - t) + palette.floor[k] * t) * glow)
}

/// A factor around 1 a pixel: below 1 where opposite neighbours stand nearer to the eye (a hollow), above on ridges.
fn hollows(frame: &Frame, side: usize, samples: usize) -> Vec<f32> {
    const DIRECTIONS: [(f32, f32); 6] = [(1.0, 0.0), (0.87, 0.5), (0.5, 0.87), (0.0, 1.0), (-0.5, 0.87), (-0.87, 0.5)];
    let away = |x: usize, y: usize| {
        let inverse = frame.depth[(y * samples) * frame.side + x * samples];
        if inverse > 0.0 { 1.0 / inverse } else { f32::INFINITY }
    };
    let distance: Vec<f32> = (0..side * side).map(|k| away(k % side, k / side)).collect();
    // Steps in pixels, and about how far each is in space: the unit ball fills the picture.
    let steps: Vec<(isize, isize, f32)> = [0.010, 0.028]
        .into_iter()
        .flat_map(|part: f32| {
            let radius = (part * side as f32).max(1.0);
            let whole = |d: f32| (d * radius).round() as isize;
            DIRECTIONS.map(|(dx, dy)| (whole(dx), whole(dy), 0.5 * side as f32 / radius))
        })
        .collect();
    let at = |x: isize, y: isize| {
        let inside = (0..side as isize).contains(&x) && (0..side as isize).contains(&y);
        if inside { distance[y as usize * side + x as usize] } else { f32::INFINITY }
    };
    let mut factors = vec![1.0f32; side * side];
    for (k, factor) in factors.iter_mut().enumerate() {
        let here = distance[k];
        if !here.is_finite() {
            continue;
        }
        let (x, y) = ((k % side) as isize, (k / side) as isize);
        let mut dark = 0.0;
        for &(dx, dy, per_reach) in &steps {
            let nearer = |x: isize, y: isize| ((here - at(x, y)) * per_reach).clamp(-1.5, 1.5);
            let bend = nearer(x + dx, y + dy) + nearer(x - dx, y - dy);
            dark += (0.5 * bend).clamp(-0.35, 1.0);
        }
        *factor = (1.0 - 0.55 * dark / steps.len() as f32).clamp(0.45, 1.12);
    }
    factors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nearer_triangle_hides_a_farther_one_whatever_the_order() {
        let corners = |z: f32| [Vector3::new(0.0, 0.0, z), Vector3::new(0.0, 8.0, z), Vector3::new(8.0, 0.0, z)];
        let normals = [Vector3::z(); 3];
        let (near, far) = (corners(0.9), corners(0.2));
        let palette = Palette::light();
        let mut light = Vec::new();
        for order in [[&near, &far], [&far, &near]] {
            let mut frame = Frame::new(8);
            order.iter().for_each(|t| triangle(&mut frame, t, &normals, &palette));
            assert!((frame.depth[8 + 1] - 0.9).abs() < 1e-6);
            assert_eq!(frame.depth[7 * 8 + 7], 0.0);
            light.push(frame.light);
        }
        assert_eq!(light[0], light[1]);
    }

    #[test]
    fn light_is_finite_for_a_zero_normal() {
        assert!(shade(Vector3::zeros(), [0.5; 3]).iter().all(|c| c.is_finite()));
    }
}
