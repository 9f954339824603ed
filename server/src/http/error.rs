//! The only place that knows both an error and a status.
//!
//! [`judge`] maps every error to a status and a code by a `match` without `_`, so that a new variant is decided here
//! before it compiles.

use crate::auth::AuthError;
use crate::connections::ReserveReason;
use crate::pool::{PoolError, StopReason};
use crate::work::WorkError;
use crate::work::corpus::CorpusError;
use crate::work::engine::{EngineError, Refusal};
use crate::work::uploads::UploadError;
use axum::body::Body;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use quadmuse_proto::upload::TUS_VERSION;
use quadmuse_proto::{Code, Problem, problem};
use std::error::Error;
use std::time::Duration;

tokio::task_local! {
    /// The id of the request that this task answers.
    pub static REQUEST_ID: String;
}

/// Seconds after which to come back when nothing better is known.
const RETRY_AFTER_S: u64 = 2;

/// Why a request is not answered as asked.
#[derive(Debug, thiserror::Error)]
pub enum HttpError {
    /// The work refused or failed.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// No route, or an id that can't be one.
    #[error("expected the address of a resource, found `{path}`; see /docs for those there are")]
    NoRoute {
        /// The path asked for.
        path: String,
    },
    /// The route has other methods.
    #[error("expected another method on `{path}` than {method}; the `allow` header lists them")]
    MethodNotAllowed {
        /// The path.
        path: String,
        /// The method asked for.
        method: String,
    },
    /// None of what is accepted can be given.
    #[error("expected `accept` to allow one of {offered}, found `{found}`")]
    NotAcceptable {
        /// What can be given.
        offered: String,
        /// What was accepted.
        found: String,
    },
    /// A parameter or header is wrong.
    #[error("expected `{name}` {expected}, found `{found}`")]
    Parameter {
        /// Its name.
        name: String,
        /// What would do.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The operation has no such parameter.
    #[error("expected {}, found `{found}`{}", parameters(known), meant(nearest.as_deref()))]
    ParameterUnknown {
        /// The name that was given.
        found: String,
        /// The name that it is likely to be.
        nearest: Option<String>,
        /// Those that the operation has, with commas between.
        known: String,
    },
    /// The body is not what it should be.
    #[error("{0}")]
    BodyInvalid(String),
    /// The body has another media type or content encoding than those that are read.
    #[error("expected {expected}, found `{found}`")]
    BodyFormat {
        /// What would do.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The body is too large, packed or unpacked.
    #[error(
        "expected a body of at most {limit} bytes, unpacked, found a larger one; send a smaller mesh, or raise --upload-limit"
    )]
    BodyTooLarge {
        /// The limit, in bytes.
        limit: u64,
    },
    /// The body did not arrive in time.
    #[error("expected the body within {seconds} s, found it still arriving; send it again")]
    BodyTimeout {
        /// The limit, in seconds.
        seconds: u64,
    },
    /// The same `Idempotency-Key` came with another request.
    #[error("expected the idempotency key `{0}` with the request it came with first, found another; use a fresh key")]
    KeyReused(String),
    /// There is no token, or a wrong one.
    #[error(
        "expected a valid token in `authorization: Bearer`, found {found}; create one by `quadmuse-server token create`"
    )]
    Unauthorized {
        /// What came in its place.
        found: &'static str,
    },
    /// The token's role is not enough.
    #[error("expected a token of role {needed}, found {found}")]
    Forbidden {
        /// The role needed.
        needed: &'static str,
        /// The role found.
        found: &'static str,
    },
    /// What is for admins needs a token also on an open service.
    #[error(
        "expected a token of role admin, found none; create one by `quadmuse-server token create --role admin` on the server's machine"
    )]
    AdminNeedsToken,
    /// The tokens can't be read or changed as asked.
    #[error(transparent)]
    Tokens(#[from] AuthError),
    /// The request was sent to a name that anybody may let lead here.
    #[error(
        "expected `host` to be an address, localhost or a name given by --allow-host, found `{found}`; start the server with --allow-host if that is its name"
    )]
    HostUnknown {
        /// The name found.
        found: String,
    },
    /// A page of another origin sent what is no mere read.
    #[error("expected a request of this server's own page or of a program, found one of another origin, `{found}`")]
    CrossOrigin {
        /// What said so.
        found: String,
    },
    /// The caller asks too often.
    #[error("expected fewer requests a second of one caller, found more; try again in {} s", retry_after.as_secs().max(1))]
    TooOften {
        /// When to come back.
        retry_after: Duration,
    },
    /// There are too many connections: in all, or of this address.
    #[error("expected fewer connections {}, found as many as there may be; close some, or try again shortly", words_of_beyond(*beyond))]
    TooManyConnections {
        /// Which of the limits was met.
        beyond: ReserveReason,
    },
    /// Another version of the protocol of uploads, or none.
    #[error("expected `tus-resumable` 1.0.0, found {found}; see OPTIONS /v1/uploads")]
    TusVersion {
        /// The version found.
        found: String,
    },
    /// The server that has it, one of several, does not answer.
    #[error("expected the server that has {of} to answer, found it gone; {way_out}")]
    OwnerGone {
        /// What it has.
        of: String,
        /// What to do.
        way_out: String,
    },
    /// The server that has it broke off its answer.
    #[error("expected an answer of the server that has it, found the connection broken; try again shortly")]
    OwnerBroke,
    /// The service is stopping.
    #[error("expected a running service, found it stopping; try again shortly")]
    Stopping,
    /// The answer took too long.
    #[error("expected an answer within {seconds} s, found none; try again later")]
    TooSlow {
        /// The limit, in seconds.
        seconds: u64,
    },
    /// A handler panicked, or an answer could not be written: a bug.
    #[error("{0}")]
    Internal(String),
}

