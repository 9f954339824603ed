//! The store on disk is a backend like every other.

#[path = "support/conformance.rs"]
mod conformance;
#[path = "support/sample.rs"]
mod sample;

use quadmuse_store::Store;
use std::sync::Arc;

#[test]
fn a_store_on_disk_conforms() {
    let mut dirs = Vec::new();
    conformance::all(&mut || {
        let dir = tempfile::tempdir().expect("a directory");
        let (store, _) = Store::open(dir.path(), &sample::options()).expect("a store");
        dirs.push(dir);
        (Arc::new(store.clone()), Arc::new(store))
    });
}
