//! What any one of several servers does: encoding what was uploaded, and encoding again what is of an older encoder.
//!
//! A server that takes an upload reads it, so that a bad mesh is refused soon, puts it away and adds a job; whoever has a
//! free core takes it, encodes the mesh and adds the example; the first server waits for the outcome and answers. A server
//! that is killed is not heard of any more, and its job is taken again. A job that is done twice has the effect of one:
//! the same mesh is the same example, and the same encoding changes nothing.
//!
//! Kinds are by the encoder's version, so that servers with an older and a newer one work side by side, each on its own.

use super::corpus::{CorpusError, PutOutcome};
use super::engine::{Cut, ExtraParts};
use super::ingest::{self, Annotation, Upload};
use super::{Caller, REQUEST_TIME_MAX, Scope, Work, WorkError, reencode};
use crate::pool::User;
use bytes::Bytes;
use quadmuse_cluster::{Job, LEASE};
use quadmuse_proto::id::RequestId;
use quadmuse_proto::{Components, Example, ExampleId, MeshFormat, Parts, Segmentation};
use serde::{Deserialize, Serialize};
use serde_bytes::ByteBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

/// Longest wait for a job in one call.
const WAIT: Duration = Duration::from_secs(2);
/// Pause after a queue that does not answer.
const PAUSE: Duration = Duration::from_secs(2);
/// How often it is said that work on a job goes on.
const SIGN_EVERY: Duration = Duration::from_secs(LEASE.as_secs() / 3);
/// A job for which there was no room is taken again after this time.
const PUT_OFF: Duration = Duration::from_secs(1);
/// A job that was taken so often is given up: whoever takes it may die of it.
const TIMES_MAX: u64 = 5;
/// Jobs to encode again that are in the queue at a time.
const STALE_MAX: u64 = 1000;
/// Pauses between looks for an outcome: the first, and the longest.
const LOOKS: (Duration, Duration) = (Duration::from_millis(25), Duration::from_millis(500));
/// How well uploads are compressed: fast.
const ZSTD_LEVEL: i32 = 1;
/// The names of the two kinds of jobs in metrics.
const ADD: &str = "add";
const ENCODE: &str = "encode";
/// How often the length of the queue is told to whoever watches.
const COUNT_EVERY: Duration = Duration::from_secs(5);

/// Jobs that several servers share. Every call blocks.
pub trait Queue: Send + Sync + 'static {
    /// Adds a job of a kind; whether it was added: of a kind and a name one waits, or is being done, at a time.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn add(&self, kind: &str, name: &str, payload: &[u8]) -> Result<bool, CorpusError>;

    /// Takes a job of a kind; `None` if there is none within `wait`.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn take(&self, kind: &str, wait: Duration) -> Result<Option<Box<dyn Job>>, CorpusError>;

    /// Jobs that wait or are being done.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn count(&self) -> Result<u64, CorpusError>;

    /// Keeps bytes for a while.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn keep(&self, name: &str, bytes: &[u8]) -> Result<(), CorpusError>;

    /// What was kept so.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn kept(&self, name: &str) -> Result<Option<Vec<u8>>, CorpusError>;

    /// Removes what was kept so.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn forget(&self, name: &str) -> Result<(), CorpusError>;
}

/// What is to be done.
#[derive(Serialize, Deserialize)]
enum Task {
    /// Encode an upload that was put away under this name, and add it.
    Add { upload: String },
    /// Encode a segment again.
    Encode { example: ExampleId, segment: u32 },
}

/// An upload that was put away for a job.
#[derive(Serialize, Deserialize)]
struct StoredUpload {
    user: u64,
    name: String,
    tags: Vec<String>,
    relevance: f64,
    format: Option<MeshFormat>,
    way: Segmentation,
    labels: Option<Vec<i64>>,
    components: Components,
    /// As `parts=` has it.
    parts: Option<String>,
    parts_are_sought: bool,
    /// Length of the mesh, unpacked.
    length: u64,
    /// The mesh, by zstd.
    mesh: ByteBuf,
}

/// What became of an upload.
#[derive(Serialize, Deserialize)]
enum Outcome {
    /// It is an example.
    Added {
        id: ExampleId,
        is_new: bool,
        /// Whoever knows so much of the corpus knows it.
        position: u64,
    },
    /// It could not be encoded: who tries again finds why.
    Failed,
}

fn upload_name(name: &str) -> String {
    format!("job-{name}")
}

fn outcome_name(name: &str) -> String {
    format!("outcome-{name}")
}

