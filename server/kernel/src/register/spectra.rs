//! The coarsest level of a whole corpus in memory, and the energy of every shift of every picture at once.
//!
//! A and B are √λ at 32² less their means, A_r(f) the Fourier coefficients of row r. For the shift by t pixels along u
//!
//! ```text
//! E(t) = (mean A − mean B)² + var A + var B − 2·c(t)
//! c(t) = 1/n³ · Σ_f w_f Re(X_f e^{2πi·ft/n}),   X_f = Σ_r B_r(f)·conj A_r(f),   f = 0 … n/2,  w = 1, 2, …, 2, 1
//! ```
//!
//! by Parseval. Mirrored in u, A_r(f) becomes e^{2πi·f/n}·conj A_r(f): Σ_r B_r(f)·A_r(f) instead, and t one less; the four
//! real sums of products serve both. Mirrored in v the rows are reversed, which is done to the query.
//! *Source:* paper §5.2 ("isometries"); METHOD §6 ("row spectra").
//! *Ours, not the paper's:* coefficients are kept as 16-bit integers with a scale for each picture, 2 KiB a segment,
//! and **that is the picture** which the coarsest level ranks: exactly, in f64 ([`Row::peaks`]), after a sweep in f32
//! over blocks of [`LANES`] pictures ([`Block::peaks`]) has told within [`PEAK_ERROR`] which ones matter. A lane is a
//! picture, so no sum depends on the width of the processor's vectors, on threads, or on what else is in the block.

use std::sync::LazyLock;

use super::Flip;
use super::entry::SYMMETRIC_COST;
use super::image::Image;
use crate::topology::Topology;

/// Pixels a side of the pictures that are kept.
pub const SIDE: usize = 32;
/// Pictures of a block.
pub const LANES: usize = 16;
/// Numbers a picture: a row's spectrum has as many as the row.
pub const VALUES: usize = SIDE * SIDE;
/// |c in f32 − c| ≤ this · (var A + var B)/2: 64 roundings, more than any term of c goes through.
pub const PEAK_ERROR: f64 = 64.0 * (f32::EPSILON as f64) / 2.0;
/// Largest integer that a coefficient is kept as.
const CODE_MAX: f64 = 32_767.0;
/// Frequencies with a real and an imaginary part: all but 0 and n/2.
const COMPLEX: usize = SIDE / 2 - 1;
/// Steps of a pixel in which near-duplicates are laid on one another.
const QUARTERS: usize = 4;
/// 1/n³.
const NORM: f64 = 1.0 / (SIDE * SIDE * SIDE) as f64;

/// Where the coefficient of (frequency, row) stands: first all of frequency 0, then of n/2, then pairs (re, im).
pub(super) fn place(frequency: usize, row: usize) -> usize {
    match frequency {
        0 => row,
        f if f == SIDE / 2 => SIDE + row,
        f => 2 * SIDE * f + 2 * row,
    }
}

/// w_f/n³.
pub(super) fn weight(frequency: usize) -> f64 {
    NORM * if (1..=COMPLEX).contains(&frequency) { 2.0 } else { 1.0 }
}

/// cos and sin of 2πk/n.
static CIRCLE: LazyLock<[(f64, f64); SIDE]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / SIDE as f64).sin_cos();
        (cos, sin)
    })
});

/// Row spectra of a picture less its mean, in the order of [`place`], and the mean.
fn spectra(image: &Image) -> ([f64; VALUES], f64) {
    let pixels = (0..VALUES).map(|k| image.pixel(k % SIDE, k / SIDE));
    let mean = pixels.sum::<f64>() / VALUES as f64;
    let circle = &*CIRCLE;
    let mut values = [0.0; VALUES];
    for row in 0..SIDE {
        for frequency in 0..=SIDE / 2 {
            let (mut re, mut im) = (0.0, 0.0);
            for x in 0..SIDE {
                let (cos, sin) = circle[frequency * x % SIDE];
                let value = image.pixel(x, row) - mean;
                re += value * cos;
                im -= value * sin;
            }
            values[place(frequency, row)] = re;
            if (1..=COMPLEX).contains(&frequency) {
                values[place(frequency, row) + 1] = im;
            }
        }
    }
    (values, mean)
}

