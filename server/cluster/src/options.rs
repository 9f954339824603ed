//! Where the engine is, and how a server gets in.

use std::path::PathBuf;
use std::time::Duration;

use crate::engine::UPLOADS_BYTES_MAX;

/// Nodes that keep everything, unless told otherwise.
const REPLICAS: usize = 3;

/// How a server gets in. A user and a password stand in the address, `nats://user:password@host`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// A file with a token and its key, as `nsc` writes it (`.creds`).
    pub credentials: Option<PathBuf>,
    /// Certificates of the authorities that the engine's are checked against, as PEM; with it, TLS is required.
    pub authorities: Option<PathBuf>,
    /// This server's own certificate and its key, as PEM, where the engine asks for one.
    pub certificate: Option<(PathBuf, PathBuf)>,
}

/// Where the engine is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClusterOptions {
    /// Addresses of its nodes, such as `nats://10.0.0.1:4222`; one that answers is enough.
    pub nodes: Vec<String>,
    /// The name of the corpus there: letters, digits, `-` and `_`.
    pub bucket: String,
    /// Nodes that keep everything; `None`: three, or one where the engine is one node.
    pub replicas: Option<usize>,
    /// How a server gets in.
    pub access: Access,
    /// Most bytes that are kept for a while, on each node.
    pub uploads_bytes: u64,
    /// Longest time to reach it at a start.
    pub reach: Duration,
    /// For so long nobody else gets a job of which nothing is heard; what the first server says counts.
    pub lease: Duration,
}

/// For so long nobody else gets a job of which nothing is heard, unless told otherwise.
pub const LEASE: Duration = Duration::from_secs(30);

/// Longest name of a corpus.
const BUCKET_LENGTH_MAX: usize = 64;

impl ClusterOptions {
    /// The corpus `bucket` on the engine at these addresses, separated by commas, without credentials.
    pub fn new(nodes: &str, bucket: &str) -> Self {
        let nodes = nodes.split(',').map(str::trim).filter(|node| !node.is_empty());
        Self {
            nodes: nodes.map(str::to_owned).collect(),
            bucket: bucket.to_owned(),
            replicas: None,
            access: Access::default(),
            uploads_bytes: UPLOADS_BYTES_MAX,
            reach: Duration::from_secs(30),
            lease: LEASE,
        }
    }

    /// Nodes that are to keep everything, if the engine has so many, however many are named: who names one of three to
    /// make a token must not make a corpus that is kept once.
    pub fn replicas(&self) -> usize {
        self.replicas.unwrap_or(REPLICAS)
    }

    /// The user and the password that one of the addresses names, as `nats://user:password@host` does; `%40` stands for `@`.
    pub(crate) fn login(&self) -> Option<(String, String)> {
        self.nodes.iter().find_map(|node| {
            let (login, _) = node.split_once("://").map_or(node.as_str(), |(_, rest)| rest).rsplit_once('@')?;
            let (user, password) = login.split_once(':').unwrap_or((login, ""));
            Some((unescaped(user), unescaped(password)))
        })
    }

    /// The addresses without what they say of users: the client would pass over it, and show it in its errors.
    pub(crate) fn addresses(&self) -> impl Iterator<Item = String> {
        self.nodes.iter().map(|node| match (node.split_once("://"), node.rsplit_once('@')) {
            (Some((scheme, _)), Some((_, host))) => format!("{scheme}://{host}"),
            (None, Some((_, host))) => host.to_owned(),
            (_, None) => node.clone(),
        })
    }

    /// What is wrong with it, if something is.
    pub fn fault(&self) -> Option<String> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.nodes.is_empty() {
            return Some("expected an address of the cluster's engine, found none".into());
        }
        if self.bucket.is_empty() || self.bucket.len() > BUCKET_LENGTH_MAX || !self.bucket.chars().all(allowed) {
            let expected = format!("1 to {BUCKET_LENGTH_MAX} letters, digits, `-` and `_`");
            return Some(format!("expected a bucket of {expected}, found `{}`", self.bucket));
        }
        let replicas = self.replicas();
        let odd = [1, 3, 5].contains(&replicas);
        (!odd).then(|| format!("expected 1, 3 or 5 replicas, found {replicas}"))
    }
}

/// A part of an address, with the characters that `%` and two digits stand for.
fn unescaped(text: &str) -> String {
    let (mut bytes, mut rest) = (Vec::with_capacity(text.len()), text.as_bytes());
    while let Some((&first, others)) = rest.split_first() {
        let pair = others.get(..2).and_then(|pair| std::str::from_utf8(pair).ok());
        let escaped = pair.filter(|_| first == b'%').and_then(|pair| u8::from_str_radix(pair, 16).ok());
        bytes.push(escaped.unwrap_or(first));
        rest = if escaped.is_some() { &others[2..] } else { others };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_gets_in_is_read_from_the_address_and_left_out_of_it() {
        let options = ClusterOptions::new("nats://a:1, nats://quad%40muse:s3%25:ret@b:2,tls://c:3", "studio");
        assert_eq!(options.login(), Some(("quad@muse".into(), "s3%:ret".into())));
        assert_eq!(options.addresses().collect::<Vec<_>>(), ["nats://a:1", "nats://b:2", "tls://c:3"]);
        assert_eq!(ClusterOptions::new("nats://a:1,b:2", "studio").login(), None);
        assert_eq!(unescaped("100%"), "100%");
    }

    #[test]
    fn everything_is_kept_three_times_unless_told_otherwise() {
        let options = ClusterOptions::new("nats://a:1, nats://b:2,nats://c:3,", "studio");
        assert_eq!((options.nodes.len(), options.replicas(), options.fault()), (3, 3, None));
        assert_eq!(ClusterOptions::new("nats://a:1", "studio").replicas(), 3);
        assert!(ClusterOptions::new("", "studio").fault().is_some());
        assert!(ClusterOptions::new("nats://a", "a.b").fault().is_some());
        assert!(ClusterOptions { replicas: Some(2), ..options }.fault().is_some());
    }
}
