//! The last look at what is delivered: whether its mesh can be used at all, whatever was thought of it before.

use super::mapped::{Judgement, Mapped, Verdict};
use super::model::Model;
use super::side::Side;
use super::stitched::{LayoutOwner, Stitched};
use crate::compose::apart::{owned, scale};
use crate::measure::sound::{Flaws, ReferenceSurface};
use crate::mesh::bvh::Bvh;
use crate::mesh::facing::TurnedArea;
use crate::mesh::{NONE, PolyMesh, TriMesh, Vec3};
use crate::topology::with_gaps_filled;
use std::sync::Arc;

/// Flaws that a composition may have, since its maps have them on purpose. Shares from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AllowedFlaws {
    /// Of the faces: those that are spanned flat where the scan has nothing.
    pub spanned: f64,
    /// Of the scan's area: what is left bare.
    pub bare: f64,
}

/// A stitched mesh, measured against its input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Appraisal {
    /// Of each segment the share of the mesh's area that an example's layout has there, 0–1.
    pub examples: Vec<f64>,
    /// Share of its area that is the input's own triangles as quads, 0–1.
    pub own: f64,
    /// Share of the input's area with faces near it, 0–1.
    pub covered: f64,
    /// Mean distance of its faces' middles from the input by area, as a share of the input's diagonal. Faces that bridge a gap
    /// count for nothing.
    pub away: f64,
    /// Share of its area that looks more than 60° away from the input, 0–1: spikes and crumples.
    pub turned: f64,
    /// The same of faces of examples alone, as a share of all of its area.
    pub turned_of_examples: f64,
    /// What makes it no use as it is, a sentence each; none of a mesh that is sound.
    pub flaws: Vec<String>,
    /// Segments on which the faces stand that make it so.
    pub flawed: Vec<u32>,
}

/// Calls a map broken whose mesh is, and says why before all else.
pub(crate) fn check(mapped: &mut Mapped, query: &Side) {
    let inner = &*query.model;
    if inner.laid.is_some() {
        // A part of what was laid whole ends beside its segment.
        let reference = ReferenceSurface::new(owned(inner.ground().input()).into_owned());
        let flaws = reference.flaws(&mapped.mesh, &[]).reasons(1.0, 0.0);
        broken_by(flaws, &mut mapped.verdict, &mut mapped.reasons);
        return;
    }
    let surface: &TriMesh = &query.encoded.query.chart.mesh;
    let mut flaws = ReferenceSurface::with_tree(surface.clone(), Arc::clone(query.encoded.query.tree()))
        .with_gaps(inner.patch(query.segment).ok().and_then(with_gaps_filled).into_iter())
        .flaws(&mapped.mesh, &mapped.reach.bridging);
    if !inner.is_most(query.segment) {
        // On a part stitching moves vertices to what is missed.
        flaws.missed = 0.0;
    }
    let left_out = 1.0 - mapped.reach.covers.input;
    let reasons = |flaws: &Flaws| flaws.reasons(left_out, mapped.reach.spanned);
    let (found, of_stitched, note) = (reasons(&flaws), reasons(&flaws.reached()), flaws.note(left_out));
    if found != of_stitched || note.is_some() {
        let mut stitched = Judgement { verdict: mapped.verdict, reasons: mapped.reasons.clone() };
        broken_by(of_stitched, &mut stitched.verdict, &mut stitched.reasons);
        mapped.stitched = Some(stitched);
    }
    if let Some(note) = note {
        mapped.verdict = mapped.verdict.max(Verdict::Fair);
        mapped.reasons.insert(0, note);
    }
    broken_by(found, &mut mapped.verdict, &mut mapped.reasons);
}

/// Calls a mesh broken where there are flaws, and puts them before all other reasons.
fn broken_by(flaws: Vec<String>, verdict: &mut Verdict, reasons: &mut Vec<String>) {
    if !flaws.is_empty() {
        *verdict = Verdict::Broken;
        reasons.splice(0..0, flaws);
    }
}

