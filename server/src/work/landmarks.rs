//! Named landmarks: points of an example's surface that are found again on a scan by their names.

use super::engine::Model;
use super::ingest::model;
use super::{REQUEST_TIME_MAX, Work, WorkError, texts};
use crate::pool::{Lane, User};
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{NONE, Vec3, prepare};
use quadmuse_proto::constraint::{LANDMARKS_MAX, Place};
use quadmuse_proto::example::{LANDMARK_NAME_LENGTH_MAX, NAMED_MAX};
use quadmuse_proto::{Example, ExampleId, Landmark, NamedPoint, NewMap};
use std::collections::HashSet;
use std::sync::Arc;

/// Names that a message tells before it breaks off.
const NAMES_LISTED: usize = 12;

/// The landmarks of an example as they are kept: each with its point on the surface.
///
/// # Errors
/// [`WorkError::Parameter`] where one has no name of its own, or no place; refusals of the corpus and of the pool.
pub async fn placed(
    work: &Arc<Work>,
    user: User,
    id: ExampleId,
    wanted: Vec<NamedPoint>,
) -> Result<Vec<NamedPoint>, WorkError> {
    let example = work.catalogue.example(id)?;
    check_names(&wanted)?;
    if wanted.is_empty() {
        return Ok(wanted);
    }
    let job = work.admit(user, work.engine.memory_estimate(example.bytes), REQUEST_TIME_MAX)?;
    let model = model(work, &job, Lane::Edit, &example).await?;
    work.pool.run(&job, Lane::Edit, move |_| on_surface(&model, wanted)).await?
}

fn check_names(wanted: &[NamedPoint]) -> Result<(), WorkError> {
    if wanted.len() > NAMED_MAX {
        return Err(invalid(format!("of at most {NAMED_MAX} points"), format!("{}", wanted.len())));
    }
    let mut names = HashSet::new();
    for NamedPoint { name, .. } in wanted {
        if name.trim().is_empty() || name.len() > LANDMARK_NAME_LENGTH_MAX {
            let expected = format!("with names of 1 to {LANDMARK_NAME_LENGTH_MAX} bytes, not only blanks");
            return Err(invalid(expected, format!("one of {} bytes", name.len())));
        }
        if let Some(found) = texts::unprintable(name) {
            return Err(invalid(format!("with names {}", texts::EXPECTED), found));
        }
        if !names.insert(name.as_str()) {
            return Err(invalid("with each name once".into(), format!("`{name}` twice")));
        }
    }
    Ok(())
}

fn on_surface(model: &Model, mut wanted: Vec<NamedPoint>) -> Result<Vec<NamedPoint>, WorkError> {
    let positions = &model.mesh.positions;
    let mut tree = None;
    for NamedPoint { name, vertex, point } in &mut wanted {
        let found = match (*vertex, *point) {
            (Some(vertex), _) => *positions.get(vertex as usize).ok_or_else(|| {
                invalid(format!("with a vertex below {} at `{name}`", positions.len()), vertex.to_string())
            })?,
            (None, Some(point)) => {
                let tree = match &mut tree {
                    Some(tree) => tree,
                    none => none.insert(surface(model)?),
                };
                let found =
                    Some(point).filter(|p| p.iter().all(|x| x.is_finite())).map(|p| tree.closest(Vec3::from(p)));
                let found = found.filter(|found| found.triangle != NONE);
                found.ok_or_else(|| invalid(format!("with a point near the surface at `{name}`"), "none".into()))?.point
            }
            (None, None) => {
                return Err(invalid(format!("with a vertex or a point at `{name}`"), "neither".into()));
            }
        };
        *point = Some(found.into());
    }
    Ok(wanted)
}

fn surface(model: &Model) -> Result<Bvh, WorkError> {
    let prepared = prepare(&model.mesh).map_err(|error| {
        // It was read before, and so it is not the caller's fault.
        tracing::warn!(%error, "an example that was read before has no surface");
        invalid("with vertices, as its surface can't be searched".into(), "a point".into())
    })?;
    Ok(Bvh::new(&prepared.mesh))
}

fn invalid(expected: String, found: String) -> WorkError {
    WorkError::parameter("landmarks", expected, found)
}

/// Checks what a new map is to be held by.
///
/// # Errors
/// [`WorkError::Parameter`].
pub fn check(wanted: &NewMap) -> Result<(), WorkError> {
    for (name, count, most) in
        [("landmarks", wanted.landmarks.len(), LANDMARKS_MAX), ("names", wanted.names.len(), NAMED_MAX)]
    {
        if count > most {
            return Err(WorkError::parameter(name, format!("at most {most}"), count));
        }
        if count > 0 && wanted.example == ExampleId::TEMPLATE {
            let expected = "none with a regular layout, which has no points of its own";
            return Err(WorkError::parameter(name, expected, count));
        }
    }
    Ok(())
}

