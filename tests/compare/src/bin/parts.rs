//! Cuts every manifold mesh at hand into parts, as needed and one a protrusion, and prints what came of it.
//!
//! `parts [NAME_PART]`: a row a mesh. What takes longer than [`SLOW_S`] is told while it runs, and marked.

use quadmuse_compare::parts::{file, row};
use quadmuse_kernel::segment::PartCount;
use std::process::ExitCode;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Seconds that a surface may take without a word.
const SLOW_S: f64 = 30.0;

fn main() -> ExitCode {
    let name = std::env::args().nth(1).unwrap_or_default();
    let Some(shared) = quadmuse_tests::shared::folder_or_say("the table of parts") else { return ExitCode::SUCCESS };
    let files = match file::manifold(&shared.join("meshes")) {
        Ok(files) => files,
        Err(why) => {
            eprintln!("{why}");
            return ExitCode::FAILURE;
        }
    };
    println!(
        "| mesh | triangles | components, loops, handles | as needed: parts (discs annuli spheres tori) | s | a protrusion each | s |"
    );
    println!("|---|---|---|---|---|---|---|");
    let (mut meshes, mut refused, mut failures) = (0, 0, 0);
    for path in files.iter().filter(|f| f.to_string_lossy().contains(&name)) {
        let stem = path.file_name().unwrap_or_default().to_string_lossy();
        meshes += 1;
        let surface = match file::surface(path) {
            Ok(surface) => surface,
            Err(why) => {
                refused += 1;
                println!("| {stem} | {why} |");
                continue;
            }
        };
        let [needed, protrusions] = [PartCount::AsNeeded, PartCount::Protrusions]
            .map(|count| while_telling(&stem, || row::row(&surface, count)));
        failures += [&needed, &protrusions].iter().filter(|r| r.failed()).count();
        let [components, loops, handles] = needed.shape;
        println!(
            "| {stem} | {} | {components} {loops} {handles} | {} | {} |",
            needed.triangles,
            needed.cells(SLOW_S),
            protrusions.cells(SLOW_S)
        );
    }
    println!("\n{meshes} meshes, {refused} not read, {failures} failures");
    if failures == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Does something, and says so once it takes long.
fn while_telling<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let (done, wait) = channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            if wait.recv_timeout(Duration::from_secs_f64(SLOW_S)) == Err(RecvTimeoutError::Timeout) {
                eprintln!("{what}: still at it after {SLOW_S} s");
            }
        });
        let made = work();
        drop(done);
        made
    })
}
