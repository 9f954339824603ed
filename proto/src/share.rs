//! Shares of a corpus that is larger than one server's memory.

use crate::id::ExampleId;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// Most shares that a corpus is divided into.
pub const SHARES_MAX: u32 = 64;

/// One share of several, such as `2/3`: the second of three. Each example, with all its segments, belongs to one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Share {
    number: u32,
    of: u32,
}

/// A text that is no share.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a share k/n with k from 1 to n, and n at most {SHARES_MAX}, found `{found}`")]
pub struct ShareError {
    found: String,
}

impl Share {
    /// Share `number` of `of`, counted from 1; `None` if there is no such share.
    pub const fn new(number: u32, of: u32) -> Option<Self> {
        if number >= 1 && number <= of && of <= SHARES_MAX { Some(Self { number, of }) } else { None }
    }

    /// Its number, from 1 on.
    pub const fn number(self) -> u32 {
        self.number
    }

    /// How many shares there are.
    pub const fn of(self) -> u32 {
        self.of
    }

    /// The share that an example belongs to, where there are as many as here.
    #[must_use]
    pub const fn of_example(self, id: ExampleId) -> Self {
        // Ids of one millisecond count up in their last bits, and begin alike: all bits are mixed before they are divided.
        let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p] = id.to_bytes();
        let time = u64::from_be_bytes([a, b, c, d, e, f, g, h]);
        let random = u64::from_be_bytes([i, j, k, l, m, n, o, p]);
        let mixed = mix(mix(time) ^ random);
        // Below `of`, which is small.
        Self { number: (mixed % self.of as u64) as u32 + 1, of: self.of }
    }

    /// Whether an example belongs to it.
    pub fn holds(self, id: ExampleId) -> bool {
        self.of_example(id) == self
    }
}

/// The finaliser of splitmix64: each bit of the result depends on each bit of `x`.
const fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Share {
    type Err = ShareError;

    fn from_str(text: &str) -> Result<Self, ShareError> {
        let refused = || ShareError { found: text.chars().take(32).collect() };
        let (number, of) = text.split_once('/').ok_or_else(refused)?;
        let (number, of) = (number.parse().map_err(|_| refused())?, of.parse().map_err(|_| refused())?);
        Self::new(number, of).ok_or_else(refused)
    }
}

impl Serialize for Share {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Share {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_written_k_of_n_and_there_are_no_others() {
        let share: Share = "2/3".parse().expect("a share");
        assert_eq!((share.number(), share.of(), share.to_string()), (2, 3, "2/3".to_owned()));
        assert_eq!(serde_json::from_str::<Share>("\"2/3\"").expect("a share"), share);
        for bad in ["", "2", "0/3", "4/3", "1/65", "-1/3", "1/0", "a/b", "1/3/3"] {
            assert!(bad.parse::<Share>().is_err(), "{bad}");
        }
    }

    #[test]
    fn each_example_belongs_to_one_share_and_the_shares_are_alike() {
        let shares: Vec<Share> = (1..=3).filter_map(|number| Share::new(number, 3)).collect();
        let ids: Vec<ExampleId> = (0..3000).map(|_| ExampleId::generate()).collect();
        let count = |share: &Share| ids.iter().filter(|&&id| share.holds(id)).count();
        let counts: Vec<usize> = shares.iter().map(count).collect();
        assert_eq!(counts.iter().sum::<usize>(), ids.len());
        assert!(counts.iter().all(|count| (800..1200).contains(count)), "{counts:?}");
    }

    #[test]
    fn the_share_of_an_example_is_the_same_in_every_release() {
        let id: ExampleId = "01ARZ3NDEKTSV4RRFFQ69G5FAV".parse().expect("an id");
        let number = |of| Share::new(1, of).expect("a share").of_example(id).number();
        assert_eq!([1, 2, 3, 64].map(number), [1, 2, 3, 54]);
    }
}
