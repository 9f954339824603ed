//! An example on a query as it lies when it is laid roughly.

use super::Model;
use quadmuse_kernel::mesh::Vec3;
use std::sync::Arc;

/// How an example lies on a query, roughly.
#[derive(Clone, Debug)]
pub struct Rough {
    /// How sure it is, below 1: relief, less what its bend counts.
    pub agreement: f64,
    /// Share of the query's area that it lies on.
    pub covered: f64,
    /// Share of the example's area for which the query has nothing: it would be spanned flat.
    pub off: f64,
    /// Where each vertex of its surface lies.
    pub places: Arc<Vec<Vec3>>,
    /// Whether it lies mirrored.
    pub mirrored: bool,
}

impl Rough {
    /// Rates it against others on the same query, as [`quadmuse_proto::Map::worth`] rates maps.
    pub fn worth(&self) -> f64 {
        if self.agreement > 0.0 { self.agreement * self.covered * (1.0 - self.off) } else { self.agreement }
    }
}

/// An example that lies on a query, to lead another there of which it is a part.
#[derive(Clone, Debug)]
pub struct RoughLead {
    /// The example.
    pub model: Arc<Model>,
    /// Its segment.
    pub segment: u32,
    /// How it lies.
    pub rough: Rough,
}
