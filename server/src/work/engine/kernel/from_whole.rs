//! Where a query was cut as an example is, the example's parts go where the whole was laid.
//!
//! A part alone knows less of where it belongs: one that is nearly its own mirror image may lie mirrored, and a trunk's half
//! turned. The caller's constraints bend that map in the input's own domain: with p_k where it takes the constraints' ends on
//! the example and q_k their ends on the input, uv ↦ ψ̂(uv), held at places of a grid that are far from them.

use super::super::{EngineError, Refusal, Side};
use super::fresh;
use super::model::{Laid as WholeLaid, ModelInner};
use super::registered::{self, Laid, Registered, Surface, Way};
use quadmuse_kernel::encode::features::distance_on;
use quadmuse_kernel::encode::index::Location as Place;
use quadmuse_kernel::map::edit::check_folds;
use quadmuse_kernel::map::placed::placed;
use quadmuse_kernel::map::untangle::untangle;
use quadmuse_kernel::map::{CrossMap, leave_fillings};
use quadmuse_kernel::measure;
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{TriMesh, Vec3};
use quadmuse_kernel::register::{Flip, Registration};
use quadmuse_kernel::topology::Patch;
use quadmuse_proto::Location;

/// Places of the grid along each side of the domain.
const HOLDS: usize = 10;
/// Distance from a constraint, in the domain, within which nothing is held: at least, and in lengths of its move.
const FREE_MIN: f64 = 0.15;
const FREE_MOVES: f64 = 2.5;
/// A move in the domain that is none.
const STILL: f64 = 1e-9;

/// The map of a part that the whole makes.
#[derive(Debug)]
pub(super) struct OfWhole {
    /// As the whole lies, whose cuts are beside the segment's.
    as_laid: CrossMap,
    /// Within the segment, boundary on boundary.
    cross: CrossMap,
    /// 95th percentile of the angle distortion as it was laid, in degrees.
    laid_angle_p95_deg: f64,
}

/// The part where the whole was laid on this query, if it was, and the 95th percentile of its angle distortion there, in
/// degrees.
pub(super) fn from_whole<'a>(
    registered: &'a Registered,
    example: &Side,
    query: &Side,
) -> Result<Option<(Laid<'a>, f64)>, EngineError> {
    let (of, on): (&ModelInner, &ModelInner) = (example.model.inner.open()?, query.model.inner.open()?);
    let is_its_part = example.segment == query.segment;
    let Some(whole) = on.laid.as_ref().filter(|laid| is_its_part && laid.is_of(&example.model.mesh)) else {
        return Ok(None);
    };
    let (patch, surface) = (of.patch(example.segment)?, registered.surface(query)?);
    if registered.of_whole.get().is_none() {
        let Some(made) = part_of(whole, patch, surface) else { return Ok(None) };
        let _ = registered.of_whole.set(made);
    }
    let Some(of_whole) = registered.of_whole.get() else { return Ok(None) };
    let source = fresh(&example.encoded.encoding)?;
    let own = Own { part: &patch.mesh, bvh: Bvh::new(&patch.mesh), cross: &of_whole.cross, input: surface };
    let mut constraints = registered::constraints(registered.registration(), &registered.named(), source, surface);
    for c in &mut constraints {
        if let Some(there) = own.taken_to(Vec3::from(c.on_example.point)) {
            let [u, v] = there.uv(&surface.chart);
            c.on_input = Location { point: there.point(&surface.chart).into(), u, v };
        }
    }
    constraints.extend(registered::pinned(registered, &source.chart, &surface.chart));
    let pins: Vec<(Vec3, Place)> = registered.pinned.iter().map(|(_, (a, b))| (a.point(&source.chart), *b)).collect();
    let within = match pins.is_empty() {
        true => of_whole.cross.clone(),
        false => own.bent(&pins).map_err(|detail| folds(registered, &detail))?,
    };
    // What the constraints leave alone is shown where the whole lies.
    let mut cross = of_whole.as_laid.clone();
    for (v, bent) in within.locations.iter().enumerate().filter(|(v, bent)| **bent != of_whole.cross.locations[*v]) {
        (cross.locations[v], cross.positions[v]) = (*bent, within.positions[v]);
    }
    let laid = Laid {
        cross,
        as_part: Some(within.positions),
        way: Way::Whole,
        input: &surface.chart,
        mirrored: whole.mirrored,
        cost: whole.cost,
        modulus_log: whole.modulus_log,
        constraints,
        registered: registered.clone(),
    };
    Ok(Some((laid, of_whole.laid_angle_p95_deg)))
}

