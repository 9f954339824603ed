//! Finishing the map of an example that has settled: what it lacks is spanned or left out, folds are mended, and it is judged.

use super::BARE_MIN;
use super::continued::{extend, rest_of};
use super::error::{PipelineError, Stop, internal};
use super::fitted::{COVERED, LocatedLandmark, of_example};
use super::from_whole::PositionedMap;
use super::mapped::{Beyond, Covers, Fitted, MapExtent, Verdict};
use super::registered::{self, Registered};
use super::side::Side;
use super::spanned::span;
use crate::encode::index::Location;
use crate::fit::mend::{fray, islands, leaps, mend};
use crate::fit::places::Placement;
use crate::fit::{UnfoldedPatch, within, without, without_limbs};
use crate::map::CrossMap;
use crate::map::bend::{Pin, bend, is_inside};
use crate::map::reembed::{InputChart, turn_back};
use crate::map::untangle::inward;
use crate::measure::corner_change;
use crate::measure::sound::ReferenceSurface;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::area_between;
use crate::mesh::{NONE, PolyMesh, TriMesh, Vec3};
use crate::numerics::stage::Stage;
use crate::register::{Entry, Flip};
use crate::settle::Evidence;
use crate::topology::Topology;
use crate::unfold::{Chart, Uv};
use std::sync::{Arc, OnceLock};

/// The finest level at which parts are registered, in pixels a side.
const SIDE: usize = 128;
/// A landmark that is missed by less, in % of the √area of the input, is met.
const MISSED_MIN_PERCENT: f64 = 0.05;
/// Less of the example beyond the input is none.
const LOST_MIN: f64 = 0.01;

/// A constraint of the caller's: its name and ends.
type Pinned = (String, (Location, Location));

/// The parameters of a map, beside its surfaces.
#[derive(Clone, Copy)]
pub(crate) struct MapParameters<'a> {
    /// How the input is treated beyond the example.
    pub(crate) beyond: Beyond,
    /// Landmarks.
    pub(crate) held: &'a [LocatedLandmark],
    /// True where both are closed, and the input is most of its scan.
    pub(crate) are_wholes: bool,
}

/// Limbs that the input lacks are left out if they have more than this share of the example's area. *Untuned.*
const LIMB_MIN: f64 = 0.01;
/// A piece of the example is squashed if it keeps less than this share of its area, beside the rest. *Untuned.*
const SQUASHED: f64 = 0.25;
/// How often at most the rim of what is left of an example frays. *Untuned.*
const FRAYED_MAX: usize = 4;

/// Holds what is left of an example on its way to a map.
#[derive(Clone)]
struct RemainingExample {
    example: Side,
    surface: UnfoldedPatch,
    cross: CrossMap,
    /// Vertices for which the input has nothing.
    bare: Vec<bool>,
    /// True where limbs that the input lacks are left out.
    is_open: bool,
}

/// Holds how an example settled, and on what.
struct SettledExample<'a> {
    /// All of the example.
    whole: &'a UnfoldedPatch,
    mirrored: bool,
    evidence: Evidence,
    reference: ReferenceSurface,
}

impl SettledExample<'_> {
    /// Finds the edges of a mesh that leap across the input.
    fn leaps(&self, mesh: &TriMesh, cross: &CrossMap) -> Vec<[u32; 2]> {
        if Stage::Fray.is_on() { leaps(mesh, &cross.positions, &self.reference) } else { Vec::new() }
    }
}

impl RemainingExample {
    /// Takes from an example the faces that lie beyond the input.
    fn of(
        placement: Placement,
        example: &Side,
        settled: &SettledExample<'_>,
        chart: &Chart,
    ) -> Result<Self, PipelineError> {
        let Placement { places, lost, off, mirrored, .. } = placement;
        let (locations, positions) = places.into_iter().map(|p| (Location::from(p), p.point)).unzip();
        let (mesh, cross) = (&settled.whole.patch.mesh, CrossMap { locations, positions });
        let mut bare: Vec<bool> = lost.iter().zip(&off).map(|(lost, off)| *lost || *off).collect();
        let leaps = settled.leaps(mesh, &cross);
        islands(mesh, &leaps, &mut bare);
        let mut lost = with_turned(mesh, &cross, chart, registered::sign(mirrored), lost);
        fray(mesh, &leaps, &mut lost);
        let mut left = Self { example: example.clone(), surface: settled.whole.clone(), cross, bare, is_open: false };
        left.lose(&lost, LOST_MIN)?;
        Ok(left)
    }

