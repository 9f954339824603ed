//! Which vertices on the two sides of an arc are merged, so that rows of quads go through where counts allow.
//!
//! Both sides are rows of vertices along one curve. A matching is a row of blocks: p edges of one side against one edge
//! of the other. p = 1 closes; p = 2 leaves a triangle; at p = 3 two edges are folded together, which makes two extraordinary
//! vertices; larger p several times that.
//! The cheapest row of blocks is found by dynamic programming, where a block costs the extraordinary vertices that it
//! makes and a merged pair the square of what it slides along the curve:
//!
//! C(i, j) = min over p of C(i − p, j − 1), C(i − 1, j − p) + block(p) + w·((s_i − t_j)/h)² + (val(i, j) − 4)²,
//!
//! val(i, j) the number of edges that the merged vertex has, so that corners of one side meet no corners of the other.
//!
//! *Ours, not the paper's,* which merges nearest pairs greedily.

/// The most edges that a block may have on its longer side.
pub const BLOCK_MAX: usize = 27;
/// Weight of a pair's slide by one edge of the coarser side.
const SLIDE_WEIGHT: f64 = 0.05;
/// Cost of an extraordinary vertex.
const EXTRAORDINARY_COST: f64 = 1.0;
/// Cost of a triangle beside the extraordinary vertices that it makes: it has to be resolved with another, far away.
const TRIANGLE_COST: f64 = 12.0;
/// Largest table that is searched as a whole; beyond, a band around the places with like lengths.
const TABLE_MAX: usize = 400_000;
/// Half-width of the band, beside the difference of the counts.
const BAND: usize = 40;
/// First pairs that are tried on a closed arc, to either side of the nearest.
const SHIFTS: usize = 8;

/// Pairs of places (on the first, on the second side) that are merged, in order along the arc.
pub type Pairs = Vec<(usize, usize)>;

/// A row of vertices on one side of an arc.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ArcRow {
    /// Length along the arc up to each.
    pub at: Vec<f64>,
    /// Edges that each has in its part.
    pub edges: Vec<u32>,
}

impl ArcRow {
    /// Of n + 1 vertices of an open row, n edges.
    fn count(&self) -> Option<usize> {
        self.at.len().min(self.edges.len()).checked_sub(1)
    }

    /// A closed row opened at a vertex, which comes again at the end, a period further; lengths from that vertex.
    fn opened(&self, first: usize, length: f64) -> Self {
        let n = self.at.len();
        let mut at: Vec<f64> = (0..n).map(|k| (self.at[(first + k) % n] - self.at[first]).rem_euclid(length)).collect();
        at.push(length);
        Self { at, edges: (0..=n).map(|k| self.edges[(first + k) % n]).collect() }
    }
}

/// What a merged pair costs beside its slide: both edges along the arc become shared.
fn pair_cost(a: u32, b: u32) -> f64 {
    let off = f64::from(a) + f64::from(b) - 6.0;
    EXTRAORDINARY_COST * off * off
}

/// What a block of p against one costs.
fn block_cost(p: usize) -> f64 {
    let quads = (p - 1) / 2;
    let triangles = (p - 1) % 2;
    // Several 3 : 1 blocks beside each other are better shaped than one of many edges against one.
    let crowding = 1.0 + 0.5 * quads.saturating_sub(1) as f64;
    2.0 * EXTRAORDINARY_COST * quads as f64 * crowding + triangles as f64 * (2.0 * EXTRAORDINARY_COST + TRIANGLE_COST)
}

