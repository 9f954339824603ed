//! The demo: a service of its own, the sample corpus, a scan, a ranking that refines, and the example's quads on it.

use super::Sample;
use super::samples::upload;
use crate::config::Config;
use crate::service::{self, Running, StartError};
use crate::work::engine::kernel::KernelEngine;
use crate::work::engine::{Cut, EngineError, ExtraParts, Registration};
use crate::work::ingest::{self, Annotation, Upload};
use crate::work::picture::{Palette, Picture, Poles, View, Wires, render, side_by_side_captioned};
use crate::work::query::{Board, LiveQuery, QueryOptions};
use crate::work::{Caller, Work, WorkError, mapping, search};
use nalgebra::Matrix3;
use quadmuse_kernel::mesh::{Format, PolyMesh, Vec3, write};
use quadmuse_proto::{EntryState, NewMap, Verdict};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Entries of the ranking that are printed.
const ROWS: usize = 6;
/// Side of each picture, in pixels.
const PICTURE_SIDE: u32 = 720;
/// Longest wait for the end of a ranking.
const QUERY_TIME_MAX: Duration = Duration::from_secs(120);

/// Why the demo did not end.
#[derive(Debug, thiserror::Error)]
pub enum TourError {
    /// The service did not start.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The service refused something.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A sample could not be written as a file.
    #[error(transparent)]
    Mesh(#[from] quadmuse_kernel::mesh::MeshError),
    /// The ranking is empty.
    #[error("expected the ranking of {0} to hold an entry, found none")]
    NoEntry(String),
    /// A file can't be written.
    #[error("expected to write {}, found that the system refuses: {source}; give another directory by --out", path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Runs the demo; results go to `out`.
///
/// # Errors
/// [`TourError`].
pub async fn run(out: &Path, data: &Path) -> Result<Running, TourError> {
    let began = Instant::now();
    std::fs::create_dir_all(out).map_err(|source| TourError::File { path: out.into(), source })?;
    let config = Config::local(data.into());
    let running = service::start(&config, Arc::new(KernelEngine::default())).await?;
    say(&format!("A service of its own listens on http://{}", running.address));
    let samples = super::corpus();
    add_all(&running.work, &samples).await?;
    let inputs = super::inputs();
    let mut written = vec![put_all(&out.join("examples"), &samples)?, put_all(&out.join("scans"), &inputs)?];
    for input in &inputs {
        written.extend(quadrangulate(&running.work, &samples, input, out).await?);
    }
    say("\nWritten:");
    for path in &written {
        say(&format!("  {}", path.display()));
    }
    say(&format!("{:.1} seconds in all.", began.elapsed().as_secs_f64()));
    Ok(running)
}

async fn add_all(work: &Arc<Work>, samples: &[Sample]) -> Result<(), TourError> {
    let start = Instant::now();
    for sample in samples {
        let annotation =
            Annotation { name: sample.name.clone(), tags: sample.tags.clone(), relevance: f64::from(sample.relevance) };
        let cut = Cut { besides: ExtraParts::Sought, ..Cut::default() };
        let upload = Upload { cut, ..upload(&sample.mesh)? };
        ingest::add(work, Caller::default(), upload, annotation).await?;
    }
    let quads: usize = samples.iter().map(|s| s.mesh.faces.len()).sum();
    let seconds = start.elapsed().as_secs_f64();
    say(&format!("{} examples with {quads} quads, unfolded and stored in {seconds:.1} s\n", samples.len()));
    Ok(())
}

/// Ranks the corpus for an input, maps the best example on it, writes the mesh and its picture.
async fn quadrangulate(
    work: &Arc<Work>,
    samples: &[Sample],
    input: &Sample,
    out: &Path,
) -> Result<Vec<PathBuf>, TourError> {
    let triangles = input.mesh.faces.len();
    say(&format!("── {}: {triangles} triangles, in a pose and size of its own", input.name));
    let options =
        QueryOptions { top: 4, resolution: 128, deadline: Some(QUERY_TIME_MAX), tags: Vec::new(), like: None };
    let live = search::start(work, Caller::default(), upload(&input.mesh)?, options).await?;
    follow(&live).await;
    let board = live.board();
    let best = board.rankings.first().and_then(|r| r.candidates.first()).cloned();
    let best = best.ok_or_else(|| TourError::NoEntry(input.name.clone()))?;
    let wanted = NewMap::new(0, best.resident.example.id, best.resident.segment);
    let map = mapping::create(work, &live, wanted).await?;
    let state = map.newest();
    let name = best.resident.example.name.clone();
    let summary = &state.summary;
    say(&format!(
        "   {name}'s {} quads on it: verdict {}, {} faces turned over, {:.0} ms\n",
        summary.faces,
        word(summary.verdict),
        summary.folds,
        summary.timings.total_ms
    ));
    let stem = out.join(&input.name);
    let mesh_path = stem.with_extension("obj");
    put(&mesh_path, &write(&state.mapped.mesh, Format::Obj)?)?;
    let example = samples.iter().find(|s| s.name == name).map_or(&state.mapped.mesh as &PolyMesh, |s| &s.mesh);
    let picture_path = stem.with_extension("png");
    let mirrored = is_mirror(&state.mapped.registration);
    put(&picture_path, &picture(example, &input.mesh, &state.mapped.mesh, mirrored, &name).to_png())?;
    Ok(vec![mesh_path, picture_path])
}

/// Writes samples to a folder, each as NAME.obj, for whoever wants to go on with them; answers with the folder.
///
/// # Errors
/// [`TourError::File`], [`TourError::Mesh`].
pub(super) fn put_all(folder: &Path, samples: &[Sample]) -> Result<PathBuf, TourError> {
    std::fs::create_dir_all(folder).map_err(|source| TourError::File { path: folder.into(), source })?;
    for sample in samples {
        put(&folder.join(&sample.name).with_extension("obj"), &write(&sample.mesh, Format::Obj)?)?;
    }
    Ok(folder.into())
}

/// Prints the ranking each time it is refined.
async fn follow(live: &Arc<LiveQuery>) {
    let mut seen = 0;
    loop {
        let board = live.wait_for(|board| board.revision > seen).await;
        if board.revision > seen {
            seen = board.revision;
            print_ranking(&board);
        }
        if board.state.is_final() && live.board().revision == seen {
            return;
        }
    }
}

fn print_ranking(board: &Board) {
    let Some(ranking) = board.rankings.first() else { return };
    let took: f64 = board.timings.levels.last().map_or(0.0, |t| t.ms);
    say(&format!("   at {0}² pixels, {1} examples, {took:.0} ms", ranking.level, ranking.candidates.len()));
    for (rank, entry) in ranking.candidates.iter().take(ROWS).enumerate() {
        let state = match entry.state {
            EntryState::Refining => "refining",
            EntryState::Done => "done",
            EntryState::Locked => "locked",
        };
        say(&format!("     {:>2}  {:<22} {:>8.4}  {state}", rank + 1, entry.resident.example.name, entry.score));
    }
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Good => "good",
        Verdict::Fair => "fair",
        Verdict::Poor => "poor",
        Verdict::Broken => "broken",
    }
}

fn is_mirror(registration: &Registration) -> bool {
    registration.flip.u != registration.flip.v
}

/// The example, the scan, and the example's quads on the scan, all from the same side.
fn picture(example: &PolyMesh, scan: &PolyMesh, mapped: &PolyMesh, mirrored: bool, name: &str) -> Picture {
    let before = View::guess(example);
    let turn = rotation_between(example, mapped, mirrored);
    let after = View { up: turn * before.up, front: turn * before.front, ..before };
    let bare = View { wires: Wires::Hidden, poles: Poles::Unmarked, ..after }.with_palette(Palette::scan());
    let pictures = [
        render(example, &before, PICTURE_SIDE),
        render(scan, &bare, PICTURE_SIDE),
        render(mapped, &after, PICTURE_SIDE),
    ];
    let captions = [format!("example: {name}"), "scan".to_owned(), "its quads on the scan".to_owned()];
    let row: Vec<(&Picture, &str)> = pictures.iter().zip(captions.iter().map(String::as_str)).collect();
    side_by_side_captioned(&row)
}

/// The rotation that best carries the example's vertices to the mapped ones (Kabsch); a mirrored map is turned back
/// first.
fn rotation_between(example: &PolyMesh, mapped: &PolyMesh, mirrored: bool) -> Matrix3<f64> {
    let centre = |mesh: &PolyMesh| mesh.positions.iter().sum::<Vec3>() / mesh.positions.len().max(1) as f64;
    let (a, b) = (centre(example), centre(mapped));
    let flip = if mirrored { Matrix3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0)) } else { Matrix3::identity() };
    let mut spread = Matrix3::zeros();
    for (p, q) in example.positions.iter().zip(&mapped.positions) {
        spread += (q - b) * (flip * (p - a)).transpose();
    }
    let svd = spread.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    let sign = if (u * v_t).determinant() < 0.0 { -1.0 } else { 1.0 };
    u * Matrix3::from_diagonal(&Vec3::new(1.0, 1.0, sign)) * v_t * flip
}

fn put(path: &Path, bytes: &[u8]) -> Result<(), TourError> {
    std::fs::write(path, bytes).map_err(|source| TourError::File { path: path.into(), source })
}

/// Prints a line for the user. A closed pipe is no failure of the demo.
fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::inputs;
    use quadmuse_kernel::mesh::{Limits, read};

    #[test]
    fn the_samples_are_there_as_files_that_can_be_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let samples = inputs();
        let written = put_all(&folder.path().join("scans"), &samples).expect("writes");
        for sample in samples {
            let bytes = std::fs::read(written.join(&sample.name).with_extension("obj")).expect("is there");
            let read = read(&bytes, None, &Limits::default());
            assert_eq!(read.expect("a mesh").faces.len(), sample.mesh.faces.len(), "{}", sample.name);
        }
    }

    #[test]
    fn the_rotation_of_a_turned_mesh_is_found() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
        let example = PolyMesh { positions: points.map(Vec3::from).to_vec(), ..PolyMesh::default() };
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 1.9);
        let mapped =
            PolyMesh { positions: example.positions.iter().map(|p| turn * p * 2.0).collect(), ..PolyMesh::default() };
        assert!((rotation_between(&example, &mapped, false) - turn.matrix()).norm() < 1e-9);
    }
}
