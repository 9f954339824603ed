//! Maps that are asked for while parts of a cluster are killed, and what comes in their place.
//!
//! The answer to each is a map that has the faces of its example, or a problem with a code that tells the caller what to do,
//! within its time. Whoever asks a server that is killed itself has no answer, and that is no fault either.

use crate::{
    http::{self, Answer},
    shapes::{self, Faces},
};
use quadmuse_proto::{
    Code, Entry, Making, MakingState, Map, MapOrMaking, NewMap, Problem, Query, QueryState, Ranking,
    problem::MEDIA_TYPE,
};
use std::{
    collections::BTreeMap,
    io,
    net::SocketAddr,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// Servers of the cluster, each at its address, or none while it is killed.
pub type Addresses = Mutex<Vec<Option<SocketAddr>>>;

/// Maps that are asked of one query.
const EACH: usize = 4;
/// For so long an answer is held, in seconds.
const WAIT_S: u64 = 20;
/// Longest time for an answer beyond the time for which it is held: a server that is gone is told within two seconds, and
/// those that are asked are stopped for a while, too.
const GRACE: Duration = Duration::from_secs(10);
/// Longest time until a map that is looked for is there.
const THERE_WITHIN: Duration = Duration::from_secs(60);
/// Longest time until the query of the maps is done.
const RANKED_WITHIN: Duration = Duration::from_secs(30);
/// Pause between two looks.
const PAUSE: Duration = Duration::from_millis(100);

/// The mesh that a writer adds as an example at a turn. No two are the same, nor do those of three turns have the same faces.
pub fn example(writer: u32, turn: usize) -> String {
    let around = 8 + 2 * u32::try_from(turn % 3).unwrap_or_default();
    format!("# {writer} {turn}\n{}", shapes::vase(writer, around, 4, Faces::Quads))
}

/// The name of that example.
pub fn name(writer: u32, turn: usize) -> String {
    format!("w{writer}t{turn}")
}

/// The mesh of an example of this name, whatever its revision.
fn example_named(name: &str) -> Option<String> {
    let (writer, rest) = name.strip_prefix('w')?.split_once('t')?;
    let turn = rest.split_once('r').map_or(rest, |(turn, _)| turn);
    Some(example(writer.parse().ok()?, turn.parse().ok()?))
}

/// The server whose turn it is; `None` while it is killed.
pub fn some(addresses: &Addresses, turn: usize) -> Option<SocketAddr> {
    let all = addresses.lock().unwrap_or_else(PoisonError::into_inner);
    all.get(turn % all.len().max(1)).copied().flatten()
}

fn is_there(addresses: &Addresses, address: SocketAddr) -> bool {
    addresses.lock().unwrap_or_else(PoisonError::into_inner).contains(&Some(address))
}

/// What came of the maps.
#[derive(Default)]
pub struct Maps(Mutex<Counts>);

#[derive(Default)]
struct Counts {
    there: u64,
    /// Problems by their code.
    problems: BTreeMap<&'static str, u64>,
    /// Asked of a server that was killed meanwhile.
    unanswered: u64,
    faults: u64,
    /// The longest time that an answer took beyond the time for which it was held.
    longest: Duration,
}

/// What a map that was asked for came to.
#[derive(Debug, PartialEq)]
enum End {
    There,
    Problem(Code),
    Unanswered,
    Fault(String),
}

impl Maps {
    fn note(&self, end: End) {
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match end {
            End::There => counts.there += 1,
            End::Problem(code) => *counts.problems.entry(code.as_str()).or_default() += 1,
            End::Unanswered => counts.unanswered += 1,
            End::Fault(why) => {
                counts.faults += 1;
                eprintln!("a map: {why}");
            }
        }
    }

    fn took(&self, beyond: Duration) {
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        counts.longest = counts.longest.max(beyond);
    }

    /// The counts in a line, and whether all was as it should be: some maps came, and nothing else than is told here.
    pub fn summary(&self) -> (String, bool) {
        let counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let problems = counts.problems.iter().map(|(code, count)| format!("{count} {code}")).collect::<Vec<_>>();
        let problems = if problems.is_empty() { "none".to_owned() } else { problems.join(", ") };
        let Counts { there, unanswered, faults, longest, .. } = &*counts;
        let line = format!(
            "maps: {there} there, with their examples' faces; problems: {problems}; {unanswered} asked of a server that was killed; \
             {faults} faults; longest answer {:.1} s more than it was held",
            longest.as_secs_f64()
        );
        (line, *there > 0 && *faults == 0)
    }
}

/// Asks for maps of queries of one server through the others, until it is over. Maps of the first caller's scan are soon
/// there; the others' have as many faces as a scan has, so that servers die while maps are made.
pub fn ask(caller: usize, addresses: &Addresses, maps: &Maps, is_over: &AtomicBool) {
    let [around, up] = if caller == 0 { [16, 6] } else { [48, 16] };
    let scan = shapes::vase(1, around, up, Faces::Triangles);
    for turn in caller.. {
        if is_over.load(Ordering::Relaxed) {
            return;
        }
        std::thread::sleep(PAUSE);
        let Some((query, entries)) = ranked(addresses, turn, &scan) else { continue };
        for (k, entry) in entries.iter().filter(|entry| example_named(&entry.name).is_some()).take(EACH).enumerate() {
            // Both servers that don't have it are asked; one holds its answer, and of the other the map is looked for.
            let asking = Asking { addresses, maps, turn: turn + 1 + k % 2, wait: WAIT_S * (k as u64 % 2) };
            let end = asking.map(&query, entry);
            let is_gone = matches!(end, Some(End::Problem(_)));
            end.into_iter().for_each(|end| maps.note(end));
            if is_gone {
                break;
            }
        }
    }
}

/// A query of one server, ranked: its path, and the entries of its ranking.
fn ranked(addresses: &Addresses, turn: usize, scan: &str) -> Option<(String, Vec<Entry>)> {
    let posted = http::post(some(addresses, turn)?, "/v1/queries?resolution=32", "model/obj", scan.as_bytes()).ok()?;
    let path = posted.header("location").filter(|_| posted.status == 202)?.to_owned();
    let begun = Instant::now();
    while begun.elapsed() < RANKED_WITHIN {
        std::thread::sleep(PAUSE);
        let Some(Ok(answer)) = some(addresses, turn + 1).map(|other| http::get(other, &path)) else { continue };
        // Another caller counts what queries come to.
        let query: Query = serde_json::from_slice(&answer.body).ok()?;
        if query.state == QueryState::Done {
            let answer = http::get(some(addresses, turn + 1)?, &format!("{path}/ranking")).ok()?;
            return Some((path, serde_json::from_slice::<Ranking>(&answer.body).ok()?.entries));
        }
    }
    None
}

/// A caller who asks one server for a map.
struct Asking<'a> {
    addresses: &'a Addresses,
    maps: &'a Maps,
    /// Tells which server is asked.
    turn: usize,
    /// For so long the first answer is held, in seconds.
    wait: u64,
}

