//! Settings: flags, then `QUADMUSE_…` variables, then a TOML file, then defaults.

mod cluster;

pub use cluster::{ClusterAction, ClusterArgs};

use crate::connections::ConnectionLimits;
use crate::telemetry::traces::Collector;
use crate::work::engine::Stage;
use clap::{Args, Parser, Subcommand};
use quadmuse_cluster::ClusterOptions;
use quadmuse_proto::Share;
use serde::Deserialize;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Where the server listens unless told otherwise.
pub const LISTEN_DEFAULT: &str = "127.0.0.1:7979";

/// Largest body, packed or unpacked, unless told otherwise: some 1.5 million triangles as OBJ.
pub const UPLOAD_LIMIT_DEFAULT: u64 = 128 << 20;

/// Memory that jobs may use together, by estimate, unless told otherwise.
pub const MEMORY_LIMIT_DEFAULT: u64 = 4 << 30;

/// Connections at a time unless told otherwise.
pub const CONNECTIONS_DEFAULT: usize = 4096;

/// Requests a second of one caller unless told otherwise.
pub const RATE_LIMIT_DEFAULT: u32 = 2000;

/// Memory that is set aside for a connection's buffers when their number follows from the memory, in bytes.
const MEMORY_PER_CONNECTION: u64 = 256 << 10;

/// Fewest connections that follow from the memory.
const CONNECTIONS_LEAST: usize = 64;

/// Connections that go with so much memory.
fn connections_for(memory_bytes: u64) -> usize {
    let fitting = usize::try_from(memory_bytes / MEMORY_PER_CONNECTION).unwrap_or(usize::MAX);
    fitting.clamp(CONNECTIONS_LEAST, CONNECTIONS_DEFAULT)
}

/// The command line.
#[derive(Debug, Parser)]
#[command(name = "quadmuse-server", version, about = "The corpus search service of Quadmuse")]
#[command(args_conflicts_with_subcommands = true)]
pub struct Cli {
    /// What to do; `serve` if nothing else is said.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// The flags of `serve`.
    #[command(flatten)]
    pub serve: ServeArgs,
}

/// What the binary can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the service (the default).
    Serve(Box<ServeArgs>),
    /// Show the whole path with built-in samples: nothing is needed but this binary.
    Demo(DemoArgs),
    /// Bring a store on this machine's disk to this release's schema.
    Migrate {
        /// The store.
        #[command(flatten)]
        store: StoreArgs,
        /// Say what would be done, and do nothing.
        #[arg(long)]
        dry_run: bool,
    },
    /// Read every byte of a store on this machine's disk and report what is damaged; changes nothing.
    Check {
        /// The store.
        #[command(flatten)]
        store: StoreArgs,
        /// Directory for a copy of the index while it is checked (default: the system's for temporary files).
        #[arg(long, value_name = "DIR")]
        scratch: Option<PathBuf>,
    },
    /// Write a store on this machine's disk into one file.
    Backup {
        /// The store.
        #[command(flatten)]
        store: StoreArgs,
        /// The file to write.
        file: PathBuf,
    },
    /// Fill an empty store on this machine's disk from a backup.
    Restore {
        /// The store.
        #[command(flatten)]
        store: StoreArgs,
        /// The file to read.
        file: PathBuf,
    },
    /// Move, keep and look after a corpus that servers share.
    Cluster {
        /// What to do.
        #[command(subcommand)]
        action: ClusterAction,
    },
    /// Grow a store of made-up examples, to measure searching with.
    BenchCorpus(crate::bench_corpus::BenchCorpusArgs),
    /// Create, list and revoke access tokens.
    Token {
        /// Directory of the store; before or behind the verb.
        #[arg(long, env = "QUADMUSE_DATA", global = true)]
        data: Option<PathBuf>,
        /// The corpus whose servers they are for, if servers share one; before the verb.
        #[command(flatten)]
        cluster: ClusterArgs,
        /// What to do.
        #[command(subcommand)]
        action: TokenAction,
    },
}

