//! The surface polish of a first map, its snapping to the input's lines, and what edits keep of it.
//!
//! Polishing costs more than an edit may. So the first map is polished, and an edited one, which is a closed form,
//! takes over by how much each vertex was moved then; near the caller's own constraints nothing is moved, so that they
//! hold exactly.

use super::constraint::{Constraint, ConstraintOrigin};
use crate::map::CrossMap;
use crate::map::reembed::{self, InputChart};
use crate::map::snap::{Snap, snap};
use crate::map::walk::walk;
use crate::mesh::{TriMesh, Vec3};
use crate::unfold::Chart;
use std::sync::OnceLock;

/// Within this distance of a caller's constraint (in √area) the polish fades out.
const FADE: f64 = 0.15;

/// Tells where the polish took each vertex of the first map.
#[derive(Debug)]
pub(crate) struct PolishShift {
    before: Vec<Vec3>,
    after: CrossMap,
}

/// The example's side of what settles.
pub(crate) struct Laying<'a> {
    /// Its patch's mesh.
    pub(crate) mesh: &'a TriMesh,
    /// The creases that its file gives, as vertices of the mesh.
    pub(crate) creases: Vec<[u32; 2]>,
    /// What is snapped.
    pub(crate) snap: Snap,
}

/// Lets `cross`, the map of a surface onto the charts of `grounds`, come to rest, or moves it as the first map was moved.
/// `mirror` is −1 for mirrored maps.
pub(crate) fn settle(
    kept: &OnceLock<PolishShift>,
    laying: &Laying,
    cross: &mut CrossMap,
    grounds: &[InputChart],
    mirror: f64,
    constraints: &[Constraint],
) {
    let callers: Vec<Vec3> = constraints
        .iter()
        .filter(|c| c.origin == ConstraintOrigin::User)
        .map(|c| Vec3::from(c.on_input.point))
        .collect();
    if callers.is_empty() && kept.get().is_none() {
        let before = cross.positions.clone();
        reembed::settle(laying.mesh, cross, grounds, mirror);
        if let Some(ground) = grounds.first() {
            snap(laying.mesh, &laying.creases, cross, ground.chart, mirror, laying.snap);
        }
        let _ = kept.set(PolishShift { before, after: cross.clone() });
        return;
    }
    let settled = kept.get().filter(|s| s.before.len() == cross.positions.len());
    if let (Some(settled), Some(ground)) = (settled, grounds.first()) {
        follow(settled, cross, ground.chart, &callers);
    }
}

fn follow(settled: &PolishShift, cross: &mut CrossMap, input: &Chart, callers: &[Vec3]) {
    let scale = input.mesh.total_area().sqrt();
    for v in 0..cross.positions.len() {
        let (at, there) = (cross.positions[v], settled.after.positions[v]);
        let nearest = callers.iter().map(|c| (c - at).norm()).fold(f64::INFINITY, f64::min);
        let share = (nearest / (FADE * scale)).min(1.0);
        let share = share * share * (3.0 - 2.0 * share);
        if share >= 1.0 && at == settled.before[v] {
            (cross.locations[v], cross.positions[v]) = (settled.after.locations[v], there);
            continue;
        }
        let moved = there - settled.before[v];
        if moved != Vec3::zeros() {
            cross.locations[v] = walk(&input.mesh, cross.locations[v], moved * share);
            cross.positions[v] = cross.locations[v].point(input);
        }
    }
}
