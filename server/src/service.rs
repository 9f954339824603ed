//! A running service: its parts joined, from the store on disk, or the corpus that servers share, to the open port.

mod cluster;

use crate::app::{App, ClusterHandles, Settings};
use crate::audit::Audit;
use crate::auth::{Access, NOTE_USES_EVERY, Tokens};
use crate::config::Config;
use crate::connections::{ConnectionLimits, Connections};
use crate::http;
use crate::peers::{self, Peers};
use crate::pool::{Admission, Pool, taken};
use crate::shutdown::serve;
use crate::work::corpus::stored::StoredCorpus;
use crate::work::engine::Engine;
use crate::work::jobs::Queue;
use crate::work::kept::{Files, KeptQueries};
use crate::work::uploads::{self, Uploads};
use crate::work::{Work, follow, jobs, queries, reencode, scrub};
use quadmuse_store::{Backend, OpenOptions, StoreError};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::{TcpListener, TcpSocket};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Jobs that compute or wait for it, at most.
const JOBS_MAX: usize = 1024;

/// Connections that may wait to be accepted. One that finds no room is tried again by its system a second later, so that a
/// thousand watchers who come at once would hold up a health check by that.
const BACKLOG: u32 = 4096;

/// Longest time for commits under way to end after the last connection.
const COMMIT_TIME_MAX: Duration = Duration::from_millis(1500);

/// Longest time to tell the other servers that this one ends.
const LEAVE_TIME_MAX: Duration = Duration::from_millis(500);

/// The index's pages may take this part of the memory, within bounds in bytes.
const INDEX_SHARE: u64 = 8;
const INDEX_BYTES: (u64, u64) = (16 << 20, 256 << 20);

/// Why a service does not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// Others could reach a service that lets everybody in.
    #[error(
        "expected a loopback address or a token, found {listen} and no token; create one by `quadmuse-server token create`, or give --open"
    )]
    Open {
        /// Where it would listen.
        listen: SocketAddr,
    },
    /// The address is taken, or not ours.
    #[error("expected to listen on {listen}, found that the system refuses: {source}")]
    Listen {
        /// Where it would listen.
        listen: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// The store can't be opened.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The system gives no threads.
    #[error("expected threads from the system, found none: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A part of the start was interrupted.
    #[error("expected the start to end, found it interrupted")]
    Interrupted,
}

/// A running service. Dropping it leaves it running; see [`Running::stop`].
pub struct Running {
    /// Where it listens.
    pub address: SocketAddr,
    /// What it does.
    pub work: Arc<Work>,
    peers: Option<Arc<Peers>>,
    stopping: CancellationToken,
    serving: JoinHandle<()>,
    background: JoinHandle<()>,
    jobs: JoinHandle<()>,
}

