//! What is shown of a query while it is ranked.

use crate::{error::ClientError, follow::Watcher, table, ui::Ui};
use quadmuse_proto::{Event, Query, QueryState, Ranking};

/// What a command is run for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// The ranking.
    Ranking,
    /// What is made of its best entries.
    Outcome,
}

/// Prints the events of a query.
///
/// On a terminal a table is drawn over: the ranking of a segment if that alone is wanted, else a line a segment. Elsewhere
/// who wants the ranking gets a line a revision, and at the end the first entries of each segment; who wants the outcome
/// gets nothing here. Programs get the events themselves.
pub(super) struct Screen<'a> {
    query: Query,
    only: Option<u32>,
    wanted: Wanted,
    rankings: Vec<Option<Ranking>>,
    ui: &'a mut Ui,
}

impl<'a> Screen<'a> {
    pub(super) fn new(query: Query, only: Option<u32>, wanted: Wanted, ui: &'a mut Ui) -> Self {
        let rankings = vec![None; query.segments.len()];
        Self { query, only, wanted, rankings, ui }
    }

    /// Shows a revision.
    fn show(&mut self, ranking: &Ranking) -> Result<(), ClientError> {
        let place = self.rankings.get_mut(ranking.segment as usize);
        let before = place.and_then(|place| place.replace(ranking.clone()));
        let room = self.ui.room();
        let is_one = self.query.segments.len() <= 1 || self.only.is_some();
        match (self.ui.is_live(), self.wanted) {
            (true, Wanted::Ranking) if is_one => self.ui.draw(&table::ranking(ranking, room)),
            (true, _) => self.ui.draw(&table::summary(&self.query, &self.rankings, room)),
            (false, Wanted::Ranking) => {
                let line = table::revision(ranking);
                // A revision may differ in entries that its line does not tell.
                if before.is_some_and(|before| table::revision(&before) == line) {
                    return Ok(());
                }
                self.ui.text(&line)
            }
            (false, Wanted::Outcome) => Ok(()),
        }
    }

    /// Shows what it came to. The last revision of a ranking was told while the query still ranked.
    fn show_last(&mut self, state: QueryState) -> Result<(), ClientError> {
        for ranking in self.rankings.iter_mut().flatten() {
            ranking.state = state;
        }
        if self.wanted == Wanted::Outcome {
            return Ok(());
        }
        let is_one = self.query.segments.len() <= 1 || self.only.is_some();
        let room = self.ui.room();
        for ranking in self.rankings.iter().flatten() {
            match self.ui.is_live() {
                true if is_one => self.ui.draw(&table::ranking(ranking, room))?,
                true => {}
                false => self.ui.text(&format!("\n{}", table::first_entries(ranking, self.query.top)))?,
            }
        }
        Ok(())
    }
}

impl Watcher for Screen<'_> {
    fn see(&mut self, event: &Event) -> Result<(), ClientError> {
        match event {
            Event::Level(ranking) if self.only.is_some_and(|only| only != ranking.segment) => return Ok(()),
            Event::Level(ranking) => self.show(ranking)?,
            Event::End(end) => self.show_last(end.summary.state)?,
            Event::Begin(_) | Event::Error(_) => {}
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
    use quadmuse_proto::{End, EndState};

    fn revision(segment: u32, revision: u64, level: u32, entries: u32) -> Event {
        Event::Level(Ranking { segment, revision, level, ..with_entries(entries) })
    }

    fn end(segments: u32) -> Event {
        let summary = Query { state: QueryState::Done, ..query(segments) };
        Event::End(Box::new(End { query: summary.id, state: EndState::Done, revision: 9, summary }))
    }

    /// What is printed of two revisions of each of three segments, of 40 entries each.
    fn printed(terminal: Option<Room>, wanted: Wanted) -> String {
        let out = Shared::default();
        let mut ui = Ui::new(Audience::People, terminal, out.clone(), std::io::sink());
        let mut screen = Screen::new(query(3), None, wanted, &mut ui);
        for (level, number) in [(32, 1), (64, 2)] {
            (0..3).for_each(|segment| screen.see(&revision(segment, number, level, 40)).expect("prints"));
        }
        screen.see(&end(3)).expect("prints");
        out.text()
    }

    #[test]
    fn several_segments_share_one_table_on_a_terminal() {
        for wanted in [Wanted::Ranking, Wanted::Outcome] {
            let all = printed(Some(Room::default()), wanted);
            let last = all.rsplit("\x1b[0J").next().expect("some text");
            assert_eq!((last.matches("head 1").count(), last.lines().count()), (3, 5), "{last}");
        }
    }

    #[test]
    fn a_pipe_gets_a_line_a_revision_and_the_first_entries_once() {
        let all = printed(None, Wanted::Ranking);
        let lines: Vec<&str> = all.lines().collect();
        assert!(lines[0].starts_with("segment 0 · level 32 of 128 · best: head 1, score 0.1250"), "{all}");
        assert_eq!(all.matches("level 32 of 128").count(), 3, "{all}");
        // The last level: a line a segment, and the title of its table.
        assert_eq!(all.matches("level 64 of 128").count(), 3 + 3, "{all}");
        // A table is a title, a header, a rule, four entries and their rest, with a blank line before it.
        assert_eq!(lines.len(), 6 + 3 * 9, "{all}");
        assert_eq!(all.matches("… and 38 more").count(), 3, "{all}");
    }

    #[test]
    fn what_is_done_is_not_called_under_way() {
        let piped = printed(None, Wanted::Ranking);
        assert_eq!((piped.matches("ranked · done").count(), piped.matches("· ranking").count()), (3, 0), "{piped}");
        let out = Shared::default();
        let mut ui = Ui::new(Audience::People, Some(Room::default()), out.clone(), std::io::sink());
        let mut screen = Screen::new(query(1), None, Wanted::Ranking, &mut ui);
        screen.see(&revision(0, 1, 128, 2)).expect("prints");
        screen.see(&end(1)).expect("prints");
        let last = out.text().rsplit("\x1b[0J").next().expect("some text").to_owned();
        assert!(last.contains("ranked · done") && last.contains("head 1"), "{last}");
    }

    #[test]
    fn a_pipe_gets_nothing_of_the_ranking_where_the_outcome_is_wanted() {
        assert_eq!(printed(None, Wanted::Outcome), "");
    }

    #[test]
    fn a_revision_that_says_nothing_new_takes_no_line() {
        let out = Shared::default();
        let mut ui = Ui::new(Audience::People, None, out.clone(), std::io::sink());
        let mut screen = Screen::new(query(1), None, Wanted::Ranking, &mut ui);
        for (number, entries) in [(1, 2), (2, 3)] {
            screen.see(&revision(0, number, 32, entries)).expect("prints");
        }
        assert_eq!(out.text().lines().count(), 1, "{}", out.text());
    }

    #[test]
    fn only_the_segment_asked_for_is_shown() {
        let out = Shared::default();
        let mut ui = Ui::new(Audience::Programs, None, out.clone(), std::io::sink());
        let mut screen = Screen::new(query(3), Some(1), Wanted::Ranking, &mut ui);
        screen.see(&revision(0, 1, 32, 1)).expect("prints");
        assert_eq!(out.text(), "");
        screen.see(&revision(1, 1, 32, 1)).expect("prints");
        assert_eq!(out.text().lines().count(), 1);
    }
}
