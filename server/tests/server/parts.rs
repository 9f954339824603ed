//! An example that is kept whole and by its parts: a scan that falls into parts takes its quads from these, before a restart and
//! after.

use quadmuse_kernel::mesh::{Format, PolyMesh, write};
use quadmuse_proto::{
    Beyond, CompositionPart, Example, ExampleId, MeshFormat, NewComposition, NewMap, Parts, QueryState, Ranking,
};
use quadmuse_server::demo;
use quadmuse_server::pool::{Admission, Pool};
use quadmuse_server::work::composing::{self, LiveComposition};
use quadmuse_server::work::corpus::stored::StoredCorpus;
use quadmuse_server::work::engine::kernel::KernelEngine;
use quadmuse_server::work::engine::{Cut, ExtraParts};
use quadmuse_server::work::ingest::{self, Annotation, Upload};
use quadmuse_server::work::query::{LiveQuery, QueryOptions};
use quadmuse_server::work::{Caller, Work, mapping, search};
use quadmuse_store::{OpenOptions, StoreError};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn upload(mesh: &PolyMesh, cut: Cut) -> Upload {
    let bytes = write(mesh, Format::Obj).expect("writable").into();
    Upload { bytes, format: Some(MeshFormat::Obj), cut }
}

/// Looks at a store that the one before may still be closing.
const OPENINGS_MAX: usize = 3000;