impl Asking<'_> {
    /// A map of an entry; `None` where there is nobody to ask.
    fn map(&self, query: &str, entry: &Entry) -> Option<End> {
        let server = some(self.addresses, self.turn)?;
        let wanted = serde_json::to_vec(&NewMap::new(0, entry.example, entry.example_segment)).ok()?;
        let begun = Instant::now();
        let path = format!("{query}/maps?wait={}", self.wait);
        let posted = self.timed(self.wait, || http::post(server, &path, "application/json", &wanted));
        let mut shown = match posted {
            Ok(answer) => read(&answer),
            // It is not known whether the map is made.
            Err(end) => return Some(self.unanswered(server, end)),
        };
        loop {
            let making = match shown {
                MapAnswer::Map(map) => return Some(self.checked(query, &map, entry)),
                MapAnswer::Making(making) if begun.elapsed() < THERE_WITHIN => making,
                MapAnswer::Making(making) => {
                    let (state, stage) = (making.state, making.stage);
                    return Some(End::Fault(format!("{state:?} ({stage}) after {THERE_WITHIN:?}")));
                }
                MapAnswer::End(end) => return Some(end),
            };
            std::thread::sleep(PAUSE);
            // As behind a proxy, another server is asked where this one was killed.
            let Some(server) = some(self.addresses, self.turn).or_else(|| some(self.addresses, self.turn + 1)) else {
                shown = MapAnswer::Making(making);
                continue;
            };
            let path = format!("{query}/maps/{}?wait={}", making.id, WAIT_S);
            shown = match self.timed(WAIT_S, || http::get(server, &path)) {
                Ok(answer) => read(&answer),
                Err(end) => match self.unanswered(server, end) {
                    End::Unanswered => MapAnswer::Making(making),
                    fault => return Some(fault),
                },
            };
        }
    }

    /// An answer, in time.
    fn timed(&self, wait: u64, ask: impl FnOnce() -> io::Result<Answer>) -> Result<Answer, End> {
        let begun = Instant::now();
        let answer = ask();
        let beyond = begun.elapsed().saturating_sub(Duration::from_secs(wait));
        if beyond > GRACE {
            return Err(End::Fault(format!("{:.1} s until {answer:?}", begun.elapsed().as_secs_f64())));
        }
        self.maps.took(beyond);
        answer.map_err(|error| End::Fault(format!("no answer, {error}")))
    }

    /// What it means that there was no answer: nothing where the server that was asked is no longer there.
    fn unanswered(&self, server: SocketAddr, end: End) -> End {
        match end {
            _ if !is_there(self.addresses, server) => End::Unanswered,
            End::Fault(why) => End::Fault(format!("{server}: {why}")),
            end => end,
        }
    }

    /// A map whose mesh is compared with its example's.
    fn checked(&self, query: &str, map: &Map, entry: &Entry) -> End {
        if (map.example, map.example_segment) != (entry.example, entry.example_segment) {
            return End::Fault(format!("of {} in place of {}", map.example, entry.example));
        }
        let Some(server) = some(self.addresses, self.turn) else { return End::Unanswered };
        let mesh = match self.timed(0, || http::get(server, &format!("{query}/maps/{}/mesh?format=obj", map.id))) {
            Ok(answer) if answer.status == 200 => answer.text(),
            Ok(answer) => return problem(&answer),
            Err(end) => return self.unanswered(server, end),
        };
        let example = example_named(&entry.name).unwrap_or_default();
        match has_faces_of(&example, &mesh, [map.own_faces, map.faces], map.kept.as_deref()) {
            Ok(()) => End::There,
            Err(why) => End::Fault(format!("{} of {}: {why}", map.id, entry.name)),
        }
    }
}

