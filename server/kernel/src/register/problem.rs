//! The registration energy of one level: E(q) = mean over pixels of (√λ₂(ψ(x)) − √λ₁(x))², with its normal equations.
//!
//! ψ and its derivatives are evaluated on a grid of nodes and interpolated (an MLS map is smooth); λ is sampled at
//! every pixel. *Source:* paper Eq. 6 and §5.2; METHOD §5.

use super::image::Image;
use super::mls::{Domain, MlsTerms};
use crate::numerics::wide::{Wide, wide};
use crate::unfold::Uv;

/// Pixels between nodes at a level: fine enough that interpolation does not change a result (tests/records).
fn node_step(side: usize) -> usize {
    match side {
        0..=63 => 2,
        64..=127 => 4,
        128..=255 => 4,
        _ => 8,
    }
}

/// One level of one registration, prepared.
pub struct Problem<'a> {
    /// The domain of the map.
    pub domain: Domain,
    /// √λ₁, mirrored as the flip asks.
    pub example: &'a Image,
    /// √λ₂.
    pub query: &'a Image,
    /// Controls on the example.
    pub p: &'a [Uv],
    step: usize,
    terms: Vec<MlsTerms>,
}

/// E, its gradient and Gauss–Newton matrix over the unknowns (q₁u, q₁v, q₂u, …).
pub struct Normal {
    /// Mean squared difference.
    pub energy: f64,
    /// mean Jᵀr.
    pub gradient: Vec<f64>,
    /// mean JᵀJ, row-major.
    pub matrix: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// Prepares the nodes for controls at `p`.
    pub fn new(domain: Domain, example: &'a Image, query: &'a Image, p: &'a [Uv]) -> Self {
        let step = node_step(example.side);
        let (columns, rows) = (example.side / step, example.side / step + 1);
        let terms = wide(Prepare { domain, p, columns, rows, unit: step as f64 / example.side as f64 });
        Self { domain, example, query, p, step, terms }
    }

    /// Nodes along u; along v there is one more.
    fn columns(&self) -> usize {
        self.example.side / self.step
    }

    /// Displacement ψ(x) − x at each node.
    #[inline(always)]
    fn displacements(&self, q: &[Uv]) -> Vec<Uv> {
        let columns = self.columns();
        let unit = self.step as f64 / self.example.side as f64;
        let mut displacements = Vec::with_capacity(self.terms.len());
        for (row, line) in self.terms.chunks_exact(columns).enumerate() {
            for (column, terms) in line.iter().enumerate() {
                let y = terms.at(self.domain, q);
                displacements.push([y[0] - column as f64 * unit, y[1] - row as f64 * unit]);
            }
        }
        displacements
    }

    /// E at `q`.
    pub fn energy(&self, q: &[Uv]) -> f64 {
        wide(Energy { problem: self, q, folded: Folded::Too }).unwrap_or(f64::INFINITY)
    }

    /// E at `q`, unless a node cell is turned over there.
    pub fn unfolded_energy(&self, q: &[Uv]) -> Option<f64> {
        wide(Energy { problem: self, q, folded: Folded::Never })
    }

    #[inline(always)]
    fn energy_of(&self, displacements: &[Uv]) -> f64 {
        let mut sum = 0.0;
        self.for_each_pixel(
            displacements,
            #[inline(always)]
            |_, _, residual, _| sum += residual * residual,
        );
        sum / (self.example.side * self.example.side) as f64
    }

    /// Node cells that `q` turns over (either triangle).
    pub fn folded_cells(&self, q: &[Uv]) -> Vec<Uv> {
        self.folds_of(&self.displacements(q)).collect()
    }

    #[inline(always)]
    fn folds_of(&self, displacements: &[Uv]) -> impl Iterator<Item = Uv> {
        let columns = self.columns();
        folded(columns, self.step as f64 / self.example.side as f64, displacements)
    }

    /// E with gradient and Gauss–Newton matrix at `q`.
    pub fn normal(&self, q: &[Uv]) -> Normal {
        wide(NormalAt { problem: self, q })
    }

