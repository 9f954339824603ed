//! Where things are printed: data to standard output, notes and progress to standard error.
//!
//! A terminal gets bars, and tables that are drawn over; anything else gets plain text.

use crate::{
    error::{ClientError, printable},
    paint::Paint,
};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};
use serde::Serialize;
use std::{
    env,
    io::{self, BufRead, IsTerminal, Write},
    time::Duration,
};

/// For whom is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audience {
    /// Tables and sentences.
    People,
    /// JSON, one value a line.
    Programs,
}

/// Describes the screen: its size, `None` where it has no end (a file, a pipe), and whether it shows colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Room {
    /// Columns.
    pub width: Option<u16>,
    /// Lines.
    pub height: Option<u16>,
    /// Colours.
    pub paint: Paint,
}

/// Where things are printed.
pub struct Ui {
    audience: Audience,
    out: Box<dyn Write + Send>,
    notes: Box<dyn Write + Send>,
    terminal: Option<Room>,
    /// Whom to ask; nobody where there is no terminal, or where programs read.
    answers: Option<Box<dyn BufRead + Send>>,
    /// Whether `out` is for data alone, so that all texts go to `notes`.
    sides: Sides,
    notes_paint: Paint,
    /// Where bars are drawn, below each other; it is hidden where nobody sees them.
    bars: MultiProgress,
    /// Lines of the drawing that the next one replaces.
    drawn_lines: usize,
}

/// How often a sign of life moves.
const SPINNER_TICK: Duration = Duration::from_millis(100);
/// A step of unknown length, and one of which is known how far it is.
const SPINNER: &str = "{spinner} {msg}";
const SHARE: &str = "{spinner} {msg} {bar:24} {pos:>3} %";

/// Where texts and values go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sides {
    /// To standard output.
    Out,
    /// To standard error: standard output takes a mesh.
    Notes,
}

/// A style, or indicatif's own where the template is none.
fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Shows on a sign of life what is being done, and how far that is, 0–1.
pub(crate) fn tell_share(spinner: &ProgressBar, what: &str, share: f64) {
    spinner.set_message(printable(what));
    spinner.set_position((100.0 * share.clamp(0.0, 1.0)) as u64);
    if spinner.length().is_none() {
        spinner.set_length(100);
        spinner.set_style(style(SHARE));
    }
}

impl Ui {
    /// Standard output and standard error, as they are.
    pub fn stdout(json: bool) -> Self {
        let (out, err) = (console::Term::stdout(), console::Term::stderr());
        let audience = if json { Audience::Programs } else { Audience::People };
        let (no_color, term) = (env::var_os("NO_COLOR"), env::var_os("TERM"));
        let coloured = Paint::of_terminal(no_color.as_deref(), term.as_deref());
        let terminal = (out.is_term() && !json).then(|| {
            let size = out.size_checked();
            let (height, width) = (size.map(|size| size.0), size.map(|size| size.1));
            Room { width, height, paint: coloured }
        });
        let shown = err.is_term() && !json;
        let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bars = MultiProgress::with_draw_target(target);
        let is_dialogue = io::stdin().is_terminal() && err.is_term() && !json;
        let answers = is_dialogue.then(|| Box::new(io::BufReader::new(io::stdin())) as Box<dyn BufRead + Send>);
        let notes_paint = if err.is_term() && !json { coloured } else { Paint::Plain };
        let (out, notes) = (Box::new(io::stdout()), Box::new(io::stderr()));
        Self { audience, out, notes, terminal, answers, sides: Sides::Out, notes_paint, bars, drawn_lines: 0 }
    }

    /// Two writers in place of the standard ones; `terminal` is what to take the first for.
    pub fn new(
        audience: Audience,
        terminal: Option<Room>,
        out: impl Write + Send + 'static,
        notes: impl Write + Send + 'static,
    ) -> Self {
        Self {
            audience,
            out: Box::new(out),
            notes: Box::new(notes),
            terminal,
            answers: None,
            sides: Sides::Out,
            notes_paint: terminal.unwrap_or_default().paint,
            bars: MultiProgress::with_draw_target(ProgressDrawTarget::hidden()),
            drawn_lines: 0,
        }
    }

    /// With a terminal to draw bars on.
    pub fn with_bars(self, terminal: impl TermLike + 'static) -> Self {
        let target = ProgressDrawTarget::term_like(Box::new(terminal));
        Self { bars: MultiProgress::with_draw_target(target), ..self }
    }

    /// Somewhere to print where nobody reads.
    pub fn silent() -> Self {
        Self::new(Audience::People, None, io::sink(), io::sink())
    }

    /// Somewhere to print where nobody reads, but whose bars are seen below these.
    pub fn silent_below(&self) -> Self {
        Self { bars: self.bars.clone(), ..Self::silent() }
    }

