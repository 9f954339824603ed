//! What queries were started with, kept for a day, so that one can be started again: on this server after it ended, or on
//! another after its own died. What its segments are called is kept beside it.
//!
//! Kept are the bytes as they were sent (unpacked, then compressed by zstd) with all that was asked of them and whose they
//! are. They are kept behind the answer's back: a query is not slower for it, and is ranked where keeping fails.

use super::corpus::CorpusError;
use super::engine::Cut;
use super::ingest::Upload;
use super::query::{LiveQuery, QueryOptions};
use super::{Caller, Work, WorkError};
use crate::pool::User;
use bytes::Bytes;
use quadmuse_cluster::{UPLOADS_BYTES_MAX, UPLOADS_KEPT_FOR};
use quadmuse_proto::{Components, ExampleId, MeshFormat, Parts, QueryId, Segmentation};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tokio::sync::{Semaphore, watch};

/// Uploads that are put away, and that are fetched, at a time; the others wait.
const AT_ONCE: usize = 2;

/// How well they are compressed: fast.
const ZSTD_LEVEL: i32 = 1;

/// Names the two things that are kept of a query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeptKind {
    /// Its upload, with what was asked.
    Upload,
    /// The names of its segments.
    Names,
}

impl KeptKind {
    /// The end of the name under which it is kept: it follows the query's id.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Upload => "",
            Self::Names => "-names",
        }
    }
}

/// Where uploads of queries are kept for [`UPLOADS_KEPT_FOR`] at most, and while they take at most [`UPLOADS_BYTES_MAX`]. Every
/// call blocks.
pub trait UploadStore: Send + Sync + 'static {
    /// Puts one away, in place of an older one.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn put(&self, id: QueryId, what: KeptKind, bytes: &[u8]) -> Result<(), CorpusError>;

    /// One that was put away; `None` if it never was, or is no more.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn get(&self, id: QueryId, what: KeptKind) -> Result<Option<Vec<u8>>, CorpusError>;

    /// Removes one, if it is there.
    ///
    /// # Errors
    /// [`CorpusError`].
    fn remove(&self, id: QueryId, what: KeptKind) -> Result<(), CorpusError>;
}

/// The request of a caller who started a query, beside the bytes.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct QueryRequest {
    owner: u64,
    /// Length of the bytes, unpacked.
    length: u64,
    top: u32,
    resolution: u32,
    deadline_ms: Option<u64>,
    tags: Vec<String>,
    like: Option<ExampleId>,
    format: Option<MeshFormat>,
    way: Segmentation,
    labels: Option<Vec<i64>>,
    components: Components,
    /// As `parts=` has it.
    parts: Option<String>,
}

/// An upload as it is kept: the length of what was asked (u32 LE), what was asked as MessagePack, the bytes by zstd.
fn packed(owner: User, upload: &Upload, options: &QueryOptions) -> Result<Vec<u8>, CorpusError> {
    let failed = |error: Box<dyn std::error::Error + Send + Sync>| CorpusError::Failed(error);
    let asked = QueryRequest {
        owner: owner.0,
        length: upload.bytes.len() as u64,
        top: options.top,
        resolution: options.resolution,
        deadline_ms: options.deadline.map(|time| time.as_millis() as u64),
        tags: options.tags.clone(),
        like: options.like,
        format: upload.format,
        way: upload.cut.way,
        labels: upload.cut.labels.clone(),
        components: upload.cut.components,
        parts: upload.cut.parts.map(|parts| parts.to_string()),
    };
    let asked = rmp_serde::to_vec_named(&asked).map_err(|error| failed(error.into()))?;
    let bytes = zstd::bulk::compress(&upload.bytes, ZSTD_LEVEL).map_err(|error| failed(error.into()))?;
    Ok([&(asked.len() as u32).to_le_bytes()[..], &asked, &bytes].concat())
}

/// What was asked, and the bytes as they are compressed; `None` of what is damaged.
fn unpacked(kept: &[u8]) -> Option<(QueryRequest, &[u8])> {
    let (length, rest) = kept.split_first_chunk::<4>()?;
    let (asked, bytes) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    Some((rmp_serde::from_slice(asked).ok()?, bytes))
}

/// Keeps and gives back what queries were started with.
pub struct KeptQueries {
    uploads: Arc<dyn UploadStore>,
    turns: Arc<Semaphore>,
    readers: Semaphore,
    /// Names are put away one after the other.
    naming: Arc<Semaphore>,
    /// Queries whose uploads are being put away.
    pending: watch::Sender<BTreeSet<QueryId>>,
}

