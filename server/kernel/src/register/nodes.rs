//! ψ at the nodes of a level for controls that stand still on the example while the solver moves where they go: prepared
//! once, evaluated often, many nodes side by side.
//!
//! With S, D, S', D' = Σw, Σw·d, Σ±w, Σ±w·d over a control's images, d = p − x, and W, m = Σ Σw, Σ Σw·d / W over all:
//!
//! ```text
//! share = (S, S') / W     by_u = conj(D − m·S)     by_v = i·conj(D' − m·S')     z = −m
//! q* = base + Σ share·q   M = turn + Σ by_u·q_u + by_v·q_v
//! ```
//!
//! since Σ w·conj(p̂) of an image is conj(Σw·d) − conj(m)·Σw, so that one pass over the images does. *Source:* [`super::mls`],
//! whose [`MlsTerms`](super::mls::MlsTerms) are the plain twin that this is tested against.

use std::ops::Range;

use super::mls::{Domain, ROTATION_MIN, TINY, orbit_v};
use crate::numerics::wide::{LANES, Lanes, Wide, wide};
use crate::unfold::Uv;

/// What one control is to [`LANES`] nodes of one row, whose length is a multiple of that: share (u, v), by_u (re, im), by_v (re, im).
type Influence = [Lanes; 6];

/// Pixels between nodes at a level: fine enough that interpolation does not change a result (tests/records).
fn node_step(side: usize) -> usize {
    match side {
        0..=63 => 2,
        64..=255 => 4,
        _ => 8,
    }
}

/// How nodes lie in memory: row by row, with a column before and after each that repeats its other end (u is periodic),
/// and more than a row of zeros before and after all, so that a node's eight neighbours stand at fixed offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Nodes a row.
    pub columns: usize,
    /// Rows: one more.
    pub rows: usize,
}

impl Grid {
    /// From one row to the next.
    #[inline(always)]
    pub fn stride(self) -> usize {
        self.columns + 2
    }

    /// Numbers a field.
    pub fn size(self) -> usize {
        ((self.rows + 2) * self.stride() + 2).next_multiple_of(LANES)
    }

    /// Where node (column, row) stands.
    #[inline(always)]
    pub fn at(self, column: usize, row: usize) -> usize {
        self.lines().start + row * self.stride() + column + 1
    }

    /// Where the rows stand, their repeated ends included.
    #[inline(always)]
    pub fn lines(self) -> Range<usize> {
        self.stride() + 1..(self.rows + 1) * self.stride() + 1
    }

    /// Repeats the ends of each row.
    #[inline(always)]
    pub fn close<T: Copy>(self, field: &mut [T]) {
        for row in 0..self.rows {
            let first = self.at(0, row);
            field[first - 1] = field[first + self.columns - 1];
            field[first + self.columns] = field[first];
        }
    }

    /// Makes what [`Self::close`] repeats zero.
    #[inline(always)]
    pub fn open(self, field: &mut [f32]) {
        for row in 0..self.rows {
            let first = self.at(0, row);
            (field[first - 1], field[first + self.columns]) = (0.0, 0.0);
        }
    }
}

/// ψ's nodes at a level.
#[derive(Debug)]
pub struct Nodes {
    /// The domain of the map.
    pub domain: Domain,
    /// Controls on the example.
    pub p: Vec<Uv>,
    /// Pixels a side.
    pub side: usize,
    /// Pixels between nodes.
    pub step: usize,
    /// How they lie.
    pub grid: Grid,
    /// For each [`LANES`] nodes, all controls.
    influences: Vec<Influence>,
    fixed: Vec<Fixed>,
}

/// What of q*, M and z at nodes side by side no q changes.
#[derive(Clone, Copy, Debug, Default)]
struct Fixed {
    base: [Lanes; 2],
    turn: [Lanes; 2],
    z: [Lanes; 2],
}

/// Displacements ψ(x) − x: a field of u and one of v, in the order of [`Grid`].
#[derive(Clone, Debug)]
pub struct Displacements(pub [Vec<f64>; 2]);

/// ψ of nodes side by side, as far as derivatives need it.
struct NodeValues {
    psi: [Lanes; 2],
    /// e^{iθ} and i·z·e^{iθ}/|M|.
    turn: [Lanes; 2],
    spin: [Lanes; 2],
}