    #[inline(always)]
    fn normal_here(&self, q: &[Uv]) -> Normal {
        let unknowns = 2 * self.p.len();
        let (displacements, derivatives) = self.node_derivatives(q);
        let columns = self.columns();
        let cells = columns * columns;
        let mut local = vec![CellSums::default(); cells];
        let mut sum = 0.0;
        self.for_each_pixel(
            &displacements,
            #[inline(always)]
            |cell, shape, residual, slope| {
                sum += residual * residual;
                local[cell].add(shape, residual, slope);
            },
        );
        let scale = 1.0 / (self.example.side * self.example.side) as f64;
        let mut gradient = vec![0.0; unknowns];
        let mut products = vec![0.0; derivatives.len()];
        for (cell, sums) in local.iter().enumerate() {
            sums.scatter(self.nodes_of(cell), &derivatives, unknowns, &mut products, &mut gradient);
        }
        let mut matrix = vec![0.0; unknowns * unknowns];
        for (d, t) in derivatives.chunks_exact(unknowns).zip(products.chunks_exact(unknowns)) {
            for (i, &di) in d.iter().enumerate() {
                if di != 0.0 {
                    add_scaled(&mut matrix[i * unknowns..i * unknowns + i + 1], t, di);
                }
            }
        }
        for i in 0..unknowns {
            for j in 0..=i {
                matrix[i * unknowns + j] *= scale;
                matrix[j * unknowns + i] = matrix[i * unknowns + j];
            }
        }
        for g in &mut gradient {
            *g *= scale;
        }
        Normal { energy: sum * scale, gradient, matrix }
    }

    /// Displacements, and rows ∂ψ_u/∂q, ∂ψ_v/∂q of each node (two rows of `unknowns` a node).
    #[inline(always)]
    fn node_derivatives(&self, q: &[Uv]) -> (Vec<Uv>, Vec<f64>) {
        let unknowns = 2 * self.p.len();
        let columns = self.columns();
        let unit = self.step as f64 / self.example.side as f64;
        let mut rows = vec![0.0; 2 * unknowns * self.terms.len()];
        let mut blocks = vec![[0.0; 4]; self.p.len()];
        let mut displacements = Vec::with_capacity(self.terms.len());
        for (k, (terms, out)) in self.terms.iter().zip(rows.chunks_exact_mut(2 * unknowns)).enumerate() {
            let y = terms.with_gradient(self.domain, q, &mut blocks);
            displacements.push([y[0] - (k % columns) as f64 * unit, y[1] - (k / columns) as f64 * unit]);
            let (du, dv) = out.split_at_mut(unknowns);
            for (i, b) in blocks.iter().enumerate() {
                (du[2 * i], dv[2 * i], du[2 * i + 1], dv[2 * i + 1]) = (b[0], b[1], b[2], b[3]);
            }
        }
        (displacements, rows)
    }

    /// The four nodes of a cell: (0,0), (1,0), (0,1), (1,1).
    #[inline(always)]
    fn nodes_of(&self, cell: usize) -> [usize; 4] {
        let columns = self.columns();
        let (i, j) = (cell % columns, cell / columns);
        let right = (i + 1) % columns;
        [j * columns + i, j * columns + right, (j + 1) * columns + i, (j + 1) * columns + right]
    }

    /// Calls `visit(cell, node weights, residual, ∇√λ₂)` for every pixel, cell by cell.
    #[inline(always)]
    fn for_each_pixel(&self, displacements: &[Uv], mut visit: impl FnMut(usize, [f64; 4], f64, [f64; 2])) {
        let columns = self.columns();
        for cell in 0..columns * columns {
            let [n0, n1, n2, n3] = self.nodes_of(cell);
            let (a, b, c, d) = (displacements[n0], displacements[n1], displacements[n2], displacements[n3]);
            let (x0, y0) = ((cell % columns) * self.step, (cell / columns) * self.step);
            for dy in 0..self.step {
                for dx in 0..self.step {
                    let (fx, fy) = ((dx as f64 + 0.5) / self.step as f64, (dy as f64 + 0.5) / self.step as f64);
                    let shape = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
                    let du = shape[0] * a[0] + shape[1] * b[0] + shape[2] * c[0] + shape[3] * d[0];
                    let dv = shape[0] * a[1] + shape[1] * b[1] + shape[2] * c[1] + shape[3] * d[1];
                    let x = self.example.centre(x0 + dx, y0 + dy);
                    let (value, slope) = self.query.sample([x[0] + du, x[1] + dv]);
                    visit(cell, shape, value - self.example.pixel(x0 + dx, y0 + dy), slope);
                }
            }
        }
    }
}

/// Prepares the nodes of a grid.
struct Prepare<'a> {
    domain: Domain,
    p: &'a [Uv],
    columns: usize,
    rows: usize,
    unit: f64,
}

impl Wide for Prepare<'_> {
    type Output = Vec<MlsTerms>;

    #[inline(always)]
    fn run(self) -> Vec<MlsTerms> {
        let mut terms = Vec::with_capacity(self.columns * self.rows);
        for row in 0..self.rows {
            for column in 0..self.columns {
                terms.push(MlsTerms::new(self.domain, self.p, [column as f64 * self.unit, row as f64 * self.unit]));
            }
        }
        terms
    }
}

/// Whether maps that turn cells over have an energy.
enum Folded {
    Too,
    Never,
}

