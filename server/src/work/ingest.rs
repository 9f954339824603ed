//! Examples: adding, annotating, removing, reading.

use super::corpus::{NewExample, PutOutcome};
use super::engine::{Cut, Encoded, EngineError, ExtraParts, Grain, Model, PackedEncoding};
use super::{Caller, REQUEST_TIME_MAX, Work, WorkError, doubts, jobs, landmarks, texts};
use crate::pool::{Job, Lane, User};
use bytes::Bytes;
use quadmuse_kernel::mesh::PolyMesh;
pub use quadmuse_kernel::pipeline::SEGMENTS_MAX;
use quadmuse_kernel::pipeline::few;
use quadmuse_proto::example::{
    CREDIT_LENGTH_MAX, NAME_LENGTH_MAX, NOTES_LENGTH_MAX, RELEVANCE_RANGE, TAG_LENGTH_MAX, TAGS_MAX,
};
use quadmuse_proto::{Example, ExampleId, ExamplePatch, MeshCounts, MeshFormat};
use std::sync::Arc;

/// The relevance of an example added without one.
pub const RELEVANCE_DEFAULT: f64 = 3.0;

/// An upper estimate of the memory that an upload takes once it is cut, in bytes.
pub fn memory_of(work: &Work, bytes: u64, model: &Model) -> u64 {
    work.engine.memory_estimate(bytes) + work.engine.memory_of_segments(model.segments.len())
}

/// Checks that labels ask for no more segments than a mesh may have.
///
/// # Errors
/// [`WorkError::Parameter`].
pub fn check_labels(labels: &[i64]) -> Result<(), WorkError> {
    if few(labels).is_err() {
        let expected = format!("to give at most {SEGMENTS_MAX} segments");
        return Err(WorkError::parameter("segments", expected, format!("more than {SEGMENTS_MAX} labels")));
    }
    Ok(())
}

/// A mesh as it came in.
#[derive(Clone, Debug)]
pub struct Upload {
    /// The bytes, unpacked.
    pub bytes: Bytes,
    /// Their format, if the caller named one.
    pub format: Option<MeshFormat>,
    /// How to cut the mesh.
    pub cut: Cut,
}

/// What a caller says of a new example.
#[derive(Clone, Debug)]
pub struct Annotation {
    /// Its name.
    pub name: String,
    /// Its tags.
    pub tags: Vec<String>,
    /// Its relevance, 0–5.
    pub relevance: f64,
}

/// Adds an example; durable when it returns.
///
/// # Errors
/// Refusals of the mesh, of the annotation, of the pool and of the corpus.
pub async fn add(
    work: &Arc<Work>,
    caller: Caller,
    upload: Upload,
    annotation: Annotation,
) -> Result<(Arc<Example>, PutOutcome), WorkError> {
    check_name(&annotation.name)?;
    check_relevance(annotation.relevance)?;
    let tags = normal_tags(annotation.tags)?;
    let (bytes, cut) = (upload.bytes.clone(), upload.cut.clone());
    // An example cut into a number of parts is kept with the labels that came of it: it is found once it is cut.
    if cut.parts.is_none()
        && let Some(there) = work.blocking(move |work| Ok(work.corpus.find(&bytes, &cut))).await?
    {
        return Ok((there, PutOutcome::There));
    }
    let annotation = Annotation { tags, ..annotation };
    if work.queue.get().is_some() {
        // A bad mesh is refused soon, however busy the encoders are.
        let model = read_example(work, caller, &upload).await?;
        let doubts = work.blocking(move |_| Ok(doubts::doubts(&model.mesh))).await?;
        if let Some((example, put)) = jobs::added(work, caller, &upload, &annotation).await {
            return Ok((doubted(&example, doubts), put));
        }
    }
    add_here(work, caller, upload, annotation).await
}

