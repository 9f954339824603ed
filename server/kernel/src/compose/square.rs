//! Sheared quads are made squarer: each is drawn to the rectangle with its diagonals' directions and their mean length.
//!
//! A quad whose diagonals halve each other and are alike in length is a rectangle, whatever the angle between them. With
//! c the mean of its corners and d₀, d₁ its diagonals, corner 0 is drawn to c − r·d₀/|d₀|, r = (|d₀| + |d₁|)/4, and so on
//! around; a vertex goes to the mean of what its quads ask for, and back onto the input. Vertices whose quads are good stay,
//! so that a layout keeps what its artist made of it. Unlike the mean of the neighbours this does not shrink.
//! *Ours, not the paper's.*

use super::net::Net;
use super::resolve::deviations_deg;
use super::smooth::Target;
use crate::mesh::Vec3;

/// Mean deviation from right angles at a vertex up to which it stays, and from which on it goes all the way, in degrees.
const STAYS_DEG: f64 = 15.0;
const GOES_DEG: f64 = 35.0;
/// Part of the way that is gone a round, and the share of the neighbours' mean in it.
const STEP: f64 = 0.6;
const MEAN_SHARE: f64 = 0.15;
/// Share of its last move that a vertex goes again before it is asked: a shear that runs through many quads is gone sooner.
const MOMENTUM: f64 = 0.8;
/// Rounds after which the weights are taken anew.
const ROUNDS_PER_WEIGHT: u32 = 8;

/// Mean deviation of a quad's angles from 90°, in degrees; an angle at an edge without length counts 90.
pub fn deviation_deg(p: [Vec3; 4]) -> f64 {
    deviations_deg(p).into_iter().map(|d| d.unwrap_or(90.0)).sum::<f64>() / 4.0
}

fn corners(net: &Net, face: &[u32]) -> Option<[Vec3; 4]> {
    let &[a, b, c, d] = face else { return None };
    Some([a, b, c, d].map(|v| net.positions[v as usize]))
}

/// Mean deviation over a net's quads, in degrees.
pub fn mean_deviation_deg(net: &Net) -> f64 {
    let (sum, count) = net
        .faces()
        .filter_map(|(_, face)| corners(net, face))
        .fold((0.0, 0.0), |(sum, count), p| (sum + deviation_deg(p), count + 1.0));
    sum / f64::max(count, 1.0)
}

/// Goes `rounds` rounds; vertices on the true boundary stay.
pub fn square_up(net: &mut Net, target: &Target, rounds: u32) {
    let mut moving: Vec<Moving> = Vec::new();
    for round in 0..rounds {
        if round % ROUNDS_PER_WEIGHT == 0 {
            moving = weights(net);
        }
        let before: Vec<Vec3> = moving.iter().map(|m| net.positions[m.vertex as usize]).collect();
        moving.iter().for_each(|m| net.positions[m.vertex as usize] += m.last * MOMENTUM);
        let asked = asked_for(net);
        for (m, old) in moving.iter_mut().zip(&before) {
            let (sum, count) = asked[m.vertex as usize];
            let here = net.positions[m.vertex as usize];
            let beside = &m.beside;
            let mean = beside.iter().map(|&w| net.positions[w as usize]).sum::<Vec3>() / beside.len().max(1) as f64;
            let to = if count > 0.0 { sum / count * (1.0 - MEAN_SHARE) + mean * MEAN_SHARE } else { here };
            m.to = target.onto_surface(here + (to - here) * (STEP * m.weight));
            m.last = m.to - old;
        }
        moving.iter().for_each(|m| net.positions[m.vertex as usize] = m.to);
    }
}

/// A vertex that may move.
struct Moving {
    vertex: u32,
    weight: f64,
    beside: Vec<u32>,
    /// Where it goes in this round, and by how much it went in the last.
    to: Vec3,
    last: Vec3,
}

/// The vertices that may move, with their weights.
fn weights(net: &Net) -> Vec<Moving> {
    let mut sums = vec![(0.0, 0.0); net.positions.len()];
    for (_, face) in net.faces() {
        let Some(p) = corners(net, face) else { continue };
        let deviation = deviation_deg(p);
        for &v in face {
            sums[v as usize].0 += deviation;
            sums[v as usize].1 += 1.0;
        }
    }
    let weight =
        |(sum, count): (f64, f64)| ((sum / f64::max(count, 1.0) - STAYS_DEG) / (GOES_DEG - STAYS_DEG)).clamp(0.0, 1.0);
    let all = (0..net.positions.len() as u32).map(|v| (v, weight(sums[v as usize])));
    let moving = |(vertex, weight): (u32, f64)| Moving {
        vertex,
        weight,
        beside: net.neighbours(vertex),
        to: Vec3::zeros(),
        last: Vec3::zeros(),
    };
    all.filter(|&(v, w)| w > 0.0 && !net.on_boundary(v)).map(moving).collect()
}

/// For each vertex the sum of what its quads ask for, and how many they are.
fn asked_for(net: &Net) -> Vec<(Vec3, f64)> {
    let mut sums = vec![(Vec3::zeros(), 0.0); net.positions.len()];
    for (_, face) in net.faces() {
        let Some(p) = corners(net, face) else { continue };
        let centre = (p[0] + p[1] + p[2] + p[3]) / 4.0;
        let diagonals = [p[2] - p[0], p[3] - p[1]];
        let lengths = diagonals.map(|d| d.norm());
        if lengths[0] <= 0.0 || lengths[1] <= 0.0 {
            continue;
        }
        let r = (lengths[0] + lengths[1]) / 4.0;
        for k in 0..4 {
            let along = diagonals[k % 2] * (r / lengths[k % 2]);
            let sum = &mut sums[face[k] as usize];
            sum.0 += if k < 2 { centre - along } else { centre + along };
            sum.1 += 1.0;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    fn flat(n: u32) -> (Net, Target) {
        let mut net = sheet(n, n);
        net.positions.iter_mut().for_each(|p| *p /= f64::from(n));
        (net, Target::new(&grid(12, 12, false, false)))
    }

    #[test]
    fn sheared_quads_become_squarer_and_square_ones_stay() {
        let (mut net, target) = flat(10);
        let before = net.positions.clone();
        square_up(&mut net, &target, 10);
        assert_eq!(net.positions, before);
        for v in 0..121u32 {
            if !net.on_boundary(v) {
                net.positions[v as usize].x += 0.07 * f64::from(v / 11 % 2 * 2) - 0.07;
            }
        }
        let sheared = mean_deviation_deg(&net);
        square_up(&mut net, &target, 40);
        assert!(mean_deviation_deg(&net) < 0.5 * sheared, "{sheared} to {}", mean_deviation_deg(&net));
        assert!((0..121u32).all(|v| !net.on_boundary(v) || net.positions[v as usize] == before[v as usize]));
    }
}