impl Nodes {
    /// Prepares the nodes of a level of `side` pixels for controls at `p`, at least one.
    pub fn new(domain: Domain, side: usize, p: &[Uv]) -> Self {
        let step = node_step(side);
        let grid = Grid { columns: side / step, rows: side / step + 1 };
        let (influences, fixed) = wide(Prepare { domain, p, grid });
        Self { domain, p: p.to_vec(), side, step, grid, influences, fixed }
    }

    /// Distance between nodes, in the domain.
    #[inline(always)]
    pub fn unit(&self) -> f64 {
        self.step as f64 / self.side as f64
    }

    /// The controls at each [`LANES`] nodes, with the first of these.
    #[inline(always)]
    fn chunks(&self) -> impl Iterator<Item = (&[Influence], &Fixed, [usize; 2])> {
        let a_row = self.grid.columns / LANES;
        let places = (0..self.fixed.len()).map(move |k| [k % a_row * LANES, k / a_row]);
        let parts = self.influences.chunks_exact(self.p.len().max(1)).zip(&self.fixed);
        parts.zip(places).map(|((all, fixed), place)| (all, fixed, place))
    }

    #[inline(always)]
    fn evaluate(&self, all: &[Influence], fixed: &Fixed, q: &[Uv]) -> NodeValues {
        let (mut star, mut m) = (fixed.base, fixed.turn);
        for ([share_u, share_v, u_re, u_im, v_re, v_im], q) in all.iter().zip(q) {
            for k in 0..LANES {
                star[0][k] += share_u[k] * q[0];
                star[1][k] += share_v[k] * q[1];
                m[0][k] += u_re[k] * q[0] + v_re[k] * q[1];
                m[1][k] += u_im[k] * q[0] + v_im[k] * q[1];
            }
        }
        let mut at = NodeValues { psi: star, turn: [[1.0; LANES], [0.0; LANES]], spin: [[0.0; LANES]; 2] };
        for k in 0..LANES {
            let size = (m[0][k] * m[0][k] + m[1][k] * m[1][k]).sqrt();
            let turns = size > ROTATION_MIN;
            let over = 1.0 / if turns { size } else { 1.0 };
            let e = if turns { [m[0][k] * over, m[1][k] * over] } else { [1.0, 0.0] };
            let z = [fixed.z[0][k], fixed.z[1][k]];
            let r = [z[0] * e[0] - z[1] * e[1], z[0] * e[1] + z[1] * e[0]];
            let over = if turns { over } else { 0.0 };
            (at.turn[0][k], at.turn[1][k]) = (e[0], e[1]);
            (at.spin[0][k], at.spin[1][k]) = (-r[1] * over, r[0] * over);
            at.psi[0][k] += r[0] / self.domain.aspect;
            at.psi[1][k] += r[1];
        }
        at
    }

    #[inline(always)]
    fn place(&self, at: &NodeValues, [column, row]: [usize; 2], to: &mut Displacements) {
        let (unit, first) = (self.unit(), self.grid.at(column, row));
        for k in 0..LANES {
            to.0[0][first + k] = at.psi[0][k] - (column + k) as f64 * unit;
            to.0[1][first + k] = at.psi[1][k] - row as f64 * unit;
        }
    }

    /// ψ(x) − x at each node for controls that go to `q`.
    #[inline(always)]
    pub fn displacements(&self, q: &[Uv]) -> Displacements {
        let mut all = Displacements([vec![0.0; self.grid.size()], vec![0.0; self.grid.size()]]);
        for (influences, fixed, place) in self.chunks() {
            self.place(&self.evaluate(influences, fixed, q), place, &mut all);
        }
        all.0.iter_mut().for_each(|field| self.grid.close(field));
        all
    }