struct Energy<'a> {
    problem: &'a Problem<'a>,
    q: &'a [Uv],
    folded: Folded,
}

impl Wide for Energy<'_> {
    type Output = Option<f64>;

    #[inline(always)]
    fn run(self) -> Option<f64> {
        let displacements = self.problem.displacements(self.q);
        if matches!(self.folded, Folded::Never) && self.problem.folds_of(&displacements).next().is_some() {
            return None;
        }
        Some(self.problem.energy_of(&displacements))
    }
}

struct NormalAt<'a> {
    problem: &'a Problem<'a>,
    q: &'a [Uv],
}

impl Wide for NormalAt<'_> {
    type Output = Normal;

    #[inline(always)]
    fn run(self) -> Normal {
        self.problem.normal_here(self.q)
    }
}

/// Sums over a cell's pixels: Σ φ_a φ_b ∇B∇Bᵀ for node pairs, Σ φ_a ∇B r.
#[derive(Clone, Debug, Default)]
struct CellSums {
    /// For each node pair a ≤ b: (uu, uv, vv).
    pairs: [[f64; 3]; 10],
    rights: [[f64; 2]; 4],
}

impl CellSums {
    #[inline(always)]
    fn add(&mut self, shape: [f64; 4], residual: f64, g: [f64; 2]) {
        let squares = [g[0] * g[0], g[0] * g[1], g[1] * g[1]];
        let mut at = 0;
        for a in 0..4 {
            self.rights[a][0] += shape[a] * g[0] * residual;
            self.rights[a][1] += shape[a] * g[1] * residual;
            for b in a..4 {
                let w = shape[a] * shape[b];
                for k in 0..3 {
                    self.pairs[at][k] += w * squares[k];
                }
                at += 1;
            }
        }
    }

    /// Adds this cell's part of H·D to `products` and of Jᵀr to `gradient`.
    #[inline(always)]
    fn scatter(&self, nodes: [usize; 4], d: &[f64], unknowns: usize, products: &mut [f64], gradient: &mut [f64]) {
        let row = |node: usize, c: usize| (2 * node + c) * unknowns..(2 * node + c + 1) * unknowns;
        let both = |node: usize| 2 * node * unknowns..2 * (node + 1) * unknowns;
        let mut at = 0;
        for a in 0..4 {
            for c in 0..2 {
                add_scaled(gradient, &d[row(nodes[a], c)], self.rights[a][c]);
            }
            for b in a..4 {
                let [uu, uv, vv] = self.pairs[at];
                at += 1;
                add_both(&mut products[both(nodes[a])], &d[both(nodes[b])], [uu, uv, vv]);
                if a != b {
                    add_both(&mut products[both(nodes[b])], &d[both(nodes[a])], [uu, uv, vv]);
                }
            }
        }
    }
}

#[inline(always)]
fn add_scaled(to: &mut [f64], from: &[f64], factor: f64) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += factor * f;
    }
}

/// Adds the symmetric 2 × 2 matrix (uu, uv; uv, vv) times a node's two rows to another's.
#[inline(always)]
fn add_both(to: &mut [f64], from: &[f64], [uu, uv, vv]: [f64; 3]) {
    let (to_u, to_v) = to.split_at_mut(to.len() / 2);
    let (from_u, from_v) = from.split_at(from.len() / 2);
    for (((tu, tv), fu), fv) in to_u.iter_mut().zip(to_v).zip(from_u).zip(from_v) {
        *tu += uu * fu + uv * fv;
        *tv += uv * fu + vv * fv;
    }
}

/// Centres of the cells of a grid over the domain of which a triangle is turned over: the grid has `columns` nodes a row,
/// one row more, and so much between nodes. Both triangles of each cell are tested, the seam's cells included.
/// *Source:* METHOD §5 ("folds").
#[inline(always)]
pub fn folded(columns: usize, unit: f64, displacements: &[Uv]) -> impl Iterator<Item = Uv> {
    let at = move |i: usize, j: usize| {
        let d = displacements[j * columns + if i == columns { 0 } else { i }];
        [i as f64 * unit + d[0], j as f64 * unit + d[1]]
    };
    let turned = |a: Uv, b: Uv, c: Uv| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0.0;
    let is_folded = move |i: usize, j: usize| {
        let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
        turned(a, b, c) | turned(a, c, d)
    };
    let rows = displacements.len().checked_div(columns).unwrap_or(0).saturating_sub(1);
    let cells = (0..rows).flat_map(move |j| (0..columns).map(move |i| (i, j)));
    cells.filter(move |&(i, j)| is_folded(i, j)).map(move |(i, j)| [(i as f64 + 0.5) * unit, (j as f64 + 0.5) * unit])
}