    /// Takes away the faces most of whose vertices are `lost`, if these have more than a share `least` of the area. Tells whether it
    /// did.
    fn lose(&mut self, lost: &[bool], least: f64) -> Result<bool, PipelineError> {
        without(&self.surface, lost, least).map_or(Ok(false), |less| self.take(less))
    }

    /// Takes away the limbs that the input lacks. Tells whether it did.
    fn lose_limbs(&mut self) -> Result<bool, PipelineError> {
        let mesh = &self.surface.patch.mesh;
        let (rim, squashed) = (mesh.boundary_vertices(), squashed(mesh, &self.cross.positions));
        let missing: Vec<bool> = (0..rim.len()).map(|v| (self.bare[v] || squashed[v]) && !rim[v]).collect();
        self.is_open = without_limbs(&self.surface, &missing, LIMB_MIN).map_or(Ok(false), |less| self.take(less))?;
        Ok(self.is_open)
    }

    /// Takes what is `less` of the example.
    fn take(&mut self, less: UnfoldedPatch) -> Result<bool, PipelineError> {
        let kept = &less.patch.vertex_of;
        self.cross = CrossMap {
            locations: kept.iter().map(|&v| self.cross.locations[v as usize]).collect(),
            positions: kept.iter().map(|&v| self.cross.positions[v as usize]).collect(),
        };
        self.bare = kept.iter().map(|&v| self.bare[v as usize]).collect();
        self.example = of_example(&self.example, &less)?;
        self.surface = less;
        Ok(true)
    }
}

/// Marks the vertices about which a mesh is squashed where they lie at `positions`: limbs that the input lacks may come to rest on it,
/// a head on the stump of a neck.
fn squashed(mesh: &TriMesh, positions: &[Vec3]) -> Vec<bool> {
    let mut areas = vec![[0.0; 2]; positions.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let (own, laid) = (mesh.area(t), area_between(corners.map(|v| positions[v as usize])));
        for &v in corners {
            areas[v as usize][0] += own;
            areas[v as usize][1] += laid;
        }
    }
    let [own, laid] = areas.iter().fold([0.0; 2], |sum, area| [sum[0] + area[0], sum[1] + area[1]]);
    areas.iter().map(|area| area[1] * own < SQUASHED * area[0] * laid).collect()
}

/// Finishes the map of an example that has settled: without the limbs that the input lacks, if it is of use only then.
pub(crate) fn finish(
    placement: Placement,
    (example, one): (&Side, &UnfoldedPatch),
    query: (&Side, &UnfoldedPatch),
    asked: MapParameters<'_>,
    stop: Stop,
) -> Result<Fitted, PipelineError> {
    let two = &query.1.query;
    let settled = SettledExample {
        whole: one,
        mirrored: placement.mirrored,
        evidence: placement.evidence,
        reference: ReferenceSurface::with_tree((*two.chart.mesh).clone(), Arc::clone(two.tree())),
    };
    let left = RemainingExample::of(placement, example, &settled, &two.chart)?;
    let mut without = left.clone();
    let whole = finished(left, &settled, query, asked, stop)?;
    let is_there =
        asked.held.len() >= POSE_FIXED_BY || is_alike(&settled.evidence, JudgedBy::of(one, asked.are_wholes));
    let may_be_better = whole.mapped.verdict >= Verdict::Poor && is_there && Stage::Span.is_on();
    if !may_be_better || !without.lose_limbs()? {
        return Ok(whole);
    }
    let without = finished(without, &settled, query, asked, stop)?;
    let reach = &without.mapped.reach;
    // Openings that rows don't close stay where too little is bare for a composition to lay it out.
    let is_closed = reach.own.is_some() || 1.0 - reach.covers.input > BARE_MIN || asked.beyond == Beyond::Leave;
    let is_better = is_closed && without.mapped.verdict < whole.mapped.verdict;
    Ok(if is_better { without } else { whole })
}

