//! Faces without area are opened.
//!
//! Corners inside go to the mean of their neighbours, x_v ← (x_v + mean)/2, off the input if need be; while that does not
//! suffice, so do ever more rings around them: where many rows lie on one line, only the edge of the heap has somewhere to go.
//! *Ours, not the paper's.*

use super::check::quad_area;
use super::net::Net;
use crate::mesh::Vec3;

/// Rounds at most, and after how many one ring more moves.
const ROUNDS: usize = 64;
const ROUNDS_PER_RING: usize = 8;

/// Opens the quads whose area is at most `least`.
pub fn open_flat(net: &mut Net, least: f64) {
    for round in 0..ROUNDS {
        let mut moving = flat_corners(net, least);
        if moving.is_empty() {
            return;
        }
        for _ in 0..round / ROUNDS_PER_RING {
            let beside: Vec<u32> = moving.iter().flat_map(|&v| net.neighbours(v)).collect();
            moving.extend(beside);
            moving.sort_unstable();
            moving.dedup();
        }
        moving.retain(|&v| !net.on_boundary(v));
        for v in moving {
            let around = net.neighbours(v);
            let mean = around.iter().map(|&w| net.positions[w as usize]).sum::<Vec3>() / around.len().max(1) as f64;
            net.positions[v as usize] = 0.5 * (net.positions[v as usize] + mean);
        }
    }
}

/// The corners of the quads whose area is at most `least`, in order.
pub fn flat_corners(net: &Net, least: f64) -> Vec<u32> {
    let area = |c: &[u32]| match *c {
        [a, b, c, d] => quad_area([a, b, c, d].map(|v| net.positions[v as usize])),
        _ => f64::INFINITY,
    };
    let mut corners: Vec<u32> = net.faces().filter(|(_, c)| area(c) <= least).flat_map(|(_, c)| c.to_vec()).collect();
    corners.sort_unstable();
    corners.dedup();
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;

    #[test]
    fn rows_that_lie_on_one_line_are_opened_and_the_border_stays() {
        let mut net = sheet(12, 12);
        let before = net.positions.clone();
        for v in 0..net.positions.len() as u32 {
            let p = net.positions[v as usize];
            if !net.on_boundary(v) && (3.0..10.0).contains(&p.y) && (3.0..10.0).contains(&p.x) {
                net.positions[v as usize] = Vec3::new(6.0, p.y, 0.0);
            }
        }
        assert_eq!(flat_corners(&net, 1e-9).len(), 49);
        open_flat(&mut net, 1e-3);
        assert!(flat_corners(&net, 1e-3).is_empty());
        let border = (0..net.positions.len()).filter(|&v| net.on_boundary(v as u32));
        assert!(border.into_iter().all(|v| net.positions[v] == before[v]));
    }
}
