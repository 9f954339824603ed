//! Labels with smooth borders.
//!
//! Each label's indicator is diffused a few steps and the largest wins, again and again: borders move by their
//! curvature, straighten, and meet at equal angles, and necks pull themselves tight. *Source:* Merriman, Bence and Osher
//! (1994), threshold dynamics. Only a band along the borders is touched.

use crate::mesh::tri::TriMesh;
use crate::numerics::stop;

/// How strongly borders are smoothed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Strength {
    /// How often the largest wins.
    pub(super) rounds: usize,
    /// Steps of diffusion between.
    pub(super) steps: usize,
}

/// The shares of the labels at a vertex, by label; they sum to 1.
pub(super) type Shares = Vec<(u32, f64)>;

/// The shares of the labels at each vertex after smoothing.
pub(super) fn smooth(mesh: &TriMesh, label_of: &[u32], strength: Strength) -> Vec<Shares> {
    let neighbours = mesh.neighbours();
    let mut shares = indicators(mesh, label_of);
    for round in 0..strength.rounds {
        if round > 0 {
            shares = shares.iter().map(|s| vec![(winner(s), 1.0)]).collect();
        }
        let band = band(&shares, &neighbours, strength.steps);
        for _ in 0..strength.steps {
            stop::ask();
            let next: Vec<Shares> = band.iter().map(|&v| averaged(v, &shares, &neighbours)).collect();
            band.iter().zip(next).for_each(|(&v, s)| shares[v as usize] = s);
        }
    }
    shares
}

/// The label with the largest share; the lower of two equal ones.
pub(super) fn winner(shares: &Shares) -> u32 {
    let best = |a: &(u32, f64), b: &(u32, f64)| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0));
    shares.iter().copied().max_by(best).map_or(0, |s| s.0)
}

/// Shares by the area of the triangles at each vertex.
fn indicators(mesh: &TriMesh, label_of: &[u32]) -> Vec<Shares> {
    let mut shares: Vec<Shares> = vec![Vec::new(); mesh.positions.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let area = mesh.area(t).max(1e-300);
        stop::pass(1);
        corners.iter().for_each(|&v| add(&mut shares[v as usize], label_of[t], area));
    }
    shares.iter_mut().for_each(normalise);
    shares
}

fn add(shares: &mut Shares, label: u32, weight: f64) {
    match shares.iter_mut().find(|s| s.0 == label) {
        Some(share) => share.1 += weight,
        None => shares.push((label, weight)),
    }
}

fn normalise(shares: &mut Shares) {
    shares.sort_by_key(|s| s.0);
    let sum: f64 = shares.iter().map(|s| s.1).sum();
    shares.iter_mut().for_each(|s| s.1 /= sum.max(1e-300));
}

/// Vertices within `steps` + 1 edges of one with several labels or a neighbour of another label.
fn band(shares: &[Shares], neighbours: &[Vec<u32>], steps: usize) -> Vec<u32> {
    let mixed = |v: usize| {
        shares[v].len() > 1 || neighbours[v].iter().any(|&w| winner(&shares[w as usize]) != winner(&shares[v]))
    };
    let mut inside: Vec<bool> = (0..shares.len()).map(mixed).collect();
    let mut band: Vec<u32> = (0..shares.len() as u32).filter(|&v| inside[v as usize]).collect();
    let mut front = 0;
    for _ in 0..=steps {
        let end = band.len();
        for k in front..end {
            for &w in &neighbours[band[k] as usize] {
                if !std::mem::replace(&mut inside[w as usize], true) {
                    band.push(w);
                }
            }
        }
        front = end;
    }
    band
}

fn averaged(v: u32, shares: &[Shares], neighbours: &[Vec<u32>]) -> Shares {
    let around = &neighbours[v as usize];
    let mut sum = Vec::new();
    for &(label, share) in &shares[v as usize] {
        add(&mut sum, label, share * around.len().max(1) as f64);
    }
    for &w in around {
        shares[w as usize].iter().for_each(|&(label, share)| add(&mut sum, label, share));
    }
    normalise(&mut sum);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_zigzag_border_becomes_straight() {
        let mesh = grid(40, 40, false, false);
        let label = |t: usize| {
            let (i, j) = ((t / 2) % 40, (t / 2) / 40);
            u32::from(j + (i / 2) % 3 >= 21)
        };
        let labels: Vec<u32> = (0..mesh.triangles.len()).map(label).collect();
        let shares = smooth(&mesh, &labels, Strength { rounds: 3, steps: 12 });
        let heights: Vec<f64> = (0..mesh.positions.len())
            .filter(|&v| winner(&shares[v]) == 1)
            .map(|v| mesh.positions[v])
            .filter(|p| (0.1..0.9).contains(&p.x))
            .map(|p| p.y)
            .collect();
        let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
        let above = |y: f64| heights.iter().filter(|h| (**h - y).abs() < 1e-9).count();
        assert!(above(lowest + 0.025) >= 32, "{} of 33 in the second row", above(lowest + 0.025));
    }
}
