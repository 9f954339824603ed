//! Schema 1, the first: the trees of the index, empty.
//!
//! | tree | key | value |
//! |---|---|---|
//! | `manifest` | id 16 | revision u32 LE ‖ length u32 LE ‖ BLAKE3 16 of the record |
//! | `body` | id 16 ‖ revision u32 BE ‖ chunk u16 BE | ≤ 3,800 bytes of the record (MessagePack map) |
//! | `derived` | id 16 ‖ segment u32 BE | pointer (MessagePack map): encoder version, generation, parts |
//! | `parts` | id 16 ‖ segment u32 BE ‖ generation 16 ‖ part u8 ‖ chunk u16 BE | ≤ 3,800 bytes of a part |
//! | `pending` | id 16 ‖ segment u32 BE ‖ generation 16 | nothing: these parts are garbage unless a pointer names them |
//!
//! Every value but those of `meta` ends in eight bytes of BLAKE3 over tree, key and payload.

use std::path::Path;

const TREES: [&str; 5] = ["manifest", "body", "derived", "parts", "pending"];

pub(crate) fn run(_dir: &Path, db: &sled::Db, report: &mut dyn FnMut(u64)) -> Result<(), sled::Error> {
    for (done, tree) in (1..).zip(TREES) {
        db.open_tree(tree)?;
        report(done);
    }
    Ok(())
}