/// Finishes the map of what is left of an example.
fn finished(
    mut left: RemainingExample,
    settled: &SettledExample<'_>,
    (query, two): (&Side, &UnfoldedPatch),
    MapParameters { beyond, held, are_wholes }: MapParameters<'_>,
    stop: Stop,
) -> Result<Fitted, PipelineError> {
    let &SettledExample { whole, mirrored, evidence, .. } = settled;
    let (chart, sign) = (&two.query.chart, registered::sign(mirrored));
    let spanned = span(&mut left.cross, &left.surface.patch.mesh, &left.bare, two.query.tree());
    if Stage::Mend.is_on() {
        let ground = InputChart { chart, index: two.query.index() };
        let mesh = &left.surface.patch.mesh;
        turn_back(mesh, &mut left.cross, &ground, sign, &OnceLock::new());
        mend(mesh, &mut left.cross, chart, sign);
    }
    // What frays leaves another rim, and may be torn there.
    for _ in 0..FRAYED_MAX {
        let mesh = &left.surface.patch.mesh;
        let mut lost = vec![false; mesh.positions.len()];
        fray(mesh, &settled.leaps(mesh, &left.cross), &mut lost);
        if !lost.contains(&true) || !left.lose(&lost, 0.0)? {
            break;
        }
    }
    let RemainingExample { example, surface, cross, is_open, .. } = left;
    let kept_share = surface.patch.mesh.total_area() / whole.patch.mesh.total_area();
    let mut turned = inward(&surface.patch.mesh, &cross, chart, sign);
    let before = turned.len() as u64;
    // What is spanned is flat, and which way it looks says nothing.
    turned.retain(|f| spanned.binary_search(f).is_err());
    let (pinned, missed) = pinned(held, (&surface, &cross), two, mirrored);
    let mut registration = described(&surface, two, (cross.clone(), pinned), mirrored)?;
    registration.turned_there = before - turned.len() as u64;
    let mut mapped = registered::map(&registration, &example, query, stop)?;
    let field = within(&surface.patch.mesh, &cross.positions, &two.patch.mesh);
    let rest = field.map(|field| rest_of(&two.patch.mesh, &field, is_open)).unwrap_or_default();
    let covered = 1.0 - rest.iter().map(|piece| piece.mesh.total_area()).sum::<f64>() / two.patch.mesh.total_area();
    mapped.reach = MapExtent {
        covers: Covers { example: kept_share, input: covered },
        kept: (kept_share < 1.0).then(|| kept(&example)).transpose()?,
        spanned: spanned.len() as f64 / mapped.mesh.faces.len().max(1) as f64,
        is_open,
        bridging: numbers(&spanned, &surface.patch.mesh, &mapped.mesh),
        ..MapExtent::default()
    };
    let judged_by = JudgedBy::of(whole, are_wholes);
    let sureness = sureness(&evidence, judged_by);
    (mapped.evidence, mapped.sureness) = (Some(evidence), Some(sureness));
    let folded = share(&surface.patch.mesh, &cross.positions, &turned);
    let sheared = corner_change(&surface.patch.mesh, &cross.positions);
    let is_posed = held.len() >= POSE_FIXED_BY;
    let is_alike = is_posed || is_alike(&evidence, judged_by);
    let shares = (folded, mapped.reach.spanned, sheared);
    (mapped.verdict, mapped.reasons) = judged(&evidence, shares, (is_alike, is_posed));
    mapped.reasons.extend(missed);
    let mut fitted = Fitted { mapped, example, query: query.clone() };
    if beyond == Beyond::Extend && (covered < COVERED || is_open) {
        extend(&mut fitted, &rest);
    }
    Ok(fitted)
}

/// The numbers in a map's mesh of some faces of the example's file, in order. The mesh has all faces of the file, or those of the
/// `patch`.
fn numbers(faces: &[u32], patch: &TriMesh, mapped: &PolyMesh) -> Vec<u32> {
    let mut own = patch.polygon_of.clone();
    own.sort_unstable();
    own.dedup();
    if own.len() < mapped.faces.len() {
        return faces.to_vec();
    }
    faces.iter().filter_map(|face| own.binary_search(face).ok()).map(|number| number as u32).collect()
}

