//! The same corpus, input and settings give the same ranking, energies and vertices, bit for bit: for any number of
//! threads, any order of insertion, before and after a restart.

use quadmuse_kernel::mesh::{Format, PolyMesh, write};
use quadmuse_proto::{ExampleId, MeshFormat, NewMap, QueryState};
use quadmuse_server::demo::{self, Sample};
use quadmuse_server::pool::{Admission, Pool};
use quadmuse_server::work::corpus::stored::StoredCorpus;
use quadmuse_server::work::engine::Cut;
use quadmuse_server::work::engine::kernel::KernelEngine;
use quadmuse_server::work::ingest::{self, Annotation, Upload};
use quadmuse_server::work::query::QueryOptions;
use quadmuse_server::work::{Caller, Work, mapping, search};
use quadmuse_store::OpenOptions;
use std::path::Path;
use std::sync::Arc;

/// Examples of the corpus: enough that some are passed over at each level.
const EXAMPLES: usize = 7;
/// The finest level, in pixels a side: a query's default, so that every step of one is taken.
const RESOLUTION: u32 = 128;

/// What must not change: name, score, energy and state of each entry, and the vertices of the best map.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Outcome {
    entries: Vec<(String, u64, u64, String)>,
    vertices: Vec<[u64; 3]>,
}

fn upload(mesh: &PolyMesh) -> Upload {
    let bytes = write(mesh, Format::Obj).expect("writable").into();
    Upload { bytes, format: Some(MeshFormat::Obj), cut: Cut::default() }
}

async fn outcome(data: &Path, threads: usize, add: &[&Sample], input: &Sample) -> Outcome {
    let pool = Pool::new(threads, Admission::new(4 << 30, 64)).expect("threads");
    let (corpus, _) = StoredCorpus::open(data, &OpenOptions::default()).expect("a store");
    let work = Work::new(pool, Arc::new(KernelEngine::default()), Arc::new(corpus));
    work.load();
    for sample in add {
        let relevance = f64::from(sample.relevance);
        let annotation = Annotation { name: sample.name.clone(), tags: Vec::new(), relevance };
        ingest::add(&work, Caller::default(), upload(&sample.mesh), annotation).await.expect("added");
    }
    let options = QueryOptions { top: 2, resolution: RESOLUTION, deadline: None, tags: Vec::new(), like: None };
    let live = search::start(&work, Caller::default(), upload(&input.mesh), options).await.expect("started");
    let board = live.wait_for(|_| false).await;
    assert_eq!(board.state, QueryState::Done);
    let ranking = live.ranking(&board, 0, EXAMPLES).expect("a ranking");
    let best: (ExampleId, u32) = (ranking.entries[0].example, ranking.entries[0].example_segment);
    let wanted = NewMap::new(0, best.0, best.1);
    let map = mapping::create(&work, &live, wanted).await.expect("a map");
    let vertices = &map.newest().mapped.mesh.positions;
    let entry = |e: &quadmuse_proto::Entry| {
        (e.name.clone(), e.score.to_bits(), e.energy.to_bits(), format!("{:?} {:?}", e.state, e.flip))
    };
    work.keep_rows();
    Outcome {
        entries: ranking.entries.iter().map(entry).collect(),
        vertices: vertices.iter().map(|p| [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()]).collect(),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn threads_insertion_and_restarts_change_nothing() {
    let mut samples = demo::corpus();
    let fellows = |input: &Sample| samples.iter().filter(|s| s.tags.last() == input.tags.last()).count();
    let input = demo::inputs().into_iter().max_by_key(fellows).expect("an input");
    samples.retain(|s| s.tags.last() == input.tags.last());
    samples.truncate(EXAMPLES);
    assert!(samples.len() > 3, "{}", samples.len());
    let mut first: Option<Outcome> = None;
    for (turn, threads) in [1, 2, 3, 4, 8].into_iter().enumerate() {
        let dir = tempfile::tempdir().expect("a directory");
        let mut order: Vec<&Sample> = samples.iter().collect();
        let by = turn % order.len();
        order.rotate_left(by);
        if turn % 2 == 1 {
            order.reverse();
        }
        let fresh = outcome(dir.path(), threads, &order, &input).await;
        let known = first.get_or_insert_with(|| fresh.clone());
        assert!(*known == fresh, "{threads} threads: {:?}\nand {:?}", known.entries, fresh.entries);
        let again = outcome(dir.path(), 9 - threads, &[], &input).await;
        assert!(*known == again, "after a restart: {:?}\nand {:?}", known.entries, again.entries);
    }
}
