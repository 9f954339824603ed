//! The command line: verbs, flags, and the environment variables behind them.

use crate::{
    file::OutFile,
    spec::{ConstraintSpec, ExampleRef, LandmarkSpec, Name, Require, SegmentsSpec, TagEdit, UsePart},
};
use clap::{Args, Parser, Subcommand};
use quadmuse_proto::{
    Beyond, Components, OnFold, Topology, composition, example::RELEVANCE_RANGE, query, segment::Parts,
};
use std::{ffi::OsString, path::PathBuf};

/// The address when none is given.
pub const SERVER_DEFAULT: &str = "http://127.0.0.1:7979";

/// Finds quad layouts that artists made, and lays them on your shape.
#[derive(Debug, Parser)]
#[command(name = "quadmuse", version, max_term_width = 100, after_help = AFTER_HELP)]
pub struct Cli {
    /// Address of the server
    #[arg(long, global = true, env = "QUADMUSE_SERVER", value_name = "URL", default_value = SERVER_DEFAULT)]
    pub server: String,
    /// Token, where the server wants one
    #[arg(long, global = true, env = "QUADMUSE_TOKEN", value_name = "T", hide_env_values = true)]
    pub token: Option<String>,
    /// Folder for what is remembered between commands: the last query, for `@last` [default: quadmuse in XDG_STATE_HOME, or
    /// in ~/.local/state]
    #[arg(long, global = true, env = "QUADMUSE_STATE", value_name = "DIR")]
    pub state: Option<PathBuf>,
    /// Print JSON instead of tables: one value, or one a line
    #[arg(long, global = true)]
    pub json: bool,
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

impl Cli {
    /// Reads a command line, the program's name first.
    ///
    /// # Errors
    /// What clap says to people, and the exit code it wants.
    pub fn read(words: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        Self::try_parse_from(edits_last(words.into_iter().collect()))
    }
}

/// Puts a `--` before the words of `tag` that are no flags, so that `-TAG` isn't taken for one wherever it stands.
fn edits_last(words: Vec<OsString>) -> Vec<OsString> {
    let is_flag = |word: &OsString| word.to_string_lossy().starts_with("--") || word == "-h";
    let takes_value = |word: &OsString| word == "--server" || word == "--token" || word == "--state";
    let (mut flags, mut others) = (Vec::new(), Vec::new());
    let mut rest = words.into_iter();
    flags.extend(rest.next());
    let mut verb = None;
    while let Some(word) = rest.next() {
        if word == "--" && verb == Some(true) {
            // One of these is enough.
        } else if is_flag(&word) {
            let value = takes_value(&word);
            flags.push(word);
            flags.extend(value.then(|| rest.next()).flatten());
        } else if verb.is_none() {
            verb = Some(word == "tag");
            flags.push(word);
        } else if verb == Some(true) {
            others.push(word);
        } else {
            // Another verb: all stays as it is.
            flags.push(word);
        }
    }
    if !others.is_empty() {
        flags.push("--".into());
    }
    flags.extend(others);
    flags
}

const AFTER_HELP: &str = "Wherever an id is asked for, its beginning will do where it is the only one; for an example also its \
     name, or the beginning of that; for a query also @last, the last one that was started.\n\n\
     Exit codes: 0 done, 1 refused or failed, 2 wrong usage, 3 server out of reach.";

/// The verbs.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Add meshes to the corpus
    Add(AddArgs),
    /// List the corpus
    List(ListArgs),
    /// Show an example
    Show {
        /// The example
        #[arg(value_name = "ID")]
        id: Name,
    },
    /// Remove examples from the corpus
    Remove {
        /// The examples
        #[arg(value_name = "ID", required = true)]
        ids: Vec<Name>,
    },
    /// Set an example's relevance
    Rate {
        /// The example
        #[arg(value_name = "ID")]
        id: Name,
        /// Its relevance, 0 to 5
        #[arg(value_name = "R", value_parser = relevance, allow_negative_numbers = true)]
        relevance: f64,
    },
    /// Add tags to an example (+TAG) and take tags off it (-TAG)
    Tag {
        /// The example
        #[arg(value_name = "ID")]
        id: Name,
        /// `+TAG` adds, `-TAG` takes off; without any, the tags are shown
        #[arg(value_name = "+T|-T")]
        edits: Vec<TagEdit>,
    },
    /// Rank the corpus against a mesh
    Query(QueryCommand),
    /// Show the ranking of a query
    Ranking(RankingArgs),
    /// Lay an example on the input, and write the mesh
    Map(MapArgs),
    /// Edit the constraints of a map, and write the new mesh
    Constrain(ConstrainArgs),
    /// Stitch the maps of a query's segments into one mesh of quads
    Compose(ComposeCommand),
    /// All in one go: upload, rank, map or compose, download
    Retopo(RetopoArgs),
}