/// The part of the whole on a segment's surface; `None` where a vertex has no place, or the boundaries differ.
fn part_of(whole: &WholeLaid, patch: &Patch, surface: &Surface) -> Option<OfWhole> {
    let points: Option<Vec<Vec3>> =
        patch.vertex_of.iter().map(|&v| whole.places.get(v as usize).copied().flatten()).collect();
    let (chart, mirror) = (&surface.chart, registered::sign(whole.mirrored));
    let points = points?;
    let mut cross = placed(patch, &points, chart, mirror)?;
    untangle(&patch.mesh, &mut cross, chart, mirror, &surface.bvh);
    leave_fillings(&mut cross, chart);
    let as_laid = CrossMap { locations: cross.locations.clone(), positions: points };
    let laid_angle_p95_deg = measure::angle_distortion(&patch.mesh, &as_laid).p95;
    Some(OfWhole { as_laid, cross, laid_angle_p95_deg })
}

fn folds(registered: &Registered, detail: &str) -> EngineError {
    let which: Vec<&str> = registered.pinned.iter().map(|p| p.0.as_str()).collect();
    EngineError::refused(Refusal::ConstraintFolds, format!("constraint {}: {detail}", which.join(", ")))
}

/// A part with the map that the whole makes of it.
struct Own<'a> {
    part: &'a TriMesh,
    bvh: Bvh,
    cross: &'a CrossMap,
    input: &'a Surface,
}

impl Own<'_> {
    /// Where a point of the example goes.
    fn taken_to(&self, from: Vec3) -> Option<Place> {
        let near = self.bvh.closest(from);
        let corners = self.part.triangles.get(near.triangle as usize)?;
        let point: Vec3 = (0..3).map(|k| self.cross.positions[corners[k] as usize] * near.barycentric[k]).sum();
        let on = self.input.bvh.get_or_init(|| Bvh::new(&self.input.chart.mesh)).closest(point);
        Some(Place { triangle: on.triangle, barycentric: on.barycentric })
    }

    /// The map with points of the example taken to places on the input; why not, where it would fold.
    fn bent(&self, pins: &[(Vec3, Place)]) -> Result<CrossMap, String> {
        let (chart, topology) = (&*self.input.chart, self.input.chart.topology);
        let mut bend = Registration {
            flip: Flip::default(),
            side: 0,
            p: Vec::new(),
            q: Vec::new(),
            energy: 0.0,
            variance: 0.0,
            folds: 0,
        };
        for (from, to) in pins {
            let Some(p) = self.taken_to(*from).map(|place| place.uv(chart)) else { continue };
            let q = to.uv(chart);
            // Of all periods the nearest.
            let v = if topology.is_periodic_v() { q[1] + (p[1] - q[1]).round() } else { q[1] };
            bend.p.push(p);
            bend.q.push([q[0] + (p[0] - q[0]).round(), v]);
        }
        let moves: Vec<_> = bend.p.iter().copied().zip(bend.q.iter().copied()).collect();
        let is_free = |x: [f64; 2]| {
            moves
                .iter()
                .any(|&(p, q)| distance_on(topology, p, x) < (FREE_MOVES * distance_on(topology, p, q)).max(FREE_MIN))
        };
        for (i, j) in (0..HOLDS).flat_map(|i| (0..HOLDS).map(move |j| (i, j))) {
            let x = [i, j].map(|k| (k as f64 + 0.5) / HOLDS as f64);
            if !is_free(x) {
                bend.p.push(x);
                bend.q.push(x);
            }
        }
        check_folds(&bend, topology).map_err(|e| e.to_string())?;
        let mut cross = self.cross.clone();
        for (location, position) in cross.locations.iter_mut().zip(&mut cross.positions) {
            let from = location.uv(chart);
            let to = bend.map(topology, from);
            let inside = [to[0].rem_euclid(1.0), if topology.is_periodic_v() { to[1].rem_euclid(1.0) } else { to[1] }];
            if distance_on(topology, from, inside) > STILL {
                *location = self.input.index.locate(chart, inside);
                *position = location.point(chart);
            }
        }
        Ok(cross)
    }
}
