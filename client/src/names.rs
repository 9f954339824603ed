//! Names on the command line stand for ids. A name is the id itself, the beginning of one, an example's name, or `@last`.
//!
//! The service takes ids only; names are looked up in its lists. What an id may be is not looked up.

use crate::{
    api::{Api, ExampleFilter},
    error::ClientError,
    spec::{ExampleRef, Name, SegmentRef, UsePart},
    state::State,
};
use quadmuse_proto::{ExampleId, MapId, QueryId, QuerySegment};
use std::fmt::Display;

/// The word for the last query that was started.
pub const LAST: &str = "@last";

/// Candidates that are listed where a name is ambiguous.
const CANDIDATES_LISTED: usize = 8;

/// Something that a text may stand for.
struct Thing<I> {
    id: I,
    /// Empty where it has none.
    name: String,
}

/// The example that a text stands for.
///
/// # Errors
/// [`ClientError::NoSuchName`], [`ClientError::Ambiguous`]; the service refuses or is out of reach.
pub async fn example(name: &Name, api: &Api) -> Result<ExampleId, ClientError> {
    if let Ok(id) = name.0.parse() {
        return Ok(id);
    }
    let all = api.examples(&ExampleFilter::default()).await?;
    one("example", &name.0, all.into_iter().map(|example| Thing { id: example.id, name: example.name }).collect())
}

/// The example, and its segment, that a text stands for.
///
/// # Errors
/// As [`example`].
pub async fn example_ref(given: &ExampleRef<Name>, api: &Api) -> Result<ExampleRef, ClientError> {
    Ok(ExampleRef { example: example(&given.example, api).await?, segment: given.segment })
}

/// The examples that segments are to take; `segments`: those of the query.
///
/// # Errors
/// As [`example`].
pub async fn uses(
    parts: &[UsePart<Name, SegmentRef>],
    segments: &[QuerySegment],
    api: &Api,
) -> Result<Vec<UsePart>, ClientError> {
    let mut all = Vec::with_capacity(parts.len());
    for part in parts {
        let segment = segment(&part.segment, segments)?;
        all.push(UsePart { segment, example: example_ref(&part.example, api).await? });
    }
    Ok(all)
}

/// The query that a text stands for.
///
/// # Errors
/// As [`example`]; [`ClientError::NoLastQuery`].
pub async fn query(name: &Name, api: &Api, state: &State) -> Result<QueryId, ClientError> {
    if name.0 == LAST {
        return state.last_query(api.server()).ok_or_else(|| ClientError::NoLastQuery { server: api.server().into() });
    }
    if let Ok(id) = name.0.parse() {
        return Ok(id);
    }
    let all = api.queries().await?;
    one("query", &name.0, all.into_iter().map(|query| Thing { id: query.id, name: String::new() }).collect())
}

/// The number of the segment that a text stands for. A number is taken at its word: the service knows whether there is such
/// a segment.
///
/// # Errors
/// As [`example`].
pub fn segment(given: &SegmentRef, segments: &[QuerySegment]) -> Result<u32, ClientError> {
    match given {
        SegmentRef::Number(number) => Ok(*number),
        SegmentRef::Named(found) => {
            let thing = |s: &QuerySegment| Some(Thing { id: s.segment, name: s.name.clone()? });
            one("segment", found, segments.iter().filter_map(thing).collect())
        }
    }
}

/// The map of a query that a text stands for.
///
/// # Errors
/// As [`example`].
pub async fn map(query: QueryId, name: &Name, api: &Api) -> Result<MapId, ClientError> {
    if let Ok(id) = name.0.parse() {
        return Ok(id);
    }
    let all = api.maps(query).await?;
    one("map", &name.0, all.into_iter().map(|map| Thing { id: map.id, name: String::new() }).collect())
}