/// Reads and cuts what is to be an example.
async fn read_example(work: &Arc<Work>, caller: Caller, upload: &Upload) -> Result<Arc<Model>, WorkError> {
    let estimate = work.engine.memory_estimate(upload.bytes.len() as u64);
    let job = work.admit(caller.user, estimate, REQUEST_TIME_MAX)?;
    let upload = Upload { cut: Cut { grain: Grain::Faces, ..upload.cut.clone() }, ..upload.clone() };
    read(work, &job, Lane::Coarse, &upload).await
}

/// Encodes an upload on this server and adds it; durable when it returns.
///
/// # Errors
/// As [`add`].
pub(super) async fn add_here(
    work: &Arc<Work>,
    caller: Caller,
    upload: Upload,
    annotation: Annotation,
) -> Result<(Arc<Example>, PutOutcome), WorkError> {
    // A bad mesh is refused soon, however busy the encoders are.
    let model = read_example(work, caller, &upload).await?;
    let job = work.admit(caller.user, memory_of(work, upload.bytes.len() as u64, &model), REQUEST_TIME_MAX)?;
    let (segments, mended, besides) = encode_all(work, &job, &model).await?;
    let cut = match &model.labels {
        Some(labels) if upload.cut.parts.is_some() => Cut { labels: Some(labels.clone()), ..Cut::default() },
        _ => Cut { parts: None, grain: Grain::Free, besides, ..upload.cut.clone() },
    };
    let repairs = model.repairs.iter().cloned().chain(mended).collect();
    let new = NewExample {
        name: annotation.name,
        tags: annotation.tags,
        relevance: annotation.relevance,
        bytes: upload.bytes,
        format: model.format.as_str().into(),
        cut,
        counts: counts_of(&model.mesh),
        repairs,
        segments,
        encoder_version: work.engine.version(),
    };
    // From here on it is a commit: it goes on even if the caller hangs up.
    work.blocking(move |work| {
        let (example, put) = work.corpus.put(new)?;
        work.catalogue.follow();
        Ok((doubted(&example, doubts::doubts(&model.mesh)), put))
    })
    .await
}

/// An example as it is answered to whoever added it: with what speaks against its being one.
fn doubted(example: &Arc<Example>, doubts: Vec<String>) -> Arc<Example> {
    if doubts.is_empty() { Arc::clone(example) } else { Arc::new(Example { doubts, ..Example::clone(example) }) }
}

/// Reads and cuts an upload.
///
/// # Errors
/// Refusals of the mesh and of the pool.
pub async fn read(work: &Arc<Work>, job: &Job, lane: Lane, upload: &Upload) -> Result<Arc<Model>, WorkError> {
    let (engine, upload) = (Arc::clone(&work.engine), upload.clone());
    let read = move |stop: &_| engine.read(&upload.bytes, upload.format, &upload.cut, stop);
    let model = work.pool.run(job, lane, read).await??;
    if model.segments.len() > SEGMENTS_MAX {
        let expected = format!("to fall into at most {SEGMENTS_MAX} segments");
        let found = format!("{}; send its pieces by themselves, or without small parts", model.segments.len());
        return Err(WorkError::parameter("mesh", expected, found));
    }
    Ok(Arc::new(model))
}

/// Unfolds and encodes one segment.
///
/// # Errors
/// Refusals of the mesh and of the pool.
pub async fn encode(
    work: &Arc<Work>,
    job: &Job,
    lane: Lane,
    model: &Arc<Model>,
    segment: u32,
) -> Result<Encoded, WorkError> {
    let (engine, model) = (Arc::clone(&work.engine), Arc::clone(model));
    Ok(work.pool.run(job, lane, move |stop| engine.encode(&model, segment, stop)).await??)
}

