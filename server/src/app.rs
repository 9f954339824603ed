//! The handles that requests share. Nothing below `http/` sees them.

use crate::audit::Audit;
use crate::auth::Tokens;
use crate::http::forward::Signs;
use crate::http::forward::shares::PeerHolders;
use crate::http::idempotency::Idempotency;
use crate::http::packed::Text;
use crate::peers::Peers;
use crate::rate::Rates;
use crate::work::Work;
use crate::work::kept::KeptQueries;
use crate::work::uploads::Uploads;
use metrics_exporter_prometheus::PrometheusHandle;
use std::ops::Deref;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;

/// The handles; cheap to clone.
#[derive(Clone)]
pub struct App(Arc<Handles>);

/// What requests have to keep to.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Largest body, packed or unpacked, in bytes.
    pub upload_limit: u64,
    /// Names under which the service is reached, beside addresses and `localhost`.
    pub allowed_hosts: Vec<String>,
    /// Origins whose pages may use the service, beside its own.
    pub allowed_origins: Vec<String>,
    /// Requests a second of one caller; 0: no limit.
    pub rate_limit: u32,
}

/// The handles by which servers stand in for each other.
pub struct ClusterHandles {
    /// What queries were started with.
    pub kept: KeptQueries,
    /// The servers that share the corpus, if this is one of several.
    pub peers: Option<Arc<Peers>>,
    /// Which of them were there when they were asked last.
    pub signs: Arc<Signs>,
}

/// What [`App`] holds.
pub struct Handles {
    /// What requests have to keep to.
    pub settings: Settings,
    /// What the service does.
    pub work: Arc<Work>,
    /// Who may.
    pub tokens: Arc<Tokens>,
    /// How often they may ask.
    pub rates: Rates,
    /// What they changed.
    pub audit: Audit,
    /// Files that arrive piece by piece.
    pub uploads: Arc<Uploads>,
    /// What queries were started with.
    pub kept: Arc<KeptQueries>,
    /// The servers that share the corpus, if this is one of several.
    pub peers: Option<Arc<Peers>>,
    /// Which of them were there when they were asked last.
    pub signs: Arc<Signs>,
    /// Answers to `Idempotency-Key`.
    pub idempotency: Idempotency,
    /// The metrics.
    pub metrics: PrometheusHandle,
    /// The contract, as JSON.
    pub openapi: std::sync::OnceLock<Text>,
    /// Set when the service stops.
    pub stopping: CancellationToken,
}

impl App {
    /// Joins the handles.
    pub fn new(
        work: Arc<Work>,
        tokens: Arc<Tokens>,
        audit: Audit,
        uploads: Arc<Uploads>,
        together: ClusterHandles,
        settings: Settings,
        stopping: CancellationToken,
    ) -> Self {
        if let Some(peers) = &together.peers {
            work.shares.reach(Arc::new(PeerHolders::of(Arc::clone(peers), Arc::clone(&together.signs))));
        }
        Self(Arc::new(Handles {
            work,
            tokens,
            rates: Rates::new(settings.rate_limit),
            audit,
            uploads,
            kept: Arc::new(together.kept),
            peers: together.peers,
            signs: together.signs,
            idempotency: Idempotency::default(),
            settings,
            metrics: crate::telemetry::metrics(),
            openapi: std::sync::OnceLock::new(),
            stopping,
        }))
    }
}

impl Deref for App {
    type Target = Handles;

    fn deref(&self) -> &Handles {
        &self.0
    }
}
