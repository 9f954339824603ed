//! `query` and `ranking`: uploads a mesh, and shows its ranking as it is refined.

use crate::{
    api::{Api, RankingView},
    args::{QueryArgs, QueryCommand, RankingArgs},
    error::ClientError,
    follow::{self, Watcher},
    table,
    ui::Ui,
};
use quadmuse_proto::{End, EndState, Event, Query, Ranking};

pub(super) async fn query(args: &QueryCommand, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let query = upload(&args.query, api, ui).await?;
    if args.no_follow {
        ui.value(&query)?;
        ui.note(&format!("ranking goes on; see it with `quadmuse ranking {} --follow`", query.id));
    } else {
        follow_upload(&query, api, ui).await?;
    }
    ui.text(&query.id.to_string())
}

/// Uploads a mesh, and tells what was repaired in it.
pub(super) async fn upload(args: &QueryArgs, api: &Api, ui: &mut Ui) -> Result<Query, ClientError> {
    let spinner = ui.spinner("uploading");
    let query = api.start_query(args).await;
    spinner.finish_and_clear();
    let query = query?;
    for repair in &query.repairs {
        ui.note(&format!("{}: {repair}", args.file.display()));
    }
    Ok(query)
}

/// Shows the rankings of a query until they are final.
pub(super) async fn follow_upload(query: &Query, api: &Api, ui: &mut Ui) -> Result<End, ClientError> {
    let mut screen = Screen::new(query.clone(), None, ui);
    let end = follow::poll(api, query.clone(), &mut screen).await?;
    ui.settle();
    follow::conclude(&end)?;
    tell_end(&end, ui);
    Ok(end)
}

fn tell_end(end: &End, ui: &mut Ui) {
    let timings = &end.summary.timings;
    if end.state == EndState::Deadline {
        ui.note("the deadline came before the last level; this is the best ranking so far");
    }
    if let Some(first_ms) = timings.first_ranking_ms {
        let (first, all) = (first_ms / 1000.0, timings.total_ms / 1000.0);
        ui.note(&format!("first ranking after {first:.2} s, the last after {all:.2} s"));
    }
}

pub(super) async fn ranking(args: &RankingArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let query = api.query(args.query).await?;
    check_segment(&query, args.segment)?;
    if args.follow {
        let mut screen = Screen::new(query.clone(), args.segment, ui);
        let end = follow::stream(api, query.id, &mut screen).await?;
        ui.settle();
        follow::conclude(&end)?;
        tell_end(&end, ui);
        return Ok(());
    }
    if let Some(problem) = query.problem {
        return Err(ClientError::Refused(Box::new(problem)));
    }
    let segments = query.segments.iter().map(|segment| segment.segment);
    for segment in segments.filter(|&segment| args.segment.is_none_or(|only| only == segment)) {
        let ranking = api.ranking(query.id, RankingView { segment, after: None, wait_ms: 0 }).await?;
        ui.value(&ranking)?;
        ui.text(&table::ranking(&ranking, ui.room()))?;
    }
    Ok(())
}

/// Sees to it that a query has the segment asked for.
pub(super) fn check_segment(query: &Query, segment: Option<u32>) -> Result<(), ClientError> {
    match segment {
        Some(segment) if !query.segments.iter().any(|s| s.segment == segment) && !query.segments.is_empty() => {
            Err(ClientError::NoSuchSegment { query: query.id.to_string(), segment, segments: query.segments.len() })
        }
        _ => Ok(()),
    }
}

/// Prints the events of a query: a table that is drawn over, or one below the other; or the events themselves.
struct Screen<'a> {
    query: Query,
    only: Option<u32>,
    rankings: Vec<Option<Ranking>>,
    ui: &'a mut Ui,
}

impl<'a> Screen<'a> {
    fn new(query: Query, only: Option<u32>, ui: &'a mut Ui) -> Self {
        Self { query, only, rankings: Vec::new(), ui }
    }

    fn show(&mut self, ranking: &Ranking) -> Result<(), ClientError> {
        let room = self.ui.room();
        if !self.ui.is_live() || self.query.segments.len() <= 1 || self.only.is_some() {
            return self.ui.draw(&table::ranking(ranking, room));
        }
        let index = ranking.segment as usize;
        self.rankings.resize(self.query.segments.len(), None);
        if let Some(place) = self.rankings.get_mut(index) {
            *place = Some(ranking.clone());
        }
        self.ui.draw(&table::summary(&self.query, &self.rankings, room))
    }
}

impl Watcher for Screen<'_> {
    fn see(&mut self, event: &Event) -> Result<(), ClientError> {
        match event {
            Event::Level(ranking) if self.only.is_some_and(|only| only != ranking.segment) => return Ok(()),
            Event::Level(ranking) => self.show(ranking)?,
            Event::Begin(_) | Event::End(_) | Event::Error(_) => {}
        }
        self.ui.value(event)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        table::tests::{query, with_entries},
        ui::{Audience, Room, tests::Shared},
    };

    #[test]
    fn several_segments_share_one_table_on_a_terminal() {
        let out = Shared::default();
        let mut ui = Ui::new(Audience::People, Some(Room::default()), out.clone(), std::io::sink());
        let mut screen = Screen::new(query(3), None, &mut ui);
        let mut second = with_entries(2);
        second.segment = 2;
        screen.see(&Event::Level(with_entries(1))).expect("prints");
        screen.see(&Event::Level(second)).expect("prints");
        let last = out.text();
        let last = last.rsplit("\x1b[0J").next().expect("some text");
        assert_eq!(last.matches("head 1").count(), 2, "{last}");
    }

    #[test]
    fn only_the_segment_asked_for_is_shown() {
        let out = Shared::default();
        let mut ui = Ui::new(Audience::Programs, None, out.clone(), std::io::sink());
        let mut screen = Screen::new(query(3), Some(1), &mut ui);
        screen.see(&Event::Level(with_entries(1))).expect("prints");
        assert_eq!(out.text(), "");
        let mut wanted = with_entries(1);
        wanted.segment = 1;
        screen.see(&Event::Level(wanted)).expect("prints");
        assert_eq!(out.text().lines().count(), 1);
    }
}