/// What an answer says of a map.
#[derive(Debug)]
enum MapAnswer {
    Map(Box<Map>),
    Making(Making),
    End(End),
}

fn read(answer: &Answer) -> MapAnswer {
    if !(200..300).contains(&answer.status) {
        return MapAnswer::End(problem(answer));
    }
    match serde_json::from_slice(&answer.body) {
        Ok(MapOrMaking::There(map)) => MapAnswer::Map(map),
        Ok(MapOrMaking::Making(Making { problem: Some(problem), .. })) => MapAnswer::End(judged(problem.code)),
        Ok(MapOrMaking::Making(making)) if making.state == MakingState::Cancelled => {
            MapAnswer::End(End::Fault("cancelled, which nobody asked for".into()))
        }
        Ok(MapOrMaking::Making(making)) => MapAnswer::Making(making),
        Err(error) => MapAnswer::End(End::Fault(format!("{} and no map: {error}", answer.status))),
    }
}

/// A problem that tells its caller what to do; anything else is a fault.
fn problem(answer: &Answer) -> End {
    let status = answer.status;
    let is_typed = answer.header("content-type") == Some(MEDIA_TYPE);
    let Ok(problem) = serde_json::from_slice::<Problem>(&answer.body) else {
        return End::Fault(format!("{status} without a problem: {:?}", answer.text()));
    };
    let passes = status == 503 || status == 429;
    if !is_typed || problem.status != status || (passes && answer.header("retry-after").is_none()) {
        return End::Fault(format!("{status} with {:?}: {problem}", answer.headers));
    }
    match judged(problem.code) {
        End::Fault(_) => End::Fault(format!("{status}, {problem}")),
        end => end,
    }
}

/// The codes that a caller may meet who did nothing wrong: a server is gone or busy, or it took too long.
fn judged(code: Code) -> End {
    match code {
        Code::OwnerGone | Code::Unavailable | Code::Overloaded | Code::Timeout | Code::Deadline => End::Problem(code),
        other => End::Fault(other.to_string()),
    }
}

/// Compares the faces of a map's mesh with those of its example, as OBJ. Of the mesh's faces so many are the example's, of
/// vertices that were `kept`, or of all of them.
fn has_faces_of(example: &str, mesh: &str, [own, total]: [u64; 2], kept: Option<&[u32]>) -> Result<(), String> {
    let (of, all) = (faces(example), faces(mesh));
    let first = usize::try_from(own).ok().and_then(|count| all.get(..count));
    let Some(first) = first.filter(|first| !first.is_empty() && all.len() as u64 == total) else {
        return Err(format!("{total} faces, {own} of them its example's, in a mesh of {}", all.len()));
    };
    if kept.is_none() && first.len() != of.len() {
        return Err(format!("all vertices, and {own} of {} faces", of.len()));
    }
    let vertex = |v: &u32| kept.map_or(Some(*v), |kept| kept.get(*v as usize).copied());
    let mut rest = of.iter();
    for face in first {
        let corners: Option<Vec<u32>> = face.iter().map(vertex).collect();
        let found = corners.map(ordered);
        if !rest.any(|face| found.as_ref() == Some(face)) {
            return Err(format!("a face {face:?} that its example does not have there"));
        }
    }
    Ok(())
}

