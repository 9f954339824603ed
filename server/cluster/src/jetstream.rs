//! The engine on NATS JetStream; the only module that names its client.
//!
//! Four streams a corpus, replicated over its nodes, of each subject the newest message only:
//!
//! ```text
//! <bucket>_entries   quadmuse.<bucket>.entries.<key>            written with the sequence at which the stream is expected to end
//! <bucket>_objects   quadmuse.<bucket>.objects.<name>.<piece>   piece 0 last, headed by their number (u32 LE)
//! <bucket>_uploads   quadmuse.<bucket>.uploads.<name>.<piece>   the same, for a while: the engine removes what is old
//! <bucket>_jobs      quadmuse.<bucket>.jobs.<kind>.<name>       a work queue: what is acknowledged as done goes
//! ```
//!
//! A position is a sequence of the stream of entries. Writes wait for the acknowledgement, which JetStream gives when a
//! majority of the nodes has the message. It is in their files then, though not synced: a power cut of a majority at once
//! may lose the last two minutes, the end of a process loses nothing.

mod following;
mod jobs;
mod streams;

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use async_nats::jetstream::Context;
use async_nats::jetstream::context::{PublishAckFuture, PublishError, PublishErrorKind};
use async_nats::jetstream::stream::{
    DeleteMessageErrorKind, DirectGetErrorKind, LastRawMessageErrorKind, RetentionPolicy, Stream,
};
use async_nats::jetstream::{Error as Refusal, ErrorCode};
use async_nats::{ConnectOptions, HeaderMap, ServerAddr};
use bytes::Bytes;
use futures_util::StreamExt;
use tokio::runtime::Runtime;

use crate::engine::{Deliveries, Engine, EngineError, Entry, JOBS_KEPT_FOR, Job, UPLOADS_KEPT_FOR, Written};
use crate::options::ClusterOptions;
use following::Following;
use jobs::Jobs;

/// Longest time for one answer of the engine.
const ANSWER: Duration = Duration::from_secs(3);
/// Longest time to try an object in: a leader is elected in some seconds. Who reads waits less long.
const PUT_FOR: Duration = Duration::from_secs(15);
const GET_FOR: Duration = Duration::from_secs(6);
const LEADING: &str = "tell its leader";
/// Bytes of an object in one message; the engine takes a MiB unless told otherwise.
const PIECE_BYTES: usize = 512 << 10;
/// Pieces of an object that are under way at a time.
const PIECES_AT_ONCE: usize = 8;
/// Pieces of an object at most: more than the largest upload has.
const PIECES_MAX: u32 = 4096;
/// Bytes before the contents of piece 0.
const HEAD_BYTES: usize = 4;
/// Pause between attempts.
const PAUSE: Duration = Duration::from_millis(250);

/// A corpus on JetStream.
pub struct JetStream {
    /// Its own, since callers block; in an option so that it can be ended without waiting.
    runtime: Option<Runtime>,
    context: Context,
    entries: Stream,
    objects: Pieces,
    uploads: Pieces,
    uploads_bytes: u64,
    jobs: Jobs,
    bucket: String,
    /// Where the stream of entries ended when this server wrote last. Held while it writes.
    last: Mutex<Option<u64>>,
}

/// A stream of bytes under names, each in pieces.
struct Pieces {
    stream: Stream,
    /// What the subjects begin with: `quadmuse.<bucket>.<kind>`.
    prefix: String,
}

impl Pieces {
    fn subject(&self, name: &str, piece: u32) -> String {
        format!("{}.{name}.{piece}", self.prefix)
    }
}

