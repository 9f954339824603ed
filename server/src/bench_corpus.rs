//! A corpus of any size to measure search with: real encodings, and as many made-up relatives of theirs as wanted.
//!
//! The same seed gives the same corpus, segment by segment, so that a corpus can be grown. What is searched (pyramids,
//! features, moduli) is whole; the *mesh* of a made-up segment is a stub, so that nothing sensible can be mapped from it.

mod variant;

use crate::demo;
use crate::pool::Stop;
use crate::work::corpus::stored::StoredCorpus;
use crate::work::corpus::{CorpusError, NewExample};
use crate::work::engine::{Cut, Engine, EngineError, PackedEncoding};
use clap::Args;
use quadmuse_kernel::mesh::{Format, write};
use quadmuse_proto::query::{LEVELS, RESOLUTION_DEFAULT};
use quadmuse_proto::{MeshCounts, Topology};
use quadmuse_store::{OpenOptions, StoreError};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Segments added by one commit.
const BATCH: usize = 64;
/// Variants of one source in a row.
const RUN: usize = 64;
/// Threads beside those that compute: some always wait for the disk.
const WAITING_THREADS: usize = 2;
/// Names of files that hold meshes end so.
const MESH_EXTENSIONS: [&str; 5] = ["obj", "ply", "off", "stl", "glb"];

/// The flags of `bench-corpus`.
#[derive(Clone, Debug, Args)]
pub struct BenchCorpusArgs {
    /// Directory of the store; created if it is not there. Only ever use one of its own: most meshes in it are stubs.
    #[arg(long)]
    pub data: PathBuf,
    /// Segments that the corpus shall have; a smaller one is grown.
    #[arg(long)]
    pub count: usize,
    /// Folders of meshes whose encodings are varied (default: the built-in samples).
    #[arg(long, value_name = "DIR")]
    pub meshes: Vec<PathBuf>,
    /// Only sources of this topology.
    #[arg(long, default_value = "disc")]
    pub topology: Topology,
    /// The finest level that is warped, in pixels a side: the one that a query reaches by default. Finer levels are those
    /// of the source, which are costly to warp and to pack, and only take their place on the disk.
    #[arg(long, value_name = "SIDE", default_value_t = RESOLUTION_DEFAULT)]
    pub warped: u32,
    /// Leave out levels finer than this, in pixels a side: for measures of the coarsest ranking alone.
    #[arg(long, value_name = "SIDE", default_value_t = FINEST)]
    pub finest: u32,
    /// What the variations are drawn from.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Stop after so many seconds, to be grown another time.
    #[arg(long, value_name = "SECONDS")]
    pub time: Option<u64>,
}

/// The finest level there is.
const FINEST: u32 = LEVELS[LEVELS.len() - 1];