/// Matches two rows that begin together and end together. `None` if one has more than [`BLOCK_MAX`] times the edges.
pub fn match_open(s: &ArcRow, t: &ArcRow) -> Option<(f64, Pairs)> {
    let (n, m) = (s.count()?, t.count()?);
    if n == 0 || m == 0 {
        return None;
    }
    let length = (s.at[n] - s.at[0]).abs().max(f64::MIN_POSITIVE);
    let h = length / n.min(m) as f64;
    let p_max = block_max(n, m);
    let whole = (n + 1) * (m + 1) <= TABLE_MAX;
    let band = BAND + 2 * n.abs_diff(m).min(BAND);
    let range = |i: usize| {
        let middle = t.at.partition_point(|&x| x - t.at[0] < s.at[i] - s.at[0]);
        if whole { (0, m) } else { (middle.saturating_sub(band), (middle + band).min(m)) }
    };
    let width = if whole { m + 1 } else { 2 * band + 1 };
    let mut cost = vec![f64::INFINITY; (n + 1) * width];
    let mut from = vec![(0u8, 0u8); (n + 1) * width];
    let low: Vec<usize> = (0..=n).map(|i| range(i).0).collect();
    let index = |i: usize, j: usize| j.checked_sub(low[i]).filter(|d| *d < width).map(|d| i * width + d);
    if let Some(k) = index(0, 0) {
        cost[k] = 0.0;
    }
    for i in 1..=n {
        for j in range(i).0.max(1)..=range(i).1 {
            let Some(here) = index(i, j) else { continue };
            let slide = (s.at[i] - s.at[0] - t.at[j] + t.at[0]) / h;
            let pair = SLIDE_WEIGHT * slide * slide + pair_cost(s.edges[i], t.edges[j]);
            let mut best = (f64::INFINITY, (0, 0));
            for p in 1..=p_max {
                for (a, b) in [(p, 1), (1, p)] {
                    let (Some(x), Some(y)) = (i.checked_sub(a), j.checked_sub(b)) else { continue };
                    let Some(k) = index(x, y) else { continue };
                    let sum = cost[k] + block_cost(p) + pair;
                    if sum < best.0 {
                        best = (sum, (a as u8, b as u8));
                    }
                }
            }
            (cost[here], from[here]) = best;
        }
    }
    let total = index(n, m).map(|k| cost[k]).filter(|c| c.is_finite())?;
    let (mut i, mut j) = (n, m);
    let mut pairs = vec![(n, m)];
    while (i, j) != (0, 0) {
        let (a, b) = from[index(i, j)?];
        if a == 0 {
            return None;
        }
        i -= a as usize;
        j -= b as usize;
        pairs.push((i, j));
    }
    pairs.reverse();
    Some((total, pairs))
}

/// Blocks no longer than the counts ask for.
fn block_max(n: usize, m: usize) -> usize {
    let ratio = n.max(m).div_ceil(n.min(m));
    (3 * ratio).clamp(3, BLOCK_MAX)
}

