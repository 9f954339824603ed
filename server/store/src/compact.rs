//! A fresh copy of the index, without what garbage and damage left in it.

use std::fs;
use std::path::Path;

use crate::derived::Part;
use crate::engine::{Engine, Failure};
use crate::error::StoreError;
use crate::files::{self, sync_dir};
use crate::recover::{INDEX_DIR, remove_tree};
use crate::shared::Shared;

/// A copy under way; worthless after a kill.
const COPY_DIR: &str = "index.copy";
/// A whole copy, to be opened in place of the index.
const NEXT_DIR: &str = "index.next";
/// The index that a copy took the place of.
const FORMER_DIR: &str = "index.former";
const CACHE_BYTES: u64 = 64 << 20;

/// Copies every record and every encoding that can be read. The copy takes the index's place by [`switch`].
pub(crate) fn copy(shared: &Shared, engine: &Engine) -> Result<(), StoreError> {
    let (bytes, _) = engine.size().unwrap_or((0, 0));
    shared.check_space(bytes)?;
    let dir = shared.dir.join(COPY_DIR);
    remove_tree(&dir)?;
    let copy = || {
        let fresh = Engine::open(&shared.dir, &dir, CACHE_BYTES)?;
        let index = shared.index();
        index.pointers().try_for_each(|(key, pointer)| fresh.reserve_parts(key, pointer))?;
        for (key, pointer) in index.pointers() {
            let part = |kind| Some(Part { kind, bytes: engine.part(key, pointer, kind).ok()?.ok()? });
            let Some(parts) = pointer.kinds().map(part).collect::<Option<Vec<_>>>() else {
                tracing::warn!(id = %key.0, segment = key.1, "a damaged encoding is left behind");
                continue;
            };
            fresh.put_parts(key, pointer.generation(), &parts)?;
            fresh.put_pointer(key, pointer, None)?;
            fresh.settle(key, pointer.generation())?;
        }
        for record in index.records() {
            // A record that doesn't serialise was never written: it can't be here.
            if let Ok(encoded) = files::encode(record) {
                fresh.put_record(record, &encoded)?;
            }
        }
        fresh.commit()
    };
    copy().map_err(|failure: Failure| failure.into_error("be copied"))?;
    fs::rename(&dir, shared.dir.join(NEXT_DIR)).map_err(StoreError::io("rename", &dir))?;
    sync_dir(&shared.dir)
}

/// Puts a whole copy, if there is one, in the place of the index. May be killed at any point and called again.
pub(crate) fn switch(store: &Path) -> Result<(), StoreError> {
    let (index, next, former) = (store.join(INDEX_DIR), store.join(NEXT_DIR), store.join(FORMER_DIR));
    if next.exists() {
        if index.exists() {
            remove_tree(&former)?;
            fs::rename(&index, &former).map_err(StoreError::io("rename", &index))?;
        }
        fs::rename(&next, &index).map_err(StoreError::io("rename", &next))?;
        sync_dir(store)?;
    } else if !index.exists() && former.exists() {
        fs::rename(&former, &index).map_err(StoreError::io("rename", &former))?;
        sync_dir(store)?;
    }
    remove_tree(&former)?;
    remove_tree(&store.join(COPY_DIR))
}
