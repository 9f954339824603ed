//! Maps and compositions: how good they are, and what they are made of.

use super::{ranking::flip, time, word};
use crate::paint::Paint;
use quadmuse_proto::{Composition, ConstraintOrigin, Covers, Histogram, Map, Verdict};

/// What came of a map: the verdict first, then the reasons, then the figures; with the example's name, where it is known.
pub fn map(map: &Map, name: Option<&str>, paint: Paint) -> String {
    let set_by_user = map.constraints.iter().filter(|c| c.origin == ConstraintOrigin::User).count();
    let mut lines = vec![format!("verdict    {}", headline(map.verdict, map.inspired, map.covers, paint))];
    lines.extend(map.reasons.iter().map(|reason| format!("           – {}", word(reason))));
    lines.push(format!("map        {} (revision {}) of query {}", map.id, map.revision, map.query));
    let id = map.example.to_string();
    let name = name.filter(|name| *name != id).map_or_else(String::new, |name| format!(" of {}", word(name)));
    lines.push(format!("example    {id} segment {}{name}, on segment {}", map.example_segment, map.segment));
    lines.push(format!("mesh       {} vertices, {} faces, {} folded", map.vertices, map.faces, map.folds));
    lines.push(format!("flip       {}, shifted by {:.3}", flip(map.flip), map.shift_u));
    lines.push(format!("angles     {}", statistics(&map.distortion.angle, "°")));
    lines.push(format!("areas      {} (log₂)", statistics(&map.distortion.area, "")));
    lines.push(format!("constraints {} ({set_by_user} set by hand), energy {:.4}", map.constraints.len(), map.energy));
    lines.push(format!("took       {}", time(map.timings.total_ms)));
    lines.join("\n")
}

fn statistics(histogram: &Histogram, unit: &str) -> String {
    let Histogram { mean, median, p95, max, .. } = histogram;
    format!(
        "changed by {mean:.2}{unit} on average, median {median:.2}{unit}, 95 % {p95:.2}{unit}, at most {max:.2}{unit}"
    )
}

/// The headline: the verdict, how much is an example's, and how much is covered.
fn headline(verdict: Verdict, inspired: f64, covers: Covers, paint: Paint) -> String {
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let scan = percent(covers.input);
    if inspired <= 0.0 {
        let word = if verdict == Verdict::Broken { "broken, and no" } else { "no" };
        let word = paint.verdict(verdict, &format!("{word} example used"));
        return format!("{word}: a regular layout on {scan} of the scan");
    }
    let advice = match verdict {
        Verdict::Good => "",
        Verdict::Fair => ": look at it first",
        Verdict::Poor => ": choose another example, or set constraints",
        Verdict::Broken => ": of no use as it is",
    };
    let word = paint.verdict(verdict, verdict.as_str());
    let (own, example) = (percent(inspired), percent(covers.example));
    format!("{word}{advice} ({own} of it an example's; {scan} of the scan and {example} of the example covered)")
}

/// What came of a composition.
pub fn composition(composition: &Composition, paint: Paint) -> String {
    let Composition { id, query, parts, vertices, quads, triangles, extraordinary_vertices, .. } = composition;
    let mut lines = vec![
        format!("verdict     {}", headline(composition.verdict, composition.inspired, composition.covers, paint)),
        format!("composition {id} of query {query}, {} of its segments", parts.len()),
        format!("mesh        {vertices} vertices, {quads} quads, {triangles} triangles left"),
        format!(
            "layout      {extraordinary_vertices} extraordinary vertices, {} in the parts before",
            composition.extraordinary_before
        ),
    ];
    let reasons = composition.reasons.iter().map(|reason| format!("            – {}", word(reason)));
    lines.splice(1..1, reasons);
    lines.extend(composition.notes.iter().map(|note| format!("note        {}", word(note))));
    lines.push(format!("took        {}", time(composition.total_ms)));
    lines.join("\n")
}

/// The quads that a density will give the maps that were chosen, told before the work. What the service lays on other segments comes on
/// top.
pub fn expected_quads(maps: &[Map], segments: usize, density: i32) -> String {
    let now: u64 = maps.iter().map(|map| map.faces).sum();
    let steps = density.unsigned_abs();
    let factor = 4u64.saturating_pow(steps);
    let (then, how) = match density {
        0 => (now, "as the examples have".to_owned()),
        1.. => (now.saturating_mul(factor), format!("{factor} for each of the examples' {now}")),
        _ => (now / factor, format!("one for {factor} of the examples' {now}, where their layouts allow")),
    };
    let more = match segments.saturating_sub(maps.len()) {
        0 => String::new(),
        1 => ", and those of another segment".to_owned(),
        n => format!(", and those of {n} other segments"),
    };
    format!("density {density}: about {then} quads ({how}){more}")
}

