//! The judge of meshes: a program that stands beside the shared meshes and knows nothing of how a mesh was made.

use serde::Deserialize;
use std::{
    ffi::OsStr,
    io,
    path::{Path, PathBuf},
    process::Command,
};

/// Why there is no judgement.
#[derive(Debug, thiserror::Error)]
pub enum JudgeError {
    /// Python can't be run.
    #[error(
        "expected to run {python}, found that it cannot be: {source}; set QUADMUSE_PYTHON to a Python with numpy and scipy"
    )]
    Python {
        /// What was tried.
        python: String,
        /// What the system says.
        source: io::Error,
    },
    /// It printed something else than a judgement.
    #[error("expected a judgement of {file}, found: {found}")]
    Judgement {
        /// The mesh.
        file: String,
        /// What was printed.
        found: String,
    },
}

/// A mapped mesh against the truth; distances in % of √area.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Truth {
    /// Whether the faces are the example's, in their order (each up to its first corner).
    pub same_faces: bool,
    /// Median distance of a vertex from where it belongs.
    pub median_pct: f64,
    /// 95th percentile of that.
    pub p95_pct: f64,
    /// Share of the faces that look the other way, in %.
    pub turned_faces_pct: f64,
}

/// A mesh by itself, and against the scan it was laid on.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Soundness {
    /// Vertices that a face uses.
    pub vertices: u64,
    /// Faces.
    pub faces: u64,
    /// Faces with four corners.
    pub quads: u64,
    /// Edges of more than two faces.
    pub nonmanifold_edges: u64,
    /// Vertices whose faces form more than one fan.
    pub nonmanifold_vertices: u64,
    /// Edges that two faces run along in the same direction.
    pub inconsistent_edges: u64,
    /// Boundary loops.
    pub boundary_loops: u64,
    /// Pieces.
    pub components: u64,
    /// Vertices − edges + faces.
    pub euler: i64,
    /// Inner vertices with another number of edges than four.
    pub extraordinary: u64,
    /// Inner vertices with two edges.
    pub doublets: u64,
    /// Mean of a quad's corner angles from 90°.
    pub angle_deviation_mean_deg: Option<f64>,
    /// 95th percentile of a quad's corner angles from 90°.
    pub angle_deviation_p95_deg: Option<f64>,
    /// From the mesh to the scan.
    pub out_to_scan_pct: Distance,
    /// From the scan to the mesh.
    pub scan_to_out_pct: Distance,
}

/// Distances in % of the scan's bounding box diagonal.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Distance {
    /// Mean.
    pub mean: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

/// The judge.
#[derive(Clone, Debug)]
pub struct Judge {
    python: String,
    script: PathBuf,
}

impl Judge {
    /// The judge in the shared folder; `None` if it is missing, or Python with what it needs is.
    fn find(shared: &Path) -> Option<Self> {
        let python = std::env::var("QUADMUSE_PYTHON").unwrap_or_else(|_| "python3".into());
        let script = shared.join("eval/judge.py");
        let has_needed = Command::new(&python).args(["-c", "import numpy, scipy"]).output();
        let judge = Self { python, script };
        (judge.script.is_file() && has_needed.is_ok_and(|output| output.status.success())).then_some(judge)
    }

    /// The judge; says on standard error that `what` is left out if there is none.
    pub fn find_or_say(shared: &Path, what: &str) -> Option<Self> {
        let found = Self::find(shared);
        if found.is_none() {
            eprintln!("no judge: {what} needs a Python with numpy and scipy (QUADMUSE_PYTHON); left out");
        }
        found
    }

    /// Judges a mapped mesh against the truth.
    ///
    /// # Errors
    /// [`JudgeError`].
    pub fn truth(&self, out: &Path, truth: &Path) -> Result<Truth, JudgeError> {
        self.ask(out, &[OsStr::new("truth"), out.as_os_str(), truth.as_os_str()])
    }

    /// Judges a mesh by itself, and against the scan it was laid on.
    ///
    /// # Errors
    /// [`JudgeError`].
    pub fn soundness(&self, out: &Path, scan: &Path) -> Result<Soundness, JudgeError> {
        self.ask(out, &[OsStr::new("mesh"), out.as_os_str(), OsStr::new("--input"), scan.as_os_str()])
    }

    fn ask<T: for<'a> Deserialize<'a>>(&self, file: &Path, words: &[&OsStr]) -> Result<T, JudgeError> {
        let output = Command::new(&self.python)
            .arg(&self.script)
            .args(words)
            .output()
            .map_err(|source| JudgeError::Python { python: self.python.clone(), source })?;
        serde_json::from_slice(&output.stdout).map_err(|_| {
            let found = [output.stdout.as_slice(), output.stderr.as_slice()].concat();
            let found = String::from_utf8_lossy(&found).trim().to_owned();
            JudgeError::Judgement { file: file.display().to_string(), found }
        })
    }
}
