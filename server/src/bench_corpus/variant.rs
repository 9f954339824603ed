//! One made-up segment: a real encoding, smoothly warped, with another modulus and noise.
//!
//! λ′(x) = λ(ψ(x))·|det Dψ(x)|·e^ν(x), scaled to mean 1, with ψ(u, v) = (u + s + Σ a_j sin 2π(f_j u + g_j v + φ_j),
//! v + sin πv·Σ b_j sin 2π(f_j u + φ_j)): periodic in u, each boundary onto itself. ν is noise at the
//! nodes of a grid. The modulus is
//! multiplied by a log-normal factor. A surface of like parts in other proportions has such an encoding; no surface is
//! made that has it.

use crate::work::engine::kernel::topology_in;
use crate::work::engine::{PackedEncoding, PackedFeature, SegmentFacts};
use quadmuse_kernel::encode::{LEVEL_SIDES, Picture, features};
use quadmuse_samples::random::Random;
use std::f64::consts::{PI, TAU};

/// Waves of a warp.
const WAVES: usize = 4;
/// Deviation of a wave's height, in periods.
const HEIGHT: f64 = 0.012;
/// Deviation of the logarithm of the modulus.
const MODULUS_SPREAD: f64 = 0.12;
/// Deviation of the logarithm of how it bends.
const BENDING_SPREAD: f64 = 0.06;
/// Deviation of the noise, of the logarithm of λ.
const NOISE: f64 = 0.05;
/// Least factor by which a warp may change areas.
const AREA_MIN: f64 = 0.05;
/// Cells a side of the grid on which a warp is evaluated; between its nodes it is interpolated.
const GRID: usize = 64;

/// A wave of the warp.
struct Wave {
    along: f64,
    across: f64,
    phase: f64,
    height: [f64; 2],
}

/// The encoding of a segment like `source`, warped up to the level of `finest` pixels a side; finer levels stay as they
/// are. The same for the same seed.
pub(super) fn variant(source: &PackedEncoding, finest: u32, seed: u64) -> PackedEncoding {
    let mut random = Random::new(seed);
    let up_to = source.levels.iter().filter(|level| level.0 <= finest).max_by_key(|level| level.0);
    let Some((side, values)) = up_to else { return source.clone() };
    let k = source.facts.k * (MODULUS_SPREAD * random.normal()).exp();
    let mut pyramid = vec![warped(&Picture { side: *side as usize, values: values.clone() }, &mut random)];
    while let Some(last) = pyramid.last().filter(|p| p.side > LEVEL_SIDES[0]) {
        let next = last.halved();
        pyramid.push(next);
    }
    pyramid.reverse();
    let found = features::extract(&pyramid, topology_in(source.facts.topology));
    // Drawn last, so that pictures and moduli of a seed are those they always were.
    let bending = source.facts.bending.map(|b| b * (BENDING_SPREAD * random.normal()).exp() as f32);
    let feature = |f: &features::Feature| PackedFeature { uv: f.uv, lambda: f.lambda, side: f.side as u32 };
    let coarse = pyramid.into_iter().map(|p| (p.side as u32, p.values));
    let fine = source.levels.iter().filter(|level| level.0 > finest).cloned();
    PackedEncoding {
        facts: SegmentFacts { k, bending, features: found.len() as u32, ..source.facts },
        features: found.iter().map(feature).collect(),
        levels: coarse.chain(fine).collect(),
    }
}

fn warped(from: &Picture, random: &mut Random) -> Picture {
    let side = from.side;
    let nodes = nodes(random);
    let step = GRID as f64 / side as f64;
    let node = |i: usize, j: usize| nodes[j.min(GRID) * (GRID + 1) + i];
    let mut values = Vec::with_capacity(side * side);
    for y in 0..side {
        let gy = (y as f64 + 0.5) * step;
        let (j, fy) = (gy as usize, gy.fract());
        for x in 0..side {
            let gx = (x as f64 + 0.5) * step;
            let (i, fx) = (gx as usize, gx.fract());
            let (a, b, c, d) = (node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1));
            let mix = |n: usize| (a[n] * (1.0 - fx) + b[n] * fx) * (1.0 - fy) + (c[n] * (1.0 - fx) + d[n] * fx) * fy;
            let at = [(gx / GRID as f64) + mix(0), (gy / GRID as f64) + mix(1)];
            values.push(sample(from, at) * mix(2));
        }
    }
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    Picture { side, values: values.into_iter().map(|x| (x / mean) as f32).collect() }
}

