//! What fuzzing found once, and a few seeds more: a short run of every target.

use quadmuse_fuzz::{TARGETS, target};

/// Targets and seeds that once broke a promise, with what it was.
const FINDS: [(&str, u64, &str); 1] = [(
    "composition",
    4,
    "a vertex thrown far off: frames of a rectangle of a hundred thousand quads were laid for minutes",
)];

#[test]
fn what_was_found_once_is_not_found_again() {
    for (name, seed, what) in FINDS {
        let target = target(name).expect("a target");
        println!("{name} of seed {seed}: {what}");
        (target.run)(seed);
    }
}

#[test]
fn every_target_keeps_its_promise_on_a_few_seeds_and_refuses_some_of_them() {
    for target in TARGETS {
        let taken = (0..target.short).filter(|seed| (target.run)(*seed)).count() as u64;
        println!("{}: {taken} of {} taken", target.name, target.short);
        assert!(taken > 0 && taken < target.short, "{}: {taken} of {} taken", target.name, target.short);
    }
}