/// Starts a service on the store that `config` names; it answers when this returns.
///
/// # Errors
/// [`StartError`].
pub async fn start(config: &Config, engine: Arc<dyn Engine>) -> Result<Running, StartError> {
    ignore_file_size_signal();
    // A corpus that servers share has their tokens, too: it comes first then.
    let shared = match &config.cluster {
        Some(options) => Some(cluster::join(options, &config.data, config.share).await?),
        None => None,
    };
    let tokens = match shared.clone().and_then(Backend::documents) {
        Some(documents) => Tokens::shared(documents),
        None => Tokens::beside(&config.data),
    };
    let tokens = Arc::new(tokens);
    check_open(config, &tokens)?;
    let listen = config.listen;
    let listener = listener(listen).map_err(|source| StartError::Listen { listen, source })?;
    let address = listener.local_addr().map_err(|source| StartError::Listen { listen, source })?;
    let together = match &shared {
        Some(shared) => ClusterHandles {
            kept: KeptQueries::on(Arc::new(cluster::SharedUploads(Arc::clone(shared)))),
            peers: Some(cluster::meet(shared, config.advertise.as_deref(), config.share, address).await?),
            signs: Arc::default(),
        },
        None => ClusterHandles {
            kept: KeptQueries::on(Arc::new(Files::beside(&config.data))),
            peers: None,
            signs: Arc::default(),
        },
    };
    let peers = together.peers.clone();
    let pool = Pool::new(config.threads, Admission::new(config.memory_limit, JOBS_MAX))?;
    let queue = shared.clone().map(|shared| Arc::new(cluster::SharedQueue(shared)) as Arc<dyn Queue>);
    let corpus = match shared {
        Some(shared) => cluster::corpus_of(shared, &engine).await?,
        None => open_corpus(&config.data, config.memory_limit).await?,
    };
    let number = together.peers.as_ref().map(|peers| peers.own());
    let work = Work::holding(config.share, number, pool, engine, Arc::new(corpus));
    if let Some(queue) = queue {
        let _ = work.queue.set(queue);
    }
    let began = Instant::now();
    let loading = work.blocking(|work| {
        work.load();
        Ok(())
    });
    loading.await.map_err(|_| StartError::Interrupted)?;
    let snapshot = work.catalogue.snapshot();
    let (examples, segments) = (snapshot.example_count(), snapshot.segment_count());
    tracing::info!(examples, segments, ms = began.elapsed().as_millis() as u64, "corpus loaded");
    let stopping = CancellationToken::new();
    let audit = Audit::beside(&config.data);
    let uploads = Arc::new(Uploads::beside(&config.data, config.upload_limit).on(work.server));
    tokio::spawn(uploads::run(Arc::clone(&uploads), stopping.clone()));
    let app =
        App::new(Arc::clone(&work), Arc::clone(&tokens), audit, uploads, together, settings(config), stopping.clone());
    if let Some(peers) = peers.clone() {
        tokio::spawn(peers::run(peers, stopping.clone()));
    }
    tokio::spawn(note_uses(tokens, stopping.clone()));
    let limits = ConnectionLimits { all: config.connections, per_address: config.connections_per_address };
    let connections = Connections::new(limits);
    let router = http::router(app);
    let serving = tokio::spawn(serve(listener, router, connections, stopping.clone()));
    if config.samples && examples == 0 {
        let stock = crate::demo::samples::stock(Arc::clone(&work));
        tokio::spawn(stopping.clone().run_until_cancelled_owned(stock));
    }
    let background = tokio::spawn(reencode::run(Arc::clone(&work), stopping.clone()));
    tokio::spawn(follow::run(Arc::clone(&work), stopping.clone()));
    let jobs = tokio::spawn(jobs::run(Arc::clone(&work), stopping.clone()));
    tokio::spawn(scrub::run(Arc::clone(&work), stopping.clone()));
    tokio::spawn(queries::run(Arc::clone(&work), stopping.clone()));
    tokio::spawn(stopping.clone().run_until_cancelled_owned(taken::watch(config.memory_limit)));
    tracing::info!(%address, threads = work.pool.threads(), version = env!("CARGO_PKG_VERSION"), "serving");
    Ok(Running { address, work, peers, stopping, serving, background, jobs })
}

fn listener(listen: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = if listen.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    // The port of a server that has just ended can be taken again.
    socket.set_reuseaddr(true)?;
    socket.bind(listen)?;
    socket.listen(BACKLOG)
}

fn check_open(config: &Config, tokens: &Tokens) -> Result<(), StartError> {
    if tokens.access() == Access::Tokens {
        return Ok(());
    }
    if !config.listen.ip().is_loopback() && !config.open {
        return Err(StartError::Open { listen: config.listen });
    }
    tracing::warn!(listen = %config.listen, "no token was created: the service is open to everybody who reaches it");
    Ok(())
}

/// A limit on the size of files ends a process by a signal, unless somebody listens to that; then the write fails, and is
/// answered as such.
fn ignore_file_size_signal() {
    const SIGXFSZ: i32 = 25;
    use tokio::signal::unix::{SignalKind, signal};
    // Once heard it is never fatal again, also when this is dropped.
    if let Err(error) = signal(SignalKind::from_raw(SIGXFSZ)) {
        tracing::warn!(%error, "a limit on the size of files would end the service");
    }
}