/// The flags of `serve`. What is absent here is looked for in the file, then taken from the defaults.
#[derive(Clone, Debug, Default, Args, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServeArgs {
    /// Directory of the store; created if it is not there.
    #[arg(long, env = "QUADMUSE_DATA")]
    pub data: Option<PathBuf>,
    /// Address and port to listen on.
    #[arg(long, env = "QUADMUSE_LISTEN", value_name = "ADDR")]
    pub listen: Option<SocketAddr>,
    /// Threads that compute (default: one a core).
    #[arg(long, env = "QUADMUSE_THREADS", value_name = "N")]
    pub threads: Option<usize>,
    /// Memory that jobs may use together, by estimate, in bytes.
    #[arg(long, env = "QUADMUSE_MEMORY_LIMIT", value_name = "BYTES")]
    pub memory_limit: Option<u64>,
    /// Largest body, packed or unpacked, in bytes.
    #[arg(long, env = "QUADMUSE_UPLOAD_LIMIT", value_name = "BYTES")]
    pub upload_limit: Option<u64>,
    /// Most connections at a time (default: one for each 256 KiB of the memory limit, from 64 to 4096).
    #[arg(long, env = "QUADMUSE_CONNECTIONS", value_name = "N")]
    pub connections: Option<usize>,
    /// Most connections of one address at a time (default: three of four).
    #[arg(long, env = "QUADMUSE_CONNECTIONS_PER_ADDRESS", value_name = "N")]
    pub connections_per_address: Option<usize>,
    /// Requests a second of one caller, a change counted as five; 0: no limit (default: 2000).
    #[arg(long, env = "QUADMUSE_RATE_LIMIT", value_name = "N")]
    pub rate_limit: Option<u32>,
    /// A name under which others reach this server; may repeat (in a variable or file: separated by commas, a list).
    /// Addresses and localhost are allowed always; with tokens and without this flag, every name is.
    #[arg(long = "allow-host", env = "QUADMUSE_ALLOW_HOST", value_name = "NAME", value_delimiter = ',', value_parser = crate::http::origin::host_name)]
    pub allow_host: Vec<String>,
    /// An origin whose pages may use this server, like `https://tools.studio.example`; may repeat (in a variable or file:
    /// separated by commas, a list). Without this flag only the server's own page may.
    #[arg(long = "allow-origin", env = "QUADMUSE_ALLOW_ORIGIN", value_name = "ORIGIN", value_delimiter = ',', value_parser = crate::http::origin::origin_name)]
    pub allow_origin: Vec<String>,
    /// Put the built-in sample examples into a corpus that is empty.
    #[arg(long, env = "QUADMUSE_SAMPLES")]
    pub samples: bool,
    /// Serve without tokens even on an address that others can reach.
    #[arg(long, env = "QUADMUSE_OPEN")]
    pub open: bool,
    /// A collector of traces, like `http://127.0.0.1:4318`: spans are sent to it by OTLP over HTTP (default: none).
    #[arg(long, env = "QUADMUSE_OTLP", value_name = "URL")]
    pub otlp: Option<String>,
    /// Where the servers that share its corpus reach this one, such as `http://10.0.0.7:7979` (default: where it listens, or
    /// the machine's name where it listens on every address).
    #[arg(long, env = "QUADMUSE_ADVERTISE", value_name = "URL")]
    pub advertise: Option<String>,
    /// Hold only a share of the corpus's pictures in memory, such as `2/3`, where it has no room for all: servers with the
    /// other shares are asked in each search. Every share has to be held by a server, and may be by several.
    #[arg(long, env = "QUADMUSE_SHARD", value_name = "K/N")]
    pub shard: Option<Share>,
    /// Leave stages of the computation out, to measure what each is worth; what is computed without them is not to be kept.
    #[arg(long, value_name = "STAGES", value_delimiter = ',', value_parser = Stage::named, hide_short_help = true)]
    #[serde(skip)]
    pub without: Vec<Stage>,
    /// Where the corpus lies, if not in the directory of the store.
    #[command(flatten)]
    #[serde(flatten)]
    pub cluster: ClusterArgs,
    /// A TOML file with the same names (`data`, `listen`, `memory_limit`, …).
    #[arg(long, env = "QUADMUSE_CONFIG", value_name = "FILE")]
    #[serde(skip)]
    pub config: Option<PathBuf>,
}

/// The flags of `demo`.
#[derive(Clone, Debug, Args)]
pub struct DemoArgs {
    /// Directory for the mapped meshes and their pictures, and for the samples: `examples/` and `scans/`.
    #[arg(long, env = "QUADMUSE_OUT", default_value = "quadmuse-demo")]
    pub out: PathBuf,
    /// Keep the service running afterwards.
    #[arg(long)]
    pub keep: bool,
}

/// Which store.
#[derive(Clone, Debug, Args)]
pub struct StoreArgs {
    /// Directory of the store.
    #[arg(long, env = "QUADMUSE_DATA")]
    pub data: PathBuf,
}

