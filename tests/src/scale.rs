//! Search at scale, measured from outside: corpora grown, a server started, queries over HTTP.

pub mod process;
pub mod query;

use crate::{
    binaries::{BinaryError, program},
    server::{Server, ServerError},
};
use query::Timed;
use std::{
    io,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

/// Pause between a server's start and its first query: what it does after it is ready shall not be measured.
const SETTLE: Duration = Duration::from_millis(500);

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// A program is missing.
    #[error(transparent)]
    Binary(#[from] BinaryError),
    /// No server.
    #[error(transparent)]
    Server(#[from] ServerError),
    /// A file or a connection.
    #[error("expected to {doing}, found {source}")]
    Io {
        /// What was tried.
        doing: String,
        /// What the system said.
        source: io::Error,
    },
    /// An answer that is none.
    #[error("expected {expected}, found {found}")]
    Answer {
        /// What was asked for.
        expected: &'static str,
        /// What came.
        found: String,
    },
}

/// What a corpus of one size came to.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Segments.
    pub count: usize,
    /// From the start of the server until it was ready, the second time it opened the corpus.
    pub ready: Duration,
    /// Queries, the quickest of each input.
    pub queries: Vec<Timed>,
    /// From the deletion of a query under way until the server computed no more.
    pub cancelled: Duration,
    /// Resident after all of it, in bytes, and the most it ever was.
    pub resident: [u64; 2],
    /// Bytes on disk, and those of them in the index.
    pub disk: [u64; 2],
}

/// Grows a corpus to `count` segments in its folder below `corpora`, unless it has them.
///
/// # Errors
/// [`ScaleError`].
pub fn grown(corpora: &Path, count: usize, meshes: &Path) -> Result<PathBuf, ScaleError> {
    let data = corpora.join(format!("corpus-{count}"));
    let count = count.to_string();
    let status = Command::new(program("quadmuse-server")?)
        .args(["bench-corpus", "--count", &count, "--data"])
        .arg(&data)
        .arg("--meshes")
        .arg(meshes)
        .stdout(Stdio::null())
        .status()
        .map_err(|source| ScaleError::Io { doing: "grow a corpus".into(), source })?;
    if status.success() {
        return Ok(data);
    }
    Err(ScaleError::Answer { expected: "bench-corpus to grow a corpus", found: status.to_string() })
}

/// Starts a server on a corpus, puts each input `times` times, cancels one, and looks at the process and the disk.
///
/// # Errors
/// [`ScaleError`].
pub fn measure(data: &Path, count: usize, inputs: &[PathBuf], times: usize) -> Result<Measured, ScaleError> {
    // The first start after the corpus has grown makes what later ones find.
    let mut first = Server::start(data)?;
    let ended = first.terminate(Duration::from_secs(60));
    ended.map_err(|source| ScaleError::Io { doing: "end the first server".into(), source })?;
    drop(first);
    let begun = Instant::now();
    let server = Server::start(data)?;
    let ready = begun.elapsed();
    std::thread::sleep(SETTLE);
    let mut queries = Vec::new();
    for input in inputs {
        let body = std::fs::read(input)
            .map_err(|source| ScaleError::Io { doing: format!("read {}", input.display()), source })?;
        let name = input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut timed = Vec::new();
        for _ in 0..times {
            timed.push(query::timed(&server, &name, &body)?);
        }
        queries.extend(timed.into_iter().min_by(|a, b| a.total_ms.total_cmp(&b.total_ms)));
    }
    let input = inputs.first().map(std::fs::read).transpose();
    let input = input.map_err(|source| ScaleError::Io { doing: "read the first input".into(), source })?;
    let cancelled = query::cancelled(&server, &input.unwrap_or_default())?;
    let resident = process::resident(server.id());
    let disk = [process::disk(data), process::disk(&data.join("index"))];
    Ok(Measured { count, ready, queries, cancelled, resident, disk })
}

/// The measurements as a table.
pub fn table(all: &[Measured]) -> String {
    let mut lines = vec![
        "| N | input | ready s | encode | first ranking after it | 32² | 64² | 128² | finish | end | end, its processor time \
         | deleted → idle | resident MiB (most) | disk KiB a segment (index) |"
            .to_owned(),
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|".to_owned(),
    ];
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    for m in all {
        let [resident, most] = m.resident.map(mib);
        let [disk, index] = m.disk.map(|bytes| bytes as f64 / 1024.0 / m.count.max(1) as f64);
        for q in &m.queries {
            let levels: Vec<String> = q.levels.iter().map(|(ms, entries)| format!("{ms:.0} ({entries})")).collect();
            let mut levels = levels.into_iter();
            let mut level = || levels.next().unwrap_or_default();
            let cells = [
                m.count.to_string(),
                q.name.clone(),
                format!("{:.1}", m.ready.as_secs_f64()),
                format!("{:.0}", q.encode_ms),
                format!("{:.1}", q.first_ms),
                level(),
                level(),
                level(),
                level(),
                format!("{:.0}", q.total_ms),
                format!("{:.0}", q.cpu_ms),
                format!("{:.0}", m.cancelled.as_secs_f64() * 1e3),
                format!("{resident:.0} ({most:.0})"),
                format!("{disk:.0} ({index:.0})"),
            ];
            lines.push(format!("| {} |", cells.join(" | ")));
        }
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_a_line_for_each_query_and_as_many_cells_as_heads() {
        let timed = Timed {
            name: "head".into(),
            encode_ms: 100.0,
            first_ms: 7.25,
            levels: vec![(250.0, 128), (120.0, 64), (40.0, 4), (900.0, 4)],
            total_ms: 1500.0,
            cpu_ms: 2500.0,
        };
        let measured = Measured {
            count: 1000,
            ready: Duration::from_millis(500),
            queries: vec![timed.clone(), timed],
            cancelled: Duration::from_millis(12),
            resident: [100 << 20, 200 << 20],
            disk: [102_400_000, 92_160_000],
        };
        let table = table(&[measured]);
        let cells: Vec<usize> = table.lines().map(|line| line.matches('|').count()).collect();
        assert_eq!(cells, [15; 4]);
        assert!(table.contains("| 250 (128) | 120 (64) | 40 (4) | 900 (4) |") && table.contains("100 (90)"), "{table}");
    }
}
