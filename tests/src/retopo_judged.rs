//! `retopo` of whole bodies, animals and objects of any genus, judged from outside.

pub mod bodies;
pub mod table;

use crate::{
    client::Client,
    http,
    judge::{Judge, Soundness},
    real_input::RunError,
    server::Server,
    shared::{column, csv},
};
use bodies::Body;
use serde_json::Value;
use std::{
    collections::BTreeMap,
    ffi::OsStr,
    path::{Path, PathBuf},
    time::Instant,
};

/// Mean distance to the input up to which a result is close, in % of the diagonal.
pub const DISTANCE_MAX_PCT: f64 = 0.25;
/// By how much the mean deviation from right angles may be above that of the examples used, in degrees.
pub const ANGLE_MORE_MAX_DEG: f64 = 5.0;

/// What came of a body.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The judgement of the result.
    pub made: Soundness,
    /// Segments of the input.
    pub segments: usize,
    /// Segments that took a regular layout.
    pub templates: usize,
    /// Extraordinary vertices inside the parts, before they were stitched.
    pub extraordinary_before: u64,
    /// Mean deviation from right angles of the examples used; `None` if there is none.
    pub examples_deg: Option<f64>,
    /// What the service has to say.
    pub notes: Vec<String>,
    /// All of it, in seconds.
    pub seconds: f64,
}

/// A body, and what came of it, or why nothing did.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The body.
    pub body: Body,
    /// The judgement of the input by itself.
    pub input: Soundness,
    /// What came of it.
    pub outcome: Result<Outcome, String>,
}

impl Judged {
    /// What a result must be and is not, a word each; empty if all holds.
    pub fn broken(&self) -> Vec<&'static str> {
        let Ok(outcome) = &self.outcome else { return vec!["no result"] };
        let (made, input) = (&outcome.made, &self.input);
        let angle = made.angle_deviation_mean_deg.unwrap_or(90.0);
        let claims = [
            (made.quads == made.faces, "not only quads"),
            (made.nonmanifold_edges + made.nonmanifold_vertices == 0, "not manifold"),
            (made.inconsistent_edges == 0, "not oriented"),
            (made.doublets == 0, "doublets"),
            (made.components == input.components, "components"),
            (made.boundary_loops == input.boundary_loops, "loops"),
            (made.euler == input.euler, "euler"),
            (made.out_to_scan_pct.mean.max(made.scan_to_out_pct.mean) <= DISTANCE_MAX_PCT, "distance"),
            (outcome.examples_deg.is_none_or(|of| angle <= of + ANGLE_MORE_MAX_DEG), "angles"),
        ];
        claims.into_iter().filter(|(holds, _)| !holds).map(|(_, what)| what).collect()
    }
}

/// The corpus: the shared quad meshes; closed ones that are cut whole as well as in parts.
#[derive(Clone, Debug, Default)]
pub struct Corpus {
    /// The file of each example, by its id.
    pub files: BTreeMap<String, PathBuf>,
    /// Files that were refused, each with the reason.
    pub refused: Vec<(String, String)>,
}

/// Adds the shared quad meshes.
///
/// # Errors
/// [`RunError`]; that a file is refused is none.
pub fn fill(client: &Client, shared: &Path) -> Result<Corpus, RunError> {
    let folder = shared.join("meshes/quads");
    let path = folder.join("manifest.csv");
    let text = std::fs::read_to_string(&path).map_err(|source| RunError::File { path, source })?;
    let rows = csv(&text);
    let all: Vec<PathBuf> = rows.iter().map(|row| folder.join(column(row, "file"))).collect();
    let limbed = |row: &&Vec<(String, String)>| ["animal", "body"].contains(&column(row, "category"));
    let cut: Vec<PathBuf> = rows.iter().filter(limbed).map(|row| folder.join(column(row, "file"))).collect();
    let mut corpus = Corpus::default();
    for (words, files) in [(vec!["--json", "add"], all), (vec!["--json", "add", "--parts", "auto"], cut)] {
        let words = words.into_iter().map(OsStr::new).chain(files.iter().map(|file| file.as_os_str()));
        let ran = client.run(words)?;
        let values = ran.values().map_err(|found| RunError::Answer { expected: "JSON lines", found })?;
        if values.is_empty() {
            ran.ok()?;
        }
        for value in values {
            let file = PathBuf::from(value["file"].as_str().unwrap_or_default());
            match value["id"].as_str() {
                Some(id) => drop(corpus.files.insert(id.to_owned(), file)),
                None => {
                    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    corpus.refused.push((name, value["detail"].as_str().unwrap_or_default().to_owned()));
                }
            }
        }
    }
    Ok(corpus)
}