/// Largest c over all shifts, and the least shift in pixels that has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// c.
    pub value: f64,
    /// Pixels by which the example is moved along u.
    pub shift: usize,
}

/// The coarsest picture of an example, as it is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Coefficients in units of `scale`.
    pub codes: Box<[i16; VALUES]>,
    /// What a unit is worth.
    pub scale: f32,
    /// Mean of √λ.
    pub mean: f32,
    /// Variance of the picture that the codes stand for.
    pub variance: f64,
    /// Whether it is its own mirror image, so that mirrored hypotheses say nothing.
    pub symmetric: bool,
}

impl Row {
    /// Keeps √λ at 32²; `None` for an image of another side.
    pub fn new(image: &Image, topology: Topology) -> Option<Self> {
        if image.side != SIDE {
            return None;
        }
        let (values, mean) = spectra(image);
        let largest = values.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let scale = (largest / CODE_MAX) as f32;
        let code = |x: f64| (x / f64::from(scale)).round().clamp(-CODE_MAX, CODE_MAX) as i16;
        let codes = match scale > 0.0 {
            true => Box::new(values.map(code)),
            false => Box::new([0; VALUES]),
        };
        Some(Self::from_parts(codes, scale, mean as f32, topology))
    }

    /// The row with these codes; what else is known of it is computed.
    pub fn from_parts(codes: Box<[i16; VALUES]>, scale: f32, mean: f32, topology: Topology) -> Self {
        let squares = |range: std::ops::Range<usize>| codes[range].iter().map(|&x| i64::from(x).pow(2)).sum::<i64>();
        let sum = squares(0..2 * SIDE) + 2 * squares(2 * SIDE..VALUES);
        let variance = NORM * f64::from(scale) * f64::from(scale) * sum as f64;
        let mut row = Self { codes, scale, mean, variance, symmetric: false };
        row.symmetric = row.is_symmetric(topology);
        row
    }

    /// The same picture as a query.
    pub fn spectrum(&self) -> Spectrum {
        Spectrum { values: self.values(), mean: f64::from(self.mean), variance: self.variance }
    }

    /// E / (var A + var B) of the best translation without a flip, to a quarter of a pixel (between pixels the
    /// pictures are what their coefficients say): whether two examples are one but for the cut and the mesh.
    pub fn unmirrored_cost(&self, query: &Spectrum) -> f64 {
        let variance = self.variance + query.variance;
        let gap = f64::from(self.mean) - query.mean;
        let (ends, plain, _) = self.products(query);
        let whole = best_shift(&ends, &plain, 0);
        let mut most = whole.value;
        for quarter in 1 - QUARTERS as isize..QUARTERS as isize {
            let shift = whole.shift as f64 + quarter as f64 / QUARTERS as f64;
            let angle = std::f64::consts::TAU * shift / SIDE as f64;
            let half = ends[1] * (angle * (SIDE / 2) as f64).cos();
            let waves = (1..).zip(&plain).map(|(f, (re, im))| {
                let (sin, cos) = (angle * f64::from(f)).sin_cos();
                re * cos - im * sin
            });
            most = most.max(ends[0] + half + waves.sum::<f64>());
        }
        let energy = (gap * gap + variance - 2.0 * most).max(0.0);
        if energy > 0.0 { energy / variance.max(f64::MIN_POSITIVE) } else { 0.0 }
    }

    fn is_symmetric(&self, topology: Topology) -> bool {
        let own = self.spectrum();
        Flip::all(topology).iter().filter(|flip| flip.is_mirror()).any(|&flip| {
            let peak = self.peaks(&own.turned(flip))[usize::from(flip.u)];
            2.0 * (self.variance - peak.value) < SYMMETRIC_COST * 2.0 * self.variance
        })
    }

    /// The coefficients.
    fn values(&self) -> Box<[f64; VALUES]> {
        Box::new(self.codes.map(|x| f64::from(x) * f64::from(self.scale)))
    }