/// Landmarks as constraints of the map of a surface, and a sentence for each that is met nearly only: one whose face lies on the
/// boundary, or that would fold the map.
fn pinned(
    held: &[LocatedLandmark],
    (one, cross): (&UnfoldedPatch, &CrossMap),
    two: &UnfoldedPatch,
    mirrored: bool,
) -> (Vec<Pinned>, Vec<String>) {
    if held.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let own_tree = one.query.tree();
    let (mesh, tree) = (&one.patch.mesh, Bvh::new(&one.patch.mesh));
    let (chart, input) = (&two.query.chart, two.query.tree());
    let (size, sign) = (chart.mesh.total_area().sqrt(), registered::sign(mirrored));
    let pin = |held: &LocatedLandmark| Pin { on_example: tree.closest(held.from).into(), to: held.at };
    let can_be = |pins: &[Pin]| bend(mesh, cross, pins, chart, sign, input).is_ok();
    let fit_together = can_be(&held.iter().map(pin).collect::<Vec<_>>());
    let (mut kept, mut pins, mut missed): (Vec<Pinned>, Vec<Pin>, Vec<String>) = Default::default();
    for (k, held) in held.iter().enumerate() {
        pins.push(pin(held));
        if fit_together || can_be(&pins) {
            kept.push((format!("l{}", k + 1), (own_tree.closest(held.from).into(), held.to)));
            continue;
        }
        let Some(Pin { on_example, .. }) = pins.pop() else { continue };
        let corners = mesh.triangles.get(on_example.triangle as usize).copied().unwrap_or_default();
        let at: Vec3 = (0..3).map(|k| cross.positions[corners[k] as usize] * on_example.barycentric[k]).sum();
        let percent = 100.0 * (at - held.at).norm() / size;
        if percent > MISSED_MIN_PERCENT {
            missed.push(format!("landmark {} is met but for {percent:.2} % of the scan's size", k + 1));
        }
    }
    (kept, missed)
}

/// A registration that stands for a map given by places.
fn described(
    one: &UnfoldedPatch,
    two: &UnfoldedPatch,
    (cross, pinned): (CrossMap, Vec<Pinned>),
    mirrored: bool,
) -> Result<Registered, PipelineError> {
    let flip = Flip { u: mirrored, v: false };
    let (chart, tree) = (&two.query.chart, two.query.tree());
    let (own, own_tree) = (&one.query, Bvh::new(&one.patch.mesh));
    let border = one.patch.mesh.boundary_vertices();
    let taken = |uv: Uv| -> Option<Uv> {
        let near = own_tree.closest(own.index().locate(&own.chart, uv).point(&own.chart));
        if !is_inside(&one.patch.mesh, &border, &near.into()) {
            // It could not be dragged.
            return None;
        }
        let corners = one.patch.mesh.triangles.get(near.triangle as usize)?;
        let to: Vec3 = (0..3).map(|k| cross.positions[corners[k] as usize] * near.barycentric[k]).sum();
        Some(Location::from(tree.closest(to)).uv(chart))
    };
    let features = own.encoding().features.iter().filter_map(|f| Some((flip.apply(f.uv), taken(f.uv)?)));
    let (p, q) = features.unzip();
    let entry = Entry::laid(&two.query, flip, SIDE, p, q).ok_or_else(|| internal("expected an unfolded query"))?;
    let of_whole = OnceLock::new();
    let _ = of_whole.set(PositionedMap::settled(&one.patch, cross, mirrored));
    Ok(Registered { of_whole: Arc::new(of_whole), pinned, ..Registered::of(entry) })
}

/// The vertices of an example's file that the faces of its segment use, in order.
fn kept(example: &Side) -> Result<Vec<u32>, PipelineError> {
    let inner = &*example.model;
    let mesh = &example.model.mesh;
    let mut used = vec![false; mesh.positions.len()];
    for &t in &inner.patch(example.segment)?.triangle_of {
        let face = inner.segmented.mesh.polygon_of[t as usize] as usize;
        mesh.faces.face(face).iter().for_each(|&v| used[v as usize] = true);
    }
    Ok((0..used.len() as u32).filter(|&v| used[v as usize]).collect())
}

/// The vertices that are `lost`, and those about which most faces look into the input: where they reach the example's rim, it goes
/// on around the input's end and comes back behind it. A closed example has no rim but about what it lost.
fn with_turned(mesh: &TriMesh, cross: &CrossMap, chart: &Chart, sign: f64, mut lost: Vec<bool>) -> Vec<bool> {
    if !lost.contains(&true) && !mesh.twins.contains(&NONE) {
        return lost;
    }
    let turned = inward(mesh, cross, chart, sign);
    let mut counts = vec![[0u32; 2]; lost.len()];
    for (corners, f) in mesh.triangles.iter().zip(&mesh.polygon_of) {
        let is_turned = turned.binary_search(f).is_ok();
        corners.iter().for_each(|&v| counts[v as usize][usize::from(is_turned)] += 1);
    }
    lost.iter_mut().zip(counts).for_each(|(lost, [out, into])| *lost |= into > out);
    lost
}

