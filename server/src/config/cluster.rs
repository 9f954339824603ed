//! Settings of a corpus that servers share.

use super::ConfigError;
use clap::{Args, Subcommand};
use quadmuse_cluster::{Access, ClusterOptions};
use serde::Deserialize;
use std::path::PathBuf;
use std::time::Duration;

/// Which corpus on which engine, and how to get in.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[serde(default)]
pub struct ClusterArgs {
    /// Addresses of the nodes of a NATS JetStream engine that holds the corpus, such as `nats://a,nats://b,nats://c`.
    /// Without it, the corpus lies in the directory of the store.
    #[arg(long, env = "QUADMUSE_CLUSTER", value_name = "URLS", hide_env_values = true)]
    pub cluster: Option<String>,
    /// Name of the corpus on the engine (default: quadmuse).
    #[arg(long, env = "QUADMUSE_BUCKET", value_name = "NAME")]
    pub bucket: Option<String>,
    /// Nodes that keep everything: 1, 3 or 5 (default: 3, or 1 where the engine is a single node).
    #[arg(long, env = "QUADMUSE_CLUSTER_REPLICAS", value_name = "N")]
    pub cluster_replicas: Option<usize>,
    /// A file of credentials for the engine (`.creds`).
    #[arg(long, env = "QUADMUSE_CLUSTER_CREDENTIALS", value_name = "FILE")]
    pub cluster_credentials: Option<PathBuf>,
    /// Certificates of the authorities that the engine's is checked against (PEM); with it, TLS is required.
    #[arg(long, env = "QUADMUSE_CLUSTER_CA", value_name = "FILE")]
    pub cluster_ca: Option<PathBuf>,
    /// This server's own certificate for the engine (PEM).
    #[arg(long, env = "QUADMUSE_CLUSTER_CERT", value_name = "FILE", requires = "cluster_key")]
    pub cluster_cert: Option<PathBuf>,
    /// The key of that certificate (PEM).
    #[arg(long, env = "QUADMUSE_CLUSTER_KEY", value_name = "FILE", requires = "cluster_cert")]
    pub cluster_key: Option<PathBuf>,
}

/// The name of a corpus unless told otherwise.
const BUCKET_DEFAULT: &str = "quadmuse";

impl ClusterArgs {
    /// These settings, and those of `file` where they say nothing.
    pub fn or(self, file: Self) -> Self {
        Self {
            cluster: self.cluster.or(file.cluster),
            bucket: self.bucket.or(file.bucket),
            cluster_replicas: self.cluster_replicas.or(file.cluster_replicas),
            cluster_credentials: self.cluster_credentials.or(file.cluster_credentials),
            cluster_ca: self.cluster_ca.or(file.cluster_ca),
            cluster_cert: self.cluster_cert.or(file.cluster_cert),
            cluster_key: self.cluster_key.or(file.cluster_key),
        }
    }

    /// The engine, if one is named.
    ///
    /// # Errors
    /// [`ConfigError::Cluster`].
    pub fn options(&self) -> Result<Option<ClusterOptions>, ConfigError> {
        let Some(nodes) = &self.cluster else {
            return match &self.bucket {
                Some(bucket) => {
                    Err(ConfigError::Cluster(format!("expected --cluster URLS with --bucket {bucket}, found none")))
                }
                None => Ok(None),
            };
        };
        let bucket = self.bucket.as_deref().unwrap_or(BUCKET_DEFAULT);
        let access = Access {
            credentials: self.cluster_credentials.clone(),
            authorities: self.cluster_ca.clone(),
            certificate: self.cluster_cert.clone().zip(self.cluster_key.clone()),
        };
        let options = ClusterOptions { replicas: self.cluster_replicas, access, ..ClusterOptions::new(nodes, bucket) };
        options.fault().map_or(Ok(Some(options)), |fault| Err(ConfigError::Cluster(fault)))
    }

    /// The engine, which has to be named.
    ///
    /// # Errors
    /// [`ConfigError::Cluster`].
    pub fn required(&self) -> Result<ClusterOptions, ConfigError> {
        let none = || ConfigError::Cluster("expected --cluster URLS (or QUADMUSE_CLUSTER), found none".into());
        self.options()?.ok_or_else(none)
    }
}

