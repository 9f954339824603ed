//! Pictures as registration sees them: √λ of one level, mirrored as a flip asks, sampled with its gradient.

use super::Flip;
use crate::encode::Picture;
use crate::unfold::Uv;

/// √λ of a level.
#[derive(Clone, Debug)]
pub struct Image {
    /// Pixels a side.
    pub side: usize,
    values: Vec<f64>,
    /// Variance of the values.
    pub variance: f64,
    periodic_v: bool,
}

impl Image {
    /// √λ of a picture, its example mirrored by `flip` beforehand.
    pub fn new(picture: &Picture, flip: Flip, periodic_v: bool) -> Self {
        let side = picture.side;
        let source = |x: usize, y: usize| {
            let x = if flip.u { side - 1 - x } else { x };
            let y = if flip.v { side - 1 - y } else { y };
            f64::from(picture.values[y * side + x]).max(0.0).sqrt()
        };
        let values: Vec<f64> = (0..side * side).map(|k| source(k % side, k / side)).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n;
        Self { side, values, variance, periodic_v }
    }

    /// The value of pixel (column, row).
    #[inline(always)]
    pub fn pixel(&self, x: usize, y: usize) -> f64 {
        self.values[y * self.side + x]
    }

    /// Whether the last row borders on the first.
    pub fn is_periodic_v(&self) -> bool {
        self.periodic_v
    }

    /// A row of values.
    pub fn row(&self, y: usize) -> &[f64] {
        &self.values[y * self.side..(y + 1) * self.side]
    }

    /// Centre of pixel (column, row).
    pub fn centre(&self, x: usize, y: usize) -> Uv {
        [(x as f64 + 0.5) / self.side as f64, (y as f64 + 0.5) / self.side as f64]
    }

    /// Bilinear value and its gradient (per unit of u and v) at a point; periodic in u, clamped in v.
    #[inline(always)]
    pub fn sample(&self, at: Uv) -> (f64, [f64; 2]) {
        let n = self.side as isize;
        let scale = self.side as f64;
        let wrapped = |t: f64| t - t.floor();
        let v = if self.periodic_v { wrapped(at[1]) } else { at[1] };
        let (x, y) = (wrapped(at[0]) * scale - 0.5, v * scale - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        // From −1 to n: one comparison in place of a division.
        let around = |c: isize| {
            (if c < 0 {
                c + n
            } else if c >= n {
                c - n
            } else {
                c
            }) as usize
        };
        let row = |r: isize| if self.periodic_v { around(r) } else { r.clamp(0, n - 1) as usize };
        let (c0, c1) = (around(x0 as isize), around(x0 as isize + 1));
        let (r0, r1) = (row(y0 as isize), row((y0 as isize).saturating_add(1)));
        let (a, b) = (self.pixel(c0, r0), self.pixel(c1, r0));
        let (c, d) = (self.pixel(c0, r1), self.pixel(c1, r1));
        let (low, high) = (a + fx * (b - a), c + fx * (d - c));
        let du = (1.0 - fy) * (b - a) + fy * (d - c);
        (low + fy * (high - low), [du * scale, (high - low) * scale])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(side: usize) -> Picture {
        let value = |k: usize| {
            let (u, v) = ((k % side) as f64 / side as f64, (k / side) as f64 / side as f64);
            (1.0 + 0.5 * (std::f64::consts::TAU * u).sin() + 0.2 * v) as f32
        };
        Picture { side, values: (0..side * side).map(value).collect() }
    }

    #[test]
    fn the_gradient_is_the_difference_of_the_values() {
        let image = Image::new(&wave(32), Flip::default(), false);
        let at = [0.991, 0.41];
        let (_, g) = image.sample(at);
        let h = 1e-5;
        let du = (image.sample([at[0] + h, at[1]]).0 - image.sample([at[0] - h, at[1]]).0) / (2.0 * h);
        let dv = (image.sample([at[0], at[1] + h]).0 - image.sample([at[0], at[1] - h]).0) / (2.0 * h);
        assert!((g[0] - du).abs() < 1e-6 && (g[1] - dv).abs() < 1e-6);
    }

    #[test]
    fn a_flip_mirrors_pixel_for_pixel() {
        let image = Image::new(&wave(32), Flip { u: true, v: false }, false);
        let plain = Image::new(&wave(32), Flip::default(), false);
        assert_eq!(image.pixel(0, 5), plain.pixel(31, 5));
    }
}
