//! Long files go piece by piece (tus 1.0.0), so that a connection that breaks costs a piece and not the whole.

use super::{Api, Sent};
use crate::error::ClientError;
use quadmuse_proto::upload::{OFFSET_OCTET_STREAM, TUS_RESUMABLE, TUS_VERSION, UPLOAD_LENGTH, UPLOAD_OFFSET};
use reqwest::{Method, RequestBuilder, Response, StatusCode, header};
use std::time::Duration;

/// Files longer than this go piece by piece, in bytes.
pub(super) const WHOLE_MAX: usize = 16 << 20;

/// Bytes of a piece: little enough to arrive in the server's time over a slow line.
const PIECE: usize = 4 << 20;

/// So often a piece is sent again while nothing more arrives.
const TRIES_MAX: u32 = 8;

/// So often an upload that the server lost is begun anew.
const BEGINNINGS_MAX: u32 = 3;

/// Shortest and longest pause before a piece is sent again; it doubles from one to the next.
const PAUSE: (Duration, Duration) = (Duration::from_millis(500), Duration::from_secs(10));

/// Tells whether the server does not have what a request named.
fn is_absent(error: &ClientError) -> bool {
    matches!(error, ClientError::Refused(problem) if [404, 405, 410].contains(&problem.status))
}

/// Tells whether the client can ask how much arrived, and continue from there.
fn may_go_on(error: &ClientError) -> bool {
    match error {
        ClientError::Unreachable { .. } | ClientError::BrokenOff { .. } | ClientError::UploadBrokenOff { .. } => true,
        ClientError::Refused(problem) => [404, 408, 409, 410, 429, 503].contains(&problem.status),
        _ => false,
    }
}

impl Api {
    fn tus(&self, method: Method, path: &[&str]) -> RequestBuilder {
        self.request(method, path).header(TUS_RESUMABLE, TUS_VERSION)
    }

    /// Uploads bytes, however often the connection breaks; the upload's id. `None` where the server takes none: an older one.
    ///
    /// # Errors
    /// The service refuses, or stays out of reach.
    pub(super) async fn upload(&self, bytes: &[u8], sent: Sent<'_>) -> Result<Option<String>, ClientError> {
        let mut beginnings = 1;
        loop {
            let Some(id) = self.begin(bytes.len()).await? else { return Ok(None) };
            match self.send_pieces(&id, bytes, sent).await {
                Ok(()) => return Ok(Some(id)),
                Err(error) if is_absent(&error) && beginnings < BEGINNINGS_MAX => beginnings += 1,
                Err(error) => return Err(error),
            }
        }
    }

    async fn begin(&self, length: usize) -> Result<Option<String>, ClientError> {
        let request = self.tus(Method::POST, &["uploads"]).header(UPLOAD_LENGTH, length);
        let response = match self.send(request).await {
            Err(error) if is_absent(&error) => return Ok(None),
            answer => answer?,
        };
        let location = response.headers().get(header::LOCATION).and_then(|value| value.to_str().ok());
        match location.and_then(|at| at.rsplit('/').next()).filter(|id| !id.is_empty()) {
            Some(id) => Ok(Some(id.to_owned())),
            None => Err(unintelligible(&response, "the address of an upload", header::LOCATION.as_str())),
        }
    }

    async fn send_pieces(&self, id: &str, bytes: &[u8], arrived: Sent<'_>) -> Result<(), ClientError> {
        let (mut offset, mut tries, mut pause) = (0, 0, PAUSE.0);
        while let Some(rest) = bytes.get(offset..).filter(|rest| !rest.is_empty()) {
            let sent = self.send_piece(id, offset, &rest[..rest.len().min(PIECE)]).await;
            let error = match sent {
                Ok(next) => {
                    (offset, tries, pause) = (next, 0, PAUSE.0);
                    arrived(next as f64 / bytes.len() as f64);
                    continue;
                }
                Err(error) if is_absent(&error) || !may_go_on(&error) || tries >= TRIES_MAX => return Err(error),
                Err(error) => error,
            };
            tokio::time::sleep(pause).await;
            (tries, pause) = (tries + 1, (2 * pause).min(PAUSE.1));
            match self.offset(id).await {
                Ok(there) if there > offset => (offset, tries, pause) = (there, 0, PAUSE.0),
                Ok(there) => offset = there,
                Err(lost) if is_absent(&lost) => return Err(lost),
                Err(_) if tries < TRIES_MAX => {}
                Err(_) => return Err(error),
            }
        }
        Ok(())
    }

    async fn send_piece(&self, id: &str, offset: usize, piece: &[u8]) -> Result<usize, ClientError> {
        let request = self.tus(Method::PATCH, &["uploads", id]).header(UPLOAD_OFFSET, offset);
        let request = request.header(header::CONTENT_TYPE, OFFSET_OCTET_STREAM).body(piece.to_vec());
        offset_of(&self.send(request).await?)
    }

    async fn offset(&self, id: &str) -> Result<usize, ClientError> {
        offset_of(&self.send(self.tus(Method::HEAD, &["uploads", id])).await?)
    }

    /// Frees an upload that was used. One that stays costs nobody more than its time.
    pub(super) async fn free_upload(&self, id: &str) {
        let _ = self.send_once(self.tus(Method::DELETE, &["uploads", id])).await;
    }
}

fn offset_of(response: &Response) -> Result<usize, ClientError> {
    let offset = response.headers().get(UPLOAD_OFFSET).and_then(|value| value.to_str().ok()?.parse().ok());
    offset.ok_or_else(|| unintelligible(response, "how much of an upload arrived", UPLOAD_OFFSET))
}

fn unintelligible(response: &Response, expected: &'static str, header: &str) -> ClientError {
    let status = match response.status() {
        status if status == StatusCode::OK => "an answer".to_owned(),
        status => format!("an answer of status {}", status.as_u16()),
    };
    ClientError::Unintelligible {
        url: response.url().to_string(),
        expected,
        found: format!("{status} without a usable `{header}`"),
    }
}