/// Every segment, packed, with what unfolding had to mend, and the parts besides the whole that there are. A part that can't be
/// unfolded is left out: the whole can.
async fn encode_all(
    work: &Arc<Work>,
    job: &Job,
    model: &Arc<Model>,
) -> Result<(Vec<PackedEncoding>, Vec<String>, ExtraParts), WorkError> {
    let one = async |segment: u32| -> Result<(PackedEncoding, Vec<String>), WorkError> {
        let (engine, model) = (Arc::clone(&work.engine), Arc::clone(model));
        let pack = move |stop: &_| {
            let encoded = engine.encode(&model, segment, stop)?;
            Ok::<_, EngineError>((engine.pack(&encoded.encoding)?, encoded.repairs))
        };
        Ok(work.pool.run(job, Lane::Ingest, pack).await??)
    };
    let Some(labels) = &model.besides else {
        let all = futures_util::future::try_join_all((0..model.segments.len() as u32).map(one)).await?;
        let (segments, mended): (Vec<_>, Vec<_>) = all.into_iter().unzip();
        return Ok((segments, mended.concat(), ExtraParts::Nothing));
    };
    let (whole, mended) = one(0).await?;
    let (mut segments, mut number_of) = (vec![whole], vec![0; model.segments.len()]);
    let parts = (1..model.segments.len() as u32).map(one);
    for (part, packed) in (1..).zip(futures_util::future::join_all(parts).await) {
        match packed {
            Ok((packed, _)) => {
                number_of[part] = segments.len() as i64;
                segments.push(packed);
            }
            Err(WorkError::Engine(EngineError::Refused { detail, .. })) => tracing::info!(part, detail, "left out"),
            Err(error) => return Err(error),
        }
    }
    if segments.len() == 1 {
        return Ok((segments, mended, ExtraParts::Nothing));
    }
    let number = |part: &i64| usize::try_from(*part).ok().and_then(|part| number_of.get(part)).copied().unwrap_or(0);
    let besides = ExtraParts::Known(labels.iter().map(number).collect());
    Ok((segments, mended, besides))
}

/// Changes what is said of an example. Landmarks are found on its surface first.
///
/// # Errors
/// Refusals of the annotation, of the pool and of the corpus.
pub async fn annotate(
    work: &Arc<Work>,
    caller: Caller,
    id: ExampleId,
    patch: ExamplePatch,
) -> Result<Arc<Example>, WorkError> {
    patch.name.as_deref().map_or(Ok(()), check_name)?;
    patch.relevance.map_or(Ok(()), check_relevance)?;
    patch.author.as_deref().map_or(Ok(()), |author| check_line("author", author))?;
    patch.licence.as_deref().map_or(Ok(()), |licence| check_line("licence", licence))?;
    patch.notes.as_deref().map_or(Ok(()), check_notes)?;
    let tags = patch.tags.map(normal_tags).transpose()?;
    let landmarks = match patch.landmarks {
        Some(wanted) => Some(landmarks::placed(work, caller.user, id, wanted).await?),
        None => None,
    };
    let patch = ExamplePatch { tags, landmarks, ..patch };
    work.blocking(move |work| {
        let example = work.corpus.annotate(id, &patch)?;
        work.catalogue.follow();
        Ok(example)
    })
    .await
}

/// Removes an example.
///
/// # Errors
/// Refusals of the corpus.
pub async fn remove(work: &Arc<Work>, id: ExampleId) -> Result<(), WorkError> {
    work.blocking(move |work| {
        work.corpus.remove(id)?;
        work.examples.forget(id);
        work.catalogue.follow();
        Ok(())
    })
    .await
}

/// The bytes as uploaded.
///
/// # Errors
/// Refusals of the corpus.
pub async fn bytes(work: &Arc<Work>, user: User, id: ExampleId) -> Result<Bytes, WorkError> {
    // Until the last byte is sent they lie in memory, however slowly they are taken.
    let share = work.hold(user, work.catalogue.example(id)?.bytes)?;
    work.blocking(move |work| Ok(share.held(work.corpus.bytes(id)?.into()))).await
}

