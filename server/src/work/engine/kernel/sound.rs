//! The last look at what is delivered: whether its mesh can be used at all, whatever was thought of it before.

use super::super::{Allowed, Appraisal, EngineError, Mapped, Model, Side, Stitched};
use super::fresh;
use super::model::ModelInner;
use quadmuse_kernel::compose::apart::owned;
use quadmuse_kernel::measure::sound::ReferenceSurface;
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{NONE, PolyMesh, TriMesh, Vec3};
use quadmuse_kernel::topology::holes::filled;
use quadmuse_proto::Verdict;

/// Calls a map broken whose mesh is, and says why before all else.
pub(super) fn check(mapped: &mut Mapped, query: &Side) -> Result<(), EngineError> {
    let inner: &ModelInner = query.model.inner.open()?;
    let flaws = if inner.laid.is_some() {
        // A part of what was laid whole ends beside its segment.
        ReferenceSurface::new(owned(inner.ground().input()).into_owned()).flaws(&mapped.mesh, &[]).reasons(1.0, 0.0)
    } else {
        let surface: &TriMesh = &fresh(&query.encoded.encoding)?.chart.mesh;
        ReferenceSurface::new(surface.clone())
            .flaws(&mapped.mesh, &mapped.reach.bridging)
            .reasons(1.0 - mapped.reach.covers.input, mapped.reach.spanned)
    };
    if !flaws.is_empty() {
        mapped.verdict = Verdict::Broken;
        mapped.reasons.splice(0..0, flaws);
    }
    Ok(())
}

/// Measures a composition; see [`Engine::appraise`](super::super::Engine::appraise).
pub(super) fn appraise(query: &Model, made: &Stitched, allowed: Allowed) -> Result<Appraisal, EngineError> {
    let inner: &ModelInner = query.inner.open()?;
    let ground = inner.ground();
    let surface = owned(ground.input());
    let with_gaps = inner.segmented.parts.iter().filter(|part| !part.holes.is_empty());
    let filled = with_gaps.map(|part| filled(&part.mesh, &part.holes));
    let flaws = ReferenceSurface::new(surface.into_owned()).with_gaps(filled).flaws(&made.mesh, &made.bridging);
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
    Ok(Appraisal { examples, covered: 1.0 - flaws.bare, flaws: flaws.reasons(allowed.bare, allowed.spanned), flawed })
}

fn middle(mesh: &PolyMesh, face: &[u32]) -> Vec3 {
    face.iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / face.len().max(1) as f64
}

/// The area of a face.
pub(super) fn area(mesh: &PolyMesh, face: &[u32]) -> f64 {
    let at = |k: usize| mesh.positions[face[k] as usize];
    let fan = |k: usize| (at(k) - at(0)).cross(&(at(k + 1) - at(0)));
    0.5 * (1..face.len().saturating_sub(1)).map(fan).sum::<Vec3>().norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pool::Stop;
    use crate::work::engine::{Cut, Engine, kernel::KernelEngine};
    use std::fmt::Write;
    use std::sync::Arc;

    /// n × n quads on a dome, as OBJ.
    fn dome(n: usize) -> String {
        let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        let mut text = String::new();
        for (x, y) in (0..=n).flat_map(|j| (0..=n).map(move |i| (at(i), at(j)))) {
            let _ = writeln!(text, "v {x} {y} {}", 0.8 * (1.0 - x * x) * (1.0 - y * y));
        }
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
            let v = |i: usize, j: usize| j * (n + 1) + i + 1;
            let _ = writeln!(text, "f {} {} {} {}", v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1));
        }
        text
    }

    fn read(text: &str) -> Model {
        let read = KernelEngine::default().read(text.as_bytes(), None, &Cut::default(), &Stop::new(None));
        read.expect("a disc")
    }

    fn stitched(mesh: PolyMesh, is_example: bool) -> Stitched {
        Stitched {
            mesh: Arc::new(mesh),
            is_example: vec![is_example],
            is_poor_kept: false,
            bridging: Vec::new(),
            extraordinary_vertices: 0,
            extraordinary_before: 0,
            notes: Vec::new(),
        }
    }

    #[test]
    fn a_composition_is_measured_and_its_flaws_are_found_where_they_are() {
        let (input, layout) = (read(&dome(40)), read(&dome(12)));
        let mesh = (*layout.mesh).clone();
        let sound = appraise(&input, &stitched(mesh.clone(), true), Allowed::default()).expect("measured");
        assert!((sound.examples[0] - 1.0).abs() < 1e-9 && sound.covered > 0.999, "{sound:?}");
        assert!(sound.flaws.is_empty() && sound.flawed.is_empty(), "{sound:?}");
        assert_eq!(
            appraise(&input, &stitched(mesh.clone(), false), Allowed::default()).expect("measured").examples,
            [0.0]
        );
        // A vertex in one corner, drawn through below the dome to the other.
        let mut torn = mesh;
        torn.positions[14] = torn.positions[13 * 13 - 1];
        let torn = appraise(&input, &stitched(torn, true), Allowed::default()).expect("measured");
        assert!(!torn.flaws.is_empty() && torn.flawed == [0], "{torn:?}");
    }
}
