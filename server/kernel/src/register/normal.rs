//! The normal equations of the registration energy: gradient and Gauss–Newton matrix over where the controls go.
//!
//! With φ_a the bilinear weights of the nodes of a pixel's cell, B its slope ∇√λ₂, r its residual and D_j the field
//! ∂ψ/∂q_j at the nodes,
//!
//! ```text
//! J_j = Σ_a φ_a B·D_j(a)      JᵀJ_ij = D_iᵀ H D_j      H(a, b) = Σ φ_a φ_b B Bᵀ      Jᵀr_i = D_iᵀ R      R(a) = Σ φ_a B r
//! ```
//!
//! H joins a node with its eight neighbours only: a stencil, whose product with a field is one pass over it.
//! *Source:* paper §5.2 and appendix; METHOD §5. *Ours:* fields in f32, since a step is tested by its energy.

use super::nodes::{Grid, Nodes};
use super::problem::Pixels;
use crate::numerics::wide::{Wide, wide};
use crate::unfold::Uv;

/// Numbers that are added up side by side.
const LANES: usize = 8;
/// Products of H that are multiplied by the fields at a time.
const BATCH: usize = 4;
/// Pairs a ≤ b of a cell's nodes (0,0), (1,0), (0,1), (1,1), in the order of [`PAIRS`], and room to fill vectors.
const PAIRS_ROOM: usize = 16;
const PAIRS: [[usize; 2]; 10] = [[0, 0], [0, 1], [0, 2], [0, 3], [1, 1], [1, 2], [1, 3], [2, 2], [2, 3], [3, 3]];
/// Directions of the stencil of which each node keeps the block; the opposite ones are kept at the other node.
const DIRECTIONS: [[isize; 2]; 5] = [[0, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// E's gradient and Gauss–Newton matrix over the unknowns (q₁u, q₁v, q₂u, …).
#[derive(Clone, Debug)]
pub struct Normal {
    /// mean Jᵀr.
    pub gradient: Vec<f64>,
    /// mean JᵀJ, row-major.
    pub matrix: Vec<f64>,
}

/// Gradient and matrix where the controls go to `q` and the pixels show `pixels`.
pub fn normal(nodes: &Nodes, q: &[Uv], pixels: &Pixels) -> Normal {
    wide(NormalAt { nodes, q, pixels })
}

struct NormalAt<'a> {
    nodes: &'a Nodes,
    q: &'a [Uv],
    pixels: &'a Pixels,
}

impl Wide for NormalAt<'_> {
    type Output = Normal;

    #[inline(always)]
    fn run(self) -> Normal {
        let Self { nodes, q, pixels } = self;
        let (grid, unknowns) = (nodes.grid, 2 * nodes.p.len());
        let fields = nodes.derivatives(q);
        let stencil = Stencil::new(nodes, pixels);
        let scale = 1.0 / (nodes.side * nodes.side) as f64;
        // A field of u and one of v an unknown.
        let both = 2 * grid.size();
        let of = |unknown: usize| &fields[unknown * both..(unknown + 1) * both];
        let mut products = vec![0.0f32; BATCH * both];
        let mut matrix = vec![0.0; unknowns * unknowns];
        for from in (0..unknowns).step_by(BATCH) {
            let batch = BATCH.min(unknowns - from);
            for (k, product) in products.chunks_exact_mut(both).take(batch).enumerate() {
                stencil.multiply(of(from + k), product);
            }
            let (p0, rest) = products.split_at(both);
            let (p1, rest) = rest.split_at(both);
            let (p2, p3) = rest.split_at(both);
            for i in 0..from + batch {
                let dots = four_dots(of(i), [p0, p1, p2, p3]);
                for (k, dot) in dots.into_iter().enumerate().take(batch) {
                    let (i, j) = (i.max(from + k), i.min(from + k));
                    // The blocks on the diagonal give both halves; the lower stands.
                    matrix[i * unknowns + j] = f64::from(dot) * scale;
                    matrix[j * unknowns + i] = f64::from(dot) * scale;
                }
            }
        }
        let gradient = (0..unknowns).map(|i| f64::from(dot(of(i), &stencil.rights)) * scale).collect();
        Normal { gradient, matrix }
    }
}

