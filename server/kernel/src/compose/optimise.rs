//! Slides the vertices of a net along the input until its quads are rectangles of the wanted sizes.
//!
//! E(x) = Σ_q h_q⁻² Σ_k |x_qk − c_q − r_qk|² + Σ_v s_v κ_v |x_v − x⁰_v|², x on the input: c_q is the mean of the corners
//! x_qk of quad q, r_q the rectangle that it would be, h_q the edge that is wanted there, s_v the stiffness that holds a vertex at
//! its place x⁰_v, and κ_v the weight that its quads give it. With S = (x₁ + x₂ − x₀ − x₃)/4 and T = (x₂ + x₃ − x₀ − x₁)/4
//! as complex numbers in the quad's plane, the nearest rectangle has the corners e^{iθ}(±a ± ib), 2θ = arg(S² − T²),
//! a = Re e^{−iθ}S, b = Im e^{−iθ}T; its size √(ab) goes towards h_q/2, and the ratio of its sides towards 1, by a part of the way.
//!
//! Local step: r_q. Global step: one solve of the quadratic form by a factor made once, of what is asked for along the
//! input; what comes out is again taken along the input, and each vertex put back onto it. As P L⁻¹ P, P taking the
//! tangential part, is positive, E falls. A share of the last move goes into the next, as long as E falls.
//! *Source:* Bouaziz et al., *Shape-Up: shaping discrete geometry with projections* (2012), local and global step and
//! the rectangle. *Ours, not the paper's:* on a surface; sizes; and that it is used where seams are to lose their shear.

use super::check::{quad_area, quad_area_vector};
use super::net::Net;
use super::smooth::Target;
use crate::mesh::{NONE, Vec3};
use crate::numerics::many_in_halves;
use crate::numerics::sparse::{Factored, Pattern};
use crate::numerics::stage::Stage;

/// Part of the way that a size goes, in logarithms, not to the one wanted, but to the one that a quad has.
const SIZE_FREEDOM: f64 = 0.5;
/// The same for the ratio of the sides, which is at most so much before.
const RATIO_FREEDOM: f64 = 0.8;
const RATIO_MAX: f64 = 3.0;
/// A side shorter than this share of the nearest square's has no direction: then that square is taken.
const THIN: f64 = 0.1;
/// Share of the last move that goes into the next.
const MOMENTUM: f64 = 0.7;
/// Where E has grown, steps become shorter by this factor, down to this share.
const SHORTER: f64 = 0.7;
const STEP_MIN: f64 = 0.3;
/// E no longer falls when it did not fall by this share in so many rounds: on 351 nets of three scans nine of ten had come within 1 %
/// of their least by then (`tests/records/seconds-2026-11-26c.md`).
const FALL_MIN: f64 = 1e-3;
const PATIENCE: u32 = 8;
/// Longest step, in edges that are wanted.
const STEP_MAX: f64 = 0.5;
/// What is added to the diagonal, as a share of it: a closed net has no place of its own.
const DAMPING: f64 = 1e-3;
/// Cosine to the mean normal of its corners up to which a quad's own normal is not believed.
const TURNED: f64 = 0.2;
/// Rounds in which wanted sizes are evened out.
const EVENING_ROUNDS: usize = 100;
/// Smallest area, as a share of the mean, that counts for a size.
const AREA_MIN: f64 = 1e-4;

/// A quad with the edge that is wanted of it, and the weight that this gives it.
#[derive(Clone, Copy, Debug)]
struct Quad {
    corners: [u32; 4],
    edge: f64,
    weight: f64,
}

impl Quad {
    fn at(&self, positions: &[Vec3]) -> [Vec3; 4] {
        self.corners.map(|v| positions[v as usize])
    }
}

