//! The streams of a corpus: found, or made with the replicas asked for.

use async_nats::jetstream::Context;
use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::context::{CreateStreamError, CreateStreamErrorKind, GetStreamErrorKind};
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
            let (info, asked) = (stream.cached_info(), options.replicas());
            // An engine of one node keeps nothing more than once, and nobody said otherwise.
            let may = options.replicas.is_some() || info.cluster.is_some();
            if may && info.config.num_replicas < asked {
                raise(context, &info.config, asked).await;
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

/// Has a stream kept on more nodes from now on, if they are there.
async fn raise(context: &Context, now: &Config, asked: usize) {
    let (stream, replicas) = (&now.name, now.num_replicas);
    match context.update_stream(Config { num_replicas: asked, ..now.clone() }).await {
        Ok(_) => {
            tracing::warn!(stream, replicas, asked, "the corpus was kept fewer times than asked for; it is copied")
        }
        Err(error) => tracing::warn!(stream, replicas, asked, %error, "the corpus is kept fewer times than asked for"),
    }
}

async fn make(
    context: &Context,
    options: &ClusterOptions,
    name: String,
    Wanted { kind, age, retention }: Wanted,
) -> Result<Stream, EngineError> {
    const DOING: &str = "make the corpus";
    let mut config = Config {
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
    let mut made = context.create_stream(config.clone()).await;
    if options.replicas.is_none() && made.as_ref().is_err_and(is_one_node) {
        config.num_replicas = 1;
        made = context.create_stream(config).await;
    }
    made.map_err(|error| {
        let asked = options.replicas();
        let one =
            || format!("it is one node, and keeps nothing {asked} times: give --cluster-replicas 1, or add nodes");
        if is_one_node(&error) { refused(DOING, one()) } else { silent(DOING, error) }
    })
}

/// The engine is a single node. Another error tells of a cluster that is still forming and has too few nodes: that is tried again.
fn is_one_node(error: &CreateStreamError) -> bool {
    matches!(error.kind(), CreateStreamErrorKind::JetStream(found)
        if found.error_code() == ErrorCode::STREAM_REPLICAS_NOT_SUPPORTED)
}
