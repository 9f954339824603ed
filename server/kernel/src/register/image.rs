//! Pictures as registration sees them: √λ of one level, mirrored as a flip asks, sampled with its gradient.

use super::Flip;
use crate::encode::Picture;
use crate::unfold::Uv;

/// √λ of a level.
#[derive(Clone, Debug)]
pub struct Image {
    /// Pixels a side.
    pub side: usize,
    /// Row by row, with a pixel before and after each that repeats its other end, and a row before and after all that
    /// repeats the other end too where v is periodic, else the row beside it: no sample asks where it is.
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
        Self { side, values: framed(&values, side, periodic_v), variance, periodic_v }
    }

    /// From one row to the next.
    #[inline(always)]
    fn stride(&self) -> usize {
        self.side + 2
    }

    /// The value of pixel (column, row).
    #[inline(always)]
    pub fn pixel(&self, x: usize, y: usize) -> f64 {
        self.values[(y + 1) * self.stride() + x + 1]
    }

    /// Whether the last row borders on the first.
    pub fn is_periodic_v(&self) -> bool {
        self.periodic_v
    }

    /// A row of values.
    pub fn row(&self, y: usize) -> &[f64] {
        &self.values[(y + 1) * self.stride() + 1..][..self.side]
    }

    /// Centre of pixel (column, row).
    pub fn centre(&self, x: usize, y: usize) -> Uv {
        [(x as f64 + 0.5) / self.side as f64, (y as f64 + 0.5) / self.side as f64]
    }

    /// Bilinear value and its gradient (per unit of u and v) at a point; periodic in u, clamped in v.
    #[inline(always)]
    pub fn sample(&self, at: Uv) -> (f64, [f64; 2]) {
        let ([value], [du], [dv]) = self.samples([[at[0]], [at[1]]]);
        (value, [du, dv])
    }

    /// The same at points side by side: values, and gradients by u and by v.
    #[inline(always)]
    pub fn samples<const N: usize>(&self, [u, v]: [[f64; N]; 2]) -> ([f64; N], [f64; N], [f64; N]) {
        let scale = self.side as f64;
        let (mut fx, mut fy, mut corner) = ([0.0; N], [0.0; N], [0usize; N]);
        for k in 0..N {
            let (x, y) =
                ((u[k] - u[k].floor()) * scale - 0.5, if self.periodic_v { v[k] - v[k].floor() } else { v[k] });
            // Beyond the frame nothing changes any more.
            let y = (y * scale - 0.5).max(-1.0).min(scale - 0.5);
            let (x0, y0) = (x.floor(), y.floor());
            (fx[k], fy[k]) = (x - x0, y - y0);
            // At most some 2¹⁸, which f64 and i32 hold; NaN becomes 0.
            corner[k] = ((y0 + 1.0) * (scale + 2.0) + (x0 + 1.0)) as i32 as usize;
        }
        let mut four = [[0.0; N]; 4];
        for k in 0..N {
            let at = corner[k].min(self.values.len() - self.stride() - 2);
            let near = &self.values[at..at + self.stride() + 2];
            let (above, below) = (&near[..2], &near[self.stride()..]);
            (four[0][k], four[1][k], four[2][k], four[3][k]) = (above[0], above[1], below[0], below[1]);
        }
        let (mut value, mut du, mut dv) = ([0.0; N], [0.0; N], [0.0; N]);
        for k in 0..N {
            let [a, b, c, d] = [four[0][k], four[1][k], four[2][k], four[3][k]];
            let (low, high) = (a + fx[k] * (b - a), c + fx[k] * (d - c));
            value[k] = low + fy[k] * (high - low);
            du[k] = ((1.0 - fy[k]) * (b - a) + fy[k] * (d - c)) * scale;
            dv[k] = (high - low) * scale;
        }
        (value, du, dv)
    }
}

/// Rows with a frame around them, see [`Image`].
fn framed(values: &[f64], side: usize, periodic_v: bool) -> Vec<f64> {
    if side == 0 {
        return vec![0.0; 4];
    }
    let mut framed = Vec::with_capacity((side + 2) * (side + 2));
    let (before, after) = if periodic_v { (side - 1, 0) } else { (0, side - 1) };
    for y in std::iter::once(before).chain(0..side).chain(std::iter::once(after)) {
        let row = &values[y * side..(y + 1) * side];
        framed.push(row[side - 1]);
        framed.extend_from_slice(row);
        framed.push(row[0]);
    }
    framed
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
    fn a_sample_is_the_mean_of_the_four_pixels_about_it_also_on_the_seam_and_beyond_the_ends() {
        for periodic in [false, true] {
            let image = Image::new(&wave(32), Flip::default(), periodic);
            let pixel = |x: i32, y: i32| {
                let y = if periodic { y.rem_euclid(32) } else { y.clamp(0, 31) };
                image.pixel(x.rem_euclid(32) as usize, y as usize)
            };
            for k in 0..300 {
                let (x, y) = (f64::from(k) * 0.37 - 40.0, f64::from(k) * 0.291 - 20.0);
                let (x0, y0, fx, fy) = (x.floor() as i32, y.floor() as i32, x - x.floor(), y - y.floor());
                let low = (1.0 - fx) * pixel(x0, y0) + fx * pixel(x0 + 1, y0);
                let high = (1.0 - fx) * pixel(x0, y0 + 1) + fx * pixel(x0 + 1, y0 + 1);
                let (value, gradient) = image.sample([(x + 0.5) / 32.0, (y + 0.5) / 32.0]);
                assert!((value - ((1.0 - fy) * low + fy * high)).abs() < 1e-12, "{x} {y}");
                assert!((gradient[1] - 32.0 * (high - low)).abs() < 1e-10, "{x} {y}");
            }
            assert!(image.sample([f64::NAN, f64::INFINITY]).0.is_nan());
        }
    }

    #[test]
    fn a_flip_mirrors_pixel_for_pixel() {
        let image = Image::new(&wave(32), Flip { u: true, v: false }, false);
        let plain = Image::new(&wave(32), Flip::default(), false);
        assert_eq!(image.pixel(0, 5), plain.pixel(31, 5));
    }
}
