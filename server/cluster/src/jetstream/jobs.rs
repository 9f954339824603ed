//! Jobs: a stream from which a message goes when it is acknowledged, and a consumer a kind that all servers draw from.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use async_nats::jetstream::consumer::{AckPolicy, Consumer, pull};
use async_nats::jetstream::stream::Stream;
use async_nats::jetstream::{AckKind, Message};
use futures_util::StreamExt;
use tokio::runtime::Handle;

use super::{ANSWER, silent};
use crate::engine::{EngineError, Job};

/// Most jobs that are being done at a time, of a kind.
const TAKEN_MAX: i64 = 4096;
const DOING: &str = "give a job";

/// The stream of jobs, and who draws from it.
pub(super) struct Jobs {
    pub(super) stream: Stream,
    /// What the subjects begin with: `quadmuse.<bucket>.jobs`.
    pub(super) prefix: String,
    /// For so long nobody else gets a job of which nothing is heard.
    pub(super) lease: Duration,
    takers: Mutex<HashMap<String, Consumer<pull::Config>>>,
}

impl Jobs {
    pub(super) fn of(stream: Stream, prefix: String, lease: Duration) -> Self {
        Self { stream, prefix, lease, takers: Mutex::default() }
    }

    /// The consumer of a kind: the servers share it, and the engine keeps it.
    async fn taker(&self, kind: &str) -> Result<Consumer<pull::Config>, EngineError> {
        let known = self.takers.lock().unwrap_or_else(PoisonError::into_inner).get(kind).cloned();
        if let Some(known) = known {
            return Ok(known);
        }
        let name = format!("takers-{kind}");
        let config = pull::Config {
            durable_name: Some(name.clone()),
            filter_subject: format!("{}.{kind}.>", self.prefix),
            ack_policy: AckPolicy::Explicit,
            ack_wait: self.lease,
            max_deliver: -1,
            max_ack_pending: TAKEN_MAX,
            ..pull::Config::default()
        };
        let made = self.stream.get_or_create_consumer(&name, config).await.map_err(|error| silent(DOING, error))?;
        self.takers.lock().unwrap_or_else(PoisonError::into_inner).insert(kind.to_owned(), made.clone());
        Ok(made)
    }

    pub(super) async fn take(&self, kind: &str, wait: Duration, handle: Handle) -> Result<Option<Taken>, EngineError> {
        let taker = self.taker(kind).await?;
        // It may have been removed from the engine: whoever failed once asks for it anew.
        let forget = |error: String| {
            self.takers.lock().unwrap_or_else(PoisonError::into_inner).remove(kind);
            silent(DOING, error)
        };
        let asked = taker.batch().max_messages(1).expires(wait).messages().await;
        let mut messages = asked.map_err(|error| forget(error.to_string()))?;
        let next = tokio::time::timeout(wait + ANSWER, messages.next()).await;
        let message = match next.map_err(|error| forget(error.to_string()))? {
            None => return Ok(None),
            Some(message) => message.map_err(|error| forget(error.to_string()))?,
        };
        let times_taken = message.info().map_err(|error| silent(DOING, error))?.delivered;
        let name = message.subject.strip_prefix(&format!("{}.{kind}.", self.prefix)).unwrap_or_default().to_owned();
        Ok(Some(Taken { message, name, times_taken: u64::try_from(times_taken).unwrap_or(1), handle }))
    }
}

/// A job that this server has taken.
pub(super) struct Taken {
    message: Message,
    name: String,
    times_taken: u64,
    handle: Handle,
}

impl Taken {
    fn say(&self, kind: AckKind, doing: &'static str) -> Result<(), EngineError> {
        self.handle.block_on(self.message.ack_with(kind)).map_err(|error| silent(doing, error))
    }
}

impl Job for Taken {
    fn name(&self) -> &str {
        &self.name
    }

    fn payload(&self) -> &[u8] {
        &self.message.payload
    }

    fn times_taken(&self) -> u64 {
        self.times_taken
    }

    fn goes_on(&self) -> Result<(), EngineError> {
        self.say(AckKind::Progress, "hear that a job goes on")
    }

    fn done(&self) -> Result<(), EngineError> {
        // The engine says that it has heard it.
        self.handle.block_on(self.message.double_ack()).map_err(|error| silent("hear that a job is done", error))
    }

    fn give_back(&self, pause: Duration) -> Result<(), EngineError> {
        self.say(AckKind::Nak(Some(pause)), "take a job back")
    }
}