fn kind(work: &Work) -> String {
    format!("v{}", work.engine.version())
}

/// Has an upload that was read already encoded by whichever server is free; `None` where the queue can't be used, or the
/// mesh not encoded: then the caller does it by itself, and finds why.
pub(super) async fn added(
    work: &Arc<Work>,
    caller: Caller,
    upload: &Upload,
    annotation: &Annotation,
) -> Option<(Arc<Example>, PutOutcome)> {
    let queue = Arc::clone(work.queue.get()?);
    let begun = Instant::now();
    let name = RequestId::generate().to_string();
    let put_away = put_away(caller.user, upload, annotation)?;
    let (adding, task) = (name.clone(), Task::Add { upload: upload_name(&name) });
    let added = work.blocking(move |work| {
        let task = rmp_serde::to_vec_named(&task).map_err(|error| CorpusError::Failed(error.into()))?;
        queue.keep(&upload_name(&adding), &put_away)?;
        Ok(queue.add(&kind(work), &format!("add.{adding}"), &task)?)
    });
    if let Err(error) = added.await {
        tracing::warn!(%error, "an upload can't be handed to all servers; it is encoded here");
        return None;
    }
    let outcome = outcome_of(work, &name, begun).await;
    let queue = Arc::clone(work.queue.get()?);
    let forgotten = work.blocking(move |_| {
        queue.forget(&upload_name(&name))?;
        Ok(queue.forget(&outcome_name(&name))?)
    });
    if let Err(error) = forgotten.await {
        tracing::debug!(%error, "what was kept of an upload is not removed; it goes with its time");
    }
    let Outcome::Added { id, is_new, position } = outcome? else { return None };
    let known = work.blocking(move |work| {
        // Who added it sees it at once.
        work.corpus.wait_for(position, REQUEST_TIME_MAX);
        work.catalogue.follow();
        Ok(work.corpus.get(id)?)
    });
    let put = if is_new { PutOutcome::Added } else { PutOutcome::There };
    known.await.ok().map(|example| (example, put))
}

fn put_away(user: User, upload: &Upload, annotation: &Annotation) -> Option<Vec<u8>> {
    let Upload { bytes, format, cut } = upload;
    let put_away = StoredUpload {
        user: user.0,
        name: annotation.name.clone(),
        tags: annotation.tags.clone(),
        relevance: annotation.relevance,
        format: *format,
        way: cut.way,
        labels: cut.labels.clone(),
        components: cut.components,
        parts: cut.parts.map(|parts| parts.to_string()),
        parts_are_sought: cut.besides == ExtraParts::Sought,
        length: bytes.len() as u64,
        mesh: zstd::bulk::compress(bytes, ZSTD_LEVEL).ok()?.into(),
    };
    rmp_serde::to_vec_named(&put_away).ok()
}

impl StoredUpload {
    fn taken_out(self) -> Option<(Caller, Upload, Annotation)> {
        let mesh = zstd::bulk::decompress(&self.mesh, usize::try_from(self.length).ok()?).ok()?;
        let cut = Cut {
            way: self.way,
            labels: self.labels,
            components: self.components,
            parts: self.parts.and_then(|parts| parts.parse::<Parts>().ok()),
            besides: if self.parts_are_sought { ExtraParts::Sought } else { ExtraParts::Nothing },
            ..Cut::default()
        };
        let annotation = Annotation { name: self.name, tags: self.tags, relevance: self.relevance };
        let caller = Caller { user: User(self.user), scope: Scope::Own };
        Some((caller, Upload { bytes: Bytes::from(mesh), format: self.format, cut }, annotation))
    }
}

/// Waits for an outcome, as long as a request may take.
async fn outcome_of(work: &Arc<Work>, name: &str, begun: Instant) -> Option<Outcome> {
    let mut pause = LOOKS.0;
    while begun.elapsed() < REQUEST_TIME_MAX {
        tokio::time::sleep(pause).await;
        pause = (2 * pause).min(LOOKS.1);
        let (queue, name) = (Arc::clone(work.queue.get()?), outcome_name(name));
        match work.blocking(move |_| Ok(queue.kept(&name)?)).await {
            Ok(Some(outcome)) => return rmp_serde::from_slice(&outcome).ok(),
            Ok(None) => {}
            Err(error) => tracing::debug!(%error, "an outcome is not known yet"),
        }
    }
    None
}

