//! Lists in pages: `limit` and `cursor` in, `next` out.

use serde::{Deserialize, Serialize};

/// Items a page when the caller names no `limit`.
pub const LIMIT_DEFAULT: u32 = 50;

/// The largest `limit` that is accepted.
pub const LIMIT_MAX: u32 = 500;

/// One page of a list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Page<T> {
    /// The items, in order of creation.
    pub items: Vec<T>,
    /// The `cursor` of the next page; absent on the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}
