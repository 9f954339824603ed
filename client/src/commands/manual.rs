//! `completions` and `man`: made from the command line's own description, so that they can't differ from it.

use crate::{args::Cli, error::ClientError, file, ui::Ui};
use clap::CommandFactory;
use clap_complete::Shell;
use clap_mangen::Man;
use std::path::Path;

/// The program's name.
const PROGRAM: &str = "quadmuse";

pub(super) fn completions(shell: Shell, ui: &mut Ui) -> Result<(), ClientError> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), PROGRAM, &mut script);
    ui.data(&script)
}

/// Prints the page of a command, or of the program itself.
pub(super) fn page(command: Option<&str>, ui: &mut Ui) -> Result<(), ClientError> {
    let mut all = all();
    let page = match command {
        None => all.swap_remove(0),
        Some(found) => {
            let sought = format!("{PROGRAM}-{found}");
            let place = all.iter().position(|page| page.name == sought);
            all.swap_remove(place.ok_or_else(|| ClientError::NoSuchCommand { found: found.into() })?)
        }
    };
    ui.data(&page.text)
}

/// Writes all pages to a folder.
pub(super) fn pages(dir: &Path, ui: &mut Ui) -> Result<(), ClientError> {
    let unwritable = |source| ClientError::Unwritable { path: dir.into(), source };
    std::fs::create_dir_all(dir).map_err(unwritable)?;
    let all = all();
    for page in &all {
        file::write(&dir.join(&page.name).with_extension("1"), &page.text)?;
    }
    ui.note(&format!("{} pages written to {}", all.len(), dir.display()));
    Ok(())
}

/// A manual page.
struct Page {
    /// `quadmuse-add`.
    name: String,
    /// As roff.
    text: Vec<u8>,
}

/// The program's page, and then one a command.
fn all() -> Vec<Page> {
    let mut program = Cli::command();
    // What is common to all commands is handed down to them here.
    program.build();
    let commands = program.get_subcommands().filter(|command| command.get_name() != "help").cloned();
    let commands: Vec<clap::Command> = commands.collect();
    std::iter::once(program).chain(commands).map(page_of).collect()
}

fn page_of(command: clap::Command) -> Page {
    let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
    let source = format!("{PROGRAM} {}", env!("CARGO_PKG_VERSION"));
    let mut text = Vec::new();
    // A vector takes whatever is written to it.
    let _ = Man::new(command).title(name.to_uppercase()).source(source).render(&mut text);
    Page { name, text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_that_tells_its_flags() {
        let all = all();
        assert_eq!(all[0].name, "quadmuse");
        assert_eq!(all.len(), 1 + Cli::command().get_subcommands().count());
        for page in &all {
            let text = String::from_utf8(page.text.clone()).expect("text");
            assert!(text.contains(&format!(".TH {}", page.name.to_uppercase())), "{}: {text}", page.name);
            assert!(text.contains("\\fBQUADMUSE_SERVER\\fR environment variable"), "{}: {text}", page.name);
        }
        let batch = all.iter().find(|page| page.name == "quadmuse-batch").expect("a page");
        assert!(String::from_utf8_lossy(&batch.text).contains("pictures"));
    }
}