/// Adds a job for each of these segments, which are of an older encoder or have no encoding; as many as make sense at a
/// time.
pub(super) async fn encode_again(work: &Arc<Work>, stale: Vec<(ExampleId, u32)>) -> Result<(), WorkError> {
    let Some(queue) = work.queue.get().cloned() else { return Ok(()) };
    work.blocking(move |work| {
        let room = STALE_MAX.saturating_sub(queue.count()?);
        let mut added = 0u64;
        for (example, segment) in stale {
            if added >= room {
                break;
            }
            let task = rmp_serde::to_vec_named(&Task::Encode { example, segment });
            let task = task.map_err(|error| CorpusError::Failed(error.into()))?;
            added += u64::from(queue.add(&kind(work), &format!("encode.{example}.{segment}"), &task)?);
        }
        Ok(())
    })
    .await
}

/// Does jobs until `stopping`, as many at a time as there are threads.
pub async fn run(work: Arc<Work>, stopping: CancellationToken) {
    let Some(queue) = work.queue.get().cloned() else { return };
    // There from the beginning: of a counter that is first seen at 1 an alert doesn't know that it has grown.
    for what in [ADD, ENCODE] {
        metrics::counter!("quadmuse_jobs_total", "kind" => what, "outcome" => Effect::GivenUp.word()).increment(0);
    }
    let takers = (0..work.pool.threads()).map(|_| taker(&work, &queue, &stopping));
    tokio::join!(futures_util::future::join_all(takers), count(&work, &queue, &stopping));
}

/// Tells how long the queue is.
async fn count(work: &Arc<Work>, queue: &Arc<dyn Queue>, stopping: &CancellationToken) {
    while stopping.run_until_cancelled(tokio::time::sleep(COUNT_EVERY)).await.is_some() {
        let queue = Arc::clone(queue);
        if let Ok(count) = work.blocking(move |_| Ok(queue.count()?)).await {
            metrics::gauge!("quadmuse_queue_jobs").set(count as f64);
        }
    }
}

async fn taker(work: &Arc<Work>, queue: &Arc<dyn Queue>, stopping: &CancellationToken) {
    while !stopping.is_cancelled() {
        let (taking, stop) = (Arc::clone(queue), stopping.clone());
        let taken = work.blocking(move |work| {
            let job = taking.take(&kind(work), WAIT)?;
            // Somebody else does it then, and need not wait.
            let job = match job {
                Some(job) if stop.is_cancelled() => {
                    give_back(&*job, Duration::ZERO);
                    None
                }
                job => job,
            };
            Ok(job.map(|job| Arc::new(Mutex::new(job))))
        });
        match stopping.run_until_cancelled(taken).await {
            Some(Ok(Some(job))) => done(work, queue, &job, stopping).await,
            Some(Ok(None)) => {}
            Some(Err(error)) => {
                tracing::debug!(%error, "no job can be taken");
                stopping.run_until_cancelled(tokio::time::sleep(PAUSE)).await;
            }
            None => return,
        }
    }
}

type Shared = Arc<Mutex<Box<dyn Job>>>;

fn give_back(job: &dyn Job, pause: Duration) {
    if let Err(error) = job.give_back(pause) {
        tracing::debug!(%error, "a job is not given back; it comes again by itself");
    }
}

/// Says something to the queue of a job, off the tokio workers.
async fn say(work: &Arc<Work>, job: &Shared, what: impl FnOnce(&dyn Job) + Send + 'static) {
    let job = Arc::clone(job);
    // What it panicked with was logged.
    let _ = work
        .blocking(move |_| {
            what(&**job.lock().unwrap_or_else(PoisonError::into_inner));
            Ok(())
        })
        .await;
}

/// Does a job, and says meanwhile that it goes on.
async fn done(work: &Arc<Work>, queue: &Arc<dyn Queue>, job: &Shared, stopping: &CancellationToken) {
    let (task, times_taken) = {
        let job = job.lock().unwrap_or_else(PoisonError::into_inner);
        (rmp_serde::from_slice::<Task>(job.payload()), job.times_taken())
    };
    let Ok(task) = task else {
        tracing::error!("a job can't be read; it is given up");
        return say(work, job, ended).await;
    };
    let doing = effect(work, queue, &task, times_taken);
    tokio::pin!(doing);
    let effect = loop {
        tokio::select! {
            effect = &mut doing => break effect,
            () = tokio::time::sleep(SIGN_EVERY) => {
                say(work, job, |job| {
                    if let Err(error) = job.goes_on() {
                        tracing::debug!(%error, "not said that a job goes on");
                    }
                })
                .await;
            }
            () = stopping.cancelled() => break Effect::PutOff(Duration::ZERO),
        }
    };
    let what = if matches!(task, Task::Add { .. }) { ADD } else { ENCODE };
    metrics::counter!("quadmuse_jobs_total", "kind" => what, "outcome" => effect.word()).increment(1);
    match effect {
        Effect::Done | Effect::GivenUp => say(work, job, ended).await,
        Effect::PutOff(pause) => say(work, job, move |job| give_back(job, pause)).await,
    }
}

