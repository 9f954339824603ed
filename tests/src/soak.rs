//! The service at full load for a long time: memory, latency and errors of each interval, as a table and as a picture.

pub mod picture;

use crate::{
    http,
    load::{Caller, Did, Sent, Times, Until, has_end, saturate, spawn},
    scale::{ScaleError, process},
    server::Server,
    shapes::{self, Faces},
};
use serde_json::{Value, json};
use std::{
    fmt::Write,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

/// How often health is asked for, and how often a watcher looks.
const HEALTH_EVERY: Duration = Duration::from_millis(50);
const WATCH_EVERY: Duration = Duration::from_secs(1);
/// Pause between two edits, and between two changes of the corpus.
const EDIT_EVERY: Duration = Duration::from_millis(500);
const CHANGE_EVERY: Duration = Duration::from_secs(5);
/// Cells of the side of an example that comes and goes.
const CELLS: u32 = 12;

/// Who does what, and for how long.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// How long all of it goes on.
    pub time: Duration,
    /// One row of the table is so long.
    pub interval: Duration,
    /// Clients that send queries, each the next when its last has ended.
    pub clients: usize,
    /// Watchers: half of them poll, half of them stream.
    pub watchers: usize,
}

/// One interval.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// Its end, in seconds from the beginning.
    pub at_s: f64,
    /// Memory of the server at its end, in MiB.
    pub resident_mib: f64,
    /// Answers of `/healthz` in milliseconds: median, p99 and the most.
    pub health_ms: [f64; 3],
    /// Edits of a map's constraint in milliseconds: median and p95; not a number where there was none.
    pub edit_ms: [f64; 2],
    /// Queries that ended.
    pub ended: usize,
    /// Answers to watchers.
    pub watched: usize,
    /// Examples added and removed again.
    pub changes: usize,
    /// Calls that failed, of whatever kind; refusals with `Retry-After` are none.
    pub errors: usize,
}

/// What happened since the last row.
#[derive(Default)]
struct Tally {
    ended: AtomicUsize,
    watched: AtomicUsize,
    changes: AtomicUsize,
    errors: AtomicUsize,
    edits: Mutex<Times>,
}

impl Tally {
    fn count(&self, of: &AtomicUsize, is_good: bool) {
        let of = if is_good { of } else { &self.errors };
        of.fetch_add(1, Ordering::Relaxed);
    }
}

/// Loads the server as planned; `shows` is given each row as it is there.
///
/// # Errors
/// [`ScaleError`].
pub fn measure(server: &Server, mesh: &[u8], plan: Plan, shows: &mut dyn FnMut(&Row)) -> Result<Vec<Row>, ScaleError> {
    let (over, tally, newest) = (AtomicBool::new(false), Tally::default(), Mutex::<Vec<String>>::default());
    let is_over = || over.load(Ordering::Relaxed);
    let failed = |source| ScaleError::Io { doing: "start a thread".into(), source };
    // A query that is taken is the end of its client's last one.
    let taken = |id: &str| {
        tally.count(&tally.ended, true);
        newest.lock().unwrap_or_else(PoisonError::into_inner).push(id.to_owned());
    };
    let watched = |at: usize| {
        let newest = newest.lock().unwrap_or_else(PoisonError::into_inner);
        newest.len().checked_sub(1 + at % newest.len().clamp(1, 4)).map(|at| newest[at].clone())
    };
    let caller = Caller { server, token: None };
    thread::scope(|scope| {
        let clients = saturate(scope, (server, mesh), plan.clients, &over, &taken).map_err(failed)?;
        for at in 0..plan.watchers {
            let (caller, tally) = (&caller, &tally);
            let watch = move || {
                while !is_over() {
                    if let Some(id) = watched(at) {
                        let way = if at.is_multiple_of(2) { "" } else { "/stream" };
                        let answer = caller.ask(&format!("GET /v1/queries/{id}{way}"), None);
                        let is_good =
                            |a: &http::Answer| a.status == 410 || a.status == 200 && (way.is_empty() || has_end(a));
                        tally.count(&tally.watched, answer.as_ref().is_ok_and(is_good));
                    }
                    thread::sleep(WATCH_EVERY);
                }
            };
            spawn(scope, watch).map_err(failed)?;
        }
        spawn(scope, || edits(&caller, mesh, &is_over, &tally)).map_err(failed)?;
        spawn(scope, || changes(&caller, &is_over, &tally)).map_err(failed)?;
        let rows = rows(server, plan, &tally, shows);
        over.store(true, Ordering::Relaxed);
        let errors = Did::all(clients).errors;
        let mut rows = rows;
        if let Some(last) = rows.last_mut() {
            last.errors += errors;
        }
        Ok(rows)
    })
}

