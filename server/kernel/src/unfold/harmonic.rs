//! v and its conjugate u.
//!
//! Δv = 0 with v = 0 on the boundary and v = 1 at the pole. For every pole P, v = G·e_P / G(P, P), G the inverse of
//! the Dirichlet Laplacian: one factorisation serves all poles. u is the harmonic conjugate, ∇u = R∇v / P with
//! P = ∫|∇v|², so its period is 1; it is found by least squares, minimising Σ_T A_T |∇u − R∇v/P|² with integer jumps
//! across one path instead of a geometric cut. On the boundary u is the flux of v ([`rim`]).
//! *Source:* paper §4.2 (Eqs. 1, 2). *Ours, not the paper's:* u as the conjugate needs neither Eq. 3 nor a cut
//! (METHOD §2).

use std::sync::{Arc, Mutex, PoisonError};

use super::laplacian::{Laplacian, opposite};
use super::path::{distances, jumps, trace};
use super::rim;
use crate::mesh::tri::TriMesh;
use crate::numerics::{Factored, SolveError, side_by_side};
use crate::topology::Topology;

/// A harmonic function with its Dirichlet energy.
#[derive(Clone, Debug)]
pub struct Harmonic {
    /// Value at each vertex, 0–1.
    pub v: Vec<f64>,
    /// P = ∫|∇v|².
    pub energy: f64,
}

/// Surfaces of more vertices hold one factor at a time, which takes some 600 bytes a vertex while it is made; a factor that
/// is wanted again is made anew. *Untuned.*
const VERTICES_OF_TWO_FACTORS: usize = 250_000;

/// Solves for harmonic functions on one surface: its Laplacian, and the factor of that under the boundary conditions.
#[derive(Debug)]
pub struct HarmonicSolver {
    /// The (refined) mesh.
    pub mesh: Arc<TriMesh>,
    /// What it is.
    pub topology: Topology,
    /// Its Laplacian.
    pub laplacian: Laplacian,
    /// Vertices on the boundary.
    pub on_boundary: Vec<bool>,
    /// True for each vertex that the Dirichlet Laplacian holds at 0.
    fixed: Vec<bool>,
    /// Its factor, where it is held.
    dirichlet: Mutex<Option<Arc<Factored>>>,
    /// The vertex that grounds a closed surface.
    ground: u32,
}

impl HarmonicSolver {
    /// Factors the surface's Dirichlet Laplacian (closed surfaces: grounded at one vertex), and beside it makes something
    /// else of the Laplacian; neither, and `None`, where the surface is too large for both at a time.
    ///
    /// # Errors
    /// [`SolveError`] when the system cannot be factored.
    pub fn beside<B: Send>(
        mesh: Arc<TriMesh>,
        topology: Topology,
        other: impl Fn(&Laplacian) -> B + Sync,
    ) -> Result<(Self, Option<B>), SolveError> {
        let laplacian = Laplacian::new(&mesh)?;
        let on_boundary = mesh.boundary_vertices();
        let mut fixed = on_boundary.clone();
        let ground = 0;
        if topology == Topology::Sphere || topology == Topology::Torus {
            fixed[ground as usize] = true;
        }
        let (dirichlet, other) = if mesh.positions.len() > VERTICES_OF_TWO_FACTORS {
            (None, None)
        } else {
            let factored = || laplacian.factor(&fixed, 0.0, |_| false);
            let (dirichlet, other) = side_by_side(factored, || other(&laplacian));
            (Some(Arc::new(dirichlet?)), Some(other))
        };
        Ok((Self { mesh, topology, laplacian, on_boundary, fixed, dirichlet: Mutex::new(dirichlet), ground }, other))
    }

    /// The factor of the Dirichlet Laplacian.
    fn dirichlet(&self) -> Result<Arc<Factored>, SolveError> {
        let mut held = self.dirichlet.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(factor) = &*held {
            return Ok(Arc::clone(factor));
        }
        let factor = Arc::new(self.laplacian.factor(&self.fixed, 0.0, |_| false)?);
        Ok(Arc::clone(held.insert(factor)))
    }