/// Runs up to `rounds` rounds, until E no longer falls. `stiffness` of each vertex: 0 for one that is free, ∞ for one that stays.
pub fn optimise(net: &mut Net, target: &Target, stiffness: &[f64], rounds: u32) {
    if !Stage::Optimise.is_on() {
        return;
    }
    let Some(mut state) = State::new(net, stiffness) else { return };
    let mut least = (f64::INFINITY, state.positions.clone());
    let mut last_fall = (f64::INFINITY, 0);
    for round in 0..=rounds {
        let asked = state.ask();
        if asked.energy < least.0 {
            least = (asked.energy, state.positions.clone());
        }
        if asked.energy < last_fall.0 * (1.0 - FALL_MIN) {
            last_fall = (asked.energy, round);
        }
        if round == rounds || round >= last_fall.1 + PATIENCE {
            break;
        }
        state.go(asked, target);
    }
    for (&v, p) in state.vertices.iter().zip(least.1).take(state.free) {
        net.positions[v as usize] = p;
    }
}

/// E where the vertices are, minus half its gradient with r_q held, and their normals.
struct EnergyGradient {
    energy: f64,
    pull: Vec<Vec3>,
    normals: Vec<Vec3>,
}

/// The quads with a corner that moves, and their vertices, which are numbered anew: those that move come first.
struct State {
    /// The number of each vertex in the net.
    vertices: Vec<u32>,
    /// How many move.
    free: usize,
    positions: Vec<Vec3>,
    quads: Vec<Quad>,
    /// The share of each vertex's normal that comes from quads of which no corner moves.
    normals_beside: Vec<Vec3>,
    /// s_v κ_v, x⁰_v and the longest step of each vertex that moves.
    springs: Vec<f64>,
    start: Vec<Vec3>,
    step_max: Vec<f64>,
    factor: Factored,
    /// By how much each vertex that moves went in the last round, where that did good.
    last: Vec<Vec3>,
    step: f64,
    energy: f64,
}

