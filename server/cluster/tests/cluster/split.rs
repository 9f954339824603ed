//! A network that is split between the nodes of a real engine, each in a network namespace of its own. Left out where there
//! is no `nats-server`, or where no namespaces may be made.
//!
//! A node that is stopped (`tests/jetstream.rs`) says nothing to anybody. A node that is cut off goes on, and takes itself
//! for the leader for a while: here once for those who write to it, and once with nobody but them.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::history::{self, History};
use crate::leader::leader;
use crate::nodes::{Link, Nodes};
use quadmuse_cluster::{ClusterOptions, JetStream, SharedCorpus, SharedOptions};

/// Says to a process of this program that it has a network, and a `/run`, of its own.
const INSIDE: &str = "QUADMUSE_SPLIT_INSIDE";
const NAME: &str = "split::a_node_that_is_cut_off_acknowledges_nothing_that_is_lost";
/// A node is cut off for so long: longer than an election takes.
const CUT_OFF: Duration = Duration::from_secs(10);
const TOGETHER: Duration = Duration::from_secs(2);

#[test]
fn a_node_that_is_cut_off_acknowledges_nothing_that_is_lost() {
    if std::env::var_os(INSIDE).is_some() {
        return split();
    }
    let apart = ["--user", "--map-root-user", "--net", "--mount"];
    let may = Command::new("unshare").args(apart).args(["sh", "-c", "ip link add c type bridge"]).output();
    if !may.is_ok_and(|tried| tried.status.success()) {
        println!("left out: no network namespaces may be made here");
        return;
    }
    let own = std::env::current_exe().expect("a program");
    let inside = Command::new("unshare")
        .args(apart)
        .args(["sh", "-c", "mount -t tmpfs none /run && ip link set lo up && exec \"$0\" \"$@\""])
        .arg(own)
        .args(["--exact", NAME, "--nocapture"])
        .env(INSIDE, "1")
        .output()
        .expect("it runs");
    println!("{}", String::from_utf8_lossy(&inside.stdout));
    assert!(inside.status.success(), "{}", String::from_utf8_lossy(&inside.stderr));
}

/// Three copies, whichever nodes are named.
fn reach(addresses: &str) -> JetStream {
    let options = ClusterOptions { replicas: Some(3), ..ClusterOptions::new(addresses, "split") };
    JetStream::connect(&options).expect("reached")
}

fn join(addresses: &str, dir: &Path, name: &str) -> Arc<SharedCorpus> {
    let engine = reach(addresses);
    Arc::new(SharedCorpus::open(Arc::new(engine), &SharedOptions::caching_in(&dir.join(name))).expect("joined"))
}

fn split() {
    let Some(nodes) = Nodes::start_apart(3) else { return };
    let dir = tempfile::tempdir().expect("a directory");
    let asking = reach(&nodes.addresses());
    // One of them knows but the node that leads at first: it goes on to reach it when nobody else does.
    let only = nodes.address(leader(&asking));
    let servers = [join(&only, dir.path(), "a"), join(&nodes.addresses(), dir.path(), "b")];
    let (history, stopping) = (Mutex::new(History::default()), AtomicBool::new(false));
    std::thread::scope(|scope| {
        history::start_writers(scope, &servers, &history, &stopping);
        // From the other nodes alone, so that clients still reach it; then from everybody.
        for links in [&[Link::Nodes][..], &[Link::Nodes, Link::Clients]] {
            std::thread::sleep(TOGETHER);
            let leader = leader(&asking);
            links.iter().for_each(|link| nodes.cut(leader, *link));
            std::thread::sleep(CUT_OFF);
            links.iter().for_each(|link| nodes.mend(leader, *link));
        }
        std::thread::sleep(TOGETHER);
        stopping.store(true, Ordering::Relaxed);
    });
    history::judge(history, &servers, &join(&nodes.addresses(), dir.path(), "fresh"), &asking, "two splits");
}