async fn opened(data: &Path) -> Arc<Work> {
    let pool = Pool::new(2, Admission::new(4 << 30, 64)).expect("threads");
    let mut found = StoredCorpus::open(data, &OpenOptions::default());
    for _ in 0..OPENINGS_MAX {
        if !matches!(found, Err(StoreError::Locked { .. })) {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
        found = StoredCorpus::open(data, &OpenOptions::default());
    }
    let (corpus, _) = found.expect("a store");
    let work = Work::new(pool, Arc::new(KernelEngine::default()), Arc::new(corpus));
    work.load();
    work
}

async fn added(work: &Arc<Work>, name: &str) -> Arc<Example> {
    let sample = demo::corpus().into_iter().find(|sample| sample.name == name).expect("a sample");
    let annotation = Annotation { name: name.into(), tags: Vec::new(), relevance: 3.0 };
    let cut = Cut { besides: ExtraParts::Sought, ..Cut::default() };
    ingest::add(work, Caller::default(), upload(&sample.mesh, cut), annotation).await.expect("added").0
}

/// A pig as a scan: its quads in triangles, and larger.
fn scan() -> PolyMesh {
    let pig = demo::corpus().into_iter().find(|sample| sample.name == "pig").expect("a pig").mesh;
    let fan = pig.faces.iter().flat_map(|f| (2..f.len()).map(move |k| [f[0], f[k - 1], f[k]]));
    let triangles: Vec<[u32; 3]> = fan.collect();
    PolyMesh {
        positions: pig.positions.iter().map(|x| x * 2.0).collect(),
        faces: triangles.iter().map(|t| &t[..]).collect(),
        ..PolyMesh::default()
    }
}

async fn ranked(work: &Arc<Work>, parts: Option<Parts>) -> (Arc<LiveQuery>, Vec<Ranking>) {
    let options = QueryOptions { top: 2, resolution: 64, deadline: None, tags: Vec::new(), like: None };
    let cut = Cut { parts, ..Cut::default() };
    let live = search::start(work, Caller::default(), upload(&scan(), cut), options).await.expect("started");
    let board = live.wait_for(|_| false).await;
    assert_eq!(board.state, QueryState::Done);
    let ranking = |segment| live.ranking(&board, segment as u32, 9).expect("a ranking");
    let rankings = (0..live.model.segments.len()).map(ranking).collect();
    (live, rankings)
}

fn described(rankings: &[Ranking]) -> Vec<(String, u32, u64)> {
    let entries = rankings.iter().flat_map(|ranking| &ranking.entries);
    entries.map(|e| (e.name.clone(), e.example_segment, e.score.to_bits())).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scan_in_parts_takes_the_parts_of_an_example_that_stands_once_in_each_ranking() {
    let dir = tempfile::tempdir().expect("a directory");
    let work = opened(dir.path()).await;
    let (pig, fish) = (added(&work, "pig").await, added(&work, "fish").await);
    let is_whole: Vec<bool> = pig.segments.iter().map(|segment| !segment.is_part).collect();
    assert!(is_whole[0] && is_whole.len() > 4 && is_whole[1..].iter().all(|whole| !whole), "{:?}", pig.segments);
    assert!(fish.segments[1..].iter().all(|segment| segment.is_part), "{:?}", fish.segments);
    let (live, rankings) = ranked(&work, Some(Parts::Auto)).await;
    assert!(rankings.len() > 4, "{} segments", rankings.len());
    for ranking in &rankings {
        for example in [&pig, &fish] {
            let times = ranking.entries.iter().filter(|entry| entry.example == example.id).count();
            assert!(times <= 1, "{} stands {times} times for segment {}", example.name, ranking.segment);
        }
        assert!((1..=2).contains(&ranking.corpus_size), "{} of 2 examples", ranking.corpus_size);
    }
    // The pig's own parts are the best for parts of a pig, and lie there with their own faces.
    let of_parts =
        rankings.iter().filter_map(|r| r.entries.first()).filter(|e| e.example == pig.id && e.example_segment > 0);
    assert!(of_parts.count() * 2 > rankings.len(), "{:?}", described(&rankings));
    let first = rankings.iter().find(|r| r.entries.first().is_some_and(|e| e.example_segment > 0)).expect("a part");
    let (segment, example, example_segment) =
        (first.segment, first.entries[0].example, first.entries[0].example_segment);
    let wanted = NewMap::new(segment, example, example_segment);
    let map = mapping::create(&work, &live, wanted.clone()).await.expect("a map").newest();
    let faces =
        [&pig, &fish].into_iter().find(|e| e.id == example).expect("there").segments[example_segment as usize].faces;
    assert!(map.summary.own_faces > 0 && map.summary.own_faces <= faces, "{} of {faces}", map.summary.own_faces);
    // Whole, it is compared with what is whole.
    let (_, whole) = ranked(&work, None).await;
    assert_eq!(whole.len(), 1);
    assert!(whole[0].entries.iter().all(|entry| entry.example_segment == 0), "{:?}", described(&whole));
    assert_eq!(whole[0].entries[0].example, pig.id);
    // All of it is the same after a restart.
    work.keep_rows();
    drop((work, live));
    let work = opened(dir.path()).await;
    assert_eq!(*work.catalogue.example(pig.id).expect("there"), *pig);
    let (live, again) = ranked(&work, Some(Parts::Auto)).await;
    assert_eq!(described(&again), described(&rankings));
    let after = mapping::create(&work, &live, wanted).await.expect("a map").newest();
    assert_eq!(after.mapped.mesh.positions, map.mapped.mesh.positions);
}

#[tokio::test(flavor = "multi_thread")]
async fn regular_layouts_that_are_named_are_laid_anew_as_one_unless_they_are_kept() {
    let dir = tempfile::tempdir().expect("a directory");
    let work = opened(dir.path()).await;
    added(&work, "fish").await;
    let (live, rankings) = ranked(&work, Some(Parts::Auto)).await;
    let all: Vec<u32> = (0..rankings.len() as u32).collect();
    let mut parts = Vec::new();
    for &segment in &all {
        let wanted = NewMap::new(segment, ExampleId::TEMPLATE, 0);
        let map = mapping::create(&work, &live, wanted).await.expect("a regular layout").id;
        parts.push(CompositionPart { segment, map });
    }
    let composed = async |keep: &[u32]| {
        let wanted = NewComposition {
            parts: parts.clone(),
            smoothing: 5,
            density: 0,
            keep: keep.to_vec(),
            beyond: Beyond::Extend,
        };
        let (id, making) = composing::start(&work, &live, wanted).expect("started");
        making.over().await;
        composing::find(&live, id).expect("made")
    };
    let (anew, kept) = (composed(&[]).await, composed(&all).await);
    assert_eq!((anew.summary.parts.len(), &anew.summary.templates), (0, &all));
    assert_eq!(kept.summary.parts.len(), all.len());
    let extraordinary = |made: &LiveComposition| made.summary.extraordinary_vertices;
    assert!(2 * extraordinary(&anew) < extraordinary(&kept), "{} of {}", extraordinary(&anew), extraordinary(&kept));
}
