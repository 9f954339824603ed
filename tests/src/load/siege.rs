//! Several users who want the service's memory at once: what it holds at most, and whether it answers meanwhile.
//!
//! Each user does one thing again and again, several times at once: what one may have is limited, so that it takes many to be
//! over what was promised of all.

use super::{Caller, Sent, Times, fairness, spawn};
use crate::{
    http,
    scale::{ScaleError, process},
    server::Server,
    shapes::{self, Faces},
};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    io::Write,
    net::TcpStream,
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

/// Pause between two looks at the memory.
const LOOK: Duration = Duration::from_millis(10);
/// Pause between two questions for the health.
const HEALTH_EVERY: Duration = Duration::from_millis(20);
/// What one user does at a time.
const AT_ONCE: usize = 4;
/// Pause of who is refused.
const REFUSED: Duration = Duration::from_millis(50);
/// Cells of a side of the mesh that labels and maps are of, and of the scan.
const SIDE: u32 = 90;
const SCAN_SIDE: u32 = 220;
/// What is held open sends so many bytes, a part at a time.
const HELD_BYTES: usize = 48 << 20;
const HELD_PART: usize = 1 << 20;

/// What a user does.
#[derive(Clone, Copy, Debug)]
pub enum Way {
    /// Labels files of several hundred kilobytes with a mesh, each malformed at its end.
    Labels,
    /// Scans of some hundred thousand triangles.
    Scans,
    /// Maps with very many quads of a small input, and compositions and retopologies of it.
    Maps,
    /// Uploads that end only when all is over.
    Held,
}

impl Way {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Labels, Self::Scans, Self::Maps, Self::Held];
}

/// What came of it.
#[derive(Debug, Default)]
pub struct Siege {
    /// The most resident memory, in bytes.
    pub most: u64,
    /// The same 20 s after the end.
    pub after: u64,
    /// How long health took.
    pub health: Times,
    /// Questions for health that failed.
    pub unwell: usize,
    /// Answers by user, way and status; 0 is a connection without one.
    pub answers: BTreeMap<(String, u16), usize>,
    /// Whether the server lives.
    pub lives: bool,
}

/// Starts a server with so little memory and a token for each of `users` users, who do the same `way` each or, with none, one of
/// all each, for so long.
///
/// # Errors
/// [`ScaleError`].
pub fn measure(data: &Path, limit: u64, users: usize, way: Option<Way>, time: Duration) -> Result<Siege, ScaleError> {
    let tokens = (0..users).map(|k| fairness::token(data, &format!("user-{k}"))).collect::<Result<Vec<_>, _>>()?;
    let limit = format!("QUADMUSE_MEMORY_LIMIT={limit}");
    let words = ["env", &limit, "QUADMUSE_CONNECTIONS_PER_ADDRESS=512", "QUADMUSE_RATE_LIMIT=1000000"];
    let mut server = Server::start_under(&words, data)?;
    let (over, most, answers) = (AtomicBool::new(false), AtomicU64::new(0), Mutex::new(BTreeMap::new()));
    let failed = |source| ScaleError::Io { doing: "start a thread".into(), source };
    let mut siege = thread::scope(|scope| {
        spawn(scope, || {
            while !over.load(Ordering::Relaxed) {
                most.fetch_max(process::resident(server.id())[0], Ordering::Relaxed);
                thread::sleep(LOOK);
            }
        })
        .map_err(failed)?;
        for (k, token) in tokens.iter().enumerate() {
            let way = way.unwrap_or(Way::ALL[k % Way::ALL.len()]);
            for at in 0..AT_ONCE {
                let (server, over, answers) = (&server, &over, &answers);
                spawn(scope, move || {
                    let caller = Caller { server, token: Some(token.clone()) };
                    let note = |status: u16| {
                        let mut answers = answers.lock().unwrap_or_else(PoisonError::into_inner);
                        *answers.entry((format!("{way:?}"), status)).or_default() += 1;
                        if matches!(status, 0 | 429 | 503) {
                            thread::sleep(REFUSED);
                        }
                    };
                    attack(&caller, way, at, &|| over.load(Ordering::Relaxed), &note);
                })
                .map_err(failed)?;
            }
        }
        let siege = watched(&server, time);
        over.store(true, Ordering::Relaxed);
        Ok::<_, ScaleError>(siege)
    })?;
    thread::sleep(Duration::from_secs(20));
    siege.most = most.load(Ordering::Relaxed);
    siege.after = process::resident(server.id())[0];
    siege.lives = server.is_alive();
    siege.answers = answers.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(siege)
}

