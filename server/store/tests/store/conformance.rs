//! The store on disk is a backend like every other.

use quadmuse_store::Store;
use std::sync::Arc;

#[test]
fn a_store_on_disk_conforms() {
    let mut dirs = Vec::new();
    crate::suite::all(&mut || {
        let dir = tempfile::tempdir().expect("a directory");
        let (store, _) = Store::open(dir.path(), &crate::sample::options()).expect("a store");
        dirs.push(dir);
        (Arc::new(store.clone()), Arc::new(store))
    });
}
