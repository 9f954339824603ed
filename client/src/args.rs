//! The command line: verbs, flags, and the environment variables behind them.

mod annotate;

pub use annotate::AnnotateArgs;

use crate::{
    file::OutFile,
    spec::{
        ConstraintSpec, ExampleRef, LandmarkSpec, LandmarksSpec, Name, Require, SegmentNameSpec, SegmentRef,
        SegmentsSpec, TagEdit, UsePart,
    },
};
use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;
use quadmuse_proto::{
    Beyond, Components, MeshFormat, OnFold, Topology, composition, example::RELEVANCE_RANGE, query, segment::Parts,
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
     Exit codes: 0 done, 1 refused or failed, 2 wrong usage, 3 server out of reach, 130 interrupted by Ctrl-C.";

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
    /// Remove examples from the corpus; on a terminal it asks first
    Remove(RemoveArgs),
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
    /// Say who made an example, under which licence, and where its landmarks are
    Annotate(AnnotateArgs),
    /// Rank the corpus against a mesh
    Query(QueryCommand),
    /// Show the ranking of a query
    Ranking(RankingArgs),
    /// Name the parts of a scan, its segments, for all who look at the query
    Name {
        /// The query
        #[arg(value_name = "QUERY")]
        query: Name,
        /// `SEGMENT=NAME`, the segment by its number or by the name it has; `SEGMENT=` takes the name off. Without any, the segments
        /// are listed
        #[arg(value_name = "SEGMENT=NAME")]
        names: Vec<SegmentNameSpec>,
    },
    /// Lay an example on the input, and write the mesh
    Map(MapArgs),
    /// Edit the constraints of a map, and write the new mesh
    Constrain(ConstrainArgs),
    /// Stitch the maps of a query's segments into one mesh of quads
    Compose(ComposeCommand),
    /// All in one go: upload, rank, map or compose, download
    Retopo(RetopoArgs),
    /// `retopo` for every scan of a folder, with a report
    Batch(BatchArgs),
    /// Print the address of the page that shows a query, and open it where there is a screen
    Open {
        /// The query
        #[arg(value_name = "QUERY")]
        query: Name,
    },
    /// Print the completions of a shell
    Completions {
        /// The shell
        #[arg(value_name = "SHELL")]
        shell: Shell,
    },
    /// Print a manual page, or write all of them to a folder
    Man {
        /// The command whose page to print [default: that of quadmuse itself]
        #[arg(value_name = "COMMAND")]
        command: Option<String>,
        /// Write a page a command to this folder: `quadmuse.1`, `quadmuse-add.1`, …
        #[arg(long, value_name = "DIR", conflicts_with = "command")]
        dir: Option<PathBuf>,
    },
}

/// `add`.
#[derive(Debug, Args)]
pub struct AddArgs {
    /// Mesh files: OBJ, PLY, OFF, STL, glTF, each compressed by gzip or not; `-` is standard input
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// A tag for all of them (may be repeated)
    #[arg(long = "tag", value_name = "T")]
    pub tags: Vec<String>,
    /// The example's name, where there is one file [default: the file's name without its extension]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Their relevance, 0 to 5
    #[arg(long, value_name = "R", value_parser = relevance, allow_negative_numbers = true)]
    pub relevance: Option<f64>,
    /// Tell what was repaired in each mesh
    #[arg(short, long)]
    pub verbose: bool,
    /// Keep each whole alone, without its parts beside it
    #[arg(long, conflicts_with_all = ["segments", "parts"])]
    pub whole_only: bool,
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
    /// few as can be; an example that can stay whole is kept whole and by its parts]
    #[arg(long, value_name = "N|auto")]
    pub parts: Option<Parts>,
    /// What becomes of small components beside the largest: `largest` leaves them out, `refuse` refuses the mesh
    /// [default: largest]
    #[arg(long, value_name = "largest|refuse")]
    pub components: Option<Components>,
}

