//! Colours: palettes in linear light, the sRGB curve, and the colour map of encodings.

/// What a picture is painted with. Background and clay are linear RGB, 0–1; lines and marks are sRGB bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Palette {
    /// Background at the top, linear.
    pub sky: [f32; 3],
    /// Background at the bottom, linear.
    pub floor: [f32; 3],
    /// Albedo of outer faces, linear.
    pub clay: [f32; 3],
    /// Albedo of outer faces that are not what is meant, linear.
    pub aside: [f32; 3],
    /// Albedo of faces seen from inside, linear.
    pub inside: [f32; 3],
    /// Polygon edges, linear.
    pub line: [f32; 3],
    /// Boundary edges, linear.
    pub rim: [f32; 3],
    /// Opacity of polygon edges, 0–1.
    pub line_opacity: f32,
}

impl Palette {
    /// Warm grey clay on a light background.
    pub const fn light() -> Self {
        Self {
            sky: [0.86, 0.87, 0.89],
            floor: [0.60, 0.60, 0.61],
            clay: [0.66, 0.60, 0.54],
            aside: [0.26, 0.29, 0.34],
            inside: [0.30, 0.33, 0.40],
            line: [0.025, 0.022, 0.03],
            rim: [0.45, 0.06, 0.02],
            line_opacity: 0.62,
        }
    }

    /// Warm grey clay on a dark background.
    pub const fn dark() -> Self {
        Self {
            sky: [0.050, 0.053, 0.060],
            floor: [0.018, 0.019, 0.022],
            clay: [0.62, 0.57, 0.52],
            aside: [0.10, 0.11, 0.13],
            inside: [0.17, 0.19, 0.24],
            line: [0.012, 0.011, 0.014],
            rim: [0.80, 0.22, 0.05],
            line_opacity: 0.66,
        }
    }

    /// Bluish clay on the light background: the input a query brings, beside the corpus' warm clay.
    pub const fn scan() -> Self {
        Self { clay: [0.45, 0.54, 0.62], line_opacity: 0.34, ..Self::light() }
    }
}

impl Default for Palette {
    fn default() -> Self {
        Self::light()
    }
}

/// Colour of the mark on a vertex of `valence` edges, sRGB; `None` where the vertex is regular.
pub(super) fn pole_colour(valence: u32) -> Option<[u8; 3]> {
    match valence {
        4 => None,
        0..=3 => Some([38, 96, 214]),
        5 => Some([226, 84, 28]),
        _ => Some([140, 46, 168]),
    }
}

/// Albedo of the faces of a segment, linear: hues a golden angle apart, so that numbers near each other differ.
pub(super) fn segment_albedo(label: i64) -> [f32; 3] {
    let hue = (label.rem_euclid(4096) as f32 * 0.618_034 + 0.08).fract() * 6.0;
    let value = if label.rem_euclid(3) == 1 { 0.50 } else { 0.72 };
    let channel = |shift: f32| {
        let x = ((hue + shift) % 6.0 - 3.0).abs() - 1.0;
        value * (0.22 + 0.78 * x.clamp(0.0, 1.0))
    };
    [channel(0.0), channel(4.0), channel(2.0)]
}

/// Linear light (0–1) to an sRGB byte.
pub(super) fn to_srgb(linear: f32) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (255.0 * y).round() as u8
}

/// Perceptual colour map from dark violet over green to yellow; `t` 0–1, values outside are clamped.
///
/// *Source:* the stops are samples of matplotlib's viridis (CC0).
pub(super) fn perceptual(t: f32) -> [u8; 3] {
    const STOPS: [[u8; 3]; 9] = [
        [68, 1, 84],
        [71, 44, 122],
        [59, 81, 139],
        [44, 113, 142],
        [33, 144, 141],
        [39, 173, 129],
        [92, 200, 99],
        [170, 220, 50],
        [253, 231, 37],
    ];
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) } * (STOPS.len() - 1) as f32;
    let k = (t as usize).min(STOPS.len() - 2);
    let f = t - k as f32;
    let mix = |c: usize| (f32::from(STOPS[k][c]) * (1.0 - f) + f32::from(STOPS[k + 1][c]) * f).round() as u8;
    [mix(0), mix(1), mix(2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_srgb_curve_keeps_its_ends_and_middle_grey() {
        assert_eq!((to_srgb(0.0), to_srgb(1.0), to_srgb(0.214)), (0, 255, 127));
        assert_eq!((to_srgb(-1.0), to_srgb(f32::INFINITY)), (0, 255));
    }

    #[test]
    fn the_colour_map_grows_brighter_all_the_way() {
        let brightness = |t: f32| {
            let [r, g, b] = perceptual(t).map(f32::from);
            0.21 * r + 0.72 * g + 0.07 * b
        };
        for k in 0..64 {
            assert!(brightness((k + 1) as f32 / 64.0) > brightness(k as f32 / 64.0), "at {k}");
        }
        assert_eq!(perceptual(f32::NAN), perceptual(0.0));
    }
}
