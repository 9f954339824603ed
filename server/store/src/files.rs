//! Ground state in files: written whole or not at all, and durable once their directory is synced.

use std::borrow::Cow;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use quadmuse_proto::id::ExampleId;

use crate::error::StoreError;
use crate::frame;
use crate::record::{ContentHash, ExampleRecord};

const TEMPORARY: &str = "tmp-";
const GROUND_MAGIC: [u8; 4] = *b"QMG1";
/// More bytes than a record ever has.
const GROUND_BYTES_MAX: u64 = 16 << 20;

/// Writes `name` in `dir`: temporary file, sync, rename. The directory itself is synced by [`sync_dir`].
fn write_whole(dir: &Path, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
    let temporary = dir.join(format!("{TEMPORARY}{}", ExampleId::generate()));
    let path = dir.join(name);
    let write = || {
        let mut file = File::create_new(&temporary)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, &path)
    };
    write().map_err(|source| {
        // What is left of it is collected at the next opening anyway.
        let _ = fs::remove_file(&temporary);
        StoreError::Io { doing: "write", path: path.clone(), source }
    })
}

/// Writes many files in `dir` as [`write_whole`] does, with one sync for all of them.
fn write_all_whole<'a>(dir: &Path, files: impl Iterator<Item = (String, Cow<'a, [u8]>)>) -> Result<(), StoreError> {
    let mut written: Vec<(PathBuf, PathBuf)> = Vec::new();
    let write = || {
        for (name, bytes) in files {
            let temporary = dir.join(format!("{TEMPORARY}{}", ExampleId::generate()));
            written.push((temporary.clone(), dir.join(name)));
            File::create_new(&temporary)?.write_all(&bytes)?;
        }
        rustix::fs::syncfs(File::open(dir)?)?;
        written.iter().try_for_each(|(temporary, path)| fs::rename(temporary, path))
    };
    write().map_err(|source| {
        // What is left of them is collected at the next opening anyway.
        written.iter().for_each(|(temporary, _)| drop(fs::remove_file(temporary)));
        StoreError::Io { doing: "write into", path: dir.to_path_buf(), source }
    })
}

/// Makes renames and removals in `dir` durable.
pub(crate) fn sync_dir(dir: &Path) -> Result<(), StoreError> {
    File::open(dir).and_then(|dir| dir.sync_all()).map_err(StoreError::io("sync", dir))
}

/// Creates a directory and makes its entry durable.
pub(crate) fn create_dir(dir: &Path) -> Result<(), StoreError> {
    if dir.is_dir() {
        return Ok(());
    }
    fs::create_dir_all(dir).map_err(StoreError::io("create", dir))?;
    // The parent of a relative path of one name is written as nothing.
    let parent = dir.parent().map(|parent| if parent.as_os_str().is_empty() { Path::new(".") } else { parent });
    parent.map_or(Ok(()), sync_dir)
}

fn remove(path: &Path) -> Result<(), StoreError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(StoreError::io("remove", path)(error)),
        _ => Ok(()),
    }
}

/// Names of the files in `dir`; others than text are none of ours.
fn names(dir: &Path) -> Result<Vec<String>, StoreError> {
    let entries = fs::read_dir(dir).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
    let entries = entries.map_err(StoreError::io("list", dir))?;
    Ok(entries.into_iter().filter_map(|entry| entry.file_name().into_string().ok()).collect())
}

/// Content-addressed files: meshes as uploaded, and labels.
#[derive(Debug)]
pub(crate) struct Objects {
    dir: PathBuf,
}

impl Objects {
    pub(crate) fn new(dir: PathBuf) -> Self {
        Self { dir }
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    fn path(&self, hash: ContentHash) -> PathBuf {
        self.dir.join(hash.to_string())
    }

    /// Writes an object, unless an intact one is there.
    pub(crate) fn put(&self, hash: ContentHash, bytes: &[u8]) -> Result<(), StoreError> {
        if self.length(hash) == Some(bytes.len() as u64) && matches!(self.get(hash), Ok(Ok(_))) {
            return Ok(());
        }
        write_whole(&self.dir, &hash.to_string(), bytes)
    }

    /// Writes objects with one sync for all, those left out of which an intact one is there.
    pub(crate) fn put_all<'a>(
        &self,
        objects: impl Iterator<Item = (ContentHash, Cow<'a, [u8]>)>,
    ) -> Result<(), StoreError> {
        let intact =
            |hash, length: usize| self.length(hash) == Some(length as u64) && matches!(self.get(hash), Ok(Ok(_)));
        let missing = objects.filter(|(hash, bytes)| !intact(*hash, bytes.len()));
        write_all_whole(&self.dir, missing.map(|(hash, bytes)| (hash.to_string(), bytes)))
    }

    /// Length of an object in bytes, `None` if it isn't there.
    pub(crate) fn length(&self, hash: ContentHash) -> Option<u64> {
        fs::metadata(self.path(hash)).ok().filter(|facts| facts.is_file()).map(|facts| facts.len())
    }

    /// An object, checked against its name; the inner error says how it is damaged.
    pub(crate) fn get(&self, hash: ContentHash) -> Result<Result<Vec<u8>, String>, StoreError> {
        let path = self.path(hash);
        match fs::read(&path) {
            Ok(bytes) if ContentHash::of(&bytes) == hash => Ok(Ok(bytes)),
            Ok(_) => Ok(Err(format!("object {hash} does not match its hash"))),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Err(format!("object {hash} is missing"))),
            Err(error) => Err(StoreError::io("read", &path)(error)),
        }
    }

