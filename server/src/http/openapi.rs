//! `/openapi.json`: the contract, made from the handlers' own annotations and the types of `proto`.

mod described;

use super::negotiate::{JSON, MSGPACK, if_none_match};
use super::packed::{Coding, Text};
use crate::app::App;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use quadmuse_proto::upload::OFFSET_OCTET_STREAM;
use quadmuse_proto::{
    Code, Components, CompositionId, ExampleId, MapId, MeshFormat, Problem, QueryId, RetopoId, Segmentation, Topology,
    UploadId, problem,
};
use serde_json::{Value, json};
use utoipa::openapi::{ComponentsBuilder, InfoBuilder, OpenApi, OpenApiBuilder};

/// What stands at the top of the contract; the routes add the rest.
pub fn head() -> OpenApi {
    let info = InfoBuilder::new()
        .title("Quadmuse")
        .version(env!("CARGO_PKG_VERSION"))
        .description(Some(
            "Ranks a corpus of quad meshes against an input mesh and maps the chosen ones onto it. \
             Bodies are JSON or MessagePack (`accept`, `content-type`); errors are `application/problem+json`.",
        ))
        .build();
    // Those that no body names: they stand in parameters, or are added to every operation.
    let components = ComponentsBuilder::new().schema_from::<Problem>().schema_from::<Code>();
    let components = components
        .schema_from::<Segmentation>()
        .schema_from::<Components>()
        .schema_from::<MeshFormat>()
        .schema_from::<Topology>();
    let components = components.schema_from::<ExampleId>().schema_from::<QueryId>().schema_from::<MapId>();
    let components =
        components.schema_from::<CompositionId>().schema_from::<RetopoId>().schema_from::<UploadId>().build();
    OpenApiBuilder::new().info(info).components(Some(components)).build()
}

/// The contract as JSON: every JSON body in MessagePack too, every operation with its problems and its security.
pub fn finished(api: &OpenApi) -> Bytes {
    let mut spec = serde_json::to_value(api).unwrap_or_default();
    spec["components"]["securitySchemes"] = json!({ "token": { "type": "http", "scheme": "bearer" } });
    // What old clients read where they don't know a code is never sent.
    if let Some(codes) = spec["components"]["schemas"]["Code"]["enum"].as_array_mut() {
        codes.retain(|code| code != Code::Other.as_str());
    }
    spec["servers"] = json!([{ "url": "/", "description": "The server that tells this" }]);
    described::ids(&mut spec["components"]["schemas"]);
    for (path, operations) in spec["paths"].as_object_mut().into_iter().flatten() {
        finish_path(path, operations);
    }
    described::unsigned(&mut spec);
    spec.to_string().into()
}

fn finish_path(path: &str, operations: &mut Value) {
    let Some(operations) = operations.as_object_mut() else { return };
    for (method, operation) in operations {
        if !matches!(method.as_str(), "get" | "head" | "options" | "post" | "patch" | "delete" | "put") {
            continue;
        }
        let schema = json!({ "$ref": "#/components/schemas/Problem" });
        operation["responses"]["default"] =
            json!({ "description": "A problem", "content": { problem::MEDIA_TYPE: { "schema": schema } } });
        operation["security"] = json!([{}, { "token": [] }]);
        if let Some(responses) = operation["responses"].as_object_mut() {
            responses.values_mut().for_each(add_msgpack);
        }
        if operation.get("requestBody").is_some() {
            add_msgpack(&mut operation["requestBody"]);
            add_mesh_bodies(&mut operation["requestBody"]);
        }
        described::operation(path, operation);
    }
}

fn add_msgpack(body: &mut Value) {
    if let Some(content) = body.get_mut("content").and_then(Value::as_object_mut)
        && let Some(json) = content.get("application/json").cloned()
    {
        content.insert(MSGPACK.into(), json);
    }
}

/// A mesh may come under its own media type, or in a form; a piece of a file is bytes.
fn add_mesh_bodies(body: &mut Value) {
    let Some(content) = body.get_mut("content").and_then(Value::as_object_mut) else { return };
    let bytes = json!({ "schema": { "type": "string", "format": "binary" } });
    if let Some(piece) = content.get_mut(OFFSET_OCTET_STREAM) {
        *piece = bytes.clone();
    }
    if content.remove("application/octet-stream").is_none() {
        return;
    }
    content.insert("application/octet-stream".into(), bytes.clone());
    for format in MeshFormat::ALL {
        content.insert(format.media_type().into(), bytes.clone());
    }
    let form = json!({ "schema": { "type": "object", "required": ["mesh"], "properties": {
        "mesh": { "type": "string", "format": "binary" },
        "segments": { "type": "string", "description": "One integer a line, one line a face" }
    } } });
    content.insert("multipart/form-data".into(), form);
}

/// The contract.
pub async fn get(State(app): State<App>, headers: HeaderMap) -> Response {
    let text = app.openapi.get_or_init(|| Text::kept(Bytes::new()));
    text.answer(Coding::of(&headers), JSON, if_none_match(&headers).as_deref())
}