/// What the faces of an example's mesh tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Faces {
    /// Their corners.
    Plain,
    /// The segment that they are of, too; 0 for what is of no part of a whole.
    Labelled,
}

/// The mesh of an example, in another format than it was uploaded in if need be. Only PLY has a place for labels.
///
/// # Errors
/// Refusals of the corpus and of the format.
pub async fn mesh(
    work: &Arc<Work>,
    caller: Caller,
    id: ExampleId,
    (format, faces): (MeshFormat, Faces),
) -> Result<Bytes, WorkError> {
    if faces == Faces::Labelled && format != MeshFormat::Ply {
        return Err(WorkError::parameter(
            "labels",
            "`format=ply` beside it: no other format has labels",
            format.as_str(),
        ));
    }
    let example = work.catalogue.example(id)?;
    let bytes = bytes(work, caller.user, id).await?;
    if example.format == format.as_str() && faces == Faces::Plain {
        return Ok(bytes);
    }
    let estimate = work.engine.memory_estimate(bytes.len() as u64);
    let job = work.admit(caller.user, estimate, REQUEST_TIME_MAX)?;
    let model = model(work, &job, Lane::Lay, &example).await?;
    let mesh = match faces {
        Faces::Plain => Arc::clone(&model.mesh),
        Faces::Labelled => {
            let engine = Arc::clone(&work.engine);
            work.pool.run(&job, Lane::Lay, move |_| engine.labelled_by_segment(&model)).await??
        }
    };
    write(work, job, caller.user, &mesh, format).await
}

/// An example, read from its bytes unless that was done lately.
///
/// # Errors
/// Refusals of the corpus and of the pool.
pub async fn model(work: &Arc<Work>, job: &Job, lane: Lane, example: &Example) -> Result<Arc<Model>, WorkError> {
    let id = example.id;
    if let Some(model) = work.examples.model(id) {
        return Ok(model);
    }
    let (bytes, cut) = work.blocking(move |work| Ok((work.corpus.bytes(id)?, work.corpus.cut(id)?))).await?;
    let cut = Cut { grain: Grain::Faces, ..cut };
    let model = read(work, job, lane, &Upload { bytes, format: example.format.parse().ok(), cut }).await?;
    work.examples.put_model(id, &model, example.bytes);
    Ok(model)
}

/// A segment of an example, unfolded and encoded unless that was done lately. `model`: the example.
///
/// # Errors
/// Refusals of the mesh and of the pool.
pub async fn example_encoded(
    work: &Arc<Work>,
    job: &Job,
    lane: Lane,
    (example, model, segment): (&Example, &Arc<Model>, u32),
) -> Result<Arc<Encoded>, WorkError> {
    let of = (example.id, segment);
    if let Some(encoded) = work.examples.encoded(of) {
        return Ok(encoded);
    }
    let encoded = Arc::new(encode(work, job, lane, model, segment).await?);
    work.examples.put_encoded(of, &encoded, example.bytes);
    Ok(encoded)
}

/// A mesh as a file, paid for until it is sent.
async fn write(
    work: &Arc<Work>,
    job: Job,
    user: User,
    mesh: &Arc<PolyMesh>,
    format: MeshFormat,
) -> Result<Bytes, WorkError> {
    let share = work.hold(user, file_bytes_of(mesh))?;
    let (engine, mesh) = (Arc::clone(&work.engine), Arc::clone(mesh));
    let file = work.pool.run(&job, Lane::Edit, move |_| engine.write(&mesh, format)).await??;
    Ok(share.held(file))
}

/// An upper estimate of the length of a mesh as a file, in bytes, the buffer it grows in included.
fn file_bytes_of(mesh: &PolyMesh) -> u64 {
    // Coordinates, texture coordinates and a name a vertex; an index of each kind and separators a corner.
    160 * mesh.positions.len() as u64 + 48 * mesh.faces.corners().len() as u64 + 4096
}

