//! What admins ask: how the service is in detail, and what a check of the corpus found.

use serde::{Deserialize, Serialize};

/// An example that is set aside because its bytes are damaged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DamagedExample {
    /// The example's id.
    pub example: String,
}

/// What one caller has in use.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CallerUse {
    /// The token's id; of a caller without one, a number that stands for its address.
    pub caller: String,
    /// Jobs that compute or wait for it.
    pub jobs: u64,
    /// Memory of its jobs and of what is held of them, by estimate, in bytes.
    pub memory_bytes: u64,
}

/// How the service is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Status {
    /// Why new examples are refused, if they are.
    pub unwritable: Option<String>,
    /// Examples set aside.
    pub damaged: Vec<DamagedExample>,
    /// Who uses what.
    pub callers: Vec<CallerUse>,
    /// Memory that jobs and what is held may take, in bytes.
    pub memory_limit_bytes: u64,
    /// Memory taken from that, by estimate, in bytes.
    pub memory_admitted_bytes: u64,
    /// Memory of the process, as its allocator counts it, in bytes.
    pub memory_allocated_bytes: u64,
    /// Memory of the process that is in main memory, as its allocator counts it, in bytes.
    pub memory_resident_bytes: u64,
}

/// What a check of the corpus found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Check {
    /// Examples read.
    pub examples: u64,
    /// Encodings read.
    pub segments: u64,
    /// Bytes read.
    pub bytes: u64,
    /// What is wrong, a sentence each.
    pub problems: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_travels() {
        let check = Check { examples: 1, segments: 2, bytes: 3, problems: vec!["x is damaged".into()] };
        let json = serde_json::to_string(&check).expect("writes");
        assert_eq!(serde_json::from_str::<Check>(&json).expect("reads"), check);
        let packed = rmp_serde::to_vec_named(&check).expect("packs");
        assert_eq!(rmp_serde::from_slice::<Check>(&packed).expect("unpacks"), check);
    }
}