/// H as a field of (uu, uv, vv) for each of [`DIRECTIONS`], and R as two fields.
struct Stencil {
    grid: Grid,
    blocks: Vec<f32>,
    rights: Vec<f32>,
}

impl Stencil {
    #[inline(always)]
    fn new(nodes: &Nodes, pixels: &Pixels) -> Self {
        let (grid, step) = (nodes.grid, nodes.step);
        let length = grid.size();
        let mut stencil =
            Self { grid, blocks: vec![0.0; 3 * DIRECTIONS.len() * length], rights: vec![0.0; 2 * length] };
        let weights = weights(step);
        for row in 0..grid.rows - 1 {
            for column in 0..grid.columns {
                let mut cell = Cell::default();
                for dy in 0..step {
                    let from = (row * step + dy) * nodes.side + column * step;
                    let line = weights[dy * step..(dy + 1) * step].iter();
                    let r = &pixels.residual[from..from + step];
                    let (bu, bv) = (&pixels.slope[0][from..from + step], &pixels.slope[1][from..from + step]);
                    for (((weight, r), bu), bv) in line.zip(r).zip(bu).zip(bv) {
                        cell.add(weight, *r, [*bu, *bv]);
                    }
                }
                stencil.scatter(&cell, column, row);
            }
        }
        stencil.blocks.chunks_exact_mut(length).for_each(|field| grid.close(field));
        stencil
    }

    #[inline(always)]
    fn scatter(&mut self, cell: &Cell, column: usize, row: usize) {
        let (grid, length) = (self.grid, self.grid.size());
        let right = (column + 1) % grid.columns;
        let nodes = [grid.at(column, row), grid.at(right, row), grid.at(column, row + 1), grid.at(right, row + 1)];
        for (k, [a, b]) in PAIRS.into_iter().enumerate() {
            let way = [b % 2, b / 2].map(|x| x as isize);
            let way = [way[0] - (a % 2) as isize, way[1] - (a / 2) as isize];
            let direction = DIRECTIONS.iter().position(|d| *d == way).unwrap_or(0);
            for (c, sum) in cell.squares.iter().enumerate() {
                self.blocks[(3 * direction + c) * length + nodes[a]] += sum[k];
            }
        }
        for (a, node) in nodes.into_iter().enumerate() {
            for c in 0..2 {
                self.rights[c * length + node] += cell.rights[c][a];
            }
        }
    }

    /// H times a field of u and one of v.
    #[inline(always)]
    fn multiply(&self, field: &[f32], product: &mut [f32]) {
        let (length, stride) = (self.grid.size(), self.grid.stride());
        let lines = self.grid.lines();
        let (first, count) = (lines.start, lines.len());
        let (field_u, field_v) = field.split_at(length);
        let (product_u, product_v) = product.split_at_mut(length);
        let (to_u, to_v) = (&mut product_u[lines.clone()], &mut product_v[lines]);
        to_u.fill(0.0);
        to_v.fill(0.0);
        for (k, [dx, dy]) in DIRECTIONS.into_iter().enumerate() {
            let block = |c: usize, from: usize| &self.blocks[(3 * k + c) * length + from..][..count];
            let offset = dy * stride as isize + dx;
            let (ahead, behind) = (first.saturating_add_signed(offset), first.saturating_add_signed(-offset));
            let blocks = [block(0, first), block(1, first), block(2, first)];
            add_blocks(to_u, to_v, blocks, [&field_u[ahead..][..count], &field_v[ahead..][..count]]);
            if offset != 0 {
                let blocks = [block(0, behind), block(1, behind), block(2, behind)];
                add_blocks(to_u, to_v, blocks, [&field_u[behind..][..count], &field_v[behind..][..count]]);
            }
        }
        self.grid.open(product_u);
        self.grid.open(product_v);
    }
}

