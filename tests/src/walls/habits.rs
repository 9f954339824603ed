//! Habits that hold in every source: short files, nothing left to do, no test left out, nothing unsafe.

use super::source::{code_of, lines_naming};

/// Lines of a source at which it is to be split.
pub const FILE_LINES_MAX: usize = 600;

/// What a source does against the habits.
pub fn complaints(path: &str, source: &str) -> Vec<String> {
    let mut found = Vec::new();
    let lines = source.lines().count();
    if lines > FILE_LINES_MAX {
        found.push(format!("{path} has {lines} lines; split it by ideas below {FILE_LINES_MAX}"));
    }
    if path.ends_with("/mod.rs") {
        found.push(format!("{path} is a mod.rs; name it after its folder, and put it beside that"));
    }
    let code = code_of(source);
    for (word, way_out) in [
        ("todo!", "finish it, or leave it out"),
        ("unimplemented!", "finish it, or leave it out"),
        ("#[ignore", "mend the test, or remove it"),
        ("allow(unsafe_code)", "find a safe way"),
        ("dbg!", "remove it, or log it"),
    ] {
        found.extend(lines_holding(&code, word).map(|line| format!("{path}:{line} has {word}; {way_out}")));
    }
    let later = concat!("FIX", "ME");
    found.extend(lines_naming(source, later).into_iter().map(|line| format!("{path}:{line} has {later}; do it now")));
    found
}

fn lines_holding<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    code.lines().enumerate().filter(move |(_, line)| line.contains(word)).map(|(index, _)| index + 1)
}