    /// Makes room for another factor: lets go of its own, where the surface is too large for both.
    pub(super) fn make_room(&self) {
        if self.mesh.positions.len() > VERTICES_OF_TWO_FACTORS {
            self.let_go();
        }
    }

    fn let_go(&self) {
        *self.dirichlet.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Column of the Green's function at `p`: L g = e_p, g = 0 on what is fixed.
    fn green(&self, p: u32) -> Result<Vec<f64>, SolveError> {
        let mut g = vec![0.0; self.mesh.positions.len()];
        if !self.on_boundary[p as usize] && (self.topology == Topology::Disc || p != self.ground) {
            g[p as usize] = 1.0;
        }
        self.dirichlet()?.solve(&mut g);
        Ok(g)
    }

    /// Solves L x = `right` with x = 0 on the boundary (or at the ground).
    ///
    /// # Errors
    /// [`SolveError`] when the system cannot be factored.
    pub fn poisson(&self, mut right: Vec<f64>) -> Result<Vec<f64>, SolveError> {
        let closed = matches!(self.topology, Topology::Sphere | Topology::Torus);
        for (x, on) in right.iter_mut().zip(&self.on_boundary) {
            if *on {
                *x = 0.0;
            }
        }
        if closed {
            right[self.ground as usize] = 0.0;
        }
        self.dirichlet()?.solve(&mut right);
        Ok(right)
    }

    /// v for the given poles: disc `[pole]`, sphere `[v = 0, v = 1]`, annulus none.
    ///
    /// # Errors
    /// [`SolveError`] when the system cannot be factored.
    pub fn v(&self, poles: &[u32]) -> Result<Harmonic, SolveError> {
        let mut v = match (self.topology, poles) {
            (Topology::Disc, &[pole, ..]) => {
                let g = self.green(pole)?;
                let top = g[pole as usize];
                g.into_iter().map(|x| x / top).collect()
            }
            (Topology::Sphere, &[south, north, ..]) => {
                // L g = e_north − e_south, whatever the ground: the two columns differ by a constant only.
                let (g1, g0) = (self.green(north)?, self.green(south)?);
                let g: Vec<f64> = g1.iter().zip(&g0).map(|(a, b)| a - b).collect();
                let (low, high) = (g[south as usize], g[north as usize]);
                g.into_iter().map(|x| (x - low) / (high - low)).collect()
            }
            _ => self.annulus_v()?,
        };
        let energy = self.laplacian.energy(&v);
        v.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
        Ok(Harmonic { v, energy })
    }

    /// v of an annulus: 0 on its first loop, 1 on its second.
    fn annulus_v(&self) -> Result<Vec<f64>, SolveError> {
        let mut given = vec![0.0; self.mesh.positions.len()];
        if let Some(second) = self.mesh.boundary_loops().get(1) {
            second.iter().for_each(|&h| given[self.mesh.tail(h) as usize] = 1.0);
        }
        let right: Vec<f64> = self.laplacian.apply(&given).into_iter().map(|y| -y).collect();
        let inside = self.poisson(right)?;
        Ok(given.iter().zip(&inside).map(|(g, x)| g + x).collect())
    }

    /// The path across which u jumps by its period: pole → boundary, pole → pole, or loop → loop.
    pub fn cut_path(&self, poles: &[u32]) -> Vec<u32> {
        match (self.topology, poles) {
            (Topology::Sphere, &[south, north, ..]) => {
                let (_, by) = distances(&self.mesh, &[north]);
                trace(&self.mesh, &by, south)
            }
            (Topology::Disc, &[pole, ..]) => {
                let (distance, by) = distances(&self.mesh, &[pole]);
                let boundary = (0..distance.len() as u32).filter(|&v| self.on_boundary[v as usize]);
                let nearest = boundary.min_by(|&a, &b| distance[a as usize].total_cmp(&distance[b as usize]));
                nearest.map_or_else(Vec::new, |target| trace(&self.mesh, &by, target))
            }
            _ => {
                let loops = self.mesh.boundary_loops();
                let vertices =
                    |k: usize| -> Vec<u32> { loops.get(k).into_iter().flatten().map(|&h| self.mesh.tail(h)).collect() };
                // From the loop at v = 1 to the one at v = 0, as from a pole to the boundary.
                let (distance, by) = distances(&self.mesh, &vertices(1));
                let nearest =
                    vertices(0).into_iter().min_by(|&a, &b| distance[a as usize].total_cmp(&distance[b as usize]));
                nearest.map_or_else(Vec::new, |target| trace(&self.mesh, &by, target))
            }
        }
    }

    /// u, the harmonic conjugate of `v`, at each vertex (0 at the poles, where it has none), with the jumps of the
    /// mesh's halfedges: along halfedge a → b, u grows by u_b − u_a − s.
    ///
    /// # Errors
    /// [`SolveError::NotPositiveDefinite`] when what is left without the poles' faces falls apart.
    pub fn conjugate(&self, harmonic: &Harmonic, poles: &[u32]) -> Result<(Vec<f64>, Vec<i32>), SolveError> {
        let path = self.cut_path(poles);
        let s = jumps(&self.mesh, &path, poles);
        let mut carried = s.clone();
        self.laplacian.triangulation.carry(&self.mesh, &mut carried, poles);
        let u = self.fit_conjugate(harmonic, poles, &carried, path.last().copied())?;
        Ok((u, s))
    }

    fn fit_conjugate(
        &self,
        harmonic: &Harmonic,
        poles: &[u32],
        carried: &[i32],
        ground: Option<u32>,
    ) -> Result<Vec<f64>, SolveError> {
        let t = &self.laplacian.triangulation;
        let tails = &t.tails;
        let is_pole_face = |f: usize| (0..3).any(|k| poles.contains(&tails[3 * f + k]));
        let n = self.mesh.positions.len();
        let weights = self.laplacian.weights_without(is_pole_face);
        let mut held = vec![true; n];
        for (h, &w) in weights.iter().enumerate() {
            if w != 0.0 && tails[h] != t.head(h as u32) {
                held[tails[h] as usize] = false;
                held[t.head(h as u32) as usize] = false;
            }
        }
        let rim = rim::flux(&self.laplacian, &harmonic.v, carried).unwrap_or_default();
        let mut given = vec![0.0; n];
        let mut orphans: Vec<u32> = (0..n as u32).filter(|&v| held[v as usize] && !poles.contains(&v)).collect();
        if rim.is_empty() {
            let ground = ground.filter(|&g| !held[g as usize]).or_else(|| (0..n as u32).find(|&v| !held[v as usize]));
            // The faces of a pole in a ribbon span it: what they part is held at a vertex each.
            self.one_of_each(&weights, &held, ground).into_iter().for_each(|v| held[v as usize] = true);
        } else {
            orphans.retain(|&v| !self.on_boundary[v as usize]);
            let first = rim.iter().find(|(v, _)| Some(*v) == ground).map_or(0.0, |(_, u)| *u);
            for &(v, u) in &rim {
                (held[v as usize], given[v as usize]) = (true, u - first);
            }
        }
        let mut right = vec![0.0; n];
        for h in 0..tails.len() as u32 {
            let (a, b) = (tails[h as usize] as usize, t.head(h) as usize);
            let flow = weights[h as usize] * (f64::from(carried[h as usize]) + given[a] - given[b]);
            right[a] -= flow;
            right[b] += flow;
        }
        // ∫ ∇φ_c · R∇v over a face is half the difference of v along the edge opposite to c; inside it telescopes
        // to nothing, at the poles' links it carries what v is not constant there.
        for h in (0..tails.len() as u32).filter(|&h| !is_pole_face(h as usize / 3)) {
            let c = opposite(t, h) as usize;
            let dv = harmonic.v[t.head(h) as usize] - harmonic.v[tails[h as usize] as usize];
            right[c] -= 0.5 * dv / harmonic.energy;
        }
        (0..n).filter(|&v| held[v]).for_each(|v| right[v] = 0.0);
        drop(weights);
        self.make_room();
        self.laplacian.factor(&held, 0.0, is_pole_face)?.solve(&mut right);
        right.iter_mut().zip(&given).for_each(|(u, given)| *u += given);
        if self.topology == Topology::Annulus && !rim.is_empty() {
            self.settle_loops(harmonic, carried, &mut right);
        }
        self.adopt(&orphans, poles, carried, &mut right);
        Ok(right)
    }

    /// A vertex of each set of free vertices that is connected by weights, `ground` for its own.
    fn one_of_each(&self, weights: &[f64], held: &[bool], ground: Option<u32>) -> Vec<u32> {
        let t = &self.laplacian.triangulation;
        let mut leader: Vec<u32> = (0..held.len() as u32).collect();
        let find = |leader: &mut [u32], mut v: u32| {
            while leader[v as usize] != v {
                leader[v as usize] = leader[leader[v as usize] as usize];
                v = leader[v as usize];
            }
            v
        };
        for h in (0..weights.len()).filter(|&h| weights[h] != 0.0) {
            let (a, b) = (find(&mut leader, t.tails[h]), find(&mut leader, t.head(h as u32)));
            leader[a.max(b) as usize] = a.min(b);
        }
        let mut found: Vec<u32> = ground.into_iter().collect();
        let mut is_grounded = vec![false; held.len()];
        found.iter().for_each(|&v| is_grounded[find(&mut leader, v) as usize] = true);
        for v in (0..held.len() as u32).filter(|&v| !held[v as usize]) {
            if !std::mem::replace(&mut is_grounded[find(&mut leader, v) as usize], true) {
                found.push(v);
            }
        }
        found
    }

    /// Turns an annulus's second loop against its first until ∫∇u · ∇v = 0: u + tv is as harmonic as u.
    fn settle_loops(&self, harmonic: &Harmonic, carried: &[i32], u: &mut [f64]) {
        let t = &self.laplacian.triangulation;
        let product = |(h, w): (usize, &f64)| {
            let (a, b) = (t.tails[h] as usize, t.head(h as u32) as usize);
            w * (u[b] - u[a] - f64::from(carried[h])) * (harmonic.v[b] - harmonic.v[a])
        };
        let turn = -self.laplacian.half_weights.iter().enumerate().map(product).sum::<f64>() / harmonic.energy;
        u.iter_mut().zip(&harmonic.v).for_each(|(u, v)| *u += turn * v);
    }

    /// Vertices whose faces all touch a pole take the mean of their neighbours' u.
    fn adopt(&self, orphans: &[u32], poles: &[u32], carried: &[i32], u: &mut [f64]) {
        let t = &self.laplacian.triangulation;
        for &v in orphans {
            let (mut sum, mut count) = (0.0, 0.0);
            for h in 0..t.tails.len() as u32 {
                let (a, b) = (t.tails[h as usize], t.head(h));
                let s = f64::from(carried[h as usize]);
                if a == v && !poles.contains(&b) && !orphans.contains(&b) {
                    (sum, count) = (sum + u[b as usize] - s, count + 1.0);
                } else if b == v && !poles.contains(&a) && !orphans.contains(&a) {
                    (sum, count) = (sum + u[a as usize] + s, count + 1.0);
                }
            }
            u[v as usize] = if count > 0.0 { sum / count } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_factor_that_was_let_go_is_made_anew_and_solves_the_same() {
        let mesh = Arc::new(grid(14, 11, false, false));
        let (solver, beside) = HarmonicSolver::beside(mesh, Topology::Disc, |_| ()).expect("solvable");
        assert_eq!(beside, Some(()), "a small surface holds both");
        let before = solver.v(&[80]).expect("solvable");
        solver.make_room();
        assert!(solver.dirichlet.lock().expect("not poisoned").is_some());
        solver.let_go();
        assert!(solver.dirichlet.lock().expect("not poisoned").is_none());
        let after = solver.v(&[80]).expect("solvable");
        assert_eq!((before.v, before.energy), (after.v, after.energy));
    }
}
