//! One level of a pyramid in few bytes: λ as 16-bit codes of log λ, predicted from its neighbours, in byte planes, packed.
//!
//! code(x) = 1 + round((ln λ(x) − ln λ_min) / step), and 0 where λ = 0; λ̂ = exp(ln λ_min + step·(code − 1)), so
//! |λ̂/λ − 1| ≤ e^(step/2) − 1. The logarithm is monotonic and its error is relative, as that of the energy, which is why a ranking over
//! decoded pictures is the ranking over the originals: the error of E = mean (√λ₁ − √λ₂)² is a mean of independent errors of
//! at most step/4 of √λ each.
//!
//! *Ours:* the step is fixed by the level, not by the picture's range, unless the range needs a larger one. The error of E falls with the
//! number of pixels (√n), so finer levels may have larger steps: the steps up to 128², the level a search ends at by default, are those
//! that change no ranking of 24 real meshes by more than 10⁻⁵ of E. At 512² a step of 2⁻⁶ is an rms of 4.5·10⁻³ of λ; it adds
//! step²/48 = 5·10⁻⁶ to every E alike (mean λ is 1), and ± 2·√(E·step²/48/n), some 10⁻⁶: it changes no ranking of those 24 meshes
//! whose energies differ by more than 2·10⁻⁴. Bytes of real meshes' pictures
//! (they are constant a triangle, with edges between), steps of 2⁻¹² everywhere → 2⁻⁸ → as here: 173 → 83 → 48 KB at 512²; 18 KB at 128².
//!
//! Layout, little-endian: `version 1 ‖ predictor ‖ packing ‖ 0 ‖ side u16 ‖ ln λ_min f64 ‖ step f64`, then for each of six classes
//! `residuals u32 ‖ packed bytes u32`, then their packed streams. A pixel's class is how much its known neighbours differ, so that the quiet insides of
//! triangles and the edges between them are packed with statistics of their own (−9 % at 512²). A stream is the low, then the high bytes of the zigzagged
//! residuals of its class, in order of the picture.

use crate::record::{at_most, invalid};
use crate::{Level, StoreError};

/// Greatest side of a level, in pixels.
pub const LEVEL_SIDE_MAX: u32 = 512;
const VERSION: u8 = 1;
const HEAD: usize = 22;
/// Greatest code above the one of λ_min.
const CODE_SPAN: f64 = 65_534.0;
/// Levels up to this side gain nothing from zstd (20 µs fixed cost for some 2 KiB).
const SMALL_SIDE: u32 = 64;
const ZSTD_LEVEL: i32 = 1;
const CLASSES: usize = 6;
/// Greatest sum of differences between the known neighbours of a pixel for each class but the last.
const CLASS_MAX: [u32; CLASSES - 1] = [0, 3, 15, 63, 255];
/// Bytes before the streams: number of residuals and of packed bytes of each class.
const TABLE: usize = 8 * CLASSES;

/// Finest step of ln λ worth keeping at a level of this side.
fn step_min(side: u32) -> f64 {
    match side {
        0..=64 => 1.0 / 32_768.0,
        65..=128 => 1.0 / 4096.0,
        129..=256 => 1.0 / 128.0,
        _ => 1.0 / 64.0,
    }
}

/// How a code is foretold from its left, upper and upper left neighbour.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Predictor {
    /// left + up − upper left: exact on planes, best where the picture is smooth.
    Plane,
    /// (left + up) / 2: adds the least noise.
    Mean,
    /// The median of left, up and left + up − upper left: keeps edges.
    Median,
}

const PREDICTORS: [Predictor; 3] = [Predictor::Plane, Predictor::Mean, Predictor::Median];