fn ended(job: &dyn Job) {
    if let Err(error) = job.done() {
        // It is done again, to the same effect.
        tracing::warn!(%error, job = job.name(), "not said that a job is done");
    }
}

/// What came of a job.
enum Effect {
    Done,
    GivenUp,
    PutOff(Duration),
}

impl Effect {
    fn word(&self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::GivenUp => "given_up",
            Self::PutOff(_) => "put_off",
        }
    }

    fn of(error: &WorkError, times_taken: u64) -> Self {
        let is_for_later = match error {
            WorkError::Pool(refusal) => refusal.retry_after().is_some(),
            WorkError::Corpus(CorpusError::Unreachable(_) | CorpusError::Busy | CorpusError::Full(_)) => true,
            _ => false,
        };
        match is_for_later {
            // There was no room, or nobody answered: that says nothing against the job.
            true => Self::PutOff(PUT_OFF),
            false if times_taken < TIMES_MAX && matches!(error, WorkError::Lost) => Self::PutOff(PUT_OFF),
            false => Self::GivenUp,
        }
    }
}

async fn effect(work: &Arc<Work>, queue: &Arc<dyn Queue>, task: &Task, times_taken: u64) -> Effect {
    match task {
        Task::Encode { .. } if times_taken > TIMES_MAX => Effect::GivenUp,
        Task::Encode { example, segment } => match reencode::rebuilt(work, *example, *segment).await {
            Ok(()) => Effect::Done,
            Err(WorkError::Corpus(CorpusError::NotFound(_))) => Effect::Done,
            Err(error) => {
                tracing::warn!(%example, segment, %error, "not encoded again");
                Effect::of(&error, times_taken)
            }
        },
        Task::Add { upload } => {
            let outcome = match times_taken > TIMES_MAX {
                true => Err(Effect::GivenUp),
                false => encoded(work, queue, upload).await.map_err(|error| {
                    tracing::info!(upload, %error, "an upload is not encoded");
                    Effect::of(&error, times_taken)
                }),
            };
            let (outcome, effect) = match outcome {
                Ok(Some(outcome)) => (outcome, Effect::Done),
                // Whoever wanted it has gone, or has it.
                Ok(None) => return Effect::Done,
                Err(Effect::PutOff(pause)) => return Effect::PutOff(pause),
                Err(effect) => (Outcome::Failed, effect),
            };
            let (queue, name) = (Arc::clone(queue), upload.trim_start_matches("job-").to_owned());
            let outcome_kept = work.blocking(move |_| {
                let outcome = rmp_serde::to_vec_named(&outcome).map_err(|error| CorpusError::Failed(error.into()))?;
                Ok(queue.keep(&outcome_name(&name), &outcome)?)
            });
            match outcome_kept.await {
                Ok(()) => effect,
                Err(error) => Effect::of(&error, times_taken),
            }
        }
    }
}

/// Encodes an upload that was put away, and adds it; `None` if it isn't there any more.
async fn encoded(work: &Arc<Work>, queue: &Arc<dyn Queue>, upload: &str) -> Result<Option<Outcome>, WorkError> {
    let (queue, name) = (Arc::clone(queue), upload.to_owned());
    let kept = work.blocking(move |_| Ok(queue.kept(&name)?)).await?;
    let Some(kept) = kept else { return Ok(None) };
    let unreadable = || WorkError::from(CorpusError::Invalid("expected an upload that was put away whole".into()));
    let put_away: StoredUpload = rmp_serde::from_slice(&kept).map_err(|_| unreadable())?;
    drop(kept);
    let share = work.hold(User(put_away.user), put_away.length)?;
    let (caller, upload, annotation) = put_away.taken_out().ok_or_else(unreadable)?;
    let (example, put) = ingest::add_here(work, caller, upload, annotation).await?;
    drop(share);
    let is_new = put == PutOutcome::Added;
    Ok(Some(Outcome::Added { id: example.id, is_new, position: work.corpus.reached() }))
}

#[cfg(test)]
#[path = "jobs/tests.rs"]
mod tests;
