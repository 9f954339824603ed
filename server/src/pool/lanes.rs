//! The queues: lanes by urgency, in each the user who had least, and of a user the oldest job first.
//!
//! *Source:* start-time fair queueing (Goyal, Vin, Cheng 1996): a user's virtual time is the computing time it had; who
//! has work waiting and the least of it is next, and who comes anew starts where the others are, so that being idle saves
//! nothing up. *Ours:* the two lanes of queries are one for that choice, and within a user the oldest job goes on first,
//! whichever of the two it is in: under more load than can be served, what was begun is finished before more is begun. So
//! that a newer query's first level does not wait for all older ones, one of [`FIRST_LEVEL_EVERY`] quanta of a user is the
//! oldest of its coarse ones.

use super::{Lane, User};
use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

/// A piece of work, ready to run.
pub(super) type Quantum = Box<dyn FnOnce() + Send>;

/// Of so many quanta, one is the least urgent: no lane waits for ever behind busier ones.
const LEAST_URGENT_EVERY: u32 = 8;

/// Of so many quanta of a user's queries, one is of the coarse lane, if any is.
const FIRST_LEVEL_EVERY: u32 = 4;

/// What a quantum under way is taken to cost until it has ended.
const QUANTUM_EXPECTED: Duration = Duration::from_millis(20);

/// Users without work whose time is remembered.
const IDLE_USERS_MAX: usize = 1024;

/// All that waits for a thread.
#[derive(Default)]
pub(super) struct Lanes {
    users: HashMap<User, Turns>,
    /// Virtual time of who was served last.
    now: Duration,
    popped: u32,
    pushed: u64,
}

/// What waits of one user, by lane, the oldest job first; and what the user had.
#[derive(Default)]
struct Turns {
    lanes: [BTreeMap<(u64, u64), Quantum>; 5],
    /// Virtual time.
    had: Duration,
    /// Quanta under way.
    running: u32,
    /// Quanta of queries served.
    served: u32,
    /// When it was served last, as a count: who waits longer is first among equals.
    last: u64,
}

const EDIT: usize = 0;
const LAY: usize = 1;
const COARSE: usize = 2;
const FINE: usize = 3;
const INGEST: usize = 4;

fn place(lane: Lane) -> usize {
    match lane {
        Lane::Edit => EDIT,
        Lane::Lay => LAY,
        Lane::Coarse => COARSE,
        Lane::Fine => FINE,
        Lane::Ingest => INGEST,
    }
}

impl Turns {
    fn has(&self, lanes: &[usize]) -> bool {
        lanes.iter().any(|&lane| !self.lanes[lane].is_empty())
    }

    fn is_idle(&self) -> bool {
        self.running == 0 && !self.has(&[EDIT, LAY, COARSE, FINE, INGEST])
    }

    fn first_of(&mut self, lanes: &[usize]) -> Option<Quantum> {
        let oldest = |&&lane: &&usize| self.lanes[lane].keys().next().copied();
        let &lane = lanes.iter().filter(|lane| oldest(lane).is_some()).min_by_key(oldest)?;
        self.lanes[lane].pop_first().map(|(_, quantum)| quantum)
    }
}

impl Lanes {
    /// Appends to a user's queue in a lane; `job` is the older the less it is.
    pub(super) fn push(&mut self, lane: Lane, user: User, job: u64, quantum: Quantum) {
        self.pushed += 1;
        self.forget_idle();
        let (now, pushed) = (self.now, self.pushed);
        let turns = self.users.entry(user).or_default();
        if turns.is_idle() {
            turns.had = turns.had.max(now);
        }
        turns.lanes[place(lane)].insert((job, pushed), quantum);
    }

    /// Takes the most urgent quantum, and now and then the least urgent; whose it is must be told to [`Lanes::ended`].
    pub(super) fn pop(&mut self) -> Option<(User, Quantum)> {
        self.popped = self.popped.wrapping_add(1);
        const BY_URGENCY: [&[usize]; 4] = [&[EDIT], &[LAY], &[COARSE, FINE], &[INGEST]];
        if self.popped.is_multiple_of(LEAST_URGENT_EVERY) {
            return BY_URGENCY.iter().rev().find_map(|lanes| self.pop_of(lanes));
        }
        BY_URGENCY.iter().find_map(|lanes| self.pop_of(lanes))
    }

    /// Takes an edit, if one waits; whose it is must be told to [`Lanes::ended`].
    pub(super) fn pop_edit(&mut self) -> Option<(User, Quantum)> {
        self.popped = self.popped.wrapping_add(1);
        self.pop_of(&[EDIT])
    }

    fn pop_of(&mut self, lanes: &[usize]) -> Option<(User, Quantum)> {
        let waiting = self.users.iter_mut().filter(|(_, turns)| turns.has(lanes));
        let turn = |turns: &Turns| (turns.had + QUANTUM_EXPECTED * turns.running, turns.last);
        let (&user, turns) = waiting.min_by_key(|(user, turns)| (turn(turns), user.0))?;
        let is_of_query = lanes.contains(&COARSE);
        turns.served = turns.served.wrapping_add(u32::from(is_of_query));
        let first_level = is_of_query && turns.served.is_multiple_of(FIRST_LEVEL_EVERY) && turns.has(&[COARSE]);
        let quantum = turns.first_of(if first_level { &[COARSE] } else { lanes })?;
        (turns.running, turns.last) = (turns.running + 1, u64::from(self.popped));
        self.now = self.now.max(turns.had);
        Some((user, quantum))
    }