impl Drop for JetStream {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn silent(doing: &'static str, error: impl std::fmt::Display) -> EngineError {
    EngineError::Silent { doing, reason: error.to_string() }
}

fn refused(doing: &'static str, error: impl std::fmt::Display) -> EngineError {
    EngineError::Refused { doing, reason: error.to_string() }
}

/// What the engine says where it has no room left.
const NO_ROOM: [ErrorCode; 4] = [
    ErrorCode::ACCOUNT_RESOURCES_EXCEEDED,
    ErrorCode::INSUFFICIENT_RESOURCES,
    ErrorCode::STORAGE_RESOURCES_EXCEEDED,
    ErrorCode::STREAM_STORE_FAILED,
];

/// Why a message was not acknowledged.
fn unkept(doing: &'static str, error: &PublishError) -> EngineError {
    let refusal = std::error::Error::source(error).and_then(|source| source.downcast_ref::<Refusal>());
    match refusal {
        Some(refusal) if NO_ROOM.contains(&refusal.error_code()) => {
            EngineError::Full { doing, reason: refusal.to_string() }
        }
        _ => silent(doing, error),
    }
}

/// Whether a message was refused because one of its subject waits already. The engine has no code for that alone.
fn is_there_already(error: &PublishError) -> bool {
    let refusal = std::error::Error::source(error).and_then(|source| source.downcast_ref::<Refusal>());
    refusal.is_some_and(|refusal| refusal.to_string().contains("maximum messages per subject"))
}

impl JetStream {
    /// Reaches the engine, and creates the corpus there if it isn't yet. Blocks.
    ///
    /// # Errors
    /// [`EngineError`] if the options make no sense, no node answers in time, or the engine can't keep the replicas asked for.
    pub fn connect(options: &ClusterOptions) -> Result<Self, EngineError> {
        const DOING: &str = "be reached";
        if let Some(fault) = options.fault() {
            return Err(refused(DOING, fault));
        }
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_name("cluster-client")
            .enable_all()
            .build()
            .map_err(|error| refused(DOING, error))?;
        let begun = Instant::now();
        let reached = runtime.block_on(async {
            loop {
                match reach(options).await {
                    Err(EngineError::Silent { .. }) if begun.elapsed() < options.reach => {
                        tokio::time::sleep(PAUSE).await;
                    }
                    reached => return reached,
                }
            }
        });
        match reached {
            Ok((context, [entries, objects, uploads, jobs])) => Ok(Self {
                runtime: Some(runtime),
                context,
                entries,
                objects: Pieces { stream: objects, prefix: format!("quadmuse.{}.objects", options.bucket) },
                uploads: Pieces { stream: uploads, prefix: format!("quadmuse.{}.uploads", options.bucket) },
                uploads_bytes: options.uploads_bytes,
                jobs: Jobs::of(jobs, format!("quadmuse.{}.jobs", options.bucket), options.lease),
                bucket: options.bucket.clone(),
                last: Mutex::new(None),
            }),
            Err(error) => {
                runtime.shutdown_background();
                Err(error)
            }
        }
    }

    /// The name of the node that leads the entries; `None` while there is none, or only one node.
    ///
    /// # Errors
    /// [`EngineError`].
    pub fn entries_leader(&self) -> Result<Option<String>, EngineError> {
        self.wait(LEADING, leader_of(&self.entries))
    }

    /// Runs to its end what the client does.
    fn wait<T>(
        &self,
        doing: &'static str,
        what: impl Future<Output = Result<T, EngineError>>,
    ) -> Result<T, EngineError> {
        match &self.runtime {
            Some(runtime) => runtime.block_on(what),
            None => Err(silent(doing, "it was left")),
        }
    }

    fn entry_subject(&self, key: &str) -> String {
        format!("quadmuse.{}.entries.{key}", self.bucket)
    }

    async fn publish(&self, subject: String, bytes: Bytes) -> Result<PublishAckFuture, EngineError> {
        self.context.publish(subject, bytes).await.map_err(|error| silent("keep a message", error))
    }

    async fn piece(&self, pieces: &Pieces, name: &str, piece: u32) -> Result<Option<Bytes>, EngineError> {
        const DOING: &str = "give a piece of an object";
        let subject = pieces.subject(name, piece);
        match tokio::time::timeout(ANSWER, pieces.stream.direct_get_last_for_subject(&subject)).await {
            Ok(Ok(message)) => return Ok(Some(message.payload)),
            Ok(Err(error)) if error.kind() == DirectGetErrorKind::NotFound => {}
            Ok(Err(error)) => tracing::debug!(%error, "a node did not answer; its leader is asked"),
            Err(_) => tracing::debug!("a node did not answer in time; its leader is asked"),
        }
        // The node that was asked may be behind: only the leader can say that there is none.
        Ok(newest(&pieces.stream, &subject, DOING).await?.map(|entry| entry.bytes.into()))
    }