/// The corners of each face of an OBJ, from 0.
fn faces(obj: &str) -> Vec<Vec<u32>> {
    let corner = |word: &str| word.split('/').next()?.parse::<u32>().ok()?.checked_sub(1);
    let face = |line: &str| line.strip_prefix("f ").map(|words| words.split_whitespace().filter_map(corner).collect());
    obj.lines().filter_map(face).map(ordered).collect()
}

/// The same face from its lowest corner on, in the direction of the lower neighbour: a map may be mirrored.
fn ordered(mut face: Vec<u32>) -> Vec<u32> {
    let lowest = (0..face.len()).min_by_key(|&k| face[k]).unwrap_or_default();
    face.rotate_left(lowest);
    if face.len() > 2 && face[1] > face[face.len() - 1] {
        face[1..].reverse();
    }
    face
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(status: u16, headers: &[(&str, &str)], body: &str) -> Answer {
        let headers = headers.iter().map(|&(name, value)| (name.to_owned(), value.to_owned())).collect();
        Answer { status, headers, body: body.as_bytes().to_vec() }
    }

    fn judged_answer(code: Code, status: u16, headers: &[(&str, &str)]) -> End {
        let body = serde_json::to_string(&Problem::new(code, status, "expected")).expect("prints");
        problem(&answer(status, headers, &body))
    }

    #[test]
    fn only_a_problem_that_says_what_to_do_is_one() {
        let typed = ("content-type", MEDIA_TYPE);
        assert_eq!(judged_answer(Code::OwnerGone, 503, &[typed, ("retry-after", "2")]), End::Problem(Code::OwnerGone));
        assert_eq!(judged_answer(Code::Deadline, 504, &[typed]), End::Problem(Code::Deadline));
        let faults = [
            judged_answer(Code::OwnerGone, 503, &[typed]),
            judged_answer(Code::OwnerGone, 503, &[("retry-after", "2")]),
            judged_answer(Code::Internal, 500, &[typed]),
            judged_answer(Code::NotFound, 404, &[typed]),
            problem(&answer(502, &[], "<html>Bad gateway</html>")),
        ];
        assert!(faults.iter().all(|end| matches!(end, End::Fault(_))), "{faults:?}");
    }

    #[test]
    fn a_map_has_its_examples_faces_in_their_order_and_no_others() {
        let example = "f 1 2 3 4\nf 3 4 5 6\nf 5 6 7 8\n";
        let holds = |mesh: &str, own: u64, all: u64, kept: Option<&[u32]>| {
            has_faces_of(example, mesh, [own, all], kept).is_ok()
        };
        assert!(holds("f 1/1 2/2 3/3 4/4\nf 3 4 5 6\nf 5 6 7 8\n", 3, 3, None));
        assert!(holds("f 4 3 2 1\nf 6 5 4 3\nf 8 7 6 5\n", 3, 3, None), "mirrored");
        assert!(holds("f 1 2 3 4\nf 3 4 5 6\n", 1, 2, Some(&[2, 3, 4, 5])), "one face is left, and one is new");
        assert!(!holds("f 1 3 2 4\nf 3 4 5 6\nf 5 6 7 8\n", 3, 3, None), "two corners are exchanged");
        assert!(!holds("f 3 4 5 6\nf 1 2 3 4\nf 5 6 7 8\n", 3, 3, None), "two faces are exchanged");
        assert!(!holds("f 1 2 3 4\nf 3 4 5 6\n", 2, 2, None), "a face is missing");
        assert!(!holds("f 1 2 3 4\n", 1, 1, Some(&[0, 1])), "of vertices that were not kept");
        assert!(!holds("", 0, 0, None), "nothing is there");
    }

    #[test]
    fn an_example_is_known_by_its_name() {
        assert_eq!(example_named(&name(2, 31)), Some(example(2, 31)));
        assert_eq!(example_named("w2t31r2"), Some(example(2, 31)));
        assert_eq!(example_named("regular layout"), None);
        assert_ne!(faces(&example(1, 1)), faces(&example(1, 2)));
    }
}
