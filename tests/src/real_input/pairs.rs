//! Pairs with a known truth: an example, the same shape in another form as a scan, and where each vertex belongs.

use super::{Extent, RunError, corpus::Corpus, is_mirrored, number_in, read, text_in};
use crate::{
    client::Client,
    judge::{Judge, Truth},
    shared::{column, csv},
};
use serde_json::Value;
use std::{
    path::{Path, PathBuf},
    time::Instant,
};

/// A pair.
#[derive(Clone, Debug)]
pub struct Pair {
    /// `head`, `hand`, `mirrored`, `body`, `pose`, `animal`.
    pub kind: String,
    /// The input's triangles.
    pub triangles: u64,
    /// The input's noise, as told.
    pub noise: String,
    /// The quads.
    pub example: PathBuf,
    /// The scan.
    pub input: PathBuf,
    /// The example's faces where they belong on the scan.
    pub truth: PathBuf,
}

impl Pair {
    /// A name for people: the input's.
    pub fn name(&self) -> String {
        let stem = self.input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        stem.trim_start_matches("input_").to_owned()
    }
}

/// What came of a pair.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The judgement.
    pub truth: Truth,
    /// The service's own verdict.
    pub verdict: String,
    /// Whether the example was mirrored.
    pub mirrored: bool,
    /// Folded faces, as the service counts them.
    pub folds: u64,
    /// The example's place in the ranking, from 1; `None` below what is told.
    pub rank: Option<u64>,
    /// From upload to the last ranking, in seconds.
    pub query_s: f64,
    /// Mapping and download, in seconds.
    pub map_s: f64,
}

/// A pair, and what came of it, or why nothing did.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The pair.
    pub pair: Pair,
    /// What came of it.
    pub outcome: Result<Outcome, String>,
}

/// The pairs in the shared folder.
///
/// # Errors
/// The list can't be read.
pub fn pairs(shared: &Path, extent: Extent) -> Result<Vec<Pair>, RunError> {
    let folder = shared.join("meshes/groundtruth");
    let rows = csv(&read(folder.join("pairs.csv"))?);
    let all = rows.iter().map(|row| Pair {
        kind: column(row, "kind").to_owned(),
        triangles: column(row, "triangles").parse().unwrap_or_default(),
        noise: column(row, "noise").to_owned(),
        example: folder.join(column(row, "example")),
        input: folder.join(column(row, "input")),
        truth: folder.join(column(row, "truth")),
    });
    let is_wanted = |pair: &Pair| extent == Extent::All || matches!(pair.kind.as_str(), "head" | "mirrored");
    Ok(all.filter(is_wanted).collect())
}

/// Sends every pair through query → map, and judges it; tells each on standard error as it is done.
pub fn run(client: &Client, judge: &Judge, corpus: &Corpus, pairs: &[Pair], out: &Path) -> Vec<Judged> {
    let judged = pairs.iter().map(|pair| {
        let outcome = one(client, judge, corpus, pair, out).map_err(|error| error.to_string());
        match &outcome {
            Ok(o) => {
                eprintln!("{:>9} {}: {:.2} %, {:.1} s", pair.kind, pair.name(), o.truth.median_pct, o.query_s + o.map_s)
            }
            Err(error) => eprintln!("{:>9} {}: {error}", pair.kind, pair.name()),
        }
        Judged { pair: pair.clone(), outcome }
    });
    judged.collect()
}

fn one(client: &Client, judge: &Judge, corpus: &Corpus, pair: &Pair, out: &Path) -> Result<Outcome, RunError> {
    let example_file = pair.example.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let missing =
        || RunError::Answer { expected: "the pair's example in the corpus", found: format!("no {example_file}") };
    let example = corpus.ids.get(&example_file).ok_or_else(missing)?;

    let begun = Instant::now();
    let ran = client.run(["--json".as_ref(), "query".as_ref(), pair.input.as_os_str()])?.ok()?;
    let query_s = begun.elapsed().as_secs_f64();
    let events = ran.values().map_err(|found| RunError::Answer { expected: "JSON lines", found })?;
    let query = text_in(events.first().unwrap_or(&Value::Null), "query")?;
    let rank = rank_of(&events, example);

    let mesh = out.join(format!("{}.obj", pair.name()));
    let begun = Instant::now();
    let words =
        ["--json", "map", &query, example, "--force", "-o"].map(AsRef::as_ref).into_iter().chain([mesh.as_os_str()]);
    let map = client.run(words)?.ok()?.last_value();
    let map_s = begun.elapsed().as_secs_f64();
    Ok(Outcome {
        truth: judge.truth(&mesh, &pair.truth)?,
        verdict: text_in(&map, "verdict")?,
        mirrored: is_mirrored(&map)?,
        folds: number_in(&map, "folds")? as u64,
        rank,
        query_s,
        map_s,
    })
}

/// The example's place in the last ranking.
fn rank_of(events: &[Value], example: &str) -> Option<u64> {
    let last = events.iter().rev().find(|event| event["event"] == "level")?;
    let entry = last["entries"].as_array()?.iter().find(|entry| entry["example"] == example)?;
    entry["rank"].as_u64()
}