    /// Writes an entry on the condition that nothing at all was written since its position was looked up: that the engine
    /// checks where it keeps the message. (A condition on the subject alone is checked by a clustered 2.9 before what is
    /// under way is kept: of 240 writes that it acknowledged so, 93 had overwritten each other.)
    async fn write_after(
        &self,
        last: &mut Option<u64>,
        key: &str,
        expected: u64,
        bytes: &[u8],
    ) -> Result<Written, EngineError> {
        const DOING: &str = "keep an entry";
        let (subject, payload, begun) = (self.entry_subject(key), Bytes::copy_from_slice(bytes), Instant::now());
        while begun.elapsed() < ANSWER {
            // First the end of the stream, then the entry: what is written in between is noticed.
            let end = match last.take() {
                Some(end) => end,
                None => self.end_of(&self.entries, DOING).await?,
            };
            let there = newest(&self.entries, &subject, DOING).await?.map_or(0, |entry| entry.position);
            if there != expected {
                *last = Some(end);
                return Ok(Written::Elsewhere);
            }
            let mut headers = HeaderMap::new();
            headers.insert("Nats-Expected-Last-Sequence", end.to_string());
            let sent = self.context.publish_with_headers(subject.clone(), headers, payload.clone()).await;
            match sent.map_err(|error| silent(DOING, error))?.await {
                Ok(ack) => {
                    *last = Some(ack.sequence);
                    return Ok(Written::At(ack.sequence));
                }
                // Another server was faster, with this or another entry.
                Err(error) if error.kind() == PublishErrorKind::WrongLastSequence => {}
                Err(error) => return Err(unkept(DOING, &error)),
            }
        }
        Err(silent(DOING, "others write all the time"))
    }

    async fn end_of(&self, stream: &Stream, doing: &'static str) -> Result<u64, EngineError> {
        let info = stream.get_info().await.map_err(|error| silent(doing, error))?;
        Ok(info.state.last_sequence)
    }

    async fn put(&self, into: &Pieces, name: &str, bytes: &[u8]) -> Result<(), EngineError> {
        const DOING: &str = "keep an object";
        let acknowledged = async |ack: PublishAckFuture| ack.await.map_err(|error| unkept(DOING, &error));
        let (first, rest) = bytes.split_at(bytes.len().min(PIECE_BYTES));
        let pieces: Vec<&[u8]> = rest.chunks(PIECE_BYTES).collect();
        let count = u32::try_from(1 + pieces.len()).unwrap_or(u32::MAX);
        if count > PIECES_MAX {
            return Err(refused(DOING, format!("{} bytes are too many", bytes.len())));
        }
        for some in (1u32..).zip(&pieces).collect::<Vec<_>>().chunks(PIECES_AT_ONCE) {
            let mut sent = Vec::with_capacity(some.len());
            for (number, piece) in some {
                sent.push(self.publish(into.subject(name, *number), Bytes::copy_from_slice(piece)).await?);
            }
            for ack in sent {
                acknowledged(ack).await?;
            }
        }
        // Piece 0 says that the others are there.
        let head = [&count.to_le_bytes()[..], first].concat();
        acknowledged(self.publish(into.subject(name, 0), head.into()).await?).await.map(drop)
    }

    /// Removes the oldest of what is kept for a while until `more` bytes fit.
    async fn make_room(&self, more: u64) -> Result<(), EngineError> {
        const DOING: &str = "make room for an upload";
        loop {
            let state = self.uploads.stream.get_info().await.map_err(|error| silent(DOING, error))?.state;
            if state.messages == 0 || state.bytes.saturating_add(more) <= self.uploads_bytes {
                return Ok(());
            }
            // A quarter of them, so that this is not done for each one that comes.
            let end = state.first_sequence + (state.last_sequence - state.first_sequence) / 4 + 1;
            self.uploads.stream.purge().sequence(end).await.map_err(|error| silent(DOING, error))?;
        }
    }

