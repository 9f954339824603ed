//! The picture of an encoding: λ through a perceptual colour map, its features as small circles.

use super::colour::perceptual;
use super::{Picture, SIDE_MAX};

/// Largest side of an encoding, in its own pixels.
const LEVEL_SIDE_MAX: usize = 512;
/// λ at the dark and at the bright end of the colour map, as powers of two. λ has mean 1, so 0 is the middle.
const LOG2_RANGE: f32 = 5.0;

/// Draws λ (mean 1; `side` × `side`, row after row, the row of v = 0 first and drawn at the bottom) on a log scale from
/// 1/32 (dark) to 32 (bright), `scale` pixels a value, and a circle at each feature (u, v in 0–1).
///
/// A λ shorter than `side`² is drawn as far as it goes; non-finite values count as the nearest end. `side` is
/// clamped to 512 and `scale` so that the picture stays within [`SIDE_MAX`].
pub fn encoding_picture(lambda: &[f32], side: usize, features: &[[f64; 2]], scale: u32) -> Picture {
    let side = side.clamp(1, LEVEL_SIDE_MAX);
    let scale = scale.clamp(1, SIDE_MAX / side as u32);
    let pixels = side as u32 * scale;
    let mut picture = Picture::filled(pixels, pixels, perceptual(0.0));
    for y in 0..pixels {
        let row = side - 1 - (y / scale) as usize;
        for x in 0..pixels {
            if let Some(&value) = lambda.get(row * side + (x / scale) as usize) {
                picture.set(x, y, perceptual(0.5 + 0.5 * value.max(1e-30).log2() / LOG2_RANGE));
            }
        }
    }
    let radius = (pixels as f32 / 90.0).max(2.0);
    for &[u, v] in features.iter().filter(|f| f.iter().all(|x| x.is_finite())) {
        let centre = ((u.rem_euclid(1.0) * f64::from(pixels)) as f32, ((1.0 - v) * f64::from(pixels)) as f32);
        super::caption::ring(&mut picture, centre, radius + 0.9, [10, 10, 14]);
        super::caption::ring(&mut picture, centre, radius, [255, 255, 255]);
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_row_lies_at_the_bottom_and_large_values_are_brightest() {
        let picture = encoding_picture(&[0.01, 1.0, 1.0, 100.0], 2, &[], 4);
        assert_eq!((picture.width(), picture.height()), (8, 8));
        assert_eq!(picture.pixel(0, 7), perceptual(0.0));
        assert_eq!(picture.pixel(7, 0), perceptual(1.0));
        assert_eq!(picture.pixel(0, 0), perceptual(0.5));
    }

    #[test]
    fn short_infinite_and_misplaced_input_is_survived() {
        let picture = encoding_picture(&[f32::NAN, f32::INFINITY], 3, &[[f64::NAN, 0.5], [7.2, -3.0]], 5000);
        assert_eq!(picture.width(), 3 * (SIDE_MAX / 3));
        encoding_picture(&[], 0, &[], 0);
    }

    #[test]
    fn a_feature_is_drawn_where_it_lies() {
        let flat = vec![1.0; 64 * 64];
        let (bare, marked) = (encoding_picture(&flat, 64, &[], 4), encoding_picture(&flat, 64, &[[0.25, 0.75]], 4));
        let changed = |x, y| bare.pixel(x, y) != marked.pixel(x, y);
        assert!((50..78).any(|x| changed(x, 64)));
        assert!(!(50..78).any(|x| changed(x, 192)), "v runs up, not down");
    }
}
