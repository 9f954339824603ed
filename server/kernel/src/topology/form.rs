//! How many of a surface's faces tell of its form.
//!
//! An example is laid on the form of a surface: on what its faces say of where it bends. A million needles around a vertex
//! say as little as a dozen triangles, and a strip, however long, as little as a piece of it. The share of the faces that
//! count is the product of three, each of which is 1 for what an artist made or a scanner saw:
//! - of needles: a face counts as the disc in it is of the disc about it, min(1, (q / q₀)²), with q = 4√3 A / Σ l² its
//!   quality, 1 where its sides are equal;
//! - of strips and sieves: with w = A / D the mean width of the surface (D its diagonal), faces count in so many squares of
//!   that width; so they do in squares of w = 4 A / L (L the length of its rims), the mean width between its rims;
//! - of noise: where most faces turn against their neighbours, those count that lie in pieces where they don't.
//!
//! So twice as many faces of the same form are worth the same work. *Ours, not the paper's.*

use crate::mesh::tri::{NONE, TriMesh, area_between};
use crate::mesh::{Vec3, diagonal};
use crate::numerics::stop;

use super::connected_across;

/// q₀: faces of less are needles. Of the scans that results are measured on at most .3 % are. *Untuned.*
const QUALITY_MIN: f64 = 0.1;
/// Squares of its mean width that a surface is worth at most, and of the mean width between its rims. The scans that results are
/// measured on have 1 to 4, those made of views, which are full of gaps, up to 38 by their rims (`service-2026-11-25c`).
/// *Untuned.*
const SQUARES: f64 = 5.0;
const SQUARES_BETWEEN_RIMS: f64 = 40.0;
/// cos 45°: neighbours that turn more do not go on in each other.
const GOES_ON: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Triangles of a piece that goes on. In noise whose slopes are 1 and more hardly a piece has as many. *Untuned.*
const PIECE_MIN: usize = 64;
/// Where this share of the triangles lies in such pieces, all count. Scans have .7, of a few faces, to 1. *Untuned.*
const MOST: f64 = 0.5;
/// Of fewer triangles, which may be all edges, each goes on.
const TRIANGLES_MIN: usize = 1024;

/// The share of a surface's faces that tell of its form, 0–1.
pub fn share_of_form(mesh: &TriMesh) -> f64 {
    stop::pass(mesh.triangles.len());
    round(mesh) * squares(mesh) * smooth(mesh)
}

/// The mean of what triangles are worth as needles.
fn round(mesh: &TriMesh) -> f64 {
    let worth = |&corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| mesh.positions[v as usize]);
        let sides = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
        let quality = 4.0 * 3f64.sqrt() * area_between([a, b, c]) / sides.max(f64::MIN_POSITIVE);
        (quality / QUALITY_MIN).min(1.0).powi(2)
    };
    mesh.triangles.iter().map(worth).sum::<f64>() / mesh.triangles.len().max(1) as f64
}

/// The share of its area that so many squares of its mean widths have.
fn squares(mesh: &TriMesh) -> f64 {
    let area = mesh.total_area();
    let place = |v: u32| mesh.positions[v as usize];
    let rim = |h: u32| (place(mesh.head(h)) - place(mesh.tail(h))).norm();
    let rims: f64 = (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE).map(rim).sum();
    let used = mesh.triangles.iter().flatten().map(|&v| &mesh.positions[v as usize]);
    let across = area / diagonal(used);
    let share = |squares: f64, width: f64| squares * width * width / area;
    // Of no area there is no width. A sum of nothing is -0.
    let of_rims = if rims > 0.0 { share(SQUARES_BETWEEN_RIMS, 4.0 * area / rims) } else { 1.0 };
    let share = share(SQUARES, across).min(of_rims);
    if share.is_finite() { share.min(1.0) } else { 0.0 }
}

