//! The same suite on a real engine of three nodes, and what becomes of acknowledged writes when its nodes are killed.
//!
//! The kills are in one test, so that its nodes are started once. Left out where there is no
//! `nats-server`.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::history::{self, History};
use crate::leader::leader;
use crate::nodes::Nodes;
use crate::suite::{eventually, small};
use quadmuse_cluster::{ClusterOptions, Engine, Entry, JetStream, SharedCorpus, SharedOptions, Written};
use quadmuse_proto::id::ExampleId;
use quadmuse_store::Backend;

fn join(nodes: &Nodes, bucket: &str, dir: &Path) -> Arc<SharedCorpus> {
    Arc::new(try_join(nodes, bucket, dir).expect("reached and joined"))
}

/// The same where an engine that elects leaders may not answer in time.
fn try_join(nodes: &Nodes, bucket: &str, dir: &Path) -> Option<SharedCorpus> {
    let engine = JetStream::connect(&ClusterOptions::new(&nodes.addresses(), bucket)).ok()?;
    let cache = dir.join(ExampleId::generate().to_string());
    SharedCorpus::open(Arc::new(engine), &SharedOptions::caching_in(&cache)).ok()
}

#[test]
fn on_a_real_engine() {
    let Some(mut nodes) = Nodes::start(3) else { return };
    let dir = tempfile::tempdir().expect("a directory");
    let begun = Instant::now();
    let mut corpora = 0;
    crate::suite::all(&mut || {
        corpora += 1;
        let bucket = format!("conformance-{corpora}");
        (join(&nodes, &bucket, dir.path()), join(&nodes, &bucket, dir.path()))
    });
    println!("conformance on three nodes: {:.1} s", begun.elapsed().as_secs_f64());
    a_counter_counts_every_write(&nodes);
    jobs_are_done_once_with_effect(&nodes);
    a_follower_that_does_not_read_for_a_while_misses_nothing(&nodes);
    large_objects_come_back(&nodes, dir.path());
    two_may_collect_at_once(&nodes, dir.path());
    what_is_kept_for_a_while_comes_back_and_is_no_object(&nodes, dir.path());
    kept_uploads_are_bounded(&nodes);
    what_was_kept_once_is_kept_three_times_from_then_on(&mut nodes, dir.path());
    what_was_acknowledged_survives_the_nodes(&mut nodes, dir.path());
}

/// A corpus of which one copy was asked for at first, opened by somebody who names one node of three.
fn what_was_kept_once_is_kept_three_times_from_then_on(nodes: &mut Nodes, dir: &Path) {
    let once = ClusterOptions { replicas: Some(1), ..ClusterOptions::new(&nodes.addresses(), "raised") };
    let first = JetStream::connect(&once).expect("reached");
    let one = SharedCorpus::open(Arc::new(first), &SharedOptions::caching_in(&dir.join("raised"))).expect("joined");
    let kept: Vec<_> = (0..5).map(|seed| one.add(&small(seed).example(), &[]).expect("added").record().id).collect();
    drop(one);
    // The address of one leads to all.
    let asking = JetStream::connect(&ClusterOptions::new(&nodes.address(0), "raised")).expect("reached");
    let is_whole = |nodes: &Nodes| {
        let Some(fresh) = try_join(nodes, "raised", dir) else { return false };
        fresh.snapshot().examples.len() == kept.len() && fresh.check(&mut |_| {}).is_ok_and(|r| r.problems.is_empty())
    };
    eventually("it is there", || is_whole(nodes));
    eventually("every node holds all of it", || {
        let held = [0, 1, 2].map(|at| {
            let mut held = nodes.held(at);
            held.retain(|stream, _| stream.starts_with("raised_"));
            held
        });
        held[0].get("raised_entries").is_some_and(|&entries| entries >= kept.len() as u64)
            && held.iter().all(|of| *of == held[0])
    });
    let leader = leader(&asking);
    nodes.kill(leader);
    eventually("it is there without the node that had it", || is_whole(nodes));
    nodes.revive(leader);
}