/// Adds the symmetric 2 × 2 matrices (uu, uv; uv, vv) times a field.
#[inline(always)]
fn add_blocks(to_u: &mut [f32], to_v: &mut [f32], [uu, uv, vv]: [&[f32]; 3], [u, v]: [&[f32]; 2]) {
    let to = to_u.iter_mut().zip(to_v);
    for (((to_u, to_v), ((uu, uv), vv)), (u, v)) in to.zip(uu.iter().zip(uv).zip(vv)).zip(u.iter().zip(v)) {
        *to_u += uu * u + uv * v;
        *to_v += uv * u + vv * v;
    }
}

/// φ_a φ_b for all pairs and φ_a, of one pixel of a cell.
struct Weight {
    pairs: [f32; PAIRS_ROOM],
    nodes: [f32; 4],
}

fn weights(step: usize) -> Vec<Weight> {
    let one = |k: usize| {
        let at = |k: usize| (k as f32 + 0.5) / step as f32;
        let (fx, fy) = (at(k % step), at(k / step));
        let nodes = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        let mut pairs = [0.0; PAIRS_ROOM];
        for (to, [a, b]) in pairs.iter_mut().zip(PAIRS) {
            *to = nodes[a] * nodes[b];
        }
        Weight { pairs, nodes }
    };
    (0..step * step).map(one).collect()
}

/// Sums over a cell's pixels: Σ φ_a φ_b B Bᵀ as (uu, uv, vv), Σ φ_a B r.
#[derive(Default)]
struct Cell {
    squares: [[f32; PAIRS_ROOM]; 3],
    rights: [[f32; 4]; 2],
}

impl Cell {
    #[inline(always)]
    fn add(&mut self, weight: &Weight, r: f32, [u, v]: [f32; 2]) {
        for (sums, square) in self.squares.iter_mut().zip([u * u, u * v, v * v]) {
            for k in 0..PAIRS_ROOM {
                sums[k] += weight.pairs[k] * square;
            }
        }
        for (sums, right) in self.rights.iter_mut().zip([u * r, v * r]) {
            for a in 0..4 {
                sums[a] += weight.nodes[a] * right;
            }
        }
    }
}

/// Dot products of a field with four others.
#[inline(always)]
fn four_dots(a: &[f32], [b0, b1, b2, b3]: [&[f32]; BATCH]) -> [f32; BATCH] {
    let mut sums = [[0.0f32; LANES]; BATCH];
    let [a, b0, b1, b2, b3] = [a, b0, b1, b2, b3].map(|field| field.as_chunks::<LANES>().0);
    let all = a.iter().zip(b0).zip(b1).zip(b2).zip(b3);
    for ((((a, b0), b1), b2), b3) in all {
        for k in 0..LANES {
            sums[0][k] += a[k] * b0[k];
            sums[1][k] += a[k] * b1[k];
            sums[2][k] += a[k] * b2[k];
            sums[3][k] += a[k] * b3[k];
        }
    }
    sums.map(|sums| sums.iter().sum())
}