/// A query whose upload is being put away, until this is dropped.
struct Pending {
    id: QueryId,
    of: watch::Sender<BTreeSet<QueryId>>,
}

impl Pending {
    fn new(of: &watch::Sender<BTreeSet<QueryId>>, id: QueryId) -> Self {
        of.send_if_modified(|ids| ids.insert(id));
        Self { id, of: of.clone() }
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        self.of.send_if_modified(|ids| ids.remove(&self.id));
    }
}

impl KeptQueries {
    /// On a store of uploads.
    pub fn on(uploads: Arc<dyn UploadStore>) -> Self {
        let (turns, readers, naming) = (Semaphore::new(AT_ONCE), Semaphore::new(AT_ONCE), Semaphore::new(1));
        let (turns, naming) = (Arc::new(turns), Arc::new(naming));
        Self { uploads, turns, readers, naming, pending: watch::Sender::default() }
    }

    /// Keeps what a query was started with, in the background.
    pub fn keep(&self, work: &Arc<Work>, live: &LiveQuery, upload: Upload) {
        let (uploads, turns, work) = (Arc::clone(&self.uploads), Arc::clone(&self.turns), Arc::clone(work));
        let (id, owner, options) = (live.id, live.caller.user, live.options.clone());
        let tracked = Arc::clone(&work);
        let pending = Pending::new(&self.pending, id);
        tracked.background.spawn(async move {
            let _pending = pending;
            let Ok(_turn) = turns.acquire_owned().await else { return };
            let kept = work.blocking(move |work| {
                // Removed while it waited: nobody wants it.
                if work.queries.owner(id).is_some() {
                    uploads.put(id, KeptKind::Upload, &packed(owner, &upload, &options)?)?;
                    drop(upload);
                    if work.queries.owner(id).is_none() {
                        uploads.remove(id, KeptKind::Upload)?;
                    }
                }
                Ok(())
            });
            if let Err(error) = kept.await {
                tracing::warn!(%error, query = %id, "its upload is not kept: it can't be started again elsewhere");
            }
        });
    }

    /// Keeps what the segments of a query are called, in the background.
    pub fn keep_names(&self, work: &Arc<Work>, live: &Arc<LiveQuery>) {
        let (uploads, naming, work) = (Arc::clone(&self.uploads), Arc::clone(&self.naming), Arc::clone(work));
        let (id, live, tracked) = (live.id, Arc::clone(live), Arc::clone(&work));
        tracked.background.spawn(async move {
            // Each puts away the names as they are by then, so the last that were given are the last that are kept.
            let Ok(_turn) = naming.acquire_owned().await else { return };
            let kept = work.blocking(move |work| {
                let names = live.names.all();
                if names.is_empty() || work.queries.owner(id).is_none() {
                    uploads.remove(id, KeptKind::Names)?;
                    return Ok(());
                }
                let bytes = rmp_serde::to_vec(&names).map_err(|error| CorpusError::Failed(error.into()))?;
                uploads.put(id, KeptKind::Names, &bytes)?;
                if work.queries.owner(id).is_none() {
                    uploads.remove(id, KeptKind::Names)?;
                }
                Ok(())
            });
            if let Err(error) = kept.await {
                tracing::warn!(%error, query = %id, "its names are not kept: it has none where it is started again");
            }
        });
    }

    /// The names that the segments of a query have, or had. Without them it is started again all the same.
    pub async fn names(&self, work: &Arc<Work>, id: QueryId) -> BTreeMap<u32, String> {
        if let Ok(live) = work.queries.get(id) {
            return live.names.all();
        }
        let uploads = Arc::clone(&self.uploads);
        let found = work.blocking(move |_| Ok(uploads.get(id, KeptKind::Names)?)).await;
        let kept = found.unwrap_or_else(|error| {
            tracing::warn!(%error, query = %id, "its names are not found");
            None
        });
        kept.and_then(|kept| rmp_serde::from_slice(&kept).ok()).unwrap_or_default()
    }

