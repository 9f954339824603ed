//! Examples laid on inputs that may end elsewhere, or be closed where the example is open.
//!
//! Both are compared as wholes and by parts ([`extents`]); the best few are laid like surfaces that end alike, and the one
//! that matches best and distorts least is taken. The sides of such a map are what is left of the surfaces, so that it is
//! edited like any other.

use super::super::{Encoded, Encoding, EngineError, Fitted, Model, Opaque, Reach, Refusal, Registration, Side};
use super::model::ModelInner;
use super::{Source, facts, fresh, internal, registered};
use crate::pool::Stop;
use quadmuse_kernel::extent::{Crop, Extent, extents};
use quadmuse_kernel::fit::{Cropped, Surface, beyond::continued, crop, crop_between};
use quadmuse_kernel::mesh::{PolyMesh, Vec3};
use quadmuse_kernel::register::{Entry, LevenbergMarquardt, Query};
use quadmuse_kernel::segment::Segmented;
use quadmuse_kernel::topology::{Components, Patch, Topology, primitive};
use quadmuse_proto::{Beyond, Covers, Topology as Primitive, Verdict};
use std::sync::Arc;

/// The finest level at which parts are registered, in pixels a side.
const SIDE: usize = 128;
/// Pairs of parts that are laid.
const LAID: usize = 2;
/// A part must match better than the whole by this factor.
const PART_MARGIN: f64 = 0.8;
/// Extents of which neither share differs by more are the same.
const SAME_SHARE: f64 = 0.02;

/// Whether examples of one topology can be laid on inputs of another.
pub(super) fn reaches(example: Primitive, query: Primitive) -> bool {
    let has_caps = |topology| matches!(topology, Primitive::Disc | Primitive::Sphere);
    example == query || has_caps(example) && has_caps(query)
}

/// Lays an example where it fits best.
pub(super) fn fit(
    from: Option<&Registration>,
    example: &Side,
    query: &Side,
    beyond: Beyond,
    stop: &Stop,
) -> Result<Fitted, EngineError> {
    let whole = from.map(|from| registered::map(from, example, query, stop)).transpose()?;
    let whole = whole.map(|mapped| Fitted { mapped, example: example.clone(), query: query.clone() });
    if whole.as_ref().is_some_and(|whole| whole.mapped.verdict == Verdict::Good || whole.mapped.is_of_whole) {
        return whole.ok_or_else(|| EngineError::Internal("expected the map just made".into()));
    }
    let mut best = whole;
    for (extent, one, two) in parts(example, query, stop)? {
        let Some(made) = laid(&extent, one, two, stop)? else { continue };
        let least = best.as_ref().map_or(f64::INFINITY, |best| best.mapped.misfit * PART_MARGIN);
        if made.mapped.misfit < least {
            best = Some(made);
        }
    }
    let mut best = best.ok_or_else(|| {
        let detail =
            "expected an example of which a part matches the input, or the reverse, found none; choose another";
        EngineError::refused(Refusal::NotEncodable, detail)
    })?;
    if beyond == Beyond::Extend {
        extend(&mut best)?;
    }
    Ok(best)
}

/// The best pairs of parts, with what they leave of the two sides.
fn parts(example: &Side, query: &Side, stop: &Stop) -> Result<Vec<(Extent, Side, Side)>, EngineError> {
    let (one, two) = (surface(example)?, surface(query)?);
    let stopped = || stop.reason().is_some();
    let mut found: Vec<Extent> = Vec::new();
    for extent in extents(&one.query, &two.query, &LevenbergMarquardt::default(), &stopped) {
        let apart = |a: &Crop, b: &Crop| (a.share - b.share).abs() > SAME_SHARE;
        let is_new = found.iter().all(|f| {
            apart(&f.one, &extent.one) || apart(&f.two, &extent.two) || f.registration.flip != extent.registration.flip
        });
        if is_new && !(extent.one.is_whole() && extent.two.is_whole()) {
            found.push(extent);
        }
    }
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
    let mut made = Vec::new();
    for extent in found {
        let first = match extent.one.is_whole() {
            true => Some(example.clone()),
            false => crop_between(&one, &extent.one).map(|c| of_example(example, c)).transpose()?,
        };
        let second = match extent.two.is_whole() {
            true => Some(query.clone()),
            false => crop(&two, &extent.two).map(|c| of_query(query, c)).transpose()?,
        };
        if let (Some(first), Some(second)) = (first, second) {
            made.push((extent, first, second));
        }
        if made.len() == LAID {
            break;
        }
    }
    Ok(made)
}

fn surface(side: &Side) -> Result<Surface, EngineError> {
    let model: &ModelInner = side.model.inner.open()?;
    Ok(Surface {
        patch: Arc::new(model.patch(side.segment)?.clone()),
        query: Arc::clone(fresh(&side.encoded.encoding)?),
    })
}