/// The address at which others reach a server, as `--advertise` gives it; an empty one is none.
///
/// # Errors
/// [`ConfigError::Cluster`].
pub(super) fn advertised(given: Option<String>) -> Result<Option<String>, ConfigError> {
    let Some(text) = given.filter(|text| !text.is_empty()) else { return Ok(None) };
    let refused = || ConfigError::Cluster(format!("expected --advertise http://HOST:PORT, found `{text}`"));
    let rest = text.strip_prefix("http://").ok_or_else(refused)?.trim_end_matches('/');
    let authority: axum::http::uri::Authority = rest.parse().map_err(|_| refused())?;
    let port = authority.port_u16().ok_or_else(refused)?;
    let host = authority.host();
    let is_plain = !host.is_empty() && !rest.contains('@') && port > 0;
    if is_plain { Ok(Some(format!("http://{host}:{port}"))) } else { Err(refused()) }
}

/// What to do with a corpus that servers share.
#[derive(Debug, Subcommand)]
pub enum ClusterAction {
    /// Copy a local store to the engine; what is there already stays. No service may run on the store meanwhile.
    Import {
        /// Which corpus.
        #[command(flatten)]
        cluster: ClusterArgs,
        /// The store.
        #[command(flatten)]
        store: super::StoreArgs,
    },
    /// Copy the corpus from the engine to an empty local store.
    Export {
        /// Which corpus.
        #[command(flatten)]
        cluster: ClusterArgs,
        /// The store.
        #[command(flatten)]
        store: super::StoreArgs,
    },
    /// Write the corpus into one file, as it is at one moment, while servers go on.
    Backup {
        /// Which corpus.
        #[command(flatten)]
        cluster: ClusterArgs,
        /// The file to write.
        file: PathBuf,
    },
    /// Fill an empty corpus on the engine from a backup.
    Restore {
        /// Which corpus.
        #[command(flatten)]
        cluster: ClusterArgs,
        /// The file to read.
        file: PathBuf,
    },
    /// Read every object and compare it with its hash; changes nothing.
    Check {
        /// Which corpus.
        #[command(flatten)]
        cluster: ClusterArgs,
    },
    /// Remove objects that no example needs any more.
    Collect {
        /// Which corpus.
        #[command(flatten)]
        cluster: ClusterArgs,
        /// Leave alone what was put less long ago: it may belong to an example that is being added.
        #[arg(long, value_name = "TIME", default_value = "24h", value_parser = humantime::parse_duration)]
        older_than: Duration,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_advertised_by_host_and_port() {
        let of = |text: &str| advertised(Some(text.into()));
        assert_eq!(advertised(None).expect("none"), None);
        assert_eq!(of("").expect("none"), None);
        for good in ["http://10.0.0.7:7979", "http://studio-1:80", "http://[::1]:7979"] {
            assert_eq!(of(good).expect("sound").as_deref(), Some(good));
        }
        assert_eq!(of("http://a:1/").expect("sound").as_deref(), Some("http://a:1"));
        for bad in
            ["10.0.0.7:7979", "https://a:1", "http://a", "http://:1", "http://a:0", "http://a:1/x", "http://u@a:1"]
        {
            assert!(of(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_bucket_needs_an_engine_and_an_engine_a_sound_name() {
        assert_eq!(ClusterArgs::default().options().expect("none"), None);
        let of = |cluster: &str, bucket: &str| ClusterArgs {
            cluster: Some(cluster.into()),
            bucket: Some(bucket.into()),
            ..ClusterArgs::default()
        };
        let options = of("nats://a,nats://b,nats://c", "studio").options().expect("sound").expect("named");
        assert_eq!((options.nodes.len(), options.bucket.as_str(), options.replicas()), (3, "studio", 3));
        assert!(matches!(of("nats://a", "a b").options(), Err(ConfigError::Cluster(_))));
        let alone = ClusterArgs { bucket: Some("studio".into()), ..ClusterArgs::default() };
        assert!(matches!(alone.options(), Err(ConfigError::Cluster(_))));
        assert!(matches!(ClusterArgs::default().required(), Err(ConfigError::Cluster(_))));
    }
}
