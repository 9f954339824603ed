//! Tables for people.

use super::lay::Outcome;
use super::method::Method;
use std::collections::BTreeMap;
use std::fmt::Write;

/// An outcome with its pair's kind and name.
#[derive(Clone, Debug)]
pub struct Row {
    /// The kind of pair.
    pub kind: String,
    /// The pair's name.
    pub name: String,
    /// The method.
    pub method: Method,
    /// What came of it.
    pub outcome: Result<Outcome, String>,
}

/// A line for one outcome.
pub fn line(row: &Row) -> String {
    let head = format!("{:9} {:44} {:11}", row.kind, row.name.chars().take(44).collect::<String>(), row.method.name());
    match &row.outcome {
        Err(why) => format!("{head} {why}"),
        Ok(o) => {
            let e = &o.evidence;
            format!(
                "{head} {:6.2} {:6.2} {}{} folds {} {:?} | cost {:.3} modulus {:+.3} turned {:.4} angle {:.1} laid {:.1} uncovered {:.4} missing {}/{} | badness {:.2} | snapped {}+{} refused {} edges off {} | {:.2} {:.2} {:.2} s",
                o.median_pct,
                o.p95_pct,
                if o.mirrored { "mirrored " } else { "" },
                if o.atlas { "atlas" } else { "chart" },
                o.folds,
                o.verdict,
                e.cost,
                e.modulus_log,
                e.turned_share,
                e.angle_p95_deg,
                e.laid_angle_p95_deg,
                e.coverage.uncovered_share,
                e.coverage.missing,
                e.coverage.features,
                o.badness,
                o.snapped.corners,
                o.snapped.creased,
                o.snapped.refused,
                o.edges_off_pct.map_or_else(|| "–".to_owned(), |x| format!("{x:.3}")),
                o.seconds[0],
                o.seconds[1],
                o.seconds[2],
            )
        }
    }
}

/// Means by kind and method, in Markdown.
pub fn by_kind(rows: &[Row]) -> String {
    let mut groups: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|row| groups.entry(&row.kind).or_default().push(row));
    let mut text = String::from(
        "| kind | method | pairs | median | largest | p95 | mirrored | folds |\n|---|---|---|---|---|---|---|---|\n",
    );
    for (kind, rows) in groups {
        for method in Method::ALL {
            let done: Vec<&Outcome> =
                rows.iter().filter(|r| r.method == method).filter_map(|r| r.outcome.as_ref().ok()).collect();
            if done.is_empty() {
                continue;
            }
            let mean = |f: fn(&Outcome) -> f64| done.iter().map(|o| f(o)).sum::<f64>() / done.len() as f64;
            let most = done.iter().map(|o| o.median_pct).fold(0.0, f64::max);
            let mirrored = done.iter().filter(|o| o.mirrored).count();
            let folds: usize = done.iter().map(|o| o.folds).sum();
            let _ = writeln!(
                text,
                "| {kind} | {} | {} | {:.2} | {most:.2} | {:.2} | {mirrored} | {folds} |",
                method.name(),
                done.len(),
                mean(|o| o.median_pct),
                mean(|o| o.p95_pct),
            );
        }
    }
    text
}
