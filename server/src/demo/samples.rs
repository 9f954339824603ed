//! The samples as files: what a new corpus may begin with, and scans to try it with.

use super::{Sample, corpus, inputs};
use crate::work::engine::{Cut, ExtraParts};
use crate::work::ingest::{self, Annotation, Upload};
use crate::work::{Caller, Work};
use bytes::Bytes;
use quadmuse_kernel::mesh::{Format, MeshError, PolyMesh, write};
use quadmuse_proto::{MeshFormat, SampleKind};
use std::sync::{Arc, OnceLock};

/// A sample as a file.
#[derive(Clone, Debug)]
pub struct SampleFile {
    /// What it is good for.
    pub kind: SampleKind,
    /// Its name, unique among those of its kind.
    pub name: String,
    /// Its tags.
    pub tags: Vec<String>,
    /// Its relevance, 0–5.
    pub relevance: f64,
    /// Its faces.
    pub faces: u64,
    /// It as OBJ.
    pub bytes: Bytes,
}

/// All of them, made once and kept: some MB.
static FILES: OnceLock<Vec<SampleFile>> = OnceLock::new();

/// All samples, the examples first. Takes seconds when it is called first: blocks.
pub fn files() -> &'static [SampleFile] {
    FILES.get_or_init(|| {
        let examples = corpus().into_iter().map(|sample| (SampleKind::Example, sample));
        let scans = inputs().into_iter().map(|sample| (SampleKind::Scan, sample));
        examples.chain(scans).filter_map(|(kind, sample)| file(kind, sample)).collect()
    })
}

fn file(kind: SampleKind, sample: Sample) -> Option<SampleFile> {
    let Sample { name, tags, relevance, mesh } = sample;
    let faces = mesh.faces.len() as u64;
    // Written in each run of the demo, and in a test: it does not fail.
    let bytes = write(&mesh, Format::Obj).inspect_err(|error| tracing::error!(%error, name, "no sample")).ok()?;
    Some(SampleFile { kind, name, tags, relevance: f64::from(relevance), faces, bytes: bytes.into() })
}

/// Puts the sample examples into the corpus. What fails is logged: a service without samples is a service all the same.
pub async fn stock(work: Arc<Work>) {
    let Ok(all) = tokio::task::spawn_blocking(files).await else { return };
    let mut added = 0;
    for sample in all.iter().filter(|sample| sample.kind == SampleKind::Example) {
        match add(&work, sample).await {
            Ok(()) => added += 1,
            Err(error) => {
                tracing::warn!(%error, added, "the samples were not added");
                return;
            }
        }
    }
    tracing::info!(added, "the corpus was empty, and has the samples now");
}

async fn add(work: &Arc<Work>, sample: &SampleFile) -> Result<(), crate::work::WorkError> {
    let SampleFile { name, mut tags, relevance, bytes, .. } = sample.clone();
    // So that all of them are found, and can be taken out again.
    tags.push("sample".into());
    let cut = Cut { besides: ExtraParts::Sought, ..Cut::default() };
    let upload = Upload { bytes, format: Some(MeshFormat::Obj), cut };
    ingest::add(work, Caller::default(), upload, Annotation { name, tags, relevance }).await.map(drop)
}

/// A mesh as a file to upload.
///
/// # Errors
/// [`MeshError`].
pub fn upload(mesh: &PolyMesh) -> Result<Upload, MeshError> {
    let bytes = write(mesh, Format::Obj)?.into();
    Ok(Upload { bytes, format: Some(MeshFormat::Obj), cut: Cut::default() })
}
