//! How good the ranking is on labelled real meshes: P@1, P@4 and MAP, same identity excluded.
//!
//! `ranking_precision [--resolution R]`; the meshes stand at `../shared` or `QUADMUSE_SHARED`. The corpus are the quad
//! meshes and the examples of the ground-truth pairs; queries are the pairs' inputs, remeshed shapes in any pose. An
//! entry is right if it is of the input's category, and doesn't count if it is of the very shape of the input.

use quadmuse_tests::{
    client::Client,
    real_input::{
        Extent, RunError, corpus,
        pairs::{self, Pair},
    },
    server::Server,
    shared::{column, csv},
    tool,
};
use std::{collections::BTreeMap, path::Path, process::ExitCode};

/// Entries of a page that a user looks at.
const PAGE: usize = 4;

/// What one query came to.
struct Judged {
    name: String,
    category: String,
    first: f64,
    page: f64,
    average: f64,
}

fn main() -> ExitCode {
    let resolution = std::env::args().skip_while(|word| word != "--resolution").nth(1).unwrap_or_else(|| "128".into());
    tool::run(Ok(resolution), "the ranking's precision", |resolution, shared| {
        println!("{}", table(&run(shared, resolution)?));
        Ok::<_, RunError>(ExitCode::SUCCESS)
    })
}

fn run(shared: &Path, resolution: &str) -> Result<Vec<Judged>, RunError> {
    let folder = tempfile::tempdir().map_err(|source| RunError::File { path: "a temporary folder".into(), source })?;
    let server = Server::start(&folder.path().join("data"))?;
    let client = Client::new(server.url());
    let pairs = pairs::pairs(shared, Extent::All)?;
    let corpus = corpus::fill(&client, shared, &pairs, Extent::All)?;
    let labels = labels(shared, &pairs)?;
    let of_id: BTreeMap<&str, &str> = corpus.ids.iter().map(|(file, id)| (id.as_str(), file.as_str())).collect();
    let mut judged = Vec::new();
    let mut seen = Vec::new();
    for pair in &pairs {
        let identity = identity_of_input(pair);
        if seen.contains(&identity) {
            continue;
        }
        seen.push(identity.clone());
        let words = ["--json", "query", "--resolution", resolution].map(AsRef::as_ref);
        let ran = client.run(words.into_iter().chain([pair.input.as_os_str()]))?.ok()?;
        let events = ran.values().map_err(|found| RunError::Answer { expected: "JSON lines", found })?;
        let last = events.iter().rev().find(|event| event["event"] == "level" && event["segment"] == 0);
        let Some(entries) = last.and_then(|event| event["entries"].as_array()) else { continue };
        let files = entries.iter().filter_map(|entry| of_id.get(entry["example"].as_str()?).copied());
        let others = files.filter(|file| !file.contains(&identity));
        let category = category(&pair.kind);
        let right: Vec<bool> = others.map(|file| labels.get(file).is_some_and(|label| label == category)).collect();
        if right.contains(&true) {
            judged.push(judge(pair, category, &right));
        }
    }
    Ok(judged)
}

/// The category of each file of the corpus.
fn labels(shared: &Path, pairs: &[Pair]) -> Result<BTreeMap<String, String>, RunError> {
    let path = shared.join("meshes/quads/manifest.csv");
    let text = std::fs::read_to_string(&path).map_err(|source| RunError::File { path, source })?;
    let quads =
        csv(&text).into_iter().map(|row| (column(&row, "file").to_owned(), column(&row, "category").to_owned()));
    let examples = pairs.iter().map(|pair| (file_name(&pair.example), category(&pair.kind).to_owned()));
    Ok(quads.chain(examples).collect())
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// A pair's kind says how it was made; this is what it shows.
fn category(kind: &str) -> &str {
    match kind {
        "mirrored" => "hand",
        "pose" => "body",
        other => other,
    }
}

/// The shape that was remeshed: `input_<example>__<shape>[_mirrored]`.
fn identity_of_input(pair: &Pair) -> String {
    let name = pair.name();
    let shape = name.split_once("__").map_or(name.as_str(), |(_, shape)| shape);
    shape.trim_end_matches("_mirrored").to_owned()
}

fn judge(pair: &Pair, category: &str, right: &[bool]) -> Judged {
    let all = right.iter().filter(|r| **r).count();
    let page = right.iter().take(PAGE).filter(|r| **r).count() as f64 / PAGE.min(all) as f64;
    let mut found = 0;
    let mut sum = 0.0;
    for (rank, _) in (1u32..).zip(right).filter(|(_, right)| **right) {
        found += 1;
        sum += f64::from(found) / f64::from(rank);
    }
    Judged {
        name: pair.name(),
        category: category.to_owned(),
        first: f64::from(u8::from(right.first() == Some(&true))),
        page,
        average: sum / all as f64,
    }
}

fn table(judged: &[Judged]) -> String {
    let mut lines = vec!["| input | category | P@1 | P@4 | AP |".to_owned(), "|---|---|---|---|---|".to_owned()];
    let line = |name: &str, category: &str, values: [f64; 3]| {
        let [first, page, average] = values.map(|value| format!("{value:.2}"));
        format!("| {name} | {category} | {first} | {page} | {average} |")
    };
    let values = |one: &Judged| [one.first, one.page, one.average];
    lines.extend(judged.iter().map(|one| line(&one.name, &one.category, values(one))));
    let mut categories: Vec<&str> = judged.iter().map(|one| one.category.as_str()).collect();
    categories.sort_unstable();
    categories.dedup();
    let mean_of = |wanted: &dyn Fn(&Judged) -> bool| {
        let these: Vec<[f64; 3]> = judged.iter().filter(|one| wanted(one)).map(values).collect();
        let mean = |k: usize| these.iter().map(|v| v[k]).sum::<f64>() / these.len().max(1) as f64;
        (these.len(), [mean(0), mean(1), mean(2)])
    };
    for category in categories {
        let (count, means) = mean_of(&|one| one.category == category);
        lines.push(line(&format!("mean of {count}"), category, means));
    }
    let (count, means) = mean_of(&|_| true);
    lines.push(line(&format!("mean of {count}"), "all", means));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair() -> Pair {
        Pair {
            kind: "mirrored".into(),
            triangles: 0,
            noise: String::new(),
            example: "example_hand_1.obj".into(),
            input: "input_hand_1__hand_2_mirrored.obj".into(),
            truth: "truth.obj".into(),
        }
    }

    #[test]
    fn precision_is_of_the_first_entries_and_of_the_whole_order() {
        let judged = judge(&pair(), "hand", &[true, false, true, false, false]);
        assert_eq!((judged.first, judged.page), (1.0, 1.0));
        assert!((judged.average - (1.0 + 2.0 / 3.0) / 2.0).abs() < 1e-12);
        assert_eq!(judge(&pair(), "hand", &[false, true, true, true, true]).page, 0.75);
    }

    #[test]
    fn the_shape_of_an_input_is_the_one_that_was_remeshed() {
        assert_eq!(identity_of_input(&pair()), "hand_2");
        assert_eq!(category("pose"), "body");
    }
}
