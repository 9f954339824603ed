//! Pole refinement: moving the input's pole until the registered energy is least.
//!
//! The pole found on each surface alone is good to some per cent of its size; how well two encodings register tells
//! it better. Pattern search: six directions on the surface at 12, 6, then 3 % of √area.
//! *Source:* METHOD §2 ("pole refinement"); *ours, not the paper's.*

use super::{Level, Registration, Solver, coarse_flip, query_images};
use crate::encode::{Encoding, encode_to};
use crate::mesh::tri::TriMesh;
use crate::unfold::path::distances;
use crate::unfold::{UnfoldError, Unfolder};

/// Radii of the search, in √area. *Source:* METHOD §2.
const RADII: [f64; 3] = [0.12, 0.06, 0.03];
/// Directions tried at each radius.
const DIRECTIONS: usize = 6;
/// Moves at one radius at most.
const MOVES_MAX: usize = 4;
/// Level at which poles are compared.
const SEARCH_SIDE: usize = 64;
/// A move must lower the energy by this share.
const GAIN_MIN: f64 = 0.005;

/// Poles of the input with the registration they give.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The poles.
    pub poles: Vec<u32>,
    /// The registration at the search's level, against the input's encoding with these poles.
    pub registration: Registration,
    /// E / variance there.
    pub cost: f64,
    /// Unfoldings made.
    pub unfoldings: usize,
}

/// Registers the example's flip of `flip` against the input with the given poles, to the search's level.
///
/// # Errors
/// [`UnfoldError`] where these poles cannot be unfolded.
pub fn evaluate(
    unfolder: &Unfolder,
    poles: &[u32],
    example: &Encoding,
    flip: super::Flip,
    solver: &dyn Solver,
    stop: &dyn Fn() -> bool,
) -> Result<Refined, UnfoldError> {
    let query = encode_to(&unfolder.chart(poles)?, SEARCH_SIDE);
    let images = query_images(&query, SEARCH_SIDE);
    let mut registration: Option<Registration> = None;
    for image in &images {
        let Some(level) = Level::new(example, image) else { continue };
        match &mut registration {
            None => registration = Some(coarse_flip(&level, flip, solver, stop)),
            Some(r) => r.advance(&level, solver, stop),
        }
    }
    let registration = registration.ok_or(UnfoldError::NoArea(0.0))?;
    let cost = registration.energy / registration.variance.max(1e-300);
    Ok(Refined { poles: poles.to_vec(), registration, cost, unfoldings: 1 })
}

/// Searches from `start` for poles of lower registered energy.
pub fn refine(
    mesh: &TriMesh,
    unfolder: &Unfolder,
    start: Refined,
    example: &Encoding,
    solver: &dyn Solver,
    stop: &dyn Fn() -> bool,
) -> Refined {
    let scale = mesh.total_area().sqrt();
    let flip = start.registration.flip;
    let mut best = start;
    for radius in RADII {
        for _ in 0..MOVES_MAX {
            let mut improved = false;
            for which in 0..best.poles.len() {
                let at = best.poles[which];
                for neighbour in around(mesh, at, radius * scale) {
                    if stop() {
                        return best;
                    }
                    let mut poles = best.poles.clone();
                    poles[which] = neighbour;
                    let Ok(trial) = evaluate(unfolder, &poles, example, flip, solver, stop) else { continue };
                    let unfoldings = best.unfoldings + 1;
                    if trial.cost < best.cost * (1.0 - GAIN_MIN) {
                        best = trial;
                        improved = true;
                    }
                    best.unfoldings = unfoldings;
                }
            }
            if !improved {
                break;
            }
        }
    }
    best
}

/// Interior vertices at about `radius` from `centre` along edges, one in each of six directions where there is one.
fn around(mesh: &TriMesh, centre: u32, radius: f64) -> Vec<u32> {
    let (distance, _) = distances(mesh, &[centre]);
    let on_boundary = mesh.boundary_vertices();
    let origin = mesh.positions[centre as usize];
    let near = |v: u32| (0.5..=1.5).contains(&(distance[v as usize] / radius)) && !on_boundary[v as usize];
    let candidates: Vec<u32> = (0..distance.len() as u32).filter(|&v| near(v)).collect();
    let Some(&first) = candidates.first() else { return Vec::new() };
    // A frame about the mean normal of the neighbourhood; only directions matter.
    let x = (mesh.positions[first as usize] - origin).normalize();
    let mut normal = crate::mesh::Vec3::zeros();
    for t in &mesh.triangles {
        if t.contains(&centre) {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            normal += (b - a).cross(&(c - a));
        }
    }
    let y = normal.cross(&x);
    let mut chosen: Vec<u32> = Vec::new();
    for k in 0..DIRECTIONS {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
        let misfit = |v: u32| {
            let d = mesh.positions[v as usize] - origin;
            let (dx, dy) = (d.dot(&x), d.dot(&y) / y.norm().max(1e-300));
            let length = dx.hypot(dy).max(1e-300);
            let angle = 1.0 - (dx * cos + dy * sin) / length;
            angle + (distance[v as usize] / radius - 1.0).abs()
        };
        let best = candidates.iter().copied().min_by(|&a, &b| misfit(a).total_cmp(&misfit(b)).then(a.cmp(&b)));
        if let Some(v) = best.filter(|v| !chosen.contains(v)) {
            chosen.push(v);
        }
    }
    chosen
}
