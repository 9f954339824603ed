//! The results as tables in Markdown.

use super::Judged;
use crate::real_input::table::markdown;

/// A row a body.
pub fn table(judged: &[Judged]) -> String {
    let header = [
        "input",
        "triangles",
        "genus",
        "segments",
        "regular",
        "quads",
        "extraordinary before",
        "after",
        "out %",
        "back %",
        "angle °",
        "examples' °",
        "s",
        "sound",
        "verdict",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    for one in judged {
        let genus = (2 * one.input.components as i64 - one.input.boundary_loops as i64 - one.input.euler) / 2;
        let mut row = vec![one.body.name(), one.input.faces.to_string(), genus.to_string()];
        let broken = one.broken();
        let degrees = |of: Option<f64>| of.map_or("–".to_owned(), |angle| format!("{angle:.1}"));
        let measured = |what: &&str| ["distance", "angles"].contains(what);
        match &one.outcome {
            Ok(o) => row.extend([
                o.segments.to_string(),
                o.templates.to_string(),
                o.made.quads.to_string(),
                o.extraordinary_before.to_string(),
                o.made.extraordinary.to_string(),
                format!("{:.3}", o.made.out_to_scan_pct.mean),
                format!("{:.3}", o.made.scan_to_out_pct.mean),
                degrees(o.made.angle_deviation_mean_deg),
                degrees(o.examples_deg),
                format!("{:.0}", o.seconds),
                if broken.iter().all(measured) { "yes" } else { "NO" }.to_owned(),
                if broken.is_empty() { "holds".to_owned() } else { broken.join(", ") },
            ]),
            Err(error) => row.push(error.replace(['\n', '|'], " ")),
        }
        rows.push(row);
    }
    markdown(&rows)
}

/// What the service said about each, as a list.
pub fn notes(judged: &[Judged]) -> String {
    let said = judged.iter().filter_map(|one| {
        let outcome = one.outcome.as_ref().ok().filter(|o| !o.notes.is_empty())?;
        Some(format!("- {}: {}\n", one.body.name(), outcome.notes.join("; ")))
    });
    said.collect()
}
