//! Keeping the results: a file a run in `tests/records/`, with what is needed to compare it to another.

use super::RunError;
use crate::walls::tree::root;
use std::{path::PathBuf, process::Command};

/// What a program prints, trimmed; empty if it can't be run.
fn printed(program: &str, words: &[&str]) -> String {
    let output = Command::new(program).args(words).current_dir(root()).output();
    output.map_or_else(|_| String::new(), |output| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Under which circumstances a run took place: day, commit, profile, processor.
pub fn circumstances() -> String {
    let (day, commit) = (printed("date", &["-u", "+%F"]), printed("git", &["rev-parse", "--short", "HEAD"]));
    let dirty =
        if printed("git", &["status", "--porcelain", "--untracked-files=no"]).is_empty() { "" } else { " (changed)" };
    let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpuinfo.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or_default();
    let model = model.trim_start_matches([' ', '\t', ':']);
    format!("{day}, commit {commit}{dirty}, profile {profile}, {cores} cores ({model})")
}

/// Writes a record; answers with its path.
///
/// # Errors
/// [`RunError::File`].
pub fn write(text: &str) -> Result<PathBuf, RunError> {
    let (day, commit) = (printed("date", &["-u", "+%F"]), printed("git", &["rev-parse", "--short", "HEAD"]));
    let folder = root().join("tests/records");
    let path = folder.join(format!("real-input-{day}-{commit}.md"));
    let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, text));
    written.map_err(|source| RunError::File { path: path.clone(), source })?;
    Ok(path)
}
