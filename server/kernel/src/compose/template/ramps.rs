//! Harmonic maps onto rectangles, as sums of a few known functions.
//!
//! Along a boundary of n columns the coordinates of a rectangle are linear from corner to corner: with t the place and c the
//! corners, x(t) = x(0) + x'(0)·t + Σ_c Δ_c·max(0, t − c), Δ_c by how much the slope changes there. Harmonic extension is
//! linear, so one solution for each of the functions 1 and max(0, t − c) of each boundary, 0 on the others, is enough for
//! all rectangles that are tried; each is solved when it is first asked for. *Ours, not the paper's.*

use super::frame::Corners;
use std::collections::HashMap;

/// Most values that are held; beyond, those held are let go.
const VALUES_MAX: usize = 8 << 20;

/// Extends what a function of the place gives on one boundary, with 0 on the others.
pub type Extend<'a> = dyn Fn(usize, &dyn Fn(f64) -> f64) -> Vec<f64> + 'a;

/// The functions known so far.
pub struct Ramps<'a> {
    extend: Box<Extend<'a>>,
    /// By boundary, and by the corner of max(0, t − c); none for 1.
    known: HashMap<(usize, Option<usize>), Vec<f64>>,
}

impl<'a> Ramps<'a> {
    /// None known yet.
    pub fn new(extend: Box<Extend<'a>>) -> Self {
        Self { extend, known: HashMap::new() }
    }

    /// x and y where each boundary lies on a rectangle, moved by so much.
    pub fn map(&mut self, boundaries: &[(Corners, [f64; 2])]) -> [Vec<f64>; 2] {
        let mut sum = [Vec::new(), Vec::new()];
        for (boundary, &(corners, moved)) in boundaries.iter().enumerate() {
            for (ramp, weights) in terms(corners, moved) {
                let values = self.known((boundary, ramp));
                for (sum, w) in sum.iter_mut().zip(weights) {
                    sum.resize(values.len(), 0.0);
                    if w != 0.0 {
                        sum.iter_mut().zip(values).for_each(|(s, x)| *s += w * x);
                    }
                }
            }
        }
        sum
    }

    fn known(&mut self, which: (usize, Option<usize>)) -> &[f64] {
        let size = self.known.values().next().map_or(0, Vec::len);
        if (self.known.len() + 1) * size > VALUES_MAX && !self.known.contains_key(&which) {
            self.known.clear();
        }
        let Self { extend, known } = self;
        known.entry(which).or_insert_with(|| match which {
            (boundary, None) => extend(boundary, &|_| 1.0),
            (boundary, Some(corner)) => extend(boundary, &|t| (t - corner as f64).max(0.0)),
        })
    }
}

/// The weights of 1 (none) and of max(0, t − c) in x and y.
fn terms(corners: Corners, moved: [f64; 2]) -> Vec<(Option<usize>, [f64; 2])> {
    let (f, a, b) = (corners.first, corners.a, corners.b);
    let at = |k: usize| corners.at(k as f64);
    let slope = |k: usize| [0, 1].map(|d| at(k + 1)[d] - at(k)[d]);
    let round = 2 * (a + b);
    let start = [0, 1].map(|d| at(0)[d] + moved[d]);
    let mut all = vec![(None, start), (Some(0), slope(0))];
    for corner in [f, f + a, f + a + b, f + 2 * a + b].map(|c| c % round).into_iter().filter(|c| *c > 0) {
        let (before, after) = (slope(corner - 1), slope(corner));
        all.push((Some(corner), [0, 1].map(|d| after[d] - before[d])));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_of_ramps_goes_around_the_rectangle() {
        let places: Vec<f64> = (0..=240).map(|k| f64::from(k) / 10.0).collect();
        for (first, a) in [(0, 1), (0, 5), (3, 7), (11, 4), (20, 11), (23, 6)] {
            let corners = Corners::new(first, a, 12).expect("24 columns");
            let hole = Corners::new(first + 2, 2, 12).expect("24 columns");
            // One value a boundary and place, no surface between.
            let extend = |boundary: usize, f: &dyn Fn(f64) -> f64| -> Vec<f64> {
                (0..2).flat_map(|k| places.iter().map(move |&t| if k == boundary { f(t) } else { 0.0 })).collect()
            };
            let mut ramps = Ramps::new(Box::new(extend));
            let [x, y] = ramps.map(&[(corners, [0.0, 0.0]), (hole, [5.0, -2.0])]);
            for (k, &t) in places.iter().enumerate() {
                let ([p, q], [r, s]) = (corners.at(t), hole.at(t));
                let found = [x[k], y[k], x[k + places.len()] - 5.0, y[k + places.len()] + 2.0];
                assert!([p, q, r, s].iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-9), "{first} {a} {t}");
            }
        }
    }
}
