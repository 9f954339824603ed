//! An integer-grid map: coordinates at each vertex whose lines of whole numbers become the edges of quads.
//!
//! E(u, x) = Σ_ij w |R(k_ij) u_j + t_ij(x) − u_i − d_ij|², d_ij the edge in the frames of its ends, in edges of the quads, x
//! the whole numbers of [`jumps`](super::jumps). u is eliminated: A u + B x = b, so that E in x alone has the matrix
//! S = C − BᵀA⁻¹B, on which x is rounded. On lines and boundaries the coordinate across is held at a whole number.
//! *Source:* Bommes, Zimmer, Kobbelt, *Mixed-integer quadrangulation* (2009), §3 and 5. *Ours, not the paper's:* edges in
//! place of triangles, since the triangles are even; one factor for all whole numbers; a stiff weight for lines.

use super::cross::{CrossField, edges};
use super::curvature::finer;
use super::jumps::{Jumps, jumps, quarter_turn};
use super::plane::{Complex, Planes};
use super::rounding::{Quadratic, rounded};
use crate::mesh::disjoint::Sets;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::sparse::{Factored, Pattern};
use crate::numerics::stop;
use std::collections::BTreeMap;

/// Weight that holds lines at whole numbers, against 1 of other edges: *untuned*.
const LINE_WEIGHT: f64 = 1e4;
/// This is added to the diagonal: a torus without singular points may be shifted as a whole.
const DAMPING: f64 = 1e-9;
/// Most whole numbers: their matrix is dense.
const NUMBERS_MAX: usize = 1600;
/// Most coefficients of whole numbers at edges.
const ENTRIES_MAX: usize = 4_000_000;
/// By how much a map may be enlarged or made smaller at most: *untuned*.
const SCALE_MAX: f64 = 1.3;
/// Columns that are solved for at a time.
const COLUMNS: usize = 16;

/// The map.
#[derive(Clone, Debug)]
pub(super) struct GridMap {
    pub(super) jumps: Jumps,
    /// Coordinates at each vertex, in its turned frame.
    pub(super) at: Vec<[f64; 2]>,
    /// Pairs of whole numbers.
    pub(super) pairs: Vec<[i64; 2]>,
}

/// A line's vertex whose coordinate across, an axis, is a whole number.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    vertex: u32,
    axis: usize,
}

/// The map of a field for quads with edges of length `h`; `None` where there are too many whole numbers, or none fit.
pub(super) fn grid_map(mesh: &TriMesh, planes: &Planes, field: &CrossField, sharp: &[u32], h: f64) -> Option<GridMap> {
    let jumps = jumps(mesh, field, ENTRIES_MAX)?;
    let frame: Vec<Complex> = (0..mesh.positions.len())
        .map(|v| Complex::from_angle(-(field.angle[v] + f64::from(jumps.gauge[v]) * std::f64::consts::FRAC_PI_2)))
        .collect();
    let finer = finer(mesh, planes, h);
    let wanted = |e: u32| {
        let shorter = 0.5 * (finer[mesh.tail(e) as usize] + finer[mesh.head(e) as usize]);
        wanted(mesh, planes, &frame, &jumps, e, h / shorter)
    };
    let border = (0..mesh.twins.len() as u32).filter(|&e| mesh.twin(e) == NONE);
    let lines: BTreeMap<u32, usize> = border
        .chain(sharp.iter().map(|&e| if mesh.twin(e) == NONE { e } else { e.min(mesh.twin(e)) }))
        .map(|e| (e, usize::from(wanted(e)[0].abs() > wanted(e)[1].abs())))
        .collect();
    let anchors = anchors(mesh, &jumps, &lines);
    let numbers = 2 * jumps.pairs + anchors.len();
    if numbers > NUMBERS_MAX {
        return None;
    }
    let system = System::new(mesh, &jumps, &lines, &anchors, wanted);
    let Reduced { factored, form, g } = system.reduced(&jumps)?;
    let mean = form.as_ref().map_or(&[][..], |form| &form.mean);
    let laid = system.places(&factored, mean, 1.0);
    // The map that is nearest to a field is smaller than the surface, and finer quads make it larger.
    let area = laid_area(mesh, &jumps, &laid, mean).max(f64::MIN_POSITIVE);
    let scale = (mesh.total_area() / (h * h) / area).sqrt().clamp(SCALE_MAX.recip(), SCALE_MAX);
    let x = form.map_or(Some(Vec::new()), |form| rounded(&form, &g, scale))?;
    let u = system.places(&factored, &x.iter().map(|x| *x as f64).collect::<Vec<_>>(), scale);
    let at = u.chunks_exact(2).map(|u| [u[0], u[1]]).collect();
    let pairs = x[..2 * jumps.pairs].chunks_exact(2).map(|x| [x[0], x[1]]).collect();
    Some(GridMap { jumps, at, pairs })
}