/// What to do with tokens.
#[derive(Clone, Debug, Subcommand)]
pub enum TokenAction {
    /// Create a token and print it: it is not kept and can't be shown again.
    Create {
        /// What it may do: reader (queries), contributor (examples too), admin (everything).
        #[arg(long, default_value = "reader")]
        role: crate::auth::Role,
        /// Whose it is, for the list.
        #[arg(long, default_value = "")]
        name: String,
        /// How long it is accepted, such as `90d` or `12h`; without it, always.
        #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
        expires: Option<Duration>,
    },
    /// List the tokens, without what makes them secret.
    List,
    /// Revoke a token by its id.
    Revoke {
        /// Its id, as listed.
        id: String,
    },
}

/// The settings of the service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Directory of the store.
    pub data: PathBuf,
    /// Address and port.
    pub listen: SocketAddr,
    /// Threads that compute; 0: one a core.
    pub threads: usize,
    /// Memory that jobs may use together, in bytes.
    pub memory_limit: u64,
    /// Largest body, in bytes.
    pub upload_limit: u64,
    /// Most connections at a time.
    pub connections: usize,
    /// Most connections of one address.
    pub connections_per_address: usize,
    /// Requests a second of one caller; 0: no limit.
    pub rate_limit: u32,
    /// Names under which it is reached.
    pub allowed_hosts: Vec<String>,
    /// Origins whose pages may use it, beside its own.
    pub allowed_origins: Vec<String>,
    /// Whether an empty corpus gets the samples.
    pub samples: bool,
    /// Whether it may be open on any address.
    pub open: bool,
    /// The engine that holds the corpus; `None`: it lies in `data`.
    pub cluster: Option<ClusterOptions>,
    /// Where other servers reach this one (`http://host:port`); `None`: where it listens.
    pub advertise: Option<String>,
    /// The share of the corpus whose pictures it holds in memory; `None`: all of it.
    pub share: Option<Share>,
}

impl Config {
    /// A service for this machine alone, on a free port.
    pub fn local(data: PathBuf) -> Self {
        let listen = SocketAddr::from(([127, 0, 0, 1], 0));
        Self {
            data,
            listen,
            threads: 0,
            memory_limit: MEMORY_LIMIT_DEFAULT,
            upload_limit: UPLOAD_LIMIT_DEFAULT,
            connections: CONNECTIONS_DEFAULT,
            connections_per_address: ConnectionLimits::of(CONNECTIONS_DEFAULT).per_address,
            rate_limit: RATE_LIMIT_DEFAULT,
            allowed_hosts: Vec::new(),
            allowed_origins: Vec::new(),
            samples: false,
            open: false,
            cluster: None,
            advertise: None,
            share: None,
        }
    }
}

/// Why the settings can't be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file can't be read.
    #[error("expected a TOML file of settings at {}, found another thing: {source}", path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<config::ConfigError>,
    },
    /// A setting is missing.
    #[error("expected --data DIR (or QUADMUSE_DATA, or `data` in the file), found none")]
    NoData,
    /// The engine can't be used as named.
    #[error("{0}")]
    Cluster(String),
    /// The collector of traces can't be used as named.
    #[error("{0}")]
    Collector(String),
    /// A setting makes no sense.
    #[error("expected {name} {expected}, found {found}")]
    Invalid {
        /// Which setting.
        name: &'static str,
        /// What would do.
        expected: &'static str,
        /// What was given.
        found: String,
    },
}

/// Most threads that can be asked for.
const THREADS_MAX: usize = 1024;

impl Config {
    /// The settings: `args` first, then the file they name, then the defaults.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn resolve(args: ServeArgs) -> Result<Self, ConfigError> {
        let file = args.config.as_deref().map_or_else(|| Ok(ServeArgs::default()), read_file)?;
        let invalid = |name, expected, found: String| Err(ConfigError::Invalid { name, expected, found });
        let memory_limit = args.memory_limit.or(file.memory_limit).unwrap_or(MEMORY_LIMIT_DEFAULT);
        let connections = args.connections.or(file.connections).unwrap_or_else(|| connections_for(memory_limit));
        let per_address = args.connections_per_address.or(file.connections_per_address);
        let resolved = Self {
            data: absolute(&args.data.or(file.data).ok_or(ConfigError::NoData)?),
            listen: match args.listen.or(file.listen) {
                Some(listen) => listen,
                None => SocketAddr::from(([127, 0, 0, 1], 7979)),
            },
            threads: args.threads.or(file.threads).unwrap_or(0),
            memory_limit,
            upload_limit: args.upload_limit.or(file.upload_limit).unwrap_or(UPLOAD_LIMIT_DEFAULT),
            connections,
            connections_per_address: per_address.unwrap_or(ConnectionLimits::of(connections).per_address),
            rate_limit: args.rate_limit.or(file.rate_limit).unwrap_or(RATE_LIMIT_DEFAULT),
            allowed_hosts: hosts(args.allow_host, file.allow_host)?,
            allowed_origins: origins(args.allow_origin, file.allow_origin)?,
            samples: args.samples || file.samples,
            open: args.open || file.open,
            cluster: args.cluster.or(file.cluster).options()?,
            advertise: cluster::advertised(args.advertise.or(file.advertise))?,
            share: args.shard.or(file.shard),
        };
        match &resolved {
            Self { cluster: None, advertise: Some(address), .. } => {
                Err(ConfigError::Cluster(format!("expected --cluster URLS with --advertise {address}, found none")))
            }
            Self { cluster: None, share: Some(share), .. } => {
                Err(ConfigError::Cluster(format!("expected --cluster URLS with --shard {share}, found none")))
            }
            c if c.threads > THREADS_MAX => invalid("threads", "at most 1024", c.threads.to_string()),
            c if c.upload_limit == 0 => invalid("upload-limit", "of at least one byte", "0".into()),
            c if c.connections == 0 => invalid("connections", "of at least one", "0".into()),
            c if c.connections_per_address == 0 => invalid("connections-per-address", "of at least one", "0".into()),
            _ => Ok(resolved),
        }
    }
}