    /// ∂ψ_u and ∂ψ_v by each unknown (q₁u, q₁v, q₂u, …) at each node: two fields an unknown.
    #[inline(always)]
    pub fn derivatives(&self, q: &[Uv]) -> Vec<f32> {
        let (length, aspect) = (self.grid.size(), self.domain.aspect);
        let mut fields = vec![0.0f32; 4 * self.p.len() * length];
        for (influences, fixed, [column, row]) in self.chunks() {
            let NodeValues { turn: e, spin, .. } = self.evaluate(influences, fixed, q);
            let first = self.grid.at(column, row);
            for (one, four) in influences.iter().zip(fields.chunks_exact_mut(4 * length)) {
                let [share_u, share_v, u_re, u_im, v_re, v_im] = one;
                let mut d = [[0.0f32; LANES]; 4];
                for k in 0..LANES {
                    let turn_u = e[0][k] * u_im[k] - e[1][k] * u_re[k];
                    let turn_v = e[0][k] * v_im[k] - e[1][k] * v_re[k];
                    d[0][k] = (share_u[k] + spin[0][k] * turn_u / aspect) as f32;
                    d[1][k] = (spin[1][k] * turn_u) as f32;
                    d[2][k] = (spin[0][k] * turn_v / aspect) as f32;
                    d[3][k] = (share_v[k] + spin[1][k] * turn_v) as f32;
                }
                for (field, d) in four.chunks_exact_mut(length).zip(&d) {
                    field[first..first + LANES].copy_from_slice(d);
                }
            }
        }
        fields.chunks_exact_mut(length).for_each(|field| self.grid.close(field));
        fields
    }
}

/// Prepares the nodes of a grid.
struct Prepare<'a> {
    domain: Domain,
    p: &'a [Uv],
    grid: Grid,
}

impl Wide for Prepare<'_> {
    type Output = (Vec<Influence>, Vec<Fixed>);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { domain, p, grid } = self;
        let unit = 1.0 / grid.columns as f64;
        let count = grid.columns * grid.rows / LANES;
        let (mut influences, mut fixed) = (Vec::with_capacity(count * p.len()), Vec::with_capacity(count));
        let mut sums = vec![Sums::default(); p.len()];
        for row in 0..grid.rows {
            for from in (0..grid.columns).step_by(LANES) {
                let mut u = [0.0; LANES];
                for k in 0..LANES {
                    u[k] = (from + k) as f64 * unit;
                }
                for (sums, p) in sums.iter_mut().zip(p) {
                    *sums = Sums::of(domain, *p, &u, row as f64 * unit);
                }
                fixed.push(finish(domain, &sums, [&u, &[row as f64 * unit; LANES]], &mut influences));
            }
        }
        (influences, fixed)
    }
}

/// Sums over the images of one control, for nodes side by side.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// S and D.
    plain: [Lanes; 3],
    /// S' and D', by the sign of the image in v.
    signed: [Lanes; 3],
    /// The same by its period in u, and by its offset in v.
    period: [Lanes; 3],
    offset: [Lanes; 3],
}

impl Sums {
    #[inline(always)]
    fn of(domain: Domain, p: Uv, u: &Lanes, v: f64) -> Self {
        let mut sums = Self::default();
        for [sign, offset] in orbit_v(domain.topology) {
            let dv = sign * p[1] + offset - v;
            let fade_v = 1.0 - dv * dv;
            if fade_v <= 0.0 {
                continue;
            }
            // 0 ≤ u < 1: of the images one period apart these may be near.
            let home = -p[0].floor();
            for period in [home - 1.0, home, home + 1.0] {
                let from = p[0] + period;
                for k in 0..LANES {
                    let du = from - u[k];
                    let fade = (1.0 - du * du).max(0.0) * fade_v;
                    let d = domain.aspect * du;
                    let w = fade * fade / (d * d + dv * dv + TINY);
                    let three = [w, w * d, w * dv];
                    for c in 0..3 {
                        sums.plain[c][k] += three[c];
                        sums.signed[c][k] += sign * three[c];
                        sums.period[c][k] += period * three[c];
                        sums.offset[c][k] += offset * three[c];
                    }
                }
            }
        }
        sums
    }
}

