//! Files that arrive piece by piece, and so survive a broken connection: on disk beside the store, bounded, and gone after a while.
//!
//! Of each there are two files below `uploads/`: its bytes under its id, and `ID.json` with whose it is and how long it will be.
//! How many bytes arrived is the length of the first, so that a restart finds it. A second writer of the same upload finds another
//! offset than it knows, and is refused.

use super::{Caller, Work, WorkError};
use crate::pool::User;
use bytes::Bytes;
use quadmuse_proto::UploadId;
use quadmuse_proto::id::ServerNumber;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::{self, File, OpenOptions};
use std::io::ErrorKind;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio_util::sync::CancellationToken;

/// The folder beside the store.
const FOLDER: &str = "uploads";

/// Most uploads of one caller at a time.
const PER_USER_MAX: usize = 16;

/// So many uploads of the largest size may be there at a time; of one caller half as many.
const LARGEST_MAX: u64 = 8;

/// An upload that nothing happens to is gone after this time.
const IDLE_TIME_MAX: Duration = Duration::from_secs(3600);

/// An upload is gone after this time, whatever happens to it.
const AGE_MAX: Duration = Duration::from_secs(24 * 3600);

/// Free space that uploads leave alone, in bytes: twice what the store leaves alone, so that the corpus can still be written.
const FREE_LEAST: u64 = 256 << 20;

/// Between two looks for uploads whose time is over.
const COLLECT_EVERY: Duration = Duration::from_secs(60);

/// Why an upload is not made, continued or used.
#[derive(Debug, thiserror::Error)]
pub enum UploadError {
    /// There is none: it was never made, was another's, was removed, or its time is over.
    #[error(
        "expected an upload of yours on this server, found none with the id {0}; its time is over, or it is not there: begin anew"
    )]
    NoSuch(UploadId),
    /// It stands elsewhere.
    #[error(
        "expected the bytes from {expected} on, found those from {found} on; ask for `upload-offset` by HEAD, and go on from there"
    )]
    Offset {
        /// So many bytes are there.
        expected: u64,
        /// From there on they were sent.
        found: u64,
    },
    /// More bytes than were announced.
    #[error("expected {length} bytes in all, as `upload-length` announced, found more")]
    Beyond {
        /// How many were announced.
        length: u64,
    },
    /// More bytes are announced than may be.
    #[error(
        "expected `upload-length` to be at most {limit}, found {found}; send a smaller mesh, or raise --upload-limit"
    )]
    TooLarge {
        /// How many there may be.
        limit: u64,
        /// How many were announced.
        found: u64,
    },
    /// It is used before all of it is there.
    #[error("expected all {length} bytes of the upload {id}, found {offset}; send the rest first")]
    Unfinished {
        /// Which.
        id: UploadId,
        /// So many are there.
        offset: u64,
        /// So many there will be.
        length: u64,
    },
    /// The caller has too many, or too much in them.
    #[error(
        "expected at most {limit} {of} in uploads of one caller, found more; use or remove some, or try again later"
    )]
    OverShare {
        /// Of what.
        of: &'static str,
        /// How much there may be.
        limit: u64,
    },
    /// All of them together are too much.
    #[error("expected room for {needed} bytes among the uploads, found none; try again shortly")]
    Full {
        /// What was asked for.
        needed: u64,
    },
    /// The disk has no room.
    #[error("expected {needed} bytes of free space beside a reserve, found less; free some on the server's disk")]
    DiskFull {
        /// What was asked for.
        needed: u64,
    },
    /// The disk fails.
    #[error("expected to keep an upload on the disk, found {0}")]
    Disk(std::io::Error),
}

fn of_disk(error: std::io::Error) -> UploadError {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
            UploadError::DiskFull { needed: 0 }
        }
        _ => UploadError::Disk(error),
    }
}

/// The status of an upload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UploadStatus {
    /// So many bytes are there.
    pub offset: u64,
    /// So many there will be.
    pub length: u64,
    /// What the uploader said of them, as it was sent.
    pub metadata: String,
    /// When it will be gone.
    pub expires: SystemTime,
}