/// A mesh that is held already, as a file.
///
/// # Errors
/// Refusals of the format and of the pool.
pub async fn mesh_file(
    work: &Arc<Work>,
    user: User,
    mesh: &Arc<PolyMesh>,
    format: MeshFormat,
) -> Result<Bytes, WorkError> {
    let job = work.admit(user, 0, REQUEST_TIME_MAX)?;
    write(work, job, user, mesh, format).await
}

/// The mesh of a query as a file. Where it was cut, and the format has a place for it, each face tells its segment.
///
/// # Errors
/// Refusals of the format and of the pool.
pub async fn input_file(
    work: &Arc<Work>,
    user: User,
    model: &Arc<Model>,
    format: MeshFormat,
) -> Result<Bytes, WorkError> {
    if format != MeshFormat::Ply || model.segments.len() < 2 {
        return mesh_file(work, user, &model.mesh, format).await;
    }
    let job = work.admit(user, 0, REQUEST_TIME_MAX)?;
    // The copy takes less than the file does.
    let _copy = work.hold(user, file_bytes_of(&model.mesh))?;
    let (engine, cut) = (Arc::clone(&work.engine), Arc::clone(model));
    let mesh = work.pool.run(&job, Lane::Edit, move |_| engine.labelled_by_segment(&cut)).await??;
    write(work, job, user, &mesh, format).await
}

/// What a mesh is made of.
pub fn counts_of(mesh: &PolyMesh) -> MeshCounts {
    let of_degree = |n: usize| mesh.faces.iter().filter(|face| face.len() == n).count() as u64;
    let (vertices, faces) = (mesh.positions.len() as u64, mesh.faces.len() as u64);
    MeshCounts { vertices, faces, triangles: of_degree(3), quads: of_degree(4) }
}

fn check_name(name: &str) -> Result<(), WorkError> {
    check_length("name", name, NAME_LENGTH_MAX)?;
    check_text("name", name)
}

/// An author or a licence.
fn check_line(name: &'static str, text: &str) -> Result<(), WorkError> {
    check_length(name, text, CREDIT_LENGTH_MAX)?;
    check_text(name, text)
}

/// Notes may have several lines.
fn check_notes(notes: &str) -> Result<(), WorkError> {
    check_length("notes", notes, NOTES_LENGTH_MAX)?;
    notes.lines().try_for_each(|line| check_text("notes", line))
}

fn check_length(name: &'static str, text: &str, most: usize) -> Result<(), WorkError> {
    if text.len() <= most {
        return Ok(());
    }
    Err(WorkError::parameter(name, format!("of at most {most} bytes"), format!("{} bytes", text.len())))
}

fn check_text(name: &'static str, text: &str) -> Result<(), WorkError> {
    texts::unprintable(text).map_or(Ok(()), |found| Err(WorkError::parameter(name, texts::EXPECTED, found)))
}

fn check_relevance(relevance: f64) -> Result<(), WorkError> {
    if RELEVANCE_RANGE.contains(&relevance) {
        return Ok(());
    }
    Err(WorkError::parameter("relevance", "from 0 to 5", relevance))
}

/// Tags sorted, each once, within their limits.
///
/// # Errors
/// [`WorkError::Parameter`].
pub fn normal_tags(mut tags: Vec<String>) -> Result<Vec<String>, WorkError> {
    tags.sort();
    tags.dedup();
    if tags.len() > TAGS_MAX {
        return Err(WorkError::parameter("tag", format!("at most {TAGS_MAX} times"), tags.len()));
    }
    tags.iter().try_for_each(|tag| check_text("tag", tag))?;
    match tags.iter().find(|tag| tag.trim().is_empty() || tag.len() > TAG_LENGTH_MAX) {
        None => Ok(tags),
        Some(tag) => {
            let expected = format!("of 1 to {TAG_LENGTH_MAX} bytes, not only blanks");
            Err(WorkError::parameter("tag", expected, format!("{} bytes", tag.len())))
        }
    }
}
