//! What the system tells of a process and of a folder (Linux; 0 where it doesn't).

use std::path::Path;

/// Processor time of all threads so far, in milliseconds.
pub fn cpu_ms(id: u32) -> f64 {
    scheduled_ms(id, 0)
}

/// All threads so far waited for a core so long, in milliseconds: real time that is neither processor time nor sleep.
pub fn waited_ms(id: u32) -> f64 {
    scheduled_ms(id, 1)
}

/// A field of what the system's scheduler tells of threads, summed over all of them.
fn scheduled_ms(id: u32, field: usize) -> f64 {
    let Ok(threads) = std::fs::read_dir(format!("/proc/{id}/task")) else { return 0.0 };
    let of_thread = |entry: std::fs::DirEntry| {
        let text = std::fs::read_to_string(entry.path().join("schedstat")).ok()?;
        text.split(' ').nth(field)?.parse::<f64>().ok()
    };
    threads.flatten().filter_map(of_thread).sum::<f64>() / 1e6
}

/// A thread of a process.
#[derive(Clone, Debug, PartialEq)]
pub struct Thread {
    /// Its number.
    pub id: String,
    /// Its processor time so far, in milliseconds.
    pub cpu_ms: f64,
    /// It neither runs nor waits for a processor.
    pub is_asleep: bool,
}

/// The threads whose names begin so.
pub fn threads(id: u32, name: &str) -> Vec<Thread> {
    let Ok(threads) = std::fs::read_dir(format!("/proc/{id}/task")) else { return Vec::new() };
    let of_thread = |entry: std::fs::DirEntry| {
        let stat = std::fs::read_to_string(entry.path().join("stat")).ok()?;
        // The name stands in brackets, and the state is the word behind it.
        let (before, after) = stat.rsplit_once(')')?;
        let is_named = before.split_once('(')?.1.starts_with(name);
        let times = std::fs::read_to_string(entry.path().join("schedstat")).ok().filter(|_| is_named)?;
        let cpu_ms = times.split(' ').next()?.parse::<f64>().ok()? / 1e6;
        let is_asleep = !after.trim_start().starts_with('R');
        Some(Thread { id: entry.file_name().to_string_lossy().into_owned(), cpu_ms, is_asleep })
    };
    threads.flatten().filter_map(of_thread).collect()
}

/// Resident memory in bytes: now, and the most there was.
pub fn resident(id: u32) -> [u64; 2] {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
    ["VmRSS:", "VmHWM:"].map(|name| {
        let line = status.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_default();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap_or(0) * 1024
    })
}

/// Bytes that a folder takes on the disk, whole blocks counted.
pub fn disk(folder: &Path) -> u64 {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let of_entry = |entry: std::fs::DirEntry| match entry.metadata() {
        Ok(about) if about.is_dir() => disk(&entry.path()),
        Ok(about) => blocks(&about),
        Err(_) => 0,
    };
    entries.flatten().map(of_entry).sum()
}

#[cfg(unix)]
fn blocks(about: &std::fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::blocks(about) * 512
}

#[cfg(not(unix))]
fn blocks(about: &std::fs::Metadata) -> u64 {
    about.len()
}

/// The mean number of processes that wanted a processor in the last minute, as the system tells it.
pub fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().unwrap_or_default().to_owned()
}