    /// The picture that the codes stand for, √λ row by row.
    pub fn picture(&self) -> Vec<f64> {
        let values = self.values();
        let pixel = |k: usize| {
            let (x, row) = (k % SIDE, k / SIDE);
            let sign = if x % 2 == 0 { 1.0 } else { -1.0 };
            let mut sum = values[place(0, row)] + sign * values[place(SIDE / 2, row)];
            for f in 1..=COMPLEX {
                let (cos, sin) = CIRCLE[f * x % SIDE];
                let at = place(f, row);
                sum += 2.0 * (values[at] * cos - values[at + 1] * sin);
            }
            f64::from(self.mean) + sum / SIDE as f64
        };
        (0..VALUES).map(pixel).collect()
    }

    /// The best shift against a query as it is and mirrored in u, in f64.
    pub fn peaks(&self, query: &Spectrum) -> [Peak; 2] {
        let (ends, plain, mirrored) = self.products(query);
        [best_shift(&ends, &plain, 0), best_shift(&ends, &mirrored, 1)]
    }

    /// w_f·X_f/n³ of frequencies 0 and n/2; of the others as it is, and mirrored in u.
    fn products(&self, query: &Spectrum) -> ([f64; 2], Products, Products) {
        let scale = f64::from(self.scale) * NORM;
        let code = |k: usize| f64::from(self.codes[k]);
        let q = &query.values;
        let ends = [0, SIDE / 2].map(|f| scale * (0..SIDE).map(|r| q[place(f, r)] * code(place(f, r))).sum::<f64>());
        let (mut plain, mut mirrored) = ([(0.0, 0.0); COMPLEX], [(0.0, 0.0); COMPLEX]);
        for f in 1..=COMPLEX {
            let mut s = [0.0; 4];
            for row in 0..SIDE {
                let at = place(f, row);
                let (b, a) = ((q[at], q[at + 1]), (code(at), code(at + 1)));
                s[0] += b.0 * a.0;
                s[1] += b.1 * a.1;
                s[2] += b.1 * a.0;
                s[3] += b.0 * a.1;
            }
            let s = s.map(|x| 2.0 * scale * x);
            plain[f - 1] = (s[0] + s[1], s[2] - s[3]);
            mirrored[f - 1] = (s[0] - s[1], s[2] + s[3]);
        }
        (ends, plain, mirrored)
    }
}

/// X_f of the frequencies with two parts.
type Products = [(f64, f64); COMPLEX];

/// The largest c, whose products stand for a picture moved by `offset` pixels already.
fn best_shift(ends: &[f64; 2], products: &Products, offset: usize) -> Peak {
    let circle = &*CIRCLE;
    let at = |t: usize| {
        let s = (t + SIDE - offset) % SIDE;
        let mut sum = ends[0] + if s.is_multiple_of(2) { ends[1] } else { -ends[1] };
        for (f, (re, im)) in (1..).zip(products) {
            let (cos, sin) = circle[f * s % SIDE];
            sum += re * cos - im * sin;
        }
        sum
    };
    let mut best = Peak { value: at(0), shift: 0 };
    for shift in 1..SIDE {
        let value = at(shift);
        if value > best.value {
            best = Peak { value, shift };
        }
    }
    best
}

/// A query's coarsest picture.
#[derive(Clone, Debug)]
pub struct Spectrum {
    pub(super) values: Box<[f64; VALUES]>,
    /// Mean of √λ.
    pub mean: f64,
    /// Its variance.
    pub variance: f64,
}

impl Spectrum {
    /// The spectra of √λ at 32²; `None` for an image of another side.
    pub fn new(image: &Image) -> Option<Self> {
        let (values, mean) = (image.side == SIDE).then(|| spectra(image))?;
        Some(Self { values: Box::new(values), mean, variance: image.variance })
    }

    /// The picture with these coefficients, mean and variance, as [`Spectrum::values`] gives them.
    pub fn from_values(values: Box<[f64; VALUES]>, mean: f64, variance: f64) -> Self {
        Self { values, mean, variance }
    }

    /// Its coefficients.
    pub fn values(&self) -> &[f64; VALUES] {
        &self.values
    }

    /// The query against which an example mirrored in v is to be looked for: its rows in reverse.
    #[must_use]
    pub fn turned(&self, flip: Flip) -> Self {
        let mut turned = self.clone();
        if flip.v {
            for f in 0..=SIDE / 2 {
                let width = if (1..=COMPLEX).contains(&f) { 2 } else { 1 };
                for row in 0..SIDE {
                    let (to, from) = (place(f, row), place(f, SIDE - 1 - row));
                    turned.values[to..to + width].copy_from_slice(&self.values[from..from + width]);
                }
            }
        }
        turned
    }