impl From<PoolError> for HttpError {
    fn from(error: PoolError) -> Self {
        Self::Work(error.into())
    }
}

impl From<UploadError> for HttpError {
    fn from(error: UploadError) -> Self {
        Self::Work(error.into())
    }
}

impl HttpError {
    /// A wrong parameter or header.
    pub fn parameter(name: &str, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Parameter { name: name.into(), expected: expected.into(), found: found.to_string() }
    }
}

/// What parameters there are.
fn parameters(known: &str) -> String {
    if known.is_empty() { "no parameters here".into() } else { format!("parameters out of {known}") }
}

/// What may have been meant.
fn meant(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

fn words_of_beyond(beyond: ReserveReason) -> &'static str {
    match beyond {
        ReserveReason::All => "in all",
        ReserveReason::Address => "of this address",
    }
}

/// The status and the code of an error.
fn judge(error: &HttpError) -> (StatusCode, Code) {
    match error {
        HttpError::Work(error) => judge_work(error),
        HttpError::NoRoute { .. } => (StatusCode::NOT_FOUND, Code::NotFound),
        HttpError::MethodNotAllowed { .. } => (StatusCode::METHOD_NOT_ALLOWED, Code::MethodNotAllowed),
        HttpError::NotAcceptable { .. } => (StatusCode::NOT_ACCEPTABLE, Code::NotAcceptable),
        HttpError::Parameter { .. } | HttpError::ParameterUnknown { .. } => {
            (StatusCode::BAD_REQUEST, Code::ParameterInvalid)
        }
        HttpError::BodyInvalid(_) => (StatusCode::BAD_REQUEST, Code::BodyInvalid),
        HttpError::BodyFormat { .. } => (StatusCode::UNSUPPORTED_MEDIA_TYPE, Code::FormatUnknown),
        HttpError::BodyTooLarge { .. } => (StatusCode::PAYLOAD_TOO_LARGE, Code::BodyTooLarge),
        HttpError::BodyTimeout { .. } => (StatusCode::REQUEST_TIMEOUT, Code::Timeout),
        HttpError::KeyReused(_) => (StatusCode::CONFLICT, Code::Conflict),
        HttpError::Unauthorized { .. } => (StatusCode::UNAUTHORIZED, Code::Unauthorized),
        HttpError::Forbidden { .. } | HttpError::AdminNeedsToken | HttpError::CrossOrigin { .. } => {
            (StatusCode::FORBIDDEN, Code::Forbidden)
        }
        HttpError::HostUnknown { .. } => (StatusCode::MISDIRECTED_REQUEST, Code::Forbidden),
        HttpError::Tokens(error) => judge_tokens(error),
        HttpError::TooOften { .. } | HttpError::TooManyConnections { beyond: ReserveReason::Address } => {
            (StatusCode::TOO_MANY_REQUESTS, Code::Overloaded)
        }
        HttpError::TooManyConnections { beyond: ReserveReason::All } => {
            (StatusCode::SERVICE_UNAVAILABLE, Code::Overloaded)
        }
        HttpError::TusVersion { .. } => (StatusCode::PRECONDITION_FAILED, Code::ParameterInvalid),
        HttpError::OwnerGone { .. } => (StatusCode::SERVICE_UNAVAILABLE, Code::OwnerGone),
        HttpError::OwnerBroke => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        HttpError::Stopping => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        HttpError::TooSlow { .. } => (StatusCode::GATEWAY_TIMEOUT, Code::Deadline),
        HttpError::Internal(_) => (StatusCode::INTERNAL_SERVER_ERROR, Code::Internal),
    }
}