/// Measures a composition against its input.
pub fn appraise(query: &Model, made: &Stitched, allowed: AllowedFlaws) -> Appraisal {
    let ground = query.ground();
    let surface = owned(ground.input());
    let filled = query.segmented.parts.iter().filter_map(with_gaps_filled);
    let reference = ReferenceSurface::new(surface.into_owned()).with_gaps(filled);
    let flaws = reference.flaws(&made.mesh, &made.bridging);
    let turned = reference.turned(&made.mesh, &made.bridging);
    let tree = Bvh::new(ground.input().surface);
    // The segment on which a face stands: that at its middle.
    let placed = |face: &[u32]| {
        let near = tree.closest(middle(&made.mesh, face));
        let owner = ground.input().owner.get(near.triangle as usize).copied().unwrap_or(NONE);
        ((owner != NONE).then_some(owner), near.distance)
    };
    let mut examples = vec![0.0; made.standing.len()];
    let (mut all, mut own, mut away, mut lying) = (0.0, 0.0, 0.0, 0.0);
    let mut of_examples = TurnedArea::default();
    for (f, face) in (0u32..).zip(made.mesh.faces.iter()) {
        let area = area(&made.mesh, face);
        all += area;
        let (segment, distance) = placed(face);
        if distance.is_finite() && made.bridging.binary_search(&f).is_err() {
            (away, lying) = (away + area * distance, lying + area);
        }
        let segment = segment.map(|segment| segment as usize);
        match segment.and_then(|segment| Some((segment, made.standing.get(segment)?))) {
            Some((segment, LayoutOwner::Example)) => {
                examples[segment] += area;
                of_examples.add(turned[f as usize]);
            }
            Some((_, LayoutOwner::Own)) => own += area,
            _ => {}
        }
    }
    let all = f64::max(all, f64::MIN_POSITIVE);
    examples.iter_mut().for_each(|share| *share /= all);
    let mut flawed: Vec<u32> = flaws.faces.iter().filter_map(|&f| placed(made.mesh.faces.face(f as usize)).0).collect();
    flawed.sort_unstable();
    flawed.dedup();
    let away = away / f64::max(lying * scale(ground.input().surface).diagonal, f64::MIN_POSITIVE);
    let (covered, flaws) = (1.0 - flaws.bare, flaws.reasons(allowed.bare, allowed.spanned));
    let turned = TurnedArea::of(turned);
    let turned_of_examples = of_examples.share_of(turned);
    let turned = turned.share();
    Appraisal { examples, own: own / all, covered, away, turned, turned_of_examples, flaws, flawed }
}

/// The mean of a face's corners.
pub(crate) fn middle(mesh: &PolyMesh, face: &[u32]) -> Vec3 {
    face.iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / face.len().max(1) as f64
}

/// The area of a face.
pub(crate) fn area(mesh: &PolyMesh, face: &[u32]) -> f64 {
    let at = |k: usize| mesh.positions[face[k] as usize];
    let fan = |k: usize| (at(k) - at(0)).cross(&(at(k + 1) - at(0)));
    0.5 * (1..face.len().saturating_sub(1)).map(fan).sum::<Vec3>().norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Limits;
    use crate::pipeline::{Cut, read as read_model};
    use std::fmt::Write;

    /// n × n quads on a dome, as OBJ.
    fn dome(n: usize) -> String {
        dome_without(n, |_, _| false)
    }

    /// The same without the quads whose first corner is told to go, by its place in the square from −1 to 1.
    fn dome_without(n: usize, is_gone: impl Fn(f64, f64) -> bool) -> String {
        let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        let mut text = String::new();
        for (x, y) in (0..=n).flat_map(|j| (0..=n).map(move |i| (at(i), at(j)))) {
            let _ = writeln!(text, "v {x} {y} {}", 0.8 * (1.0 - x * x) * (1.0 - y * y));
        }
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).filter(|&(i, j)| !is_gone(at(i), at(j))) {
            let v = |i: usize, j: usize| j * (n + 1) + i + 1;
            let _ = writeln!(text, "f {} {} {} {}", v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1));
        }
        text
    }

    fn read(text: &str) -> Model {
        read_model(text.as_bytes(), None, &Cut::default(), &Limits::default()).expect("a disc")
    }

    fn stitched(mesh: PolyMesh, is_example: bool) -> Stitched {
        Stitched {
            mesh: Arc::new(mesh),
            standing: vec![if is_example { LayoutOwner::Example } else { LayoutOwner::Own }],
            bridging: Vec::new(),
            extraordinary_vertices: 0,
            extraordinary_before: 0,
            notes: Vec::new(),
        }
    }

    #[test]
    fn an_end_of_a_tube_may_be_bridged() {
        let is_gone = |x: f64, y: f64| x.abs() < 0.2 && y.abs() < 0.2;
        let (input, layout) = (read(&dome_without(40, is_gone)), read(&dome(12)));
        assert_eq!(input.segments()[0].topology, crate::topology::Topology::Annulus);
        let made = appraise(&input, &stitched((*layout.mesh).clone(), true), AllowedFlaws::default());
        assert!(made.flaws.is_empty(), "{made:?}");
    }

    #[test]
    fn a_composition_is_measured_and_its_flaws_are_found_where_they_are() {
        let (input, layout) = (read(&dome(40)), read(&dome(12)));
        let mesh = (*layout.mesh).clone();
        let sound = appraise(&input, &stitched(mesh.clone(), true), AllowedFlaws::default());
        assert!((sound.examples[0] - 1.0).abs() < 1e-9 && sound.covered > 0.999, "{sound:?}");
        assert!(sound.flaws.is_empty() && sound.flawed.is_empty(), "{sound:?}");
        let own = appraise(&input, &stitched(mesh.clone(), false), AllowedFlaws::default());
        assert_eq!((&own.examples[..], sound.own), (&[0.0][..], 0.0));
        assert!((own.own - 1.0).abs() < 1e-9, "{own:?}");
        // A vertex in one corner, drawn through below the dome to the other.
        let mut torn = mesh;
        torn.positions[14] = torn.positions[13 * 13 - 1];
        let torn = appraise(&input, &stitched(torn, true), AllowedFlaws::default());
        assert!(!torn.flaws.is_empty() && torn.flawed == [0], "{torn:?}");
    }
}
