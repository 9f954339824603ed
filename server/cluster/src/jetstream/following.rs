//! Messages of a stream as they come, by a consumer that the engine forgets when nobody asks any more.

use std::time::{Duration, SystemTime};

use async_nats::jetstream::consumer::{AckPolicy, Consumer, DeliverPolicy, pull};
use async_nats::jetstream::stream::Stream;
use futures_util::StreamExt;
use tokio::runtime::Handle;

use super::silent;
use crate::engine::{Deliveries, Delivery, EngineError, Entry};

/// Messages asked for at a time, and bytes.
const BATCH: usize = 500;
/// How long the engine keeps a request for more.
const EXPIRES: Duration = Duration::from_secs(10);
/// How often the engine says that it is there when it has nothing to say.
const HEARTBEAT: Duration = Duration::from_secs(2);
/// How long the engine remembers a follower that doesn't ask.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(60);
const DOING: &str = "deliver";

/// What is wanted of each message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    All,
    /// Its subject and its sequence alone.
    Heads,
}

pub(super) struct Following {
    /// In an option so that it can end where it has to: the client unsubscribes in the background.
    messages: Option<pull::Stream>,
    /// What subjects begin with, before the key.
    prefix: String,
    handle: Handle,
}

impl Drop for Following {
    fn drop(&mut self) {
        let _inside = self.handle.enter();
        drop(self.messages.take());
    }
}

impl Following {
    pub(super) async fn begin(
        stream: &Stream,
        after: u64,
        wanted: Wanted,
        prefix: String,
        handle: Handle,
    ) -> Result<Self, EngineError> {
        let deliver_policy = match after {
            0 => DeliverPolicy::All,
            after => DeliverPolicy::ByStartSequence { start_sequence: after + 1 },
        };
        let config = pull::Config {
            deliver_policy,
            ack_policy: AckPolicy::None,
            inactive_threshold: FORGOTTEN_AFTER,
            headers_only: wanted == Wanted::Heads,
            num_replicas: 1,
            memory_storage: true,
            ..pull::Config::default()
        };
        let consumer: Consumer<pull::Config> =
            stream.create_consumer(config).await.map_err(|error| silent(DOING, error))?;
        let asked = consumer.stream().max_messages_per_batch(BATCH).expires(EXPIRES).heartbeat(HEARTBEAT);
        let messages = asked.messages().await.map_err(|error| silent(DOING, error))?;
        Ok(Self { messages: Some(messages), prefix, handle })
    }

    /// The next message, and when it was put.
    pub(super) fn next_put(&mut self, wait: Duration) -> Result<Option<(Delivery, SystemTime)>, EngineError> {
        let Some(messages) = &mut self.messages else { return Err(silent(DOING, "the following ended")) };
        let next = self.handle.block_on(async { tokio::time::timeout(wait, messages.next()).await });
        let message = match next {
            Err(_) => return Ok(None),
            Ok(None) => return Err(silent(DOING, "the following ended")),
            Ok(Some(message)) => message.map_err(|error| silent(DOING, error))?,
        };
        let info = message.info().map_err(|error| silent(DOING, error))?;
        let key = message.subject.strip_prefix(&self.prefix).unwrap_or_default().to_owned();
        let entry = Entry { position: info.stream_sequence, bytes: message.payload.to_vec() };
        let (number, left, put) = (info.consumer_sequence, info.pending, info.published.into());
        Ok(Some((Delivery { number, key, entry, left }, put)))
    }
}

impl Deliveries for Following {
    fn next(&mut self, wait: Duration) -> Result<Option<Delivery>, EngineError> {
        Ok(self.next_put(wait)?.map(|(delivery, _)| delivery))
    }
}
