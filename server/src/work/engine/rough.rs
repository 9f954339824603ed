//! An example on a query as it lies when it is laid roughly.

use super::{Model, RoughPlacement};
use std::sync::Arc;

/// An example that lies on a query, to lead another there of which it is a part.
#[derive(Clone, Debug)]
pub struct RoughLead {
    /// The example.
    pub model: Arc<Model>,
    /// Its segment.
    pub segment: u32,
    /// How it lies.
    pub rough: RoughPlacement,
}
