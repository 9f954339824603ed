//! Colours on a terminal: few, and never the only sign of anything.

use quadmuse_proto::Verdict;
use std::ffi::OsStr;

/// Whether a text is coloured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paint {
    /// Text alone.
    #[default]
    Plain,
    /// With the escape sequences of a terminal.
    Coloured,
}

const BOLD: &str = "1";
const RED: &str = "31";
const GREEN: &str = "32";
const YELLOW: &str = "33";
const BOLD_RED: &str = "1;31";

impl Paint {
    /// Chooses colours for a terminal by the variables `NO_COLOR` (<https://no-color.org>; empty, it counts as none) and `TERM`.
    pub fn of_terminal(no_color: Option<&OsStr>, term: Option<&OsStr>) -> Self {
        let is_refused = no_color.is_some_and(|value| !value.is_empty());
        if is_refused || term.is_some_and(|term| term == "dumb") { Self::Plain } else { Self::Coloured }
    }

    fn with(self, codes: &str, text: &str) -> String {
        match self {
            Self::Plain => text.to_owned(),
            Self::Coloured => format!("\x1b[{codes}m{text}\x1b[0m"),
        }
    }

    /// The word before a failure.
    pub fn failure(self, text: &str) -> String {
        self.with(BOLD_RED, text)
    }

    /// The word before a warning.
    pub fn warning(self, text: &str) -> String {
        self.with(YELLOW, text)
    }

    /// Marks a heading.
    pub fn heading(self, text: &str) -> String {
        self.with(BOLD, text)
    }

    /// A text in the colour of a verdict.
    pub fn verdict(self, verdict: Verdict, text: &str) -> String {
        let codes = match verdict {
            Verdict::Good => GREEN,
            Verdict::Fair => YELLOW,
            Verdict::Poor => RED,
            Verdict::Broken => BOLD_RED,
        };
        self.with(codes, text)
    }

    /// A table whose first line is its header.
    pub fn table(self, table: &str) -> String {
        match table.split_once('\n') {
            Some((header, rest)) => format!("{}\n{rest}", self.heading(header)),
            None => table.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_for_terminals_whose_user_wants_them() {
        let of = |no_color: Option<&str>, term: Option<&str>| {
            Paint::of_terminal(no_color.map(OsStr::new), term.map(OsStr::new))
        };
        assert_eq!(of(None, Some("xterm")), Paint::Coloured);
        assert_eq!(of(Some(""), None), Paint::Coloured, "an empty variable counts as none");
        assert_eq!(of(Some("0"), Some("xterm")), Paint::Plain, "whatever its value");
        assert_eq!(of(None, Some("dumb")), Paint::Plain);
    }

    #[test]
    fn a_verdict_has_a_colour_of_its_own_and_keeps_its_word() {
        let all = [Verdict::Good, Verdict::Fair, Verdict::Poor, Verdict::Broken];
        let mut painted: Vec<String> = all.iter().map(|&v| Paint::Coloured.verdict(v, "x")).collect();
        assert!(painted.iter().all(|text| text.starts_with("\x1b[") && text.ends_with("mx\x1b[0m")), "{painted:?}");
        painted.dedup();
        assert_eq!(painted.len(), 4);
        assert_eq!(Paint::Plain.verdict(Verdict::Good, "x"), "x");
    }
}