impl Cli {
    /// The collector of traces that the flags, or the file they name, ask for. Looked for before all else: the log begins with it.
    ///
    /// # Errors
    /// [`ConfigError::File`], [`ConfigError::Collector`].
    pub fn collector(&self) -> Result<Option<Collector>, ConfigError> {
        let args = match &self.command {
            None => &self.serve,
            Some(Command::Serve(args)) => args,
            Some(_) => return Ok(None),
        };
        let named = match (&args.otlp, &args.config) {
            (Some(named), _) => Some(named.clone()),
            (None, Some(file)) => read_file(file)?.otlp,
            (None, None) => None,
        };
        // An empty variable is how others are unset, too.
        let named = named.filter(|named| !named.is_empty());
        named.map(|named| named.parse().map_err(ConfigError::Collector)).transpose()
    }
}

/// The directory, whatever the working directory becomes.
fn absolute(dir: &Path) -> PathBuf {
    std::path::absolute(dir).unwrap_or_else(|_| dir.to_owned())
}

impl StoreArgs {
    /// The directory of the store, absolute.
    pub fn dir(&self) -> PathBuf {
        absolute(&self.data)
    }
}

/// The names given by flags, else those of the file.
fn hosts(given: Vec<String>, file: Vec<String>) -> Result<Vec<String>, ConfigError> {
    let names = if given.is_empty() { file } else { given };
    let checked = |name: String| {
        let invalid = |_| ConfigError::Invalid { name: "allow-host", expected: "names of hosts", found: name.clone() };
        crate::http::origin::host_name(&name).map_err(invalid)
    };
    names.into_iter().map(checked).collect()
}

/// The origins given by flags, else those of the file.
fn origins(given: Vec<String>, file: Vec<String>) -> Result<Vec<String>, ConfigError> {
    let names = if given.is_empty() { file } else { given };
    let checked = |name: String| {
        let expected = "origins like https://tools.studio.example";
        let invalid = |_| ConfigError::Invalid { name: "allow-origin", expected, found: name.clone() };
        crate::http::origin::origin_name(&name).map_err(invalid)
    };
    names.into_iter().map(checked).collect()
}