fn judge_tokens(error: &AuthError) -> (StatusCode, Code) {
    match error {
        AuthError::Unknown(_) => (StatusCode::NOT_FOUND, Code::NotFound),
        AuthError::Invalid { .. } => (StatusCode::BAD_REQUEST, Code::ParameterInvalid),
        AuthError::Shared(_) => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        AuthError::File { .. } | AuthError::Format { .. } | AuthError::NoRandomness => {
            (StatusCode::INTERNAL_SERVER_ERROR, Code::Internal)
        }
    }
}

fn judge_work(error: &WorkError) -> (StatusCode, Code) {
    match error {
        WorkError::Engine(error) => judge_engine(error),
        WorkError::Corpus(error) => judge_corpus(error),
        WorkError::Pool(error) => judge_pool(error),
        WorkError::Upload(error) => judge_upload(error),
        WorkError::Parameter { .. } | WorkError::TopologyDiffers { .. } => {
            (StatusCode::BAD_REQUEST, Code::ParameterInvalid)
        }
        WorkError::NoSuchSegment { .. }
        | WorkError::NoSuchQuery(_)
        | WorkError::NoSuchMap(_)
        | WorkError::NoSuchComposition(_)
        | WorkError::NoSuchRetopo(_) => (StatusCode::NOT_FOUND, Code::NotFound),
        WorkError::QueryExpired(_) => (StatusCode::GONE, Code::QueryExpired),
        WorkError::NotEncodedYet { .. } => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        WorkError::QueryEnded { .. } | WorkError::TooMany { .. } | WorkError::NotMade { .. } => {
            (StatusCode::CONFLICT, Code::Conflict)
        }
        WorkError::CorpusEmpty { .. } => (StatusCode::CONFLICT, Code::CorpusEmpty),
        WorkError::QueriesFull { .. } | WorkError::MakingsFull { .. } => {
            (StatusCode::SERVICE_UNAVAILABLE, Code::Overloaded)
        }
        WorkError::Query(error) => judge_work(error),
        WorkError::Lost => (StatusCode::INTERNAL_SERVER_ERROR, Code::Internal),
    }
}

