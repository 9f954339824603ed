//! Problems: what the service answers when it refuses or fails (RFC 9457, `application/problem+json`).

use serde::{Deserialize, Serialize};
use std::fmt;

/// The media type of a [`Problem`] in JSON.
pub const MEDIA_TYPE: &str = "application/problem+json";

/// Why a request was refused. The list is closed within a version of the service; a client that meets a word it does
/// not know reads [`Code::Other`] and goes by the status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Code {
    /// The file is damaged, cut off, or not what its format demands.
    MeshUnreadable,
    /// The file holds no face.
    MeshEmpty,
    /// An edge has more than two faces, or a vertex more than one fan, beyond what can be repaired.
    MeshNotManifold,
    /// The surface (or a segment of it) is neither a disc, annulus, sphere nor torus.
    TopologyUnsupported,
    /// The mesh has more vertices, faces or corners than the service takes, or would need more memory than it has.
    MeshTooLarge,
    /// The mesh is sound, but no encoding of it could be computed.
    MeshNotEncodable,
    /// The body has more bytes than the service takes, packed or unpacked.
    BodyTooLarge,
    /// The body's format is none of those read, or the answer's format none of those written.
    FormatUnknown,
    /// The body (or a part of it) is not what its `Content-Type` says, or has a wrong shape.
    BodyInvalid,
    /// A query parameter, header or field has a value outside its range.
    ParameterInvalid,
    /// No resource has this address, or it was removed.
    NotFound,
    /// The address is right, its methods are others.
    MethodNotAllowed,
    /// None of the media types in `Accept` can be given.
    NotAcceptable,
    /// The request contradicts the state of the resource.
    Conflict,
    /// A token is needed, or the one given is unknown or revoked.
    Unauthorized,
    /// The token's role does not allow this.
    Forbidden,
    /// Too much to do at the moment; come back after `Retry-After` seconds.
    Overloaded,
    /// The service is stopping or not yet ready; come back after `Retry-After` seconds.
    Unavailable,
    /// There is nothing in the corpus (under these tags and this topology) to rank against.
    CorpusEmpty,
    /// The constraints asked for would fold the map over.
    ConstraintFolds,
    /// The request did not arrive in its time.
    Timeout,
    /// The computation did not end in its time; allow it more, or send a smaller mesh.
    Deadline,
    /// The query ended, and made room for newer ones; post it again.
    QueryExpired,
    /// The server that took it, one of several, does not answer; `POST /v1/queries/{id}/restart` starts a query again.
    OwnerGone,
    /// The bytes of this example are damaged on the server's disk; add the same mesh again, or remove it.
    Damaged,
    /// The disk is full; reads go on.
    StorageFull,
    /// The service failed; it is not the caller's fault.
    Internal,
    /// A code this client does not know.
    #[serde(other)]
    Other,
}

impl Code {
    /// Every code that the service sends.
    pub const ALL: [Self; 27] = [
        Self::MeshUnreadable,
        Self::MeshEmpty,
        Self::MeshNotManifold,
        Self::TopologyUnsupported,
        Self::MeshTooLarge,
        Self::MeshNotEncodable,
        Self::BodyTooLarge,
        Self::FormatUnknown,
        Self::BodyInvalid,
        Self::ParameterInvalid,
        Self::NotFound,
        Self::MethodNotAllowed,
        Self::NotAcceptable,
        Self::Conflict,
        Self::Unauthorized,
        Self::Forbidden,
        Self::Overloaded,
        Self::Unavailable,
        Self::CorpusEmpty,
        Self::ConstraintFolds,
        Self::Timeout,
        Self::Deadline,
        Self::QueryExpired,
        Self::OwnerGone,
        Self::Damaged,
        Self::StorageFull,
        Self::Internal,
    ];

