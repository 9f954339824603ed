//! Schemas of the ids: strings on the wire.

use crate::Share;
use crate::id::{CompositionId, ExampleId, MapId, QueryId, RetopoId, TokenId, UploadId};
use std::borrow::Cow;
use utoipa::openapi::{ObjectBuilder, RefOr, Schema, schema::Type};
use utoipa::{PartialSchema, ToSchema};

macro_rules! id_schema {
    ($($name:ident: $what:literal),*) => {$(
        impl PartialSchema for $name {
            fn schema() -> RefOr<Schema> {
                ObjectBuilder::new().schema_type(Type::String).description(Some($what)).into()
            }
        }

        impl ToSchema for $name {
            fn name() -> Cow<'static, str> {
                stringify!($name).into()
            }
        }
    )*};
}

id_schema!(
    ExampleId: "An example's id: opaque, sorts by time of creation.",
    QueryId: "A query's id: opaque, sorts by time of creation.",
    MapId: "A map's id: opaque, sorts by time of creation.",
    CompositionId: "A composition's id: opaque, sorts by time of creation.",
    RetopoId: "A retopology's id: opaque, sorts by time of creation.",
    TokenId: "A token's public id: opaque, sorts by time of creation.",
    UploadId: "An upload's id: opaque, sorts by time of creation."
);

impl PartialSchema for Share {
    fn schema() -> RefOr<Schema> {
        let what = "A share of a corpus that servers hold together: `2/3` is the second of three.";
        ObjectBuilder::new().schema_type(Type::String).description(Some(what)).into()
    }
}

impl ToSchema for Share {
    fn name() -> Cow<'static, str> {
        "Share".into()
    }
}
