//! The registration energy of one level: E(q) = mean over pixels of (√λ₂(ψ(x)) − √λ₁(x))².
//!
//! ψ and its derivatives are evaluated on a grid of nodes and interpolated (an MLS map is smooth); λ is sampled at
//! every pixel. Its normal equations are [`super::normal`]'s. *Source:* paper Eq. 6 and §5.2; METHOD §5.

use std::sync::Arc;

use super::folds::folded;
use super::image::Image;
use super::nodes::{Displacements, Nodes};
use super::normal::{Normal, normal};
use crate::numerics::wide::{Wide, wide};
use crate::unfold::Uv;

/// Pixels of a row that are sampled side by side; a side is a multiple of it.
const LANES: usize = 8;

/// One level of one registration, prepared.
pub struct Problem<'a> {
    /// √λ₁, mirrored as the flip asks.
    pub example: &'a Image,
    /// √λ₂.
    pub query: &'a Image,
    /// The map's nodes.
    pub nodes: Arc<Nodes>,
}

/// What every pixel shows under a map.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// E.
    pub energy: f64,
    /// √λ₂(ψ(x)) − √λ₁(x) of each pixel, row by row.
    pub residual: Vec<f32>,
    /// ∇√λ₂ there, by u and by v.
    pub slope: [Vec<f32>; 2],
}

impl<'a> Problem<'a> {
    /// Two images of the side for which the nodes were made.
    pub fn new(nodes: Arc<Nodes>, example: &'a Image, query: &'a Image) -> Self {
        Self { example, query, nodes }
    }

    /// Controls on the example.
    pub fn p(&self) -> &[Uv] {
        &self.nodes.p
    }

    /// What every pixel shows with controls at `q`.
    pub fn pixels(&self, q: &[Uv]) -> Pixels {
        let none = Pixels { energy: f64::INFINITY, residual: Vec::new(), slope: [Vec::new(), Vec::new()] };
        wide(Look { problem: self, q, folded: Folded::Too }).unwrap_or(none)
    }

    /// The same, unless a node cell is turned over there.
    pub fn unfolded_pixels(&self, q: &[Uv]) -> Option<Pixels> {
        wide(Look { problem: self, q, folded: Folded::Never })
    }

    /// E at `q`.
    pub fn energy(&self, q: &[Uv]) -> f64 {
        self.pixels(q).energy
    }

    /// Node cells that `q` turns over (either triangle).
    pub fn folded_cells(&self, q: &[Uv]) -> Vec<Uv> {
        self.folds_of(&self.nodes.displacements(q)).collect()
    }

    #[inline(always)]
    fn folds_of(&self, displacements: &Displacements) -> impl Iterator<Item = Uv> {
        let (grid, [u, v]) = (self.nodes.grid, &displacements.0);
        folded(grid.columns, grid.rows, self.nodes.unit(), move |column, row| {
            let at = grid.at(column, row);
            [u[at], v[at]]
        })
    }

    /// E's gradient and Gauss–Newton matrix at `q`, where the pixels show what [`Self::pixels`] found there.
    pub fn normal(&self, q: &[Uv], pixels: &Pixels) -> Normal {
        normal(&self.nodes, q, pixels)
    }

    #[inline(always)]
    fn look(&self, displacements: &Displacements) -> Pixels {
        let (nodes, side) = (&*self.nodes, self.example.side);
        let (grid, step) = (nodes.grid, nodes.step);
        let mut pixels = Pixels {
            energy: 0.0,
            residual: vec![0.0; side * side],
            slope: [vec![0.0; side * side], vec![0.0; side * side]],
        };
        let mut sums = [0.0; LANES];
        // Displacements of a row of pixels, first at the nodes' columns, one beyond the last.
        let (mut at_nodes, mut moved) = (vec![[0.0; 2]; grid.columns + 1], vec![[0.0; 2]; side]);
        for y in 0..side {
            let (row, f) = (y / step, ((y % step) as f64 + 0.5) / step as f64);
            for (column, to) in at_nodes.iter_mut().enumerate() {
                let (low, high) = (grid.at(column, row), grid.at(column, row + 1));
                *to = [0, 1].map(|c| (1.0 - f) * displacements.0[c][low] + f * displacements.0[c][high]);
            }
            for (pair, cell) in at_nodes.windows(2).zip(moved.chunks_exact_mut(step)) {
                for (dx, to) in cell.iter_mut().enumerate() {
                    let f = (dx as f64 + 0.5) / step as f64;
                    *to = [0, 1].map(|c| pair[0][c] + f * (pair[1][c] - pair[0][c]));
                }
            }
            self.look_along(y, &moved, &mut sums, &mut pixels);
        }
        pixels.energy = sums.iter().sum::<f64>() / (side * side) as f64;
        pixels
    }

    /// A row of pixels, moved so.
    #[inline(always)]
    fn look_along(&self, y: usize, moved: &[Uv], sums: &mut [f64; LANES], pixels: &mut Pixels) {
        let side = self.example.side;
        let unit = 1.0 / side as f64;
        let v0 = (y as f64 + 0.5) * unit;
        let own = self.example.row(y).as_chunks::<LANES>().0.iter().zip(moved.as_chunks::<LANES>().0);
        for (k, (own, moved)) in own.enumerate() {
            let mut at = [[0.0; LANES]; 2];
            for x in 0..LANES {
                at[0][x] = ((k * LANES + x) as f64 + 0.5) * unit + moved[x][0];
                at[1][x] = v0 + moved[x][1];
            }
            let (value, du, dv) = self.query.samples(at);
            let from = y * side + k * LANES;
            let residual = &mut pixels.residual[from..from + LANES];
            for x in 0..LANES {
                let difference = value[x] - own[x];
                sums[x] += difference * difference;
                residual[x] = difference as f32;
            }
            for (slope, found) in pixels.slope.iter_mut().zip([du, dv]) {
                for (to, from) in slope[from..from + LANES].iter_mut().zip(found) {
                    *to = from as f32;
                }
            }
        }
    }
}

/// Whether maps that turn cells over have an energy.
enum Folded {
    Too,
    Never,
}

struct Look<'a> {
    problem: &'a Problem<'a>,
    q: &'a [Uv],
    folded: Folded,
}

impl Wide for Look<'_> {
    type Output = Option<Pixels>;

    #[inline(always)]
    fn run(self) -> Option<Pixels> {
        let displacements = self.problem.nodes.displacements(self.q);
        if matches!(self.folded, Folded::Never) && self.problem.folds_of(&displacements).next().is_some() {
            return None;
        }
        Some(self.problem.look(&displacements))
    }
}
