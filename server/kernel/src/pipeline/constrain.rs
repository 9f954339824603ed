//! Editing constraints: removals first, then moves and additions; all of an edit or nothing.

use super::constraint::{Constraint, ConstraintEdit, ConstraintOrigin, OnFold, Place};
use super::error::{PipelineError, Refusal, Stop};
use super::from_whole;
use super::registered::Registered;
use super::side::Side;
use crate::encode::features::distance_on;
use crate::encode::index::{Location, PlanarIndex};
use crate::map::edit::{self, EditError};
use crate::mesh::bvh::Bvh;
use crate::mesh::{NONE, Vec3};
use crate::topology::Topology;
use crate::unfold::Chart;
use std::sync::{Arc, OnceLock};

/// Applies an edit to the registration of a map; `present` are the map's constraints.
///
/// # Errors
/// [`PipelineError::Refused`] where a constraint is unknown, names no point of its surface, or folds the map;
/// [`PipelineError::Stopped`].
pub fn edit(
    registered: &Registered,
    present: &[Constraint],
    wanted: &ConstraintEdit,
    example: &Side,
    query: &Side,
    stop: Stop,
) -> Result<Registered, PipelineError> {
    // What several charts make has tips that no chart could move: it is bent where it lies.
    let is_of_charts = registered.atlas.get().is_some_and(Option::is_some);
    if is_of_charts || registered.of_whole.get().is_some() {
        from_whole::keep(registered, example, query, stop)?;
        let (one, two) = (&&example.encoded.query.chart, &registered.surface(query)?.chart);
        let (edited, touched) = edit_pinned(registered, wanted, present, (example, one), (query, two))?;
        return from_whole::fitted(edited, &touched, wanted.on_fold, example, query, stop);
    }
    let topology = registered.entry.best().unfolded.encoding.topology;
    let input = registered.surface(query)?;
    let source = &example.encoded.query;
    let mut registration = registered.registration().clone();
    let mut names = registered.named();
    for id in &wanted.undo {
        undo(&mut registration, &mut names, &registered.entry.best().registration, id)?;
    }
    for id in &wanted.remove {
        let at = position(&names, id)?;
        edit::remove(&mut registration, at)
            .map_err(|e| PipelineError::refused(Refusal::ConstraintInvalid, e.to_string()))?;
        names.remove(at);
    }
    let bvhs = (&*registered.example_bvh, &input.bvh);
    let ends = Ends { example, query, example_chart: &source.chart, input_chart: &input.chart, bvhs };
    let mut touched = Vec::new();
    for new in &wanted.set {
        let index = new.id.as_ref().map(|id| position(&names, id)).transpose()?;
        let now = edit::constraints(&registration);
        let old = index.and_then(|i| now.get(i)).copied();
        let on_example = match &new.on_example {
            Some(place) => ends.on_example(place)?,
            None => old.map(|o| o.0).ok_or_else(|| missing("on_example"))?,
        };
        let on_input = match &new.on_input {
            Some(place) => ends.on_input(place)?,
            None => old.map(|o| o.1).ok_or_else(|| missing("on_input"))?,
        };
        edit::set(&mut registration, topology, index, on_example, on_input)
            .map_err(|e| PipelineError::refused(Refusal::ConstraintUnknown, e.to_string()))?;
        match index {
            Some(i) => names[i].1 = ConstraintOrigin::User,
            None => names.push((free_name(&names), ConstraintOrigin::User)),
        }
        touched.push(index.unwrap_or(names.len() - 1));
    }
    let settled = match wanted.on_fold {
        OnFold::Refuse => edit::check_folds(&registration, topology),
        OnFold::Resolve => edit::resolve(&mut registration, topology, &touched).map(|_| ()),
    };
    settled.map_err(|e| folds(&e, &registration, topology, &names, &touched))?;
    Ok(Registered { edited: Some(registration), names, ..registered.clone() })
}

fn missing(end: &str) -> PipelineError {
    PipelineError::refused(Refusal::ConstraintInvalid, format!("expected `{end}` for a new constraint, found none"))
}

/// Puts a constraint back as the registration had it; one that was added goes.
fn undo(
    registration: &mut crate::register::Registration,
    names: &mut Vec<(String, ConstraintOrigin)>,
    original: &crate::register::Registration,
    id: &str,
) -> Result<(), PipelineError> {
    let feature = id.strip_prefix('f').and_then(|k| k.parse::<usize>().ok()).filter(|k| *k < original.p.len());
    let at = names.iter().position(|(name, _)| name == id);
    match (feature, at) {
        (Some(k), Some(at)) => {
            (registration.p[at], registration.q[at]) = (original.p[k], original.q[k]);
            names[at].1 = ConstraintOrigin::Feature;
        }
        (Some(k), None) => {
            registration.p.push(original.p[k]);
            registration.q.push(original.q[k]);
            names.push((id.to_owned(), ConstraintOrigin::Feature));
        }
        (None, _) => {
            let at = position(names, id)?;
            edit::remove(registration, at)
                .map_err(|e| PipelineError::refused(Refusal::ConstraintInvalid, e.to_string()))?;
            names.remove(at);
        }
    }
    Ok(())
}