/// d of a halfedge, as both ends see it.
fn wanted(mesh: &TriMesh, planes: &Planes, frame: &[Complex], jumps: &Jumps, e: u32, h: f64) -> [f64; 2] {
    let (i, j) = (mesh.tail(e), mesh.head(e));
    let along = mesh.positions[j as usize] - mesh.positions[i as usize];
    let seen = |v: u32| planes.flat(v, along).unit() * frame[v as usize];
    let turn = Complex::from_angle(f64::from(jumps.turn[e as usize]) * std::f64::consts::FRAC_PI_2);
    let mean = (seen(i) + turn * seen(j)).unit() * (along.norm() / h);
    [mean.re, mean.im]
}

/// One vertex of each run of lines along one axis.
fn anchors(mesh: &TriMesh, jumps: &Jumps, lines: &BTreeMap<u32, usize>) -> Vec<Anchor> {
    let mut sets = Sets::new(2 * mesh.positions.len());
    let mut on = vec![false; 2 * mesh.positions.len()];
    for (&e, &axis) in lines {
        let i = 2 * mesh.tail(e) + axis as u32;
        let j = 2 * mesh.head(e) + ((axis as u8 + jumps.turn[e as usize]) % 2) as u32;
        (on[i as usize], on[j as usize]) = (true, true);
        sets.join(i, j);
    }
    let roots = (0..on.len() as u32).filter(|&k| on[k as usize] && sets.root(k) == k);
    roots.map(|k| Anchor { vertex: k / 2, axis: k as usize % 2 }).collect()
}

/// One squared term: s u_b − u_a + Σ f x − d, with its weight.
struct Term<'a> {
    a: usize,
    b: Option<(usize, f64)>,
    f: &'a [(u32, f64)],
    d: f64,
    weight: f64,
}

/// E in the whole numbers alone: their form, if there are any, and the factor of A.
struct Reduced {
    factored: Factored,
    form: Option<Quadratic>,
    g: Vec<f64>,
}

struct System {
    diagonal: Vec<f64>,
    entries: Vec<(u32, u32, f64)>,
    /// Columns of B.
    columns: Vec<BTreeMap<u32, f64>>,
    c: Vec<f64>,
    b: Vec<f64>,
    g: Vec<f64>,
    is_anchored: bool,
}

impl System {
    fn new(
        mesh: &TriMesh,
        jumps: &Jumps,
        lines: &BTreeMap<u32, usize>,
        anchors: &[Anchor],
        wanted: impl Fn(u32) -> [f64; 2],
    ) -> Self {
        let (n, m) = (2 * mesh.positions.len(), 2 * jumps.pairs + anchors.len());
        let mut system = Self {
            diagonal: vec![DAMPING; n],
            entries: Vec::new(),
            columns: vec![BTreeMap::new(); m],
            c: vec![0.0; m * m],
            b: vec![0.0; n],
            g: vec![0.0; m],
            is_anchored: !anchors.is_empty(),
        };
        let mut f = Vec::new();
        for e in edges(mesh) {
            let d = wanted(e);
            let line = lines.get(&e);
            for axis in 0..2 {
                let (across, sign) = row(jumps.turn[e as usize], axis);
                f.clear();
                for (pair, m) in &jumps.shift[e as usize] {
                    let of = [m[2 * axis], m[2 * axis + 1]];
                    let of = (0..2).filter(|&k| of[k] != 0).map(|k| (2 * pair + k as u32, f64::from(of[k])));
                    f.extend(of);
                }
                let is_across = line == Some(&axis);
                system.add(Term {
                    a: 2 * mesh.tail(e) as usize + axis,
                    b: Some((2 * mesh.head(e) as usize + across, sign)),
                    f: &f,
                    d: if is_across { 0.0 } else { d[axis] },
                    weight: if is_across { LINE_WEIGHT } else { 1.0 },
                });
            }
        }
        for (k, anchor) in anchors.iter().enumerate() {
            let f = [((2 * jumps.pairs + k) as u32, 1.0)];
            let a = 2 * anchor.vertex as usize + anchor.axis;
            system.add(Term { a, b: None, f: &f, d: 0.0, weight: LINE_WEIGHT });
        }
        system
    }