/// `remove`.
#[derive(Debug, Args)]
pub struct RemoveArgs {
    /// The examples
    #[arg(value_name = "ID", required_unless_present = "tags")]
    pub ids: Vec<Name>,
    /// All examples with this tag in their place (may be repeated: with all of them); without a terminal to ask on it
    /// takes --yes
    #[arg(long = "tag", value_name = "T", conflicts_with = "ids")]
    pub tags: Vec<String>,
    /// Don't ask
    #[arg(short, long)]
    pub yes: bool,
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

/// An upload that is to be ranked.
#[derive(Clone, Debug, Args)]
pub struct QueryArgs {
    /// The mesh: OBJ, PLY, OFF, STL, glTF, compressed by gzip or not; `-` is standard input
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// How to rank it
    #[command(flatten)]
    pub rank: RankArgs,
}

/// How an upload is ranked.
#[derive(Clone, Debug, Args)]
pub struct RankArgs {
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
    /// Only this segment, by its number or its name
    #[arg(long, value_name = "SEGMENT")]
    pub segment: Option<SegmentRef>,
    /// Follow it until it is final
    #[arg(long)]
    pub follow: bool,
}

/// Where a mesh is written.
#[derive(Clone, Debug, Args)]
pub struct OutArgs {
    /// The file to write; its extension chooses the format: obj, ply, off, stl, glb; with .gz behind it, it is compressed.
    /// `-` is standard output
    #[arg(short, long = "out", value_name = "OUT")]
    pub out: OutFile,
    /// The format, whatever the extension; `-` has none, and is obj otherwise
    #[arg(long, value_name = "obj|ply|off|stl|glb")]
    pub format: Option<MeshFormat>,
    /// Overwrite a file without asking. Without it, who is at no terminal is refused
    #[arg(long)]
    pub force: bool,
    /// Draw the result, too: to a PNG file
    #[arg(long, value_name = "FILE.png", value_parser = picture)]
    pub picture: Option<PathBuf>,
}

impl OutArgs {
    /// The file, in the format that is asked for.
    pub fn file(&self) -> OutFile {
        OutFile { format: self.format.unwrap_or(self.out.format), ..self.out.clone() }
    }
}

/// The size of a result.
#[derive(Clone, Debug, Default, Args)]
pub struct SizeArgs {
    /// Write it with about so many quads: rows of quads are split or taken out, and the layout's extraordinary vertices stay
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(6..=1_000_000), conflicts_with = "tolerance")]
    pub quads: Option<u32>,
    /// Write it with rows of quads split until 95 % of it and of the scan are so near to each other, in % of the scan's diagonal
    #[arg(long, value_name = "PCT", value_parser = tolerance)]
    pub tolerance: Option<f64>,
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
    /// The query's segment, by its number or its name
    #[arg(long, value_name = "SEGMENT", default_value = "0")]
    pub segment: SegmentRef,
    /// Where the input reaches beyond the example: `extend` continues the example's boundary by rows of quads, and extrudes its faces along
    /// horns or a tail that it lacks; `leave` writes the example's faces alone
    #[arg(long, value_name = "extend|leave", value_parser = beyond, default_value = "leave")]
    pub beyond: Beyond,
    /// A file for the numbers of the example's vertices that were kept, from 0, one a line: others lie beyond the input
    #[arg(long, value_name = "FILE")]
    pub kept: Option<PathBuf>,
    /// A point of the example and the point of the scan where it belongs; may repeat. From three on they fix the pose. Ends as
    /// with `constrain --set`
    #[arg(long = "landmark", value_name = "X,Y,Z=X,Y,Z", allow_hyphen_values = true)]
    pub landmark: Vec<LandmarkSpec>,
    /// A file of landmarks: JSON, a list of `{"on_example": [x, y, z], "on_input": [x, y, z], "name": …}`, or points of the scan by
    /// name as with `--names`; the word `names`: those of `--names`
    #[arg(long, value_name = "FILE|names")]
    pub landmarks: Option<LandmarksSpec>,
    /// A file that names points of the scan: JSON like `{"nose_tip": [x, y, z]}`. Where the example has a landmark of the same
    /// name, it is held there; other names are passed over
    #[arg(long, value_name = "FILE", requires = "landmarks")]
    pub names: Option<PathBuf>,
    /// Exit with 1 where the result is less than this; it is written all the same. `inspired`: more than half of its area
    /// has an example's quads; `fair`, `good`: its verdict is that or better. A broken result always exits with 1
    #[arg(long, value_name = "inspired|fair|good")]
    pub require: Option<Require>,
    /// How many quads to write
    #[command(flatten)]
    pub size: SizeArgs,
    /// Where to write it
    #[command(flatten)]
    pub out: OutArgs,
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
    /// `ON_EXAMPLE=ON_INPUT` adds a constraint, which the service names; `ID:ON_EXAMPLE=ON_INPUT` moves one that the map
    /// has, and an end left empty stays. Each end is `x,y,z` or `uU,vV` or `fFACE/w,w,w`. Or the constraint as JSON
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
    /// Where to write it
    #[command(flatten)]
    pub out: OutArgs,
}

