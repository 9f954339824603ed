//! Examples.

use super::{Column, line, new_table, size, word};
use crate::ui::Room;
use quadmuse_proto::{Example, ExampleSegment, NamedPoint, Topology};
use std::{collections::BTreeMap, fmt::Write};

/// A table of examples, and how many there are. `sought` says which were asked for, and is empty where all were.
pub fn examples(examples: &[Example], sought: &str, room: Room) -> String {
    match (examples.is_empty(), sought) {
        (true, "") => return "the corpus is empty; add examples with `quadmuse add FILE…`".into(),
        (true, _) => return format!("no example with {sought}; `quadmuse list` shows all"),
        _ => {}
    }
    let columns = [
        Column::Ids("id"),
        Column::Words("name"),
        Column::Words("tags"),
        Column::Numbers("relevance"),
        Column::Numbers("faces"),
        Column::Words("segments"),
    ];
    let mut table = new_table(&columns, room);
    for example in examples {
        table.add_row(line([
            example.id.to_string(),
            word(&example.name),
            word(&example.tags.join(" ")),
            format!("{}", example.relevance),
            example.counts.faces.to_string(),
            topologies(example),
        ]));
    }
    let count = match examples.len() {
        1 => "1 example".to_owned(),
        n => format!("{n} examples"),
    };
    format!("{}\n{count}", room.paint.table(&table.to_string()))
}

/// Tells in words what the listed examples must have: `the tags x and y, and a segment that is a disc`; empty where nothing is.
pub fn sought(tags: &[String], topology: Option<Topology>) -> String {
    let tags = match tags {
        [] => None,
        [one] => Some(format!("the tag {}", word(one))),
        [all @ .., last] => Some(format!("the tags {} and {}", word(&all.join(", ")), word(last))),
    };
    let topology = topology.map(|topology| {
        let article = if topology == Topology::Annulus { "an" } else { "a" };
        format!("a segment that is {article} {topology}")
    });
    tags.into_iter().chain(topology).collect::<Vec<_>>().join(", and ")
}

/// How many of an example's segments are parts of one that is there whole.
pub fn parts(segments: &[ExampleSegment]) -> usize {
    segments.iter().filter(|segment| segment.is_part).count()
}

/// The topologies of an example's segments: `disc`, `2 disc, 1 annulus`, or `sphere and 6 parts` of one that is there whole, too.
fn topologies(example: &Example) -> String {
    if let (Some(whole), parts @ 1..) = (example.segments.first(), parts(&example.segments)) {
        return format!("{} and {parts} parts", whole.topology);
    }
    let mut counts = BTreeMap::new();
    for segment in &example.segments {
        *counts.entry(segment.topology).or_insert(0_u32) += 1;
    }
    let one = example.segments.len() == 1;
    let parts = counts.iter().map(|(topology, n)| if one { topology.to_string() } else { format!("{n} {topology}") });
    parts.collect::<Vec<_>>().join(", ")
}

/// The names of landmarks; of many only the first.
fn landmarks(all: &[NamedPoint]) -> String {
    const LISTED: usize = 16;
    let names: Vec<String> = all.iter().take(LISTED).map(|landmark| word(&landmark.name)).collect();
    let more = all.len().saturating_sub(LISTED);
    if more > 0 { format!("{} and {more} more", names.join(", ")) } else { names.join(", ") }
}

