//! Rankings: of one segment in full, of several in a line each.

use super::{Column, line, new_table, segments::segment as segment_words, word};
use crate::ui::Room;
use comfy_table::Table;
use quadmuse_proto::{Entry, EntryState, Flip, Query, Ranking, Share};

/// Lines of a ranking that are no entries: title, header, rules, the rest's count, the line below.
const FRAME_LINES: usize = 5;
/// Columns of a terminal below which a ranking leaves out what can be done without.
const WIDTH_OF_ALL_COLUMNS: u16 = 125;
/// Entries shown where there is no end to the room.
const ENTRIES_SHOWN_MAX: usize = 40;

/// How many rows fit into the room, out of `rows`.
fn fitting(rows: usize, room: Room) -> usize {
    let most = room.height.map_or(ENTRIES_SHOWN_MAX, |height| usize::from(height).saturating_sub(FRAME_LINES).max(1));
    rows.min(most)
}

/// The ranking of one segment.
pub fn ranking(ranking: &Ranking, room: Room) -> String {
    shortened(ranking, fitting(ranking.entries.len(), room), room)
}

/// The first entries of the ranking of one segment, where there is no end to the room.
pub fn first_entries(ranking: &Ranking, count: u32) -> String {
    let shown = ranking.entries.len().min(count.max(1) as usize);
    shortened(ranking, shown, Room::default())
}

/// A revision of a segment's ranking in a line: its level, and the best entry.
pub fn revision(ranking: &Ranking) -> String {
    let Ranking { level, resolution, .. } = ranking;
    match ranking.entries.first() {
        Some(best) => format!(
            "{} · level {level} of {resolution} · best: {}, score {:.4} ({}){}",
            segment_words(ranking.segment, ranking.segment_name.as_deref()),
            name(best),
            best.score,
            example(best),
            without(&ranking.incomplete)
        ),
        None => title(ranking),
    }
}

fn shortened(ranking: &Ranking, shown: usize, room: Room) -> String {
    let title = title(ranking);
    if ranking.entries.is_empty() {
        return title;
    }
    let is_narrow = room.width.is_some_and(|width| width < WIDTH_OF_ALL_COLUMNS);
    let entries = ranking.entries.iter().take(shown);
    let table = if is_narrow { narrow_table(entries, room) } else { wide_table(entries, room) };
    let table = room.paint.table(&table.to_string());
    let rest = usize::try_from(ranking.corpus_size).unwrap_or(usize::MAX).saturating_sub(shown);
    if rest > 0 { format!("{title}\n{table}\n… and {rest} more") } else { format!("{title}\n{table}") }
}

fn narrow_table<'a>(entries: impl Iterator<Item = &'a Entry>, room: Room) -> Table {
    let columns = [
        Column::Numbers("rank"),
        Column::Words("name"),
        Column::Ids("example"),
        Column::Numbers("score"),
        Column::Numbers("level"),
        Column::Words("state"),
    ];
    let mut table = new_table(&columns, room);
    for entry in entries {
        table.add_row(line([
            entry.rank.to_string(),
            name(entry),
            example(entry),
            format!("{:.4}", entry.score),
            entry.resolution.to_string(),
            state(entry.state).to_owned(),
        ]));
    }
    table
}

fn wide_table<'a>(entries: impl Iterator<Item = &'a Entry>, room: Room) -> Table {
    let columns = [
        Column::Numbers("rank"),
        Column::Words("name"),
        Column::Ids("example"),
        Column::Numbers("score"),
        Column::Numbers("energy"),
        Column::Numbers("k"),
        Column::Numbers("rel."),
        Column::Words("flip"),
        Column::Numbers("shift"),
        Column::Numbers("level"),
        Column::Words("state"),
    ];
    let mut table = new_table(&columns, room);
    for entry in entries {
        table.add_row(line([
            entry.rank.to_string(),
            name(entry),
            example(entry),
            format!("{:.4}", entry.score),
            format!("{:.4}", entry.energy),
            format!("{:.3}", entry.k),
            entry.relevance.to_string(),
            flip(entry.flip).to_owned(),
            format!("{:.3}", entry.shift_u),
            entry.resolution.to_string(),
            state(entry.state).to_owned(),
        ]));
    }
    table
}

fn title(ranking: &Ranking) -> String {
    let Ranking { level, resolution, corpus_size, state, .. } = ranking;
    let segment = segment_words(ranking.segment, ranking.segment_name.as_deref());
    match (ranking.level, ranking.entries.is_empty()) {
        (0, _) => format!("{segment} · {} · no ranking yet", state.as_str()),
        (_, true) if ranking.incomplete.is_empty() => {
            format!("{segment} · {} · nothing in the corpus has its topology", state.as_str())
        }
        (_, true) => format!("{segment} · {} · nothing found{}", state.as_str(), without(&ranking.incomplete)),
        _ => {
            let without = without(&ranking.incomplete);
            format!("{segment} · level {level} of {resolution} · {corpus_size} ranked · {}{without}", state.as_str())
        }
    }
}