impl Predictor {
    fn predict(self, known: Known) -> u16 {
        let Known { left, up, upper_left, .. } = known;
        match self {
            Predictor::Plane => left.wrapping_add(up).wrapping_sub(upper_left),
            Predictor::Mean => left.midpoint(up),
            Predictor::Median => {
                let (low, high) = (left.min(up), left.max(up));
                let plane = i32::from(left) + i32::from(up) - i32::from(upper_left);
                u16::try_from(plane.clamp(i32::from(low), i32::from(high))).unwrap_or(high)
            }
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Packing {
    Raw,
    Lz4,
    Zstd,
}

const PACKINGS: [Packing; 3] = [Packing::Raw, Packing::Lz4, Packing::Zstd];

/// Checks a level: λ must be finite and not negative; the side a power of two up to [`LEVEL_SIDE_MAX`].
pub(crate) fn check(level: &Level) -> Result<(), StoreError> {
    let side = level.side;
    at_most("a level's side", "pixels", side as usize, LEVEL_SIDE_MAX as usize)?;
    let pixels = (side as usize) * (side as usize);
    if !side.is_power_of_two() || level.lambda.len() != pixels {
        let found = format!("{} values for a side of {side}", level.lambda.len());
        return Err(invalid("a level", "with side × side values and a power of two as its side".into(), found));
    }
    if let Some(bad) = level.lambda.iter().find(|value| !value.is_finite() || **value < 0.0) {
        return Err(invalid("every λ of a level", "to be finite and not negative".into(), bad.to_string()));
    }
    Ok(())
}

/// Packs a level that passes [`check`].
pub(crate) fn encode(level: &Level) -> Result<Vec<u8>, StoreError> {
    check(level)?;
    let side = level.side;
    let (min, step) = range(&level.lambda, step_min(side));
    let codes: Vec<u16> = level.lambda.iter().map(|&value| code(value, min, step)).collect();
    let (predictor, streams) = best_streams(&codes, side as usize);
    let (packing, packed) = pack(&streams, side);
    let mut out = Vec::with_capacity(HEAD + TABLE + packed.iter().map(Vec::len).sum::<usize>());
    out.extend_from_slice(&[VERSION, predictor, packing as u8, 0]);
    out.extend_from_slice(&(side as u16).to_le_bytes());
    out.extend_from_slice(&min.to_le_bytes());
    out.extend_from_slice(&step.to_le_bytes());
    for (stream, packed) in streams.iter().zip(&packed) {
        out.extend_from_slice(&(stream.len() as u32).to_le_bytes());
        out.extend_from_slice(&(packed.len() as u32).to_le_bytes());
    }
    packed.iter().for_each(|packed| out.extend_from_slice(packed));
    Ok(out)
}

/// ln of the least positive λ, and the step of the codes.
fn range(lambda: &[f32], step_min: f64) -> (f64, f64) {
    let positive = lambda.iter().copied().filter(|&value| value > 0.0);
    let (low, high) = positive.fold((f32::MAX, 0.0f32), |(low, high), value| (low.min(value), high.max(value)));
    if high == 0.0 {
        return (0.0, step_min);
    }
    let min = f64::from(low).ln();
    (min, step_min.max((f64::from(high).ln() - min) / CODE_SPAN))
}

fn code(value: f32, min: f64, step: f64) -> u16 {
    if value > 0.0 { 1 + ((f64::from(value).ln() - min) / step).round().clamp(0.0, CODE_SPAN) as u16 } else { 0 }
}

/// Zigzagged residuals, class by class.
type Streams = [Vec<u16>; CLASSES];

/// The number of the predictor whose residuals are smallest, and these.
fn best_streams(codes: &[u16], side: usize) -> (u8, Streams) {
    let mut best = (u64::MAX, 0, Streams::default());
    for (number, predictor) in (0u8..).zip(PREDICTORS) {
        let streams = residuals(codes, side, predictor);
        let cost = streams.iter().flatten().map(|&r| u64::from(16 - r.leading_zeros())).sum();
        if cost < best.0 {
            best = (cost, number, streams);
        }
    }
    (best.1, best.2)
}

/// The pixels around one that are known when it is decoded; those outside the picture are 0 (the first) or as their neighbour.
#[derive(Clone, Copy)]
struct Known {
    left: u16,
    up: u16,
    upper_left: u16,
    upper_right: u16,
}

impl Known {
    /// Around column `x`: `left` is the pixel before it in its row, `above` the row above (empty for the first row).
    fn at(x: usize, left: Option<u16>, above: &[u16]) -> Self {
        let up = above.get(x).copied().or(left).unwrap_or(0);
        let upper_left = x.checked_sub(1).and_then(|x| above.get(x).copied()).unwrap_or(up);
        let upper_right = above.get(x + 1).copied().unwrap_or(up);
        Self { left: left.unwrap_or(up), up, upper_left, upper_right }
    }

    fn class(self) -> usize {
        let difference = |a: u16, b: u16| u32::from(a.abs_diff(b));
        let activity = difference(self.left, self.upper_left)
            + difference(self.up, self.upper_left)
            + difference(self.up, self.upper_right);
        CLASS_MAX.iter().take_while(|&&most| activity > most).count()
    }
}

fn residuals(codes: &[u16], side: usize, predictor: Predictor) -> Streams {
    let mut streams = Streams::default();
    let mut above: &[u16] = &[];
    for row in codes.chunks_exact(side) {
        let mut left = None;
        for (x, &code) in row.iter().enumerate() {
            let known = Known::at(x, left, above);
            let delta = code.wrapping_sub(predictor.predict(known)) as i16;
            if let Some(stream) = streams.get_mut(known.class()) {
                stream.push(((delta << 1) ^ (delta >> 15)) as u16);
            }
            left = Some(code);
        }
        above = row;
    }
    streams
}

fn pack(streams: &Streams, side: u32) -> (Packing, [Vec<u8>; CLASSES]) {
    let planes = |stream: &Vec<u16>| -> Vec<u8> {
        stream.iter().map(|r| (r & 0xff) as u8).chain(stream.iter().map(|r| (r >> 8) as u8)).collect()
    };
    let raw = streams.each_ref().map(planes);
    let packing = if side <= SMALL_SIDE { Packing::Lz4 } else { Packing::Zstd };
    let packed = raw.each_ref().map(|planes| match packing {
        Packing::Zstd => zstd::bulk::compress(planes, ZSTD_LEVEL).unwrap_or_else(|_| planes.clone()),
        Packing::Lz4 => lz4_flex::block::compress(planes),
        Packing::Raw => planes.clone(),
    });
    let length = |streams: &[Vec<u8>; CLASSES]| streams.iter().map(Vec::len).sum::<usize>();
    if length(&packed) < length(&raw) { (packing, packed) } else { (Packing::Raw, raw) }
}

/// Unpacks a level; any bytes are survived, and an `Err` says what is wrong with them.
pub(crate) fn decode(bytes: &[u8]) -> Result<Level, &'static str> {
    let (head, packed) = bytes.split_first_chunk::<HEAD>().ok_or("too few bytes for a level")?;
    let [version, predictor, packing, 0, s0, s1, range @ ..] = *head else { return Err("no head of a level") };
    if version != VERSION {
        return Err("a level of an unknown version");
    }
    let predictor = *PREDICTORS.get(usize::from(predictor)).ok_or("an unknown predictor")?;
    let packing = *PACKINGS.get(usize::from(packing)).ok_or("an unknown packing")?;
    let side = u32::from(u16::from_le_bytes([s0, s1]));
    if !side.is_power_of_two() || side > LEVEL_SIDE_MAX {
        return Err("an impossible side");
    }
    let [m0, m1, m2, m3, m4, m5, m6, m7, t0, t1, t2, t3, t4, t5, t6, t7] = range;
    let min = f64::from_le_bytes([m0, m1, m2, m3, m4, m5, m6, m7]);
    let step = f64::from_le_bytes([t0, t1, t2, t3, t4, t5, t6, t7]);
    if !(min.abs() < 1e3 && step > 0.0 && step < 1.0) {
        return Err("an impossible range");
    }
    let pixels = (side as usize) * (side as usize);
    let streams = unpack_streams(packing, packed, pixels).ok_or("streams that don't unpack")?;
    let codes = restore(&streams, side as usize, predictor).ok_or("streams of another picture")?;
    let lambda = decode_codes(&codes, min, step);
    Ok(Level { side, lambda })
}

fn unpack_streams(packing: Packing, bytes: &[u8], pixels: usize) -> Option<[Vec<u8>; CLASSES]> {
    let (table, mut rest) = bytes.split_first_chunk::<TABLE>()?;
    let mut left = pixels;
    let mut streams: [Vec<u8>; CLASSES] = Default::default();
    for (stream, &[c0, c1, c2, c3, p0, p1, p2, p3]) in streams.iter_mut().zip(table.as_chunks::<8>().0) {
        let count = u32::from_le_bytes([c0, c1, c2, c3]) as usize;
        left = left.checked_sub(count)?;
        let (packed, after) = rest.split_at_checked(u32::from_le_bytes([p0, p1, p2, p3]) as usize)?;
        *stream = unpack(packing, packed, 2 * count)?;
        rest = after;
    }
    (left == 0 && rest.is_empty()).then_some(streams)
}

fn unpack(packing: Packing, packed: &[u8], length: usize) -> Option<Vec<u8>> {
    let planes = match packing {
        Packing::Raw => packed.to_vec(),
        Packing::Lz4 => {
            let mut planes = vec![0; length];
            let found = lz4_flex::block::decompress_into(packed, &mut planes).ok()?;
            planes.truncate(found);
            planes
        }
        Packing::Zstd => zstd::bulk::decompress(packed, length).ok()?,
    };
    (planes.len() == length).then_some(planes)
}

fn restore(streams: &[Vec<u8>; CLASSES], side: usize, predictor: Predictor) -> Option<Vec<u16>> {
    let mut next = streams.each_ref().map(|planes| {
        let (low, high) = planes.split_at(planes.len() / 2);
        low.iter().zip(high)
    });
    let mut codes: Vec<u16> = Vec::with_capacity(side * side);
    let (mut above, mut row) = (Vec::new(), Vec::with_capacity(side));
    for _ in 0..side {
        row.clear();
        let mut left = None;
        for x in 0..side {
            let known = Known::at(x, left, &above);
            let (&low, &high) = next.get_mut(known.class())?.next()?;
            let zigzag = u16::from_le_bytes([low, high]);
            let delta = (zigzag >> 1) ^ (zigzag & 1).wrapping_neg();
            let code = predictor.predict(known).wrapping_add(delta);
            row.push(code);
            left = Some(code);
        }
        codes.extend_from_slice(&row);
        above.clone_from(&row);
    }
    Some(codes)
}

/// λ̂ of every code. exp(min + step·(256·h + l)) is a product of two entries of small tables: 512 exponentials instead of a quarter of a million.
fn decode_codes(codes: &[u16], min: f64, step: f64) -> Vec<f32> {
    let coarse: [f64; 256] = std::array::from_fn(|h| (min + step * (256.0 * h as f64 - 1.0)).exp());
    let fine: [f64; 256] = std::array::from_fn(|l| (step * l as f64).exp());
    let value = |code: u16| {
        let [l, h] = code.to_le_bytes();
        // `u8` indices into 256 entries: always in bounds.
        if code == 0 { 0.0 } else { (coarse[usize::from(h)] * fine[usize::from(l)]).min(f64::from(f32::MAX)) as f32 }
    };
    codes.iter().map(|&code| value(code)).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A picture like λ of a head: `bumps` periodic gaussians, mean 1, with noise of relative size `noise`.
    pub(crate) fn picture(side: u32, bumps: u32, noise: f64) -> Level {
        let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
        let mut random = move || {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        let bumps: Vec<[f64; 4]> =
            (0..bumps).map(|_| [random(), random(), 0.02 + 0.12 * random(), 0.3 + 5.0 * random()]).collect();
        let n = side as usize;
        let at = |x: usize, y: usize| {
            let (u, v) = ((x as f64 + 0.5) / n as f64, (y as f64 + 0.5) / n as f64);
            let bump = |&[bu, bv, width, height]: &[f64; 4]| {
                let du = (u - bu).abs().min(1.0 - (u - bu).abs());
                height * (-(du * du + (v - bv) * (v - bv)) / (2.0 * width * width)).exp()
            };
            0.25 + bumps.iter().map(bump).sum::<f64>()
        };
        let mut lambda: Vec<f64> = (0..n * n).map(|i| at(i % n, i / n)).collect();
        let mean = lambda.iter().sum::<f64>() / lambda.len() as f64;
        for value in &mut lambda {
            *value *= (1.0 + noise * 3.46 * (random() - 0.5)) / mean;
        }
        Level { side, lambda: lambda.into_iter().map(|value| value as f32).collect() }
    }

    /// The pyramid below a level, by means of 2 × 2.
    pub(crate) fn pyramid(finest: Level) -> Vec<Level> {
        let mut levels = vec![finest];
        while let Some(last) = levels.last().filter(|level| level.side > 32) {
            let (n, half) = (last.side as usize, last.side as usize / 2);
            let at = |x: usize, y: usize| last.lambda[y * n + x];
            let mean = |i: usize| {
                let (x, y) = (2 * (i % half), 2 * (i / half));
                (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) / 4.0
            };
            let lambda = (0..half * half).map(mean).collect();
            levels.push(Level { side: last.side / 2, lambda });
        }
        levels.reverse();
        levels
    }

    fn error_max(a: &Level, b: &Level) -> f64 {
        let error = |(&a, &b): (&f32, &f32)| (f64::from(a) / f64::from(b) - 1.0).abs();
        a.lambda.iter().zip(&b.lambda).map(error).fold(0.0, f64::max)
    }

    #[test]
    fn a_level_comes_back_within_half_a_step() {
        for (name, bumps, noise) in [("smooth", 12, 0.0), ("busy", 60, 0.0), ("2 % noise", 12, 0.02)] {
            let mut total = 0;
            for level in pyramid(picture(512, bumps, noise)) {
                let bytes = encode(&level).unwrap();
                let back = decode(&bytes).unwrap();
                let error = error_max(&back, &level);
                println!("{name} {0}²: {1} bytes, largest relative error {error:.1e}", level.side, bytes.len());
                let (_, step) = range(&level.lambda, step_min(level.side));
                assert!(error <= (0.5 * step).exp_m1() + 2e-7, "{name} {}: {error} at a step of {step}", level.side);
                total += bytes.len();
            }
            println!("{name}: {total} bytes a segment");
            assert!(noise > 0.0 || total <= 120 * 1024, "{name}: {total} bytes");
        }
    }

    #[test]
    fn a_ranking_by_decoded_pictures_is_the_ranking_by_the_originals() {
        let energy = |a: &Level, b: &Level| {
            let square = |(&a, &b): (&f32, &f32)| (f64::from(a).sqrt() - f64::from(b).sqrt()).powi(2);
            a.lambda.iter().zip(&b.lambda).map(square).sum::<f64>() / a.lambda.len() as f64
        };
        for side in [32, 128, 256] {
            let query = picture(side, 12, 0.0);
            // Forty near-duplicates whose energies lie within a few per cent of each other.
            let corpus: Vec<Level> = (0..40).map(|i| picture(side, 12, 0.02 + 0.0004 * f64::from(i))).collect();
            let rank = |of: &dyn Fn(&Level) -> Level| {
                let mut order: Vec<(f64, usize)> =
                    corpus.iter().map(|entry| energy(&of(entry), &query)).zip(0..).collect();
                order.sort_by(|a, b| a.0.total_cmp(&b.0));
                order.into_iter().map(|(_, i)| i).collect::<Vec<_>>()
            };
            assert_eq!(rank(&|l| l.clone()), rank(&|l| decode(&encode(l).unwrap()).unwrap()), "at {side}²");
        }
    }

    #[test]
    fn zeros_constants_and_extremes_survive() {
        let mut lambda = vec![1.0f32; 32 * 32];
        lambda[5] = 0.0;
        lambda[6] = f32::MIN_POSITIVE;
        lambda[7] = f32::MAX;
        let level = Level { side: 32, lambda };
        let back = decode(&encode(&level).unwrap()).unwrap();
        assert_eq!(back.lambda[5], 0.0);
        assert!(back.lambda[6] > 0.0 && back.lambda[7].is_finite());
        assert!((back.lambda[8] - 1.0).abs() < 2e-3, "{}", back.lambda[8]);
        for constant in [0.0, 1.0, 3.5] {
            let level = Level { side: 64, lambda: vec![constant; 64 * 64] };
            let back = decode(&encode(&level).unwrap()).unwrap();
            assert!(back.lambda.iter().all(|&value| (value - constant).abs() < 1e-5));
        }
    }

    #[test]
    fn a_level_that_is_none_is_refused() {
        for (side, count, value) in [
            (32, 1023, 1.0),
            (48, 48 * 48, 1.0),
            (0, 0, 1.0),
            (1024, 1 << 20, 1.0),
            (32, 1024, -1.0),
            (32, 1024, f32::NAN),
        ] {
            let level = Level { side, lambda: vec![value; count] };
            assert!(matches!(encode(&level), Err(StoreError::Invalid { .. })), "{side} {count} {value}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..4000)) {
            let _ = decode(&bytes);
        }

        #[test]
        fn any_change_of_a_level_is_survived(at in 0usize..2000, to in any::<u8>(), side in 0usize..2) {
            let mut bytes = encode(&picture([64, 128][side], 5, 0.01)).unwrap();
            let at = at % bytes.len();
            bytes[at] = to;
            if let Ok(level) = decode(&bytes) {
                prop_assert_eq!(level.lambda.len(), (level.side * level.side) as usize);
                prop_assert!(level.lambda.iter().all(|value| value.is_finite()));
            }
        }
    }
}
