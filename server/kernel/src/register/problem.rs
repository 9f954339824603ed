//! The registration energy of one level: E(q) = mean over pixels of (√λ₂(ψ(x)) − √λ₁(x))², with its normal equations.
//!
//! ψ and its derivatives are evaluated on a grid of nodes and interpolated (an MLS map is smooth); λ is sampled at
//! every pixel. *Source:* paper Eq. 6 and §5.2; METHOD §5.

use super::image::Image;
use super::mls::{Domain, MlsTerms};
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
        let at = |k: usize| {
            let unit = step as f64 / example.side as f64;
            [(k % columns) as f64 * unit, (k / columns) as f64 * unit]
        };
        let terms = (0..columns * rows).map(|k| MlsTerms::new(domain, p, at(k))).collect();
        Self { domain, example, query, p, step, terms }
    }

    /// Nodes along u; along v there is one more.
    fn columns(&self) -> usize {
        self.example.side / self.step
    }

    /// Displacement ψ(x) − x at each node.
    pub fn displacements(&self, q: &[Uv]) -> Vec<Uv> {
        let columns = self.columns();
        let unit = self.step as f64 / self.example.side as f64;
        let displacement = |(k, terms): (usize, &MlsTerms)| {
            let y = terms.at(self.domain, q);
            [y[0] - (k % columns) as f64 * unit, y[1] - (k / columns) as f64 * unit]
        };
        self.terms.iter().enumerate().map(displacement).collect()
    }

    /// E at `q`.
    pub fn energy(&self, q: &[Uv]) -> f64 {
        let displacements = self.displacements(q);
        let mut sum = 0.0;
        self.for_each_pixel(&displacements, |_, _, residual, _| sum += residual * residual);
        sum / (self.example.side * self.example.side) as f64
    }

    /// Node cells that `q` turns over (either triangle).
    pub fn folded_cells(&self, q: &[Uv]) -> Vec<Uv> {
        let displacements = self.displacements(q);
        let columns = self.columns();
        let unit = self.step as f64 / self.example.side as f64;
        folded(columns, columns, unit, |i, j| displacements[j * columns + i % columns])
    }

    /// E with gradient and Gauss–Newton matrix at `q`.
    pub fn normal(&self, q: &[Uv]) -> Normal {
        let unknowns = 2 * self.p.len();
        let (displacements, derivatives) = self.node_derivatives(q);
        let columns = self.columns();
        let cells = columns * columns;
        let mut local = vec![CellSums::default(); cells];
        let mut sum = 0.0;
        self.for_each_pixel(&displacements, |cell, shape, residual, slope| {
            sum += residual * residual;
            local[cell].add(shape, residual, slope);
        });
        let scale = 1.0 / (self.example.side * self.example.side) as f64;
        let mut gradient = vec![0.0; unknowns];
        let mut products = vec![0.0; derivatives.len()];
        for (cell, sums) in local.iter().enumerate() {
            sums.scatter(self.nodes_of(cell), &derivatives, unknowns, &mut products, &mut gradient);
        }
        let mut matrix = vec![0.0; unknowns * unknowns];
        for (d, t) in derivatives.chunks_exact(unknowns).zip(products.chunks_exact(unknowns)) {
            for (i, &di) in d.iter().enumerate().filter(|(_, d)| **d != 0.0) {
                let row = &mut matrix[i * unknowns..i * unknowns + i + 1];
                row.iter_mut().zip(t).for_each(|(m, t)| *m += di * t);
            }
        }
        for i in 0..unknowns {
            for j in 0..=i {
                matrix[i * unknowns + j] *= scale;
                matrix[j * unknowns + i] = matrix[i * unknowns + j];
            }
        }
        gradient.iter_mut().for_each(|g| *g *= scale);
        Normal { energy: sum * scale, gradient, matrix }
    }

    /// Displacements, and rows ∂ψ_u/∂q, ∂ψ_v/∂q of each node (two rows of `unknowns` a node).
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
    fn nodes_of(&self, cell: usize) -> [usize; 4] {
        let columns = self.columns();
        let (i, j) = (cell % columns, cell / columns);
        let right = (i + 1) % columns;
        [j * columns + i, j * columns + right, (j + 1) * columns + i, (j + 1) * columns + right]
    }

    /// Calls `visit(cell, node weights, residual, ∇√λ₂)` for every pixel, cell by cell.
    fn for_each_pixel(&self, displacements: &[Uv], mut visit: impl FnMut(usize, [f64; 4], f64, [f64; 2])) {
        let columns = self.columns();
        for cell in 0..columns * columns {
            let corner = self.nodes_of(cell).map(|n| displacements[n]);
            let (x0, y0) = ((cell % columns) * self.step, (cell / columns) * self.step);
            for dy in 0..self.step {
                for dx in 0..self.step {
                    let (fx, fy) = ((dx as f64 + 0.5) / self.step as f64, (dy as f64 + 0.5) / self.step as f64);
                    let shape = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
                    let moved = |k: usize| (0..4).map(|n| shape[n] * corner[n][k]).sum::<f64>();
                    let x = self.example.centre(x0 + dx, y0 + dy);
                    let (value, slope) = self.query.sample([x[0] + moved(0), x[1] + moved(1)]);
                    visit(cell, shape, value - self.example.pixel(x0 + dx, y0 + dy), slope);
                }
            }
        }
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
    fn add(&mut self, shape: [f64; 4], residual: f64, g: [f64; 2]) {
        let squares = [g[0] * g[0], g[0] * g[1], g[1] * g[1]];
        let mut at = 0;
        for a in 0..4 {
            self.rights[a][0] += shape[a] * g[0] * residual;
            self.rights[a][1] += shape[a] * g[1] * residual;
            for b in a..4 {
                let w = shape[a] * shape[b];
                (0..3).for_each(|k| self.pairs[at][k] += w * squares[k]);
                at += 1;
            }
        }
    }

    /// Adds this cell's part of H·D to `products` and of Jᵀr to `gradient`.
    fn scatter(&self, nodes: [usize; 4], d: &[f64], unknowns: usize, products: &mut [f64], gradient: &mut [f64]) {
        let row = |node: usize, c: usize| (2 * node + c) * unknowns..(2 * node + c + 1) * unknowns;
        let mut at = 0;
        for a in 0..4 {
            for c in 0..2 {
                let right = self.rights[a][c];
                gradient.iter_mut().zip(&d[row(nodes[a], c)]).for_each(|(g, x)| *g += right * x);
            }
            for b in a..4 {
                let [uu, uv, vv] = self.pairs[at];
                at += 1;
                for (c, e, w) in [(0, 0, uu), (0, 1, uv), (1, 0, uv), (1, 1, vv)] {
                    add_scaled(&mut products[row(nodes[a], c)], &d[row(nodes[b], e)], w);
                    if a != b {
                        add_scaled(&mut products[row(nodes[b], c)], &d[row(nodes[a], e)], w);
                    }
                }
            }
        }
    }
}

#[inline]
fn add_scaled(to: &mut [f64], from: &[f64], factor: f64) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += factor * f);
}

/// Centres of the cells of a grid over the domain of which a triangle is turned over by `displacement(i, j)`.
/// Both triangles of each cell are tested, the seam's cells included. *Source:* METHOD §5 ("folds").
pub fn folded(columns: usize, rows: usize, unit: f64, displacement: impl Fn(usize, usize) -> Uv) -> Vec<Uv> {
    let at = |i: usize, j: usize| {
        let d = displacement(i, j);
        [i as f64 * unit + d[0], j as f64 * unit + d[1]]
    };
    let turned = |a: Uv, b: Uv, c: Uv| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0.0;
    let mut cells = Vec::new();
    for j in 0..rows {
        for i in 0..columns {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            if turned(a, b, c) || turned(a, c, d) {
                cells.push([(i as f64 + 0.5) * unit, (j as f64 + 0.5) * unit]);
            }
        }
    }
    cells
}