/// `add`.
#[derive(Debug, Args)]
pub struct AddArgs {
    /// Mesh files: OBJ, PLY, OFF, STL, glTF
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// A tag for all of them (may be repeated)
    #[arg(long = "tag", value_name = "T")]
    pub tags: Vec<String>,
    /// Their relevance, 0 to 5
    #[arg(long, value_name = "R", value_parser = relevance, allow_negative_numbers = true)]
    pub relevance: Option<f64>,
    /// How to cut them into segments
    #[command(flatten)]
    pub segments: SegmentsArg,
}

/// `--segments`, shared by everything that uploads.
#[derive(Clone, Debug, Default, Args)]
pub struct SegmentsArg {
    /// `auto`, `whole`, `groups`, or a file with one integer a face, one a line
    #[arg(long = "segments", value_name = "auto|whole|groups|FILE")]
    pub segments: Option<SegmentsSpec>,
    /// Segments that the server aims at when it cuts: a number from 1 to 64, or `auto`, one a protrusion [default: as
    /// few as can be]
    #[arg(long, value_name = "N|auto")]
    pub parts: Option<Parts>,
    /// What becomes of small components beside the largest: `largest` leaves them out, `refuse` refuses the mesh
    /// [default: largest]
    #[arg(long, value_name = "largest|refuse")]
    pub components: Option<Components>,
}

/// `list`.
#[derive(Debug, Args)]
pub struct ListArgs {
    /// Only examples with this tag (may be repeated: with all of them)
    #[arg(long = "tag", value_name = "T")]
    pub tags: Vec<String>,
    /// Only examples with a segment of this topology: disc, annulus, sphere, torus
    #[arg(long, value_name = "T")]
    pub topology: Option<Topology>,
}

/// The flags of an upload that is to be ranked.
#[derive(Clone, Debug, Args)]
pub struct QueryArgs {
    /// The mesh: OBJ, PLY, OFF, STL, glTF
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Entries a segment that are ranked at full resolution [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(query::TOP_MAX)))]
    pub top: Option<u32>,
    /// Only examples with this tag (may be repeated: with all of them)
    #[arg(long = "tag", value_name = "T")]
    pub tags: Vec<String>,
    /// The finest level: 32, 64, 128, 256 or 512 pixels a side [default: 128]
    #[arg(long, value_name = "R", value_parser = resolution)]
    pub resolution: Option<u32>,
    /// Seconds after which the best ranking so far will do
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub deadline: Option<f64>,
    /// Cut the mesh as this example is cut; `retopo` then lays that example on each segment
    #[arg(long, value_name = "EXAMPLE", conflicts_with_all = ["segments", "parts"])]
    pub like: Option<Name>,
    /// How to cut the mesh into segments
    #[command(flatten)]
    pub segments: SegmentsArg,
}

/// `query`.
#[derive(Debug, Args)]
pub struct QueryCommand {
    /// What to upload, and how to rank it
    #[command(flatten)]
    pub query: QueryArgs,
    /// Only upload, and print the query's id
    #[arg(long)]
    pub no_follow: bool,
}

/// `ranking`.
#[derive(Debug, Args)]
pub struct RankingArgs {
    /// The query
    #[arg(value_name = "QUERY")]
    pub query: Name,
    /// Only this segment
    #[arg(long, value_name = "N")]
    pub segment: Option<u32>,
    /// Follow it until it is final
    #[arg(long)]
    pub follow: bool,
}

/// `map`.
#[derive(Debug, Args)]
pub struct MapArgs {
    /// The query
    #[arg(value_name = "QUERY")]
    pub query: Name,
    /// The example, or `EXAMPLE:SEGMENT` [default: the best entry of the ranking]
    #[arg(value_name = "EXAMPLE")]
    pub example: Option<ExampleRef<Name>>,
    /// The query's segment
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub segment: u32,
    /// Where the input reaches beyond the example: `extend` continues the example's boundary by rows of quads, `leave` writes the example's
    /// faces alone
    #[arg(long, value_name = "extend|leave", value_parser = beyond, default_value = "leave")]
    pub beyond: Beyond,
    /// A file for the numbers of the example's vertices that were kept, from 0, one a line: others lie beyond the input
    #[arg(long, value_name = "FILE")]
    pub kept: Option<PathBuf>,
    /// A point of the example and the point of the scan where it belongs; may repeat. From three on they fix the pose. Ends as
    /// with `constrain --set`
    #[arg(long = "landmark", value_name = "X,Y,Z=X,Y,Z", allow_hyphen_values = true)]
    pub landmark: Vec<LandmarkSpec>,
    /// A file of landmarks: JSON, a list of `{"on_example": [x, y, z], "on_input": [x, y, z], "name": …}`
    #[arg(long, value_name = "FILE")]
    pub landmarks: Option<PathBuf>,
    /// Exit with 1 where the result is less than this; it is written all the same. `inspired`: more than half of its area
    /// has an example's quads; `fair`, `good`: its verdict is that or better. A broken result always exits with 1
    #[arg(long, value_name = "inspired|fair|good")]
    pub require: Option<Require>,
    /// The file to write; its extension chooses the format: obj, ply, off, stl, glb
    #[arg(short, long = "out", value_name = "OUT")]
    pub out: OutFile,
}