    fn add(&mut self, term: Term<'_>) {
        let Term { a, b, f, d, weight } = term;
        let m = self.g.len();
        stop::pass(1 + f.len() * f.len());
        self.diagonal[a] += weight;
        self.b[a] -= weight * d;
        if let Some((b, sign)) = b {
            self.diagonal[b] += weight;
            self.entries.push((a as u32, b as u32, -sign * weight));
            self.b[b] += sign * weight * d;
        }
        for &(v, x) in f {
            *self.columns[v as usize].entry(a as u32).or_default() -= weight * x;
            if let Some((b, sign)) = b {
                *self.columns[v as usize].entry(b as u32).or_default() += sign * weight * x;
            }
            self.g[v as usize] += weight * x * d;
            f.iter().for_each(|&(w, y)| self.c[v as usize * m + w as usize] += weight * x * y);
        }
    }

    /// E in the whole numbers alone.
    fn reduced(&self, jumps: &Jumps) -> Option<Reduced> {
        let (n, m) = (self.b.len(), self.g.len());
        let pattern = Pattern::new(n, self.entries.iter().map(|&(a, b, _)| (a, b))).ok()?;
        let factored = pattern.factor(&self.diagonal, self.entries.iter().copied(), &vec![false; n]).ok()?;
        let mut free = self.b.clone();
        factored.solve(&mut free);
        let dot = |column: &BTreeMap<u32, f64>, x: &[f64]| column.iter().map(|(&k, b)| b * x[k as usize]).sum::<f64>();
        let g: Vec<f64> = (0..m).map(|v| self.g[v] - dot(&self.columns[v], &free)).collect();
        let mut s = self.c.clone();
        let mut first = 0;
        while first < m {
            let count = COLUMNS.min(m - first);
            let mut x = vec![0.0; n * count];
            for (k, column) in self.columns[first..first + count].iter().enumerate() {
                column.iter().for_each(|(&row, value)| x[k * n + row as usize] = *value);
            }
            factored.solve_columns(&mut x, count);
            for k in 0..count {
                stop::ask();
                for v in 0..m {
                    s[v * m + first + k] -= dot(&self.columns[v], &x[k * n..(k + 1) * n]);
                }
            }
            first += count;
        }
        let mut singular = jumps.singular.iter().filter_map(|(_, pair)| *pair);
        if let Some(pair) = singular.next().filter(|_| !self.is_anchored) {
            // All may be shifted alike: one point stays.
            let largest = (0..m).map(|k| s[k * m + k]).fold(0.0, f64::max);
            (0..2).map(|k| 2 * pair as usize + k).for_each(|k| s[k * m + k] += largest);
        }
        let form = if m == 0 { None } else { Some(Quadratic::new(s, &g)?) };
        Some(Reduced { factored, form, g })
    }

    /// u for given numbers, with d and b `scale` times as large.
    fn places(&self, factored: &Factored, x: &[f64], scale: f64) -> Vec<f64> {
        let mut u: Vec<f64> = self.b.iter().map(|b| b * scale).collect();
        for (column, x) in self.columns.iter().zip(x) {
            column.iter().for_each(|(&row, value)| u[row as usize] -= value * x);
        }
        factored.solve(&mut u);
        u
    }
}

/// The area of a map, in squares of its grid.
fn laid_area(mesh: &TriMesh, jumps: &Jumps, u: &[f64], x: &[f64]) -> f64 {
    let at = |v: u32| [u[2 * v as usize], u[2 * v as usize + 1]];
    let shift = |h: u32| {
        let of = |k: usize| {
            let terms = jumps.shift[h as usize].iter();
            terms
                .map(|(v, m)| (0..2).map(|l| f64::from(m[2 * k + l]) * x[2 * *v as usize + l]).sum::<f64>())
                .sum::<f64>()
        };
        [of(0), of(1)]
    };
    // The head of a halfedge, as its tail sees it.
    let way = |h: u32| {
        let (r, s, t) = (quarter_turn(jumps.turn[h as usize]).map(f64::from), at(mesh.head(h)), shift(h));
        let from = at(mesh.tail(h));
        [r[0] * s[0] + r[1] * s[1] + t[0] - from[0], r[2] * s[0] + r[3] * s[1] + t[1] - from[1]]
    };
    let triangles = 0..mesh.triangles.len() as u32;
    let twice = triangles.map(|t| {
        let (a, r) = (way(3 * t), quarter_turn(jumps.turn[3 * t as usize]).map(f64::from));
        let b = way(3 * t + 1);
        let b = [r[0] * b[0] + r[1] * b[1], r[2] * b[0] + r[3] * b[1]];
        a[0] * b[1] - a[1] * b[0]
    });
    twice.sum::<f64>() / 2.0
}

/// The entry of a row of the turn by some quarters: its column, and its sign.
fn row(turn: u8, axis: usize) -> (usize, f64) {
    match (turn % 4, axis) {
        (0, a) => (a, 1.0),
        (2, a) => (a, -1.0),
        (1, 0) | (3, 1) => (1 - axis, -1.0),
        _ => (1 - axis, 1.0),
    }
}
