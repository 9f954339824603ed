//! Whether two examples are one choice: their coarsest pictures match, but for the cut and the mesh.
//!
//! |c(t)| ≤ 1/n³ · Σ_f w_f Σ_r |A_r(f)|·|B_r(f)| for every shift t, between pixels too, so that the magnitudes alone tell
//! most pairs apart, at a tenth of the time. *Source:* METHOD §6 ("signature"). *Ours:* what it is used for.

use super::spectra::{Row, SIDE, Spectrum, place, weight};

/// Magnitudes of a picture: of each row's frequencies 0 … n/2.
const MAGNITUDES: usize = SIDE * (SIDE / 2 + 1);
/// More than the rounding of a bound.
const SLACK: f64 = 1e-9;

/// A picture that others are compared with.
#[derive(Clone, Debug)]
pub struct ReferencePicture {
    spectrum: Spectrum,
    /// |A_r(f)|·√(w_f/n³).
    magnitudes: Box<[f64; MAGNITUDES]>,
}

impl ReferencePicture {
    /// Prepares a picture.
    pub fn new(row: &Row) -> Self {
        let spectrum = row.spectrum();
        let mut magnitudes = Box::new([0.0; MAGNITUDES]);
        for (k, magnitude) in magnitudes.iter_mut().enumerate() {
            let (frequency, line) = (k / SIDE, k % SIDE);
            let at = place(frequency, line);
            let (re, im) = (spectrum.values[at], spectrum.values[at + 1]);
            let is_real = frequency == 0 || frequency == SIDE / 2;
            *magnitude = (weight(frequency) * (re * re + if is_real { 0.0 } else { im * im })).sqrt();
        }
        Self { spectrum, magnitudes }
    }

    /// Whether [`Row::unmirrored_cost`] of `row`, which `other` was made of, is at most `most`.
    pub fn matches(&self, row: &Row, other: &Self, most: f64) -> bool {
        self.least_cost(other) <= most && row.unmirrored_cost(&self.spectrum) <= most
    }

    /// Never above the cost.
    fn least_cost(&self, other: &Self) -> f64 {
        let mut sums = [0.0; 8];
        let (a, b) = (self.magnitudes.as_chunks::<8>().0, other.magnitudes.as_chunks::<8>().0);
        for (a, b) in a.iter().zip(b) {
            for k in 0..8 {
                sums[k] += a[k] * b[k];
            }
        }
        let variance = self.spectrum.variance + other.spectrum.variance;
        let gap = self.spectrum.mean - other.spectrum.mean;
        let energy = gap * gap + variance - 2.0 * sums.iter().sum::<f64>();
        energy / variance.max(f64::MIN_POSITIVE) - SLACK
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Picture;
    use crate::register::Flip;
    use crate::register::image::Image;
    use crate::register::spectra::VALUES;
    use crate::register::spectra::tests::picture;
    use crate::topology::Topology;

    #[test]
    fn magnitudes_leave_out_no_pair_that_matches() {
        let row = |picture: &Picture| Row::new(&Image::new(picture, Flip::default(), false), Topology::Disc);
        let moved = |from: &Picture, by: usize| {
            let at = |k: usize| from.values[k / SIDE * SIDE + (k % SIDE + by) % SIDE] * (1.0 + 0.01 * (k % 3) as f32);
            Picture { side: SIDE, values: (0..VALUES).map(at).collect() }
        };
        let pictures = (0..24).flat_map(|k| [picture(k), moved(&picture(k), k as usize)]);
        let rows: Vec<Row> = pictures.map(|p| row(&p).expect("of 32²")).collect();
        let all: Vec<ReferencePicture> = rows.iter().map(ReferencePicture::new).collect();
        let mut seen = [0; 2];
        for (row, other) in rows.iter().zip(&all) {
            for one in &all {
                let cost = row.unmirrored_cost(&one.spectrum);
                assert!(one.least_cost(other) <= cost, "{} {cost}", one.least_cost(other));
                assert_eq!(one.matches(row, other, 0.02), cost <= 0.02);
                seen[usize::from(cost <= 0.02)] += 1;
            }
        }
        assert!(seen[0] > 100 && seen[1] >= 48, "{seen:?}");
    }
}
