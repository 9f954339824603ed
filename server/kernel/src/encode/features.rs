//! Features: local maxima of λ, the protrusions that registration moves.
//!
//! *Source:* paper §5.2 (coarse to fine, ≥ 10 px apart, "a handful"). *Ours:* λ > 2 in place of 4, at most 20
//! (METHOD §3).

use super::Picture;
use crate::topology::Topology;
use crate::unfold::Uv;

/// Distance kept between features, in pixels of the level at which they are found. *Source:* paper §5.2.
const SPACING_PX: f64 = 10.0;
/// λ that a maximum must exceed (the paper has 4).
const LAMBDA_MIN: f32 = 2.0;
/// Features a surface has at most.
pub const FEATURES_MAX: usize = 20;

/// A local maximum of λ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Where, at a pixel's centre.
    pub uv: Uv,
    /// λ there, at its level.
    pub lambda: f32,
    /// Side of the level at which it was found; finer levels use it too.
    pub side: usize,
}

/// Extracts features from a pyramid, coarse to fine. Tori are periodic in v too.
pub fn extract(pyramid: &[Picture], topology: Topology) -> Vec<Feature> {
    let mut features: Vec<Feature> = Vec::new();
    for picture in pyramid {
        let mut peaks = maxima(picture, topology);
        peaks.sort_by(|a, b| b.lambda.total_cmp(&a.lambda));
        let spacing = SPACING_PX / picture.side as f64;
        for peak in peaks {
            if features.len() == FEATURES_MAX {
                return features;
            }
            if features.iter().all(|f| distance_on(topology, f.uv, peak.uv) >= spacing) {
                features.push(peak);
            }
        }
    }
    features
}

/// Distance in the domain, periodic in u.
pub fn distance(a: Uv, b: Uv) -> f64 {
    let du = (a[0] - b[0]).rem_euclid(1.0);
    du.min(1.0 - du).hypot(a[1] - b[1])
}

/// Distance in the domain of a surface, periodic as that is.
pub fn distance_on(topology: Topology, a: Uv, b: Uv) -> f64 {
    let rows = if topology.is_periodic_v() { (a[1] - b[1]).round() } else { 0.0 };
    distance(a, [b[0], b[1] + rows])
}

/// Pixels that exceed the threshold and no neighbour exceeds; of equal neighbours the first in reading order counts.
fn maxima(picture: &Picture, topology: Topology) -> Vec<Feature> {
    let side = picture.side as isize;
    let at = |x: isize, y: isize| picture.values[(y.rem_euclid(side) * side + x.rem_euclid(side)) as usize];
    let ends = |y: isize| !topology.is_periodic_v() && (y < 0 || y >= side);
    let mut peaks = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let value = at(x, y);
            if value <= LAMBDA_MIN {
                continue;
            }
            let highest = (-1..=1).all(|dy| {
                (-1..=1).all(|dx| {
                    let (nx, ny) = (x + dx, y + dy);
                    let earlier = (dy, dx) < (0, 0);
                    ends(ny) || (dx, dy) == (0, 0) || {
                        let other = at(nx, ny);
                        other < value || (other == value && !earlier)
                    }
                })
            });
            if highest {
                let uv = [(x as f64 + 0.5) / side as f64, (y as f64 + 0.5) / side as f64];
                peaks.push(Feature { uv, lambda: value, side: picture.side });
            }
        }
    }
    peaks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_are_found_once_also_across_the_seam() {
        let side = 64;
        let bump = |x: usize, y: usize, cx: f64, cy: f64| {
            let du = (x as f64 + 0.5 - cx).rem_euclid(64.0);
            let d2 = du.min(64.0 - du).powi(2) + (y as f64 + 0.5 - cy).powi(2);
            5.0 * (-d2 / 8.0).exp()
        };
        let values = (0..side * side)
            .map(|k| (bump(k % side, k / side, 0.2, 20.5) + bump(k % side, k / side, 32.5, 40.5)) as f32)
            .collect();
        let features = extract(&[Picture { side, values }], Topology::Annulus);
        assert_eq!(features.len(), 2);
        assert!(features.iter().any(|f| distance(f.uv, [0.2 / 64.0, 20.5 / 64.0]) < 1.0 / 64.0));
    }

    #[test]
    fn on_a_torus_a_peak_on_the_seam_of_v_is_one() {
        let side = 32;
        let rise = |y: usize| (y as f64 + 0.5).min(32.0 - y as f64 - 0.5);
        let values = (0..side * side)
            .map(|k| {
                let (x, y) = ((k % side) as f64 - 15.7, rise(k / side));
                (5.0 * (-(x * x + y * y) / 9.0).exp()) as f32
            })
            .collect();
        let picture = [Picture { side, values }];
        assert_eq!(extract(&picture, Topology::Torus).len(), 1);
        assert_eq!(extract(&picture, Topology::Annulus).len(), 2);
    }
}