/// The landmarks that a new map is held by: those that are given, and those whose names the example has, too. Of too many
/// those are taken that lie farthest apart on the example.
///
/// # Errors
/// [`WorkError::Parameter`] where names are all that is given, and the example has none of them.
pub fn held(example: &Example, wanted: &NewMap) -> Result<Vec<Landmark>, WorkError> {
    let mut held = wanted.landmarks.clone();
    let known = |name: &str| example.landmarks.iter().find(|own| own.name == name)?.point;
    let named: Vec<([f64; 3], Landmark)> = wanted
        .names
        .iter()
        .filter_map(|(name, place)| {
            let point = known(name)?;
            let (on_example, on_input) = (Place::Point(point), place.clone());
            Some((point, Landmark { on_example, on_input, name: Some(name.clone()) }))
        })
        .collect();
    if named.is_empty() && held.is_empty() && !wanted.names.is_empty() {
        let expected = match example.landmarks.is_empty() {
            true => "of landmarks of the example, which has none; name some with PATCH on the example".into(),
            false => {
                format!("of landmarks of the example ({})", listed(example.landmarks.iter().map(|l| l.name.as_str())))
            }
        };
        let found = listed(wanted.names.keys().map(String::as_str));
        return Err(WorkError::parameter("names", expected, found));
    }
    let room = LANDMARKS_MAX.saturating_sub(held.len());
    let points: Vec<[f64; 3]> = named.iter().map(|(point, _)| *point).collect();
    let chosen: HashSet<usize> = spread(&points, room).into_iter().collect();
    held.extend(named.into_iter().enumerate().filter(|(k, _)| chosen.contains(k)).map(|(_, (_, landmark))| landmark));
    Ok(held)
}

/// Calls landmarks by their names in what is said of a map, where they have some: it is said by their numbers, from 1.
pub fn called(reasons: Vec<String>, held: &[Landmark]) -> Vec<String> {
    let call = |reason: String| {
        let rest = reason.strip_prefix("landmark ")?;
        let (number, rest) = rest.split_once(' ')?;
        let landmark = held.get(number.parse::<usize>().ok()?.checked_sub(1)?)?;
        Some(format!("landmark `{}` {rest}", landmark.name.as_ref()?))
    };
    reasons.into_iter().map(|reason| call(reason.clone()).unwrap_or(reason)).collect()
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.take(NAMES_LISTED + 1).collect();
    match names.get(..NAMES_LISTED) {
        Some(first) if names.len() > NAMES_LISTED => format!("{}, …", first.join(", ")),
        _ => names.join(", "),
    }
}

/// At most `most` of the points, far from each other: the one farthest from the middle of all, then always that which is
/// farthest from those taken.
fn spread(points: &[[f64; 3]], most: usize) -> Vec<usize> {
    if points.len() <= most {
        return (0..points.len()).collect();
    }
    let all: Vec<Vec3> = points.iter().map(|p| Vec3::from(*p)).collect();
    let middle = all.iter().sum::<Vec3>() / all.len() as f64;
    let mut apart: Vec<f64> = all.iter().map(|p| (p - middle).norm()).collect();
    let mut taken = Vec::with_capacity(most);
    while taken.len() < most {
        let Some(next) = (0..all.len()).max_by(|&a, &b| apart[a].total_cmp(&apart[b]).then(b.cmp(&a))) else { break };
        if taken.is_empty() {
            apart.fill(f64::INFINITY);
        }
        taken.push(next);
        for (to, point) in apart.iter_mut().zip(&all) {
            *to = to.min((point - all[next]).norm());
        }
        // Of several at one place only one is taken as long as there are others.
        apart[next] = -1.0;
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_points_those_far_apart_are_taken() {
        let points: Vec<[f64; 3]> = (0..101).map(|k| [f64::from(k), 0.0, 0.0]).collect();
        let mut taken = spread(&points, 3);
        taken.sort_unstable();
        assert_eq!(taken, [0, 50, 100]);
        assert_eq!(spread(&points[..2], 3), [0, 1]);
        let same = vec![[1.0; 3]; 5];
        let mut taken = spread(&same, 4);
        taken.sort_unstable();
        taken.dedup();
        assert_eq!(taken.len(), 4, "each but once");
        assert!(spread(&points, 0).is_empty());
    }

    #[test]
    fn a_landmark_with_a_name_is_called_by_it() {
        let place = Place::Point([0.0; 3]);
        let held = |name: Option<&str>| Landmark {
            on_example: place.clone(),
            on_input: place.clone(),
            name: name.map(str::to_owned),
        };
        let said = ["landmark 2 is met but for 1 %", "landmark 1 is met", "landmark 9 is met", "landmark", "a spike"];
        let called = called(said.map(str::to_owned).into(), &[held(None), held(Some("chin"))]);
        assert_eq!(called[0], "landmark `chin` is met but for 1 %");
        assert_eq!(called[1..], said[1..]);
    }

    #[test]
    fn long_lists_of_names_break_off() {
        let names: Vec<String> = (0..20).map(|k| format!("n{k}")).collect();
        assert!(listed(names.iter().map(String::as_str)).ends_with("n11, …"));
        assert_eq!(listed(["a", "b"].into_iter()), "a, b");
    }
}