    /// The same for sweeps, with all factors but the pictures' scales.
    pub fn narrow(&self) -> Narrow {
        let weight = |k: usize| if k < 2 * SIDE { NORM } else { 2.0 * NORM };
        Narrow(Box::new(std::array::from_fn(|k| (self.values[k] * weight(k)) as f32)))
    }
}

/// A query's spectra in f32.
#[derive(Clone, Debug)]
pub struct Narrow(Box<[f32; VALUES]>);

type Lanes = [f32; LANES];

/// [`LANES`] pictures side by side: code k of all of them, then code k + 1.
#[derive(Clone, Debug)]
pub struct Block {
    codes: Box<[[i16; LANES]]>,
    scales: Lanes,
}

impl Default for Block {
    fn default() -> Self {
        Self { codes: vec![[0; LANES]; VALUES].into_boxed_slice(), scales: [0.0; LANES] }
    }
}

impl Block {
    /// Puts a picture into a lane.
    pub fn put(&mut self, lane: usize, row: &Row) {
        self.codes.iter_mut().zip(row.codes.iter()).for_each(|(lanes, &code)| lanes[lane] = code);
        self.scales[lane] = row.scale;
    }

    /// The codes of a lane, and their scale.
    pub fn codes(&self, lane: usize) -> (Box<[i16; VALUES]>, f32) {
        (Box::new(std::array::from_fn(|k| self.codes[k][lane])), self.scales[lane])
    }

    /// Largest c of each picture over all shifts, as it is and mirrored in u, within [`PEAK_ERROR`] of [`Row::peaks`].
    pub fn peaks(&self, query: &Narrow, arch: pulp::Arch) -> [Lanes; 2] {
        arch.dispatch(|| self.peaks_here(query))
    }

    #[inline(always)]
    fn peaks_here(&self, query: &Narrow) -> [Lanes; 2] {
        let (mut ends, mut plain, mut mirrored) =
            ([[0.0; LANES]; 2], [[[0.0; LANES]; 2]; COMPLEX], [[[0.0; LANES]; 2]; COMPLEX]);
        let (singles, pairs) = self.codes.split_at(2 * SIDE);
        let (query_singles, query_pairs) = query.0.split_at(2 * SIDE);
        for (end, (codes, q)) in ends.iter_mut().zip(singles.chunks_exact(SIDE).zip(query_singles.chunks_exact(SIDE))) {
            for (code, q) in codes.iter().zip(q) {
                for lane in 0..LANES {
                    end[lane] += q * f32::from(code[lane]);
                }
            }
        }
        let of_frequency = pairs.chunks_exact(2 * SIDE).zip(query_pairs.chunks_exact(2 * SIDE));
        for ((plain, mirrored), (codes, q)) in plain.iter_mut().zip(&mut mirrored).zip(of_frequency) {
            let mut s = [[0.0f32; LANES]; 4];
            for (code, q) in codes.as_chunks::<2>().0.iter().zip(q.as_chunks::<2>().0) {
                for lane in 0..LANES {
                    let (re, im) = (f32::from(code[0][lane]), f32::from(code[1][lane]));
                    s[0][lane] += q[0] * re;
                    s[1][lane] += q[1] * im;
                    s[2][lane] += q[1] * re;
                    s[3][lane] += q[0] * im;
                }
            }
            for lane in 0..LANES {
                plain[0][lane] = s[0][lane] + s[1][lane];
                plain[1][lane] = s[2][lane] - s[3][lane];
                mirrored[0][lane] = s[0][lane] - s[1][lane];
                mirrored[1][lane] = s[2][lane] + s[3][lane];
            }
        }
        let mut peaks = [most(&ends, &plain), most(&ends, &mirrored)];
        for peak in &mut peaks {
            for lane in 0..LANES {
                peak[lane] *= self.scales[lane];
            }
        }
        peaks
    }
}

/// Quarter turns of the angles of the inverse transform: the others follow by symmetry.
const QUARTER: usize = SIDE / 4;

