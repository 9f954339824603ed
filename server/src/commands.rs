//! The commands of the binary, each a function.

pub(crate) mod cluster;

use crate::auth::{AuthError, Tokens};
use crate::config::{Cli, ClusterArgs, Command, Config, ConfigError, ServeArgs, StoreArgs, TokenAction};
use crate::demo::tour;
use crate::service::{self, StartError};
use crate::shutdown;
use crate::work::corpus::stored::words_of;
use crate::work::engine::kernel::KernelEngine;
use crate::work::engine::leave_out;
use crate::{audit, bench_corpus};
use quadmuse_cluster::{JetStream, SharedDocuments};
use quadmuse_migrations::MigrationError;
use quadmuse_proto::{NewToken, Token};
use quadmuse_store::{BackupReport, OpenOptions, Store, StoreError};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often a growing corpus says its size, in segments.
const PROGRESS_EVERY: usize = 1024;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// The settings can't be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The service does not start.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The store refused or failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The upgrade refused or failed.
    #[error(transparent)]
    Migration(#[from] MigrationError),
    /// Tokens can't be read or changed.
    #[error(transparent)]
    Auth(#[from] AuthError),
    /// A file can't be read or written.
    #[error("expected to {doing} {}, found {source}", path.display())]
    File {
        /// What was attempted.
        doing: &'static str,
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// There is no store.
    #[error("expected a store in {}, found none; `quadmuse-server --data` creates one", .0.display())]
    NoStore(PathBuf),
    /// The check found damage.
    #[error("expected a store without damage, found {0} problems, listed above")]
    Damage(usize),
    /// A backup lacks some examples.
    #[error("expected to back up every example, found {0} that are damaged and were left out, listed above")]
    LeftOut(usize),
    /// The system refuses something basic.
    #[error("expected {what} from the system, found {source}")]
    System {
        /// What was asked for.
        what: &'static str,
        /// What it said.
        source: std::io::Error,
    },
    /// No corpus was made.
    #[error(transparent)]
    BenchCorpus(#[from] bench_corpus::BenchCorpusError),
    /// The demo failed.
    #[error("expected the demo to end, found: {0}")]
    Demo(String),
}

/// Does what the command line says.
///
/// # Errors
/// [`CommandError`], to be printed.
pub fn run(cli: Cli) -> Result<(), CommandError> {
    match cli.command {
        None => serve(cli.serve),
        Some(Command::Serve(args)) => serve(*args),
        Some(Command::Demo(args)) => demo(&args),
        Some(Command::Migrate { store, dry_run }) => migrate(&store, dry_run),
        Some(Command::Check { store, scratch }) => check(&store, scratch),
        Some(Command::Backup { store, file }) => backup(&store, &file),
        Some(Command::Restore { store, file }) => restore(&store, &file),
        Some(Command::BenchCorpus(args)) => bench_corpus(&args),
        Some(Command::Cluster { action }) => cluster::run(&action),
        Some(Command::Token { data, cluster, action }) => token(data, &cluster, action),
    }
}

fn bench_corpus(args: &bench_corpus::BenchCorpusArgs) -> Result<(), CommandError> {
    let begun = Instant::now();
    let made = bench_corpus::run(args, &KernelEngine::default(), &|after| {
        if after.is_multiple_of(PROGRESS_EVERY) {
            say(&format!("{after} segments, {:.0} s", begun.elapsed().as_secs_f64()));
        }
    })?;
    let (sources, before, after) = (made.sources, made.before, made.after);
    say(&format!(
        "{after} segments (there were {before}), from {sources} encodings, in {:.1} s",
        begun.elapsed().as_secs_f64()
    ));
    Ok(())
}

/// Threads that answer requests. They mostly wait, what computes has its own; a few more than cores, so that on a busy machine the
/// system gives one of them a turn soon while others write long answers.
const ANSWERING_THREADS: usize = 4;

/// Tokio's runtime.
///
/// # Errors
/// [`CommandError::System`].
pub fn runtime() -> Result<tokio::runtime::Runtime, CommandError> {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    let built = builder.worker_threads(ANSWERING_THREADS).max_blocking_threads(64).enable_all().build();
    built.map_err(|source| CommandError::System { what: "threads", source })
}

fn serve(args: ServeArgs) -> Result<(), CommandError> {
    if !args.without.is_empty() {
        tracing::warn!(stages = ?args.without, "left out: what is computed is to be measured, not to be kept");
        leave_out(&args.without);
    }
    let config = Config::resolve(args)?;
    let runtime = runtime()?;
    let served = runtime.block_on(async {
        let running = service::start(&config, Arc::new(KernelEngine::within_memory(config.memory_limit))).await?;
        let signal = shutdown::signal().await.map_err(|source| CommandError::System { what: "signals", source });
        running.stop().await;
        signal
    });
    runtime.shutdown_timeout(Duration::from_millis(200));
    served
}

fn demo(args: &crate::config::DemoArgs) -> Result<(), CommandError> {
    let data = std::env::temp_dir().join(format!("quadmuse-demo-{}", std::process::id()));
    let runtime = runtime()?;
    let toured = runtime.block_on(async {
        let running = tour::run(&args.out, &data).await.map_err(|e| CommandError::Demo(e.to_string()))?;
        if args.keep {
            say(&format!("http://{} goes on until Ctrl-C", running.address));
            shutdown::signal().await.map_err(|source| CommandError::System { what: "signals", source })?;
        }
        running.stop().await;
        Ok(())
    });
    runtime.shutdown_timeout(Duration::from_millis(200));
    // A store that only the demo used; what is left of it harms nobody.
    let _ = std::fs::remove_dir_all(&data);
    toured
}

fn existing(store: &StoreArgs) -> Result<Store, CommandError> {
    if !store.dir().join(quadmuse_migrations::SCHEMA_FILE).exists() {
        return Err(CommandError::NoStore(store.dir()));
    }
    Ok(Store::open(&store.dir(), &OpenOptions::default())?.0)
}

fn migrate(store: &StoreArgs, dry_run: bool) -> Result<(), CommandError> {
    if !store.dir().join(quadmuse_migrations::SCHEMA_FILE).exists() {
        return Err(CommandError::NoStore(store.dir()));
    }
    let found = quadmuse_migrations::read_schema(&store.dir())?;
    let current = quadmuse_migrations::CURRENT;
    match found {
        found if found == current => say(&format!("the store is of schema {current}, this release's: nothing to do")),
        found if dry_run => say(&format!("the store is of schema {found}; it would be brought to {current}")),
        found => {
            drop(existing(store)?);
            say(&format!("the store was of schema {found} and is of {current} now"));
        }
    }
    Ok(())
}

fn check(store: &StoreArgs, scratch: Option<PathBuf>) -> Result<(), CommandError> {
    let dir = store.dir();
    if !dir.join(quadmuse_migrations::SCHEMA_FILE).exists() {
        return Err(CommandError::NoStore(dir));
    }
    let scratch = scratch.unwrap_or_else(std::env::temp_dir);
    let report = Store::check_dir(&dir, &scratch, &mut |done| tracing::info!(done, "examples checked"))?;
    for problem in &report.problems {
        say(&words_of(problem));
    }
    say(&format!("{} examples, {} segments, {} bytes read", report.examples, report.segments, report.bytes));
    if report.problems.is_empty() { Ok(()) } else { Err(CommandError::Damage(report.problems.len())) }
}

fn backup(store: &StoreArgs, file: &Path) -> Result<(), CommandError> {
    let store = existing(store)?;
    let report = write_whole(file, &|writer| Ok(store.backup(writer)?))?;
    report_backup(&report, file)
}

/// Writes a file under another name until it is whole, so that one that was interrupted is never taken for one.
fn write_whole<T>(file: &Path, write: &dyn Fn(&mut dyn Write) -> Result<T, CommandError>) -> Result<T, CommandError> {
    let partial = file.with_added_extension("partial");
    let failed = |doing| {
        let path = partial.clone();
        move |source| CommandError::File { doing, path, source }
    };
    let mut writer = BufWriter::new(File::create(&partial).map_err(failed("write"))?);
    let written = write(&mut writer)?;
    writer.flush().and_then(|()| writer.get_ref().sync_all()).map_err(failed("write"))?;
    std::fs::rename(&partial, file).map_err(failed("rename"))?;
    Ok(written)
}

/// Says what a backup came to.
fn report_backup(report: &BackupReport, file: &Path) -> Result<(), CommandError> {
    for (id, reason) in &report.skipped {
        say(&format!("left out {id}: {reason}"));
    }
    let (examples, segments, bytes) = (report.examples, report.segments, report.bytes);
    say(&format!("{examples} examples, {segments} segments, {bytes} bytes in {}", file.display()));
    // What is there is whole, and is not all: a script must not take it for that.
    if report.skipped.is_empty() { Ok(()) } else { Err(CommandError::LeftOut(report.skipped.len())) }
}

fn restore(store: &StoreArgs, file: &Path) -> Result<(), CommandError> {
    let path = file.to_owned();
    let opened = File::open(file).map_err(|source| CommandError::File { doing: "read", path, source })?;
    let (_, report) = Store::restore(&store.dir(), &OpenOptions::default(), &mut BufReader::new(opened))?;
    say(&format!("{} examples in {}", report.examples, store.dir().display()));
    Ok(())
}

fn token(data: Option<PathBuf>, cluster: &ClusterArgs, action: TokenAction) -> Result<(), CommandError> {
    let dir = StoreArgs { data: data.ok_or(ConfigError::NoData)? }.dir();
    std::fs::create_dir_all(&dir).map_err(|source| CommandError::File {
        doing: "create",
        path: dir.clone(),
        source,
    })?;
    // The audit log stays beside the store or the cache of the server on whose machine this runs.
    let tokens = match cluster.options()? {
        Some(options) => {
            let engine = JetStream::connect(&options).map_err(cluster::unreachable)?;
            Tokens::shared(Arc::new(SharedDocuments::on(Arc::new(engine))))
        }
        None => Tokens::beside(&dir),
    };
    match action {
        TokenAction::Create { role, name, expires } => {
            let expires_in_s = expires.map(|time| time.as_secs());
            let (secret, record) = tokens.create(&NewToken { name, role, expires_in_s, ..NewToken::default() })?;
            tracing::info!(id = %record.id, %role, "token created; it can't be shown again");
            audited(&dir, "token create", &record.id.to_string());
            say(&secret);
        }
        TokenAction::List => {
            for record in tokens.list()? {
                say(&token_line(&record.to_wire()));
            }
        }
        TokenAction::Revoke { id } => {
            tokens.revoke(&id)?;
            audited(&dir, "token revoke", &id);
            say(&format!("{id} is revoked"));
        }
    }
    Ok(())
}

/// The command was carried out: that it can't be noted is told, and no more.
fn audited(dir: &Path, action: &str, on: &str) {
    if let Err(error) = audit::note_command(dir, action, on) {
        tracing::warn!(%error, "not noted in the audit log");
    }
}

fn token_line(token: &Token) -> String {
    let time = |time: &Option<String>| time.clone().unwrap_or_else(|| "never".into());
    format!(
        "{}  {:<11}  created {}  expires {}  last used {}  {:?}",
        token.id,
        token.role,
        token.created.as_deref().unwrap_or("?"),
        time(&token.expires),
        time(&token.last_used),
        token.name
    )
}

/// Prints a line for the user. A closed pipe is no failure of the command.
fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}