    /// Gives what a query of the caller was started with. It waits for one that is being put away.
    ///
    /// # Errors
    /// [`WorkError::NoSuchQuery`] if nothing is kept of it, or if it was another's; refusals of the memory, and
    /// [`WorkError::Corpus`].
    pub async fn find(
        &self,
        work: &Arc<Work>,
        caller: Caller,
        id: QueryId,
        largest: u64,
    ) -> Result<(Upload, QueryOptions), WorkError> {
        work.look(caller.user)?;
        self.pending.subscribe().wait_for(|ids| !ids.contains(&id)).await.map(drop).map_err(|_| WorkError::Lost)?;
        // What comes from there is paid for only once its length is known.
        let _reader = self.readers.acquire().await.map_err(|_| WorkError::Lost)?;
        let uploads = Arc::clone(&self.uploads);
        let found = work.blocking(move |_| Ok(uploads.get(id, KeptKind::Upload)?)).await?;
        let kept = found.as_deref().and_then(unpacked);
        let (asked, bytes) = kept.ok_or(WorkError::NoSuchQuery(id))?;
        if !caller.sees(User(asked.owner)) || asked.length > largest {
            return Err(WorkError::NoSuchQuery(id));
        }
        let (share, bytes) = (work.hold(caller.user, asked.length)?, bytes.to_vec());
        let length = asked.length as usize;
        let whole = move |_: &Work| {
            let bytes = zstd::bulk::decompress(&bytes, length).map_err(|_| WorkError::NoSuchQuery(id))?;
            Ok(share.held(bytes))
        };
        let bytes: Bytes = work.blocking(whole).await?;
        let cut = Cut {
            way: asked.way,
            labels: asked.labels,
            components: asked.components,
            parts: asked.parts.and_then(|parts| parts.parse::<Parts>().ok()),
            ..Cut::default()
        };
        let options = QueryOptions {
            top: asked.top,
            resolution: asked.resolution,
            deadline: asked.deadline_ms.map(Duration::from_millis),
            tags: asked.tags,
            like: asked.like,
        };
        Ok((Upload { bytes, format: asked.format, cut }, options))
    }

    /// Removes what is kept of a query, in the background.
    pub fn remove(&self, work: &Arc<Work>, id: QueryId) {
        let (uploads, tracked) = (Arc::clone(&self.uploads), Arc::clone(work));
        let work = Arc::clone(work);
        tracked.background.spawn(async move {
            let removed = work.blocking(move |_| {
                uploads.remove(id, KeptKind::Upload)?;
                Ok(uploads.remove(id, KeptKind::Names)?)
            });
            if let Err(error) = removed.await {
                tracing::debug!(%error, query = %id, "its upload was not removed; it goes with its time");
            }
        });
    }
}

/// The folder beside the store.
const FOLDER: &str = "queries";

/// Free space that is left alone, in bytes: as much as uploads leave alone.
const FREE_LEAST: u64 = 256 << 20;

/// The uploads of one server: files beside its store, each under the id of its query.
pub struct Files {
    dir: PathBuf,
}

impl Files {
    /// Those beside the store in `data`.
    pub fn beside(data: &Path) -> Self {
        Self { dir: data.join(FOLDER) }
    }

    /// Removes what is too old, and the oldest until `more` bytes fit.
    fn make_room(&self, more: u64) -> std::io::Result<()> {
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.dir)?.flatten() {
            if let Ok(facts) = entry.metadata() {
                files.push((facts.modified().unwrap_or(SystemTime::UNIX_EPOCH), facts.len(), entry.path()));
            }
        }
        files.sort();
        let mut used: u64 = files.iter().map(|(_, length, _)| length).sum();
        for (put, length, path) in files {
            let is_old = put.elapsed().is_ok_and(|age| age > UPLOADS_KEPT_FOR);
            if !is_old && used + more <= UPLOADS_BYTES_MAX {
                break;
            }
            // Somebody else may have removed it: it is gone either way.
            let _ = fs::remove_file(path);
            used -= length;
        }
        Ok(())
    }

    fn path(&self, id: QueryId, what: KeptKind) -> PathBuf {
        self.dir.join(format!("{id}{}", what.suffix()))
    }

    fn write(&self, id: QueryId, what: KeptKind, bytes: &[u8]) -> std::io::Result<()> {
        fs::create_dir_all(&self.dir)?;
        self.make_room(bytes.len() as u64)?;
        let facts = rustix::fs::statvfs(&self.dir)?;
        let free = facts.f_bavail.saturating_mul(facts.f_frsize);
        if (bytes.len() as u64).saturating_add(FREE_LEAST) > free {
            return Err(ErrorKind::StorageFull.into());
        }
        // Under another name until it is whole; what a crash leaves of it goes with its time.
        let partial = self.dir.join(format!("{id}{}.partial", what.suffix()));
        let written = OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&partial);
        let written = written.and_then(|mut file| file.write_all(bytes));
        written.and_then(|()| fs::rename(&partial, self.path(id, what))).inspect_err(|_| {
            let _ = fs::remove_file(&partial);
        })
    }
}