    async fn get(&self, from: &Pieces, name: &str) -> Result<Option<Vec<u8>>, EngineError> {
        let Some(head) = self.piece(from, name, 0).await? else { return Ok(None) };
        let Some((count, first)) = head.split_first_chunk::<HEAD_BYTES>() else { return Ok(None) };
        let mut bytes = first.to_vec();
        for number in 1..u32::from_le_bytes(*count).min(PIECES_MAX) {
            match self.piece(from, name, number).await? {
                Some(piece) => bytes.extend_from_slice(&piece),
                None => return Ok(None),
            }
        }
        Ok(Some(bytes))
    }
}

/// Tries until the engine answers, or for so long.
fn again<T>(time: Duration, what: impl Fn() -> Result<T, EngineError>) -> Result<T, EngineError> {
    let begun = Instant::now();
    loop {
        match what() {
            Err(EngineError::Silent { .. }) if begun.elapsed() < time => std::thread::sleep(PAUSE),
            tried => return tried,
        }
    }
}

/// One attempt to reach the engine and find, or make, the streams.
async fn reach(options: &ClusterOptions) -> Result<(Context, [Stream; 4]), EngineError> {
    const DOING: &str = "be reached";
    let addresses: Result<Vec<ServerAddr>, _> = options.addresses().map(|node| node.parse()).collect();
    let addresses = addresses.map_err(|error| refused(DOING, error))?;
    let mut connect = ConnectOptions::new()
        .name("quadmuse-server")
        .connection_timeout(ANSWER)
        .request_timeout(Some(ANSWER))
        .ping_interval(Duration::from_secs(5));
    if let Some((user, password)) = options.login() {
        connect = connect.user_and_password(user, password);
    }
    let access = &options.access;
    if let Some(file) = &access.credentials {
        let read = connect.credentials_file(file).await;
        connect = read.map_err(|error| refused("take its credentials", format!("{}: {error}", file.display())))?;
    }
    if let Some(file) = &access.authorities {
        connect = connect.add_root_certificates(file.clone()).require_tls(true);
    }
    if let Some((certificate, key)) = &access.certificate {
        connect = connect.add_client_certificate(certificate.clone(), key.clone()).require_tls(true);
    }
    let client = connect.connect(addresses).await.map_err(|error| silent(DOING, error))?;
    let payload = client.server_info().max_payload;
    if payload < PIECE_BYTES + HEAD_BYTES + 4096 {
        return Err(refused(DOING, format!("its max_payload is {payload} bytes, 1 MiB is needed")));
    }
    let mut context = async_nats::jetstream::new(client);
    context.set_timeout(ANSWER);
    let kept = |kind, age| streams::Wanted { kind, age, retention: RetentionPolicy::Limits };
    let jobs = streams::Wanted { retention: RetentionPolicy::WorkQueue, ..kept("jobs", JOBS_KEPT_FOR) };
    let entries = streams::find_or_make(&context, options, kept("entries", Duration::ZERO)).await?;
    let objects = streams::find_or_make(&context, options, kept("objects", Duration::ZERO)).await?;
    let uploads = streams::find_or_make(&context, options, kept("uploads", UPLOADS_KEPT_FOR)).await?;
    let jobs = streams::find_or_make(&context, options, jobs).await?;
    Ok((context, [entries, objects, uploads, jobs]))
}

/// The node that leads a stream; `None` while there is none, or only one node.
async fn leader_of(stream: &Stream) -> Result<Option<String>, EngineError> {
    let info = stream.get_info().await.map_err(|error| silent(LEADING, error))?;
    Ok(info.cluster.and_then(|cluster| cluster.leader))
}

/// The newest message of a subject, as the stream's leader has it.
async fn newest(stream: &Stream, subject: &str, doing: &'static str) -> Result<Option<Entry>, EngineError> {
    match stream.get_last_raw_message_by_subject(subject).await {
        Ok(message) => Ok(Some(Entry { position: message.sequence, bytes: message.payload.to_vec() })),
        Err(error) => match error.kind() {
            LastRawMessageErrorKind::NoMessageFound => Ok(None),
            LastRawMessageErrorKind::JetStream(found) if found.error_code() == ErrorCode::NO_MESSAGE_FOUND => Ok(None),
            _ => Err(silent(doing, error)),
        },
    }
}

/// Deletes a message by its position; tells whether its subject has none now.
async fn deleted(stream: &Stream, (position, subject): (u64, &str), doing: &'static str) -> Result<bool, EngineError> {
    let error = match stream.delete_message(position).await {
        Ok(is_deleted) => return Ok(is_deleted),
        Err(error) => error,
    };
    // Another server deleted it, or it was put again meanwhile, or it was the answer to the deletion that was lost.
    let is_gone = |refusal: &Refusal| {
        refusal.error_code() == ErrorCode::STREAM_MESSAGE_DELETE_FAILED
            && refusal.to_string().contains("no message found")
    };
    match error.kind() {
        DeleteMessageErrorKind::JetStream(refusal) if is_gone(&refusal) => {
            Ok(newest(stream, subject, doing).await?.is_none())
        }
        _ => Err(silent(doing, error)),
    }
}

impl Engine for JetStream {
    fn put_object(&self, name: &str, bytes: &[u8]) -> Result<(), EngineError> {
        // The same bytes again: an object that was kept although its answer was lost is only kept anew.
        again(PUT_FOR, || self.wait("keep an object", self.put(&self.objects, name, bytes)))
    }

