//! Cells that a map turns over.
//!
//! A cell of a grid over the domain is folded if either of its triangles is turned over, the seam's cells included; nothing
//! is, under a translation. ψ is evaluated at all nodes in f32 first, and in f64 only about the cells that come within
//! [`MARGIN`] of folding by that: f32 puts a node some 10⁻⁶ of the domain off, and only a thousand times as much could
//! hide a fold. *Source:* METHOD §5 ("folds"). *Ours:* the two passes.

use super::evaluate::{psi, roughly_moved};
use super::mls::Domain;
use crate::numerics::wide::{Wide, wide};
use crate::unfold::Uv;

/// Cells a side at which folds are looked for.
pub const FOLD_SIDE_MAX: usize = 64;
/// Twice the area of a triangle, in cells, below which it is looked at again.
const MARGIN: f32 = 0.05;
/// Controls that go on by the same within this make no fold.
const TRANSLATION: f64 = 1e-9;

/// Whether all controls move by the same.
pub fn is_translation(p: &[Uv], q: &[Uv]) -> bool {
    let mut moves = p.iter().zip(q).map(|(p, q)| [q[0] - p[0], q[1] - p[1]]);
    let Some(first) = moves.next() else { return true };
    moves.all(|m| (m[0] - first[0]).abs() <= TRANSLATION && (m[1] - first[1]).abs() <= TRANSLATION)
}

/// Centres of the cells that the map turns over, at `side` cells a side.
pub fn fold_cells(domain: Domain, p: &[Uv], q: &[Uv], side: usize) -> Vec<Uv> {
    let unit = 1.0 / side as f64;
    let near = |[i, j]: [usize; 2]| {
        let at = |i: usize, j: usize| psi(domain, p, q, [i as f64 * unit, j as f64 * unit]);
        is_turned([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
    };
    let suspects = wide(Suspects { domain, p, q, side }).into_iter();
    suspects.filter(|&cell| near(cell)).map(|cell| centre(cell, unit)).collect()
}

/// Centres of the cells of a grid that the map turns over: it has `columns` nodes a row and so many `rows`, `unit` between
/// nodes, which are moved by `displacement(column, row)`.
#[inline(always)]
pub fn folded(
    columns: usize,
    rows: usize,
    unit: f64,
    displacement: impl Fn(usize, usize) -> Uv,
) -> impl Iterator<Item = Uv> {
    let at = move |i: usize, j: usize| {
        let d = displacement(if i == columns { 0 } else { i }, j);
        [i as f64 * unit + d[0], j as f64 * unit + d[1]]
    };
    let is_folded = move |i: usize, j: usize| is_turned([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
    let cells = (0..rows.saturating_sub(1)).flat_map(move |j| (0..columns).map(move |i| (i, j)));
    cells.filter(move |&(i, j)| is_folded(i, j)).map(move |(i, j)| centre([i, j], unit))
}

#[inline(always)]
fn centre([i, j]: [usize; 2], unit: f64) -> Uv {
    [(i as f64 + 0.5) * unit, (j as f64 + 0.5) * unit]
}

/// Whether either triangle of a cell with these corners, counter-clockwise, is turned over.
#[inline(always)]
fn is_turned([a, b, c, d]: [Uv; 4]) -> bool {
    let turned = |a: Uv, b: Uv, c: Uv| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0.0;
    turned(a, b, c) | turned(a, c, d)
}

/// Looks for cells that could be folded.
struct Suspects<'a> {
    domain: Domain,
    p: &'a [Uv],
    q: &'a [Uv],
    side: usize,
}

impl Wide for Suspects<'_> {
    type Output = Vec<[usize; 2]>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { domain, p, q, side } = self;
        // Twice the areas are 1 where nothing moves, in cells; a row of nodes, and the first again.
        let scale = side as f32;
        let row = |j: usize| {
            let mut row = roughly_moved(domain, p, q, side, j);
            row.iter_mut().for_each(|d| *d = [d[0] * scale, d[1] * scale]);
            row.push(row[0]);
            row
        };
        let mut found = Vec::new();
        let mut low = row(0);
        for j in 0..side {
            let high = row(j + 1);
            for (i, (low, high)) in low.windows(2).zip(high.windows(2)).enumerate() {
                let ab = along(low[0], low[1], [1.0, 0.0]);
                let (ac, ad) = (along(low[0], high[1], [1.0, 1.0]), along(low[0], high[0], [0.0, 1.0]));
                // What is no number is suspected too.
                let is_clear = cross(ab, ac) > MARGIN && cross(ac, ad) > MARGIN;
                if !is_clear {
                    found.push([i, j]);
                }
            }
            low = high;
        }
        found
    }
}

/// From one node to another that stands `apart`, as they are moved.
#[inline(always)]
fn along(from: [f32; 2], to: [f32; 2], apart: [f32; 2]) -> [f32; 2] {
    [to[0] - from[0] + apart[0], to[1] - from[1] + apart[1]]
}

#[inline(always)]
fn cross(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::Topology;

    /// Straight from the definition, every cell in f64.
    fn plain(domain: Domain, p: &[Uv], q: &[Uv], side: usize) -> Vec<Uv> {
        let unit = 1.0 / side as f64;
        let moved = |i: usize, j: usize| {
            let x = [i as f64 * unit, j as f64 * unit];
            let y = psi(domain, p, q, x);
            [y[0] - x[0], y[1] - x[1]]
        };
        folded(side, side + 1, unit, moved).collect()
    }

    #[test]
    fn two_passes_find_what_one_finds_in_maps_that_bend_fold_and_crowd() {
        let mut seen = [0; 2];
        for topology in [Topology::Disc, Topology::Torus] {
            let domain = Domain { topology, aspect: 1.0 };
            for seed in 1..60u64 {
                let mut state = seed;
                let mut draw = || {
                    state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (state >> 11) as f64 / (1u64 << 53) as f64
                };
                let p: Vec<Uv> = (0..3 + seed % 12).map(|_| [draw(), draw()]).collect();
                let reach = 0.004 * (seed % 30) as f64;
                let q: Vec<Uv> =
                    p.iter().map(|p| [p[0] + reach * (draw() - 0.5), p[1] + reach * (draw() - 0.5)]).collect();
                let found = fold_cells(domain, &p, &q, 64);
                assert_eq!(found, plain(domain, &p, &q, 64), "seed {seed}");
                seen[usize::from(found.is_empty())] += 1;
            }
        }
        assert!(seen[0] > 10 && seen[1] > 10, "{seen:?}");
    }

    #[test]
    fn a_translation_is_one_on_the_seam_too_and_folds_nothing() {
        let p = [[0.1, 0.2], [0.45, 0.7], [0.97, 0.9]];
        let q = p.map(|p| [p[0] + 0.3, p[1]]);
        assert!(is_translation(&p, &q) && !is_translation(&p, &[q[0], q[1], [1.26, 0.9]]));
        assert!(fold_cells(Domain { topology: Topology::Disc, aspect: 1.0 }, &p, &q, 32).is_empty());
    }
}