fn rows(server: &Server, plan: Plan, tally: &Tally, shows: &mut dyn FnMut(&Row)) -> Vec<Row> {
    let begun = Instant::now();
    let mut rows = Vec::new();
    while begun.elapsed() < plan.time {
        let (from, mut health) = (Instant::now(), Times::default());
        while from.elapsed() < plan.interval {
            let asked = Instant::now();
            let is_good = http::get(server.address(), "/healthz").is_ok_and(|answer| answer.status == 200);
            if is_good {
                health.0.push(asked.elapsed().as_secs_f64() * 1000.0);
            } else {
                tally.errors.fetch_add(1, Ordering::Relaxed);
            }
            thread::sleep(HEALTH_EVERY);
        }
        let taken = |of: &AtomicUsize| of.swap(0, Ordering::Relaxed);
        let edits = std::mem::take(&mut *tally.edits.lock().unwrap_or_else(PoisonError::into_inner));
        let [resident, _] = process::resident(server.id());
        let row = Row {
            at_s: begun.elapsed().as_secs_f64(),
            resident_mib: resident as f64 / f64::from(1 << 20),
            health_ms: [0.5, 0.99, 1.0].map(|share| health.share(share)),
            edit_ms: [0.5, 0.95].map(|share| edits.share(share)),
            ended: taken(&tally.ended),
            watched: taken(&tally.watched),
            changes: taken(&tally.changes),
            errors: taken(&tally.errors),
        };
        shows(&row);
        rows.push(row);
    }
    rows
}

/// Somebody who drags a point of a map, and begins anew where the map has made room for others.
fn edits(caller: &Caller<'_>, mesh: &[u8], is_over: &dyn Fn() -> bool, tally: &Tally) {
    while !is_over() {
        let Some((line, edit)) = laid(caller, mesh) else {
            tally.errors.fetch_add(1, Ordering::Relaxed);
            thread::sleep(WATCH_EVERY);
            continue;
        };
        while !is_over() {
            let begun = Instant::now();
            match caller.ask(&line, Some(("application/json", edit.as_bytes()))) {
                Ok(answer) if answer.status == 200 => {
                    let mut times = tally.edits.lock().unwrap_or_else(PoisonError::into_inner);
                    times.0.push(begun.elapsed().as_secs_f64() * 1000.0);
                }
                // The query made room.
                Ok(answer) if answer.status == 410 => break,
                Ok(answer) if [429, 503].contains(&answer.status) => {}
                _ => _ = tally.errors.fetch_add(1, Ordering::Relaxed),
            }
            thread::sleep(EDIT_EVERY);
        }
    }
}

/// A map, as the line that edits one of its constraints and the edit.
fn laid(caller: &Caller<'_>, mesh: &[u8]) -> Option<(String, String)> {
    let Ok(Sent::Taken(query)) = caller.send(mesh) else { return None };
    caller.wait(&query, Until::End).ok()?;
    let ranking = caller.value(&format!("GET /v1/queries/{query}/ranking"), None).ok()?;
    let best = ranking["entries"].as_array()?.first()?;
    let wanted = json!({ "segment": 0, "example": best["example"], "example_segment": best["example_segment"] });
    let body = wanted.to_string();
    let line = format!("POST /v1/queries/{query}/maps?wait=240");
    let map: Value = caller.value(&line, Some(("application/json", body.as_bytes()))).ok()?;
    let first = map["constraints"].as_array()?.first()?;
    let set = json!([{ "id": first["id"], "on_input": first["on_input"] }]);
    let edit = json!({ "set": set, "on_fold": "resolve" }).to_string();
    Some((format!("PATCH /v1/queries/{query}/maps/{}/constraints", map["id"].as_str()?), edit))
}

/// Examples that come and go.
fn changes(caller: &Caller<'_>, is_over: &dyn Fn() -> bool, tally: &Tally) {
    for kind in 100u32.. {
        if is_over() {
            return;
        }
        let mesh = shapes::head(kind, CELLS, Faces::Quads);
        let added = caller.value("POST /v1/examples", Some(("model/obj", mesh.as_bytes())));
        let id = added.as_ref().ok().and_then(|example| example["id"].as_str());
        let removed = id.map(|id| caller.ask(&format!("DELETE /v1/examples/{id}"), None));
        tally.count(&tally.changes, removed.is_some_and(|answer| answer.is_ok_and(|answer| answer.status < 300)));
        thread::sleep(CHANGE_EVERY);
    }
}

/// The rows as comma-separated values, with a header.
pub fn csv(rows: &[Row]) -> String {
    let mut text = String::from(
        "seconds,resident_mib,health_p50_ms,health_p99_ms,health_max_ms,edit_p50_ms,edit_p95_ms,queries,watched,changes,errors\n",
    );
    for row in rows {
        let [p50, p99, most] = row.health_ms;
        let [edit, edit_p95] = row.edit_ms;
        let _ = writeln!(
            text,
            "{:.0},{:.0},{p50:.1},{p99:.1},{most:.1},{edit:.1},{edit_p95:.1},{},{},{},{}",
            row.at_s, row.resident_mib, row.ended, row.watched, row.changes, row.errors
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_a_line_an_interval_and_as_many_values_as_names() {
        let row = Row { at_s: 10.0, resident_mib: 300.4, errors: 2, ..Row::default() };
        let text = csv(&[row.clone(), row]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines.iter().all(|line| line.split(',').count() == 11), "{text}");
        assert!(lines[1].starts_with("10,300,") && lines[1].ends_with(",2"), "{text}");
    }
}