/// What a ranking is without, where no server answered for some of the corpus.
fn without(incomplete: &[Share]) -> String {
    let shares: Vec<String> = incomplete.iter().map(Share::to_string).collect();
    match shares.len() {
        0 => String::new(),
        1 => format!(" · INCOMPLETE: without share {} of the corpus", shares.join("")),
        _ => format!(" · INCOMPLETE: without shares {} of the corpus", shares.join(", ")),
    }
}

/// The best entry of each segment of a query; `rankings` holds one a segment, as far as there are some.
pub fn summary(query: &Query, rankings: &[Option<Ranking>], room: Room) -> String {
    let has_names = query.segments.iter().any(|segment| segment.name.is_some());
    let mut columns = vec![Column::Numbers("segment")];
    columns.extend(has_names.then_some(Column::Words("name")));
    columns.extend([
        Column::Words("topology"),
        Column::Numbers("level"),
        Column::Words("best"),
        Column::Ids("example"),
        Column::Numbers("score"),
        Column::Numbers("of"),
    ]);
    let mut table = new_table(&columns, room);
    let shown = fitting(query.segments.len(), room);
    for (index, segment) in query.segments.iter().take(shown).enumerate() {
        let ranking = rankings.get(index).and_then(Option::as_ref);
        let best = ranking.and_then(|ranking| ranking.entries.first());
        let level = ranking.map_or(0, |ranking| ranking.level);
        let mut cells = vec![segment.segment.to_string()];
        cells.extend(has_names.then(|| segment.name.as_deref().map_or_else(|| "–".to_owned(), word)));
        cells.extend([
            segment.topology.to_string(),
            if level == 0 { "–".to_owned() } else { format!("{level} of {}", query.resolution) },
            best.map_or_else(|| "–".to_owned(), name),
            best.map_or_else(String::new, example),
            best.map_or_else(String::new, |entry| format!("{:.4}", entry.score)),
            segment.corpus_size.to_string(),
        ]);
        table.add_row(line(cells));
    }
    let rest = query.segments.len() - shown;
    let table = room.paint.table(&table.to_string());
    let more = if rest > 0 { format!("\n… and {rest} more segments") } else { String::new() };
    let without = without(&query.incomplete);
    match without.strip_prefix(" · ") {
        Some(without) => format!("{table}{more}\n{without}"),
        None => format!("{table}{more}"),
    }
}

fn name(entry: &Entry) -> String {
    let name = if entry.name.is_empty() { "(unnamed)".to_owned() } else { word(&entry.name) };
    match (&entry.template, entry.similar_to) {
        (Some(template), _) => format!("{name} (template {})", word(template)),
        (None, Some(rank)) => format!("{name} (like {rank})"),
        (None, None) => name,
    }
}

/// The example as `quadmuse map` takes it.
fn example(entry: &Entry) -> String {
    match entry.example_segment {
        0 => entry.example.to_string(),
        segment => format!("{}:{segment}", entry.example),
    }
}

/// `–`, `u`, `v` or `uv`, with a word where it turns the surface into its mirror image.
pub(super) fn flip(flip: Flip) -> &'static str {
    match (flip.u, flip.v) {
        (false, false) => "–",
        (true, false) => "u (mirror)",
        (false, true) => "v (mirror)",
        (true, true) => "uv",
    }
}