/// How good the parts of a composition are: `2 good, 1 poor, 3 regular`.
pub fn verdicts(maps: &[Map], regular: usize) -> String {
    let of = |verdict: Verdict| maps.iter().filter(|map| map.verdict == verdict).count();
    let counted = [
        (of(Verdict::Good), Verdict::Good.as_str()),
        (of(Verdict::Fair), Verdict::Fair.as_str()),
        (of(Verdict::Poor), Verdict::Poor.as_str()),
        (of(Verdict::Broken), Verdict::Broken.as_str()),
        (regular, "regular"),
    ];
    let said: Vec<String> = counted.iter().filter(|(n, _)| *n > 0).map(|(n, word)| format!("{n} {word}")).collect();
    format!("parts: {}", said.join(", "))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use quadmuse_proto::{Distortion, ExampleId, Flip, MakingState, MapId, MapTimings, QueryId};

    pub(crate) fn a_map() -> Map {
        let histogram = Histogram { mean: 2.5, median: 2.0, p95: 7.0, max: 40.0, ..Histogram::default() };
        Map {
            id: MapId::from_bytes([3; 16]),
            query: QueryId::from_bytes([7; 16]),
            state: MakingState::Done,
            progress: 1.0,
            segment: 1,
            example: ExampleId::from_bytes([1; 16]),
            example_segment: 0,
            revision: 1,
            flip: Flip { u: true, v: false },
            shift_u: 0.25,
            energy: 0.125,
            resolution: 128,
            constraints: Vec::new(),
            vertices: 402,
            faces: 400,
            folds: 0,
            distortion: Distortion { angle: histogram.clone(), area: histogram },
            verdict: Verdict::Fair,
            evidence: None,
            own_vertices: 0,
            own_faces: 0,
            kept: None,
            covers: quadmuse_proto::Covers::default(),
            inspired: 1.0,
            reasons: vec!["the largest angle changes by 40°".into()],
            timings: MapTimings { register_ms: 10.0, map_ms: 20.0, total_ms: 1234.0 },
        }
    }

    #[test]
    fn a_map_is_told_by_its_verdict_and_the_reasons_first() {
        let text = map(&a_map(), Some("head 1"), Paint::Plain);
        let lines: Vec<&str> = text.lines().collect();
        let covered = "100 % of the scan and 100 % of the example covered";
        assert_eq!(lines[0], format!("verdict    fair: look at it first (100 % of it an example's; {covered})"));
        assert_eq!(lines[1], "           – the largest angle changes by 40°");
        assert!(text.contains(" segment 0 of head 1, on segment 1"), "{text}");
        assert!(text.contains("u (mirror), shifted by 0.250"), "{text}");
        assert!(text.contains("95 % 7.00°"), "{text}");
        assert!(text.contains("1.23 s"), "{text}");
    }

    #[test]
    fn the_word_of_the_verdict_alone_is_coloured() {
        let text = map(&a_map(), None, Paint::Coloured);
        assert!(text.starts_with("verdict    \x1b[33mfair\x1b[0m: look at it first (100 %"), "{text}");
        assert_eq!(text.matches('\x1b').count(), 2, "{text}");
    }

    #[test]
    fn the_quads_of_a_density_are_told_before_the_work() {
        let maps = [a_map(), a_map()];
        assert_eq!(expected_quads(&maps, 2, 1), "density 1: about 3200 quads (4 for each of the examples' 800)");
        let coarser = "density -2: about 50 quads (one for 16 of the examples' 800, where their layouts allow), and those of 2 other segments";
        assert_eq!(expected_quads(&maps, 4, -2), coarser);
        assert!(expected_quads(&[], 1, 1).ends_with("and those of another segment"));
    }

    #[test]
    fn a_result_without_an_example_says_so_first() {
        let covers = Covers { example: 0.0, input: 0.998 };
        let line = headline(Verdict::Poor, 0.0, covers, Paint::Plain);
        assert_eq!(line, "no example used: a regular layout on 100 % of the scan");
        assert!(headline(Verdict::Broken, 0.0, covers, Paint::Plain).starts_with("broken, and no example used"));
        assert!(headline(Verdict::Broken, 0.4, covers, Paint::Plain).starts_with("broken: of no use as it is (40 % "));
    }

    #[test]
    fn the_verdicts_of_parts_are_counted() {
        let good = Map { verdict: Verdict::Good, ..a_map() };
        assert_eq!(verdicts(&[good.clone(), a_map(), good], 2), "parts: 2 good, 1 fair, 2 regular");
        assert_eq!(verdicts(&[], 3), "parts: 3 regular");
    }
}
