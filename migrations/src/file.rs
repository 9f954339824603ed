//! The schema file: the same line three times, each with its checksum, so that a damaged byte leaves two intact.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::Path;

use crate::MigrationError;

/// Name of the schema file, in the store's directory.
pub const SCHEMA_FILE: &str = "schema";
/// Directories that only a store of some schema has.
const CONTENT: [&str; 3] = ["index", "ground", "objects"];
const COPIES: usize = 3;
/// More bytes than a schema file ever has.
const BYTES_MAX: u64 = 4096;

/// The schema of a directory: 0 if it holds no store yet.
///
/// # Errors
/// [`MigrationError::Damaged`], [`MigrationError::Missing`] or [`MigrationError::Io`] if it can't be told.
pub fn read_schema(dir: &Path) -> Result<u32, MigrationError> {
    let path = dir.join(SCHEMA_FILE);
    let bytes = match fs::metadata(&path) {
        Ok(facts) if facts.len() > BYTES_MAX => return Err(MigrationError::Damaged { path }),
        Ok(_) => fs::read(&path).map_err(|source| MigrationError::Io { doing: "read", path: path.clone(), source })?,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let content = CONTENT.iter().any(|name| dir.join(name).exists());
            return if content { Err(MigrationError::Missing { path }) } else { Ok(0) };
        }
        Err(source) => return Err(MigrationError::Io { doing: "read", path, source }),
    };
    let versions = bytes.split(|&byte| byte == b'\n').filter_map(parse);
    versions.max().ok_or(MigrationError::Damaged { path })
}

/// Writes the schema file: whole or not at all, and durable when this returns.
pub(crate) fn write_schema(dir: &Path, schema: u32) -> Result<(), MigrationError> {
    let path = dir.join(SCHEMA_FILE);
    let temporary = dir.join("schema.tmp");
    let write = || {
        let mut file = File::create(&temporary)?;
        file.write_all(text(schema).as_bytes())?;
        file.sync_all()?;
        fs::rename(&temporary, &path)?;
        File::open(dir)?.sync_all()
    };
    write().map_err(|source| MigrationError::Io { doing: "write", path: path.clone(), source })
}

/// Writes the file anew if not all of it is as it should be.
pub(crate) fn repair(dir: &Path, schema: u32) -> Result<(), MigrationError> {
    let path = dir.join(SCHEMA_FILE);
    let bytes = fs::read(&path).map_err(|source| MigrationError::Io { doing: "read", path, source })?;
    if bytes == text(schema).as_bytes() { Ok(()) } else { write_schema(dir, schema) }
}

fn text(schema: u32) -> String {
    let head = format!("quadmuse-store schema {schema}");
    format!("{head} {:016x}\n", sum(&head)).repeat(COPIES)
}

fn parse(line: &[u8]) -> Option<u32> {
    let (head, sum_text) = std::str::from_utf8(line).ok()?.rsplit_once(' ')?;
    if format!("{:016x}", sum(head)) != sum_text {
        return None;
    }
    head.strip_prefix("quadmuse-store schema ")?.parse().ok()
}

/// FNV-1a, 64 bits: enough against damage, and needs no dependency that an old step would have to keep.
fn sum(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_damaged_byte_anywhere_leaves_the_schema_known_and_is_repaired() {
        let dir = tempfile::tempdir().unwrap();
        write_schema(dir.path(), 1).unwrap();
        let whole = fs::read(dir.path().join(SCHEMA_FILE)).unwrap();
        for at in 0..whole.len() {
            for flip in [0x01, 0x20, 0x80] {
                let mut bad = whole.clone();
                bad[at] ^= flip;
                fs::write(dir.path().join(SCHEMA_FILE), &bad).unwrap();
                assert_eq!(read_schema(dir.path()).unwrap(), 1, "byte {at}");
                repair(dir.path(), 1).unwrap();
                assert_eq!(fs::read(dir.path().join(SCHEMA_FILE)).unwrap(), whole);
            }
        }
    }

    #[test]
    fn content_without_a_schema_is_no_new_store() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read_schema(dir.path()).unwrap(), 0);
        fs::create_dir(dir.path().join("objects")).unwrap();
        assert!(matches!(read_schema(dir.path()), Err(MigrationError::Missing { .. })));
        fs::write(dir.path().join(SCHEMA_FILE), "nothing").unwrap();
        assert!(matches!(read_schema(dir.path()), Err(MigrationError::Damaged { .. })));
    }
}
