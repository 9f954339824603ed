//! Messages as the contract has them: objects, never lists of their values in order, which serde takes for them too; words, never
//! their numbers.

use serde::de::value::{MapDeserializer, SeqDeserializer};
use serde::de::{DeserializeOwned, Deserializer, Error as _, IntoDeserializer, Visitor};
use serde::forward_to_deserialize_any;
use serde_json::{Error, Value};

/// Reads a message.
///
/// # Errors
/// What is no JSON, or not of this shape.
pub(super) fn from_slice<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Error> {
    // The plain reader tells lines, and refuses fields that come twice; it has to be content first.
    let value = serde_json::from_slice::<T>(bytes)?;
    check::<T>(serde_json::from_slice(bytes)?)?;
    Ok(value)
}

/// Checks that all objects of a message are such.
///
/// # Errors
/// Of the first that is none.
pub(super) fn check<T: DeserializeOwned>(message: Value) -> Result<(), Error> {
    T::deserialize(Strict(message)).map(drop)
}

struct Strict(Value);

impl IntoDeserializer<'_, Error> for Strict {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for Strict {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(items) => visitor.visit_seq(SeqDeserializer::new(items.into_iter().map(Strict))),
            Value::Object(fields) => {
                visitor.visit_map(MapDeserializer::new(fields.into_iter().map(|(name, value)| (name, Strict(value)))))
            }
            plain => plain.deserialize_any(visitor),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        if self.0.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        if self.0.is_array() {
            return Err(Error::custom(format!("expected an object for {name}, found a list")));
        }
        self.deserialize_any(visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.0.deserialize_enum(name, variants, visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::from_slice;
    use quadmuse_proto::{ConstraintEdit, NewMap, NewToken, TokenPatch};

    #[test]
    fn a_list_is_no_message_at_any_depth() {
        let refused = |json: &[u8]| from_slice::<TokenPatch>(json).expect_err("a list").to_string();
        assert!(refused(b"[null, null]").contains("found a list"));
        assert!(refused(br#"{"quota": [null, null]}"#).contains("found a list"));
        assert!(from_slice::<NewToken>(br#"{"quota": [null, null], "role": "reader"}"#).is_err());
        assert!(from_slice::<TokenPatch>(b"{\n\"name\": 1}").expect_err("a number").to_string().contains("line 2"));
        assert!(from_slice::<TokenPatch>(br#"{"name": "a", "name": "b"}"#).is_err());
    }

    #[test]
    fn messages_are_read_as_before() {
        let token: NewToken = from_slice(br#"{"name": "ada", "role": "admin", "expires_in_s": 60}"#).expect("a token");
        assert_eq!((token.name.as_str(), token.expires_in_s), ("ada", Some(60)));
        let id = "01KAR5Z3J8QW0V6T4N2M9D7C1B";
        let map = format!(
            r#"{{"segment": 0, "example": "{id}", "example_segment": 1,
                "landmarks": [{{"on_example": [0, 1, 2.5], "on_input": [1, 2, 3]}}], "beyond": "leave"}}"#
        );
        let map: NewMap = from_slice(map.as_bytes()).expect("a map");
        assert_eq!((map.example.to_string().as_str(), map.landmarks.len()), (id, 1));
        let edit =
            br#"{"set": [{"on_example": [0.5, 0.5, 0], "on_input": [1, 0, 0]}], "undo": ["a"], "on_fold": "refuse"}"#;
        let edit: ConstraintEdit = from_slice(edit).expect("an edit");
        assert_eq!((edit.set.len(), edit.undo.len()), (1, 1));
    }
}