/// The flags that tell what is laid on a scan, and how: the same for one scan and for a folder of them.
#[derive(Clone, Debug, Args)]
pub struct LayArgs {
    /// `SEGMENT=EXAMPLE` or `SEGMENT=EXAMPLE:SEGMENT`: this example in place of the best (may be repeated). The scan's segment by
    /// its number, or by its name where it was given one
    #[arg(long = "use", value_name = "SEGMENT=EXAMPLE")]
    pub uses: Vec<UsePart<Name, SegmentRef>>,
    /// Rounds of smoothing [default: 5]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=i64::from(composition::SMOOTHING_MAX)))]
    pub smoothing: Option<u32>,
    /// Steps by which the quads are denser (each doubles rows and columns) or, below 0, coarser than the examples'
    #[arg(long, value_name = "STEPS", allow_negative_numbers = true, value_parser = clap::value_parser!(i32).range(-i64::from(composition::DENSITY_MAX)..=i64::from(composition::DENSITY_MAX)))]
    pub density: Option<i32>,
    /// Where the input reaches beyond the example: `extend` continues the example's boundary by rows of quads, and extrudes its faces along
    /// horns or a tail that it lacks; `leave` writes the example's faces alone
    #[arg(long, value_name = "extend|leave", value_parser = beyond, default_value = "extend")]
    pub beyond: Beyond,
    /// Exit with 1 where the result is less than this; it is written all the same. `inspired`: more than half of its area
    /// has an example's quads; `fair`, `good`: its verdict is that or better. A broken result always exits with 1
    #[arg(long, value_name = "inspired|fair|good")]
    pub require: Option<Require>,
    /// How many quads to write
    #[command(flatten)]
    pub size: SizeArgs,
}

/// The flags of a composition.
#[derive(Clone, Debug, Args)]
pub struct ComposeArgs {
    /// The examples to lay on it, and how
    #[command(flatten)]
    pub lay: LayArgs,
    /// A file for the numbers of the example's vertices that were kept, from 0, one a line: others lie beyond the input
    #[arg(long, value_name = "FILE")]
    pub kept: Option<PathBuf>,
    /// Where to write it
    #[command(flatten)]
    pub out: OutArgs,
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

/// `batch`.
#[derive(Debug, Args)]
pub struct BatchArgs {
    /// The folder of the scans; folders in it are left out
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// The folder to write to: a mesh a scan, and `report.csv`. It is made where there is none
    #[arg(short, long = "out", value_name = "DIR")]
    pub out: PathBuf,
    /// The format of the meshes
    #[arg(long, value_name = "obj|ply|off|stl|glb", default_value = "obj")]
    pub format: MeshFormat,
    /// Draw each result, too: to a PNG file beside it
    #[arg(long)]
    pub pictures: bool,
    /// Overwrite files without asking. Without it, who is at no terminal is refused
    #[arg(long)]
    pub force: bool,
    /// How to rank them
    #[command(flatten)]
    pub rank: RankArgs,
    /// The examples to lay on each, and how
    #[command(flatten)]
    pub lay: LayArgs,
}

fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_png = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png"));
    if is_png { Ok(path) } else { Err("expected a file name that ends in .png".into()) }
}

fn tolerance(text: &str) -> Result<f64, String> {
    let percent: Option<f64> = text.trim_end_matches('%').parse().ok();
    let is_there = |percent: &f64| (0.001..=100.0).contains(percent);
    percent.filter(is_there).ok_or_else(|| "expected % of the scan's diagonal, from 0.001 to 100".into())
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
mod tests;
