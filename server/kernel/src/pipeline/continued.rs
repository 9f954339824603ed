//! Maps continued by rows of quads to where the input ends.

use super::error::{PipelineError, Stop};
use super::mapped::{Fitted, MapBeforeEdit, Mapped};
use super::registered::{self, Registered};
use super::side::Side;
use super::{BARE, sound};
use crate::fit::{beyond, within};
use crate::map::assemble::select;
use crate::mesh::tri::halves_of;
use crate::mesh::{PolyMesh, TriMesh};
use crate::segment::{segment_above, segment_beyond};
use crate::topology::{Components, Patch, Topology, primitive};
use std::sync::Arc;

/// The pieces of an input that lie beyond the example, the largest first: that one alone, unless the example `is_open` where limbs are
/// left out.
pub(crate) fn rest_of(input: &TriMesh, field: &[f64], is_open: bool) -> Vec<Patch> {
    let cut = if is_open { segment_beyond(input, field) } else { segment_above(input, field) };
    cut.map(|cut| cut.parts.into_iter().skip(1).collect()).unwrap_or_default()
}

/// The map after an edit, continued to where the input ends if it was before.
pub(crate) fn edited(
    from: &Registered,
    before: &MapBeforeEdit,
    example: &Side,
    query: &Side,
    stop: Stop,
) -> Result<Mapped, PipelineError> {
    let mapped = registered::map(from, example, query, stop)?.after(before);
    let (Some(of_whole), Some(_)) = (from.of_whole.get(), before.reach.own) else { return Ok(mapped) };
    let (of, on) = (&*example.model, &*query.model);
    let (one, two) = (&of.patch(example.segment)?.mesh, &on.patch(query.segment)?.mesh);
    let field = within(one, of_whole.positions(), two);
    let mut fitted = Fitted { mapped, example: example.clone(), query: query.clone() };
    extend(&mut fitted, &field.map(|field| rest_of(two, &field, before.reach.is_open)).unwrap_or_default());
    Ok(fitted.mapped)
}

/// A map without the rows that continue it; `None` where it has none.
pub(crate) fn own(mapped: &Mapped) -> Option<Mapped> {
    let mesh = own_faces(&mapped.mesh, mapped.reach.own)?;
    let mut own = Mapped { part: Arc::clone(&mesh), mesh, ..mapped.clone() };
    (own.reach.own, own.reach.inspired) = (None, None);
    own.reasons.push(format!("{BARE}: rows of quads would leave it"));
    Some(own)
}

/// The faces of a map without the rows that continue it; `None` where it has none. `own`: how many come first.
pub(crate) fn own_faces(mesh: &PolyMesh, own: Option<(u64, u64)>) -> Option<Arc<PolyMesh>> {
    let (_, faces) = own?;
    let keep: Vec<bool> = (0..mesh.faces.len() as u64).map(|f| f < faces).collect();
    Some(Arc::new(select(mesh, &keep)))
}

/// Continues a map to where the input ends, over all pieces of the `rest`.
pub(crate) fn extend(fitted: &mut Fitted, rest: &[Patch]) {
    let input = fitted.query.model.patch(fitted.query.segment).ok().map(|patch| &patch.mesh);
    let mapped = &mut fitted.mapped;
    let own = &mapped.mesh;
    let over = |mesh: &PolyMesh, rest: &Patch| {
        let rest = primitive(&rest.mesh, Components::Largest).ok()?;
        let is_ring_or_cap = matches!(rest.topology, Topology::Annulus | Topology::Disc);
        beyond::continued(mesh, &rest, input.filter(|_| is_ring_or_cap)?)
    };
    let all = || rest.iter().try_fold(PolyMesh::clone(own), |grown, piece| over(&grown, piece));
    let Some(grown) = (!rest.is_empty()).then(all).flatten() else {
        mapped.reasons.push(format!("{BARE}: rows of quads can't go round its openings"));
        return;
    };
    if is_coarse(&grown, own.faces.len()) {
        mapped.reasons.push(format!("{BARE}: rows of quads would grow too large there"));
        return;
    }
    if is_bent(&grown, own.faces.len()) {
        mapped.reasons.push(format!("{BARE}: rows of quads would cut over its edges"));
        return;
    }
    let (all, part) = (area(&grown), area(own));
    mapped.reach.own = Some((own.positions.len() as u64, own.faces.len() as u64));
    mapped.reach.inspired = Some(part / all.max(f64::MIN_POSITIVE));
    mapped.mesh = Arc::new(grown);
    mapped.part = Arc::clone(&mapped.mesh);
}

/// Rows fan out over what is wider than the rim. Where most of what they cover is covered by faces so many times as large as the
/// example's own are on average, they no longer follow it.
const COARSE: f64 = 16.0;
/// A larger share of what rows cover is most of it to the eye.
const COARSE_SHARE: f64 = 0.2;

/// Whether the faces after the first `own` are too large for what they lie on.
fn is_coarse(grown: &PolyMesh, own: usize) -> bool {
    let areas: Vec<f64> = grown.faces.iter().map(|face| sound::area(grown, face)).collect();
    let (own, rows) = areas.split_at(own.min(areas.len()));
    let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
    let coarse: f64 = rows.iter().filter(|area| **area > COARSE * mean).sum();
    coarse > COARSE_SHARE * rows.iter().sum::<f64>()
}

/// Faces whose two halves turn from each other by more than this, as a cosine, cut over an edge of the input. Rows that run round a rim
/// do so where the edge does not: 6 % of what they cover on heads that were closed by a slanted plane, and at most .3 % on four scans that
/// look well (tests/records/other-makers-2026-11-29.md).
const BENT: f64 = 0.7;
const BENT_SHARE: f64 = 0.02;

/// Tells whether the faces after the first `own` cut over edges of the input.
fn is_bent(grown: &PolyMesh, own: usize) -> bool {
    let (mut all, mut bent) = (0.0, 0.0);
    for face in grown.faces.iter().skip(own) {
        let &[a, b, c, d] = face else { continue };
        let halves = halves_of([a, b, c, d].map(|v| grown.positions[v as usize]));
        let area = sound::area(grown, face);
        all += area;
        if halves[0].dot(&halves[1]) < BENT * halves[0].norm() * halves[1].norm() {
            bent += area;
        }
    }
    bent > BENT_SHARE * all
}

fn area(mesh: &PolyMesh) -> f64 {
    mesh.faces.iter().map(|face| sound::area(mesh, face)).sum()
}