/// The share of the area that some polygons, in order, take of a mesh whose vertices lie at `positions`.
fn share(mesh: &TriMesh, positions: &[Vec3], polygons: &[u32]) -> f64 {
    let area = |t: usize| area_between(mesh.triangles[t].map(|v| positions[v as usize]));
    let all: f64 = (0..mesh.triangles.len()).map(area).sum();
    let is_one = |t: &usize| polygons.binary_search(&mesh.polygon_of[*t]).is_ok();
    (0..mesh.triangles.len()).filter(is_one).map(area).sum::<f64>() / all.max(f64::MIN_POSITIVE)
}

/// So many landmarks fix a pose.
const POSE_FIXED_BY: usize = 3;
/// [`Evidence::agreement`] from which on a settled map is good.
const GOOD_FROM: f64 = 0.4;
/// [`Evidence::confidence`] from which on one is fair: of a closed example on a closed scan, where neither ends anywhere. Of 231 maps on
/// 17 scans right ones have −.46 and more, all but six −.4; wrong ones that nothing else speaks against −.42 and less
/// (tests/records/wholes-2026-11-28.md).
const WHOLES_FAIR_FROM: f64 = -0.4;
/// [`Evidence::agreement`] from which on one is fair: of a closed example on a part of a scan, or on an open one. Its limbs are matched
/// with the scan's.
const CLOSED_FAIR_FROM: f64 = -0.08;
/// The same of an open example, which may lie anywhere: right ones have .137 and more; thumbs and torsos on heads, rocks and mushrooms
/// −.08 to .05 (tests/records/floor-2026-11-27.md).
const OPEN_FAIR_FROM: f64 = 0.1;
/// [`Evidence::local_relief`] from which on a map is fair, and as sure as a good one: right maps of the judged sets have .46 and more
/// where they are told by relief, and .28 where they are by limbs, wrong ones up to .22; heads on statues with curls .3 and more, wrong
/// ones up to .28, but for a box (tests/records/windows-2026-11-30.md).
const LOCAL: [f64; 2] = [0.3, 0.6];
/// With less of it a map is poor, whatever else speaks for it.
const LOCAL_LEAST: f64 = 0.2;
/// Share of the area of faces that look inward up to which it is good, or fair: hidden faces of bodies do in the truth too.
const FOLDED: [f64; 2] = [0.02, 0.06];

/// Share of the example's faces that the scan has nothing for up to which it is good, or fair: right maps have up to .19.
const SPANNED: [f64; 2] = [0.02, 0.25];

/// Mean change of the faces' angles ([`corner_change`]), in degrees, up to which it is good, or fair: good maps of the judged sets have
/// up to 11, right ones between animals of different species up to 18; of bodies on toys right ones have up to 24, but a dolphin on an
/// aircraft has 24, and a calf on a toy 23 (tests/records/sides-2026-11-29.md). Quads that are sheared more are no longer the example's.
const SHEARED: [f64; 2] = [12.0, 22.0];

/// A closed example with fewer limbs is a blob, which lies on anything: only its relief tells whether it belongs there. A tongue was fair
/// on a gnome and on a bust (tests/records/other-makers-2026-11-29.md).
const LIMBS_MIN: usize = 2;

/// Names the features by which an example is judged to be like a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JudgedBy {
    /// Its limbs, and those of a scan that ends nowhere either.
    AllLimbs,
    /// Its limbs, and those of what is only a part of a scan.
    Limbs,
    /// Its relief, as a whole or within windows: it has a rim, and may lie anywhere.
    Relief,
    /// Its relief as a whole: it is closed, and a blob without limbs. Within windows a blob agrees with any other.
    Blob,
}

impl JudgedBy {
    /// `are_wholes`: whether both are closed, and the input is most of its scan.
    pub(super) fn of(example: &UnfoldedPatch, are_wholes: bool) -> Self {
        let is_closed = example.patch.topology == Topology::Sphere;
        match is_closed.then(|| example.query.protrusions().len() >= LIMBS_MIN) {
            None => Self::Relief,
            Some(false) => Self::Blob,
            Some(true) if are_wholes => Self::AllLimbs,
            Some(true) => Self::Limbs,
        }
    }
}

