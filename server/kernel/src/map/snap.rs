//! Snapping a finished map to what the input has of lines: corners of its boundary, and sharp edges.
//!
//! A registration of pictures knows no edges: where the example has one and the input has one beside it, the map ends a
//! fraction of a face away. Here vertices of the example that lie on a line get a place on the input's line
//! ([`corners`], [`creases`]); the faces around follow ([`spread`]), and what would turn a face over is left out again.
//! *Ours, not the paper's.*

pub mod corners;
pub mod creases;
pub mod lines;
pub mod spread;

use std::collections::BTreeMap;

use super::CrossMap;
use super::untangle::inward;
use crate::encode::index::Location;
use crate::mesh::poly::Crease;
use crate::mesh::tri::TriMesh;
use crate::topology::Patch;
use crate::unfold::Chart;
use lines::SharpLines;

/// What is snapped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Snap {
    /// Nothing.
    #[default]
    Off,
    /// Corners of the boundary to corners of the input's.
    Corners,
    /// Sharp edges to sharp edges.
    Creases,
    /// Both.
    All,
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SnapCounts {
    /// Corners of the boundary that lie on corners of the input's now.
    pub corners: usize,
    /// Vertices on sharp edges that lie on sharp edges of the input's now.
    pub creased: usize,
    /// Vertices that were to be moved, and stay because a face would turn over.
    pub refused: usize,
}

/// The creases that a file gives, as vertices of a patch. `vertex_of` leads from the file's vertices to those of the
/// patch's parent.
pub fn creases_on(creases: &[Crease], vertex_of: &[u32], patch: &Patch) -> Vec<[u32; 2]> {
    if creases.is_empty() {
        return Vec::new();
    }
    let on_patch: BTreeMap<u32, u32> = (0..).zip(&patch.vertex_of).map(|(v, parent)| (*parent, v)).collect();
    let vertex = |v: u32| on_patch.get(vertex_of.get(v as usize)?).copied();
    let sharp = creases.iter().filter(|c| c.sharpness > 0.0);
    sharp.filter_map(|c| Some([vertex(c.vertices[0])?, vertex(c.vertices[1])?])).collect()
}

/// Where vertices of the example are to go.
pub type Targets = BTreeMap<u32, Location>;

/// Times at most that targets near faces that turn over are given up, and the rest tried again.
const TRIALS_MAX: usize = 12;

/// Snaps a map of `mesh` (the example's patch) onto the mesh of `input`. `given` are the example's creases by its file, as
/// vertices of `mesh`; `mirror` is −1 for mirrored maps. Every vertex stays on the surface, boundary on boundary, and no
/// face looks inward that didn't.
pub fn snap(
    mesh: &TriMesh,
    given: &[[u32; 2]],
    cross: &mut CrossMap,
    input: &Chart,
    mirror: f64,
    what: Snap,
) -> SnapCounts {
    let mut snapped = SnapCounts::default();
    if matches!(what, Snap::Corners | Snap::All) {
        let matched = corners::targets(mesh, cross, input);
        let (done, refused) = moved(mesh, cross, input, mirror, matched.targets, |_| ());
        snapped.corners = matched.corners.iter().filter(|v| done.contains_key(v)).count();
        snapped.refused += refused;
    }
    if matches!(what, Snap::Creases | Snap::All) {
        let own = SharpLines::of(mesh, given);
        let targets = creases::targets(mesh, &own, cross, input);
        let (done, refused) = moved(mesh, cross, input, mirror, targets, |left| creases::in_rows(&own, left));
        snapped.creased = done.len();
        snapped.refused += refused;
    }
    snapped
}

/// Moves vertices to their targets, and what is around along with them. Targets near faces that would turn over are
/// given up, and so are those that `prune` leaves out then. Returns those that were reached, and how many were given up.
fn moved(
    mesh: &TriMesh,
    cross: &mut CrossMap,
    input: &Chart,
    mirror: f64,
    mut targets: Targets,
    prune: impl Fn(&mut Targets),
) -> (Targets, usize) {
    let wanted = targets.len();
    if wanted == 0 {
        return (targets, 0);
    }
    let before = inward(mesh, cross, input, mirror);
    for rings in 1..=TRIALS_MAX {
        let trial = spread::spread(mesh, cross, input, &targets);
        let after = inward(mesh, &trial, input, mirror);
        let mut turned: Vec<u32> = after.into_iter().filter(|f| before.binary_search(f).is_err()).collect();
        turned.extend(spread::collapsed(mesh, cross, &trial));
        turned.sort_unstable();
        if turned.is_empty() {
            *cross = trial;
            return (targets.clone(), wanted - targets.len());
        }
        let near = spread::near(mesh, &turned, rings);
        targets.retain(|&v, _| !near[v as usize]);
        prune(&mut targets);
        if targets.is_empty() {
            break;
        }
    }
    (Targets::new(), wanted)
}

#[cfg(test)]
mod tests;