    /// The word on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::MeshUnreadable => "mesh_unreadable",
            Self::MeshEmpty => "mesh_empty",
            Self::MeshNotManifold => "mesh_not_manifold",
            Self::TopologyUnsupported => "topology_unsupported",
            Self::MeshTooLarge => "mesh_too_large",
            Self::MeshNotEncodable => "mesh_not_encodable",
            Self::BodyTooLarge => "body_too_large",
            Self::FormatUnknown => "format_unknown",
            Self::BodyInvalid => "body_invalid",
            Self::ParameterInvalid => "parameter_invalid",
            Self::NotFound => "not_found",
            Self::MethodNotAllowed => "method_not_allowed",
            Self::NotAcceptable => "not_acceptable",
            Self::Conflict => "conflict",
            Self::Unauthorized => "unauthorized",
            Self::Forbidden => "forbidden",
            Self::Overloaded => "overloaded",
            Self::Unavailable => "unavailable",
            Self::CorpusEmpty => "corpus_empty",
            Self::ConstraintFolds => "constraint_folds",
            Self::Timeout => "timeout",
            Self::Deadline => "deadline",
            Self::QueryExpired => "query_expired",
            Self::OwnerGone => "owner_gone",
            Self::Damaged => "damaged",
            Self::StorageFull => "storage_full",
            Self::Internal => "internal",
            Self::Other => "other",
        }
    }

    /// The same for every problem of this code: a title for people.
    pub fn title(self) -> &'static str {
        match self {
            Self::MeshUnreadable => "The mesh cannot be read",
            Self::MeshEmpty => "The mesh is empty",
            Self::MeshNotManifold => "The mesh is not manifold",
            Self::TopologyUnsupported => "The topology is not supported",
            Self::MeshTooLarge => "The mesh is too large",
            Self::MeshNotEncodable => "The mesh cannot be encoded",
            Self::BodyTooLarge => "The body is too large",
            Self::FormatUnknown => "The format is not known",
            Self::BodyInvalid => "The body is not valid",
            Self::ParameterInvalid => "A parameter is not valid",
            Self::NotFound => "Not found",
            Self::MethodNotAllowed => "Method not allowed",
            Self::NotAcceptable => "Not acceptable",
            Self::Conflict => "Conflict",
            Self::Unauthorized => "A token is needed",
            Self::Forbidden => "Not allowed",
            Self::Overloaded => "Too busy",
            Self::Unavailable => "Not available now",
            Self::CorpusEmpty => "The corpus is empty",
            Self::ConstraintFolds => "The constraints fold the map",
            Self::Timeout => "Out of time",
            Self::Deadline => "Not done in time",
            Self::QueryExpired => "The query has expired",
            Self::OwnerGone => "Its server is gone",
            Self::Damaged => "The example is damaged",
            Self::StorageFull => "The disk is full",
            Self::Internal => "Internal error",
            Self::Other => "Problem",
        }
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// A refusal or failure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Problem {
    /// A URI of the kind of problem, one a code.
    #[serde(rename = "type")]
    pub kind: String,
    /// The kind of problem, for people.
    pub title: String,
    /// The HTTP status.
    pub status: u16,
    /// What was expected, what was found and the way out.
    pub detail: String,
    /// The stable code, for programs.
    pub code: Code,
    /// The request's id, as in `x-request-id` and in the log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request_id: Option<String>,
}

impl Problem {
    /// A problem of the given code; its type and title follow from it.
    pub fn new(code: Code, status: u16, detail: impl Into<String>) -> Self {
        let kind = format!("urn:quadmuse:problem:{code}");
        Self { kind, title: code.title().into(), status, detail: detail.into(), code, request_id: None }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.code, self.detail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_travels_under_its_word() {
        for code in Code::ALL {
            assert_eq!(serde_json::to_value(code).expect("a word"), code.as_str());
        }
    }

    #[test]
    fn a_code_of_a_later_service_is_read_as_other() {
        let text = r#"{"type":"urn:x","title":"t","status":418,"detail":"d","code":"teapot","extra":1}"#;
        let problem: Problem = serde_json::from_str(text).expect("a problem");
        assert_eq!(problem.code, Code::Other);
    }

    #[test]
    fn a_problem_has_the_members_of_rfc_9457() {
        let problem = Problem::new(Code::NotFound, 404, "expected an example, found none with id `x`");
        let value = serde_json::to_value(problem).expect("an object");
        assert_eq!(
            value,
            serde_json::json!({
                "type": "urn:quadmuse:problem:not_found", "title": "Not found", "status": 404,
                "detail": "expected an example, found none with id `x`", "code": "not_found"
            })
        );
    }
}