/// `constrain`.
#[derive(Debug, Args)]
pub struct ConstrainArgs {
    /// The query
    #[arg(value_name = "QUERY")]
    pub query: Name,
    /// The map
    #[arg(value_name = "MAP")]
    pub map: Name,
    /// `[ID:]ON_EXAMPLE=ON_INPUT`, each end `x,y,z` or `uU,vV` or `fFACE/w,w,w`; or the constraint as JSON
    #[arg(long = "set", value_name = "SPEC", required_unless_present_any = ["remove", "undo"], allow_hyphen_values = true)]
    pub set: Vec<ConstraintSpec>,
    /// A constraint to remove
    #[arg(long = "remove", value_name = "ID")]
    pub remove: Vec<String>,
    /// A constraint to put back as the registration had it; one that was added goes
    #[arg(long = "undo", value_name = "ID")]
    pub undo: Vec<String>,
    /// Where the map would fold: `refuse` the edit, or `resolve`: constraints that are not named make room
    #[arg(long, value_name = "refuse|resolve", value_parser = on_fold, default_value = "refuse")]
    pub on_fold: OnFold,
    /// The file to write; its extension chooses the format: obj, ply, off, stl, glb
    #[arg(short, long = "out", value_name = "OUT")]
    pub out: OutFile,
}

/// The flags of a composition.
#[derive(Clone, Debug, Args)]
pub struct ComposeArgs {
    /// `SEGMENT=EXAMPLE` or `SEGMENT=EXAMPLE:SEGMENT`: this example in place of the best (may be repeated)
    #[arg(long = "use", value_name = "SEGMENT=EXAMPLE")]
    pub uses: Vec<UsePart<Name>>,
    /// Rounds of smoothing [default: 5]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=i64::from(composition::SMOOTHING_MAX)))]
    pub smoothing: Option<u32>,
    /// Steps by which the quads are denser (each doubles rows and columns) or, below 0, coarser than the examples'
    #[arg(long, value_name = "STEPS", allow_negative_numbers = true, value_parser = clap::value_parser!(i32).range(-i64::from(composition::DENSITY_MAX)..=i64::from(composition::DENSITY_MAX)))]
    pub density: Option<i32>,
    /// Where the input reaches beyond the example: `extend` continues the example's boundary by rows of quads, `leave` writes the example's
    /// faces alone
    #[arg(long, value_name = "extend|leave", value_parser = beyond, default_value = "extend")]
    pub beyond: Beyond,
    /// A file for the numbers of the example's vertices that were kept, from 0, one a line: others lie beyond the input
    #[arg(long, value_name = "FILE")]
    pub kept: Option<PathBuf>,
    /// Exit with 1 where the result is less than this; it is written all the same. `inspired`: more than half of its area
    /// has an example's quads; `fair`, `good`: its verdict is that or better. A broken result always exits with 1
    #[arg(long, value_name = "inspired|fair|good")]
    pub require: Option<Require>,
    /// The file to write; its extension chooses the format: obj, ply, off, stl, glb
    #[arg(short, long = "out", value_name = "OUT")]
    pub out: OutFile,
}

/// `compose`.
#[derive(Debug, Args)]
pub struct ComposeCommand {
    /// The query
    #[arg(value_name = "QUERY")]
    pub query: Name,
    /// What to stitch, and where to write it
    #[command(flatten)]
    pub compose: ComposeArgs,
}

/// `retopo`.
#[derive(Debug, Args)]
pub struct RetopoArgs {
    /// What to upload, and how to rank it
    #[command(flatten)]
    pub query: QueryArgs,
    /// What to lay on it, and where to write it
    #[command(flatten)]
    pub compose: ComposeArgs,
}

fn beyond(text: &str) -> Result<Beyond, String> {
    match text {
        "extend" => Ok(Beyond::Extend),
        "leave" => Ok(Beyond::Leave),
        _ => Err("expected extend or leave".into()),
    }
}

fn on_fold(text: &str) -> Result<OnFold, String> {
    match text {
        "refuse" => Ok(OnFold::Refuse),
        "resolve" => Ok(OnFold::Resolve),
        _ => Err("expected refuse or resolve".into()),
    }
}

