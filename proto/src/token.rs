//! Access tokens as an admin sees them: everything but what makes them secret.

use crate::id::TokenId;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Longest name of a token, in bytes.
pub const TOKEN_NAME_LENGTH_MAX: usize = 200;

/// What a token may do; each role may do what those before it may.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Role {
    /// Ask queries; see and remove its own.
    #[default]
    Reader,
    /// Add, annotate and remove examples.
    Contributor,
    /// Everything: tokens, quotas, the queries of others, checks and backups.
    Admin,
}

impl Role {
    /// Every role, the least first.
    pub const ALL: [Self; 3] = [Self::Reader, Self::Contributor, Self::Admin];

    /// The word on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Reader => "reader",
            Self::Contributor => "contributor",
            Self::Admin => "admin",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// A word that is no role.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected reader, contributor or admin, found `{0}`")]
pub struct RoleError(String);

impl FromStr for Role {
    type Err = RoleError;

    fn from_str(text: &str) -> Result<Self, RoleError> {
        Self::ALL.into_iter().find(|role| role.as_str() == text).ok_or_else(|| RoleError(text.into()))
    }
}

/// What one token may use of the service at most; what is absent follows the service's own limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Quota {
    /// Jobs that compute or wait for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jobs: Option<u32>,
    /// Memory of its jobs and of what is held of them, in bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_bytes: Option<u64>,
    /// Requests a second, on average.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requests_per_second: Option<u32>,
}

/// A token without its secret.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Token {
    /// Its public id.
    pub id: TokenId,
    /// Whose it is.
    pub name: String,
    /// What it may do.
    pub role: Role,
    /// When it was created, RFC 3339, UTC; absent where an older release made it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub created: Option<String>,
    /// From when on it is refused; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires: Option<String>,
    /// When it was last used, to within a minute or so; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_used: Option<String>,
    /// What it may use at most.
    #[serde(default)]
    pub quota: Quota,
}

/// A token to be created.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct NewToken {
    /// Whose it will be.
    pub name: String,
    /// What it may do; `reader` unless told otherwise.
    pub role: Role,
    /// Seconds from now on for which it is accepted; absent: always.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expires_in_s: Option<u64>,
    /// What it may use at most.
    pub quota: Quota,
}

/// A token just created: the only time that its secret is shown.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedToken {
    /// The secret, for `authorization: Bearer`.
    pub secret: String,
    /// The rest of it.
    pub token: Token,
}

/// What changes of a token; what is absent stays.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TokenPatch {
    /// Whose it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// What it may use at most, in place of all that was said before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quota: Option<Quota>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_are_ordered_and_read_what_they_write() {
        assert!(Role::Reader < Role::Contributor && Role::Contributor < Role::Admin);
        for role in Role::ALL {
            assert_eq!(role.to_string().parse(), Ok(role));
            assert_eq!(serde_json::to_value(role).expect("a word"), role.as_str());
        }
        assert!("root".parse::<Role>().is_err());
    }

    #[test]
    fn a_token_travels_and_a_typo_in_a_new_one_is_refused() {
        let token = Token {
            id: TokenId::generate(),
            name: "ada".into(),
            role: Role::Admin,
            created: Some("2026-11-22T00:00:00.000Z".into()),
            expires: None,
            last_used: None,
            quota: Quota { jobs: Some(3), ..Quota::default() },
        };
        let json = serde_json::to_string(&token).expect("writes");
        assert_eq!(serde_json::from_str::<Token>(&json).expect("reads"), token);
        let packed = rmp_serde::to_vec_named(&token).expect("packs");
        assert_eq!(rmp_serde::from_slice::<Token>(&packed).expect("unpacks"), token);
        assert_eq!(serde_json::from_str::<NewToken>("{}").expect("all has a default"), NewToken::default());
        assert!(serde_json::from_str::<NewToken>(r#"{"rol": "admin"}"#).is_err());
    }
}
