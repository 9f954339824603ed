//! Rings of columns, whose number may change from ring to ring, and the strips of quads between them.
//!
//! Between a ring of n columns and one of n − 2k lies a strip of n − k quads, k of them over two edges of the longer ring
//! and none of the shorter: each has one vertex of three edges there and one of five here, and nothing else is
//! extraordinary (3 : 1 transitions would make four). *Ours, not the paper's.*

/// A ring: where its columns stand, increasing over one period of u; and the number of its first vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ring {
    /// u of each column.
    pub columns: Vec<f64>,
    /// Its first vertex; the others follow.
    pub first: u32,
}

impl Ring {
    /// The vertex at a column, counted around.
    pub fn vertex(&self, column: usize) -> u32 {
        self.first + (column % self.columns.len().max(1)) as u32
    }

    fn u(&self, column: usize) -> f64 {
        let n = self.columns.len();
        self.columns[column % n] + (column / n) as f64
    }
}

/// The most columns of a ring beside one of n, and the fewest.
pub fn within_reach(n: usize, wanted: usize) -> usize {
    let wanted = wanted + (wanted + n) % 2;
    let least = n.div_ceil(2);
    let least = least + (least + n) % 2;
    wanted.clamp(least, if n.is_multiple_of(2) { 2 * n } else { 2 * n - 1 })
}

/// Whether place i of n is one of k evenly spread ones, turned by `turn`.
fn is_chosen(i: usize, n: usize, k: usize, turn: usize) -> bool {
    let x = (i + turn) % n;
    (x + 1) * k / n > x * k / n
}

/// The strip above a ring, to one of `count` columns whose first vertex is `first`; `turn` tells strips apart, so that
/// their transitions do not lie above each other. Gives the ring, its columns above those of the lower one, and pushes
/// the quads.
pub fn strip(lower: &Ring, count: usize, first: u32, turn: usize, quads: &mut Vec<Vec<u32>>) -> Ring {
    let n = lower.columns.len();
    let mut upper = Ring { columns: Vec::with_capacity(count), first };
    let top = |j: usize| first + (j % count) as u32;
    if count <= n {
        let k = (n - count) / 2;
        let mut p = 0;
        for i in 0..count {
            if is_chosen(i, count, k, turn) {
                quads.push(vec![lower.vertex(p), lower.vertex(p + 1), lower.vertex(p + 2), top(i)]);
                upper.columns.push(lower.u(p + 1));
                p += 2;
            } else {
                upper.columns.push(lower.u(p));
            }
            quads.push(vec![lower.vertex(p), lower.vertex(p + 1), top(i + 1), top(i)]);
            p += 1;
        }
    } else {
        let k = (count - n) / 2;
        let mut q = 0;
        for i in 0..n {
            let u = lower.u(i);
            if is_chosen(i, n, k, turn) {
                let (before, after) = (u - lower.u(i + n - 1) + 1.0, lower.u(i + 1) - u);
                quads.push(vec![lower.vertex(i), top(q + 2), top(q + 1), top(q)]);
                upper.columns.extend([u - before / 3.0, u, u + after / 3.0]);
                q += 2;
            } else {
                upper.columns.push(u);
            }
            quads.push(vec![lower.vertex(i), lower.vertex(i + 1), top(q + 1), top(q)]);
            q += 1;
        }
    }
    upper
}

/// Columns of rings between one of n and one of m, both given, of like parity: `ideal(r)` is wanted for ring r, and as
/// long as it is not missed by a factor of `slack` the number stays. Ring r + 1 is within reach of ring r.
pub fn counts(n: usize, m: usize, rings: usize, slack: f64, ideal: impl Fn(usize) -> f64) -> Vec<usize> {
    let follow = |now: usize, r: usize| {
        let wanted = ideal(r).max(1.0);
        let ratio = now as f64 / wanted;
        if ratio > slack || ratio < 1.0 / slack { within_reach(now, wanted.round() as usize) } else { now }
    };
    let mut up = vec![n];
    let mut down = vec![m];
    for r in 1..=rings {
        up.push(follow(up[r - 1], r));
        down.push(follow(down[r - 1], rings - r));
    }
    down.reverse();
    // Where the two come nearest to each other, one is left for the other.
    let apart = |r: &usize| up[*r].abs_diff(down[*r]);
    let middle = (rings / 4..=rings - rings / 4).min_by_key(apart).unwrap_or(0);
    let mut all: Vec<usize> = (0..=rings).map(|r| if r < middle { up[r] } else { down[r] }).collect();
    for r in (0..rings).rev() {
        all[r] = within_reach(all[r + 1], all[r]);
    }
    all[0] = n;
    for r in 1..rings {
        all[r] = within_reach(all[r - 1], all[r]);
    }
    all[rings] = m;
    all
}

/// Rings that are needed at least between one of n and one of m columns.
pub fn rings_min(n: usize, m: usize) -> usize {
    let (low, high) = (n.min(m).max(1) as f64, n.max(m) as f64);
    // Odd numbers double to one less, and small ones feel it.
    1 + 2 * ((high / low).log2().ceil() as usize) + usize::from(low < 6.0 && high > low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{TopologyCounts, check_structure, extraordinary};
    use crate::compose::net::Net;
    use crate::mesh::Vec3;

    fn tube(counts: &[usize]) -> Net {
        let mut ring = Ring { columns: (0..counts[0]).map(|i| i as f64 / counts[0] as f64).collect(), first: 0 };
        let (mut quads, mut vertices) = (Vec::new(), counts[0] as u32);
        for (r, &count) in counts.iter().enumerate().skip(1) {
            ring = strip(&ring, count, vertices, 3 * r, &mut quads);
            assert_eq!(ring.columns.len(), count);
            assert!(ring.columns.windows(2).all(|w| w[0] < w[1]), "{:?}", ring.columns);
            assert!(ring.columns[count - 1] < ring.columns[0] + 1.0);
            vertices += count as u32;
        }
        Net::new(vec![Vec3::zeros(); vertices as usize], quads)
    }

    #[test]
    fn a_transition_of_two_columns_makes_two_extraordinary_vertices() {
        for counts in [vec![12, 12, 10, 10], vec![10, 10, 12, 12], vec![16, 16, 10, 10, 16, 16], vec![9, 9, 7, 7]] {
            let mesh = tube(&counts).into_mesh().0;
            let annulus = TopologyCounts { components: 1, boundary_loops: 2, euler: 0 };
            assert_eq!(check_structure(&mesh, annulus), Ok(()), "{counts:?}");
            let changed: usize = counts.windows(2).map(|w| w[0].abs_diff(w[1])).sum();
            assert_eq!(extraordinary(&mesh), changed, "{counts:?}");
        }
    }

    #[test]
    fn any_two_numbers_of_like_parity_are_joined_within_the_rings_that_are_asked_for() {
        for n in 3..40 {
            for m in (3 + (n + 1) % 2..90).step_by(2) {
                let rings = rings_min(n, m);
                let all = counts(n, m, rings, 1.8, |_| 20.0);
                assert_eq!((all[0], all[rings]), (n, m));
                for w in all.windows(2) {
                    assert_eq!(w[1], within_reach(w[0], w[1]), "{n} to {m}: {all:?}");
                }
            }
        }
    }
}