fn relevance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if RELEVANCE_RANGE.contains(&value) => Ok(value),
        _ => Err(format!("expected a relevance from {} to {}", RELEVANCE_RANGE.start(), RELEVANCE_RANGE.end())),
    }
}

fn resolution(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(value) if query::LEVELS.contains(&value) => Ok(value),
        _ => Err(format!("expected one of {:?}", query::LEVELS)),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds_max = query::DEADLINE_MS_MAX as f64 / 1000.0;
    match text.parse::<f64>() {
        Ok(value) if value >= 0.001 && value <= seconds_max => Ok(value),
        _ => Err(format!("expected seconds, from 0.001 to {seconds_max}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    const ID: &str = "01ARZ3NDEKTSV4RRFFQ69G5FAV";

    fn parse(line: &str) -> Result<Cli, clap::Error> {
        Cli::read(line.replace("ID", ID).split_whitespace().map(OsString::from))
    }

    #[test]
    fn the_commands_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_verb_of_the_interface_is_there() {
        for line in [
            "quadmuse add a.obj b.ply --tag head --tag hero --relevance 4 --segments whole",
            "quadmuse add a.obj --parts 8",
            "quadmuse retopo a.obj -o b.obj --parts auto",
            "quadmuse query a.obj --components refuse",
            "quadmuse retopo a.obj -o b.obj --like ID",
            "quadmuse constrain ID ID --undo f2 -o out.obj",
            "quadmuse constrain ID ID --set f1:1,2,3=4,5,6 --on-fold resolve -o out.obj",
            "quadmuse list --tag head --topology disc",
            "quadmuse show ID",
            "quadmuse remove ID ID",
            "quadmuse rate ID 4.5",
            "quadmuse tag ID +hero -wip",
            "quadmuse query a.ply --top 4 --tag head --resolution 128 --deadline 2.5 --segments groups --no-follow",
            "quadmuse ranking ID --segment 1 --follow",
            "quadmuse map ID -o out.obj",
            "quadmuse map ID ID --segment 2 -o out.ply",
            "quadmuse constrain ID ID --set 1,2,3=4,5,6 --remove f3 -o out.glb",
            "quadmuse map ID -o out.obj --require inspired",
            "quadmuse compose ID -o out.obj --require fair",
            "quadmuse retopo scan.ply -o out.obj --require good",
            "quadmuse compose ID --use 0=ID --use 1=ID:2 -o out.off",
            "quadmuse retopo scan.ply -o out.obj --top 8 --use 0=ID --smoothing 3",
            "quadmuse --server http://x:1 --token t --json list",
            "quadmuse list --json --server http://x:1",
        ] {
            assert!(parse(line).is_ok(), "{line}: {}", parse(line).expect_err("just seen"));
        }
    }

    #[test]
    fn wrong_usage_is_refused_with_exit_code_2() {
        for line in [
            "quadmuse",
            "quadmuse add",
            "quadmuse add a.obj --relevance 6",
            "quadmuse add a.obj --relevance -1",
            "quadmuse show",
            "quadmuse query a.obj --resolution 100",
            "quadmuse query a.obj --deadline nan",
            "quadmuse query a.obj --top 0",
            "quadmuse map ID",
            "quadmuse map ID -o out.docx",
            "quadmuse constrain ID ID -o out.obj",
            "quadmuse constrain ID ID --set 1,2=3,4,5 -o out.obj",
            "quadmuse constrain ID ID --on-fold resolve -o out.obj",
            "quadmuse constrain ID ID --remove f1 --on-fold bend -o out.obj",
            "quadmuse query a.obj --components all",
            "quadmuse query a.obj --like ID --parts auto",
            "quadmuse map ID -o out.obj --require poor",
            "quadmuse compose ID --use ID -o out.obj",
            "quadmuse tag ID hero",
            "quadmuse list --topology klein",
        ] {
            let error = parse(line).expect_err(line);
            assert_eq!(error.exit_code(), i32::from(crate::error::EXIT_USAGE), "{line}");
        }
    }

    #[test]
    fn a_tag_may_be_taken_off_although_it_looks_like_a_flag() {
        for line in [
            "quadmuse tag ID -wip +hero",
            "quadmuse tag ID -wip --json +hero --server http://x",
            "quadmuse --server tag tag ID -- -wip +hero",
        ] {
            let Command::Tag { edits, .. } = parse(line).expect(line).command else {
                panic!("{line}: another command")
            };
            assert_eq!(edits, [TagEdit::Remove("wip".into()), TagEdit::Add("hero".into())]);
        }
        assert!(parse("quadmuse tag ID -wip --json").expect("parses").json);
    }

    #[test]
    fn the_address_is_the_local_one_unless_told() {
        assert_eq!(parse("quadmuse list").expect("parses").server, SERVER_DEFAULT);
    }
}