/// cos and sin of 2πft/n for t = 0 … n/4 and f = 1 … n/2 − 1.
static TURNS: LazyLock<[[(f32, f32); COMPLEX]; QUARTER + 1]> = LazyLock::new(|| {
    let narrow = |(cos, sin): (f64, f64)| (cos as f32, sin as f32);
    std::array::from_fn(|t| std::array::from_fn(|f| narrow(CIRCLE[(f + 1) * t % SIDE])))
});

/// max over t of Re Σ_f X_f e^{2πi·ft/n}. Even and odd frequencies and cosines and sines are summed by themselves: their
/// signs alone tell t, −t, n/2 + t and n/2 − t apart.
#[inline(always)]
fn most(ends: &[Lanes; 2], products: &[[Lanes; 2]; COMPLEX]) -> Lanes {
    let mut most = [f32::NEG_INFINITY; LANES];
    for (t, turns) in TURNS.iter().enumerate() {
        let mut cosines = [[0.0f32; LANES]; 2];
        let mut sines = [[0.0f32; LANES]; 2];
        for (f, ([re, im], &(cos, sin))) in products.iter().zip(turns).enumerate() {
            let odd = (f + 1) % 2;
            for lane in 0..LANES {
                cosines[odd][lane] += re[lane] * cos;
                sines[odd][lane] += im[lane] * sin;
            }
        }
        let sign = if t % 2 == 0 { 1.0 } else { -1.0 };
        for lane in 0..LANES {
            let base = ends[0][lane] + sign * ends[1][lane] + cosines[0][lane];
            let (even, odd) = (sines[0][lane], sines[1][lane]);
            let near = (base + cosines[1][lane] - (even + odd)).max(base + cosines[1][lane] + (even + odd));
            let far = (base - cosines[1][lane] - (even - odd)).max(base - cosines[1][lane] + (even - odd));
            most[lane] = most[lane].max(near.max(far));
        }
    }
    most
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::translation_energies;
    use super::*;
    use crate::encode::Picture;

    /// A picture of some seeded waves and noise; seed 0 is flat.
    pub(crate) fn picture(seed: u64) -> Picture {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        if seed == 0 {
            return Picture { side: SIDE, values: vec![1.0; VALUES] };
        }
        let (fu, fv, phase) = ((1.0 + 3.0 * random()).floor(), 6.0 * random(), random());
        let value = |k: usize| {
            let (u, v) = ((k % SIDE) as f64 / SIDE as f64, (k / SIDE) as f64 / SIDE as f64);
            (1.2 + (std::f64::consts::TAU * (fu * u + phase) + fv * v).sin() * (0.2 + v) + 0.3 * random()) as f32
        };
        Picture { side: SIDE, values: (0..VALUES).map(value).map(|x| x.max(0.0)).collect() }
    }

    fn image(seed: u64) -> Image {
        Image::new(&picture(seed), Flip::default(), false)
    }

    /// The picture that a row stands for, as registration sees it.
    pub(crate) fn kept(row: &Row, flip: Flip) -> Image {
        let squares = row.picture().iter().map(|x| (x * x) as f32).collect();
        Image::new(&Picture { side: SIDE, values: squares }, flip, false)
    }

    #[test]
    fn a_row_is_its_picture_up_to_some_1e_5() {
        for seed in 1..6 {
            let (image, row) = (image(seed), Row::new(&image(seed), Topology::Disc).expect("of 32²"));
            for (k, value) in row.picture().iter().enumerate() {
                assert!((value - image.pixel(k % SIDE, k / SIDE)).abs() < 1e-4, "seed {seed}, pixel {k}");
            }
            assert!((row.variance - image.variance).abs() < 1e-5 * image.variance);
        }
    }

    #[test]
    fn energies_by_spectra_are_those_of_the_pixels_for_every_flip() {
        let query = image(77);
        let spectrum = Spectrum::new(&query).expect("of 32²");
        for seed in 0..20 {
            let row = Row::new(&image(seed), Topology::Annulus).expect("of 32²");
            for &flip in Flip::all(Topology::Annulus) {
                let energies = translation_energies(&kept(&row, flip), &query);
                let least = energies.iter().copied().fold(f64::INFINITY, f64::min);
                let peak = row.peaks(&spectrum.turned(flip))[usize::from(flip.u)];
                let gap = f64::from(row.mean) - spectrum.mean;
                let energy = gap * gap + row.variance + spectrum.variance - 2.0 * peak.value;
                assert!((energy - least).abs() < 1e-6, "seed {seed}, {flip:?}: {energy} and {least}");
                assert!((energies[peak.shift] - least).abs() < 1e-6, "seed {seed}, {flip:?}: shift {}", peak.shift);
            }
        }
    }

    #[test]
    fn the_sweep_is_within_its_error_of_the_plain_twin_whatever_the_processor() {
        let rows: Vec<Row> = (0..LANES as u64).map(|s| Row::new(&image(s), Topology::Disc).expect("of 32²")).collect();
        let mut block = Block::default();
        rows.iter().enumerate().for_each(|(lane, row)| block.put(lane, row));
        assert_eq!(block.codes(3), (rows[3].codes.clone(), rows[3].scale));
        let spectrum = Spectrum::new(&image(5)).expect("of 32²");
        let swept = block.peaks(&spectrum.narrow(), pulp::Arch::new());
        assert_eq!(swept, block.peaks(&spectrum.narrow(), pulp::Arch::Scalar));
        for (lane, row) in rows.iter().enumerate() {
            for (flip, peak) in row.peaks(&spectrum).iter().enumerate() {
                let error = (f64::from(swept[flip][lane]) - peak.value).abs();
                assert!(error <= PEAK_ERROR * (row.variance + spectrum.variance) / 2.0, "lane {lane}: {error}");
            }
        }
    }

    #[test]
    fn a_shifted_copy_is_found_at_its_shift_and_a_mirrored_one_by_its_flip() {
        let original = picture(9);
        let moved = |by: usize, mirrored: bool| {
            let at = |k: usize| {
                let x = (k % SIDE + by) % SIDE;
                original.values[k / SIDE * SIDE + if mirrored { SIDE - 1 - x } else { x }]
            };
            Image::new(&Picture { side: SIDE, values: (0..VALUES).map(at).collect() }, Flip::default(), false)
        };
        let spectrum = Spectrum::new(&image(9)).expect("of 32²");
        let row = Row::new(&moved(11, false), Topology::Disc).expect("of 32²");
        let [plain, mirrored] = row.peaks(&spectrum);
        assert_eq!(plain.shift, 11);
        assert!(plain.value > mirrored.value && (plain.value / spectrum.variance - 1.0).abs() < 1e-4);
        let [plain, mirrored] = Row::new(&moved(3, true), Topology::Disc).expect("of 32²").peaks(&spectrum);
        assert!(mirrored.value > plain.value && (mirrored.value / spectrum.variance - 1.0).abs() < 1e-4);
    }

    #[test]
    fn a_copy_moved_by_half_a_pixel_costs_nothing() {
        let wave = |by: f64| {
            let value = |k: usize| {
                let (u, v) = ((k % SIDE) as f64 + by, (k / SIDE) as f64);
                let root = 2.0 + (std::f64::consts::TAU * u / 32.0).sin() * (0.2 + v / 32.0);
                (root * root) as f32
            };
            let picture = Picture { side: SIDE, values: (0..VALUES).map(value).collect() };
            Image::new(&picture, Flip::default(), false)
        };
        let spectrum = Spectrum::new(&wave(0.0)).expect("of 32²");
        let row = Row::new(&wave(0.5), Topology::Disc).expect("of 32²");
        let whole = 1.0 - 2.0 * row.peaks(&spectrum)[0].value / (row.variance + spectrum.variance);
        assert!(whole > 0.004 && row.unmirrored_cost(&spectrum) < 1e-6, "{whole}");
    }

    #[test]
    fn a_flat_picture_has_no_variance_and_counts_as_its_own_mirror_image() {
        let row = Row::new(&image(0), Topology::Disc).expect("of 32²");
        assert_eq!((row.variance, row.mean), (0.0, 1.0));
        let even = |k: usize| (1.5 + (std::f64::consts::TAU * (k % SIDE) as f64 / SIDE as f64).cos()) as f32;
        let waves = Picture { side: SIDE, values: (0..VALUES).map(even).collect() };
        let symmetric = Row::new(&Image::new(&waves, Flip::default(), false), Topology::Disc).expect("of 32²");
        assert!(symmetric.symmetric);
    }
}
