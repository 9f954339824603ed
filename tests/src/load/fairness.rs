//! One user beside another who asks for a hundred things, and an artist who drags a point meanwhile.

use super::{Caller, Did, Sent, Times, Until, saturate};
use crate::{binaries::program, scale::ScaleError, server::Server};
use serde_json::{Value, json};
use std::{
    path::Path,
    process::Command,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Instant,
};

/// Queries of the second user that are timed.
const TIMED: usize = 8;

/// A token of a user of this name, on the store in `data`.
///
/// # Errors
/// [`ScaleError`].
pub fn token(data: &Path, name: &str) -> Result<String, ScaleError> {
    let mut command = Command::new(program("quadmuse-server")?);
    command.args(["token", "create", "--role", "contributor", "--name", name, "--data"]).arg(data);
    let output = command.output().map_err(|source| ScaleError::Io { doing: "create a token".into(), source })?;
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let token = said.split_whitespace().max_by_key(|word| word.len()).map(str::to_owned);
    token.filter(|_| output.status.success()).ok_or(ScaleError::Answer { expected: "a token", found: said })
}

/// Times until the first ranking of one user's queries: alone, and while another has `waiting` queries under way or refused.
///
/// # Errors
/// [`ScaleError`].
pub fn first_levels(
    server: &Server,
    mesh: &[u8],
    [flooder, other]: [&str; 2],
    waiting: usize,
) -> Result<([Times; 2], usize), ScaleError> {
    let [flooder, other] = [flooder, other].map(|token| Caller { server, token: Some(token.to_owned()) });
    let alone = timed(&other, mesh)?;
    let mut taken = 0;
    for _ in 0..waiting {
        taken += usize::from(matches!(flooder.send(mesh)?, Sent::Taken(_)));
    }
    let beside = timed(&other, mesh)?;
    Ok(([alone, beside], taken))
}

fn timed(caller: &Caller<'_>, mesh: &[u8]) -> Result<Times, ScaleError> {
    let mut times = Times::default();
    for _ in 0..TIMED {
        let begun = Instant::now();
        let Sent::Taken(id) = caller.send(mesh)? else {
            times.0.push(f64::INFINITY);
            continue;
        };
        caller.wait(&id, Until::First)?;
        times.0.push(begun.elapsed().as_secs_f64() * 1000.0);
        caller.wait(&id, Until::End)?;
    }
    Ok(times)
}

/// Times of edits of a constraint of a map of the example that has the mesh `drawn`: alone, and while `clients` saturate the
/// service; and the faces of the map.
///
/// # Errors
/// [`ScaleError`].
pub fn edits(
    server: &Server,
    [mesh, drawn]: [&[u8]; 2],
    clients: usize,
    edits: usize,
) -> Result<([Times; 2], u64), ScaleError> {
    let caller = Caller { server, token: None };
    let added = caller.value("POST /v1/examples", Some(("model/obj", drawn)))?;
    let example = added["id"].as_str().unwrap_or_default();
    let Sent::Taken(query) = caller.send(mesh)? else {
        return Err(ScaleError::Answer { expected: "a query", found: "a refusal".into() });
    };
    caller.wait(&query, Until::End)?;
    let wanted = json!({ "segment": 0, "example": example, "example_segment": 0 }).to_string();
    let json_body = |body: &str| -> Vec<u8> { body.as_bytes().to_vec() };
    let body = json_body(&wanted);
    let map = caller.value(&format!("POST /v1/queries/{query}/maps?wait=240"), Some(("application/json", &body)))?;
    let faces = map["faces"].as_u64().or_else(|| map["counts"]["faces"].as_u64()).unwrap_or_default();
    let id = map["id"].as_str().unwrap_or_default().to_owned();
    let constraint = found(&map["constraints"], "id")
        .ok_or_else(|| ScaleError::Answer { expected: "constraints of a map", found: map.to_string() })?;
    let places: Vec<Value> = map["constraints"].as_array().cloned().unwrap_or_default();
    let place = places.first().map(|first| first["on_input"].clone()).unwrap_or_default();
    let line = format!("PATCH /v1/queries/{query}/maps/{id}/constraints");
    let edit = json!({ "set": [{ "id": constraint, "on_input": place }], "on_fold": "resolve" }).to_string();
    let times = || {
        let mut times = Times::default();
        for _ in 0..edits {
            let begun = Instant::now();
            caller.value(&line, Some(("application/json", edit.as_bytes())))?;
            times.0.push(begun.elapsed().as_secs_f64() * 1000.0);
        }
        Ok::<_, ScaleError>(times)
    };
    let alone = times()?;
    let over = AtomicBool::new(false);
    let loaded = thread::scope(|scope| {
        let clients = saturate(scope, (server, mesh), clients, &over, &|_: &str| ());
        thread::sleep(std::time::Duration::from_secs(2));
        let loaded = times();
        over.store(true, Ordering::Relaxed);
        clients.map(Did::all).map_err(|source| ScaleError::Io { doing: "start a thread".into(), source })?;
        loaded
    })?;
    Ok(([alone, loaded], faces))
}

/// The first text of that name in a value.
fn found(value: &Value, name: &str) -> Option<String> {
    match value {
        Value::Object(fields) => {
            let own = fields.get(name).and_then(Value::as_str).map(str::to_owned);
            own.or_else(|| fields.values().find_map(|field| found(field, name)))
        }
        Value::Array(items) => items.iter().find_map(|item| found(item, name)),
        _ => None,
    }
}