impl State {
    /// `None` where no vertex moves.
    fn new(net: &Net, stiffness: &[f64]) -> Option<Self> {
        let count = net.positions.len();
        if stiffness.len() != count {
            return None;
        }
        let moves = |v: &u32| !stiffness[*v as usize].is_infinite();
        let (mut quads, others): (Vec<Quad>, Vec<Quad>) =
            quads(net).into_iter().partition(|q| q.corners.iter().any(moves));
        let mut vertices: Vec<u32> = quads.iter().flat_map(|q| q.corners).collect();
        vertices.sort_unstable_by_key(|v| (!moves(v), *v));
        vertices.dedup();
        let n = vertices.partition_point(moves);
        if n == 0 {
            return None;
        }
        let mut number = vec![NONE; count];
        vertices.iter().zip(0..).for_each(|(&v, k)| number[v as usize] = k);
        quads.iter_mut().for_each(|q| q.corners = q.corners.map(|v| number[v as usize]));
        let positions: Vec<Vec3> = vertices.iter().map(|&v| net.positions[v as usize]).collect();
        let mut normals_beside = vec![Vec3::zeros(); vertices.len()];
        for quad in others {
            let normal = quad_area_vector(quad.at(&net.positions));
            for v in quad.corners.map(|v| number[v as usize]).into_iter().filter(|&v| v != NONE) {
                normals_beside[v as usize] += normal;
            }
        }
        let (mut weights, mut edges) = (vec![0.0; vertices.len()], vec![(0.0, 0.0); vertices.len()]);
        for quad in &quads {
            for &v in &quad.corners {
                weights[v as usize] += 0.75 * quad.weight;
                edges[v as usize] = (edges[v as usize].0 + quad.edge, edges[v as usize].1 + 1.0);
            }
        }
        let springs: Vec<f64> = (0..n).map(|k| stiffness[vertices[k] as usize] * weights[k]).collect();
        let diagonal: Vec<f64> = (0..n).map(|k| weights[k] * (1.0 + DAMPING) + springs[k]).collect();
        let pairs = |q: &Quad| {
            let c = q.corners;
            let pairs = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]].map(|[i, j]| (c[i], c[j]));
            pairs.into_iter().filter(move |&(a, b)| a.max(b) < n as u32)
        };
        let pattern = Pattern::new(n, quads.iter().flat_map(pairs)).ok()?;
        let entries = quads.iter().flat_map(|q| pairs(q).map(|(a, b)| (a, b, -0.25 * q.weight)));
        let factor = pattern.factor(&diagonal, entries, &vec![false; n]).ok()?;
        Some(Self {
            free: n,
            quads,
            normals_beside,
            springs,
            start: positions[..n].to_vec(),
            step_max: edges[..n].iter().map(|(sum, count)| STEP_MAX * sum / count).collect(),
            factor,
            last: vec![Vec3::zeros(); n],
            step: 1.0,
            energy: f64::INFINITY,
            vertices,
            positions,
        })
    }

    fn ask(&self) -> EnergyGradient {
        let positions = &self.positions;
        let normals = self.normals();
        let missing = |quad: &Quad| {
            let p = quad.at(positions);
            let around = quad.corners.iter().map(|&v| normals[v as usize]).sum();
            let centre = p.iter().sum::<Vec3>() / 4.0;
            rectangle(p, around, quad.edge).map(|to| [0, 1, 2, 3].map(|k| to[k] - (p[k] - centre)))
        };
        let (mut energy, mut pull) = (0.0, vec![Vec3::zeros(); positions.len()]);
        for (quad, missing) in self.quads.iter().zip(many_in_halves(&self.quads, missing)) {
            for (&v, missing) in quad.corners.iter().zip(missing.into_iter().flatten()) {
                pull[v as usize] += missing * quad.weight;
                energy += quad.weight * missing.norm_squared();
            }
        }
        for (v, start) in self.start.iter().enumerate() {
            let back = start - positions[v];
            pull[v] += back * self.springs[v];
            energy += self.springs[v] * back.norm_squared();
        }
        EnergyGradient { energy, pull, normals }
    }

    /// Unit normals; zero where there is none.
    fn normals(&self) -> Vec<Vec3> {
        let mut sums = self.normals_beside.clone();
        for quad in &self.quads {
            let normal = quad_area_vector(quad.at(&self.positions));
            quad.corners.iter().for_each(|&v| sums[v as usize] += normal);
        }
        sums.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros)).collect()
    }

    /// One global step; `asked` is for where the vertices are.
    fn go(&mut self, asked: EnergyGradient, target: &Target) {
        if asked.energy > self.energy {
            self.last.iter_mut().for_each(|d| *d = Vec3::zeros());
            self.step = (SHORTER * self.step).max(STEP_MIN);
        }
        self.energy = asked.energy;
        let along = |v: usize, d: Vec3| d - asked.normals[v] * asked.normals[v].dot(&d);
        let n = self.free;
        let mut moves = vec![0.0; 3 * n];
        for v in 0..n {
            let pull = along(v, asked.pull[v]);
            (0..3).for_each(|k| moves[k * n + v] = pull[k]);
        }
        self.factor.solve_columns(&mut moves, 3);
        let aim = |v: usize| {
            let solved = along(v, Vec3::new(moves[v], moves[n + v], moves[2 * n + v])) * self.step;
            let share = (self.step_max[v] / solved.norm()).min(1.0);
            self.positions[v] + solved * share + self.last[v] * MOMENTUM
        };
        let aims: Vec<Vec3> = (0..n).map(aim).collect();
        for (v, to) in target.all_onto_surface(&aims).into_iter().enumerate() {
            self.last[v] = to - self.positions[v];
            self.positions[v] = to;
        }
    }
}

/// The quads of a net, the edge wanted of each the mean, by logarithms, of those around it.
fn quads(net: &Net) -> Vec<Quad> {
    let corners: Vec<[u32; 4]> = net.faces().filter_map(|(_, c)| c.try_into().ok()).collect();
    let area = |c: &[u32; 4]| quad_area(c.map(|v| net.positions[v as usize]));
    let areas: Vec<f64> = corners.iter().map(area).collect();
    let least = AREA_MIN * areas.iter().sum::<f64>() / areas.len().max(1) as f64;
    if least <= 0.0 || !least.is_finite() {
        return Vec::new();
    }
    let mut logs: Vec<f64> = areas.iter().map(|a| 0.5 * a.max(least).ln()).collect();
    for _ in 0..EVENING_ROUNDS {
        let mut at = vec![(0.0, 0.0); net.positions.len()];
        for (c, x) in corners.iter().zip(&logs) {
            c.iter().for_each(|&v| at[v as usize] = (at[v as usize].0 + x, at[v as usize].1 + 1.0));
        }
        for (c, x) in corners.iter().zip(&mut logs) {
            *x = c.iter().map(|&v| at[v as usize].0 / at[v as usize].1).sum::<f64>() / 4.0;
        }
    }
    let quad = |(corners, x): ([u32; 4], f64)| Quad { corners, edge: x.exp(), weight: (-2.0 * x).exp() };
    corners.into_iter().zip(logs).map(quad).collect()
}