/// The one thing that has this name, or else whose name or id alone begins so.
fn one<I: Copy + Display>(kind: &'static str, found: &str, all: Vec<Thing<I>>) -> Result<I, ClientError> {
    // Ids are written in capitals.
    let upper = found.to_uppercase();
    let named: Vec<&Thing<I>> = all.iter().filter(|thing| thing.name == found).collect();
    let begins = |thing: &&Thing<I>| {
        (!thing.name.is_empty() && thing.name.starts_with(found)) || thing.id.to_string().starts_with(&upper)
    };
    let candidates = if named.is_empty() { all.iter().filter(begins).collect() } else { named };
    match candidates[..] {
        [] => Err(ClientError::NoSuchName { kind, found: found.into() }),
        [one] => Ok(one.id),
        _ => {
            let listed = candidates.iter().take(CANDIDATES_LISTED).map(|thing| match thing.name.as_str() {
                "" => thing.id.to_string(),
                name => format!("{} ({name})", thing.id),
            });
            let more = candidates.len().saturating_sub(CANDIDATES_LISTED);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let candidates = format!("{}{more}", listed.collect::<Vec<_>>().join(", "));
            Err(ClientError::Ambiguous { kind, found: found.into(), candidates })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn things(names: &[(u8, &str)]) -> Vec<Thing<ExampleId>> {
        names.iter().map(|&(k, name)| Thing { id: ExampleId::from_bytes([k; 16]), name: name.into() }).collect()
    }

    #[test]
    fn a_whole_name_goes_before_beginnings() {
        let all = || things(&[(1, "head"), (2, "head old"), (3, "hand")]);
        assert_eq!(one("example", "head", all()).expect("the first"), ExampleId::from_bytes([1; 16]));
        assert_eq!(one("example", "ha", all()).expect("the third"), ExampleId::from_bytes([3; 16]));
        let id = ExampleId::from_bytes([2; 16]).to_string();
        assert_eq!(one("example", &id[..9].to_lowercase(), all()).expect("the second").to_string(), id);
    }

    #[test]
    fn what_is_not_clear_names_its_candidates() {
        let error = one("example", "he", things(&[(1, "head"), (2, "heel"), (3, "hand")])).expect_err("two");
        let said = error.to_string();
        assert!(matches!(error, ClientError::Ambiguous { .. }), "{said}");
        assert!(said.contains("(head), ") && said.contains("(heel)") && !said.contains("hand"), "{said}");
        // Two of one name are told by their ids.
        let error = one("example", "head", things(&[(1, "head"), (2, "head")])).expect_err("two");
        assert!(matches!(error, ClientError::Ambiguous { .. }), "{error}");
        let many: Vec<(u8, &str)> = (1..=20).map(|k| (k, "head")).collect();
        assert!(one("example", "head", things(&many)).expect_err("many").to_string().contains("and 12 more"));
    }

    #[test]
    fn a_segment_goes_by_its_number_or_its_name() {
        let named = |segment, name: Option<&str>| QuerySegment { name: name.map(str::to_owned), ..bare(segment) };
        let all = [named(0, Some("arm")), named(1, None), named(2, Some("leg left")), named(3, Some("leg right"))];
        let find = |text: &str| segment(&text.parse().expect(text), &all);
        assert_eq!([find("1").ok(), find("9").ok(), find("arm").ok(), find("leg l").ok()], [1, 9, 0, 2].map(Some));
        let said = find("leg").expect_err("two").to_string();
        assert!(said.contains("2 (leg left), 3 (leg right); give its number"), "{said}");
        let said = find("foot").expect_err("none").to_string();
        assert!(said.contains("the number or the name of a segment, found `foot`, which none has"), "{said}");
    }

    fn bare(segment: u32) -> QuerySegment {
        QuerySegment { segment, ..crate::table::tests::query(1).segments.remove(0) }
    }

    #[test]
    fn what_is_not_there_is_refused() {
        let error = one("example", "foot", things(&[(1, ""), (2, "head")])).expect_err("none");
        assert!(matches!(error, ClientError::NoSuchName { .. }), "{error}");
    }
}