    /// Says that a quantum of `user` has ended, and what it took.
    pub(super) fn ended(&mut self, user: User, took: Duration) {
        if let Some(turns) = self.users.get_mut(&user) {
            turns.running = turns.running.saturating_sub(1);
            turns.had += took;
        }
    }

    /// Number of quanta that wait.
    pub(super) fn len(&self) -> usize {
        self.users.values().flat_map(|turns| &turns.lanes).map(BTreeMap::len).sum()
    }

    /// Number of quanta that wait in each lane.
    pub(super) fn lengths(&self) -> [usize; 5] {
        let mut lengths = [0; 5];
        for turns in self.users.values() {
            lengths.iter_mut().zip(&turns.lanes).for_each(|(length, lane)| *length += lane.len());
        }
        lengths
    }

    /// Users without work are the same as new ones once the others' time has passed theirs.
    fn forget_idle(&mut self) {
        if self.users.len() > IDLE_USERS_MAX {
            self.users.retain(|_, turns| !turns.is_idle());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    const MS: Duration = Duration::from_millis(1);

    /// Lanes whose quanta note their names.
    #[derive(Default)]
    struct Noting {
        lanes: Lanes,
        order: Arc<Mutex<Vec<String>>>,
    }

    impl Noting {
        fn push(&mut self, lane: Lane, user: u64, job: u64, name: &str) {
            let (order, name) = (Arc::clone(&self.order), name.to_owned());
            let note = move || order.lock().expect("not poisoned").push(name);
            self.lanes.push(lane, User(user), job, Box::new(note));
        }

        fn run(&mut self, took: impl Fn(u64) -> Duration) -> Vec<String> {
            while let Some((user, quantum)) = self.lanes.pop() {
                quantum();
                self.lanes.ended(user, took(user.0));
            }
            std::mem::take(&mut self.order.lock().expect("not poisoned"))
        }
    }

    #[test]
    fn users_take_turns_and_lanes_go_by_urgency() {
        let mut all = Noting::default();
        for (lane, user, name) in [
            (Lane::Ingest, 1, "ingest"),
            (Lane::Fine, 1, "a1"),
            (Lane::Fine, 1, "a2"),
            (Lane::Fine, 1, "a3"),
            (Lane::Fine, 2, "b1"),
            (Lane::Fine, 2, "b2"),
            (Lane::Lay, 3, "lay"),
            (Lane::Edit, 3, "edit"),
        ] {
            all.push(lane, user, user, name);
        }
        assert_eq!(all.lanes.len(), 8);
        assert_eq!(all.run(|_| MS), ["edit", "lay", "a1", "b1", "a2", "b2", "a3", "ingest"]);
        assert_eq!(all.lanes.len(), 0);
        assert!(all.lanes.pop_edit().is_none());
        all.push(Lane::Lay, 3, 9, "lay");
        assert!(all.lanes.pop_edit().is_none(), "the thread of edits lays nothing");
        all.push(Lane::Edit, 3, 9, "edit");
        assert!(all.lanes.pop_edit().is_some_and(|(user, _)| user == User(3)));
    }

    #[test]
    fn who_had_least_is_next_and_being_idle_saves_nothing_up() {
        let mut all = Noting::default();
        // The first user's quanta take ten times as long: for each of them the other has ten.
        (0..3).for_each(|n| all.push(Lane::Fine, 1, 1, &format!("slow{n}")));
        (0..30).for_each(|n| all.push(Lane::Fine, 2, 2, &format!("q{n}")));
        let order = all.run(|user| if user == 1 { MS * 10 } else { MS });
        let between = |a: &str, b: &str| {
            let at = |name: &str| order.iter().position(|n| n == name).expect("it ran");
            at(b) - at(a)
        };
        assert!((9..=13).contains(&between("slow0", "slow1")), "{order:?}");
        // One who comes now does not have the time before.
        (0..4).for_each(|n| all.push(Lane::Fine, 1, 3, &format!("a{n}")));
        (0..4).for_each(|n| all.push(Lane::Fine, 9, 4, &format!("new{n}")));
        let order = all.run(|_| MS);
        assert!(order.iter().take(4).filter(|name| name.starts_with('a')).count() >= 1, "{order:?}");
    }

    #[test]
    fn what_was_begun_is_finished_before_more_is_begun() {
        let mut all = Noting::default();
        for job in 2..50 {
            all.push(Lane::Coarse, 1, job, "newer");
        }
        (0..6).for_each(|_| all.push(Lane::Fine, 1, 1, "oldest"));
        let order = all.run(|_| MS);
        let last = order.iter().rposition(|name| name == "oldest").expect("it ran");
        assert!(last < 10, "{order:?}");
        assert!(order[..last].iter().any(|name| name == "newer"), "a first level doesn't wait for all: {order:?}");
    }

    #[test]
    fn the_least_urgent_lane_has_its_turn_too() {
        let mut all = Noting::default();
        (0..20).for_each(|n| all.push(Lane::Coarse, 1, n, "coarse"));
        all.push(Lane::Ingest, 2, 100, "ingest");
        let order = all.run(|_| MS);
        assert_eq!(order.iter().position(|name| name == "ingest"), Some(7));
        assert_eq!(order.len(), 21);
    }
}
