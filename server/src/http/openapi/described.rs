//! What the handlers' annotations leave out of the contract: names of operations, what an id is, bytes, examples, and which
//! answer leads where.

use quadmuse_proto::MeshFormat;
use quadmuse_proto::upload::TUS_VERSION;
use serde_json::{Map, Value, json};

/// Collections and other nouns by which operations are named; the last in a path counts.
const NOUNS: [&str; 11] = [
    "examples",
    "queries",
    "uploads",
    "ranking",
    "stream",
    "maps",
    "compositions",
    "retopos",
    "samples",
    "tokens",
    "admin",
];
/// An id as it looks.
const ID: &str = "01KAR5Z3J8QW0V6T4N2M9D7C1B";
/// The pattern of ids.
const ID_PATTERN: &str = "^[0-7][0-9A-HJKMNP-TV-Z]{25}$";
/// A mesh that is small and valid: four quads.
const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nv 1 1 .2\nv 2 1 0\nv 0 2 0\nv 1 2 0\nv 2 2 0\nf 1 2 5 4\nf 2 3 6 5\nf 4 5 8 7\nf 5 6 9 8\n";

/// The ids of the components: what they look like. [`quadmuse_proto::ExampleId::TEMPLATE`] is accepted where an example is named.
pub(super) fn ids(schemas: &mut Value) {
    for name in ["ExampleId", "QueryId", "MapId", "CompositionId", "RetopoId", "UploadId"] {
        schemas[name]["pattern"] = ID_PATTERN.into();
        schemas[name]["examples"] = json!([ID]);
    }
}

/// Whole numbers without a sign reach twice as far as the formats that are told of them.
pub(super) fn unsigned(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            let is_unsigned = fields.get("minimum").and_then(Value::as_f64).is_some_and(|least| least >= 0.0);
            let wider = match fields.get("format").and_then(Value::as_str) {
                Some("int32") => "uint32",
                Some("int64") => "uint64",
                _ => "",
            };
            if is_unsigned && !wider.is_empty() {
                fields.insert("format".into(), wider.into());
            }
            fields.values_mut().for_each(unsigned);
        }
        Value::Array(items) => items.iter_mut().for_each(unsigned),
        _ => {}
    }
}

/// One operation, by its path and method.
pub(super) fn operation(path: &str, operation: &mut Value) {
    operation["operationId"] = named(path, operation["operationId"].as_str().unwrap_or_default()).into();
    let parameters = operation.get_mut("parameters").and_then(Value::as_array_mut);
    parameters.into_iter().flatten().for_each(described);
    for response in operation["responses"].as_object_mut().into_iter().flat_map(Map::values_mut) {
        bytes(response);
        if path.ends_with("/mesh") {
            formats(response);
        }
        events(response);
    }
    let name = operation["operationId"].as_str().unwrap_or_default().to_owned();
    let content = operation.pointer_mut("/requestBody/content").and_then(Value::as_object_mut);
    for (media, content) in content.into_iter().flatten() {
        if let Some(example) = example(&name, media) {
            content["example"] = example;
        }
    }
    let (statuses, links) = links(&name);
    for status in statuses {
        if let Some(response) = operation["responses"].get_mut(*status) {
            response["links"] = links.clone();
        }
    }
}

/// `examples_list` of `list` below `/v1/examples`.
fn named(path: &str, handler: &str) -> String {
    let is_noun = |part: &&str| NOUNS.contains(part);
    // The stream of a map is one of the map's.
    let noun = match path.strip_suffix("/stream").filter(|whole| whole.matches('/').count() > 3) {
        Some(whole) => whole.split('/').rfind(is_noun),
        None => path.split('/').rfind(is_noun),
    };
    let noun = noun.unwrap_or("health");
    if noun == handler { noun.to_owned() } else { format!("{noun}_{handler}") }
}

fn described(parameter: &mut Value) {
    let name = parameter["name"].as_str().unwrap_or_default();
    let is_path = parameter["in"] == "path";
    let description = match name {
        "id" => "The id that was answered when it was made",
        "map" => "The map's id",
        "composition" => "The composition's id",
        "retopo" => "The retopology's id",
        "segment" => "The segment's number, from 0",
        "Tus-Resumable" => {
            // As a constant it would be no header to generators of clients.
            parameter["schema"] =
                json!({ "type": "string", "pattern": format!("^{}$", TUS_VERSION.replace('.', "\\.")) });
            return;
        }
        "Upload-Metadata" => {
            parameter["schema"] = json!({ "type": "string", "pattern": "^[a-z]{1,32} [A-Za-z0-9+/]{0,64}$" });
            return;
        }
        "cursor" => {
            parameter["schema"] = json!({ "type": "string", "pattern": ID_PATTERN });
            return;
        }
        "Idempotency-Key" => {
            parameter["schema"] = json!({ "type": "string", "pattern": "^[!-~]{1,255}$" });
            return;
        }
        _ => return,
    };
    if is_path {
        parameter["description"] = description.into();
    }
}

/// Bytes are no list of integers.
fn bytes(response: &mut Value) {
    let content = response.get_mut("content").and_then(Value::as_object_mut);
    for content in content.into_iter().flat_map(Map::values_mut) {
        if content["schema"]["items"]["type"] == "integer" {
            content["schema"] = json!({ "type": "string", "format": "binary" });
        }
    }
}

