//! Stores of every released schema open and read as they were written; a newer one is refused untouched.
//!
//! `tests/golden/schema_N/store.bin.zst` holds the files of a small store as a schema of that number left them: a row of
//! `path length u16 LE ‖ path ‖ content length u64 LE ‖ content`, compressed. Never write one anew once it was released:
//! `QUADMUSE_WRITE_GOLDEN=1` does so for the current schema while that is in the making.

use std::fs;
use std::path::{Path, PathBuf};

use quadmuse_store::{
    ChartRecord, Feature, LandmarkRecord, NewSegmentation, Patch, Segmentation, Store, StoreError, Topology,
};

use crate::sample::{Sample, options, segment_of};

fn files(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { files(&path, out) } else { out.push(path) }
    }
    out.sort();
}

/// Every file of a directory with its content.
fn contents(dir: &Path) -> Vec<(String, Vec<u8>)> {
    let mut paths = Vec::new();
    files(dir, &mut paths);
    let name = |path: &Path| path.strip_prefix(dir).unwrap().to_str().unwrap().to_owned();
    paths.iter().map(|path| (name(path), fs::read(path).unwrap())).collect()
}

fn pack(dir: &Path) -> Vec<u8> {
    let mut out = Vec::new();
    for (name, content) in contents(dir) {
        out.extend_from_slice(&(name.len() as u16).to_le_bytes());
        out.extend_from_slice(name.as_bytes());
        out.extend_from_slice(&(content.len() as u64).to_le_bytes());
        out.extend_from_slice(&content);
    }
    zstd::bulk::compress(&out, 19).unwrap()
}

fn first() -> Sample {
    Sample::with(1, vec![segment_of(1, &[32, 64, 128], 200), segment_of(2, &[32], 30)])
}

fn labels() -> Vec<u32> {
    (0..680).map(|face| face % 4).collect()
}

/// Whole and by two parts: from schema 3 on.
fn third() -> Sample {
    let segments = [6, 7, 8].map(|seed| segment_of(seed, &[32], 10)).to_vec();
    Sample::with(6, segments)
}

fn parts() -> Vec<u32> {
    (0..680).map(|face| face % 3).collect()
}

/// From schema 4 on.
fn landmarks() -> Vec<LandmarkRecord> {
    let nose = LandmarkRecord { name: "nose_tip".into(), point: [0.1, -2.0, 1e-300], vertex: Some(699) };
    vec![nose, LandmarkRecord { name: "Kinn".into(), point: [1.0 / 3.0, 0.0, -0.0], vertex: None }]
}

/// What a golden store holds.
fn write(dir: &Path) {
    let (store, _) = Store::open(dir, &options()).unwrap();
    let id = store.add(&first().example()).unwrap().record().id;
    let renamed = Patch { name: Some("Kopf, größer".into()), relevance: Some(4.5), ..Patch::default() };
    store.annotate(id, Patch { author: Some("Ada".into()), landmarks: Some(landmarks()), ..renamed }).unwrap();
    let mut second = Sample::with(3, vec![segment_of(3, &[32], 10)]);
    second.segments[0].pole_override = Some(17);
    second.segments[0].topology = Topology::Annulus;
    let labels = labels();
    let mut example = second.example();
    example.segmentation = NewSegmentation::Labels(&labels);
    let id = store.add(&example).unwrap().record().id;
    store.put_derived(id, 0, 2, &segment_of(4, &[32], 10)).unwrap();
    let (third, parts) = (third(), parts());
    let mut example = third.example();
    example.segmentation = NewSegmentation::Parted(&parts);
    store.add(&example).unwrap();
    let gone = store.add(&Sample::new(5).example()).unwrap().record().id;
    store.remove(gone).unwrap();
}

