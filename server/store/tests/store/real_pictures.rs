//! Encodings of real meshes: what they need on disk, and that ranking them as stored is ranking them as computed.

use std::fs;
use std::path::PathBuf;

use quadmuse_kernel::encode::{Encoding, encode};
use quadmuse_kernel::mesh::{self, Limits};
use quadmuse_kernel::{topology, unfold};
use quadmuse_store::{ChartRecord, DerivedSegment, Feature, Level, Store, Topology};

use crate::sample::{Sample, options};

/// Meshes taken, so that the test stays short.
const MESHES: usize = 24;
/// Energies that lie closer together than this, relatively, are a tie up to 128², where a search ends by default: a
/// registration stops at a decrease of ten times as much.
const TIE: f64 = 1e-5;
/// The same at 256² and 512², which are kept with a step sixteen times as coarse.
const TIE_FINE: f64 = 2e-4;
/// Bytes of a typical segment's pyramid. (86 KiB when this was written; the room is for changes of the encoder. What the database
/// adds to it is some 17 %.)
const PYRAMID_BYTES: u64 = 96 * 1024;

fn shared() -> PathBuf {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    std::env::var_os("QUADMUSE_SHARED").map_or(beside, PathBuf::from)
}

/// The chart and the encoding of a file that is one primitive.
fn encoded(path: &PathBuf) -> Option<(Vec<[f64; 2]>, Encoding)> {
    let poly = mesh::read(&fs::read(path).ok()?, None, &Limits::default()).ok()?;
    let prepared = mesh::prepare(&poly).ok()?;
    let patch = topology::whole(&prepared.mesh).ok()?;
    let chart = unfold::unfold(&patch, &unfold::UnfoldOptions::default()).ok()?;
    let uv = chart.uv.iter().take(chart.patch_vertices).copied().collect();
    Some((uv, encode(&chart)))
}

fn derived(uv: Vec<[f64; 2]>, encoding: &Encoding) -> DerivedSegment {
    let level = |picture: &quadmuse_kernel::encode::Picture| Level {
        side: picture.side as u32,
        lambda: picture.values.clone(),
    };
    let feature = |f: &quadmuse_kernel::encode::features::Feature| Feature {
        u: f.uv[0],
        v: f.uv[1],
        lambda: f.lambda,
        level: f.side as u32,
    };
    DerivedSegment {
        topology: Topology::Disc,
        modulus: encoding.modulus,
        poles: vec![],
        levels: encoding.pyramid.iter().map(level).collect(),
        features: encoding.features.iter().map(feature).collect(),
        signature: vec![0.0; 544],
        chart: ChartRecord { uv, extra: vec![] },
    }
}

/// E = mean (√λ₁ − √λ₂)², of two pictures of the same side.
fn energy(a: &[f32], b: &[f32]) -> f64 {
    let square = |(&a, &b): (&f32, &f32)| (f64::from(a).sqrt() - f64::from(b).sqrt()).powi(2);
    a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64
}

#[test]
fn real_pictures_are_small_and_rank_as_computed() {
    let folder = shared().join("meshes/quads");
    let Ok(entries) = fs::read_dir(&folder) else {
        println!("passed over: {} is absent", folder.display());
        return;
    };
    let mut paths: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|e| e == "obj"))
        .collect();
    paths.sort();
    let dir = tempfile::tempdir().unwrap();
    let (store, _) = Store::open(dir.path(), &options()).unwrap();
    let mut corpus = Vec::new();
    let (mut pyramids, mut charts, mut vertices) = (Vec::new(), 0, 0);
    for path in paths {
        let Some((uv, encoding)) = encoded(&path) else { continue };
        let seed = corpus.len() as u64;
        let mut segment = derived(uv, &encoding);
        vertices += segment.chart.uv.len();
        let id = store.add(&Sample::with(seed, vec![segment.clone()]).example()).unwrap().record().id;
        let whole = store.stats().derived_bytes;
        // The same with nothing but its pyramid, to tell the two apart.
        let features = (segment.features.len() * 24 + segment.signature.len() * 4) as u64;
        segment.chart = ChartRecord::default();
        segment.features.clear();
        segment.signature.clear();
        store.put_derived(id, 0, 1, &segment).unwrap();
        let pyramid = store.stats().derived_bytes - (pyramids.iter().sum::<u64>());
        charts += whole - store.stats().derived_bytes - features;
        pyramids.push(pyramid);
        corpus.push((path.file_stem().unwrap().to_string_lossy().into_owned(), id, encoding));
        if corpus.len() == MESHES {
            break;
        }
    }
    assert!(corpus.len() > 5, "too few primitives among {}", folder.display());
    for ((name, _, _), bytes) in corpus.iter().zip(&pyramids) {
        println!("{name}: {bytes} bytes");
    }
    pyramids.sort_unstable();
    let median = pyramids[pyramids.len() / 2];
    println!("median pyramid {median} bytes; chart {:.1} bytes a vertex", charts as f64 / vertices as f64);
    for (side, tie) in [(32, TIE), (64, TIE), (128, TIE), (256, TIE_FINE), (512, TIE_FINE)] {
        let stored: Vec<Level> = corpus.iter().map(|(_, id, _)| store.level(*id, 0, side as u32).unwrap()).collect();
        let mut error: f64 = 0.0;
        for (name, _, query) in &corpus {
            let query = &query.level(side).unwrap().values;
            let computed: Vec<f64> =
                corpus.iter().map(|(_, _, entry)| energy(&entry.level(side).unwrap().values, query)).collect();
            let kept: Vec<f64> = stored.iter().map(|entry| energy(&entry.lambda, query)).collect();
            let mut order: Vec<usize> = (0..corpus.len()).collect();
            order.sort_by(|&a, &b| kept[a].total_cmp(&kept[b]));
            for pair in order.windows(2) {
                let (first, second) = (computed[pair[0]], computed[pair[1]]);
                assert!(
                    first <= second * (1.0 + tie) + 1e-9,
                    "{name} at {side}²: {} before {}",
                    corpus[pair[0]].0,
                    corpus[pair[1]].0
                );
            }
            let errors = computed.iter().zip(&kept).filter(|(computed, _)| **computed > 1e-6);
            error = errors.map(|(computed, kept)| (kept / computed - 1.0).abs()).fold(error, f64::max);
        }
        println!("{side}²: {} rankings unchanged, largest relative error of an energy {error:.1e}", corpus.len());
    }
    assert!(median <= PYRAMID_BYTES, "{median}");
}