fn of_disk(error: std::io::Error) -> CorpusError {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
            CorpusError::Full("expected room on the disk for the upload of a query, found too little".into())
        }
        _ => CorpusError::Failed(error.into()),
    }
}

impl UploadStore for Files {
    fn put(&self, id: QueryId, what: KeptKind, bytes: &[u8]) -> Result<(), CorpusError> {
        self.write(id, what, bytes).map_err(of_disk)
    }

    fn get(&self, id: QueryId, what: KeptKind) -> Result<Option<Vec<u8>>, CorpusError> {
        let path = self.path(id, what);
        let is_old = |facts: fs::Metadata| facts.modified().ok()?.elapsed().ok().map(|age| age > UPLOADS_KEPT_FOR);
        match fs::metadata(&path).map(is_old).and_then(|is_old| Ok((is_old, fs::read(&path)?))) {
            Ok((Some(true), _)) => Ok(None),
            Ok((_, bytes)) => Ok(Some(bytes)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(of_disk(error)),
        }
    }

    fn remove(&self, id: QueryId, what: KeptKind) -> Result<(), CorpusError> {
        match fs::remove_file(self.path(id, what)) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(of_disk(error)),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> QueryOptions {
        let tags = vec!["head".into()];
        QueryOptions { top: 3, resolution: 64, deadline: Some(Duration::from_millis(1500)), tags, like: None }
    }

    #[test]
    fn what_was_asked_comes_back_with_the_bytes() {
        let cut = Cut { labels: Some(vec![0, 1, -1]), parts: None, ..Cut::default() };
        let bytes = Bytes::from_static(b"v 0 0 0\nv 0 0 0\nv 0 0 0\n");
        let upload = Upload { bytes: bytes.clone(), format: Some(MeshFormat::Obj), cut };
        let kept = packed(User(7), &upload, &options()).expect("packed");
        let (asked, compressed) = unpacked(&kept).expect("whole");
        assert_eq!((asked.owner, asked.top, asked.deadline_ms), (7, 3, Some(1500)));
        assert_eq!(asked.labels, upload.cut.labels);
        assert_eq!(zstd::bulk::decompress(compressed, asked.length as usize).expect("whole"), bytes);
        for end in [0, 3, 10] {
            assert!(unpacked(&kept[..end]).is_none());
        }
    }

    #[test]
    fn files_are_there_until_they_are_removed_or_old() {
        let dir = tempfile::tempdir().expect("a directory");
        let files = Files::beside(dir.path());
        let (one, other) = (QueryId::generate(), QueryId::generate());
        let get = |id, what| files.get(id, what).expect("answered");
        assert_eq!(get(one, KeptKind::Upload), None);
        files.put(one, KeptKind::Upload, b"one").expect("put");
        files.put(other, KeptKind::Upload, b"other").expect("put");
        let again = Files::beside(dir.path());
        assert_eq!(again.get(one, KeptKind::Upload).expect("answered").as_deref(), Some(&b"one"[..]));
        // Names stand beside it, and the newer ones in place of the older.
        assert_eq!(get(one, KeptKind::Names), None);
        files.put(one, KeptKind::Names, b"old").expect("put");
        files.put(one, KeptKind::Names, b"new").expect("put");
        files.remove(one, KeptKind::Upload).expect("removed");
        files.remove(one, KeptKind::Upload).expect("removed before");
        assert_eq!((get(one, KeptKind::Upload), get(one, KeptKind::Names)), (None, Some(b"new".to_vec())));
        files.remove(one, KeptKind::Names).expect("removed");

        let old = fs::File::options().write(true).open(dir.path().join(FOLDER).join(other.to_string())).expect("there");
        old.set_modified(SystemTime::now() - UPLOADS_KEPT_FOR - Duration::from_secs(60)).expect("set");
        assert_eq!(get(other, KeptKind::Upload), None);
        files.put(one, KeptKind::Upload, b"one").expect("put");
        assert_eq!(fs::read_dir(dir.path().join(FOLDER)).expect("a folder").count(), 1);
    }
}