/// What judges and keeps.
#[derive(Debug)]
pub struct Bench<'a> {
    /// The service.
    pub server: &'a Server,
    /// Its client.
    pub client: Client,
    /// The judge.
    pub judge: &'a Judge,
    /// The corpus.
    pub corpus: Corpus,
    /// Where results are written.
    pub out: &'a Path,
    /// Mean deviation of each example that was asked for, by its file.
    pub deviation: BTreeMap<PathBuf, f64>,
}

impl Bench<'_> {
    /// Sends a body through `retopo`, and judges what comes back.
    ///
    /// # Errors
    /// The judge fails on the input.
    pub fn run(&mut self, body: Body, shared: &Path) -> Result<Judged, RunError> {
        let input = shared.join("meshes").join(body.file);
        let judged = self.judge.soundness(&input, &input)?;
        let outcome = self.one(&body, &input).map_err(|error| error.to_string());
        Ok(Judged { body, input: judged, outcome })
    }

    fn one(&mut self, body: &Body, input: &Path) -> Result<Outcome, RunError> {
        let mesh = self.out.join(format!("{}.obj", body.name()));
        let mut words = vec![OsStr::new("--json"), OsStr::new("retopo")];
        words.extend(body.flags.iter().map(OsStr::new));
        words.extend([input.as_os_str(), OsStr::new("-o"), mesh.as_os_str(), OsStr::new("--force")]);
        let begun = Instant::now();
        let answer = self.client.run(words)?.ok()?.last_value();
        let seconds = begun.elapsed().as_secs_f64();
        let made = self.judge.soundness(&mesh, input)?;
        let query = answer["query"].as_str().unwrap_or_default().to_owned();
        let list = |name: &str| answer[name].as_array().cloned().unwrap_or_default();
        let (parts, templates) = (list("parts"), list("templates").len());
        let examples: Vec<String> = if answer["parts"].is_array() {
            parts.iter().filter_map(|part| self.example_of(&query, part["map"].as_str()?)).collect()
        } else {
            answer["example"].as_str().map(str::to_owned).into_iter().collect()
        };
        let deviations: Vec<f64> = examples.iter().filter_map(|id| self.deviation_of(id)).collect();
        let mean = deviations.iter().sum::<f64>() / deviations.len() as f64;
        Ok(Outcome {
            made,
            segments: (parts.len() + templates).max(1),
            templates,
            extraordinary_before: answer["extraordinary_before"].as_u64().unwrap_or_default(),
            examples_deg: (!deviations.is_empty()).then_some(mean),
            notes: list("notes").iter().filter_map(Value::as_str).map(str::to_owned).collect(),
            seconds,
        })
    }

    fn example_of(&self, query: &str, map: &str) -> Option<String> {
        let answer = http::get(self.server.address(), &format!("/v1/queries/{query}/maps/{map}")).ok()?;
        let value: Value = serde_json::from_str(&answer.text()).ok()?;
        value["example"].as_str().map(str::to_owned)
    }

    fn deviation_of(&mut self, example: &str) -> Option<f64> {
        let file = self.corpus.files.get(example)?.clone();
        if let Some(&known) = self.deviation.get(&file) {
            return Some(known);
        }
        let found = self.judge.soundness(&file, &file).ok()?.angle_deviation_mean_deg?;
        self.deviation.insert(file, found);
        Some(found)
    }
}
