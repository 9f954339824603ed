//! The project's programs, built if need be, in the profile of the caller.

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

/// Why a program can't be run.
#[derive(Debug, thiserror::Error)]
pub enum BinaryError {
    /// The caller runs from a place that is no target folder.
    #[error("expected to run from target/PROFILE, found {}; start me with cargo", .0.display())]
    Place(PathBuf),
    /// Cargo failed.
    #[error("expected `cargo build` to build the programs, found that it failed; run it by hand to see why")]
    Build,
    /// The program is not where cargo puts it.
    #[error("expected a program at {}, found none; run `cargo build --workspace`", .0.display())]
    Missing(PathBuf),
}

/// Where cargo puts the programs of the caller's profile: `target/debug` or `target/release`.
fn profile_folder() -> Result<PathBuf, BinaryError> {
    let program = std::env::current_exe().map_err(|_| BinaryError::Place(PathBuf::new()))?;
    let folder = program.parent().unwrap_or(Path::new("."));
    // Tests stand in `deps/`, programs beside it.
    let folder = if folder.ends_with("deps") { folder.parent().unwrap_or(folder) } else { folder };
    let is_target = folder.file_name().is_some_and(|name| name == "debug" || name == "release");
    if is_target { Ok(folder.to_owned()) } else { Err(BinaryError::Place(program)) }
}

/// The program of that name, as the sources have it now: what is stale is built first.
///
/// # Errors
/// [`BinaryError`].
pub fn program(name: &str) -> Result<PathBuf, BinaryError> {
    static BUILT: OnceLock<bool> = OnceLock::new();
    let folder = profile_folder()?;
    let built = *BUILT.get_or_init(|| std::env::var_os("QUADMUSE_TESTS_NO_BUILD").is_some() || build(&folder));
    if !built {
        return Err(BinaryError::Build);
    }
    let path = folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    if path.exists() { Ok(path) } else { Err(BinaryError::Missing(path)) }
}

fn build(folder: &Path) -> bool {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(crate::walls::tree::root()).args(["build", "--quiet", "--workspace", "--bins"]);
    if folder.ends_with("release") {
        cargo.arg("--release");
    }
    if let Some(target) = folder.parent() {
        cargo.arg("--target-dir").arg(target);
    }
    cargo.status().is_ok_and(|status| status.success())
}
