//! What can go wrong in a command, what is said about it, and the exit code that follows.

use quadmuse_proto::{Code, Problem, QueryId};
use std::{error::Error, io, path::PathBuf};

/// Everything was done.
pub const EXIT_DONE: u8 = 0;
/// The service refused, or something failed.
pub const EXIT_FAILED: u8 = 1;
/// The command line is wrong (clap answers with the same code).
pub const EXIT_USAGE: u8 = 2;
/// No server could be reached.
pub const EXIT_UNREACHABLE: u8 = 3;
/// Ctrl-C ended the program (128 + SIGINT, as shells have it).
pub const EXIT_INTERRUPTED: u8 = 130;

/// Why a command could not be carried out.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// No connection to the server.
    #[error(
        "expected a Quadmuse server at {server}, found none that answers; start one with `quadmuse-server --data DIR`, or name another with --server or QUADMUSE_SERVER"
    )]
    Unreachable {
        /// The server's address.
        server: String,
        /// What the connection ran into.
        source: reqwest::Error,
    },
    /// The connection was lost, or nothing came in time.
    #[error(
        "expected an answer from {server}, found that the connection broke off; see whether the server still runs, then try again"
    )]
    BrokenOff {
        /// The server's address.
        server: String,
        /// What the connection ran into.
        source: reqwest::Error,
    },
    /// The connection was lost while a file was on its way.
    #[error(
        "expected {server} to take {bytes} bytes, found that it closed the connection before the last; the file may be larger than the server's --upload-limit"
    )]
    UploadBrokenOff {
        /// The server's address.
        server: String,
        /// Size of the body.
        bytes: usize,
        /// What the connection ran into.
        source: reqwest::Error,
    },
    /// Something answers that is no Quadmuse server, or one of another version.
    #[error(
        "expected {expected} from {url}, found {found}; see whether the address is that of a Quadmuse server, and of this version"
    )]
    Unintelligible {
        /// What was asked.
        url: String,
        /// What should have come.
        expected: &'static str,
        /// What came.
        found: String,
    },
    /// The service answered with a problem.
    #[error("{}", refusal(.0))]
    Refused(Box<Problem>),
    /// The server that has a query, one of several, is gone; another one said so.
    #[error("{}", refusal(.problem))]
    OwnerGone {
        /// The query.
        query: QueryId,
        /// What was answered.
        problem: Box<Problem>,
    },
    /// As [`ClientError::Refused`], where programs have already read the problem in an event.
    #[error("{}", refusal(.0))]
    InEvents(Box<Problem>),
    /// A map has no such constraint.
    #[error(
        "expected the id of a constraint that the map has ({known}), found `{found}`; leave the id out to add one: --set ON_EXAMPLE=ON_INPUT"
    )]
    NoSuchConstraint {
        /// The id.
        found: String,
        /// The ids that there are, with commas between.
        known: String,
        /// The service's answer.
        problem: Box<Problem>,
    },
    /// A file of landmarks holds none.
    #[error(
        "{}: expected JSON like [{{\"on_example\": [x, y, z], \"on_input\": [x, y, z]}}] or {{\"nose_tip\": [x, y, z]}}, found: {detail}",
        file.display()
    )]
    LandmarksInvalid {
        /// The file.
        file: PathBuf,
        /// Where it is wrong.
        detail: String,
    },
    /// An example has no landmark of a name.
    #[error("expected the name of a landmark that the example has ({known}), found `{found}`")]
    NoSuchLandmark {
        /// The name.
        found: String,
        /// The names that there are, with commas between.
        known: String,
    },
    /// Landmarks are to be found by name, and nothing says where those names are on the scan.
    #[error(
        "expected `--names FILE` beside `--landmarks names`: a file like {{\"nose_tip\": [x, y, z]}} with points of the scan"
    )]
    NamesMissing,
    /// The query was cancelled while it was followed.
    #[error("expected a ranking, found that query {query} was cancelled; start it again")]
    Cancelled {
        /// The query.
        query: String,
    },
    /// A map or composition was cancelled while it was waited for.
    #[error("expected a {product}, found that {id} was cancelled; ask for it again")]
    MakingCancelled {
        /// Whether it was to be a map or a composition.
        product: &'static str,
        /// Its id.
        id: String,
    },
    /// A segment has no entry to choose.
    #[error(
        "expected an example to lay on segment {segment}, found none in its ranking; add examples of its topology ({topology}), or name one"
    )]
    NothingRanked {
        /// The query's segment.
        segment: u32,
        /// Its topology.
        topology: String,
    },
    /// A query has fewer segments.
    #[error(
        "expected a segment below {segments}, found {segment}; `quadmuse ranking {query}` shows the query's segments"
    )]
    NoSuchSegment {
        /// The query.
        query: String,
        /// The segment asked for.
        segment: u32,
        /// Segments of the query.
        segments: usize,
    },
    /// Nothing has this name.
    #[error("expected {}, found `{found}`, which none has; {}", named_by(kind), listed_by(kind))]
    NoSuchName {
        /// The kind of thing sought: `example`, `query`, `map` or `segment`.
        kind: &'static str,
        /// The text.
        found: String,
    },
    /// Several things have this name, or begin with it.
    #[error("expected one {kind}, found `{found}`, which may be {candidates}; give {}", more_of(kind))]
    Ambiguous {
        /// The kind of thing sought: `example`, `query`, `map` or `segment`.
        kind: &'static str,
        /// The text.
        found: String,
        /// The things that the text may stand for, with commas between.
        candidates: String,
    },
    /// No query was started from here yet.
    #[error(
        "expected a query that was started on {server}, found that none is remembered; start one with `quadmuse query FILE`"
    )]
    NoLastQuery {
        /// The server's address.
        server: String,
    },
    /// An example has no segment of the topology asked for.
    #[error(
        "expected an example with a segment that is {article} {topology}, found none in {example}; choose another from `quadmuse ranking`"
    )]
    TopologyDiffers {
        /// The example.
        example: String,
        /// Topology of the query's segment.
        topology: String,
        /// `a` or `an`.
        article: &'static str,
    },
    /// Some of several files or examples were refused; each was named when it happened.
    #[error("{}", failures(*.failed, *.total))]
    SomeFailed {
        /// How many were refused.
        failed: usize,
        /// Out of how many.
        total: usize,
    },
    /// The result is no use as it is; it was written all the same.
    #[error("expected a mesh that can be used, found a broken one: {reasons}; it was written to {file} all the same")]
    Broken {
        /// The file.
        file: String,
        /// Why, with semicolons between.
        reasons: String,
    },
    /// The result is less than `--require` asks; it was written all the same.
    #[error(
        "expected a result that is {required} (--require), found {verdict}, {percent} % of it an example's; it was written to {file} all the same"
    )]
    Below {
        /// The word of the command line.
        required: &'static str,
        /// The result's verdict.
        verdict: &'static str,
        /// Share of it that is an example's.
        percent: String,
        /// The file.
        file: String,
    },
    /// Who was asked said no.
    #[error("nothing was {done}")]
    Declined {
        /// The action that was declined: `removed`, `written`.
        done: &'static str,
    },
    /// Files would be replaced, and nobody can be asked.
    #[error(
        "expected a file that is not there yet, or --force, found {files}, and no terminal to ask on; nothing was written"
    )]
    Occupied {
        /// Those that are there: the first, and how many more.
        files: String,
    },
    /// Many examples would go, and nobody can be asked.
    #[error("expected --yes, as there is no terminal to ask on, found none; {count} examples would be removed")]
    NotAsked {
        /// How many.
        count: usize,
    },
    /// One name for several files.
    #[error("expected one file with --name, found {files}; add them one by one, or name them by their files")]
    OneNameForMany {
        /// How many.
        files: usize,
    },
    /// There is no such command.
    #[error("expected a command of quadmuse, found `{found}`; `quadmuse help` lists them")]
    NoSuchCommand {
        /// The word.
        found: String,
    },
    /// No example has the tags.
    #[error("expected examples with {tags}, found none; `quadmuse list` shows all")]
    NoneTagged {
        /// `the tag x`, or `the tags x and y`.
        tags: String,
    },
    /// A folder of scans holds none.
    #[error(
        "expected mesh files in {}, found none; they end in .obj, .ply, .off, .stl, .gltf or .glb, with .gz behind it or without",
        folder.display()
    )]
    NoScans {
        /// The folder.
        folder: PathBuf,
    },
    /// A batch would overwrite its own scans.
    #[error("expected another folder to write to than that of the scans, found {} for both; give another with -o", folder.display())]
    SameFolder {
        /// The folder.
        folder: PathBuf,
    },
    /// A file cannot be read.
    #[error("expected a file that can be read at {}, found none; check the path and its permissions", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error("expected to write {}, found that it cannot be done; check that the folder exists and has room", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Standard output cannot be written.
    #[error("expected to print to standard output, found that it cannot be done")]
    Output(#[from] io::Error),
    /// The server's address is none.
    #[error("expected a server's address like http://127.0.0.1:7979, found `{found}`; {way_out}")]
    Address {
        /// What was given.
        found: String,
        /// What to do.
        way_out: &'static str,
    },
}