/// How sure a map is: [`OPEN_FAIR_FROM`] where the example is barely enough like the scan to be fair, [`GOOD_FROM`] where it is good.
/// Either its relief as a whole speaks for it, or that within windows does.
fn sureness(evidence: &Evidence, judged_by: JudgedBy) -> f64 {
    let (measured, fair) = match judged_by {
        JudgedBy::AllLimbs => (evidence.confidence(), WHOLES_FAIR_FROM),
        JudgedBy::Limbs => (evidence.agreement(), CLOSED_FAIR_FROM),
        JudgedBy::Relief | JudgedBy::Blob => (evidence.agreement(), OPEN_FAIR_FROM),
    };
    let on_scale = |measured, [fair, good]: [f64; 2]| {
        OPEN_FAIR_FROM + (GOOD_FROM - OPEN_FAIR_FROM) * (measured - fair) / (good - fair)
    };
    let as_whole = on_scale(measured, [fair, GOOD_FROM]);
    if judged_by == JudgedBy::Blob { as_whole } else { as_whole.max(on_scale(evidence.local_relief, LOCAL)) }
}

/// Tells whether an example is enough like the scan, where it lies, to be fair.
pub(super) fn is_alike(evidence: &Evidence, judged_by: JudgedBy) -> bool {
    evidence.local_relief >= LOCAL_LEAST && sureness(evidence, judged_by) >= OPEN_FAIR_FROM
}

/// The verdict on a map that has settled, with a sentence for each measure that is not good. Relief falls where shapes
/// differ, and bend grows where the map is wrong, so neither is told alone. `sheared`: the mean change of angles, in degrees.
/// `is_posed`: landmarks fix the pose. Then the caller has said where the example belongs, and shapes that differ are no reason to
/// throw it away.
fn judged(
    evidence: &Evidence,
    (folded, spanned, sheared): (f64, f64, f64),
    (is_alike, is_posed): (bool, bool),
) -> (Verdict, Vec<String>) {
    let agreement = evidence.agreement();
    let mut reasons = Vec::new();
    let mut measure = |is_good: bool, is_fair: bool, why: &str| {
        if !is_good {
            reasons.push(why.to_owned());
        }
        if is_good {
            Verdict::Good
        } else if is_fair {
            Verdict::Fair
        } else {
            Verdict::Poor
        }
    };
    let why = "bumps and hollows of the example lie on others of the scan";
    let alike = measure(agreement >= GOOD_FROM, is_alike, why);
    let [good, fair] = FOLDED;
    let smooth = measure(folded <= good, folded <= fair, "some faces look into the scan");
    let [good, fair] = SPANNED;
    let percent = 100.0 * spanned;
    let why = format!("the scan has nothing for {percent:.0} % of the example's faces: they are spanned flat");
    let there = measure(spanned <= good, spanned <= fair, &why);
    let [good, fair] = SHEARED;
    let fair = if is_posed { f64::INFINITY } else { fair };
    let why = format!("quads are sheared: their angles change by {sheared:.0}° on average");
    let square = measure(sheared <= good, sheared <= fair, &why);
    ([alike, smooth, there, square].into_iter().fold(Verdict::Good, worse), reasons)
}

