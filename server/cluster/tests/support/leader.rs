//! The node that leads the stream of entries.

use std::time::Duration;

use quadmuse_cluster::JetStream;

/// The number of that node. An election is waited for.
pub(crate) fn leader(asking: &JetStream) -> usize {
    let leader = (0..200).find_map(|_| {
        let leader = asking.entries_leader().ok().flatten();
        if leader.is_none() {
            std::thread::sleep(Duration::from_millis(100));
        }
        leader
    });
    leader.and_then(|name| name.strip_prefix("node")?.parse().ok()).expect("a leader")
}