/// Edits the constraints of a map that is given by places: a feature that is moved becomes one of the caller's, and one that is removed
/// is no longer listed. `present` are the map's. Returns which were set, too.
fn edit_pinned(
    registered: &Registered,
    wanted: &ConstraintEdit,
    present: &[Constraint],
    (example, one): (&Side, &Chart),
    (query, two): (&Side, &Chart),
) -> Result<(Registered, Vec<usize>), PipelineError> {
    let (mut pinned, mut removed) = (registered.pinned.clone(), registered.removed.clone());
    let feature = |id: &str| present.iter().find(|c| c.id == id && c.origin == ConstraintOrigin::Feature);
    let bvhs = (OnceLock::new(), OnceLock::new());
    let find = |pinned: &[(String, (Location, Location))], id: &str| -> Result<usize, PipelineError> {
        pinned.iter().position(|(name, _)| name == id).ok_or_else(|| {
            let detail = format!("expected a constraint of this map, found `{}`, which is none", id.escape_default());
            PipelineError::refused(Refusal::ConstraintUnknown, detail)
        })
    };
    // A feature that nobody moved is as it was.
    let unpin = |pinned: &mut Vec<(String, (Location, Location))>, id: &str| match find(pinned, id) {
        Ok(k) => {
            pinned.remove(k);
            Ok(())
        }
        Err(error) => feature(id).map(|_| ()).ok_or(error),
    };
    // To undo what was set is to remove it.
    for id in &wanted.undo {
        if let Some(k) = removed.iter().position(|name| name == id) {
            removed.remove(k);
            continue;
        }
        unpin(&mut pinned, id)?;
    }
    let names = registered.named();
    for id in &wanted.remove {
        unpin(&mut pinned, id)?;
        if names.iter().any(|(name, _)| name == id) && !removed.contains(id) {
            removed.push(id.clone());
        }
    }
    let mut touched = Vec::new();
    for new in &wanted.set {
        let moved = new.id.as_deref().filter(|id| pinned.iter().all(|p| p.0 != *id)).and_then(feature);
        if let Some(moved) = moved {
            let at = |place: &super::constraint::LocatedPoint| Place::Point(place.point);
            let from = locate(&at(&moved.on_example), example, one, &bvhs.0, "on_example")?;
            pinned.push((moved.id.clone(), (from, locate(&at(&moved.on_input), query, two, &bvhs.1, "on_input")?)));
        }
        let index = new.id.as_ref().map(|id| find(&pinned, id)).transpose()?;
        let old = index.and_then(|k| pinned.get(k)).map(|p| p.1);
        let on_example = match &new.on_example {
            Some(place) => locate(place, example, one, &bvhs.0, "on_example")?,
            None => old.map(|o| o.0).ok_or_else(|| missing("on_example"))?,
        };
        let on_input = match &new.on_input {
            Some(place) => locate(place, query, two, &bvhs.1, "on_input")?,
            None => old.map(|o| o.1).ok_or_else(|| missing("on_input"))?,
        };
        match index {
            Some(k) => pinned[k].1 = (on_example, on_input),
            None => {
                let names: Vec<(String, ConstraintOrigin)> =
                    pinned.iter().map(|p| (p.0.clone(), ConstraintOrigin::User)).collect();
                pinned.push((free_name(&names), (on_example, on_input)));
            }
        }
        touched.push(index.unwrap_or(pinned.len() - 1));
    }
    Ok((Registered { pinned, removed, ..registered.clone() }, touched))
}

/// Of the constraints that were set, the one nearest to the fold is named; else the nearest of all.
fn folds(
    error: &EditError,
    registration: &crate::register::Registration,
    topology: Topology,
    names: &[(String, ConstraintOrigin)],
    touched: &[usize],
) -> PipelineError {
    let all: Vec<usize> = (0..names.len()).collect();
    let (of, why) = if touched.is_empty() { (&all[..], "nearest constraint") } else { (touched, "constraint") };
    let which = match error {
        EditError::Folds { at, .. } => {
            let apart = |i: usize| distance_on(topology, registration.p[i], *at);
            of.iter().copied().min_by(|&a, &b| apart(a).total_cmp(&apart(b)))
        }
        _ => of.first().copied(),
    };
    let name = which.and_then(|i| names.get(i)).map_or("none", |n| n.0.as_str());
    PipelineError::refused(Refusal::ConstraintFolds, format!("{why} {name}: {error}"))
}

