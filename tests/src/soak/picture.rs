//! The picture of a soak: memory, latency, and what was done and failed, over time, as SVG.

use super::Row;
use std::fmt::Write;

const WIDTH: f64 = 900.0;
const PANEL: f64 = 170.0;
/// Room for what stands beside a panel, above and below it.
const LEFT: f64 = 70.0;
const RIGHT: f64 = 170.0;
const ABOVE: f64 = 30.0;
const COLOURS: [&str; 3] = ["#1f6fb2", "#c8442a", "#3a8f3d"];

/// A line: its name, and its value in a row.
type Line = (&'static str, fn(&Row) -> f64);

/// A panel: its title with the unit, and its lines.
const PANELS: [(&str, &[Line]); 3] = [
    ("memory of the server, MiB", &[("resident", |row| row.resident_mib)]),
    (
        "latency, ms",
        &[
            ("health p99", |row| row.health_ms[1]),
            ("edit p95", |row| row.edit_ms[1]),
            ("edit p50", |row| row.edit_ms[0]),
        ],
    ),
    (
        "in each interval",
        &[
            ("queries", |row| row.ended as f64),
            ("errors", |row| row.errors as f64),
            ("examples changed", |row| row.changes as f64),
        ],
    ),
];

/// The picture.
pub fn svg(rows: &[Row]) -> String {
    let height = PANELS.len() as f64 * (PANEL + ABOVE) + ABOVE;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for (k, (title, lines)) in PANELS.iter().enumerate() {
        panel(&mut text, rows, ABOVE + k as f64 * (PANEL + ABOVE), title, lines);
    }
    text.push_str("</svg>\n");
    text
}

fn panel(text: &mut String, rows: &[Row], top: f64, title: &str, lines: &[Line]) {
    let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
    let most = lines.iter().flat_map(|(_, of)| rows.iter().map(|row| finite(of(row)))).fold(1.0, f64::max);
    let end = rows.last().map_or(1.0, |row| row.at_s.max(1.0));
    let right = WIDTH - RIGHT;
    let x = |at: f64| LEFT + (right - LEFT) * at / end;
    let y = |value: f64| top + PANEL * (1.0 - value / most);
    let bottom = top + PANEL;
    let _ = writeln!(text, "<text x=\"{LEFT}\" y=\"{:.0}\" font-weight=\"bold\">{title}</text>", top - 6.0);
    for part in [0.0, 0.5, 1.0] {
        let (at, label) = (y(part * most), part * most);
        let _ = writeln!(
            text,
            "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{label:.0}</text>",
            LEFT - 6.0,
            at + 4.0
        );
        let _ = writeln!(
            text,
            "<text x=\"{:.1}\" y=\"{:.0}\" text-anchor=\"middle\" fill=\"#777\">{:.0} s</text>",
            x(part * end),
            bottom + 14.0,
            part * end
        );
    }
    for (k, (name, of)) in lines.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let known = rows.iter().filter(|row| of(row).is_finite());
        let points: String = known.map(|row| format!("{:.1},{:.1} ", x(row.at_s), y(of(row)))).collect();
        let _ = writeln!(
            text,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>\
             <text x=\"{:.0}\" y=\"{:.0}\" fill=\"{colour}\">{name}</text>",
            points.trim_end(),
            right + 10.0,
            top + 14.0 + 16.0 * k as f64
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_drawn_within_the_picture_and_what_is_unknown_is_left_out() {
        let row = |k: usize| Row {
            at_s: 10.0 * (k + 1) as f64,
            resident_mib: 100.0 * k as f64,
            edit_ms: [f64::NAN, if k == 1 { f64::NAN } else { 40.0 }],
            ..Row::default()
        };
        let text = svg(&[row(0), row(1), row(2)]);
        assert_eq!(text.matches("<polyline").count(), 7);
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
        let points = |line: &str| line.split('"').nth(1).map(|p| p.split_whitespace().count());
        let counts: Vec<_> = text.lines().filter(|l| l.starts_with("<polyline")).filter_map(points).collect();
        assert_eq!(counts, [3, 3, 2, 0, 3, 3, 3]);
        assert!(text.contains("200") && text.contains("30 s"), "the most and the end are told: {text}");
    }
}