    fn object(&self, name: &str) -> Result<Option<Vec<u8>>, EngineError> {
        again(GET_FOR, || self.wait("give an object", self.get(&self.objects, name)))
    }

    fn keep_upload(&self, name: &str, bytes: &[u8]) -> Result<(), EngineError> {
        const DOING: &str = "keep an upload";
        // One that takes most of the room would push out everybody else's.
        if bytes.len() as u64 > self.uploads_bytes / 4 {
            return Err(refused(DOING, format!("{} bytes are too many", bytes.len())));
        }
        self.wait(DOING, self.make_room(bytes.len() as u64))?;
        again(PUT_FOR, || self.wait(DOING, self.put(&self.uploads, name, bytes)))
    }

    fn upload(&self, name: &str) -> Result<Option<Vec<u8>>, EngineError> {
        again(GET_FOR, || self.wait("give an upload", self.get(&self.uploads, name)))
    }

    fn remove_upload(&self, name: &str) -> Result<(), EngineError> {
        const DOING: &str = "remove an upload";
        let subject = format!("{}.{name}.>", self.uploads.prefix);
        self.wait(DOING, async {
            self.uploads.stream.purge().filter(subject).await.map(drop).map_err(|error| silent(DOING, error))
        })
    }

    fn write(&self, key: &str, expected: u64, bytes: &[u8]) -> Result<Written, EngineError> {
        // Of this server's writers one at a time: they would only send each other back.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        self.wait("keep an entry", self.write_after(&mut last, key, expected, bytes))
    }

    fn read(&self, key: &str) -> Result<Option<Entry>, EngineError> {
        const DOING: &str = "give an entry";
        self.wait(DOING, newest(&self.entries, &self.entry_subject(key), DOING))
    }

    fn newest(&self) -> Result<u64, EngineError> {
        const DOING: &str = "tell its newest entry";
        self.wait(DOING, self.end_of(&self.entries, DOING))
    }

    fn keys(&self) -> Result<u64, EngineError> {
        const DOING: &str = "count its keys";
        // Of each key it keeps the newest entry alone.
        self.wait(DOING, async {
            let info = self.entries.get_info().await.map_err(|error| silent(DOING, error))?;
            Ok(info.state.messages)
        })
    }

    fn key_names(&self) -> Result<Vec<String>, EngineError> {
        const DOING: &str = "name its keys";
        let prefix = self.entry_subject("");
        self.wait(DOING, async {
            let named = self.entries.info_with_subjects(self.entry_subject(">")).await;
            let mut subjects = named.map_err(|error| silent(DOING, error))?;
            let mut names = Vec::new();
            while let Some(subject) = subjects.next().await {
                let (subject, _) = subject.map_err(|error| silent(DOING, error))?;
                names.extend(subject.strip_prefix(&prefix).map(str::to_owned));
            }
            Ok(names)
        })
    }

