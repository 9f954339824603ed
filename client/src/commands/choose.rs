//! Choosing the example, and its segment, that a query's segment takes.

use super::gauge::Gauge;
use crate::{
    api::{Api, RankingView},
    error::ClientError,
    follow,
    spec::ExampleRef,
    ui::Ui,
};
use quadmuse_proto::ranking::Entry;
use quadmuse_proto::{Example, ExampleId, NewMap, Query, QueryId, QuerySegment, Ranking, Topology};

/// The query, once its ranking is final.
pub(super) async fn finished(id: QueryId, api: &Api, ui: &mut Ui) -> Result<Query, ClientError> {
    let query = api.query(id).await?;
    let spinner = ui.spinner("waiting for the ranking");
    let end = follow::poll(api, query, &mut Gauge::new(spinner.clone(), "waiting for the ranking", None)).await;
    spinner.finish_and_clear();
    let end = end?;
    follow::conclude(&end)?;
    Ok(end.summary)
}

/// What to lay on a segment.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Choice {
    /// As it goes over the wire.
    pub(super) new: NewMap,
    /// The example's name, or its id where it has none.
    pub(super) name: String,
}

impl Choice {
    fn new(new: NewMap, name: &str) -> Self {
        let name = if name.is_empty() { new.example.to_string() } else { name.to_owned() };
        Self { new, name }
    }

    /// Of an entry of a segment's ranking.
    fn of(entry: &Entry, segment: u32) -> Self {
        let new = NewMap { segment, example: entry.example, example_segment: entry.example_segment, ..unchosen() };
        Self::new(new, &entry.name)
    }
}

/// The options that a choice leaves as they are.
fn unchosen() -> NewMap {
    NewMap::new(0, ExampleId::TEMPLATE, 0)
}

/// What to lay on a segment: the example that is told, or else the best entry of the ranking.
pub(super) async fn choose(
    query: &Query,
    segment: &QuerySegment,
    wanted: Option<ExampleRef>,
    api: &Api,
) -> Result<Choice, ClientError> {
    let number = segment.segment;
    if let Some(ExampleRef { example, segment: Some(example_segment) }) = wanted {
        return Ok(Choice::new(NewMap { segment: number, example, example_segment, ..unchosen() }, ""));
    }
    let ranking = api.ranking(query.id, RankingView { segment: number, after: None, wait_ms: 0 }).await?;
    if let Some(new) = best(&ranking, number, wanted) {
        return Ok(new);
    }
    match wanted {
        // The example may stand below the entries that are shown.
        Some(wanted) => {
            let is_alone = query.segments.len() == 1;
            fitting(&api.example(wanted.example).await?, number, (segment.topology, is_alone))
        }
        None => Err(ClientError::NothingRanked { segment: number, topology: segment.topology.to_string() }),
    }
}

/// The best entry of the ranking, or the best of the example that is told.
fn best(ranking: &Ranking, segment: u32, wanted: Option<ExampleRef>) -> Option<Choice> {
    let entry = ranking.entries.iter().find(|entry| wanted.is_none_or(|wanted| wanted.example == entry.example))?;
    Some(Choice::of(entry, segment))
}

/// The first segment of the example that has the topology, or that can be laid on a part of the input; a part of what is there
/// whole, too, only at last. `is_alone`: whether the segment is all of the scan.
fn fitting(example: &Example, segment: u32, (topology, is_alone): (Topology, bool)) -> Result<Choice, ClientError> {
    // Of a disc and a closed surface one may lie on a part of the other, and either on all of a scan that was cut at two places.
    let is_cut = is_alone && topology == Topology::Annulus;
    let (parts, wholes): (Vec<_>, Vec<_>) = example.segments.iter().partition(|segment| segment.is_part);
    let same = wholes.iter().find(|candidate| candidate.topology == topology);
    let found = same.or_else(|| wholes.iter().find(|c| c.topology.has_caps() && (is_cut || topology.has_caps())));
    let found = found.or_else(|| parts.iter().find(|candidate| candidate.topology == topology));
    let Some(found) = found else {
        let article = if topology == Topology::Annulus { "an" } else { "a" };
        let (example, topology) = (example.id.to_string(), topology.to_string());
        return Err(ClientError::TopologyDiffers { example, topology, article });
    };
    Ok(Choice::new(
        NewMap { segment, example: example.id, example_segment: found.segment, ..unchosen() },
        &example.name,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::{head, with_entries};

    #[test]
    fn the_best_entry_is_taken_unless_an_example_is_told() {
        let ranking = with_entries(3);
        let first = best(&ranking, 0, None).expect("an entry");
        assert_eq!((first.new.example, first.new.example_segment), (ranking.entries[0].example, 0));
        let wanted = ExampleRef { example: ranking.entries[2].example, segment: None };
        let third = best(&ranking, 0, Some(wanted)).expect("an entry");
        assert_eq!((third.new.example, third.new.example_segment), (wanted.example, 2));
        assert_eq!(best(&with_entries(0), 0, None), None);
    }

    #[test]
    fn an_example_below_the_ranking_is_taken_by_its_topology() {
        let annulus = fitting(&head(), 4, (Topology::Annulus, false)).expect("it has one");
        assert_eq!((annulus.new.segment, annulus.new.example_segment), (4, 1));
        let cap = fitting(&head(), 4, (Topology::Sphere, false)).expect("a disc may lie on a part of it");
        assert_eq!((cap.new.segment, cap.new.example_segment), (4, 0));
        let mut animal = head();
        animal.segments[0].topology = Topology::Sphere;
        animal.segments[1..].iter_mut().for_each(|segment| segment.is_part = true);
        let chosen = |topology| fitting(&animal, 0, (topology, false)).expect("it can be laid").new.example_segment;
        assert_eq!([Topology::Sphere, Topology::Disc, Topology::Annulus].map(chosen), [0, 0, 1]);
        let whole = fitting(&animal, 0, (Topology::Annulus, true)).expect("a whole animal on what was cut");
        assert_eq!(whole.new.example_segment, 0);
        let error = fitting(&head(), 4, (Topology::Torus, true)).expect_err("it has none");
        assert!(error.to_string().contains("a torus"), "{error}");
    }
}
