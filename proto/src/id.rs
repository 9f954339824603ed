//! Identifiers that sort by time of creation.
//!
//! Each is a ULID: 26 characters of Crockford base 32, a 48-bit time in milliseconds before 80 random bits. To clients they are
//! opaque strings. What lives on one server of several carries the number of that server in the first 16 of its random bits
//! ([`ServerNumber`]), so that any of them knows whom to ask. A kind of thing has a kind of id, so that a query's id can't be handed over where an example's is expected.

use std::fmt;
use std::num::NonZeroU16;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use ulid::{Generator, Ulid};

/// Length of an id as text, in characters.
pub const ID_TEXT_LEN: usize = 26;
/// Length of an id as bytes (big-endian, so that bytes sort as the ids do).
pub const ID_BYTES_LEN: usize = 16;

static GENERATOR: Mutex<Generator> = Mutex::new(Generator::new());

/// A text that is no id.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IdError {
    /// Not 26 characters long.
    #[error("expected an id of {ID_TEXT_LEN} characters, found {found}; copy the id as the service gave it")]
    Length {
        /// Length of the text, in characters.
        found: usize,
    },
    /// A character outside Crockford's base 32, or a value beyond 128 bits.
    #[error(
        "expected an id of digits and capital letters without I, L, O and U, found another text; copy the id as the service gave it"
    )]
    Alphabet,
}

/// A fresh ULID, greater than every one this process made before (even within a millisecond, even when the clock is set back).
fn generate() -> Ulid {
    let mut generator = GENERATOR.lock().unwrap_or_else(PoisonError::into_inner);
    match generator.generate() {
        Ok(id) => id,
        Err(overflow) => overflow.commit_overflow_increment(),
    }
}

fn parse(text: &str) -> Result<Ulid, IdError> {
    let found = text.chars().count();
    if found != ID_TEXT_LEN {
        return Err(IdError::Length { found });
    }
    let id = Ulid::from_string(text).map_err(|_| IdError::Alphabet)?;
    // One spelling an id: a first digit beyond 7 would wrap around, and lower case would be a second name of the same thing.
    if id.to_string() == text { Ok(id) } else { Err(IdError::Alphabet) }
}

/// The number of one start of one server, among those that share a corpus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ServerNumber(NonZeroU16);

impl ServerNumber {
    /// The server of this number; `None` for 0.
    pub const fn new(number: u16) -> Option<Self> {
        match NonZeroU16::new(number) {
            Some(number) => Some(Self(number)),
            None => None,
        }
    }

    /// The number, from 1 on.
    pub const fn get(self) -> u16 {
        self.0.get()
    }
}

impl fmt::Display for ServerNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

/// Where the number of a server stands in the bytes of an id: behind the 48 bits of the time.
const NUMBER_AT: usize = 6;

macro_rules! id_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(Ulid);

        impl $name {
            /// A fresh id, greater than every id this process made before. Reads the clock and the system's random source.
            pub fn generate() -> Self {
                Self(generate())
            }

            /// A fresh id of what lives on `server`, if there are several.
            pub fn generate_on(server: Option<ServerNumber>) -> Self {
                let id = Self::generate();
                server.map_or(id, |server| id.on(server))
            }

            /// The id whose bytes, big-endian, are given.
            pub const fn from_bytes(bytes: [u8; ID_BYTES_LEN]) -> Self {
                Self(Ulid::from_bytes(bytes))
            }

            /// The id as bytes, big-endian: they sort as the ids do.
            pub const fn to_bytes(self) -> [u8; ID_BYTES_LEN] {
                self.0.to_bytes()
            }

            /// The same id as one of what lives on `server`. Ids that one process made stay in their order.
            pub const fn on(self, server: ServerNumber) -> Self {
                let (mut bytes, [high, low]) = (self.to_bytes(), server.get().to_be_bytes());
                (bytes[NUMBER_AT], bytes[NUMBER_AT + 1]) = (high, low);
                Self::from_bytes(bytes)
            }

            /// The server on which what has this id lives, if several share a corpus; of other ids it says nothing.
            pub const fn server(self) -> Option<ServerNumber> {
                let bytes = self.to_bytes();
                ServerNumber::new(u16::from_be_bytes([bytes[NUMBER_AT], bytes[NUMBER_AT + 1]]))
            }

            /// Time of creation, in milliseconds since 1970.
            pub const fn created_unix_ms(self) -> u64 {
                self.0.timestamp_ms()
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(&self.0, f)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!(stringify!($name), "({})"), self.0)
            }
        }

        impl FromStr for $name {
            type Err = IdError;

            fn from_str(text: &str) -> Result<Self, IdError> {
                parse(text).map(Self)
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(&self.0)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let text = String::deserialize(deserializer)?;
                text.parse().map_err(serde::de::Error::custom)
            }
        }
    };
}