/// Influences of all controls at nodes side by side, at `x`, from the sums over their images.
#[inline(always)]
fn finish(domain: Domain, all: &[Sums], x: [&Lanes; 2], influences: &mut Vec<Influence>) -> Fixed {
    let aspect = domain.aspect;
    let mut totals = [[0.0; LANES]; 9];
    for sums in all {
        for c in 0..3 {
            for k in 0..LANES {
                totals[c][k] += sums.plain[c][k];
                totals[3 + c][k] += sums.period[c][k];
                totals[6 + c][k] += sums.offset[c][k];
            }
        }
    }
    let mut mean = [[0.0; LANES]; 2];
    let mut over = [0.0; LANES];
    let mut fixed = Fixed::default();
    for k in 0..LANES {
        let near = totals[0][k] > 0.0;
        over[k] = if near { 1.0 / totals[0][k] } else { 0.0 };
        (mean[0][k], mean[1][k]) = (totals[1][k] * over[k], totals[2][k] * over[k]);
        for c in 0..2 {
            fixed.z[c][k] = -mean[c][k];
            fixed.base[c][k] = if near { totals[3 + 3 * c][k] * over[k] } else { x[c][k] };
        }
        // w·conj(p̂), summed with the images' periods and offsets.
        let conj = |three: usize| {
            let [w, d, e] = [0, 1, 2].map(|c| totals[three + c][k]);
            [d - mean[0][k] * w, -(e - mean[1][k] * w)]
        };
        let (by_period, by_offset) = (conj(3), conj(6));
        fixed.turn[0][k] = aspect * by_period[0] - by_offset[1];
        fixed.turn[1][k] = aspect * by_period[1] + by_offset[0];
    }
    for sums in all {
        let mut one = [[0.0; LANES]; 6];
        for k in 0..LANES {
            let conj = |three: &[Lanes; 3]| {
                [three[1][k] - mean[0][k] * three[0][k], -(three[2][k] - mean[1][k] * three[0][k])]
            };
            let (plain, signed) = (conj(&sums.plain), conj(&sums.signed));
            one[0][k] = sums.plain[0][k] * over[k];
            one[1][k] = sums.signed[0][k] * over[k];
            (one[2][k], one[3][k]) = (aspect * plain[0], aspect * plain[1]);
            (one[4][k], one[5][k]) = (-signed[1], signed[0]);
        }
        influences.push(one);
    }
    fixed
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::register::mls::MlsTerms;
    use crate::topology::Topology;

    pub(in crate::register) const P: [Uv; 5] = [[0.1, 0.2], [0.45, 0.7], [0.8, 0.35], [0.97, 0.9], [0.25, 0.5]];
    pub(in crate::register) const Q: [Uv; 5] = [[0.17, 0.24], [0.43, 0.64], [0.86, 0.3], [1.02, 0.93], [0.27, 0.5]];

    pub(in crate::register) fn domains() -> [Domain; 3] {
        [(Topology::Disc, 1.0), (Topology::Annulus, 2.3), (Topology::Torus, 0.7)]
            .map(|(topology, aspect)| Domain { topology, aspect })
    }

    #[test]
    fn nodes_move_and_derive_as_the_plain_definition_does_also_where_a_control_is() {
        for domain in domains() {
            for side in [32, 128] {
                let nodes = Nodes::new(domain, side, &P);
                let (moved, derived) = (nodes.displacements(&Q), nodes.derivatives(&Q));
                let (grid, unit, length) = (nodes.grid, nodes.unit(), nodes.grid.size());
                for row in 0..grid.rows {
                    for column in 0..grid.columns {
                        let x = [column as f64 * unit, row as f64 * unit];
                        let (terms, mut gradient) = (MlsTerms::new(domain, &P, x), [[0.0; 4]; 5]);
                        let y = terms.with_gradient(domain, &Q, &mut gradient);
                        let at = grid.at(column, row);
                        for c in 0..2 {
                            assert!((moved.0[c][at] - (y[c] - x[c])).abs() < 1e-7, "{x:?}");
                        }
                        for (k, expected) in gradient.as_flattened().iter().enumerate() {
                            let found = f64::from(derived[k * length + at]);
                            assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0), "{x:?}: {k}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn rows_repeat_their_other_end_and_only_that() {
        let grid = Grid { columns: 16, rows: 17 };
        let mut field = vec![0.0f32; grid.size()];
        field[grid.at(0, 3)] = 1.0;
        field[grid.at(15, 3)] = 2.0;
        grid.close(&mut field);
        assert_eq!((field[grid.at(0, 3) - 1], field[grid.at(15, 3) + 1]), (2.0, 1.0));
        grid.open(&mut field);
        assert_eq!(field.iter().sum::<f32>(), 3.0);
    }
}