fn watched(server: &Server, time: Duration) -> Siege {
    let (begun, mut siege) = (Instant::now(), Siege::default());
    while begun.elapsed() < time {
        let asked = Instant::now();
        match http::get(server.address(), "/healthz") {
            Ok(answer) if answer.status == 200 => siege.health.0.push(asked.elapsed().as_secs_f64() * 1000.0),
            _ => siege.unwell += 1,
        }
        thread::sleep(HEALTH_EVERY);
    }
    siege
}

fn attack(caller: &Caller<'_>, way: Way, at: usize, is_over: &dyn Fn() -> bool, note: &dyn Fn(u16)) {
    let small = shapes::head(9, SIDE, Faces::Triangles);
    let scan = matches!(way, Way::Scans).then(|| shapes::head(11, SCAN_SIDE + at as u32, Faces::Triangles));
    let status = |answer: Result<http::Answer, ScaleError>| answer.map_or(0, |answer| answer.status);
    while !is_over() {
        match way {
            Way::Labels => {
                let body = labelled(&small);
                note(status(caller.ask("POST /v1/examples", Some(("multipart/form-data; boundary=XX", &body)))));
            }
            Way::Scans => {
                let mesh = scan.as_deref().unwrap_or_default().as_bytes();
                note(status(caller.ask("POST /v1/queries", Some(("model/obj", mesh)))));
            }
            Way::Maps => maps(caller, small.as_bytes(), is_over, note),
            Way::Held => note(held(caller, is_over)),
        }
    }
}

/// A form with a mesh and a line for each of many labels, the last of which is none.
fn labelled(mesh: &str) -> Vec<u8> {
    let part =
        |name: &str| format!("--XX\r\ncontent-disposition: form-data; name=\"{name}\"; filename=\"a.obj\"\r\n\r\n");
    let labels = "0\n".repeat(288_500);
    format!("{}{mesh}\r\n{}{labels}x\r\n--XX--\r\n", part("mesh"), part("segments")).into_bytes()
}

/// A query, and maps, compositions and retopologies of it until it is gone.
fn maps(caller: &Caller<'_>, mesh: &[u8], is_over: &dyn Fn() -> bool, note: &dyn Fn(u16)) {
    let query = match caller.send(mesh) {
        Ok(Sent::Taken(query)) => query,
        Ok(Sent::Later(_)) => return note(429),
        Err(_) => return note(0),
    };
    note(202);
    let ranking = || caller.value(&format!("GET /v1/queries/{query}/ranking"), None).unwrap_or_default();
    let mut best = Value::Null;
    while !is_over() && best.is_null() {
        best = ranking()["entries"][0]["example"].clone();
        thread::sleep(REFUSED);
    }
    let map = json!({ "segment": 0, "example": best }).to_string();
    let composition = json!({ "density": 4 }).to_string();
    let all = [("maps?wait=60", map), ("compositions?wait=60", composition), ("retopos?wait=60", "{}".to_owned())];
    for (what, body) in all.into_iter().cycle().take(9) {
        let answer =
            caller.ask(&format!("POST /v1/queries/{query}/{what}"), Some(("application/json", body.as_bytes())));
        note(answer.map_or(0, |answer| answer.status));
        if is_over() {
            return;
        }
    }
}

/// An upload that is sent part by part and never ends; what it was answered.
fn held(caller: &Caller<'_>, is_over: &dyn Fn() -> bool) -> u16 {
    let address = caller.server.address();
    let Ok(mut stream) = TcpStream::connect(address) else { return 0 };
    let token = caller.token.as_deref().unwrap_or_default();
    let length = HELD_BYTES + 1;
    let head = format!(
        "POST /v1/queries HTTP/1.1\r\nhost: {address}\r\nauthorization: Bearer {token}\r\ncontent-type: model/obj\r\ncontent-length: {length}\r\n\r\n"
    );
    let part = vec![b'\n'; HELD_PART];
    let mut sent = stream.write_all(head.as_bytes());
    for _ in 0..HELD_BYTES / HELD_PART {
        sent = sent.and_then(|()| stream.write_all(&part));
    }
    let begun = Instant::now();
    while sent.is_ok() && !is_over() && begun.elapsed() < Duration::from_secs(20) {
        thread::sleep(REFUSED);
    }
    let _ = stream.set_read_timeout(Some(Duration::from_millis(200)));
    let mut answer = [0; 12];
    match std::io::Read::read_exact(&mut stream, &mut answer) {
        Ok(()) => std::str::from_utf8(&answer[9..]).ok().and_then(|status| status.parse().ok()).unwrap_or(0),
        Err(_) => 0,
    }
}