id_type! {
    /// A mesh of the corpus.
    ExampleId
}

impl ExampleId {
    /// The reserved id of the regular layouts: built in, not stored, made anew for each segment. No example is ever given
    /// it, as it was created in 1970.
    pub const TEMPLATE: Self = Self::from_bytes([0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
}

id_type! {
    /// An uploaded input mesh while it is ranked, and after.
    QueryId
}
id_type! {
    /// A cross map of one corpus segment onto one query segment.
    MapId
}
id_type! {
    /// A file that is uploaded piece by piece.
    UploadId
}
id_type! {
    /// The maps chosen for a query's segments, stitched into one mesh.
    CompositionId
}
id_type! {
    /// Quads for all of a scan, made in one go.
    RetopoId
}
id_type! {
    /// A positional constraint of a map.
    ConstraintId
}
id_type! {
    /// One request to the service, in logs and problems.
    RequestId
}
id_type! {
    /// An access token's public name (never the token itself).
    TokenId
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_made_one_after_the_other_sort_that_way_as_text_and_as_bytes() {
        let ids: Vec<ExampleId> = (0..2000).map(|_| ExampleId::generate()).collect();
        for pair in ids.windows(2) {
            assert!(pair[0] < pair[1]);
            assert!(pair[0].to_string() < pair[1].to_string());
            assert!(pair[0].to_bytes() < pair[1].to_bytes());
        }
    }

    #[test]
    fn text_and_bytes_lead_back_to_the_id() {
        let id = QueryId::generate();
        assert_eq!(id.to_string().parse::<QueryId>(), Ok(id));
        assert_eq!(QueryId::from_bytes(id.to_bytes()), id);
    }

    #[test]
    fn an_id_tells_its_server_and_is_an_id_like_any_other() {
        for number in [1, 2, 0x1234, u16::MAX] {
            let server = ServerNumber::new(number).expect("not 0");
            let (plain, id) = (QueryId::generate(), QueryId::generate().on(server));
            assert_eq!((id.server(), server.get()), (Some(server), number));
            assert_eq!(id.to_string().len(), ID_TEXT_LEN);
            assert_eq!(id.to_string().parse::<QueryId>(), Ok(id));
            assert!(id.created_unix_ms() >= plain.created_unix_ms());
            assert_eq!(id.on(server), id);
        }
        assert_eq!(ServerNumber::new(0), None);
        assert_eq!(ExampleId::TEMPLATE.server(), None);
    }

    #[test]
    fn ids_of_one_server_sort_by_the_order_in_which_they_were_made() {
        let server = ServerNumber::new(7).expect("not 0");
        let ids: Vec<MapId> = (0..2000).map(|_| MapId::generate().on(server)).collect();
        assert!(ids.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn an_id_has_one_spelling() {
        let text = "01ARZ3NDEKTSV4RRFFQ69G5FAV";
        assert!(text.parse::<MapId>().is_ok());
        assert_eq!(text.to_lowercase().parse::<MapId>(), Err(IdError::Alphabet));
        assert_eq!("81ARZ3NDEKTSV4RRFFQ69G5FAV".parse::<MapId>(), Err(IdError::Alphabet));
        assert_eq!("01ARZ3NDEKTSV4RRFFQ69G5FAU".parse::<MapId>(), Err(IdError::Alphabet));
        assert_eq!("".parse::<MapId>(), Err(IdError::Length { found: 0 }));
        assert_eq!("é".repeat(26).parse::<MapId>(), Err(IdError::Alphabet));
    }
}