fn settings(config: &Config) -> Settings {
    Settings {
        upload_limit: config.upload_limit,
        allowed_hosts: config.allowed_hosts.clone(),
        allowed_origins: config.allowed_origins.clone(),
        rate_limit: config.rate_limit,
    }
}

/// Writes down now and then, and at the end, when tokens were used last.
async fn note_uses(tokens: Arc<Tokens>, stopping: CancellationToken) {
    loop {
        let stopped = stopping.run_until_cancelled(tokio::time::sleep(NOTE_USES_EVERY)).await.is_none();
        let noting = Arc::clone(&tokens);
        let noted = tokio::task::spawn_blocking(move || noting.note_uses()).await;
        if let Ok(Err(error)) = noted {
            tracing::warn!(%error, "not written down when tokens were used");
        }
        if stopped {
            return;
        }
    }
}

async fn open_corpus(dir: &Path, memory_limit: u64) -> Result<StoredCorpus, StartError> {
    let dir = dir.to_owned();
    // The pages of the index are a part of what the service may take.
    let cache_bytes = (memory_limit / INDEX_SHARE).clamp(INDEX_BYTES.0, INDEX_BYTES.1);
    let options = OpenOptions { cache_bytes, ..OpenOptions::default() };
    let opening = tokio::task::spawn_blocking(move || StoredCorpus::open(&dir, &options));
    let (corpus, report) = opening.await.map_err(|_| StartError::Interrupted)??;
    let (examples, ms) = (report.examples, report.took_ms);
    let (quarantined, missing) = (report.quarantined.len(), report.missing_derived.len());
    tracing::info!(examples, quarantined, missing, ms, index_rebuilt = ?report.index_rebuilt, "store opened");
    Ok(corpus)
}

impl Running {
    /// Ends the service: streams send their last event, requests under way are answered, commits end.
    pub async fn stop(self) {
        self.stopping.cancel();
        // A panic of the accept loop has been logged; there is nothing more to wait for then.
        let _ = self.serving.await;
        if let Some(peers) = self.peers {
            let leaving = tokio::task::spawn_blocking(move || peers.leave());
            // Who isn't told finds that nobody answers.
            if !matches!(tokio::time::timeout(LEAVE_TIME_MAX, leaving).await, Ok(Ok(Ok(())))) {
                tracing::warn!("not said to the other servers that this one ends");
            }
        }
        for query in self.work.queries.all() {
            query.stop().cancel();
            query.makings.cancel_all();
        }
        let _ = self.background.await;
        // Jobs under way are given back, so that others do them at once.
        let _ = tokio::time::timeout(COMMIT_TIME_MAX, self.jobs).await;
        self.work.background.close();
        if tokio::time::timeout(COMMIT_TIME_MAX, self.work.background.wait()).await.is_err() {
            tracing::warn!(left = self.work.background.len(), "some background work did not end");
        }
        if *self.work.corpus.watch().borrow() != 0 {
            let work = Arc::clone(&self.work);
            // The rows are written again by a later stop, or made anew.
            let _ = tokio::task::spawn_blocking(move || work.keep_rows()).await;
        }
        tracing::info!("stopped");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpStream;

    #[tokio::test]
    async fn thousands_may_come_before_one_is_accepted() {
        let listener = listener(SocketAddr::from(([127, 0, 0, 1], 0))).expect("a port");
        let address = listener.local_addr().expect("an address");
        // The system may allow fewer.
        let allowed = std::fs::read_to_string("/proc/sys/net/core/somaxconn").ok();
        let allowed = allowed.and_then(|text| text.trim().parse().ok()).unwrap_or(BACKLOG);
        for count in 0..BACKLOG.min(allowed) {
            // It keeps its place when it is closed.
            let came = TcpStream::connect_timeout(&address, Duration::from_secs(10));
            assert!(came.is_ok(), "after {count}: {came:?}");
        }
    }
}