/// A mesh is answered in each format, under that one's media type.
fn formats(response: &mut Value) {
    let content = response.get_mut("content").and_then(Value::as_object_mut);
    let Some((content, mesh)) =
        content.and_then(|content| content.remove("application/octet-stream").map(|m| (content, m)))
    else {
        return;
    };
    content.extend(MeshFormat::ALL.map(|format| (format.media_type().to_owned(), mesh.clone())));
}

/// A server-sent event is three texts, of which one is the event as JSON.
fn events(response: &mut Value) {
    let Some(content) = response.pointer_mut("/content/text~1event-stream") else { return };
    let what = content["schema"].take();
    content["schema"] = json!({ "type": "object", "required": ["data"], "properties": {
        "event": { "type": "string", "description": "The kind of event" },
        "id": { "type": "string", "description": "The revision, for `last-event-id`" },
        "data": { "type": "string", "contentMediaType": "application/json", "contentSchema": what }
    } });
}

fn example(name: &str, media: &str) -> Option<Value> {
    if media == "model/obj" {
        return Some(OBJ.into());
    }
    let value = match name {
        "examples_annotate" => {
            json!({ "name": "head", "tags": ["face"], "landmarks": [{ "name": "nose_tip", "vertex": 0 }] })
        }
        "queries_annotate" => json!({ "segments": [{ "segment": 0, "name": "head" }] }),
        "maps_create" => json!({ "segment": 0, "example": ID, "example_segment": 0 }),
        "maps_constrain" => json!({ "undo": [], "on_fold": "resolve" }),
        "compositions_create" => json!({ "density": 0 }),
        "retopos_create" => json!({ "beyond": "extend" }),
        "tokens_create" => json!({ "name": "ada", "role": "reader" }),
        "tokens_annotate" => json!({ "name": "ada" }),
        _ => return None,
    };
    (media == "application/json").then_some(value)
}

/// Of the answers that make something: their statuses, and the operations that its id leads to.
fn links(name: &str) -> (&'static [&'static str], Value) {
    let (statuses, own, to): (&[&str], _, &[&str]) = match name {
        "examples_add" => (
            &["201"],
            "id",
            &["examples_get", "examples_annotate", "examples_mesh", "examples_thumbnail", "examples_remove"],
        ),
        "queries_start" => (
            &["202"],
            "id",
            &[
                "queries_get",
                "queries_annotate",
                "queries_mesh",
                "ranking_get",
                "maps_list",
                "maps_create",
                "compositions_create",
                "retopos_create",
                "queries_cancel",
            ],
        ),
        "maps_create" => (
            &["201", "202"],
            "map",
            &["maps_get", "maps_mesh", "maps_preview", "maps_constrain", "maps_stream", "maps_remove"],
        ),
        "compositions_create" => (
            &["201", "202"],
            "composition",
            &[
                "compositions_get",
                "compositions_mesh",
                "compositions_preview",
                "compositions_stream",
                "compositions_remove",
            ],
        ),
        "retopos_create" => (&["201", "202"], "retopo", &["retopos_get", "retopos_stream", "retopos_remove"]),
        _ => return (&[], Value::Null),
    };
    let link = |to: &&str| {
        let mut parameters = Map::new();
        parameters.insert(own.into(), "$response.body#/id".into());
        if own != "id" {
            parameters.insert("id".into(), "$request.path.id".into());
        }
        ((*to).to_owned(), json!({ "operationId": to, "parameters": parameters }))
    };
    (statuses, Value::Object(to.iter().map(link).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_operation_is_named_by_what_it_is_done_to() {
        assert_eq!(named("/v1/examples", "list"), "examples_list");
        assert_eq!(named("/v1/queries/{id}/maps/{map}/mesh", "mesh"), "maps_mesh");
        assert_eq!(named("/v1/queries/{id}/stream", "stream"), "stream");
        assert_eq!(named("/v1/queries/{id}/maps/{map}/stream", "stream"), "maps_stream");
        assert_eq!(named("/healthz", "alive"), "health_alive");
    }

    #[test]
    fn a_mesh_is_answered_in_every_format_and_an_event_as_texts() {
        let mut mesh = json!({ "content": { "application/octet-stream": { "schema": {} } } });
        formats(&mut mesh);
        let types = mesh["content"].as_object().expect("types");
        assert!(types.len() == MeshFormat::ALL.len() && types.contains_key("model/obj"), "{types:?}");
        let mut stream = json!({ "content": { "text/event-stream": { "schema": { "$ref": "#/e" } } } });
        events(&mut stream);
        let data = &stream["content"]["text/event-stream"]["schema"]["properties"]["data"];
        assert_eq!(data["contentSchema"]["$ref"], "#/e");
    }

    #[test]
    fn numbers_without_a_sign_are_told_as_such() {
        let mut spec =
            json!([{ "type": "integer", "format": "int32", "minimum": 0 }, { "type": "integer", "format": "int32" }]);
        unsigned(&mut spec);
        assert_eq!([&spec[0]["format"], &spec[1]["format"]], ["uint32", "int32"]);
    }

    #[test]
    fn bytes_are_told_as_bytes_and_what_has_no_body_is_given_none() {
        let mut list =
            json!({ "content": { "image/png": { "schema": { "type": "array", "items": { "type": "integer" } } } } });
        bytes(&mut list);
        assert_eq!(list["content"]["image/png"]["schema"]["format"], "binary");
        let mut none = json!({ "operationId": "get", "responses": { "204": { "description": "Gone" } } });
        operation("/v1/examples/{id}", &mut none);
        assert_eq!(none, json!({ "operationId": "examples_get", "responses": { "204": { "description": "Gone" } } }));
    }
}
