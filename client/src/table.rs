//! What people see of the messages: pure functions from a message, and the room there is, to text.

mod corpus;
mod outcome;
mod ranking;
mod segments;

pub use corpus::{example, examples, parts, sought};
pub use outcome::{composition, expected_quads, map, verdicts};
pub use ranking::{first_entries, ranking, revision, summary};
pub use segments::{segment, segments};

use crate::{error::printable, ui::Room};
use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, LineStyle, Row, Table, TableStyle};

/// A rule under the header, and no others: a row is a line.
const STYLE: TableStyle = TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// What a column holds.
#[derive(Clone, Copy)]
enum Column {
    /// Words, which are cut where the room is narrow.
    Words(&'static str),
    /// Ids, which are of use only as a whole.
    Ids(&'static str),
    /// Numbers.
    Numbers(&'static str),
}

impl Column {
    fn name(self) -> &'static str {
        match self {
            Self::Words(name) | Self::Ids(name) | Self::Numbers(name) => name,
        }
    }
}

/// An empty table with the given columns, as wide as the room allows.
fn new_table(columns: &[Column], room: Room) -> Table {
    let mut table = Table::new();
    table.load_style(STYLE);
    match room.width {
        Some(width) => table.set_width(width).set_content_arrangement(ContentArrangement::Dynamic),
        None => table.set_content_arrangement(ContentArrangement::Disabled),
    };
    table.set_header(columns.iter().map(|column| column.name()));
    for (column, kind) in table.column_iter_mut().zip(columns) {
        if matches!(kind, Column::Numbers(_)) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        if !matches!(kind, Column::Words(_)) {
            column.set_constraint(ColumnConstraint::ContentWidth);
        }
    }
    table
}

/// A row that is one line, whatever is in it.
fn line(cells: impl IntoIterator<Item = String>) -> Row {
    let mut row = Row::from(cells);
    row.max_height(1);
    row
}

/// A word from outside, on one line.
fn word(text: &str) -> String {
    printable(&text.replace('\n', " "))
}

/// A time in milliseconds, as people say it.
pub fn time(ms: f64) -> String {
    match ms {
        ..0.5 => "less than 1 ms".into(),
        ..100.0 => format!("{ms:.0} ms"),
        _ => format!("{:.2} s", ms / 1000.0),
    }
}

/// Bytes, as people say them.
fn size(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        _ => format!("{:.0} MB", bytes as f64 / 1e6),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    pub(crate) use super::{
        corpus::tests::head,
        ranking::tests::{query, with_entries},
    };

    #[test]
    fn no_time_is_told_as_none_at_all() {
        let shown = [0.0, 0.4, 3.4, 99.0, 4_321.0].map(time);
        assert_eq!(shown, ["less than 1 ms", "less than 1 ms", "3 ms", "99 ms", "4.32 s"]);
    }

    #[test]
    fn sizes_are_told_in_the_unit_that_fits() {
        assert_eq!(size(9_999), "9999 B");
        assert_eq!(size(450_681), "451 kB");
        assert_eq!(size(64_000_000), "64 MB");
    }
}