fn judge_engine(error: &EngineError) -> (StatusCode, Code) {
    match error {
        EngineError::Refused { refusal, .. } => judge_refusal(*refusal),
        EngineError::Stopped(reason) => judge_stop(*reason),
        EngineError::Internal(_) => (StatusCode::INTERNAL_SERVER_ERROR, Code::Internal),
    }
}

fn judge_refusal(refusal: Refusal) -> (StatusCode, Code) {
    match refusal {
        Refusal::Unreadable => (StatusCode::UNPROCESSABLE_ENTITY, Code::MeshUnreadable),
        Refusal::Empty => (StatusCode::UNPROCESSABLE_ENTITY, Code::MeshEmpty),
        Refusal::NotManifold => (StatusCode::UNPROCESSABLE_ENTITY, Code::MeshNotManifold),
        Refusal::TopologyUnsupported | Refusal::Unlike => (StatusCode::UNPROCESSABLE_ENTITY, Code::TopologyUnsupported),
        Refusal::NotEncodable => (StatusCode::UNPROCESSABLE_ENTITY, Code::MeshNotEncodable),
        Refusal::TooLarge => (StatusCode::PAYLOAD_TOO_LARGE, Code::MeshTooLarge),
        Refusal::FormatUnknown => (StatusCode::UNSUPPORTED_MEDIA_TYPE, Code::FormatUnknown),
        Refusal::LabelsInvalid | Refusal::ConstraintInvalid | Refusal::Unsupported => {
            (StatusCode::BAD_REQUEST, Code::ParameterInvalid)
        }
        Refusal::ConstraintUnknown => (StatusCode::NOT_FOUND, Code::NotFound),
        Refusal::ConstraintFolds => (StatusCode::UNPROCESSABLE_ENTITY, Code::ConstraintFolds),
        Refusal::CompositionInvalid => (StatusCode::CONFLICT, Code::Conflict),
    }
}

fn judge_corpus(error: &CorpusError) -> (StatusCode, Code) {
    match error {
        CorpusError::NotFound(_) => (StatusCode::NOT_FOUND, Code::NotFound),
        CorpusError::Invalid(_) => (StatusCode::BAD_REQUEST, Code::ParameterInvalid),
        CorpusError::Full(_) => (StatusCode::INSUFFICIENT_STORAGE, Code::StorageFull),
        CorpusError::ReadOnly(_) => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        CorpusError::Conflict(_) => (StatusCode::CONFLICT, Code::Conflict),
        CorpusError::Unreachable(_) => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        CorpusError::Busy => (StatusCode::SERVICE_UNAVAILABLE, Code::Overloaded),
        CorpusError::NoEncoding(_) => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        CorpusError::Damaged(_) => (StatusCode::GONE, Code::Damaged),
        CorpusError::Failed(_) => (StatusCode::INTERNAL_SERVER_ERROR, Code::Internal),
    }
}

fn judge_upload(error: &UploadError) -> (StatusCode, Code) {
    match error {
        UploadError::NoSuch(_) => (StatusCode::NOT_FOUND, Code::NotFound),
        UploadError::Offset { .. } | UploadError::Unfinished { .. } => (StatusCode::CONFLICT, Code::Conflict),
        UploadError::Beyond { .. } | UploadError::TooLarge { .. } => {
            (StatusCode::PAYLOAD_TOO_LARGE, Code::BodyTooLarge)
        }
        UploadError::OverShare { .. } => (StatusCode::TOO_MANY_REQUESTS, Code::Overloaded),
        UploadError::Full { .. } => (StatusCode::SERVICE_UNAVAILABLE, Code::Overloaded),
        UploadError::DiskFull { .. } => (StatusCode::INSUFFICIENT_STORAGE, Code::StorageFull),
        UploadError::Disk(_) => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
    }
}

