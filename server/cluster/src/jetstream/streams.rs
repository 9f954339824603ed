//! The streams of a corpus: found, or made with the replicas asked for.

use async_nats::jetstream::Context;
use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::context::{CreateStreamErrorKind, GetStreamErrorKind};
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType, Stream};

use std::time::Duration;

use super::{refused, silent};
use crate::engine::EngineError;
use crate::options::ClusterOptions;

/// A stream of the corpus.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    /// `entries`, `objects`, `uploads` or `jobs`.
    pub(super) kind: &'static str,
    /// Messages that are older are removed by the engine; zero: none is.
    pub(super) age: Duration,
    /// Whether acknowledged messages are removed.
    pub(super) retention: RetentionPolicy,
}

/// Finds a stream, or makes it.
pub(super) async fn find_or_make(
    context: &Context,
    options: &ClusterOptions,
    wanted: Wanted,
) -> Result<Stream, EngineError> {
    const DOING: &str = "find the corpus";
    let name = format!("{}_{}", options.bucket, wanted.kind);
    match context.get_stream(&name).await {
        Ok(stream) => {
            let replicas = stream.cached_info().config.num_replicas;
            if replicas < options.replicas() {
                let asked = options.replicas();
                tracing::warn!(stream = name, replicas, asked, "the corpus is kept fewer times than asked for");
            }
            Ok(stream)
        }
        Err(error) => match error.kind() {
            GetStreamErrorKind::JetStream(found) if found.error_code() == ErrorCode::STREAM_NOT_FOUND => {
                make(context, options, name, wanted).await
            }
            _ => Err(silent(DOING, error)),
        },
    }
}

async fn make(
    context: &Context,
    options: &ClusterOptions,
    name: String,
    Wanted { kind, age, retention }: Wanted,
) -> Result<Stream, EngineError> {
    const DOING: &str = "make the corpus";
    let config = Config {
        subjects: vec![format!("quadmuse.{}.{kind}.>", options.bucket)],
        description: Some(format!("Quadmuse, {kind} of the corpus {}", options.bucket)),
        retention,
        // Of each subject the newest; of jobs the one that waits; nothing is ever discarded for want of room.
        max_messages_per_subject: 1,
        max_age: age,
        discard: DiscardPolicy::New,
        discard_new_per_subject: retention == RetentionPolicy::WorkQueue,
        storage: StorageType::File,
        num_replicas: options.replicas(),
        allow_direct: true,
        name,
        ..Config::default()
    };
    let made = context.create_stream(config).await;
    made.map_err(|error| match error.kind() {
        // A node alone. In a cluster that is still forming there are too few nodes for a while: that is tried again.
        CreateStreamErrorKind::JetStream(found) if found.error_code() == ErrorCode::STREAM_REPLICAS_NOT_SUPPORTED => {
            let asked = options.replicas();
            refused(
                DOING,
                format!("it is one node, and keeps nothing {asked} times: give --cluster-replicas 1, or add nodes"),
            )
        }
        _ => silent(DOING, error),
    })
}