impl ClientError {
    /// The exit code of a command that ends with this error.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Unreachable { .. } | Self::BrokenOff { .. } => EXIT_UNREACHABLE,
            Self::Address { .. }
            | Self::NotAsked { .. }
            | Self::SameFolder { .. }
            | Self::OneNameForMany { .. }
            | Self::NoSuchCommand { .. } => EXIT_USAGE,
            Self::Output(source) if source.kind() == io::ErrorKind::BrokenPipe => EXIT_DONE,
            _ => EXIT_FAILED,
        }
    }

    /// Whether there is nothing to tell, or nobody: the one file that failed was told, or the reader of standard output has
    /// gone (as in `quadmuse list | head`).
    pub fn is_silent(&self) -> bool {
        match self {
            Self::Output(source) => source.kind() == io::ErrorKind::BrokenPipe,
            Self::SomeFailed { total, .. } => *total == 1,
            _ => false,
        }
    }

    /// The problem, if the service answered with one that has not been told yet.
    pub fn problem(&self) -> Option<&Problem> {
        match self {
            Self::Refused(problem) | Self::OwnerGone { problem, .. } | Self::NoSuchConstraint { problem, .. } => {
                Some(problem)
            }
            _ => None,
        }
    }

    /// The message with the innermost cause in brackets, on one line.
    pub fn message(&self) -> String {
        let mut cause = None;
        let mut next = self.source();
        while let Some(error) = next {
            cause = Some(error);
            next = error.source();
        }
        match cause {
            Some(cause) => printable(&format!("{self} ({cause})")),
            None => printable(&self.to_string()),
        }
    }
}