/// The header that is written of an upload beside its bytes.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct UploadHeader {
    owner: u64,
    length: u64,
    metadata: String,
}

#[derive(Debug)]
struct Upload {
    announced: UploadHeader,
    now: Mutex<UploadProgress>,
}

/// How far an upload is.
#[derive(Debug)]
struct UploadProgress {
    offset: u64,
    touched: SystemTime,
    /// Whoever has found it before finds it no more.
    is_gone: bool,
}

/// The uploads of a server.
#[derive(Debug)]
pub struct Uploads {
    dir: PathBuf,
    largest: u64,
    idle_max: Duration,
    /// This server, if there are several: ids tell it.
    server: Option<ServerNumber>,
    all: Mutex<HashMap<UploadId, Arc<Upload>>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Uploads {
    /// The uploads beside the store in `data`, each of at most `largest` bytes; those of an earlier run are found again.
    pub fn beside(data: &Path, largest: u64) -> Self {
        Self::lasting(data, largest, IDLE_TIME_MAX)
    }

    fn lasting(data: &Path, largest: u64, idle_max: Duration) -> Self {
        let dir = data.join(FOLDER);
        let all = Mutex::new(found(&dir));
        Self { dir, largest, idle_max, server: None, all }
    }

    /// The same on this one of several servers.
    pub fn on(self, server: Option<ServerNumber>) -> Self {
        Self { server, ..self }
    }

    /// Largest size of an upload, in bytes.
    pub fn largest(&self) -> u64 {
        self.largest
    }

    /// Begins an upload of `length` bytes. Blocks.
    ///
    /// # Errors
    /// [`UploadError::TooLarge`], [`UploadError::OverShare`], [`UploadError::Full`], [`UploadError::DiskFull`], [`UploadError::Disk`].
    pub fn begin(
        &self,
        caller: Caller,
        length: u64,
        metadata: String,
    ) -> Result<(UploadId, UploadStatus), UploadError> {
        if length > self.largest {
            return Err(UploadError::TooLarge { limit: self.largest, found: length });
        }
        self.collect();
        fs::create_dir_all(&self.dir).map_err(of_disk)?;
        let mut all = lock(&self.all);
        self.check_room(&all, caller.user, length)?;
        let id = UploadId::generate_on(self.server);
        let announced = UploadHeader { owner: caller.user.0, length, metadata };
        // The bytes' file first: one without the other is removed at the next start.
        let written = created(&self.dir.join(id.to_string()))
            .and_then(|_| fs::write(self.announced(id), serde_json::to_vec(&announced)?));
        if let Err(error) = written {
            self.remove_files(id);
            return Err(of_disk(error));
        }
        let now = UploadProgress { offset: 0, touched: SystemTime::now(), is_gone: false };
        let upload = Arc::new(Upload { announced, now: Mutex::new(now) });
        let standing = self.standing(id, &upload, &lock(&upload.now));
        all.insert(id, upload);
        Ok((id, standing))
    }

    fn check_room(&self, all: &HashMap<UploadId, Arc<Upload>>, user: User, length: u64) -> Result<(), UploadError> {
        let (mut count, mut mine, mut total, mut to_come) = (0, 0_u64, 0_u64, 0_u64);
        for upload in all.values() {
            let announced = upload.announced.length;
            total += announced;
            to_come += announced.saturating_sub(lock(&upload.now).offset);
            if upload.announced.owner == user.0 {
                count += 1;
                mine += announced;
            }
        }
        if count >= PER_USER_MAX {
            return Err(UploadError::OverShare { of: "files", limit: PER_USER_MAX as u64 });
        }
        let share = self.largest.saturating_mul(LARGEST_MAX / 2);
        if mine.saturating_add(length) > share {
            return Err(UploadError::OverShare { of: "bytes", limit: share });
        }
        if total.saturating_add(length) > self.largest.saturating_mul(LARGEST_MAX) {
            return Err(UploadError::Full { needed: length });
        }
        let facts = rustix::fs::statvfs(&self.dir).map_err(|error| of_disk(error.into()))?;
        let free = facts.f_bavail.saturating_mul(facts.f_frsize);
        if length.saturating_add(to_come).saturating_add(FREE_LEAST) > free {
            return Err(UploadError::DiskFull { needed: length });
        }
        Ok(())
    }

    /// Where an upload of the caller stands. Blocks while somebody writes.
    ///
    /// # Errors
    /// [`UploadError::NoSuch`], also where it is another's.
    pub fn look(&self, caller: Caller, id: UploadId) -> Result<UploadStatus, UploadError> {
        let upload = self.get(caller, id)?;
        let now = lock(&upload.now);
        Ok(self.standing(id, &upload, &now))
    }

    /// Adds `bytes` to an upload that stands at `offset`; where it stands then. Blocks.
    ///
    /// # Errors
    /// [`UploadError::NoSuch`], [`UploadError::Offset`], [`UploadError::Beyond`], and those of the disk.
    pub fn append(&self, caller: Caller, id: UploadId, offset: u64, bytes: &[u8]) -> Result<UploadStatus, UploadError> {
        let upload = self.get(caller, id)?;
        let mut now = lock(&upload.now);
        if now.is_gone {
            return Err(UploadError::NoSuch(id));
        }
        if now.offset != offset {
            return Err(UploadError::Offset { expected: now.offset, found: offset });
        }
        let (length, end) = (upload.announced.length, offset.saturating_add(bytes.len() as u64));
        if end > length {
            return Err(UploadError::Beyond { length });
        }
        let file = OpenOptions::new().write(true).open(self.dir.join(id.to_string())).map_err(of_disk)?;
        file.write_all_at(bytes, offset).map_err(of_disk)?;
        (now.offset, now.touched) = (end, SystemTime::now());
        Ok(self.standing(id, &upload, &now))
    }

    /// Sees to it that what arrived outlasts a power cut. Blocks.
    ///
    /// # Errors
    /// [`UploadError::NoSuch`], and those of the disk.
    pub fn sync(&self, caller: Caller, id: UploadId) -> Result<UploadStatus, UploadError> {
        let upload = self.get(caller, id)?;
        File::open(self.dir.join(id.to_string())).and_then(|file| file.sync_data()).map_err(of_disk)?;
        let now = lock(&upload.now);
        Ok(self.standing(id, &upload, &now))
    }

    /// All bytes of an upload. Blocks.
    ///
    /// # Errors
    /// [`UploadError::NoSuch`], [`UploadError::Unfinished`], and those of the disk.
    fn read(&self, caller: Caller, id: UploadId) -> Result<Vec<u8>, UploadError> {
        let upload = self.get(caller, id)?;
        let bytes = fs::read(self.dir.join(id.to_string())).map_err(of_disk)?;
        let (offset, length) = (bytes.len() as u64, upload.announced.length);
        if offset != length {
            return Err(UploadError::Unfinished { id, offset, length });
        }
        lock(&upload.now).touched = SystemTime::now();
        Ok(bytes)
    }

    /// Removes an upload. Blocks.
    ///
    /// # Errors
    /// [`UploadError::NoSuch`].
    pub fn remove(&self, caller: Caller, id: UploadId) -> Result<(), UploadError> {
        self.get(caller, id)?;
        self.forget(id);
        Ok(())
    }

    /// Removes what is over. Blocks.
    pub fn collect(&self) {
        let all: Vec<_> = lock(&self.all).iter().map(|(id, upload)| (*id, Arc::clone(upload))).collect();
        for (id, upload) in all {
            let is_over = self.expires(id, &lock(&upload.now)) <= SystemTime::now();
            if is_over {
                self.forget(id);
            }
        }
    }

    fn forget(&self, id: UploadId) {
        let Some(upload) = lock(&self.all).remove(&id) else { return };
        // Whoever is writing has ended then.
        lock(&upload.now).is_gone = true;
        self.remove_files(id);
    }

    fn remove_files(&self, id: UploadId) {
        for path in [self.announced(id), self.dir.join(id.to_string())] {
            if let Err(error) = fs::remove_file(&path)
                && error.kind() != ErrorKind::NotFound
            {
                tracing::warn!(%error, path = %path.display(), "an upload was not removed");
            }
        }
    }

    fn announced(&self, id: UploadId) -> PathBuf {
        self.dir.join(format!("{id}.json"))
    }

    fn get(&self, caller: Caller, id: UploadId) -> Result<Arc<Upload>, UploadError> {
        let upload = lock(&self.all).get(&id).cloned().ok_or(UploadError::NoSuch(id))?;
        let is_over = self.expires(id, &lock(&upload.now)) <= SystemTime::now();
        if is_over || !caller.sees(User(upload.announced.owner)) {
            return Err(UploadError::NoSuch(id));
        }
        Ok(upload)
    }

    fn expires(&self, id: UploadId, now: &UploadProgress) -> SystemTime {
        let begun = UNIX_EPOCH + Duration::from_millis(id.created_unix_ms());
        (now.touched + self.idle_max).min(begun + AGE_MAX)
    }

    fn standing(&self, id: UploadId, upload: &Upload, now: &UploadProgress) -> UploadStatus {
        let UploadHeader { length, metadata, .. } = upload.announced.clone();
        UploadStatus { offset: now.offset, length, metadata, expires: self.expires(id, now) }
    }
}

fn created(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)
}

