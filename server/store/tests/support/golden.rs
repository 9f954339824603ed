//! Golden stores, unpacked: see `tests/golden/README.md`.
#![allow(dead_code, reason = "each test uses a part of it")]

use std::fs;
use std::path::{Path, PathBuf};

/// Unpacked, a golden store is at most this large.
const UNPACKED_MAX: usize = 64 << 20;

/// Where the golden store of a schema is.
pub(crate) fn path(schema: u32) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../tests/golden/schema_{schema}/store.bin.zst"))
}

/// The schemas of which there are golden stores.
pub(crate) fn schemas() -> Vec<u32> {
    (1..).take_while(|&schema| path(schema).exists()).collect()
}

/// Writes the files of a golden store into a directory.
pub(crate) fn unpack(schema: u32, dir: &Path) {
    unpack_bytes(&fs::read(path(schema)).unwrap(), dir);
}

/// Writes packed files into a directory.
pub(crate) fn unpack_bytes(packed: &[u8], dir: &Path) {
    let bytes = zstd::bulk::decompress(packed, UNPACKED_MAX).unwrap();
    let mut rest = &bytes[..];
    let mut take = |count: usize| {
        let (taken, next) = rest.split_at(count);
        rest = next;
        (taken, next.is_empty())
    };
    loop {
        let name_length = u16::from_le_bytes(take(2).0.try_into().unwrap());
        let name = std::str::from_utf8(take(name_length.into()).0).unwrap();
        let length = u64::from_le_bytes(take(8).0.try_into().unwrap());
        let path = dir.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let (content, last) = take(length as usize);
        fs::write(path, content).unwrap();
        if last {
            return;
        }
    }
}