/// Reads every value of a golden store that was written as that schema.
fn read(dir: &Path, schema: u32) {
    let (store, report) = Store::open(dir, &options()).unwrap();
    assert_eq!(
        (report.examples, report.records_restored, report.ground_restored, report.garbage_collected),
        (if schema < 3 { 2 } else { 3 }, 0, 0, 0)
    );
    assert!(report.index_rebuilt.is_none() && report.missing_derived.is_empty());
    assert_eq!(store.check(&mut |_| ()).unwrap().problems, []);
    let snapshot = store.snapshot();
    let [one, two, rest @ ..] = &snapshot.examples[..] else { panic!("two examples") };
    if let [three] = rest {
        assert!(matches!(three.segmentation, Segmentation::Parted { faces: 680, .. }));
        assert_eq!((store.labels(three.id).unwrap(), three.segments.len()), (Some(parts()), 3));
        assert_eq!(store.find(&third().mesh, NewSegmentation::Parted(&[]), []).unwrap().id, three.id);
    }
    let sample = first();
    assert_eq!((one.name.as_str(), one.relevance, one.revision), ("Kopf, größer", 4.5, 2));
    assert_eq!(
        (one.tags.join(" "), one.format.as_str(), one.vertices, one.faces),
        ("head sample".into(), "obj", 700, 680)
    );
    assert_eq!((&one.segments, &one.repairs), (&sample.segments, &sample.repairs));
    assert_eq!((one.licence.as_str(), one.notes.as_str()), ("", ""));
    match schema {
        ..4 => assert_eq!((one.author.as_str(), &one.landmarks), ("", &Vec::new())),
        _ => assert_eq!((one.author.as_str(), &one.landmarks), ("Ada", &landmarks())),
    }
    assert_eq!(one.bytes, sample.mesh.len() as u64);
    assert_eq!(store.mesh_bytes(one.id).unwrap(), sample.mesh);
    assert_eq!(store.find(&sample.mesh, NewSegmentation::Auto, []).unwrap().id, one.id);
    for (number, written) in (0u32..).zip(&sample.derived) {
        let read = store.derived(one.id, number).unwrap();
        assert_eq!(
            (&read.chart, &read.features, &read.signature),
            (&written.chart, &written.features, &written.signature)
        );
        assert_eq!((&read.poles, read.modulus, read.topology), (&written.poles, written.modulus, written.topology));
        for (read, written) in read.levels.iter().zip(&written.levels) {
            let near = |(a, b): (&f32, &f32)| (a / b - 1.0).abs() < 2e-4;
            assert!(read.side == written.side && read.lambda.iter().zip(&written.lambda).all(near));
        }
    }
    assert!(matches!(two.segmentation, Segmentation::Labels { faces: 680, .. }));
    assert_eq!(store.labels(two.id).unwrap(), Some(labels()));
    assert_eq!((two.segments[0].pole_override, two.segments[0].topology), (Some(17), Topology::Annulus));
    assert_eq!(store.encoder_version(two.id, 0), Some(2));
    let ChartRecord { uv, extra } = store.chart(two.id, 0).unwrap();
    assert_eq!((uv.len(), extra.len()), (10, 999));
    let feature: Feature = store.coarse(two.id, 0).unwrap().features[11];
    assert_eq!(feature.lambda, 13.0);
}

#[test]
fn a_store_of_any_schema_reads_as_it_was_written() {
    let newest = quadmuse_migrations::CURRENT;
    if std::env::var("QUADMUSE_WRITE_GOLDEN").is_ok() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path());
        fs::create_dir_all(crate::stored::path(newest).parent().unwrap()).unwrap();
        fs::write(crate::stored::path(newest), pack(dir.path())).unwrap();
    }
    for schema in 1..=newest {
        let packed = fs::read(crate::stored::path(schema)).unwrap();
        let dir = tempfile::tempdir().unwrap();
        crate::stored::unpack_bytes(&packed, dir.path());
        let size: usize = contents(dir.path()).iter().map(|(_, content)| content.len()).sum();
        println!("golden store of schema {schema}: {} bytes packed, {size} unpacked", packed.len());
        read(dir.path(), schema);
        // Opened once, it has been written to: it still reads the same.
        read(dir.path(), schema);
    }
}

#[test]
fn what_is_written_today_reads_like_the_golden_store() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    read(dir.path(), quadmuse_migrations::CURRENT);
}

#[test]
fn a_newer_store_is_refused_without_changing_a_byte() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    let newer = quadmuse_migrations::CURRENT + 1;
    // The file as a release with one schema more would leave it.
    let text = fs::read_to_string(dir.path().join("schema")).unwrap();
    let head = format!("quadmuse-store schema {newer}");
    let sum = head
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    assert_eq!(text.lines().count(), 3);
    fs::write(dir.path().join("schema"), format!("{head} {sum:016x}\n").repeat(3)).unwrap();
    let before = contents(dir.path());
    let refused = Store::open(dir.path(), &options());
    assert!(matches!(refused, Err(StoreError::Newer { found, .. }) if found == newer));
    assert_eq!(contents(dir.path()), before);
}

#[test]
fn a_store_without_its_schema_file_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    fs::remove_file(dir.path().join("schema")).unwrap();
    let before = contents(dir.path());
    assert!(matches!(Store::open(dir.path(), &options()), Err(StoreError::Migration(_))));
    assert_eq!(contents(dir.path()), before);
}