/// Four servers count up one entry as fast as they can: what was acknowledged was not overwritten.
fn a_counter_counts_every_write(nodes: &Nodes) {
    let engines =
        [(); 4].map(|()| JetStream::connect(&ClusterOptions::new(&nodes.addresses(), "counter")).expect("reached"));
    let count = |entry: Option<Entry>| {
        let entry = entry.unwrap_or(Entry { position: 0, bytes: b"0".to_vec() });
        (entry.position, String::from_utf8_lossy(&entry.bytes).parse::<u64>().expect("a number"))
    };
    let written: u64 = std::thread::scope(|scope| {
        let writers = engines.each_ref().map(|engine| {
            scope.spawn(move || {
                (0..50).fold(0, |written, _| {
                    let (position, value) = count(engine.read("counter").expect("read"));
                    let next = (value + 1).to_string();
                    let outcome = engine.write("counter", position, next.as_bytes()).expect("answered");
                    written + u64::from(outcome != Written::Elsewhere)
                })
            })
        });
        writers.into_iter().map(|writer| writer.join().expect("ended")).sum()
    });
    assert_eq!(count(engines[0].read("counter").expect("read")).1, written);
    assert_eq!(engines[1].key_names().expect("named"), ["counter"]);
}

#[test]
fn a_full_engine_is_told_as_one_and_reads_go_on() {
    for count in [1, 3] {
        let Some(nodes) = Nodes::start_with(count, "4MB") else { return };
        fills_up(&nodes);
    }
}

fn fills_up(nodes: &Nodes) {
    let dir = tempfile::tempdir().expect("a directory");
    let server = join(nodes, "full", dir.path());
    let large = |seed: u64| {
        let mut sample = small(seed);
        sample.mesh = vec![seed as u8; 600 << 10];
        sample
    };
    let kept = server.add(&large(0).example(), &[]).expect("added").record().id;
    let refused = (1..20).find_map(|seed| server.add(&large(seed).example(), &[]).err()).expect("it fills up");
    assert!(refused.is_full(), "{refused}");
    assert_eq!(join(nodes, "full", dir.path()).mesh_bytes(kept).expect("there"), large(0).mesh);
}

/// More is written than the engine sends at a time, while a follower does not read.
fn a_follower_that_does_not_read_for_a_while_misses_nothing(nodes: &Nodes) {
    const WRITTEN: u64 = 700;
    let [writer, reader] =
        [(); 2].map(|()| JetStream::connect(&ClusterOptions::new(&nodes.addresses(), "slow")).expect("reached"));
    let mut deliveries = reader.follow(0).expect("followed");
    let mut newest = 0;
    for number in 0..WRITTEN {
        let written = writer.write(&format!("key-{number}"), 0, &[number as u8; 2000]).expect("answered");
        let Written::At(position) = written else { panic!("nobody else writes") };
        newest = position;
    }
    let (mut last, mut count, begun) = (0, 0, Instant::now());
    while last < newest {
        assert!(begun.elapsed() < Duration::from_secs(60), "{count} of {WRITTEN} were delivered");
        match deliveries.next(Duration::from_secs(1)) {
            Ok(Some(delivery)) => {
                assert_eq!(delivery.entry.position, last + 1, "in order, none left out, none twice");
                (last, count) = (delivery.entry.position, count + 1);
            }
            Ok(None) => {}
            // The engine gave it up: it goes on after the last that came.
            Err(_) => deliveries = reader.follow(last).expect("followed"),
        }
    }
    assert_eq!(count, WRITTEN);
}

fn jobs_are_done_once_with_effect(nodes: &Nodes) {
    let options = ClusterOptions { lease: Duration::from_secs(2), ..ClusterOptions::new(&nodes.addresses(), "jobs") };
    let [one, other] = [(); 2].map(|()| JetStream::connect(&options).expect("reached"));
    crate::queue::all([&one, &other], options.lease, true);
}

