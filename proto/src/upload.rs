//! Resumable uploads: the headers and media type of tus 1.0.0, as server and client spell them.
//!
//! *Source:* <https://tus.io/protocols/resumable-upload>, version 1.0.0: core, creation, expiration, termination. Nothing of an upload
//! travels in a message: its state is in headers, its bytes are bodies.

/// The version of the protocol that both ends speak.
pub const TUS_VERSION: &str = "1.0.0";

/// Its extensions that the server has.
pub const TUS_EXTENSIONS: &str = "creation,expiration,termination";

/// The version that a message is of; every request but `OPTIONS` names it.
pub const TUS_RESUMABLE: &str = "tus-resumable";

/// How many bytes there are already, or from which byte on the body goes.
pub const UPLOAD_OFFSET: &str = "upload-offset";

/// How many bytes there will be.
pub const UPLOAD_LENGTH: &str = "upload-length";

/// The uploader describes the file here, by keys with values in base 64.
pub const UPLOAD_METADATA: &str = "upload-metadata";

/// When an upload will be gone, as an HTTP date.
pub const UPLOAD_EXPIRES: &str = "upload-expires";

/// The media type of a piece.
pub const OFFSET_OCTET_STREAM: &str = "application/offset+octet-stream";