fn judge_pool(error: &PoolError) -> (StatusCode, Code) {
    match error {
        PoolError::OverShare { .. } => (StatusCode::TOO_MANY_REQUESTS, Code::Overloaded),
        PoolError::Overloaded { .. } | PoolError::MemoryFull { .. } => {
            (StatusCode::SERVICE_UNAVAILABLE, Code::Overloaded)
        }
        PoolError::TooLarge { .. } => (StatusCode::PAYLOAD_TOO_LARGE, Code::MeshTooLarge),
        PoolError::Stopped(reason) => judge_stop(*reason),
        PoolError::Panicked { .. } => (StatusCode::INTERNAL_SERVER_ERROR, Code::Internal),
    }
}

/// A computation that was stopped while a request waited for it: its time was over, or the service is stopping.
fn judge_stop(reason: StopReason) -> (StatusCode, Code) {
    match reason {
        StopReason::Cancelled => (StatusCode::SERVICE_UNAVAILABLE, Code::Unavailable),
        StopReason::Memory => (StatusCode::PAYLOAD_TOO_LARGE, Code::MeshTooLarge),
        StopReason::Deadline => (StatusCode::GATEWAY_TIMEOUT, Code::Deadline),
    }
}

/// Seconds after which to come back, for errors that pass.
fn retry_after(error: &HttpError, status: StatusCode) -> Option<u64> {
    if let HttpError::Work(WorkError::Pool(refusal)) = error
        && let Some(after) = refusal.retry_after()
    {
        return Some(after.as_secs().max(1));
    }
    match error {
        HttpError::TooOften { retry_after } => Some(retry_after.as_secs().max(1)),
        _ if status == StatusCode::SERVICE_UNAVAILABLE || status == StatusCode::TOO_MANY_REQUESTS => {
            Some(RETRY_AFTER_S)
        }
        _ => None,
    }
}

/// The problem that an error is to the caller; what is ours to know goes to the log instead.
pub fn problem_of(error: &HttpError) -> Problem {
    let (status, code) = judge(error);
    let request_id = REQUEST_ID.try_with(Clone::clone).ok();
    let detail = match code {
        Code::Internal => {
            let chain = chain_of(error);
            tracing::error!(error = %chain, "internal error");
            "the service failed; the log of the server says more under this request id".to_owned()
        }
        _ => error.to_string(),
    };
    Problem { request_id, ..Problem::new(code, status.as_u16(), detail) }
}

/// An error and its sources, for the log.
fn chain_of(error: &dyn Error) -> String {
    let mut words = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        words.push_str(": ");
        words.push_str(&cause.to_string());
        source = cause.source();
    }
    words
}

impl IntoResponse for HttpError {
    fn into_response(self) -> Response {
        let problem = problem_of(&self);
        let status = StatusCode::from_u16(problem.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        // A struct of strings always prints.
        let body = serde_json::to_vec(&problem).unwrap_or_default();
        let mut response = (status, Body::from(body)).into_response();
        super::watchful::tell(&mut response, |logged| logged.code = Some(problem.code.as_str()));
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(problem::MEDIA_TYPE));
        if let Some(seconds) = retry_after(&self, status) {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if status == StatusCode::PRECONDITION_FAILED {
            headers.insert("tus-version", HeaderValue::from_static(TUS_VERSION));
        }
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_ours_is_not_told_to_the_caller() {
        let secret = HttpError::Work(WorkError::Engine(EngineError::Internal("/secret/path".into())));
        let problem = problem_of(&secret);
        assert_eq!((problem.status, problem.code), (500, Code::Internal));
        assert!(!problem.detail.contains("secret"));
    }

    #[test]
    fn a_mesh_never_causes_a_5xx() {
        for refusal in [
            Refusal::Unreadable,
            Refusal::Empty,
            Refusal::NotManifold,
            Refusal::TopologyUnsupported,
            Refusal::TooLarge,
            Refusal::FormatUnknown,
            Refusal::NotEncodable,
            Refusal::LabelsInvalid,
            Refusal::Unlike,
        ] {
            assert!(judge_refusal(refusal).0.is_client_error());
        }
    }
}
