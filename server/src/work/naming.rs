//! Names of a query's segments: people give them to the parts of a scan, for all who look at it.
//!
//! They live with the query, are paid for as its memory is, and are kept beside what it was started with ([`super::kept`]),
//! so that they are there again where it is started again.

use super::query::LiveQuery;
use super::{Work, WorkError, texts};
use crate::pool::Admitted;
use quadmuse_proto::SegmentName;
use quadmuse_proto::query::{SEGMENT_NAME_LENGTH_MAX, SEGMENTS_NAMED_MAX};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What a name takes beside its text, in bytes, rounded up: its segment, and its share of the nodes that hold it.
const BESIDE_BYTES: u64 = 64;

/// The names of a query's segments.
#[derive(Default)]
pub struct Names(Mutex<GivenNames>);

/// The names that were given, by segment.
#[derive(Default)]
struct GivenNames {
    names: BTreeMap<u32, String>,
    /// Their memory; none is held for none.
    paid: Option<Admitted>,
}

impl Names {
    fn lock(&self) -> MutexGuard<'_, GivenNames> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The name of a segment, if it has one.
    pub fn of(&self, segment: u32) -> Option<String> {
        self.lock().names.get(&segment).cloned()
    }

    /// All of them, by segment.
    pub fn all(&self) -> BTreeMap<u32, String> {
        self.lock().names.clone()
    }

    /// What they are paid with, in bytes.
    pub fn bytes(&self) -> u64 {
        self.lock().paid.as_ref().map_or(0, Admitted::bytes)
    }
}

/// Gives segments of a query names, and takes off those that are empty: all of it or nothing.
///
/// # Errors
/// [`WorkError::Parameter`], [`WorkError::NoSuchSegment`]; refusals of the memory.
pub fn name(work: &Work, live: &LiveQuery, wanted: Vec<SegmentName>) -> Result<(), WorkError> {
    check(live, &wanted)?;
    let mut given = live.names.lock();
    let mut names = given.names.clone();
    for SegmentName { segment, name } in wanted {
        if name.is_empty() {
            names.remove(&segment);
        } else {
            names.insert(segment, name);
        }
    }
    if names.len() > SEGMENTS_NAMED_MAX {
        return Err(too_many(names.len()));
    }
    let bytes = names.values().map(|name| name.len() as u64 + BESIDE_BYTES).sum();
    let paid = if names.is_empty() { None } else { Some(work.hold(live.caller.user, bytes)?) };
    *given = GivenNames { names, paid };
    Ok(())
}

/// Gives the segments of a query that was started again the names that they had. Those of segments that are there no more,
/// as a newer service may cut otherwise, are left out; it goes on without any where they can't be given.
pub fn name_again(work: &Work, live: &LiveQuery, names: BTreeMap<u32, String>) {
    let there = names.into_iter().filter(|(segment, _)| live.check_segment(*segment).is_ok());
    let there = there.map(|(segment, name)| SegmentName { segment, name }).collect();
    if let Err(error) = name(work, live, there) {
        tracing::warn!(%error, query = %live.id, "started again without the names of its segments");
    }
}

fn check(live: &LiveQuery, wanted: &[SegmentName]) -> Result<(), WorkError> {
    if wanted.len() > SEGMENTS_NAMED_MAX {
        return Err(too_many(wanted.len()));
    }
    let mut segments = BTreeSet::new();
    for SegmentName { segment, name } in wanted {
        live.check_segment(*segment)?;
        if !segments.insert(segment) {
            return Err(invalid("with each segment once", format!("{segment} twice")));
        }
        let length = name.chars().count();
        if length > SEGMENT_NAME_LENGTH_MAX {
            let expected = format!("with names of at most {SEGMENT_NAME_LENGTH_MAX} characters");
            return Err(invalid(expected, format!("{length} characters")));
        }
        if !name.is_empty() && name.trim().is_empty() {
            return Err(invalid("with names that are empty, or not only blanks", "one of blanks"));
        }
        if let Some(found) = texts::unprintable(name) {
            return Err(invalid(format!("with names {}", texts::EXPECTED), found));
        }
    }
    Ok(())
}

fn too_many(found: usize) -> WorkError {
    invalid(format!("of at most {SEGMENTS_NAMED_MAX} segments with names"), found)
}

fn invalid(expected: impl Into<String>, found: impl ToString) -> WorkError {
    WorkError::parameter("segments", expected, found)
}