/// Matches two closed rows of vertices with lengths from a common point of a curve of `length`. The first pair comes again
/// at the end, with places beyond the counts.
pub fn match_closed(s: &ArcRow, t: &ArcRow, length: f64) -> Option<(f64, Pairs)> {
    let (n, m) = (s.at.len(), t.at.len());
    if n == 0 || m == 0 {
        return None;
    }
    // A vertex of the coarser side is always merged: start with its first.
    if n > m {
        let (cost, pairs) = match_closed(t, s, length)?;
        return Some((cost, pairs.into_iter().map(|(a, b)| (b, a)).collect()));
    }
    let off = |j: usize| {
        let d = t.at[j] - s.at[0];
        d - length * (d / length).round()
    };
    let nearest = (0..m).min_by(|&a, &b| off(a).abs().total_cmp(&off(b).abs()))?;
    let one = s.opened(0, length);
    let reach = SHIFTS.min(m / 2);
    let mut best: Option<(f64, Pairs)> = None;
    for j0 in (0..=2 * reach).map(|d| (nearest + m + d - reach) % m) {
        let two = t.opened(j0, length);
        let Some((cost, pairs)) = match_open(&one, &two) else { continue };
        // The search took the first pair to be together: Σ(d − c)² − Σd² over the pairs, for their common slide c.
        let h = length / n as f64;
        let c = off(j0) / h;
        let slides = pairs[1..].iter().map(|&(i, j)| (one.at[i] - two.at[j]) / h);
        let extra: f64 = slides.map(|d| (d - c).powi(2) - d * d).sum();
        let cost = cost + SLIDE_WEIGHT * extra;
        if best.as_ref().is_none_or(|b| cost < b.0) {
            best = Some((cost, pairs.into_iter().map(|(a, b)| (a, b + j0)).collect()));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(n: usize, length: f64, offset: f64) -> ArcRow {
        ArcRow { at: (0..n).map(|k| offset + length * k as f64 / n as f64).collect(), edges: vec![3; n] }
    }

    fn blocks(pairs: &Pairs) -> Vec<(usize, usize)> {
        pairs.windows(2).map(|w| (w[1].0 - w[0].0, w[1].1 - w[0].1)).collect()
    }

    #[test]
    fn equal_counts_are_merged_one_to_one_at_the_nearest_shift() {
        let (s, t) = (even(24, 6.0, 0.1), even(24, 6.0, 0.1 + 0.25 * 7.2));
        let (_, pairs) = match_closed(&s, &t, 6.0).expect("matched");
        assert_eq!(pairs.len(), 25);
        assert!(blocks(&pairs).iter().all(|b| *b == (1, 1)));
        assert_eq!((pairs[0].1 + 24 - pairs[0].0) % 24, 24 - 7);
    }

    #[test]
    fn even_differences_need_no_triangle_and_odd_ones_need_one() {
        for (n, m) in [(20, 16), (16, 20), (31, 30), (40, 20), (12, 36), (9, 40)] {
            let (_, pairs) = match_closed(&even(n, 1.0, 0.0), &even(m, 1.0, 0.013), 1.0).expect("matched");
            let odd = blocks(&pairs).iter().filter(|(a, b)| (a + b) % 2 == 1).count();
            assert_eq!(odd, (n + m) % 2, "{n} against {m}: {:?}", blocks(&pairs));
            let (a, b) = blocks(&pairs).iter().fold((0, 0), |x, y| (x.0 + y.0, x.1 + y.1));
            assert_eq!((a, b), (n, m));
        }
    }

    #[test]
    fn corners_make_way_for_each_other() {
        let (mut s, mut t) = (even(24, 6.0, 0.1), even(24, 6.0, 0.1));
        for k in [0, 6, 12, 18] {
            (s.edges[k], t.edges[k]) = (2, 2);
        }
        let (_, pairs) = match_closed(&s, &t, 6.0).expect("matched");
        assert!(blocks(&pairs).iter().all(|b| *b == (1, 1)));
        assert!(matches!((pairs[0].1 + 24 - pairs[0].0) % 24, 1 | 23));
    }

    #[test]
    fn ends_of_an_open_arc_stay_together() {
        let row = |n: u32| ArcRow {
            at: (0..=n).map(|k| f64::from(k) / f64::from(n)).collect(),
            edges: vec![3; n as usize + 1],
        };
        let (s, t) = (row(7), row(5));
        let (_, pairs) = match_open(&s, &t).expect("matched");
        assert_eq!((pairs[0], pairs[pairs.len() - 1]), ((0, 0), (7, 5)));
        assert_eq!(blocks(&pairs).iter().filter(|b| **b == (3, 1)).count(), 1);
    }

    #[test]
    fn a_band_gives_what_the_whole_table_gives() {
        let (s, t) = (even(700, 1.0, 0.0), even(690, 1.0, 0.0003));
        let (_, pairs) = match_closed(&s, &t, 1.0).expect("matched");
        assert_eq!(blocks(&pairs).iter().filter(|b| **b == (3, 1)).count(), 5);
        assert!(blocks(&pairs).iter().all(|b| *b == (1, 1) || *b == (3, 1)));
    }
}
