//! The results as tables in Markdown, which is also good to read on a terminal.

use super::{claims::mean, pairs, scans};
use std::{collections::BTreeMap, fmt::Write};

/// A table of the pairs, and one of the means per kind.
pub fn pairs(judged: &[pairs::Judged]) -> String {
    let mut rows = vec![
        [
            "kind",
            "pair",
            "triangles",
            "noise",
            "median %",
            "p95 %",
            "turned %",
            "faces",
            "verdict",
            "mirror",
            "folds",
            "rank",
            "query s",
            "map s",
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    for pairs::Judged { pair, outcome } in judged {
        let mut row = vec![pair.kind.clone(), pair.name(), pair.triangles.to_string(), pair.noise.clone()];
        match outcome {
            Ok(o) => row.extend([
                format!("{:.2}", o.truth.median_pct),
                format!("{:.2}", o.truth.p95_pct),
                format!("{:.2}", o.truth.turned_faces_pct),
                if o.truth.same_faces { "same" } else { "OTHER" }.to_owned(),
                o.verdict.clone(),
                if o.mirrored { "yes" } else { "no" }.to_owned(),
                o.folds.to_string(),
                o.rank.map_or("–".to_owned(), |rank| rank.to_string()),
                format!("{:.1}", o.query_s),
                format!("{:.1}", o.map_s),
            ]),
            Err(error) => row.push(error.replace(['\n', '|'], " ")),
        }
        rows.push(row);
    }
    format!("{}\n{}", markdown(&rows), means(judged))
}

fn means(judged: &[pairs::Judged]) -> String {
    let mut kinds: BTreeMap<&str, Vec<&pairs::Outcome>> = BTreeMap::new();
    for judged in judged {
        let outcomes = kinds.entry(&judged.pair.kind).or_default();
        outcomes.extend(judged.outcome.as_ref().ok());
    }
    let mut rows =
        vec![["kind", "pairs", "mean median %", "worst median %", "mean p95 %", "mean s"].map(str::to_owned).to_vec()];
    for (kind, outcomes) in kinds {
        let worst = outcomes.iter().map(|o| o.truth.median_pct).fold(f64::NAN, f64::max);
        rows.push(vec![
            kind.to_owned(),
            outcomes.len().to_string(),
            format!("{:.2}", mean(outcomes.iter().map(|o| o.truth.median_pct))),
            format!("{worst:.2}"),
            format!("{:.2}", mean(outcomes.iter().map(|o| o.truth.p95_pct))),
            format!("{:.1}", mean(outcomes.iter().map(|o| o.query_s + o.map_s))),
        ]);
    }
    markdown(&rows)
}

/// A table of the scans.
pub fn scans(judged: &[scans::Judged]) -> String {
    let header = [
        "scan",
        "topology",
        "faces",
        "example",
        "verdict",
        "folds",
        "sound",
        "quads",
        "angle p95 °",
        "to scan p95 %",
        "from scan p95 %",
        "s",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    for scans::Judged { name, topology, faces, outcome } in judged {
        let mut row = vec![name.clone(), topology.clone(), faces.to_string()];
        match outcome {
            Ok(o) => row.extend([
                o.example.clone(),
                o.verdict.clone(),
                o.folds.to_string(),
                if o.is_sound(topology) { "yes" } else { "NO" }.to_owned(),
                o.soundness.quads.to_string(),
                o.soundness.angle_deviation_p95_deg.map_or("–".to_owned(), |angle| format!("{angle:.1}")),
                format!("{:.2}", o.soundness.out_to_scan_pct.p95),
                format!("{:.2}", o.soundness.scan_to_out_pct.p95),
                format!("{:.1}", o.seconds),
            ]),
            Err(error) => row.push(error.replace(['\n', '|'], " ")),
        }
        rows.push(row);
    }
    markdown(&rows)
}

/// Rows as a table whose columns are lined up; the first is the header.
pub fn markdown(rows: &[Vec<String>]) -> String {
    let columns = rows.first().map_or(0, Vec::len);
    let full = |row: &&Vec<String>| row.len() == columns;
    let width = |column: usize| rows.iter().filter(full).map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for (index, row) in rows.iter().enumerate() {
        for (cell, width) in row.iter().zip(&widths) {
            let _ = write!(text, "| {cell:<width$} ");
        }
        text.push_str("|\n");
        if index == 0 {
            for width in &widths {
                let _ = write!(text, "|{}", "-".repeat(width + 2));
            }
            text.push_str("|\n");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_lined_up_and_a_failure_may_be_long() {
        let row = |cells: &[&str]| cells.iter().map(|cell| (*cell).to_owned()).collect::<Vec<_>>();
        let text = markdown(&[row(&["a", "bc", "d"]), row(&["long", "x", "y"]), row(&["z", "a failure that is long"])]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "| a    | bc | d |");
        assert_eq!(lines[1], "|------|----|---|");
        assert_eq!(lines[3], "| z    | a failure that is long |");
    }
}
