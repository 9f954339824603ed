//! The document in which the servers stand.

use quadmuse_proto::Share;
use quadmuse_proto::id::ServerNumber;
use quadmuse_store::StoreError;
use serde::{Deserialize, Serialize};

/// Most lines of the list. Of the servers that are forgotten nobody can tell that they are gone: their ids are unknown then.
const SERVERS_MAX: usize = 128;

/// A server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) number: ServerNumber,
    /// `http://host:port`.
    pub(super) address: String,
    /// Seconds since 1970 at which it said last that it is alive.
    pub(super) seen_s: u64,
    /// Whether it has ended, or another took its place.
    #[serde(default)]
    pub(super) has_left: bool,
    /// The share of the corpus that it holds in memory; all of it, if none is told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) share: Option<Share>,
}

/// The document.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct List {
    /// What the servers seal with, in hex; made by the first.
    #[serde(default)]
    pub(super) secret: Option<String>,
    /// The number that was given last.
    #[serde(default)]
    last: u16,
    /// In the order in which they came.
    #[serde(default)]
    pub(super) servers: Vec<Record>,
}

impl List {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, StoreError> {
        serde_json::from_slice(bytes).map_err(|error| StoreError::Invalid {
            field: "the document `servers` of the cluster",
            expected: "to be a list of servers".into(),
            found: error.to_string(),
        })
    }

    pub(super) fn to_bytes(&self) -> Result<Vec<u8>, StoreError> {
        serde_json::to_vec(self).map_err(|error| StoreError::Invalid {
            field: "a list of servers",
            expected: "to serialise".into(),
            found: error.to_string(),
        })
    }

    pub(super) fn record(&self, number: ServerNumber) -> Option<&Record> {
        self.servers.iter().find(|record| record.number == number)
    }

    /// Who came last at an address.
    pub(super) fn newest_at(&self, address: &str) -> Option<&Record> {
        self.servers.iter().rev().find(|record| record.address == address)
    }

    /// Adds a server in the place of whoever stood at its address; its number.
    pub(super) fn enter(&mut self, address: &str, share: Option<Share>, now_s: u64) -> ServerNumber {
        for record in self.servers.iter_mut().filter(|record| record.address == address) {
            record.has_left = true;
        }
        let number = self.free_number();
        self.servers.push(Record { number, address: address.to_owned(), seen_s: now_s, has_left: false, share });
        while self.servers.len() > SERVERS_MAX {
            // Those first that are known to have ended, then who was silent for the longest; the new one stays.
            let others = self.servers.iter().enumerate().filter(|(_, record)| record.number != number);
            let oldest = others.min_by_key(|(at, record)| (!record.has_left, record.seen_s, *at)).map(|(at, _)| at);
            let Some(oldest) = oldest else { break };
            self.servers.remove(oldest);
        }
        number
    }

    /// The next number that none of the list has. Numbers come again after some 65,000 starts.
    fn free_number(&mut self) -> ServerNumber {
        loop {
            self.last = self.last.wrapping_add(1);
            if let Some(number) = ServerNumber::new(self.last).filter(|number| self.record(*number).is_none()) {
                return number;
            }
        }
    }

    /// Notes that a server is alive; whether another took its place meanwhile. One that was forgotten is there again.
    pub(super) fn renew(&mut self, number: ServerNumber, address: &str, share: Option<Share>, now_s: u64) -> bool {
        match self.servers.iter_mut().find(|record| record.number == number) {
            Some(record) => {
                // Another number in any case: a clock that was set back is no silence.
                record.seen_s = now_s.max(record.seen_s + 1);
                // A server of an older release leaves it out when it writes the list.
                record.share = share;
                record.has_left
            }
            None => {
                self.servers.push(Record {
                    number,
                    address: address.to_owned(),
                    seen_s: now_s,
                    has_left: false,
                    share,
                });
                false
            }
        }
    }

    /// Notes that a server has ended.
    pub(super) fn leave(&mut self, number: ServerNumber) {
        for record in self.servers.iter_mut().filter(|record| record.number == number) {
            record.has_left = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_is_bounded_and_forgets_first_who_has_ended() {
        let mut list = List::default();
        let alive = list.enter("http://alive", None, 1);
        for start in 0..300u64 {
            list.enter("http://other", None, start);
        }
        assert_eq!(list.servers.len(), SERVERS_MAX);
        assert!(list.record(alive).is_some_and(|record| !record.has_left));
        assert_eq!(list.servers.iter().filter(|record| !record.has_left).count(), 2);
    }

    #[test]
    fn numbers_go_around_without_0_and_without_those_in_use() {
        let mut list = List { last: u16::MAX - 1, ..List::default() };
        assert_eq!(list.enter("http://a", None, 0).get(), u16::MAX);
        assert_eq!(list.enter("http://b", None, 0).get(), 1);
        list.last = u16::MAX - 1;
        assert_eq!(list.enter("http://c", None, 0).get(), 2);
    }

    #[test]
    fn one_that_was_forgotten_comes_back_with_its_next_sign_of_life() {
        let mut list = List::default();
        let number = list.enter("http://a", None, 0);
        list.servers.clear();
        assert!(!list.renew(number, "http://a", None, 5));
        assert_eq!(list.record(number).map(|record| record.seen_s), Some(5));
        list.enter("http://a", None, 6);
        assert!(list.renew(number, "http://a", None, 7));
    }
}
