//! A regular layout comes to rest: its vertices slide along the surface until its quads are squares of like size.
//!
//! Where a chart is small, on a protrusion or at the far end of a band, a layout drawn in the chart has few and large quads,
//! and passes over what is there; elsewhere it has more than it needs. Each quad would be a square of the mean size, as
//! four triangles, two along each diagonal, in the energy of [`polish`](crate::map::polish). What stands on the boundary
//! stays. *Ours, not the paper's.*

use crate::compose::check::quad_area_vector;
use crate::compose::net::Net;
use crate::compose::smooth::Target;
use crate::map::CrossMap;
use crate::map::polish::{Faces, PolishOptions, settle};
use crate::mesh::Vec3;
use crate::unfold::Chart;

/// Rounds; quads have to pass many others.
const ROUNDS: usize = 30;
/// How far a quad may keep the size that it has: corners of a layout and tips of the surface need some of it.
const SIZE_FREEDOM: f64 = 0.6;
/// The triangles of a quad, as its corners.
const TRIANGLES: [[usize; 3]; 4] = [[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]];
const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// Evens out a net of quads on the surface of a chart, whose `target` is made of the same mesh.
pub fn even_out(net: &mut Net, chart: &Chart, target: &Target) {
    let quads: Vec<[u32; 4]> = net.faces().filter_map(|(_, corners)| corners.try_into().ok()).collect();
    if quads.is_empty() {
        return;
    }
    let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|q| TRIANGLES.map(|t| t.map(|k| q[k]))).collect();
    let (locations, fixed): (Vec<_>, Vec<bool>) = (0..net.positions.len() as u32)
        .map(|v| (target.location(net.positions[v as usize]), net.at(v).is_empty() || net.on_boundary(v)))
        .unzip();
    let turn = way(net, &quads, chart, target);
    let rest = quads.iter().flat_map(|_| TRIANGLES.map(|t| t.map(|k| [SQUARE[k][0], turn * SQUARE[k][1]]))).collect();
    let positions = locations.iter().map(|l| l.point(chart)).collect();
    let mut cross = CrossMap { locations, positions };
    let options = PolishOptions { rounds: ROUNDS, anchor: 0.0, size_freedom: SIZE_FREEDOM, ..PolishOptions::default() };
    let faces =
        Faces { triangles: &triangles, rest, heights: Vec::new(), fixed: fixed.clone(), area: quads.len() as f64 };
    settle(faces, &mut cross, chart, &options);
    for (v, p) in cross.positions.into_iter().enumerate().filter(|(v, _)| !fixed[*v]) {
        net.positions[v] = p;
    }
}

/// 1 if most quads are turned as the surface beneath them is, −1 if against it.
fn way(net: &Net, quads: &[[u32; 4]], chart: &Chart, target: &Target) -> f64 {
    let sum: f64 = quads
        .iter()
        .map(|q| {
            let p = q.map(|v| net.positions[v as usize]);
            let below = target.triangle(p.iter().sum::<Vec3>() / 4.0) as usize;
            let normal = chart.mesh.area_vector(below).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
            quad_area_vector(p).dot(&normal)
        })
        .sum();
    if sum < 0.0 { -1.0 } else { 1.0 }
}

/// Mean over the area of |log₂| of a quad's edge to the one wanted, given the quads' areas.
pub fn unevenness(areas: &[f64], edge: f64) -> f64 {
    let sum: f64 = areas.iter().sum();
    let of = |a: &f64| a * (a.sqrt() / edge).log2().abs();
    if sum > 0.0 && edge > 0.0 { areas.iter().filter(|a| **a > 0.0).map(of).sum::<f64>() / sum } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    const SIDE: u32 = 10;

    /// A net on a sheet, its inner vertices crowded into one corner; the same with its faces turned over.
    fn crowded(is_turned: bool) -> (Net, Chart, Target) {
        let chart =
            unfold(&whole(&grid(31, 31, false, false)).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let mut net = sheet(SIDE, SIDE);
        net.positions.iter_mut().for_each(|p| *p /= f64::from(SIDE));
        for v in (0..net.positions.len() as u32).filter(|&v| !net.on_boundary(v)).collect::<Vec<_>>() {
            net.positions[v as usize] = net.positions[v as usize].map(|x| x.powf(1.7));
        }
        let faces: Vec<(u32, Vec<u32>)> = net.faces().map(|(f, c)| (f, c.iter().rev().copied().collect())).collect();
        if is_turned {
            faces.into_iter().for_each(|(f, c)| net.set_face(f, c));
        }
        let target = Target::new(&chart.mesh);
        (net, chart, target)
    }

    fn areas(net: &Net) -> Vec<f64> {
        let diagonals = |c: &[u32]| {
            let p = |k: usize| net.positions[c[k] as usize];
            0.5 * (p(2) - p(0)).cross(&(p(3) - p(1))).norm()
        };
        net.faces().map(|(_, c)| diagonals(c)).collect()
    }

    #[test]
    fn crowded_vertices_spread_until_quads_are_alike_whichever_way_they_are_turned() {
        for is_turned in [false, true] {
            let (mut net, chart, target) = crowded(is_turned);
            let before = (net.positions.clone(), unevenness(&areas(&net), 1.0 / f64::from(SIDE)));
            even_out(&mut net, &chart, &target);
            let after = unevenness(&areas(&net), 1.0 / f64::from(SIDE));
            assert!(before.1 > 0.3 && after < 0.03, "{} to {after}", before.1);
            let stays = |v: &u32| net.positions[*v as usize] == before.0[*v as usize];
            assert!((0..net.positions.len() as u32).filter(|&v| net.on_boundary(v)).all(|v| stays(&v)));
        }
    }

    #[test]
    fn quads_as_wanted_have_no_unevenness_and_edges_twice_as_long_have_one() {
        assert_eq!(
            (unevenness(&[4.0, 4.0], 2.0), unevenness(&[], 2.0), unevenness(&[16.0, 1.0], 2.0)),
            (0.0, 0.0, 1.0)
        );
    }
}
