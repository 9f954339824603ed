//! The stream of changes: what was changed in a corpus, in order, each at a position.

use std::collections::VecDeque;

use quadmuse_proto::id::ExampleId;

/// Changes that are remembered. Who is further behind reads the corpus anew.
const REMEMBERED_MAX: usize = 1 << 16;

/// One change of a corpus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Changed {
    /// An example is new, or its encodings are.
    Encoded(ExampleId),
    /// An example was annotated; its encodings are the same.
    Annotated(ExampleId),
    /// An example is gone.
    Removed(ExampleId),
}

impl Changed {
    /// The example.
    pub fn id(self) -> ExampleId {
        let (Self::Encoded(id) | Self::Annotated(id) | Self::Removed(id)) = self;
        id
    }
}

/// What changed after a position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changes {
    /// Where to go on from.
    pub position: u64,
    /// The changes, in order; `None` if they are not known any more: read the corpus anew.
    pub changed: Option<Vec<Changed>>,
}

/// The latest changes of a corpus. Positions count them from 1; 0 is before all of them.
#[derive(Default)]
pub struct ChangeLog {
    /// The position of the newest.
    newest: u64,
    remembered: VecDeque<Changed>,
}

impl ChangeLog {
    /// Adds a change; its position.
    pub fn push(&mut self, changed: Changed) -> u64 {
        if self.remembered.len() == REMEMBERED_MAX {
            self.remembered.pop_front();
        }
        self.remembered.push_back(changed);
        self.newest += 1;
        self.newest
    }

    /// The position of the newest change.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Forgets all changes, and counts one that nobody can follow: whoever asks for those after an older position reads
    /// the corpus anew.
    pub fn start_anew(&mut self, at_least: u64) {
        self.remembered.clear();
        self.newest = self.newest.max(at_least) + 1;
    }

    /// What changed after `position`.
    pub fn after(&self, position: u64) -> Changes {
        let oldest = self.newest - self.remembered.len() as u64;
        let known = (oldest..=self.newest).contains(&position);
        let passed = usize::try_from(position.saturating_sub(oldest)).unwrap_or(usize::MAX);
        let changed = known.then(|| self.remembered.iter().skip(passed).copied().collect());
        Changes { position: self.newest, changed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_too_far_behind_is_told_to_read_anew() {
        let mut log = ChangeLog::default();
        assert_eq!(log.after(0), Changes { position: 0, changed: Some(vec![]) });
        let ids: Vec<ExampleId> = (0..3).map(|_| ExampleId::generate()).collect();
        for &id in &ids {
            log.push(Changed::Encoded(id));
        }
        assert_eq!(log.after(1).changed, Some(vec![Changed::Encoded(ids[1]), Changed::Encoded(ids[2])]));
        assert_eq!(log.after(3), Changes { position: 3, changed: Some(vec![]) });
        // A position of another corpus.
        assert_eq!(log.after(9), Changes { position: 3, changed: None });
        for _ in 0..REMEMBERED_MAX {
            log.push(Changed::Removed(ids[0]));
        }
        assert_eq!(log.after(2).changed, None);
        assert_eq!(log.after(3).changed.map(|changed| changed.len()), Some(REMEMBERED_MAX));
        log.start_anew(0);
        assert_eq!(log.after(3).changed, None);
    }
}
