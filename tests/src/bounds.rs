//! What hard input costs the service: time and memory of each file, from reading to a composed mesh.

pub mod families;

use crate::{
    client::{Client, ClientError},
    scale::process,
    server::{Server, ServerError},
    shapes::{self, Faces},
};
use std::{
    io,
    path::{Path, PathBuf},
    process::{Child, Stdio},
    time::{Duration, Instant},
};

/// How often a run is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Cells of an example's side.
const CELLS: u32 = 24;
/// Examples of the corpus.
const EXAMPLES: u32 = 8;

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum BoundsError {
    /// No server.
    #[error(transparent)]
    Server(#[from] ServerError),
    /// No client.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// A file or a process.
    #[error("expected files and processes, found that the system refuses: {0}")]
    Io(#[from] io::Error),
}

/// What one file cost.
#[derive(Clone, Debug)]
pub struct Cost {
    /// Exit code of the client; `None` if it was stopped because its time was up.
    pub code: Option<i32>,
    /// Real time in seconds.
    pub took_s: f64,
    /// Processor time of the server, in seconds.
    pub cpu_s: f64,
    /// Its threads waited for a core so long, in seconds: computing threads stand back on a machine that others use.
    pub waited_s: f64,
    /// The most memory the server ever held, in bytes.
    pub peak: u64,
    /// Whether the server lived on.
    pub lives: bool,
    /// What the client said, in one line.
    pub words: String,
}

/// Makes a store of a few examples in `data`: heads and vases.
///
/// # Errors
/// [`BoundsError`].
pub fn corpus(folder: &Path, data: &Path) -> Result<(), BoundsError> {
    let mut server = Server::start(data)?;
    let client = Client::new(server.url());
    for kind in 0..EXAMPLES {
        let path = folder.join(format!("example_{kind}.obj"));
        let text = match kind % 4 {
            3 => shapes::vase(kind, CELLS, CELLS, Faces::Quads),
            _ => shapes::head(kind, CELLS, Faces::Quads),
        };
        std::fs::write(&path, text)?;
        client.run(["add".as_ref(), path.as_os_str()])?.ok()?;
    }
    server.terminate(Duration::from_secs(60))?;
    Ok(())
}

/// What a file is sent as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sent {
    /// A scan, which is composed.
    #[default]
    Scan,
    /// An example, which is added.
    Example,
}

/// Sends a file to a server of its own on a copy of the store.
///
/// # Errors
/// [`BoundsError`].
pub fn cost(store: &Path, file: &Path, sent: Sent, time_max: Duration) -> Result<Cost, BoundsError> {
    let folder = tempfile::tempdir()?;
    let data = folder.path().join("data");
    copy(store, &data)?;
    let mut server = Server::start(&data)?;
    let client = Client::new(server.url());
    let [cpu_before, waited_before] = [process::cpu_ms(server.id()), process::waited_ms(server.id())];
    let begun = Instant::now();
    let out = folder.path().join("out.obj");
    let words = match sent {
        Sent::Scan => vec!["retopo".as_ref(), file.as_os_str(), "-o".as_ref(), out.as_os_str()],
        Sent::Example => vec!["add".as_ref(), file.as_os_str()],
    };
    let said = folder.path().join("said");
    let said_file = std::fs::File::create(&said)?;
    let mut command = client.command(words)?;
    let mut child = command.stdout(Stdio::null()).stderr(said_file).spawn()?;
    let code = wait(&mut child, begun + time_max)?;
    let took_s = begun.elapsed().as_secs_f64();
    let cpu_s = (process::cpu_ms(server.id()) - cpu_before) / 1000.0;
    let waited_s = (process::waited_ms(server.id()) - waited_before) / 1000.0;
    let [_, peak] = process::resident(server.id());
    let said = std::fs::read_to_string(said)?;
    let words = said.lines().find(|line| line.contains("error")).or_else(|| said.lines().next_back());
    let words = words.unwrap_or_default().to_owned();
    Ok(Cost { code, took_s, cpu_s, waited_s, peak, lives: server.is_alive(), words })
}

/// Waits for a child until then; stops it after that.
fn wait(child: &mut Child, until: Instant) -> io::Result<Option<i32>> {
    while Instant::now() < until {
        if let Some(status) = child.try_wait()? {
            return Ok(status.code());
        }
        std::thread::sleep(LOOK_EVERY);
    }
    child.kill()?;
    child.wait()?;
    Ok(None)
}

fn copy(from: &Path, to: &Path) -> io::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        match entry.file_type()?.is_dir() {
            true => copy(&entry.path(), &target)?,
            false => drop(std::fs::copy(entry.path(), target)?),
        }
    }
    Ok(())
}

/// The files to be measured below a folder and the folders in it, in order.
///
/// # Errors
/// The system refuses.
pub fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder)?.flatten().map(|entry| entry.path()) {
            let is_mesh = quadmuse_proto::MeshFormat::from_file_name(&path.to_string_lossy()).is_some();
            match path.is_dir() {
                true => folders.push(path),
                false => files.extend(Some(path).filter(|_| is_mesh)),
            }
        }
    }
    files.sort();
    Ok(files)
}

/// A row of the table.
pub fn row(name: &str, cost: &Cost) -> String {
    let code = cost.code.map_or("stopped".to_owned(), |code| code.to_string());
    let lives = if cost.lives { "" } else { " **ended**" };
    let words: String = cost.words.replace('|', "/").chars().take(110).collect();
    let mib = cost.peak as f64 / f64::from(1 << 20);
    format!(
        "| {name} | {code}{lives} | {:.1} | {:.1} | {:.1} | {mib:.0} | {words} |",
        cost.took_s, cost.cpu_s, cost.waited_s
    )
}