fn position(names: &[(String, ConstraintOrigin)], id: &str) -> Result<usize, PipelineError> {
    names.iter().position(|(name, _)| name == id).ok_or_else(|| {
        let known: Vec<&str> = names.iter().map(|n| n.0.as_str()).collect();
        PipelineError::refused(
            Refusal::ConstraintUnknown,
            format!("expected the id of a constraint ({}), found `{}`", known.join(", "), id.escape_default()),
        )
    })
}

/// `c1`, `c2`, …: the first that is free.
fn free_name(names: &[(String, ConstraintOrigin)]) -> String {
    let mut k = 1;
    while names.iter().any(|(name, _)| *name == format!("c{k}")) {
        k += 1;
    }
    format!("c{k}")
}

/// The two surfaces on which a constraint's ends lie.
struct Ends<'a> {
    example: &'a Side,
    query: &'a Side,
    example_chart: &'a Chart,
    input_chart: &'a Chart,
    /// Their trees of boxes, once made.
    bvhs: (&'a OnceLock<Bvh>, &'a OnceLock<Bvh>),
}

impl Ends<'_> {
    fn on_example(&self, place: &Place) -> Result<[f64; 2], PipelineError> {
        resolve(place, self.example, self.example_chart, self.bvhs.0, "on_example")
    }

    fn on_input(&self, place: &Place) -> Result<[f64; 2], PipelineError> {
        resolve(place, self.query, self.input_chart, self.bvhs.1, "on_input")
    }
}

/// (u, v) of a place as the caller names it.
fn resolve(
    place: &Place,
    side: &Side,
    chart: &Chart,
    bvh: &OnceLock<Bvh>,
    end: &str,
) -> Result<[f64; 2], PipelineError> {
    if let Place::Domain { u, v } = place {
        check_domain(*u, *v, end)?;
        return Ok([u.rem_euclid(1.0), *v]);
    }
    Ok(locate(place, side, chart, bvh, end)?.uv(chart))
}

fn check_domain(u: f64, v: f64, end: &str) -> Result<(), PipelineError> {
    if u.is_finite() && (0.0..=1.0).contains(&v) {
        return Ok(());
    }
    let detail = format!("{end}: expected a finite u and v from 0 to 1, found ({u}, {v})");
    Err(PipelineError::refused(Refusal::ConstraintInvalid, detail))
}

/// The place of a chart's mesh that the caller names.
pub(crate) fn locate(
    place: &Place,
    side: &Side,
    chart: &Chart,
    bvh: &OnceLock<Bvh>,
    end: &str,
) -> Result<Location, PipelineError> {
    let invalid = |detail: String| PipelineError::refused(Refusal::ConstraintInvalid, format!("{end}: {detail}"));
    let point = match place {
        Place::Domain { u, v } => {
            check_domain(*u, *v, end)?;
            return Ok(PlanarIndex::new(chart).locate(chart, [*u, *v]));
        }
        Place::Point(point) => Vec3::from(*point),
        Place::OnVertex { vertex } => on_vertex(side, *vertex).map_err(invalid)?,
        Place::OnFace { face, barycentric } => on_face(side, *face, barycentric).map_err(invalid)?,
    };
    if !point.iter().all(|x| x.is_finite()) {
        return Err(invalid("expected finite coordinates, found one that is not".into()));
    }
    let own = &side.encoded.query;
    let found = match Arc::ptr_eq(&chart.mesh, &own.chart.mesh) {
        // Its tree is there already.
        true => own.tree().closest(point),
        false => bvh.get_or_init(|| Bvh::new(&chart.mesh)).closest(point),
    };
    if found.triangle == NONE {
        return Err(invalid("expected a point near the surface, found one beyond all range".into()));
    }
    Ok(found.into())
}

fn on_vertex(side: &Side, vertex: u32) -> Result<Vec3, String> {
    let positions = &side.model.mesh.positions;
    let expected = || format!("expected a vertex below {}, found {vertex}", positions.len());
    positions.get(vertex as usize).copied().ok_or_else(expected)
}

fn on_face(side: &Side, face: u32, weights: &[f64]) -> Result<Vec3, String> {
    let mesh = &side.model.mesh;
    if face as usize >= mesh.faces.len() {
        return Err(format!("expected a face below {}, found {face}", mesh.faces.len()));
    }
    let corners = mesh.faces.face(face as usize);
    let sum: f64 = weights.iter().sum();
    let fits = weights.len() == corners.len() && weights.iter().all(|w| *w >= 0.0) && (sum - 1.0).abs() < 1e-6;
    if !fits {
        let n = corners.len();
        return Err(format!("expected {n} weights (face {face} has {n} corners), none negative, their sum 1"));
    }
    Ok(corners.iter().zip(weights).map(|(&v, w)| mesh.positions[v as usize] * *w).sum())
}
