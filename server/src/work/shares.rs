//! A corpus whose coarsest pictures several servers hold in memory together, each a share of them.
//!
//! All know every example and what is known of its segments; what a sweep reads, 2 KiB a segment, only one of them has, or
//! some that hold the same share. Whoever ranks a query asks one holder of each other share ([`super::search::scattered`]).

use bytes::Bytes;
use futures_util::future::BoxFuture;
use quadmuse_proto::Share;
use std::sync::{Arc, OnceLock};

/// The way to the servers that hold the other shares.
pub trait Holders: Send + Sync + 'static {
    /// What one of the holders of a share answers to a question; `None` if none of them does.
    fn ask(&self, share: Share, question: Bytes) -> BoxFuture<'_, Option<Bytes>>;

    /// How many of them there are of a share.
    fn count(&self, share: Share) -> usize;
}

/// The shares as one server sees them.
#[derive(Default)]
pub struct Shares {
    holders: OnceLock<Arc<dyn Holders>>,
}

impl Shares {
    /// Says how the others are reached; only the first time counts.
    pub fn reach(&self, holders: Arc<dyn Holders>) {
        let _ = self.holders.set(holders);
    }

    /// What a holder of a share answers; `None` if nobody does.
    pub async fn ask(&self, share: Share, question: Bytes) -> Option<Bytes> {
        self.holders.get()?.ask(share, question).await
    }

    /// The shares, of as many as `own` is of, that nobody else holds.
    pub fn without_holder(&self, own: Share) -> Vec<Share> {
        let others = (1..=own.of()).filter_map(|number| Share::new(number, own.of())).filter(|share| *share != own);
        others.filter(|share| self.holders.get().is_none_or(|holders| holders.count(*share) == 0)).collect()
    }
}
