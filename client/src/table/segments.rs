//! The segments of a query: the parts of a scan.

use super::{Column, line, new_table, word};
use crate::ui::Room;
use quadmuse_proto::Query;

/// A segment in words: its number, and its name where it has one.
pub fn segment(number: u32, name: Option<&str>) -> String {
    match name {
        Some(name) => format!("segment {number}, {}", word(name)),
        None => format!("segment {number}"),
    }
}

/// A table of a query's segments with their names.
pub fn segments(query: &Query, room: Room) -> String {
    let columns = [
        Column::Numbers("segment"),
        Column::Words("name"),
        Column::Words("topology"),
        Column::Numbers("faces"),
        Column::Numbers("k"),
    ];
    let mut table = new_table(&columns, room);
    for segment in &query.segments {
        table.add_row(line([
            segment.segment.to_string(),
            segment.name.as_deref().map_or_else(|| "–".to_owned(), word),
            segment.topology.to_string(),
            segment.faces.to_string(),
            segment.k.map_or_else(|| "–".to_owned(), |k| format!("{k:.3}")),
        ]));
    }
    room.paint.table(&table.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::query;

    #[test]
    fn segments_are_listed_with_their_names_which_garble_nothing() {
        let mut named = query(2);
        named.segments[1].name = Some("fore\u{1b}arm".into());
        let text = segments(&named, Room::default());
        let rows: Vec<&str> = text.lines().skip(2).collect();
        assert!(rows.len() == 2 && rows[0].contains('–') && rows[1].contains("arm"), "{text}");
        assert!(!text.contains('\u{1b}'), "{text}");
        assert_eq!([segment(3, None), segment(3, Some("arm"))], ["segment 3", "segment 3, arm"]);
    }
}
