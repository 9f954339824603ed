//! Faces without area are opened.
//!
//! Corners inside go to the mean of their neighbours, x_v ← (x_v + mean)/2, off the input if need be. Where many rows lie on
//! one line that does not suffice: there ever more rings around them move as well, since only the edge of the heap has
//! somewhere to go. *Ours, not the paper's.*

use super::check::quad_area;
use super::net::Net;
use crate::mesh::Vec3;

/// Rounds without and with rings around, at most, and after how many one ring more moves.
const ROUNDS: usize = 24;
const HEAP_ROUNDS: usize = 48;
const ROUNDS_PER_RING: usize = 8;

/// Opens the quads whose area is at most `least`; those that stay below `none`, which is less, with what is around them.
pub fn open_flat(net: &mut Net, least: f64, none: f64) {
    for _ in 0..ROUNDS {
        let moving = flat_corners(net, least);
        if moving.is_empty() {
            return;
        }
        relax(net, moving);
    }
    for round in 0..HEAP_ROUNDS {
        // A quad of which only one corner may move is not opened by moving others.
        let mut moving: Vec<u32> = flat_corners(net, none).into_iter().filter(|&v| !net.on_boundary(v)).collect();
        moving.retain(|&v| net.neighbours(v).iter().all(|&w| !net.on_boundary(w)));
        if moving.is_empty() {
            return;
        }
        for _ in 0..round / ROUNDS_PER_RING {
            let beside: Vec<u32> = moving.iter().flat_map(|&v| net.neighbours(v)).collect();
            moving.extend(beside);
            moving.sort_unstable();
            moving.dedup();
        }
        relax(net, moving);
    }
}

fn relax(net: &mut Net, moving: Vec<u32>) {
    for v in moving {
        if net.on_boundary(v) {
            continue;
        }
        let around = net.neighbours(v);
        let mean = around.iter().map(|&w| net.positions[w as usize]).sum::<Vec3>() / around.len().max(1) as f64;
        net.positions[v as usize] = 0.5 * (net.positions[v as usize] + mean);
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
        open_flat(&mut net, 1e-3, 1e-4);
        assert!(flat_corners(&net, 1e-4).is_empty());
        let border = (0..net.positions.len()).filter(|&v| net.on_boundary(v as u32));
        assert!(border.into_iter().all(|v| net.positions[v] == before[v]));
    }
}