/// Displacement along u and v, and det Dψ with noise, at the nodes of the grid.
fn nodes(random: &mut Random) -> Vec<[f64; 3]> {
    let shift = random.unit();
    let whole = |random: &mut Random, most: f64| random.between(0.0, most + 1.0).floor();
    let waves: Vec<Wave> = (0..WAVES)
        .map(|_| Wave {
            along: 1.0 + whole(random, 2.0),
            across: whole(random, 2.0),
            phase: random.unit(),
            height: [HEIGHT * random.normal(), HEIGHT * random.normal()],
        })
        .collect();
    let displaced = |u: f64, v: f64| {
        let (mut du, mut dv) = (shift, 0.0);
        for wave in &waves {
            du += wave.height[0] * (TAU * (wave.along * u + wave.across * v + wave.phase)).sin();
            dv += wave.height[1] * (TAU * (wave.along * u + wave.phase)).sin();
        }
        [du, dv * (PI * v).sin()]
    };
    let small = 1e-4;
    let node = |k: usize| {
        let (u, v) = ((k % (GRID + 1)) as f64 / GRID as f64, (k / (GRID + 1)) as f64 / GRID as f64);
        let [du, dv] = displaced(u, v);
        let (right, above) = (displaced(u + small, v), displaced(u, v + small));
        let [uu, vu] = [1.0 + (right[0] - du) / small, (right[1] - dv) / small];
        let [uv, vv] = [(above[0] - du) / small, 1.0 + (above[1] - dv) / small];
        [du, dv, (uu * vv - uv * vu).max(AREA_MIN) * (NOISE * random.normal()).exp()]
    };
    (0..(GRID + 1) * (GRID + 1)).map(node).collect()
}

/// λ between pixels; periodic in u, clamped in v.
fn sample(picture: &Picture, at: [f64; 2]) -> f64 {
    let n = picture.side as isize;
    let (x, y) = (at[0] * n as f64 - 0.5, at[1] * n as f64 - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let pixel = |dx: isize, dy: isize| {
        let (column, row) = ((x0 as isize + dx).rem_euclid(n), (y0 as isize + dy).clamp(0, n - 1));
        f64::from(picture.values[(row * n + column) as usize])
    };
    let (low, high) = (pixel(0, 0) + fx * (pixel(1, 0) - pixel(0, 0)), pixel(0, 1) + fx * (pixel(1, 1) - pixel(0, 1)));
    low + fy * (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_proto::Topology;

    fn source() -> PackedEncoding {
        let bump = |k: usize| {
            let (u, v) = ((k % 128) as f64 / 128.0 - 0.5, (k / 128) as f64 / 128.0 - 0.4);
            (0.2 + 5.0 * (-(u * u + v * v) * 60.0).exp()) as f32
        };
        let facts = SegmentFacts { topology: Topology::Disc, k: 0.4, faces: 9, features: 1, bending: Some(3.5) };
        let finest = Picture { side: 128, values: (0..128 * 128).map(bump).collect() };
        let levels = vec![(64, finest.halved().values), (128, finest.values)];
        PackedEncoding { facts, features: Vec::new(), levels }
    }

    #[test]
    fn a_variant_is_like_its_source_of_mean_one_and_the_same_for_the_same_seed() {
        let made = variant(&source(), 512, 7);
        assert_eq!(made, variant(&source(), 512, 7));
        assert_ne!(made, variant(&source(), 512, 8));
        assert_eq!(made.levels.iter().map(|level| level.0).collect::<Vec<_>>(), [32, 64, 128]);
        let mean = made.levels[2].1.iter().map(|x| f64::from(*x)).sum::<f64>() / f64::from(128 * 128);
        assert!((mean - 1.0).abs() < 1e-6, "{mean}");
        assert_eq!(made.facts.features, 1);
        let half = variant(&source(), 64, 7);
        assert_eq!(half.levels.last(), source().levels.last());
        assert!(made.facts.k > 0.2 && made.facts.k < 0.8);
    }
}