/// The corners, about its centre, of the rectangle that a quad would be; `around` points to the side on which its normal
/// is to be. `None` where it has no directions.
fn rectangle(p: [Vec3; 4], around: Vec3, edge: f64) -> Option<[Vec3; 4]> {
    let (own, around) = (quad_area_vector(p).try_normalize(0.0), around.try_normalize(0.0));
    let normal = match (own, around) {
        (Some(own), Some(around)) if own.dot(&around) <= TURNED => around,
        (own, around) => own.or(around)?,
    };
    let (s, t) = ((p[1] + p[2] - p[0] - p[3]) / 4.0, (p[2] + p[3] - p[0] - p[1]) / 4.0);
    let x = (s - normal * normal.dot(&s)).try_normalize(0.0)?;
    let y = normal.cross(&x);
    let [s, t] = [s, t].map(|d| [d.dot(&x), d.dot(&y)]);
    // The nearest square: its direction arg(S − iT), half its side |S − iT|/2.
    let square = [s[0] + t[1], s[1] - t[0]];
    let size = square[0].hypot(square[1]) / 2.0;
    let turn = square[1].atan2(square[0]);
    let double = [s[0] * s[0] - s[1] * s[1] - t[0] * t[0] + t[1] * t[1], 2.0 * (s[0] * s[1] - t[0] * t[1])];
    let nearest = double[1].atan2(double[0]) / 2.0;
    // Of the two opposite directions that which is also the square's.
    let theta = if (nearest - turn).cos() < 0.0 { nearest + std::f64::consts::PI } else { nearest };
    let sides = |theta: f64| [theta.cos() * s[0] + theta.sin() * s[1], theta.cos() * t[1] - theta.sin() * t[0]];
    let [a, b] = sides(theta);
    let (theta, a, b) = if a.min(b) > THIN * size { (theta, a, b) } else { (turn, size, size) };
    if a <= 0.0 || b <= 0.0 {
        return None;
    }
    let mean = 0.5 * edge * (2.0 * (a * b).sqrt() / edge).powf(SIZE_FREEDOM);
    let root = (a / b).clamp(1.0 / RATIO_MAX, RATIO_MAX).powf(0.5 * RATIO_FREEDOM);
    let (sin, cos) = theta.sin_cos();
    let (along, up) = ((x * cos + y * sin) * (mean * root), (y * cos - x * sin) * (mean / root));
    Some([-along - up, along - up, along + up, up - along])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;
    use crate::compose::square::mean_deviation_deg;
    use crate::topology::tests::grid;

    const SIDE: u32 = 10;

    /// A sheet of unit side, its inner vertices moved, what lies beneath it, and its boundary held.
    fn moved(by: impl Fn(Vec3) -> Vec3) -> (Net, Target, Vec<f64>) {
        let mut net = sheet(SIDE, SIDE);
        net.positions.iter_mut().for_each(|p| *p /= f64::from(SIDE));
        let stiffness: Vec<f64> =
            (0..net.positions.len() as u32).map(|v| if net.on_boundary(v) { f64::INFINITY } else { 0.0 }).collect();
        for (p, _) in net.positions.iter_mut().zip(&stiffness).filter(|(_, s)| **s == 0.0) {
            *p = by(*p);
        }
        (net, Target::new(&grid(12, 12, false, false)), stiffness)
    }

    fn wave(p: Vec3) -> Vec3 {
        p + Vec3::new(0.06 * (9.0 * p.y).sin(), 0.05 * (7.0 * p.x).cos(), 0.0)
    }

    fn farthest(a: &[Vec3], b: &[Vec3]) -> f64 {
        a.iter().zip(b).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn a_parallelogram_would_be_a_rectangle_on_the_side_that_its_corners_look_to() {
        let p = [[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let turned = [p[3], p[2], p[1], p[0]];
        for (p, around) in [(p, Vec3::z()), (turned, -Vec3::z()), (p, -Vec3::z())] {
            let r = rectangle(p, around, 2f64.sqrt()).expect("it has directions");
            for k in 0..4 {
                let (e, f) = (r[(k + 1) % 4] - r[k], r[(k + 3) % 4] - r[k]);
                assert!(e.dot(&f).abs() < 1e-12 && e.norm() > 0.3, "{r:?}");
            }
            assert!(quad_area_vector(r).dot(&around) > 0.0, "{r:?}");
        }
    }

    #[test]
    fn a_rectangle_of_the_size_wanted_stays_but_for_its_ratio() {
        let p = [[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let r = rectangle(p, Vec3::z(), 8f64.sqrt()).expect("it has directions");
        let ratio = (r[1].x - r[0].x) / (r[3].y - r[0].y);
        assert!((ratio - 2f64.powf(RATIO_FREEDOM)).abs() < 1e-12, "{ratio}");
        assert!((quad_area_vector(r).z - quad_area_vector(p).z).abs() < 1e-12);
    }

    #[test]
    fn a_sheared_sheet_gets_its_right_angles_back_and_a_square_one_stays() {
        let (mut net, target, stiffness) = moved(wave);
        let (square, ..) = moved(|p| p);
        let before = (mean_deviation_deg(&net), farthest(&net.positions, &square.positions));
        optimise(&mut net, &target, &stiffness, 60);
        let after = (mean_deviation_deg(&net), farthest(&net.positions, &square.positions));
        assert!(after.0 < 0.1 * before.0 && after.1 < 0.2 * before.1, "{before:?} to {after:?}");
        assert!(net.positions.iter().all(|p| p.z.abs() < 1e-12));
        let mut still = square.clone();
        optimise(&mut still, &target, &stiffness, 10);
        assert!(farthest(&still.positions, &square.positions) < 1e-9);
    }

    #[test]
    fn what_is_held_stays_and_what_is_firm_goes_less_far() {
        let middle = (6 * (SIDE + 1) + 5) as usize;
        let gone = [0.0, 1.0, f64::INFINITY].map(|firm| {
            let (mut net, target, mut stiffness) = moved(wave);
            let start = net.positions.clone();
            stiffness[middle] = firm;
            optimise(&mut net, &target, &stiffness, 60);
            let border = (0..start.len()).filter(|&v| v != middle && stiffness[v].is_infinite());
            assert!(border.into_iter().all(|v| net.positions[v] == start[v]));
            (net.positions[middle] - start[middle]).norm()
        });
        assert!(gone[0] > 1.3 * gone[1] && gone[1] > 0.0 && gone[2] == 0.0, "{gone:?}");
    }

    #[test]
    fn crowded_quads_spread() {
        let (mut net, target, stiffness) = moved(|p| p.map(|x| x.powf(1.5)));
        let spread = |net: &Net| {
            let areas = quads(net).iter().map(|q| quad_area(q.at(&net.positions))).collect::<Vec<_>>();
            areas.iter().copied().fold(0.0, f64::max) / areas.iter().copied().fold(f64::INFINITY, f64::min)
        };
        let before = spread(&net);
        optimise(&mut net, &target, &stiffness, 60);
        assert!(spread(&net) < 0.3 * before, "{before} to {}", spread(&net));
    }

    #[test]
    fn a_net_without_area_stays_as_it_is() {
        let (mut net, target, stiffness) = moved(|p| p);
        net.positions.iter_mut().for_each(|p| *p = Vec3::zeros());
        let start = net.positions.clone();
        optimise(&mut net, &target, &stiffness, 3);
        assert_eq!(net.positions, start);
    }
}