    /// With somebody who answers questions, a line each.
    pub fn answering(self, answers: impl BufRead + Send + 'static) -> Self {
        Self { answers: Some(Box::new(answers)), ..self }
    }

    /// Whether there is somebody who can answer.
    pub fn is_dialogue(&self) -> bool {
        self.answers.is_some()
    }

    /// Asks whether to do something; `y` and `yes` do, anything else does not. `None` where nobody can be asked.
    ///
    /// # Errors
    /// [`ClientError::Output`].
    pub fn ask(&mut self, question: &str) -> Result<Option<bool>, ClientError> {
        let Some(answers) = &mut self.answers else { return Ok(None) };
        self.drawn_lines = 0;
        write!(self.notes, "{} [y/N] ", printable(question))?;
        self.notes.flush()?;
        let mut answer = String::new();
        answers.read_line(&mut answer)?;
        Ok(Some(matches!(answer.trim().to_lowercase().as_str(), "y" | "yes")))
    }

    /// From here on standard output is for data alone: texts and values go to standard error.
    pub fn leave_out_to_data(&mut self) {
        self.sides = Sides::Notes;
        self.terminal = None;
    }

    /// Where texts and values go.
    fn side(&mut self) -> &mut dyn Write {
        match self.sides {
            Sides::Out => &mut self.out,
            Sides::Notes => &mut self.notes,
        }
    }

    /// Writes data to standard output, as they are.
    ///
    /// # Errors
    /// [`ClientError::Output`].
    pub fn data(&mut self, bytes: &[u8]) -> Result<(), ClientError> {
        self.out.write_all(bytes)?;
        Ok(self.out.flush()?)
    }

    /// Whether people read.
    pub fn is_for_people(&self) -> bool {
        self.audience == Audience::People
    }

    /// Whether a drawing can be drawn over.
    pub fn is_live(&self) -> bool {
        self.terminal.is_some()
    }

    /// The room for a table.
    pub fn room(&self) -> Room {
        self.terminal.unwrap_or_default()
    }

    /// Prints a text, a line end behind it. For people only.
    ///
    /// # Errors
    /// [`ClientError::Output`].
    pub fn text(&mut self, text: &str) -> Result<(), ClientError> {
        if self.is_for_people() {
            self.settle();
            writeln!(self.side(), "{}", text.trim_end_matches('\n'))?;
        }
        Ok(())
    }

    /// Prints a value as JSON on a line. For programs only.
    ///
    /// # Errors
    /// [`ClientError::Output`].
    pub fn value(&mut self, value: &impl Serialize) -> Result<(), ClientError> {
        if !self.is_for_people() {
            serde_json::to_writer(self.side(), value).map_err(io::Error::from)?;
            self.side().write_all(b"\n")?;
            self.out.flush()?;
        }
        Ok(())
    }

    /// Draws a text over the one drawn before. On terminals only: elsewhere what changes would stand there again and again.
    ///
    /// # Errors
    /// [`ClientError::Output`].
    pub fn draw(&mut self, text: &str) -> Result<(), ClientError> {
        if !self.is_for_people() || !self.is_live() {
            return Ok(());
        }
        let text = text.trim_end_matches('\n');
        if self.drawn_lines > 0 {
            // To the first column, so many lines up; erase from there to the end of the screen.
            write!(self.out, "\x1b[{}F\x1b[0J", self.drawn_lines)?;
        }
        writeln!(self.out, "{text}")?;
        self.drawn_lines = text.lines().count();
        self.out.flush()?;
        Ok(())
    }

    /// Leaves the last drawing as it is: the next one goes below.
    pub fn settle(&mut self) {
        self.drawn_lines = 0;
    }

    /// A remark beside the data. For people only; that it can't be printed is no failure.
    pub fn note(&mut self, text: &str) {
        if self.is_for_people() {
            self.settle();
            let _ = writeln!(self.notes, "{}", printable(text));
        }
    }

    /// A remark that nobody should miss. For people only.
    pub fn warn(&mut self, text: &str) {
        if self.is_for_people() {
            self.settle();
            let _ = writeln!(self.notes, "{} {}", self.notes_paint.warning("warning:"), printable(text));
        }
    }

    /// Says what went wrong: to people in a sentence, to programs as the problem that the service answered with.
    pub fn report(&mut self, error: &ClientError) {
        if error.is_silent() {
            return;
        }
        if let Some(problem) = error.problem() {
            let _ = self.value(problem);
        }
        self.complain(&error.message());
    }

    /// A sentence about a failure, to whomever.
    pub fn complain(&mut self, text: &str) {
        self.settle();
        let _ = writeln!(self.notes, "{} {}", self.notes_paint.failure("error:"), printable(text));
    }

    /// A progress bar of `length` steps; it is hidden unless standard error is a terminal.
    pub fn bar(&self, length: u64, what: &'static str) -> ProgressBar {
        let bar = ProgressBar::new(length).with_style(style("{prefix} {wide_bar} {pos}/{len}"));
        bar.set_prefix(what);
        self.bars.add(bar)
    }