fn state(state: EntryState) -> &'static str {
    match state {
        EntryState::Refining => "refining",
        EntryState::Locked => "locked",
        EntryState::Done => "done",
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use quadmuse_proto::{ExampleId, MeshCounts, Progress, QueryId, QuerySegment, QueryState, QueryTimings, Topology};

    pub(crate) fn entry(rank: u32) -> Entry {
        Entry {
            rank,
            example: ExampleId::from_bytes([rank as u8; 16]),
            example_segment: rank - 1,
            name: format!("head {rank}"),
            score: f64::from(rank) / 8.0,
            energy: 0.25,
            k: 0.4,
            relevance: 3.0,
            flip: Flip { u: rank == 2, v: false },
            shift_u: 0.125,
            resolution: 64,
            state: if rank < 3 { EntryState::Refining } else { EntryState::Locked },
            likeness: None,
            agreement: None,
            similar_to: (rank == 3).then_some(1),
            turn: Some(rank),
            template: None,
        }
    }

    pub(crate) fn with_entries(count: u32) -> Ranking {
        Ranking {
            query: QueryId::from_bytes([7; 16]),
            segment: 0,
            segment_name: None,
            revision: 2,
            level: 64,
            resolution: 128,
            state: QueryState::Ranking,
            entries: (1..=count).map(entry).collect(),
            corpus_size: u64::from(count) + 2,
            incomplete: Vec::new(),
        }
    }

    pub(crate) fn query(segments: u32) -> Query {
        let segment = |segment| QuerySegment {
            segment,
            name: None,
            topology: Topology::Annulus,
            faces: 100,
            holes: 0,
            tries: 3,
            k: None,
            features: None,
            level: None,
            corpus_size: 5,
        };
        Query {
            id: QueryId::from_bytes([7; 16]),
            state: QueryState::Ranking,
            deadline_reached: false,
            top: 4,
            resolution: 128,
            deadline_ms: None,
            tags: Vec::new(),
            counts: MeshCounts::default(),
            repairs: Vec::new(),
            waist: false,
            segments: (0..segments).map(segment).collect(),
            revision: 2,
            corpus_size: 5,
            incomplete: Vec::new(),
            progress: Progress::default(),
            timings: QueryTimings::default(),
            created: String::new(),
            problem: None,
            making: Vec::new(),
        }
    }

    #[test]
    fn a_ranking_tells_its_level_and_each_entry() {
        let text = ranking(&with_entries(3), Room::default());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "segment 0 · level 64 of 128 · 5 ranked · ranking");
        assert!(text.contains("head 3 (like 1)"), "{text}");
        assert!(text.contains("u (mirror)"), "{text}");
        assert!(text.contains(&format!("{}:2", ExampleId::from_bytes([3; 16]))), "{text}");
        assert!(text.ends_with("… and 2 more"), "{text}");
    }

    #[test]
    fn a_ranking_is_cut_to_the_height_of_the_terminal() {
        let text = ranking(&with_entries(60), Room { height: Some(24), ..Room::default() });
        assert_eq!(text.lines().count(), 23, "{text}");
        assert!(text.contains("… and 43 more"), "{text}");
        let tiny = ranking(&with_entries(60), Room { height: Some(1), ..Room::default() });
        assert!(tiny.contains("head 1 "), "{tiny}");
    }

    #[test]
    fn a_narrow_terminal_sees_whole_ids_and_a_line_an_entry() {
        let mut narrow = with_entries(12);
        narrow.entries[0].name = "a name that is far too long for any table of eighty columns".into();
        let text = ranking(&narrow, Room { width: Some(80), height: Some(24), ..Room::default() });
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        assert_eq!(text.lines().count(), 3 + 12 + 1, "{text}");
        assert!(narrow.entries.iter().all(|entry| text.contains(&entry.example.to_string())), "{text}");
    }

    #[test]
    fn before_the_first_level_there_is_only_a_title() {
        let mut early = with_entries(0);
        early.level = 0;
        assert_eq!(ranking(&early, Room::default()), "segment 0 · ranking · no ranking yet");
        early.level = 32;
        assert!(ranking(&early, Room::default()).contains("nothing in the corpus"));
    }

    #[test]
    fn a_ranking_says_which_shares_of_the_corpus_it_is_without() {
        let share = |text: &str| text.parse::<Share>().expect("a share");
        let mut some = Ranking { incomplete: vec![share("2/3")], ..with_entries(3) };
        let text = ranking(&some, Room::default());
        assert!(text.lines().next().is_some_and(|title| title.ends_with("without share 2/3 of the corpus")), "{text}");
        assert!(revision(&some).contains("INCOMPLETE"), "{}", revision(&some));
        some.entries.clear();
        assert!(!ranking(&some, Room::default()).contains("nothing in the corpus"));
        let all = Query { incomplete: vec![share("1/3"), share("2/3")], ..query(2) };
        let text = summary(&all, &[], Room::default());
        assert!(text.ends_with("INCOMPLETE: without shares 1/3, 2/3 of the corpus"), "{text}");
        assert!(!summary(&query(2), &[], Room::default()).contains("INCOMPLETE"));
    }

    #[test]
    fn several_segments_take_a_line_each() {
        let text = summary(&query(3), &[Some(with_entries(2)), None], Room::default());
        assert!(text.contains("64 of 128"), "{text}");
        assert_eq!(text.matches("annulus").count(), 3, "{text}");
        assert_eq!(text.matches("head 1").count(), 1, "{text}");
        assert!(!text.contains("name"), "{text}");
        let mut named = query(3);
        named.segments[1].name = Some("arm".into());
        let text = summary(&named, &[], Room::default());
        assert!(text.lines().next().is_some_and(|head| head.contains("name")) && text.contains("arm"), "{text}");
        let called = Ranking { segment_name: Some("arm".into()), ..with_entries(1) };
        assert!(ranking(&called, Room::default()).starts_with("segment 0, arm · level 64"));
        assert!(revision(&called).starts_with("segment 0, arm · level 64"));
    }
}