/// The share of the triangles that lie in pieces that go on, or 1 where that is most.
fn smooth(mesh: &TriMesh) -> f64 {
    let count = mesh.triangles.len();
    if count < TRIANGLES_MIN {
        return 1.0;
    }
    let normal = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| mesh.positions[v as usize]);
        (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
    };
    let normals: Vec<Vec3> = mesh.triangles.iter().map(normal).collect();
    let goes_on = |a: u32, b: u32| normals[a as usize].dot(&normals[b as usize]) >= GOES_ON;
    let pieces = connected_across(mesh, goes_on);
    let within: usize = pieces.iter().map(Vec::len).filter(|&size| size >= PIECE_MIN).sum();
    let share = within as f64 / count as f64;
    if share >= MOST { 1.0 } else { share }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;
    use std::f64::consts::TAU;

    fn worth(mesh: &TriMesh) -> f64 {
        share_of_form(mesh) * mesh.triangles.len() as f64
    }

    fn fan(n: u32) -> TriMesh {
        let mut positions = vec![Vec3::zeros()];
        positions.extend((0..n).map(|i| TAU * f64::from(i) / f64::from(n)).map(|a| Vec3::new(a.cos(), a.sin(), 0.0)));
        TriMesh::from_triangles(positions, (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect()).expect("a fan")
    }

    /// A sheet of `columns` by `rows` cells, moved.
    fn sheet(columns: u32, rows: u32, at: impl Fn(usize, Vec3) -> Vec3) -> TriMesh {
        let mut mesh = grid(columns, rows, false, false);
        mesh.positions.iter_mut().enumerate().for_each(|(v, x)| *x = at(v, *x));
        mesh
    }

    #[test]
    fn a_sheet_a_ring_and_a_rolling_sheet_are_worth_all_their_faces() {
        assert_eq!(share_of_form(&sheet(30, 30, |_, x| x)), 1.0);
        assert_eq!(share_of_form(&sheet(30, 30, |_, x| Vec3::new(x.x, x.y, 0.2 * (9.0 * x.x).sin()))), 1.0);
        assert_eq!(share_of_form(&fan(12)), 1.0);
        assert_eq!(share_of_form(&grid(40, 20, true, true)), 1.0, "no rims");
    }

    #[test]
    fn needles_are_worth_the_less_the_more_there_are() {
        let [few, many] = [3_000, 30_000].map(|n| worth(&fan(n)));
        assert!(few < 16.0 && many < few, "{few} {many}");
        let flat = sheet(100, 100, |_, x| Vec3::new(x.x, 1e-6 * x.y, 0.0));
        assert!(worth(&flat) < 1.0);
    }

    #[test]
    fn a_strip_twice_as_long_is_worth_as_much() {
        let strip = |n: u32| sheet(n, 1, |_, x| Vec3::new(x.x * f64::from(n), x.y, 0.0));
        let [one, two] = [2_000, 4_000].map(|n| worth(&strip(n)));
        assert!((one - two).abs() < 0.01 * one && one < 16.0, "{one} {two}");
    }

    #[test]
    fn a_sieve_is_worth_little_and_a_sheet_with_a_few_holes_all() {
        let sieve = |every: usize| {
            let whole = grid(101, 101, false, false);
            let is_hole = |cell: usize| cell % 101 % every == 1 && cell / 101 % every == 1;
            let kept: Vec<u32> = (0..whole.triangles.len() as u32).filter(|&t| !is_hole(t as usize / 2)).collect();
            crate::topology::submesh(&whole, &kept).0
        };
        assert_eq!(share_of_form(&sieve(25)), 1.0);
        assert!(worth(&sieve(2)) < 1024.0, "{}", worth(&sieve(2)));
    }

    #[test]
    fn noise_is_worth_little_and_a_rough_surface_all() {
        let random = |v: usize| (v as f64 * 12.9898).sin() * 43_758.545_3;
        let noisy =
            |height: f64| sheet(60, 60, |v, x| Vec3::new(x.x, x.y, height / 60.0 * (random(v) - random(v).floor())));
        assert_eq!(share_of_form(&noisy(0.5)), 1.0);
        assert!(worth(&noisy(4.0)) < 256.0, "{}", worth(&noisy(4.0)));
    }
}