fn large_objects_come_back(nodes: &Nodes, dir: &Path) {
    let mut sample = small(1);
    sample.mesh = (0..5 << 20).map(|at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let first = join(nodes, "large", dir);
    let id = first.add(&sample.example(), &[]).expect("added").record().id;
    let other = join(nodes, "large", dir);
    assert!(other.mesh_bytes(id).expect("there") == sample.mesh);
    other.remove(id).expect("removed");
    assert_eq!(other.collect(Duration::from_secs(3600)).expect("collected"), 0, "they are young");
    assert_eq!(other.collect(Duration::ZERO).expect("collected"), 2);
    let kept = first.add(&small(2).example(), &[]).expect("added").record().id;
    // A collection ends where the engine has no more to deliver at once: chunks of what went before may go with the next.
    eventually("nothing is left to collect", || other.collect(Duration::ZERO).is_ok_and(|gone| gone == 0));
    eventually("it is there", || other.mesh_bytes(kept).is_ok());
    // The bytes are gone from the engine, and come again with the example.
    first.add(&sample.example(), &[]).expect("added");
    eventually("all is whole", || {
        try_join(nodes, "large", dir).is_some_and(|fresh| fresh.check(&mut |_| {}).is_ok_and(|r| r.problems.is_empty()))
    });
}

fn two_may_collect_at_once(nodes: &Nodes, dir: &Path) {
    let servers = [(); 2].map(|()| join(nodes, "collected", dir));
    for seed in 0..12 {
        let id = servers[0].add(&small(seed).example(), &[]).expect("added").record().id;
        servers[0].remove(id).expect("removed");
    }
    std::thread::scope(|scope| {
        let both = servers.each_ref().map(|server| scope.spawn(|| server.collect(Duration::ZERO).expect("collected")));
        let counts = both.map(|one| one.join().expect("no panic"));
        assert!(counts.iter().sum::<u64>() > 0, "{counts:?}");
    });
    assert_eq!(servers[1].collect(Duration::ZERO).expect("collected"), 0);
}

fn what_is_kept_for_a_while_comes_back_and_is_no_object(nodes: &Nodes, dir: &Path) {
    let bytes: Vec<u8> = (0..3 << 20).map(|at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let (one, other) = (join(nodes, "uploads", dir), join(nodes, "uploads", dir));
    one.keep_upload("a", &bytes).expect("kept");
    one.keep_upload("b", b"short").expect("kept");
    assert!(other.upload("a").expect("answered") == Some(bytes));
    assert_eq!(other.collect(Duration::ZERO).expect("collected"), 0);
    other.remove_upload("a").expect("removed");
    assert_eq!(one.upload("a").expect("answered"), None);
    assert_eq!(one.upload("b").expect("answered").as_deref(), Some(&b"short"[..]));
    assert_eq!(one.upload("c").expect("answered"), None);
}

/// What comes pushes out the oldest, and never all.
fn kept_uploads_are_bounded(nodes: &Nodes) {
    let options = ClusterOptions { uploads_bytes: 4 << 20, ..ClusterOptions::new(&nodes.addresses(), "bounded") };
    let engine = JetStream::connect(&options).expect("reached");
    let bytes = vec![7; 700 << 10];
    for number in 0..12 {
        engine.keep_upload(&format!("q{number}"), &bytes).expect("kept");
    }
    let is_kept = |number: i32| engine.upload(&format!("q{number}")).expect("answered").is_some();
    let kept: Vec<i32> = (0..12).filter(|&number| is_kept(number)).collect();
    assert!(kept.ends_with(&[10, 11]) && (2..=5).contains(&kept.len()), "{kept:?}");
    assert!(engine.keep_upload("large", &vec![7; 2 << 20]).is_err());
}

fn what_was_acknowledged_survives_the_nodes(nodes: &mut Nodes, dir: &Path) {
    // How often nodes are killed or stopped; more by hand for a record.
    let kills: usize = std::env::var("QUADMUSE_KILLS").ok().and_then(|kills| kills.parse().ok()).unwrap_or(5);
    let servers = [join(nodes, "killed", dir), join(nodes, "killed", dir)];
    let asking = JetStream::connect(&ClusterOptions::new(&nodes.addresses(), "killed")).expect("reached");
    let (history, stopping) = (Mutex::new(History::default()), AtomicBool::new(false));
    std::thread::scope(|scope| {
        history::start_writers(scope, &servers, &history, &stopping);
        for kill in 0..kills {
            std::thread::sleep(Duration::from_millis(1000));
            let leader = leader(&asking);
            // A follower is killed, the leader is killed, and the leader is stopped and comes back as if it still led.
            match kill % 3 {
                0 | 1 => {
                    let victim = if kill % 3 == 0 { (leader + 1) % 3 } else { leader };
                    nodes.kill(victim);
                    std::thread::sleep(Duration::from_millis(1500));
                    nodes.revive(victim);
                }
                _ => {
                    nodes.signal(leader, "-STOP");
                    std::thread::sleep(Duration::from_millis(6000));
                    nodes.signal(leader, "-CONT");
                }
            }
            std::thread::sleep(Duration::from_millis(1500));
        }
        stopping.store(true, Ordering::Relaxed);
    });
    history::judge(history, &servers, &join(nodes, "killed", dir), &asking, &format!("{kills} kills"));
}
