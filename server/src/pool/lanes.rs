//! The queues: lanes by urgency, and in each lane a turn a user.

use super::{Lane, User};
use std::collections::{HashMap, VecDeque};

/// A piece of work, ready to run.
pub(super) type Quantum = Box<dyn FnOnce() + Send>;

/// Of so many quanta, one is the least urgent: no lane waits for ever behind busier ones.
const LEAST_URGENT_EVERY: u32 = 8;

/// All that waits for a thread, the most urgent lane first.
#[derive(Default)]
pub(super) struct Lanes {
    lanes: [Turns; 4],
    popped: u32,
}

/// One lane. `order` holds each user that has something waiting once.
#[derive(Default)]
struct Turns {
    order: VecDeque<User>,
    waiting: HashMap<User, VecDeque<Quantum>>,
}

impl Lanes {
    /// Appends to a user's queue in a lane.
    pub(super) fn push(&mut self, lane: Lane, user: User, quantum: Quantum) {
        let [edit, coarse, fine, ingest] = &mut self.lanes;
        let turns = match lane {
            Lane::Edit => edit,
            Lane::Coarse => coarse,
            Lane::Fine => fine,
            Lane::Ingest => ingest,
        };
        let queue = turns.waiting.entry(user).or_default();
        if queue.is_empty() {
            turns.order.push_back(user);
        }
        queue.push_back(quantum);
    }

    /// Takes the most urgent quantum, and now and then the least urgent.
    pub(super) fn pop(&mut self) -> Option<Quantum> {
        self.popped = self.popped.wrapping_add(1);
        if self.popped.is_multiple_of(LEAST_URGENT_EVERY) {
            return self.lanes.iter_mut().rev().find_map(Turns::pop);
        }
        self.lanes.iter_mut().find_map(Turns::pop)
    }

    /// Number of quanta that wait.
    pub(super) fn len(&self) -> usize {
        self.lanes.iter().flat_map(|turns| turns.waiting.values()).map(VecDeque::len).sum()
    }
}

impl Turns {
    fn pop(&mut self) -> Option<Quantum> {
        let user = self.order.pop_front()?;
        let queue = self.waiting.get_mut(&user)?;
        let quantum = queue.pop_front();
        if queue.is_empty() {
            self.waiting.remove(&user);
        } else {
            self.order.push_back(user);
        }
        quantum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[test]
    fn users_take_turns_and_lanes_go_by_urgency() {
        let (send, seen) = mpsc::channel();
        let mut lanes = Lanes::default();
        for (lane, user, name) in [
            (Lane::Ingest, 1, "ingest"),
            (Lane::Fine, 1, "a1"),
            (Lane::Fine, 1, "a2"),
            (Lane::Fine, 1, "a3"),
            (Lane::Fine, 2, "b1"),
            (Lane::Fine, 2, "b2"),
            (Lane::Edit, 3, "edit"),
        ] {
            let send = send.clone();
            lanes.push(lane, User(user), Box::new(move || send.send(name).expect("somebody listens")));
        }
        assert_eq!(lanes.len(), 7);
        while let Some(quantum) = lanes.pop() {
            quantum();
        }
        assert_eq!(seen.try_iter().collect::<Vec<_>>(), ["edit", "a1", "b1", "a2", "b2", "a3", "ingest"]);
        assert_eq!(lanes.len(), 0);
    }

    #[test]
    fn the_least_urgent_lane_has_its_turn_too() {
        let (send, seen) = mpsc::channel();
        let mut lanes = Lanes::default();
        for n in 0..20 {
            let send = send.clone();
            lanes.push(Lane::Coarse, User(1), Box::new(move || send.send(n).expect("somebody listens")));
        }
        lanes.push(Lane::Ingest, User(2), Box::new(move || send.send(100).expect("somebody listens")));
        while let Some(quantum) = lanes.pop() {
            quantum();
        }
        let order: Vec<u32> = seen.try_iter().collect();
        assert_eq!(order.iter().position(|n| *n == 100), Some(7));
        assert_eq!(order.len(), 21);
    }
}