/// Everything about one example.
pub fn example(example: &Example, room: Room) -> String {
    let counts = &example.counts;
    let mut text = String::new();
    let mut tell = |label: &str, value: &str| {
        if !value.is_empty() {
            let _ = writeln!(text, "{label:<10} {value}");
        }
    };
    tell("id", &example.id.to_string());
    tell("name", &word(&example.name));
    tell("tags", &word(&example.tags.join(" ")));
    tell("relevance", &example.relevance.to_string());
    tell("template", &word(example.template.as_deref().unwrap_or_default()));
    tell("file", &format!("{}, {}, blake3 {}", word(&example.format), size(example.bytes), word(&example.hash)));
    tell(
        "mesh",
        &format!(
            "{} vertices, {} faces ({} quads, {} triangles)",
            counts.vertices, counts.faces, counts.quads, counts.triangles
        ),
    );
    tell("added", &word(&example.created));
    tell("author", &word(&example.author));
    tell("licence", &word(&example.licence));
    for line in example.notes.lines() {
        tell("notes", &word(line));
    }
    tell("landmarks", &landmarks(&example.landmarks));
    for repair in &example.repairs {
        tell("repaired", &word(repair));
    }
    let columns = [
        Column::Numbers("segment"),
        Column::Words("topology"),
        Column::Numbers("k"),
        Column::Numbers("faces"),
        Column::Numbers("features"),
    ];
    let mut table = new_table(&columns, room);
    for segment in &example.segments {
        table.add_row(line([
            segment.segment.to_string(),
            if segment.is_part { format!("{}, part of 0", segment.topology) } else { segment.topology.to_string() },
            format!("{:.3}", segment.k),
            segment.faces.to_string(),
            segment.features.to_string(),
        ]));
    }
    format!("{text}{}", room.paint.table(&table.to_string()))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use quadmuse_proto::{ExampleId, MeshCounts};

    pub(crate) fn head() -> Example {
        let segment =
            |segment, topology| ExampleSegment { segment, is_part: false, topology, k: 0.4, faces: 200, features: 9 };
        Example {
            id: "01ARZ3NDEKTSV4RRFFQ69G5FAV".parse::<ExampleId>().expect("an id"),
            revision: 1,
            name: "head\x1b[2J".into(),
            tags: vec!["film".into(), "hero".into()],
            relevance: 4.5,
            author: "Ada".into(),
            licence: "CC0".into(),
            notes: "neutral\nopen mouth".into(),
            landmarks: vec![NamedPoint { name: "nose_tip".into(), vertex: Some(7), point: Some([0.0; 3]) }],
            hash: "ab12".into(),
            format: "obj".into(),
            bytes: 12_345,
            counts: MeshCounts { vertices: 402, faces: 400, triangles: 0, quads: 400 },
            segments: vec![segment(0, Topology::Disc), segment(1, Topology::Annulus), segment(2, Topology::Disc)],
            repairs: vec!["2 vertices that no face uses were left out".into()],
            doubts: Vec::new(),
            created: "2025-01-01T00:00:00Z".into(),
            template: None,
        }
    }

    #[test]
    fn a_list_names_each_example_and_counts_them() {
        let text = examples(&[head()], "", Room::default());
        assert!(text.contains("01ARZ3NDEKTSV4RRFFQ69G5FAV"), "{text}");
        assert!(text.contains("film hero"), "{text}");
        assert!(text.contains("2 disc, 1 annulus"), "{text}");
        assert!(text.ends_with("1 example"), "{text}");
        assert!(!text.contains('\x1b'), "a name may not steer the terminal");
    }

    #[test]
    fn a_list_keeps_to_the_width_of_the_terminal() {
        let text = examples(&[head()], "", Room { width: Some(60), ..Room::default() });
        assert!(text.lines().all(|line| line.chars().count() <= 60), "{text}");
    }

    #[test]
    fn an_empty_corpus_is_told_with_the_way_out() {
        assert!(examples(&[], "", Room::default()).contains("quadmuse add"));
    }

    #[test]
    fn a_filter_that_nothing_passes_is_no_empty_corpus() {
        let tags = ["x".to_owned(), "y".to_owned()];
        let text = examples(&[], &sought(&tags, Some(Topology::Annulus)), Room::default());
        assert_eq!(
            text,
            "no example with the tags x and y, and a segment that is an annulus; `quadmuse list` shows all"
        );
        assert_eq!((sought(&tags[..1], None).as_str(), sought(&[], None).as_str()), ("the tag x", ""));
    }

    #[test]
    fn an_example_that_is_whole_and_in_parts_says_which_is_which() {
        let mut both = head();
        both.segments[0].topology = Topology::Sphere;
        both.segments[1..].iter_mut().for_each(|segment| segment.is_part = true);
        let listed = examples(std::slice::from_ref(&both), "", Room::default());
        assert!(listed.contains("sphere and 2 parts"), "{listed}");
        let shown = example(&both, Room::default());
        assert!(shown.contains("annulus, part of 0") && !shown.contains("sphere, part"), "{shown}");
    }

    #[test]
    fn an_example_is_shown_with_its_repairs_and_segments() {
        let text = example(&head(), Room::default());
        for part in [
            "author     Ada",
            "notes      open mouth",
            "landmarks  nose_tip",
            "400 quads",
            "12 kB",
            "repaired   2 vertices",
            "annulus",
            "0.400",
        ] {
            assert!(text.contains(part), "{part} is missing in\n{text}");
        }
        assert!(!text.contains("template"));
    }
}