/// How many failed, and what became of the others.
fn failures(failed: usize, total: usize) -> String {
    match total.saturating_sub(failed) {
        0 => format!("all {total} failed"),
        1 => format!("{failed} of {total} failed; the other one is done"),
        others => format!("{failed} of {total} failed; the other {others} are done"),
    }
}

/// Tells how a thing of a kind is named.
fn named_by(kind: &str) -> String {
    match kind {
        "segment" => "the number or the name of a segment".into(),
        "example" => "the id of an example, its beginning or its name".into(),
        _ => format!("the id of a {kind}, its beginning or its name"),
    }
}

/// The words that tell one thing from others of like names.
fn more_of(kind: &str) -> &'static str {
    if kind == "segment" { "its number" } else { "more of its id" }
}

/// Where the names of a kind are to be seen.
fn listed_by(kind: &str) -> &'static str {
    match kind {
        "example" => "see `quadmuse list`",
        "query" => "`quadmuse query` prints it last; `@last` is the last",
        "segment" => "`quadmuse name QUERY` lists those of a query",
        _ => "`quadmuse map` prints it",
    }
}

/// A problem in one sentence: its detail, and the way out in this program's terms where the service can't know it.
fn refusal(problem: &Problem) -> String {
    let detail = if problem.detail.is_empty() { &problem.title } else { &problem.detail };
    let hint = match problem.code {
        Code::CorpusEmpty => "; `quadmuse list` shows what is there, `quadmuse add FILE…` adds",
        Code::Unauthorized => "; give a token with --token or QUADMUSE_TOKEN",
        Code::Overloaded | Code::Unavailable => "; try again later",
        Code::OwnerGone => ", or send the scan anew with `quadmuse query FILE`",
        _ => "",
    };
    let id = match (&problem.request_id, problem.status >= 500) {
        (Some(id), true) => format!(" [request {id}]"),
        _ => String::new(),
    };
    format!("{detail}{hint} ({}){id}", problem.code)
}

/// A text from outside without characters that would move a terminal's cursor or recolour it.
pub fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() && c != '\n' { '\u{fffd}' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_told_by_its_detail_and_code() {
        let problem = Problem::new(
            Code::MeshUnreadable,
            422,
            "expected a vertex number on line 7, found `x`; export the mesh again",
        );
        let error = ClientError::Refused(Box::new(problem));
        assert_eq!(
            error.message(),
            "expected a vertex number on line 7, found `x`; export the mesh again (mesh_unreadable)"
        );
        assert_eq!(error.exit_code(), EXIT_FAILED);
    }

    #[test]
    fn an_internal_error_names_the_request_for_the_log() {
        let mut problem = Problem::new(Code::Internal, 500, "the service failed");
        problem.request_id = Some("01R".into());
        assert_eq!(ClientError::Refused(Box::new(problem)).message(), "the service failed (internal) [request 01R]");
    }

    #[test]
    fn a_reader_that_has_gone_is_no_failure() {
        let gone = ClientError::Output(io::Error::from(io::ErrorKind::BrokenPipe));
        assert!(gone.is_silent());
        assert_eq!(gone.exit_code(), EXIT_DONE);
        assert_eq!(ClientError::Output(io::Error::from(io::ErrorKind::StorageFull)).exit_code(), EXIT_FAILED);
    }

    #[test]
    fn escape_sequences_from_outside_do_not_reach_the_terminal() {
        assert_eq!(printable("a\x1b[31mb\u{9b}c"), "a\u{fffd}[31mb\u{fffd}c");
    }

    #[test]
    fn nothing_is_said_of_others_where_there_are_none() {
        let said = |failed, total| ClientError::SomeFailed { failed, total }.message();
        assert_eq!(said(3, 3), "all 3 failed");
        assert_eq!(said(1, 2), "1 of 2 failed; the other one is done");
        assert_eq!(said(1, 4), "1 of 4 failed; the other 3 are done");
        // The only one was told when it happened.
        assert!(ClientError::SomeFailed { failed: 1, total: 1 }.is_silent());
        assert!(!ClientError::SomeFailed { failed: 2, total: 2 }.is_silent());
    }
}