/// The uploads that an earlier run left; what belongs to none is removed.
fn found(dir: &Path) -> HashMap<UploadId, Arc<Upload>> {
    let mut all = HashMap::new();
    let Ok(entries) = fs::read_dir(dir) else { return all };
    for entry in entries.flatten() {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        let id = name.strip_suffix(".json").unwrap_or(&name).parse::<UploadId>().ok();
        match id.and_then(|id| Some((id, left(dir, id)?))) {
            Some((id, upload)) => _ = all.entry(id).or_insert_with(|| Arc::new(upload)),
            // Nobody can go on with it.
            None => drop(fs::remove_file(&path)),
        }
    }
    all
}

fn left(dir: &Path, id: UploadId) -> Option<Upload> {
    let announced: UploadHeader = serde_json::from_slice(&fs::read(dir.join(format!("{id}.json"))).ok()?).ok()?;
    let facts = fs::metadata(dir.join(id.to_string())).ok()?;
    let (offset, touched) = (facts.len(), facts.modified().ok()?);
    let now = Mutex::new(UploadProgress { offset, touched, is_gone: false });
    (offset <= announced.length).then_some(Upload { announced, now })
}

/// The whole of an upload, paid for as long as anybody has it.
///
/// # Errors
/// [`UploadError`], and refusals of the memory.
pub async fn whole(work: &Arc<Work>, uploads: &Arc<Uploads>, caller: Caller, id: UploadId) -> Result<Bytes, WorkError> {
    let asked = Arc::clone(uploads);
    let UploadStatus { offset, length, .. } = work.blocking(move |_| Ok(asked.look(caller, id)?)).await?;
    if offset != length {
        return Err(UploadError::Unfinished { id, offset, length }.into());
    }
    let share = work.hold(caller.user, length)?;
    let uploads = Arc::clone(uploads);
    let bytes = work.blocking(move |_| Ok(uploads.read(caller, id)?)).await?;
    Ok(share.held(bytes))
}