/// Why no corpus was made.
#[derive(Debug, thiserror::Error)]
pub enum BenchCorpusError {
    /// The store refused or failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The corpus refused or failed.
    #[error(transparent)]
    Corpus(#[from] CorpusError),
    /// A sample can't be written.
    #[error(transparent)]
    Mesh(#[from] quadmuse_kernel::mesh::MeshError),
    /// The system gives no threads.
    #[error("expected threads from the system, found none: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A folder can't be read.
    #[error("expected to read {}, found {source}", path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// No mesh could be encoded.
    #[error("expected at least one mesh with a segment of topology {0}, found none")]
    NoSource(Topology),
}

/// An encoding to vary.
struct Source {
    name: String,
    packed: PackedEncoding,
}

/// Counts the encodings that were varied, and the segments before and after.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BenchCorpusReport {
    /// Encodings that were varied; none where there were segments enough.
    pub sources: usize,
    /// Segments there were.
    pub before: usize,
    /// Segments there are.
    pub after: usize,
}

/// Grows the corpus; `say` is told how far it is.
///
/// # Errors
/// [`BenchCorpusError`].
pub fn run(
    args: &BenchCorpusArgs,
    engine: &dyn Engine,
    say: &(dyn Fn(usize) + Sync),
) -> Result<BenchCorpusReport, BenchCorpusError> {
    let begun = Instant::now();
    let (corpus, report) = StoredCorpus::open(&args.data, &OpenOptions::default())?;
    let before = report.examples;
    if before >= args.count {
        return Ok(BenchCorpusReport { sources: 0, before, after: before });
    }
    let sources = sources(args, engine)?;
    let late = || args.time.is_some_and(|limit| begun.elapsed() > Duration::from_secs(limit));
    let threads = std::thread::available_parallelism().map_or(1, usize::from) + WAITING_THREADS;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let mut after = before;
    let per_round = BATCH * threads;
    while after < args.count && !late() {
        let round = after..args.count.min(after + per_round);
        let numbers: Vec<usize> = round.clone().collect();
        let add = |numbers: &[usize]| {
            let made = numbers.iter().map(|&number| example(&sources, number, args, engine.version()));
            corpus.put_all(made.collect()).map(drop)
        };
        pool.install(|| numbers.par_chunks(BATCH).try_for_each(add))?;
        after = round.end;
        say(after);
    }
    Ok(BenchCorpusReport { sources: sources.len(), before, after })
}

/// Example `number` of the corpus: the sources themselves first, then their variants, a run of each in turn.
fn example(sources: &[Source], number: usize, args: &BenchCorpusArgs, encoder_version: u32) -> NewExample {
    let seed = args.seed;
    let of_its_own = number < sources.len();
    // Levels that are alike are packed once a commit.
    let source = &sources[if of_its_own { number } else { number / RUN % sources.len() }];
    let mut packed = match of_its_own {
        true => source.packed.clone(),
        false => {
            let seed = seed ^ (number as u64).wrapping_mul(0xd134_2543_de82_ef95);
            variant::variant(&source.packed, args.warped, seed)
        }
    };
    packed.levels.retain(|(side, _)| *side <= args.finest);
    let name = format!("{} #{number}", source.name);
    let stub = format!("# stands for segment {number}, seed {seed}\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
    NewExample {
        tags: vec!["bench".into(), format!("one-in-ten-{}", number % 10)],
        relevance: (number % 6) as f64,
        bytes: stub.into(),
        format: "obj".into(),
        cut: Cut::default(),
        counts: MeshCounts { vertices: 4, faces: packed.facts.faces, triangles: 0, quads: packed.facts.faces },
        repairs: Vec::new(),
        segments: vec![packed],
        encoder_version,
        name,
    }
}

fn sources(args: &BenchCorpusArgs, engine: &dyn Engine) -> Result<Vec<Source>, BenchCorpusError> {
    let mut meshes: Vec<(String, Vec<u8>)> = Vec::new();
    for folder in &args.meshes {
        meshes.extend(files_in(folder).map_err(|source| BenchCorpusError::Folder { path: folder.clone(), source })?);
    }
    if args.meshes.is_empty() {
        for sample in demo::corpus() {
            meshes.push((sample.name, write(&sample.mesh, Format::Obj)?));
        }
    }
    // A mesh that can't be read or encoded is no source; what it lacks is for other commands to say.
    let encoded = |(name, bytes): &(String, Vec<u8>)| encode(name, bytes, args.topology, engine).unwrap_or_default();
    let sources: Vec<Source> = meshes.par_iter().flat_map_iter(encoded).collect();
    if sources.is_empty() { Err(BenchCorpusError::NoSource(args.topology)) } else { Ok(sources) }
}

fn encode(name: &str, bytes: &[u8], topology: Topology, engine: &dyn Engine) -> Result<Vec<Source>, EngineError> {
    let stop = Stop::new(None);
    let model = engine.read(bytes, None, &Cut::default(), &stop)?;
    let fitting = (0u32..).zip(&model.segments).filter(|(_, segment)| segment.topology == topology);
    let source = |segment: u32| -> Result<Source, EngineError> {
        let packed = engine.pack(&engine.encode(&model, segment, &stop)?.encoding)?;
        Ok(Source { name: name.to_owned(), packed })
    };
    Ok(fitting.filter_map(|(segment, _)| source(segment).ok()).collect())
}

fn files_in(folder: &Path) -> std::io::Result<Vec<(String, Vec<u8>)>> {
    let is_mesh = |path: &PathBuf| {
        path.extension().is_some_and(|found| MESH_EXTENSIONS.iter().any(|known| found.eq_ignore_ascii_case(known)))
    };
    let entries = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).filter(is_mesh).collect();
    paths.sort();
    let read = |path: PathBuf| {
        let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Ok((name, std::fs::read(path)?))
    };
    paths.into_iter().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::corpus::Corpus;
    use crate::work::engine::kernel::KernelEngine;

    #[test]
    fn a_corpus_grows_to_the_size_asked_for_and_is_the_same_in_one_go_or_two() {
        let (one, two) = (tempfile::tempdir().expect("a directory"), tempfile::tempdir().expect("a directory"));
        let meshes = tempfile::tempdir().expect("a directory");
        let dome = demo::corpus().into_iter().find(|s| s.tags.iter().any(|t| t == "disc")).expect("a disc");
        std::fs::write(meshes.path().join("dome.obj"), write(&dome.mesh, Format::Obj).expect("obj")).expect("written");
        let grow = |data: &Path, count: usize| {
            let args = BenchCorpusArgs {
                data: data.to_path_buf(),
                count,
                meshes: vec![meshes.path().to_path_buf()],
                topology: Topology::Disc,
                warped: 128,
                finest: 512,
                seed: 3,
                time: None,
            };
            run(&args, &KernelEngine::default(), &|_| ()).expect("made")
        };
        assert_eq!(grow(one.path(), 5), BenchCorpusReport { sources: 1, before: 0, after: 5 });
        grow(two.path(), 2);
        assert_eq!(grow(two.path(), 5), BenchCorpusReport { sources: 1, before: 2, after: 5 });
        assert_eq!(grow(two.path(), 4), BenchCorpusReport { sources: 0, before: 5, after: 5 });
        let listed = |data: &Path| {
            let (corpus, _) = StoredCorpus::open(data, &OpenOptions::default()).expect("a store");
            let level = |id| corpus.encoding(id, 0, 64).expect("an encoding");
            let mut all: Vec<_> = corpus.list().iter().map(|e| (e.name.clone(), e.hash.clone(), level(e.id))).collect();
            all.sort_by(|a, b| a.0.cmp(&b.0));
            all
        };
        assert_eq!(listed(one.path()), listed(two.path()));
    }
}
