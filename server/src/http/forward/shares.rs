//! Between servers that hold the corpus's pictures in memory together, each a share of them: questions, and answers.
//!
//! A question goes to one of the servers with the share, in turn; where it gives no answer, the next is asked. The seal of
//! the request is for its target, which names the hash of the question, so that no other can be put in its place.

use super::link::{Fault, Link};
use super::{FromPeer, PASSED, Signs};
use crate::app::App;
use crate::http::error::HttpError;
use crate::peers::{HoldersOf, Peers};
use crate::work::search::scattered;
use crate::work::shares::Holders;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use bytes::Bytes;
use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use http_body_util::{BodyExt, Limited};
use quadmuse_proto::Share;
use quadmuse_proto::id::ServerNumber;
use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Where questions are answered. Not of the contract: only servers of the same corpus are heard.
pub const PATH: &str = "/peers/share";

/// Longest question, in bytes: some hundred choices of poles for examples of each topology.
const QUESTION_BYTES_MAX: usize = 8 << 20;
/// Longest answer, in bytes: 512 entries, of which 128 have a row.
const ANSWER_BYTES_MAX: usize = 8 << 20;
/// Longest time for one answer. A server that is gone is noticed in two seconds.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(60);
/// For so long a server that gave no answer is asked after the others.
const AVOIDED_FOR: Duration = Duration::from_secs(10);

/// The holders among the servers that share the corpus.
pub struct PeerHolders {
    peers: Arc<Peers>,
    signs: Arc<Signs>,
    turn: AtomicUsize,
    avoided: Mutex<HashMap<ServerNumber, Instant>>,
}

impl PeerHolders {
    /// Those of a list of servers.
    pub fn of(peers: Arc<Peers>, signs: Arc<Signs>) -> Self {
        Self { peers, signs, turn: AtomicUsize::new(0), avoided: Mutex::default() }
    }

    /// Whom to ask, in this order: those with the share in turn, then who holds everything; those that failed just now, and
    /// those of whom nothing was heard for long, last.
    fn order(&self, share: Share) -> Vec<(ServerNumber, String)> {
        let HoldersOf { mut exact, whole, silent } = self.peers.holders(share);
        if !exact.is_empty() {
            let turn = self.turn.fetch_add(1, Ordering::Relaxed) % exact.len();
            exact.rotate_left(turn);
        }
        let mut avoided = self.avoided.lock().unwrap_or_else(PoisonError::into_inner);
        avoided.retain(|_, since| since.elapsed() < AVOIDED_FOR);
        exact.extend(whole);
        // Stable: among each kind the order stays.
        exact.sort_by_key(|(number, _)| avoided.contains_key(number));
        exact.extend(silent);
        exact
    }

    async fn asked(&self, (to, address): (ServerNumber, &str), question: Bytes) -> Result<Bytes, Fault> {
        let target = format!("{PATH}?question={}", blake3::hash(&question).to_hex());
        let sealed = self.peers.seal(to, None, "POST", &target);
        let request = Request::post(&target)
            .header(header::HOST, address.trim_start_matches("http://"))
            .header(header::CONTENT_TYPE, "application/msgpack")
            // Letters, digits and a few signs.
            .header(PASSED, HeaderValue::try_from(sealed).map_err(|error| Fault::Broken(error.into()))?)
            .body(Body::from(question))
            .map_err(|error| Fault::Broken(error.into()))?;
        let answer = Link::to(address, &self.signs).await?.ask(request).await?;
        let (head, body) = answer.into_parts();
        if head.status != StatusCode::OK {
            return Err(Fault::Broken(head.status.to_string().into()));
        }
        Ok(Limited::new(body, ANSWER_BYTES_MAX).collect().await.map_err(Fault::Broken)?.to_bytes())
    }
}

impl Holders for PeerHolders {
    fn ask(&self, share: Share, question: Bytes) -> BoxFuture<'_, Option<Bytes>> {
        async move {
            for (number, address) in self.order(share) {
                let asked = self.asked((number, &address), question.clone());
                match tokio::time::timeout(ANSWER_TIME_MAX, asked).await {
                    Ok(Ok(answer)) => return Some(answer),
                    Ok(Err(fault)) => {
                        tracing::warn!(server = number.get(), address, %share, reason = fault.word(), "no answer for a share");
                    }
                    Err(_) => tracing::warn!(server = number.get(), address, %share, "no answer for a share in time"),
                }
                self.avoided.lock().unwrap_or_else(PoisonError::into_inner).insert(number, Instant::now());
            }
            None
        }
        .boxed()
    }

    fn count(&self, share: Share) -> usize {
        let HoldersOf { exact, whole, .. } = self.peers.holders(share);
        exact.len() + whole.len()
    }
}

/// Answers another server's question for the best of the share that is in memory here.
///
/// # Errors
/// [`HttpError::NoRoute`] to whoever is no server of the corpus; those of [`scattered::answer`].
pub async fn answer(State(app): State<App>, request: Request) -> Result<Vec<u8>, HttpError> {
    let stranger = || HttpError::NoRoute { path: PATH.into() };
    let Some(FromPeer(passed)) = request.extensions().get::<FromPeer>().copied() else { return Err(stranger()) };
    if app.peers.as_ref().is_none_or(|peers| peers.own() != passed.to) {
        return Err(stranger());
    }
    let asked = request.uri().query().map(str::to_owned);
    let body = Limited::new(request.into_body(), QUESTION_BYTES_MAX).collect().await;
    let question = body.map_err(|_| stranger())?.to_bytes();
    let hash = blake3::hash(&question).to_hex();
    if asked != Some(format!("question={hash}")) {
        return Err(stranger());
    }
    Ok(scattered::answer(&app.work, question).await?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peers::tests::InMemory;

    #[test]
    fn those_with_a_share_are_asked_in_turn_then_who_holds_everything_and_last_who_failed_just_now() {
        let documents: Arc<InMemory> = Arc::default();
        let share: Share = "2/2".parse().expect("a share");
        let join = |address: &str, share| {
            Arc::new(Peers::join_with(Arc::clone(&documents) as Arc<_>, address, share).expect("joined"))
        };
        let own = join("http://own:1", "1/2".parse().ok());
        let [b, c] = ["http://b:1", "http://c:1"].map(|address| join(address, Some(share)).own());
        let whole = join("http://whole:1", None).own();
        let holders = PeerHolders::of(own, Arc::default());
        let order = || holders.order(share).into_iter().map(|(number, _)| number).collect::<Vec<_>>();
        assert_eq!([order(), order(), order()], [[b, c, whole], [c, b, whole], [b, c, whole]]);
        assert_eq!(holders.count(share), 3);
        holders.avoided.lock().expect("not poisoned").insert(c, Instant::now());
        assert_eq!([order(), order()], [[b, whole, c], [b, whole, c]]);
    }
}