fn worse(a: Verdict, b: Verdict) -> Verdict {
    if a == Verdict::Poor || b == Verdict::Poor {
        Verdict::Poor
    } else if a == Verdict::Fair || b == Verdict::Fair {
        Verdict::Fair
    } else {
        Verdict::Good
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::prepare;
    use crate::segment::Segmented;
    use crate::topology::Components;
    use crate::topology::tests::{ball, voxels};

    #[test]
    fn what_lies_in_a_heap_is_squashed() {
        let mesh = crate::topology::tests::grid(20, 20, false, false);
        let middle = (mesh.positions[0] + mesh.positions[mesh.positions.len() - 1]) / 2.0;
        let size = mesh.total_area().sqrt();
        let is_near = |x: &Vec3| (x - middle).norm() < 0.2 * size;
        let drawn = |x: &Vec3| if is_near(x) { middle + 0.3 * (x - middle) } else { *x };
        let found = squashed(&mesh, &mesh.positions.iter().map(drawn).collect::<Vec<_>>());
        assert!(found.iter().filter(|squashed| **squashed).count() > 20);
        assert!(found.iter().zip(&mesh.positions).all(|(squashed, x)| !squashed || is_near(x)));
    }

    #[test]
    fn where_landmarks_fix_the_pose_shapes_that_differ_are_no_reason_to_throw_a_map_away() {
        let unlike = Evidence { relief: -0.2, bend: 100.0, ..Evidence::default() };
        assert!(!is_alike(&unlike, JudgedBy::AllLimbs));
        let verdict = |folded, is_posed| judged(&unlike, (folded, 0.0, 50.0), (is_posed, is_posed)).0;
        assert_eq!([false, true].map(|is_posed| verdict(0.0, is_posed)), [Verdict::Poor, Verdict::Fair]);
        assert_eq!(verdict(0.5, true), Verdict::Poor, "folds are one");
    }

    #[test]
    fn a_closed_example_without_limbs_is_told_by_its_relief() {
        let surface = |mesh: &TriMesh| {
            let whole = Segmented::primitive(mesh, Components::SmallLeftOut).expect("closed").parts.swap_remove(0);
            assert_eq!(whole.topology, Topology::Sphere);
            UnfoldedPatch::new(whole).expect("solvable")
        };
        let is_solid = |[x, y, z]: [i32; 3]| {
            let (body, legs) =
                ((4..8).contains(&z), (0..4).contains(&z) && !(2..10).contains(&x) && !(2..5).contains(&y));
            (0..12).contains(&x) && (0..7).contains(&y) && (body || legs)
        };
        let table = prepare(&voxels(&is_solid, [12, 7, 8])).expect("closed").mesh;
        let judged_by = |mesh: &TriMesh| [true, false].map(|are_wholes| JudgedBy::of(&surface(mesh), are_wholes));
        assert_eq!(judged_by(&table), [JudgedBy::AllLimbs, JudgedBy::Limbs]);
        assert_eq!(judged_by(&ball(24)), [JudgedBy::Blob; 2]);
    }

    #[test]
    fn an_open_example_has_to_agree_better_than_a_closed_one_and_on_a_part_better_than_on_a_whole() {
        let fair = |agreement: f64, normal_disagreement: f64| {
            let evidence = Evidence {
                relief: agreement,
                local_relief: 0.25,
                bend: 0.0,
                normal_disagreement,
                ..Evidence::default()
            };
            assert!((evidence.agreement() - agreement).abs() < 1e-12);
            [JudgedBy::AllLimbs, JudgedBy::Limbs, JudgedBy::Relief].map(|judged_by| is_alike(&evidence, judged_by))
        };
        assert_eq!(fair(-0.5, 0.0), [false; 3]);
        assert_eq!(fair(-0.1, 0.0), [true, false, false]);
        assert_eq!(fair(0.0, 0.0), [true, true, false]);
        assert_eq!(fair(0.2, 0.0), [true; 3]);
        // A bust on a boot.
        assert_eq!(fair(-0.08, 0.177), [false, true, false]);
    }

    #[test]
    fn relief_within_windows_speaks_for_a_map_and_without_it_none_is_fair() {
        let fair = |relief: f64, local_relief: f64, judged_by| {
            is_alike(&Evidence { relief, local_relief, bend: 100.0, ..Evidence::default() }, judged_by)
        };
        // A head on a statue's with curls; on a part of a face; on a hand.
        let open = |relief, local_relief| fair(relief, local_relief, JudgedBy::Relief);
        assert_eq!([open(0.3, 0.45), open(0.55, 0.1), open(0.3, 0.25)], [true, false, false]);
        // A body on an armadillo's; a tongue on a squirrel.
        assert!(fair(-0.3, 0.34, JudgedBy::AllLimbs) && !fair(0.35, 0.37, JudgedBy::Blob));
    }

    #[test]
    fn a_map_of_sheared_quads_is_poor_however_well_it_agrees() {
        let alike = Evidence { relief: 0.9, bend: 10.0, ..Evidence::default() };
        let by_shear = |sheared| judged(&alike, (0.0, 0.0, sheared), (true, false));
        assert_eq!([8.0, 20.0, 25.0].map(|sheared| by_shear(sheared).0), [Verdict::Good, Verdict::Fair, Verdict::Poor]);
        assert!(by_shear(43.0).1[0].contains("43°"));
    }
}
