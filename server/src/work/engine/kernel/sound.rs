//! The last look at what is delivered: whether its mesh can be used at all, whatever was thought of it before.

use super::super::{Appraisal, EngineError, Mapped, Model, Side, Stitched};
use super::fresh;
use super::model::ModelInner;
use quadmuse_kernel::compose::apart::owned;
use quadmuse_kernel::measure::sound::Grounds;
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{NONE, PolyMesh, TriMesh, Vec3};
use quadmuse_proto::Verdict;

/// Calls a map broken whose mesh is, and says why before all else.
pub(super) fn check(mapped: &mut Mapped, query: &Side) -> Result<(), EngineError> {
    let inner: &ModelInner = query.model.inner.open()?;
    let flaws = if inner.laid.is_some() {
        // A part of what was laid whole ends beside its segment.
        Grounds::new(owned(inner.ground().input()).into_owned()).flaws(&mapped.mesh).reasons(1.0)
    } else {
        let surface: &TriMesh = &fresh(&query.encoded.encoding)?.chart.mesh;
        Grounds::new(surface.clone()).flaws(&mapped.mesh).reasons(1.0 - mapped.reach.covers.input)
    };
    if !flaws.is_empty() {
        mapped.verdict = Verdict::Broken;
        mapped.reasons.splice(0..0, flaws);
    }
    Ok(())
}

/// Measures a composition.
pub(super) fn appraise(query: &Model, made: &Stitched) -> Result<Appraisal, EngineError> {
    let inner: &ModelInner = query.inner.open()?;
    let ground = inner.ground();
    let surface = owned(ground.input());
    let flaws = Grounds::new(surface.into_owned()).flaws(&made.mesh);
    let tree = Bvh::new(ground.input().surface);
    // The segment on which a face stands: that at its middle.
    let segment_of = |face: &[u32]| {
        let near = tree.closest(middle(&made.mesh, face)).triangle;
        let owner = ground.input().owner.get(near as usize).copied().unwrap_or(NONE);
        (owner != NONE).then_some(owner)
    };
    let mut examples = vec![0.0; made.is_example.len()];
    let mut all = 0.0;
    for face in made.mesh.faces.iter() {
        let area = area(&made.mesh, face);
        all += area;
        let segment = segment_of(face).map(|segment| segment as usize);
        if let Some(segment) = segment.filter(|&segment| made.is_example.get(segment) == Some(&true)) {
            examples[segment] += area;
        }
    }
    examples.iter_mut().for_each(|share| *share /= f64::max(all, f64::MIN_POSITIVE));
    let mut flawed: Vec<u32> =
        flaws.faces.iter().filter_map(|&f| segment_of(made.mesh.faces.face(f as usize))).collect();
    flawed.sort_unstable();
    flawed.dedup();
    Ok(Appraisal { examples, covered: 1.0 - flaws.bare, flaws: flaws.reasons(0.0), flawed })
}

fn middle(mesh: &PolyMesh, face: &[u32]) -> Vec3 {
    face.iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / face.len().max(1) as f64
}

fn area(mesh: &PolyMesh, face: &[u32]) -> f64 {
    let at = |k: usize| mesh.positions[face[k] as usize];
    let fan = |k: usize| (at(k) - at(0)).cross(&(at(k + 1) - at(0)));
    0.5 * (1..face.len().saturating_sub(1)).map(fan).sum::<Vec3>().norm()
}