fn read_file(path: &Path) -> Result<ServeArgs, ConfigError> {
    let file = config::File::from(path).format(config::FileFormat::Toml);
    let read = config::Config::builder().add_source(file).build().and_then(config::Config::try_deserialize);
    read.map_err(|source| ConfigError::File { path: path.into(), source: Box::new(source) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn parse(line: &[&str]) -> ServeArgs {
        let line = std::iter::once("quadmuse-server").chain(line.iter().copied());
        Cli::try_parse_from(line).expect("a good command line").serve
    }

    #[test]
    fn origins_are_taken_as_browsers_write_them() {
        let resolved = |line: &[&str]| Config::resolve(parse(&[&["--data", "d"][..], line].concat()));
        let origins = ["--allow-origin", "https://Tools.example:8443,http://10.0.0.7"];
        let config = resolved(&origins).expect("resolves");
        assert_eq!(config.allowed_origins, ["https://tools.example:8443", "http://10.0.0.7"]);
        assert!(!config.samples && resolved(&["--samples"]).expect("resolves").samples);
        for bad in ["tools.example", "ftp://x", "https://x/y", "https://x:port", "*", "null", "https://", "https://u@x"]
        {
            assert!(crate::http::origin::origin_name(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn stages_that_are_left_out_are_known_by_name_and_others_refused() {
        assert!(parse(&["--data", "d"]).without.is_empty());
        assert_eq!(parse(&["--data", "d", "--without", "poses,cover"]).without, [Stage::Poses, Stage::Cover]);
        let refused =
            Cli::try_parse_from(["quadmuse-server", "--data", "d", "--without", "pose"]).expect_err("no stage");
        assert!(refused.to_string().contains("poses, anchors"), "{refused}");
    }

    #[test]
    fn serve_is_the_default_command_and_the_defaults_are_those_promised() {
        let config = Config::resolve(parse(&["--data", "d"])).expect("settings");
        assert!(config.data.is_absolute() && config.data.ends_with("d"));
        assert_eq!(config.listen.to_string(), LISTEN_DEFAULT);
        let explicit = Cli::try_parse_from(["quadmuse-server", "serve", "--data", "d"]).expect("a good command line");
        let Some(Command::Serve(args)) = explicit.command else { panic!("expected serve") };
        let args = *args;
        assert_eq!(Config::resolve(args).expect("settings"), config);
    }

    #[test]
    fn flags_win_over_the_file_and_the_file_over_defaults() {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        let lines = "data = \"from-file\"\nthreads = 3\nupload_limit = 10\ncluster = \"nats://a\"";
        writeln!(file, "{lines}").expect("written");
        let path = file.path().to_str().expect("a plain path");
        let config = Config::resolve(parse(&["--config", path, "--threads", "5"])).expect("settings");
        assert!(config.data.ends_with("from-file"));
        assert_eq!(config.threads, 5);
        assert_eq!(config.cluster, Some(ClusterOptions::new("nats://a", "quadmuse")));
        assert_eq!((config.upload_limit, config.memory_limit), (10, MEMORY_LIMIT_DEFAULT));
    }

    #[test]
    fn a_collector_is_named_by_a_flag_or_in_the_file_and_a_wrong_one_refused() {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        writeln!(file, "otlp = \"http://in-file:4318\"").expect("written");
        let path = file.path().to_str().expect("a plain path");
        let collector = |line: &[&str]| {
            let line = ["quadmuse-server", "serve"].iter().chain(line);
            Cli::try_parse_from(line).expect("a good command line").collector()
        };
        let named = |url: &str| Some(url.parse::<Collector>().expect("an address"));
        assert_eq!(collector(&["--config", path]).expect("read"), named("http://in-file:4318"));
        let both = ["--config", path, "--otlp", "http://flag"];
        assert_eq!(collector(&both).expect("read"), named("http://flag"));
        assert_eq!(collector(&[]).expect("none"), None);
        assert!(matches!(collector(&["--otlp", "flag:4318"]), Err(ConfigError::Collector(_))));
    }

    #[test]
    fn an_unknown_name_in_the_file_is_refused() {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        writeln!(file, "dta = \"typo\"").expect("written");
        let path = file.path().to_str().expect("a plain path");
        let error = Config::resolve(parse(&["--config", path])).expect_err("a typo");
        assert!(error.to_string().contains("dta"), "{error}");
    }

    #[test]
    fn every_verb_of_the_interface_is_read() {
        for line in [
            "serve --data d --listen 127.0.0.1:0 --threads 2 --memory-limit 1 --upload-limit 1",
            "demo --out o --keep",
            "migrate --data d --dry-run",
            "check --data d",
            "backup --data d file",
            "restore --data d file",
            "token create --data d --role contributor --name me --expires 90d",
            "token --data d create",
            "serve --data d --cluster nats://a,nats://b --bucket studio --cluster-replicas 1 --cluster-ca f",
            "cluster import --cluster nats://a --bucket studio --data d",
            "cluster export --cluster nats://a --data d",
            "cluster backup --cluster nats://a file",
            "cluster restore --cluster nats://a file",
            "cluster check --cluster nats://a --cluster-credentials f",
            "cluster collect --cluster nats://a --older-than 2d",
            "token --data d --cluster nats://a create",
            "token list --data d",
            "token revoke 01ARZ3NDEKTSV4RRFFQ69G5FAV --data d",
        ] {
            let words = std::iter::once("quadmuse-server").chain(line.split(' '));
            let read = Cli::try_parse_from(words).unwrap_or_else(|e| panic!("{line}: {e}"));
            if let Some(Command::Token { data, .. }) = read.command {
                assert_eq!(data, Some("d".into()), "{line}");
            }
        }
    }

    #[test]
    fn without_data_nothing_starts() {
        assert!(matches!(Config::resolve(parse(&[])), Err(ConfigError::NoData)));
    }
}
