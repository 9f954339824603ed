//! Boxes that are turned as what is in them lies, for meshes of needles.
//!
//! A needle that lies across the axes fills nearly nothing of a box along them: at the hub of a fan of n triangles a point is
//! in the boxes of a quarter of all, and to find the closest takes n steps. A box along the needles, across them in the
//! surface, and along its normal is as thin as they are. It bounds the same distance from below, so that it changes what is
//! looked at, and never what is found. *Ours, not the paper's.*

use super::Vec3;

/// A triangle is a needle where its box along the axes has more than so many times the area that it has itself.
const NEEDLE: f64 = 32.0;
/// Turned boxes are made where more than this share of the triangles are needles.
const NEEDLES_MIN: f64 = 0.25;
/// Room for rounding, as a share of the coordinates, and of the bound.
const ROOM: f64 = 1e-12;

/// Tells whether many of the triangles are needles.
pub(super) fn has_needles(corners: &[[Vec3; 3]]) -> bool {
    corners.iter().filter(|corners| is_needle(corners)).count() as f64 > NEEDLES_MIN * corners.len() as f64
}

fn is_needle([a, b, c]: &[Vec3; 3]) -> bool {
    let size = a.sup(b).sup(c) - a.inf(b).inf(c);
    let of_box = size.x * size.y + size.y * size.z + size.z * size.x;
    let area = (b - a).cross(&(c - a)).norm();
    // What has no area has no normal for a turned box.
    area > 0.0 && of_box > NEEDLE * area
}

/// A box along axes of its own.
#[derive(Clone, Debug)]
pub(super) struct OrientedBox {
    /// Orthonormal.
    axes: [Vec3; 3],
    low: [f64; 3],
    high: [f64; 3],
}

impl OrientedBox {
    /// The box of some triangles: along their longest edges, across these, and along their normal. One that holds everything
    /// where they have no such direction.
    pub(super) fn of<'a>(triangles: impl Iterator<Item = &'a [Vec3; 3]> + Clone) -> Self {
        let (mut along, mut normal) = (Vec3::zeros(), Vec3::zeros());
        for [a, b, c] in triangles.clone() {
            let longest =
                [b - a, c - b, a - c].into_iter().max_by(|x, y| x.norm_squared().total_cmp(&y.norm_squared()));
            let longest = longest.unwrap_or_default();
            along += if longest.dot(&along) < 0.0 { -longest } else { longest };
            normal += (b - a).cross(&(c - a));
        }
        let axes = along.try_normalize(0.0).and_then(|along| {
            let across = normal.cross(&along).try_normalize(0.0)?;
            Some([along, across, along.cross(&across)])
        });
        let (mut low, mut high) = ([f64::NEG_INFINITY; 3], [f64::INFINITY; 3]);
        let Some(axes) = axes else { return Self { axes: [Vec3::zeros(); 3], low, high } };
        for (k, axis) in axes.iter().enumerate() {
            let ends = triangles.clone().flatten().map(|corner| corner.dot(axis));
            let ends = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
            let room = ROOM * ends.0.abs().max(ends.1.abs());
            (low[k], high[k]) = (ends.0 - room, ends.1 + room);
        }
        Self { axes, low, high }
    }

    /// A lower bound of the squared distance from a point to what is in the box.
    #[inline]
    pub(super) fn distance_squared(&self, point: &Vec3) -> f64 {
        let mut sum = 0.0;
        for k in 0..3 {
            let at = self.axes[k].dot(point);
            let outside = (self.low[k] - at).max(at - self.high[k]).max(0.0);
            sum += outside * outside;
        }
        sum * (1.0 - ROOM)
    }
}