/// Removes uploads whose time is over, until `stopping`.
pub async fn run(uploads: Arc<Uploads>, stopping: CancellationToken) {
    while stopping.run_until_cancelled(tokio::time::sleep(COLLECT_EVERY)).await.is_some() {
        let uploads = Arc::clone(&uploads);
        // What it panicked with was logged.
        let _ = tokio::task::spawn_blocking(move || uploads.collect()).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::Scope;

    const LARGEST: u64 = 100;

    fn caller(user: u64) -> Caller {
        Caller { user: User(user), scope: Scope::Own }
    }

    fn begun(uploads: &Uploads, user: u64, length: u64) -> UploadId {
        uploads.begin(caller(user), length, String::new()).expect("room").0
    }

    fn files(dir: &Path) -> usize {
        fs::read_dir(dir.join(FOLDER)).expect("a folder").count()
    }

    #[test]
    fn what_arrived_is_there_after_a_restart_and_what_belongs_to_none_is_not() {
        let dir = tempfile::tempdir().expect("a directory");
        let first = Uploads::beside(dir.path(), LARGEST);
        let id = begun(&first, 1, 10);
        assert_eq!(first.append(caller(1), id, 0, b"01234").expect("room").offset, 5);
        for stray in ["x", "01ARZ3NDEKTSV4RRFFQ69G5FAV", "01ARZ3NDEKTSV4RRFFQ69G5FAW.json"] {
            fs::write(dir.path().join(FOLDER).join(stray), "{").expect("written");
        }
        drop(first);
        let second = Uploads::beside(dir.path(), LARGEST);
        assert_eq!((files(dir.path()), second.look(caller(1), id).expect("there").offset), (2, 5));
        let unfinished = second.read(caller(1), id).expect_err("half of it");
        assert!(matches!(unfinished, UploadError::Unfinished { offset: 5, length: 10, .. }), "{unfinished}");
        second.append(caller(1), id, 5, b"56789").expect("the rest");
        assert_eq!(second.read(caller(1), id).expect("whole"), b"0123456789");
    }

    #[test]
    fn a_piece_goes_on_where_the_last_ended_and_not_beyond_what_was_announced() {
        let dir = tempfile::tempdir().expect("a directory");
        let uploads = Uploads::beside(dir.path(), LARGEST);
        let id = begun(&uploads, 1, 4);
        uploads.append(caller(1), id, 0, b"ab").expect("room");
        for at in [0, 1, 3, u64::MAX] {
            let refused = uploads.append(caller(1), id, at, b"c").expect_err("elsewhere");
            assert!(matches!(refused, UploadError::Offset { expected: 2, .. }), "{at}: {refused}");
        }
        assert!(matches!(uploads.append(caller(1), id, 2, b"cde"), Err(UploadError::Beyond { length: 4 })));
        assert_eq!(uploads.append(caller(1), id, 2, b"cd").expect("room").offset, 4);
    }

    #[test]
    fn what_is_anothers_is_not_there() {
        let dir = tempfile::tempdir().expect("a directory");
        let uploads = Uploads::beside(dir.path(), LARGEST);
        let id = begun(&uploads, 1, 4);
        let is_none = |error: UploadError| matches!(error, UploadError::NoSuch(found) if found == id);
        assert!(uploads.look(caller(2), id).is_err_and(is_none));
        assert!(uploads.append(caller(2), id, 0, b"a").is_err_and(is_none));
        assert!(uploads.remove(caller(2), id).is_err_and(is_none));
        uploads.remove(caller(1), id).expect("one's own");
        assert!(uploads.look(caller(1), id).is_err_and(is_none));
        assert_eq!(files(dir.path()), 0);
    }

    #[test]
    fn one_caller_has_no_more_than_half_and_all_together_no_more_than_the_whole() {
        let dir = tempfile::tempdir().expect("a directory");
        let uploads = Uploads::beside(dir.path(), LARGEST);
        let begin = |user, length| uploads.begin(caller(user), length, String::new());
        assert!(matches!(begin(1, LARGEST + 1), Err(UploadError::TooLarge { limit: LARGEST, .. })));
        for _ in 0..4 {
            begun(&uploads, 1, LARGEST);
        }
        assert!(matches!(begin(1, 1), Err(UploadError::OverShare { of: "bytes", .. })));
        for _ in 0..4 {
            begun(&uploads, 2, LARGEST);
        }
        assert!(matches!(begin(3, 1), Err(UploadError::Full { .. })));
        for _ in 0..PER_USER_MAX {
            begun(&uploads, 3, 0);
        }
        assert!(matches!(begin(3, 0), Err(UploadError::OverShare { of: "files", .. })));
    }

    #[test]
    fn what_nothing_happens_to_is_gone_with_its_files() {
        let dir = tempfile::tempdir().expect("a directory");
        let uploads = Uploads::lasting(dir.path(), LARGEST, Duration::ZERO);
        let id = begun(&uploads, 1, 4);
        assert!(matches!(uploads.append(caller(1), id, 0, b"a"), Err(UploadError::NoSuch(_))));
        uploads.collect();
        assert_eq!(files(dir.path()), 0);
    }
}
