//! Maps that grow along protrusions of the scan that their examples lack.

use super::mapped::{Mapped, Verdict};
use super::side::Side;
use super::sound;
use crate::fit::extrude::{self, Extrusion, extruded};
use crate::measure::sound::MISSED_LIMBS;
use crate::numerics::stage::Stage;
use std::sync::Arc;

/// How the reason ends that faces were extruded.
const EXTRUDED: &str = "the example has no horn, tail or the like there";

/// Extrudes faces of a map along what it misses of the scan, where it is of some use but for that, unless the mesh breaks. Gives the share
/// of the scan's area that is missed all the same.
pub(crate) fn extrude(mapped: &mut Mapped, query: &Side) -> f64 {
    // After an edit it is told anew.
    let of_stitched = mapped.stitched.iter_mut().map(|stitched| &mut stitched.reasons);
    of_stitched.chain([&mut mapped.reasons]).for_each(|reasons| reasons.retain(|why| !why.ends_with(EXTRUDED)));
    let surface = &query.encoded.query.chart.mesh;
    // A map that is broken by what it misses alone is not broken once it reaches that.
    let reaching = mapped.stitched.clone().filter(|_| mapped.verdict == Verdict::Broken);
    let verdict = reaching.as_ref().map_or(mapped.verdict, |reaching| reaching.verdict);
    if !is_wanted(verdict, query) {
        return 0.0;
    }
    let Extrusion { mesh, missed } = extruded(&mapped.mesh, surface);
    let Some((mesh, count)) = mesh else { return missed };
    let mesh = Arc::new(mesh);
    let mut grown = Mapped { part: Arc::clone(&mesh), mesh: Arc::clone(&mesh), ..mapped.clone() };
    let area = |faces: usize| mesh.faces.iter().take(faces).map(|face| sound::area(&mesh, face)).sum::<f64>();
    let own = mapped.reach.own.map_or(mapped.mesh.faces.len(), |own| own.1 as usize);
    grown.reach.inspired = Some(area(own) / area(mesh.faces.len()).max(f64::MIN_POSITIVE));
    grown.reach.unextruded = Some(Arc::clone(&mapped.mesh));
    if let Some(reaching) = reaching {
        (grown.verdict, grown.reasons) = (reaching.verdict, reaching.reasons);
    }
    grown.reasons.retain(|why| !why.starts_with(MISSED_LIMBS));
    grown.stitched = None;
    sound::check(&mut grown, query);
    if grown.verdict >= Verdict::Poor {
        return extrude::missed(&mapped.mesh, surface);
    }
    let parts = if count == 1 { "a part" } else { "parts" };
    let why = format!("faces were extruded along {parts} of the scan: {EXTRUDED}");
    grown.stitched.iter_mut().for_each(|stitched| stitched.reasons.insert(0, why.clone()));
    grown.reasons.insert(0, why);
    *mapped = grown;
    missed
}

/// The share of the scan's area that horns and the like have which a map misses, 0–1.
pub(crate) fn missed(mapped: &Mapped, query: &Side) -> f64 {
    if !is_wanted(mapped.verdict, query) {
        return 0.0;
    }
    extrude::missed(&mapped.mesh, &query.encoded.query.chart.mesh)
}

/// Tells whether what a map misses is looked for. On a part stitching moves vertices there.
fn is_wanted(verdict: Verdict, query: &Side) -> bool {
    verdict < Verdict::Poor && query.model.is_most(query.segment) && Stage::Extrude.is_on()
}
