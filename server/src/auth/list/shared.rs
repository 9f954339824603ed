//! The list as a document that servers share.

use super::{Mark, TokenRecord};
use crate::auth::AuthError;
use quadmuse_store::{Document, Documents, StoreError};
use std::path::PathBuf;

/// The document's name.
const NAME: &str = "tokens";

/// How often a change is tried while others change the list, too.
const TRIES: usize = 32;

fn parse(document: &Document) -> Result<Vec<TokenRecord>, AuthError> {
    serde_json::from_slice(&document.bytes)
        .map_err(|source| AuthError::Format { path: PathBuf::from("the document `tokens` of the cluster"), source })
}

pub(super) fn read(documents: &dyn Documents) -> Result<Option<Vec<TokenRecord>>, AuthError> {
    documents.read(NAME)?.as_ref().map(parse).transpose()
}

pub(super) fn known(documents: &dyn Documents) -> Result<Option<Vec<TokenRecord>>, AuthError> {
    documents.known(NAME).as_ref().map(parse).transpose()
}

pub(super) fn mark(documents: &dyn Documents) -> Option<Mark> {
    documents.known(NAME).map(|document| Mark::Revision(document.revision))
}

pub(super) fn change<T>(
    documents: &dyn Documents,
    change: impl Fn(&mut Vec<TokenRecord>) -> Result<T, AuthError>,
) -> Result<T, AuthError> {
    for _ in 0..TRIES {
        let now = documents.read(NAME)?;
        let mut records = now.as_ref().map_or_else(|| Ok(Vec::new()), parse)?;
        let changed = change(&mut records)?;
        let bytes = serde_json::to_vec(&records)
            .map_err(|source| AuthError::Format { path: PathBuf::from("the tokens"), source })?;
        if documents.write(NAME, now.map_or(0, |document| document.revision), &bytes)? {
            return Ok(changed);
        }
    }
    Err(StoreError::Busy.into())
}
