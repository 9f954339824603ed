//! Scans without a truth: retopologised in one go, judged by soundness and distance.

use super::{Extent, RunError, corpus::primitives, number_in, text_in};
use crate::{
    client::Client,
    judge::{Judge, Soundness},
};
use std::{path::Path, time::Instant};

/// The scans of a subset.
const SUBSET: [&str; 3] = ["hand_lowres.obj", "leeperrysmith_head.ply", "demosthenes_head.obj"];

/// What came of a scan.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The judgement.
    pub soundness: Soundness,
    /// The service's own verdict.
    pub verdict: String,
    /// The name of the example that was laid on it.
    pub example: String,
    /// Folded faces, as the service counts them.
    pub folds: u64,
    /// All of it, in seconds.
    pub seconds: f64,
}

impl Outcome {
    /// Whether the mesh is a manifold of the scan's topology, all faces turned the same way.
    pub fn is_sound(&self, topology: &str) -> bool {
        let s = &self.soundness;
        let (loops, euler) = match topology {
            "disc" => (1, 1),
            "annulus" => (2, 0),
            _ => (0, 2),
        };
        let bad = s.nonmanifold_edges + s.nonmanifold_vertices + s.inconsistent_edges;
        (bad, s.boundary_loops, s.euler) == (0, loops, euler)
    }
}

/// A scan, and what came of it, or why nothing did.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The scan's file name.
    pub name: String,
    /// Its topology.
    pub topology: String,
    /// Its faces.
    pub faces: u64,
    /// What came of it.
    pub outcome: Result<Outcome, String>,
}

/// Sends the scans that are primitives through `retopo`, and judges them; tells each on standard error as it is done.
///
/// # Errors
/// The manifest can't be read.
pub fn run(client: &Client, judge: &Judge, shared: &Path, extent: Extent, out: &Path) -> Result<Vec<Judged>, RunError> {
    let scans = primitives(&shared.join("meshes/scans"))?.into_iter().filter(|(path, _, _)| {
        extent == Extent::All || path.file_name().is_some_and(|name| SUBSET.iter().any(|wanted| name == *wanted))
    });
    let judged = scans.map(|(path, topology, faces)| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let outcome = one(client, judge, &path, out).map_err(|error| error.to_string());
        match &outcome {
            Ok(o) => eprintln!("{name}: {} ({}), {:.1} s", o.example, o.verdict, o.seconds),
            Err(error) => eprintln!("{name}: {error}"),
        }
        Judged { name, topology, faces, outcome }
    });
    Ok(judged.collect())
}

fn one(client: &Client, judge: &Judge, scan: &Path, out: &Path) -> Result<Outcome, RunError> {
    let mesh = out.join(format!("retopo_{}.obj", scan.file_stem().unwrap_or_default().to_string_lossy()));
    let begun = Instant::now();
    let words =
        ["--json".as_ref(), "retopo".as_ref(), scan.as_os_str(), "-o".as_ref(), mesh.as_os_str(), "--force".as_ref()];
    let map = client.run(words)?.ok()?.last_value();
    let seconds = begun.elapsed().as_secs_f64();
    if map["parts"].is_array() {
        // No map follows the scan: what was stitched in its place has no example to name.
        let (verdict, example) = ("composed".to_owned(), "–".to_owned());
        return Ok(Outcome { soundness: judge.soundness(&mesh, scan)?, verdict, example, folds: 0, seconds });
    }
    let example = client.run(["--json", "show", &text_in(&map, "example")?])?.ok()?.last_value();
    Ok(Outcome {
        soundness: judge.soundness(&mesh, scan)?,
        verdict: text_in(&map, "verdict")?,
        example: text_in(&example, "name")?,
        folds: number_in(&map, "folds")? as u64,
        seconds,
    })
}