    /// A sign of life during a step of unknown length; it is hidden unless standard error is a terminal.
    pub fn spinner(&self, what: &'static str) -> ProgressBar {
        let bar = self.bars.add(ProgressBar::no_length().with_style(style(SPINNER)).with_message(what));
        if self.shows_bars() {
            bar.enable_steady_tick(SPINNER_TICK);
        }
        bar
    }

    /// Whether anybody sees bars.
    pub fn shows_bars(&self) -> bool {
        !self.bars.is_hidden()
    }

    /// Hands everything printed to the system.
    ///
    /// # Errors
    /// [`ClientError::Output`].
    pub fn finish(&mut self) -> Result<(), ClientError> {
        Ok(self.out.flush()?)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use quadmuse_proto::{Code, Problem};
    use std::sync::{Arc, Mutex};

    /// A writer whose text can be read while it is in use.
    #[derive(Clone, Default)]
    pub(crate) struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Shared {
        pub(crate) fn text(&self) -> String {
            String::from_utf8(self.0.lock().expect("no panic").clone()).expect("text")
        }
    }

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().expect("no panic").extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_terminal_is_drawn_over_and_a_pipe_is_not() {
        let out = Shared::default();
        let mut ui = Ui::new(Audience::People, Some(Room::default()), out.clone(), io::sink());
        ui.draw("a\nb").expect("prints");
        ui.draw("c").expect("prints");
        ui.text("id").expect("prints");
        ui.draw("d").expect("prints");
        assert_eq!(out.text(), "a\nb\n\x1b[2F\x1b[0Jc\nid\nd\n");

        let out = Shared::default();
        let mut ui = Ui::new(Audience::People, None, out.clone(), io::sink());
        ui.draw("a\nb").expect("prints");
        ui.text("id").expect("prints");
        assert_eq!(out.text(), "id\n");
    }

    #[test]
    fn programs_get_values_and_nothing_else() {
        let (out, notes) = (Shared::default(), Shared::default());
        let mut ui = Ui::new(Audience::Programs, None, out.clone(), notes.clone());
        ui.text("text").expect("prints");
        ui.draw("table").expect("prints");
        ui.note("remark");
        ui.value(&[1, 2]).expect("prints");
        assert_eq!((out.text().as_str(), notes.text().as_str()), ("[1,2]\n", ""));
    }

    #[test]
    fn programs_get_the_problem_and_people_the_sentence() {
        let (out, notes) = (Shared::default(), Shared::default());
        let mut ui = Ui::new(Audience::Programs, None, out.clone(), notes.clone());
        ui.report(&ClientError::Refused(Box::new(Problem::new(Code::NotFound, 404, "expected x, found none"))));
        let value: serde_json::Value = serde_json::from_str(&out.text()).expect("JSON");
        assert_eq!(value["code"], "not_found");
        assert_eq!(notes.text(), "error: expected x, found none (not_found)\n");
    }

    #[test]
    fn only_a_yes_is_one_and_without_a_terminal_nobody_is_asked() {
        let notes = Shared::default();
        let answers = io::Cursor::new("y\nno\n\nYES\n");
        let mut ui = Ui::new(Audience::People, None, io::sink(), notes.clone()).answering(answers);
        let said: Vec<Option<bool>> = (0..5).map(|_| ui.ask("remove \x1b[2Jit?").expect("asks")).collect();
        assert_eq!(said, [Some(true), Some(false), Some(false), Some(true), Some(false)]);
        assert!(notes.text().starts_with("remove \u{fffd}[2Jit? [y/N] "), "{}", notes.text());
        assert_eq!(Ui::silent().ask("?").expect("asks nobody"), None);
    }

    #[test]
    fn where_the_output_is_data_texts_and_values_stand_beside_it() {
        for (audience, said) in [(Audience::People, "text\n"), (Audience::Programs, "7\n")] {
            let (out, notes) = (Shared::default(), Shared::default());
            let mut ui = Ui::new(audience, Some(Room::default()), out.clone(), notes.clone());
            ui.leave_out_to_data();
            ui.text("text").expect("prints");
            ui.draw("table").expect("prints");
            ui.value(&7).expect("prints");
            ui.data(b"v 0 0 0\n").expect("writes");
            assert_eq!((out.text().as_str(), notes.text().as_str()), ("v 0 0 0\n", said));
        }
    }

    #[test]
    fn failures_are_coloured_on_a_terminal_alone() {
        for (paint, expected) in [(Paint::Plain, "error: x\n"), (Paint::Coloured, "\x1b[1;31merror:\x1b[0m x\n")] {
            let notes = Shared::default();
            let room = Room { paint, ..Room::default() };
            Ui::new(Audience::People, Some(room), io::sink(), notes.clone()).complain("x");
            assert_eq!(notes.text(), expected);
        }
    }
}
