//! Encoding: the conformal factor λ of a chart as a pyramid of pictures, its features, and the planar index that
//! leads back to the surface.
//!
//! λ = (3D area / total area) / (uv area). *Source:* paper §4.2.

pub mod features;
pub mod index;
pub mod raster;

use crate::topology::Topology;
use crate::unfold::Chart;
pub use features::Feature;

/// Pixels a side of the pyramid's levels, coarse to fine. *Source:* paper §5.2.
pub const LEVEL_SIDES: [usize; 5] = [32, 64, 128, 256, 512];
/// The last of them.
pub const SIDE_FINEST: usize = LEVEL_SIDES[LEVEL_SIDES.len() - 1];

/// Version of everything below [`Encoding`], and of what is kept beside it: stored encodings of another version are made anew.
pub const ENCODER_VERSION: u32 = 5;

/// A square picture over the domain: `values[row · side + column]`, rows along v from 0, columns along u.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Pixels a side.
    pub side: usize,
    /// Values, row by row.
    pub values: Vec<f32>,
}

impl Picture {
    /// The picture at half the side: the mean of each 2 × 2 pixels.
    pub fn halved(&self) -> Self {
        let side = self.side / 2;
        let at = |x: usize, y: usize| f64::from(self.values[y * self.side + x]);
        let mean = |x: usize, y: usize| {
            (0.25 * (at(2 * x, 2 * y) + at(2 * x + 1, 2 * y) + at(2 * x, 2 * y + 1) + at(2 * x + 1, 2 * y + 1))) as f32
        };
        let values = (0..side * side).map(|k| mean(k % side, k / side)).collect();
        Self { side, values }
    }

    /// Mean value.
    pub fn mean(&self) -> f64 {
        self.values.iter().map(|&x| f64::from(x)).sum::<f64>() / self.values.len().max(1) as f64
    }
}

/// The canonical encoding of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoding {
    /// What the surface is; only like topologies are compared.
    pub topology: Topology,
    /// Modulus (METHOD §2): .4 for a head.
    pub modulus: f64,
    /// λ at [`LEVEL_SIDES`], coarse to fine.
    pub pyramid: Vec<Picture>,
    /// Local maxima of λ, coarse levels first.
    pub features: Vec<Feature>,
}

impl Encoding {
    /// λ at a side of [`LEVEL_SIDES`].
    pub fn level(&self, side: usize) -> Option<&Picture> {
        self.pyramid.iter().find(|p| p.side == side)
    }
}

/// Encodes a chart.
pub fn encode(chart: &Chart) -> Encoding {
    encode_to(chart, SIDE_FINEST)
}

/// Encodes a chart with `finest` (a side of [`LEVEL_SIDES`]) as its finest level.
pub fn encode_to(chart: &Chart, finest: usize) -> Encoding {
    from_finest(raster::conformal_factor(chart, finest), chart.topology, chart.modulus)
}

/// The encoding of a surface whose finest level is `picture` (a side of [`LEVEL_SIDES`]).
pub fn from_finest(picture: Picture, topology: Topology, modulus: f64) -> Encoding {
    let mut pyramid = vec![picture];
    while let Some(last) = pyramid.last().filter(|p| p.side > LEVEL_SIDES[0]) {
        let next = last.halved();
        pyramid.push(next);
    }
    pyramid.reverse();
    let features = features::extract(&pyramid, topology);
    Encoding { topology, modulus, pyramid, features }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    #[test]
    fn the_mean_of_lambda_is_one_at_every_level() {
        for (u, v) in [(false, false), (true, false), (true, true)] {
            let patch = whole(&grid(24, 20, u, v)).expect("a primitive");
            let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
            for level in encode(&chart).pyramid {
                assert!((level.mean() - 1.0).abs() < 3e-8, "side {}: {}", level.side, level.mean());
            }
        }
    }

    #[test]
    fn a_straight_cylinder_has_a_flat_picture() {
        let patch = whole(&grid(64, 48, true, false)).expect("an annulus");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        let picture = &encode(&chart).pyramid[2];
        assert!(picture.values.iter().all(|x| (x - 1.0).abs() < 1e-3));
        assert_eq!(chart.report.uv_flips, 0);
    }
}
