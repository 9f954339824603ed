//! Every command line in the guides is one that the program takes.

use quadmuse_client::args::Cli;
use std::{fs, path::Path};

/// Command lines that there are at least: fewer mean that they are no longer found.
const LINES_MIN: usize = 40;

/// The words and operators of a shell line; quotes hold words together, and a comment ends it.
fn words(line: &str) -> Vec<String> {
    let (mut all, mut word, mut quote, mut is_word) = (Vec::new(), String::new(), None, false);
    let mut close = |word: &mut String, is_word: &mut bool| {
        if std::mem::take(is_word) {
            all.push(std::mem::take(word));
        }
    };
    for c in line.chars() {
        match (quote, c) {
            (Some(q), c) if c == q => quote = None,
            (Some(_), c) => word.push(c),
            (None, '\'' | '"') => (quote, is_word) = (Some(c), true),
            (None, '#') if !is_word => break,
            (None, c) if c.is_whitespace() => close(&mut word, &mut is_word),
            (None, '|' | ';' | '&' | '>' | '<' | '(' | ')') => {
                close(&mut word, &mut is_word);
                (word, is_word) = (c.to_string(), true);
                close(&mut word, &mut is_word);
            }
            (None, c) => {
                word.push(c);
                is_word = true;
            }
        }
    }
    close(&mut word, &mut is_word);
    all
}

/// The calls of `quadmuse` in a shell line, each from its name to where it ends.
fn calls(line: &str) -> Vec<Vec<String>> {
    let all = words(line);
    let mut found = Vec::new();
    for command in all.split(|word| matches!(word.as_str(), "|" | ";" | "&" | "(" | ")")) {
        // What is redirected is no argument.
        let end = command.iter().position(|word| matches!(word.as_str(), ">" | "<")).unwrap_or(command.len());
        let is_setting = |word: &&String| word.split_once('=').is_some_and(|(name, _)| !name.contains(['-', '/', '.']));
        let begin = command.iter().take_while(is_setting).count();
        if begin < end && command[begin] == "quadmuse" {
            found.push(command[begin..end].to_vec());
        }
    }
    found
}

/// The shell lines of a page: those of its blocks of `sh`, and code in its sentences that begins with `quadmuse`. One with a
/// `…` is no whole line.
fn shell_lines(page: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let (mut block, mut goes_on) = (None, false);
    for line in page.lines() {
        if let Some(language) = line.trim_start().strip_prefix("```") {
            block = if block.is_none() { Some(language.to_owned()) } else { None };
        } else if block.as_deref() == Some("sh") {
            let (text, more) = line.strip_suffix('\\').map_or((line, false), |text| (text, true));
            match found.last_mut() {
                Some(last) if goes_on => last.push_str(text),
                _ => found.push(text.to_owned()),
            }
            goes_on = more;
        } else if block.is_none() {
            let code = line.split('`').skip(1).step_by(2);
            // A table writes the bar of a pipe with a backslash.
            found.extend(code.filter(|code| code.contains("quadmuse ")).map(|code| code.replace("\\|", "|")));
        }
    }
    found.retain(|line| !line.contains('…'));
    found
}

/// What is wrong with the command lines of a page, and how many there are.
fn judged(name: &str, page: &str) -> (Vec<String>, usize) {
    let all: Vec<Vec<String>> = shell_lines(page).iter().flat_map(|line| calls(line)).collect();
    let wrong = all.iter().filter_map(|call| {
        let refused = Cli::read(call.iter().map(Into::into)).err().filter(clap::Error::use_stderr)?;
        Some(format!("{name}: `{}`: {refused}", call.join(" ")))
    });
    (wrong.collect(), all.len())
}

#[test]
fn every_command_line_of_the_guides_is_taken() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a root");
    let mut pages = vec![root.join("README.md"), root.join("docker/README.md")];
    let guides = fs::read_dir(root.join("docs")).expect("a folder of guides").map(|entry| entry.expect("reads").path());
    pages.extend(guides.filter(|path| path.extension().is_some_and(|end| end == "md")));
    let (mut wrong, mut count) = (Vec::new(), 0);
    for path in pages {
        let (found, lines) = judged(&path.display().to_string(), &fs::read_to_string(&path).expect("reads"));
        wrong.extend(found);
        count += lines;
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
    assert!(count >= LINES_MIN, "only {count} command lines were found");
}

#[test]
fn a_line_that_is_not_taken_is_found_wherever_it_stands() {
    for page in [
        "```sh\ncat a | quadmuse retopo - -o - --no-such-flag > b   # why\n```",
        "```sh\nquadmuse map @last \\\n    --landmark '1,2,3' -o out.obj\n```",
        "```sh\nQ=$(TOKEN=x quadmuse querry a.obj)\n```",
        "Ask by `quadmuse querry a.obj`, and so on.",
        "| a | `cat a \\| quadmuse retopo - -o out.docx` |",
    ] {
        assert_eq!(judged("page", page).0.len(), 1, "{page}");
    }
    for page in [
        "```sh\nquadmuse map @last -o out.obj \\\n    --landmark '1,2,3=4,5,6'   # quadmuse nothing\n```",
        "```json\nquadmuse querry\n```",
        "`quadmuse-server serve`, `quadmuse add FILE…`, `quadmuse help map`",
    ] {
        assert!(judged("page", page).0.is_empty(), "{page}: {:?}", judged("page", page));
    }
}