#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Picture;
    use crate::register::Flip;
    use crate::register::image::Image;
    use crate::register::mls::MlsTerms;
    use crate::register::nodes::tests::{P, Q, domains};
    use crate::register::problem::Problem;
    use std::sync::Arc;

    fn image(side: usize, by: f64) -> Image {
        let value = |k: usize| {
            let (u, v) = ((k % side) as f64 / side as f64, (k / side) as f64 / side as f64);
            let tau = std::f64::consts::TAU;
            (1.5 + (tau * (u + by)).sin() * (3.0 * v + by).cos() + 0.3 * (2.0 * tau * u + 5.0 * v).cos()) as f32
        };
        Image::new(&Picture { side, values: (0..side * side).map(value).collect() }, Flip::default(), false)
    }

    /// E, mean Jᵀr and mean JᵀJ pixel by pixel, from the plain definition of ψ at the nodes.
    fn plain(problem: &Problem, q: &[Uv]) -> (f64, Vec<f64>, Vec<f64>) {
        let (nodes, side, step) = (&*problem.nodes, problem.example.side, problem.nodes.step);
        let (n, unit) = (2 * q.len(), nodes.unit());
        let node = |i: usize, j: usize| {
            let (x, mut gradient) = ([i as f64 * unit, j as f64 * unit], vec![[0.0; 4]; q.len()]);
            let y = MlsTerms::new(nodes.domain, &nodes.p, x).with_gradient(nodes.domain, q, &mut gradient);
            ([y[0] - x[0], y[1] - x[1]], gradient)
        };
        let (mut energy, mut gradient, mut matrix) = (0.0, vec![0.0; n], vec![0.0; n * n]);
        let weight = 1.0 / (side * side) as f64;
        for y in 0..side {
            for x in 0..side {
                let f = [x, y].map(|x| ((x % step) as f64 + 0.5) / step as f64);
                let (mut moved, mut rows) = ([0.0; 2], vec![[0.0; 2]; n]);
                for corner in 0..4 {
                    let (i, j) = (x / step + corner % 2, y / step + corner / 2);
                    let (d, g) = node(i % nodes.grid.columns, j);
                    let share = [corner % 2, corner / 2].into_iter().zip(f);
                    let phi: f64 = share.map(|(up, f)| if up == 1 { f } else { 1.0 - f }).product();
                    (0..2).for_each(|c| moved[c] += phi * d[c]);
                    for (k, g) in g.into_iter().enumerate() {
                        (0..2).for_each(|c| rows[2 * k][c] += phi * g[c]);
                        (0..2).for_each(|c| rows[2 * k + 1][c] += phi * g[2 + c]);
                    }
                }
                let at = problem.example.centre(x, y);
                let (value, slope) = problem.query.sample([at[0] + moved[0], at[1] + moved[1]]);
                let r = value - problem.example.pixel(x, y);
                let along: Vec<f64> = rows.iter().map(|d| slope[0] * d[0] + slope[1] * d[1]).collect();
                energy += weight * r * r;
                for i in 0..n {
                    gradient[i] += weight * r * along[i];
                    (0..n).for_each(|j| matrix[i * n + j] += weight * along[i] * along[j]);
                }
            }
        }
        (energy, gradient, matrix)
    }

    #[test]
    fn the_equations_are_those_of_the_plain_definition_pixel_by_pixel() {
        for domain in domains() {
            let (example, query) = (image(32, 0.0), image(32, 0.07));
            let problem = Problem::new(Arc::new(Nodes::new(domain, 32, &P)), &example, &query);
            let pixels = problem.pixels(&Q);
            let found = problem.normal(&Q, &pixels);
            let (energy, gradient, matrix) = plain(&problem, &Q);
            assert!((pixels.energy - energy).abs() < 1e-9 * energy);
            let largest = |all: &[f64]| all.iter().fold(0.0f64, |most, x| most.max(x.abs()));
            for (found, expected) in [(&found.gradient, &gradient), (&found.matrix, &matrix)] {
                let apart: Vec<f64> = found.iter().zip(expected).map(|(a, b)| a - b).collect();
                assert!(
                    largest(&apart) < 1e-5 * largest(expected),
                    "{domain:?}: {} {}",
                    largest(&apart),
                    largest(expected)
                );
            }
        }
    }

    #[test]
    fn the_gradient_is_half_the_difference_of_the_energies() {
        let (example, query) = (image(64, 0.0), image(64, 0.07));
        for domain in domains() {
            let problem = Problem::new(Arc::new(Nodes::new(domain, 64, &P)), &example, &query);
            let gradient = problem.normal(&Q, &problem.pixels(&Q)).gradient;
            let largest = gradient.iter().fold(0.0f64, |most, x| most.max(x.abs()));
            for (k, found) in gradient.iter().enumerate() {
                let energy = |h: f64| {
                    let mut moved = Q;
                    moved[k / 2][k % 2] += h;
                    problem.energy(&moved)
                };
                let h = 1e-4;
                // Bilinear pictures have kinks, where the slope is not the difference.
                let expected = (energy(h) - energy(-h)) / (4.0 * h);
                assert!((found - expected).abs() < 0.02 * largest, "{k}: {found} {expected}");
            }
        }
    }
}