/// The side that a part of an example is.
fn of_example(whole: &Side, cropped: Cropped) -> Result<Side, EngineError> {
    let model: &ModelInner = whole.model.inner.open()?;
    let patch = model.patch(whole.segment)?;
    let part = &cropped.surface.patch;
    let number = |of: &[u32], v: &u32| of.get(*v as usize).copied().unwrap_or(0);
    let part = Patch {
        vertex_of: part.vertex_of.iter().map(|v| number(&patch.vertex_of, v)).collect(),
        triangle_of: part.triangle_of.iter().map(|t| number(&patch.triangle_of, t)).collect(),
        ..(**part).clone()
    };
    let mut part_of = vec![1; model.segmented.mesh.triangles.len()];
    part.triangle_of.iter().for_each(|&t| part_of[t as usize] = 0);
    let segmented = Segmented { part_of, parts: vec![part], seams: Vec::new(), ..model.segmented.clone() };
    Ok(side(whole, model, segmented, cropped.surface.query))
}

/// The side that a part of a query is; what is left beside it are the model's other segments.
fn of_query(whole: &Side, cropped: Cropped) -> Result<Side, EngineError> {
    let model: &ModelInner = whole.model.inner.open()?;
    Ok(side(whole, model, cropped.segmented, cropped.surface.query))
}

fn side(whole: &Side, of: &ModelInner, segmented: Segmented, query: Arc<Query>) -> Side {
    let inner = ModelInner { prepared: of.prepared.clone(), segmented, laid: None, is_part: true };
    let bending =
        inner.segmented.parts.first().map_or(0.0, |p| quadmuse_kernel::rank::bending::bending(&p.mesh) as f32);
    let facts = facts(query.encoding(), inner.faces(0), bending);
    let encoding = Encoding { facts, inner: Opaque::new(Source::Fresh(query)) };
    Side {
        model: Arc::new(Model {
            segments: inner.segments(),
            labels: None,
            inner: Opaque::new(inner),
            ..(*whole.model).clone()
        }),
        segment: 0,
        encoded: Arc::new(Encoded { encoding, chart: Opaque::new(()), repairs: Vec::new() }),
    }
}

/// Registers and lays two sides that end alike.
fn laid(extent: &Extent, example: Side, query: Side, stop: &Stop) -> Result<Option<Fitted>, EngineError> {
    let stopped = || stop.reason().is_some();
    let (one, two) = (fresh(&example.encoded.encoding)?, fresh(&query.encoded.encoding)?);
    let solver = LevenbergMarquardt::default();
    let Some(mut entry) = Entry::coarse(two, one.encoding(), &solver, &stopped) else { return Ok(None) };
    while entry.side() < SIDE {
        entry.advance(two, one.encoding(), &solver, &stopped).map_err(internal)?;
    }
    entry.refine_poles(two, one.encoding(), &solver, &stopped).map_err(internal)?;
    let registration = registered::checked(entry, stop)?;
    let mut mapped = registered::map(&registration, &example, &query, stop)?;
    mapped.reach = Reach {
        covers: Covers { example: extent.one.share, input: extent.two.share },
        kept: (!extent.one.is_whole()).then(|| kept(&example)).transpose()?,
        ..Reach::default()
    };
    Ok(Some(Fitted { mapped, example, query }))
}

/// The vertices of an example's file that the faces of its segment use, in order.
fn kept(example: &Side) -> Result<Vec<u32>, EngineError> {
    let inner: &ModelInner = example.model.inner.open()?;
    let mesh = &example.model.mesh;
    let mut used = vec![false; mesh.positions.len()];
    for &t in &inner.patch(example.segment)?.triangle_of {
        let face = inner.segmented.mesh.polygon_of[t as usize] as usize;
        mesh.faces.face(face).iter().for_each(|&v| used[v as usize] = true);
    }
    Ok((0..used.len() as u32).filter(|&v| used[v as usize]).collect())
}

/// Continues a map to where the input ends, where it ends before.
fn extend(fitted: &mut Fitted) -> Result<(), EngineError> {
    let model: &ModelInner = fitted.query.model.inner.open()?;
    let [_, rest] = &model.segmented.parts[..] else { return Ok(()) };
    if !model.is_part || fitted.mapped.reach.covers.input >= 1.0 {
        return Ok(());
    }
    let found = primitive(&rest.mesh, Components::Largest).ok();
    let rest = found.filter(|rest| matches!(rest.topology, Topology::Annulus | Topology::Disc));
    let mapped = &mut fitted.mapped;
    let own = &mapped.mesh;
    let Some(grown) = rest.and_then(|rest| continued(own, &rest)) else {
        mapped
            .reasons
            .push("the rest of the scan is left bare: it has more openings than rows of quads can go round".into());
        return Ok(());
    };
    let (all, part) = (area(&grown), area(own));
    mapped.reach.own = Some((own.positions.len() as u64, own.faces.len() as u64));
    mapped.reach.inspired = Some(part / all.max(f64::MIN_POSITIVE));
    mapped.mesh = Arc::new(grown);
    mapped.part = Arc::clone(&mapped.mesh);
    Ok(())
}

fn area(mesh: &PolyMesh) -> f64 {
    let of = |face: &[u32]| {
        let at = |k: usize| mesh.positions[face[k] as usize];
        (1..face.len().saturating_sub(1)).map(|k| (at(k) - at(0)).cross(&(at(k + 1) - at(0)))).sum::<Vec3>().norm()
    };
    0.5 * mesh.faces.iter().map(of).sum::<f64>()
}
