//! What must hold of the results: the hard part of the runner.

use super::{
    pairs::{Judged, Outcome},
    scans,
};

/// Folded faces on a scan of another person, one in so many: a few fold where its rim is ragged. Between pairs of one family there are
/// none.
pub const SCAN_FOLDS_ONE_IN: u64 = 200;
/// Largest mean of the medians over the head pairs, in % of √area.
pub const HEAD_MEDIAN_MEAN_MAX: f64 = 1.3;
/// Largest mean of the 95th percentiles over the head pairs, in % of √area.
pub const HEAD_P95_MEAN_MAX: f64 = 4.5;

/// The claims that don't hold, a sentence each.
pub fn broken(pairs: &[Judged], scans: &[scans::Judged]) -> Vec<String> {
    let mut found = Vec::new();
    for judged in pairs {
        let name = judged.pair.name();
        match &judged.outcome {
            Err(error) => found.push(format!("{name}: expected a mapped mesh, found: {error}")),
            Ok(outcome) => {
                found.extend(one_pair(&judged.pair.kind, outcome).into_iter().map(|claim| format!("{name}: {claim}")))
            }
        }
    }
    let heads: Vec<&Outcome> = pairs
        .iter()
        .filter(|judged| judged.pair.kind == "head")
        .filter_map(|judged| judged.outcome.as_ref().ok())
        .collect();
    if !heads.is_empty() {
        found.extend(at_most(
            "mean of the head pairs' medians",
            mean(heads.iter().map(|o| o.truth.median_pct)),
            HEAD_MEDIAN_MEAN_MAX,
        ));
        found.extend(at_most(
            "mean of the head pairs' 95th percentiles",
            mean(heads.iter().map(|o| o.truth.p95_pct)),
            HEAD_P95_MEAN_MAX,
        ));
    }
    for judged in scans {
        match &judged.outcome {
            Err(error) => found.push(format!("{}: expected a mesh, found: {error}", judged.name)),
            Ok(outcome) if outcome.folds * SCAN_FOLDS_ONE_IN > outcome.soundness.faces => found.push(format!(
                "{}: expected at most one face in {SCAN_FOLDS_ONE_IN} folded, found {} of {}",
                judged.name, outcome.folds, outcome.soundness.faces
            )),
            Ok(_) => {}
        }
    }
    found
}

fn one_pair(kind: &str, outcome: &Outcome) -> Vec<String> {
    let mut found = Vec::new();
    if !outcome.truth.same_faces {
        found.push("expected the example's own faces, found others".to_owned());
    }
    if outcome.folds > 0 {
        found.push(format!("expected no folds, found {}", outcome.folds));
    }
    match (kind, outcome.mirrored) {
        ("head", true) => found.push("expected the head as it is, found its mirror image".to_owned()),
        ("mirrored", false) => found.push("expected the mirror image, found the hand as it is".to_owned()),
        _ => {}
    }
    found
}

fn at_most(what: &str, value: f64, max: f64) -> Option<String> {
    // Written so that a NaN is refused.
    if value <= max { None } else { Some(format!("expected the {what} to be at most {max} %, found {value:.2} %")) }
}

/// The mean; NaN of nothing.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{judge::Truth, real_input::pairs::Pair};

    fn judged(kind: &str, change: impl Fn(&mut Outcome)) -> Judged {
        let truth = Truth { same_faces: true, median_pct: 1.0, p95_pct: 3.0, turned_faces_pct: 0.0 };
        let mirrored = kind == "mirrored";
        let mut outcome =
            Outcome { truth, verdict: "good".into(), mirrored, folds: 0, rank: Some(1), query_s: 1.0, map_s: 1.0 };
        change(&mut outcome);
        let pair = Pair {
            kind: kind.into(),
            triangles: 1,
            noise: String::new(),
            example: "e".into(),
            input: "input_a.obj".into(),
            truth: "t".into(),
        };
        Judged { pair, outcome: Ok(outcome) }
    }

    #[test]
    fn good_results_hold() {
        assert_eq!(broken(&[judged("head", |_| ()), judged("mirrored", |_| ())], &[]), [""; 0]);
    }

    #[test]
    fn each_claim_bites() {
        let failed = Judged { outcome: Err("refused".into()), ..judged("head", |_| ()) };
        for (judged, expected) in [
            (judged("head", |o| o.truth.median_pct = 1.4), "mean of the head pairs' medians"),
            (judged("head", |o| o.truth.p95_pct = f64::NAN), "95th percentiles"),
            (judged("head", |o| o.mirrored = true), "a: expected the head as it is"),
            (judged("mirrored", |o| o.mirrored = false), "a: expected the mirror image"),
            (judged("hand", |o| o.truth.same_faces = false), "a: expected the example's own faces"),
            (judged("hand", |o| o.folds = 2), "a: expected no folds, found 2"),
            (failed, "a: expected a mapped mesh, found: refused"),
        ] {
            let found = broken(&[judged], &[]);
            assert!(found.len() == 1 && found[0].contains(expected), "{expected}: {found:?}");
        }
    }
}