    fn leader(&self) -> Result<String, EngineError> {
        self.wait(LEADING, async {
            let (entries, objects) = (leader_of(&self.entries).await?, leader_of(&self.objects.stream).await?);
            Ok(format!("{entries:?}, {objects:?}"))
        })
    }

    fn follow(&self, after: u64) -> Result<Box<dyn Deliveries>, EngineError> {
        const DOING: &str = "be followed";
        let prefix = self.entry_subject("");
        let handle = self.runtime.as_ref().map(|runtime| runtime.handle().clone());
        let handle = handle.ok_or_else(|| silent(DOING, "it was left"))?;
        let following =
            self.wait(DOING, Following::begin(&self.entries, after, following::Wanted::All, prefix, handle))?;
        Ok(Box::new(following))
    }

    fn add_job(&self, kind: &str, name: &str, payload: &[u8]) -> Result<bool, EngineError> {
        const DOING: &str = "take a job";
        let subject = format!("{}.{kind}.{name}", self.jobs.prefix);
        let payload = Bytes::copy_from_slice(payload);
        self.wait(DOING, async {
            match self.publish(subject, payload).await?.await {
                Ok(_) => Ok(true),
                Err(error) if is_there_already(&error) => Ok(false),
                Err(error) => Err(unkept(DOING, &error)),
            }
        })
    }

    fn take_job(&self, kind: &str, wait: Duration) -> Result<Option<Box<dyn Job>>, EngineError> {
        const DOING: &str = "give a job";
        let handle = self.runtime.as_ref().map(|runtime| runtime.handle().clone());
        let handle = handle.ok_or_else(|| silent(DOING, "it was left"))?;
        let taken = self.wait(DOING, self.jobs.take(kind, wait, handle))?;
        Ok(taken.map(|taken| Box::new(taken) as Box<dyn Job>))
    }

    fn jobs(&self) -> Result<u64, EngineError> {
        const DOING: &str = "count its jobs";
        self.wait(DOING, async {
            let info = self.jobs.stream.get_info().await.map_err(|error| silent(DOING, error))?;
            Ok(info.state.messages)
        })
    }

    fn clock(&self) -> Result<SystemTime, EngineError> {
        const DOING: &str = "tell its time";
        self.wait(DOING, async {
            let mut last = SystemTime::UNIX_EPOCH;
            for stream in [&self.entries, &self.objects.stream] {
                let info = stream.get_info().await.map_err(|error| silent(DOING, error))?;
                last = last.max(info.state.last_timestamp.into());
            }
            Ok(last)
        })
    }

    fn collect(&self, before: SystemTime, is_used: &dyn Fn(&str) -> bool) -> Result<u64, EngineError> {
        const DOING: &str = "remove objects";
        let prefix = format!("{}.", self.objects.prefix);
        let handle = self.runtime.as_ref().map(|runtime| runtime.handle().clone());
        let handle = handle.ok_or_else(|| silent(DOING, "it was left"))?;
        let newest = self.wait(DOING, self.end_of(&self.objects.stream, DOING))?;
        let begin = Following::begin(&self.objects.stream, 0, following::Wanted::Heads, prefix.clone(), handle);
        let mut following = self.wait(DOING, begin)?;
        let mut gone = std::collections::HashSet::new();
        let mut position = 0;
        while position < newest {
            let Some((delivery, put)) = following.next_put(ANSWER)? else { break };
            position = delivery.entry.position;
            let name = delivery.key.split('.').next().unwrap_or_default().to_owned();
            if put < before && !is_used(&name) {
                // By its sequence: one that was put again meanwhile has another.
                let subject = format!("{prefix}{}", delivery.key);
                if self.wait(DOING, deleted(&self.objects.stream, (position, &subject), DOING))? {
                    gone.insert(name);
                }
            }
            if delivery.left == 0 {
                break;
            }
        }
        Ok(gone.len() as u64)
    }
}