    pub(crate) fn remove(&self, hash: ContentHash) -> Result<(), StoreError> {
        remove(&self.path(hash))
    }

    /// Removes what `keep` doesn't want and what writing left behind; returns how many files.
    pub(crate) fn collect(&self, keep: impl Fn(ContentHash) -> bool) -> Result<usize, StoreError> {
        let garbage =
            |name: &&String| name.starts_with(TEMPORARY) || ContentHash::from_hex(name).is_some_and(|hash| !keep(hash));
        let names = names(&self.dir)?;
        names.iter().filter(garbage).try_fold(0, |count, name| remove(&self.dir.join(name)).map(|()| count + 1))
    }
}

/// The records outside the index, one file a revision: `ground/<id>.<revision>`.
#[derive(Debug)]
pub(crate) struct Ground {
    dir: PathBuf,
}

impl Ground {
    pub(crate) fn new(dir: PathBuf) -> Self {
        Self { dir }
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    fn name(id: ExampleId, revision: u32) -> String {
        format!("{id}.{revision}")
    }

    pub(crate) fn put(&self, record: &ExampleRecord) -> Result<(), StoreError> {
        let bytes = frame::frame(GROUND_MAGIC, &encode(record)?);
        write_whole(&self.dir, &Self::name(record.id, record.revision), &bytes)
    }

    /// Writes records with one sync for all.
    pub(crate) fn put_all(&self, records: &[&ExampleRecord]) -> Result<(), StoreError> {
        let framed = |record: &&ExampleRecord| {
            let bytes = frame::frame(GROUND_MAGIC, &encode(record)?);
            Ok((Self::name(record.id, record.revision), Cow::Owned(bytes)))
        };
        let files = records.iter().map(framed).collect::<Result<Vec<_>, StoreError>>()?;
        write_all_whole(&self.dir, files.into_iter())
    }

    /// A record, checked; the inner error says how it is damaged.
    pub(crate) fn get(&self, id: ExampleId, revision: u32) -> Result<Result<ExampleRecord, String>, StoreError> {
        let name = Self::name(id, revision);
        let path = self.dir.join(&name);
        let length = fs::metadata(&path).map_err(StoreError::io("read", &path))?.len();
        if length > GROUND_BYTES_MAX {
            return Ok(Err(format!("record {name} has {length} bytes")));
        }
        let bytes = fs::read(&path).map_err(StoreError::io("read", &path))?;
        let record = frame::unframe(GROUND_MAGIC, &bytes).and_then(decode);
        let record = record.map_err(|reason| format!("record {name} has {reason}"));
        Ok(record.and_then(|record| {
            let matches = record.id == id && record.revision == revision;
            if matches { Ok(record) } else { Err(format!("record {name} holds another one")) }
        }))
    }

    pub(crate) fn remove(&self, id: ExampleId, revision: u32) -> Result<(), StoreError> {
        remove(&self.dir.join(Self::name(id, revision)))
    }

    /// Every id and revision there is; removes what writing left behind.
    pub(crate) fn list(&self) -> Result<Vec<(ExampleId, u32)>, StoreError> {
        let mut found = Vec::new();
        for name in names(&self.dir)? {
            if name.starts_with(TEMPORARY) {
                remove(&self.dir.join(&name))?;
            } else if let Some((id, revision)) = name.split_once('.') {
                found.extend(id.parse().ok().zip(revision.parse().ok()));
            }
        }
        found.sort_unstable();
        Ok(found)
    }
}

/// A record as bytes: a MessagePack map, so that a field can be added.
pub(crate) fn encode(record: &ExampleRecord) -> Result<Vec<u8>, StoreError> {
    rmp_serde::to_vec_named(record)
        .map_err(|error| crate::record::invalid("a record", "to serialise".into(), error.to_string()))
}

pub(crate) fn decode(bytes: &[u8]) -> Result<ExampleRecord, String> {
    rmp_serde::from_slice(bytes).map_err(|error| format!("no record ({error})"))
}
