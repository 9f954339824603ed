//! Rust sources with everything blanked out that is no code: comments, texts, tests.

/// The code of a source: comments and the insides of text literals are blanks, line ends stay where they are.
pub fn code_of(source: &str) -> String {
    let text: Vec<char> = source.chars().collect();
    let mut code = String::with_capacity(source.len());
    let mut at = 0;
    while at < text.len() {
        let end = skipped_until(&text, at);
        if end > at {
            code.extend(text[at..end].iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
            at = end;
        } else {
            code.push(text[at]);
            at += 1;
        }
    }
    code
}

/// Where the comment or literal that begins at `at` ends; `at` if none begins there.
fn skipped_until(text: &[char], at: usize) -> usize {
    let next = |offset: usize| text.get(at + offset).copied().unwrap_or(' ');
    let in_word = at > 0 && (text[at - 1].is_alphanumeric() || text[at - 1] == '_');
    match (text[at], next(1)) {
        ('/', '/') => find(text, at, |rest| rest[0] == '\n'),
        ('/', '*') => end_of_block_comment(text, at),
        ('"', _) => end_of_text(text, at + 1),
        ('r', '"' | '#') if !in_word => end_of_raw_text(text, at + 1).unwrap_or(at),
        ('b', 'r') if !in_word && matches!(next(2), '"' | '#') => end_of_raw_text(text, at + 2).unwrap_or(at),
        // A character, not a lifetime.
        ('\'', '\\') => find(text, at + 3, |rest| rest[0] == '\'') + 1,
        ('\'', c) if c != '\'' && next(2) == '\'' => at + 3,
        _ => at,
    }
    .min(text.len())
}

/// The first place from `at` on where `is_end` holds, or the end of the text.
fn find(text: &[char], at: usize, is_end: impl Fn(&[char]) -> bool) -> usize {
    (at..text.len()).find(|&i| is_end(&text[i..])).unwrap_or(text.len())
}

fn end_of_block_comment(text: &[char], at: usize) -> usize {
    let (mut depth, mut i) = (0, at);
    while i < text.len() {
        if text[i..].starts_with(&['/', '*']) {
            depth += 1;
            i += 2;
        } else if text[i..].starts_with(&['*', '/']) {
            depth -= 1;
            i += 2;
            if depth == 0 {
                return i;
            }
        } else {
            i += 1;
        }
    }
    text.len()
}

fn end_of_text(text: &[char], mut i: usize) -> usize {
    while i < text.len() && text[i] != '"' {
        i += if text[i] == '\\' { 2 } else { 1 };
    }
    i + 1
}

/// The end of a raw text whose `#`s or quote begin at `at`; `None` if it is none (a raw identifier).
fn end_of_raw_text(text: &[char], at: usize) -> Option<usize> {
    let hashes = text[at..].iter().take_while(|&&c| c == '#').count();
    if text.get(at + hashes) != Some(&'"') {
        return None;
    }
    let end: Vec<char> = std::iter::once('"').chain(std::iter::repeat_n('#', hashes)).collect();
    Some(find(text, at + hashes + 1, |rest| rest.starts_with(&end)) + end.len())
}

/// Code (see [`code_of`]) without its items under `#[cfg(test)]`; line ends stay where they are.
pub fn without_tests(code: &str) -> String {
    const MARK: &str = "#[cfg(test)]";
    let mut kept = String::with_capacity(code.len());
    let mut rest = code;
    while let Some(at) = rest.find(MARK) {
        let (before, item) = rest.split_at(at);
        kept.push_str(before);
        let end = item_end(item);
        kept.extend(item[..end].chars().filter(|&c| c == '\n'));
        rest = &item[end..];
    }
    kept.push_str(rest);
    kept
}

/// Where an item ends: behind its braces, or behind the `;` that comes before any.
fn item_end(item: &str) -> usize {
    let mut depth = 0;
    for (at, c) in item.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => {
                depth -= 1;
                if depth == 0 {
                    return at + 1;
                }
            }
            ';' if depth == 0 => return at + 1,
            _ => {}
        }
    }
    item.len()
}

/// The numbers, from 1, of the lines of `code` that hold `word` as a word of its own (`::` may be part of it).
pub fn lines_naming(code: &str, word: &str) -> Vec<usize> {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let holds = |line: &str| {
        line.match_indices(word)
            .any(|(at, _)| !line[..at].ends_with(is_part) && !line[at + word.len()..].starts_with(is_part))
    };
    code.lines().enumerate().filter(|(_, line)| holds(line)).map(|(index, _)| index + 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_texts_are_no_code() {
        let source = r####"use a::b; // sled::c
/* sled /* sled */ sled */ let x: &'static str = "sled \" sled";
let y = (r#"sled " sled"#, b"sled", br"sled", '"', '\'', 's');
let z = r#type;
"####;
        let code = code_of(source);
        assert!(!code.contains("sled"), "{code}");
        for kept in ["use a::b;", "&'static str =", "let z = r#type;"] {
            assert!(code.contains(kept), "{kept} is missing in {code}");
        }
        assert_eq!(code.lines().count(), source.lines().count());
    }

    #[test]
    fn tests_are_left_out_and_what_follows_them_is_not() {
        let source = "fn a() {}\n#[cfg(test)]\nmod tests {\n  fn b() { c() }\n}\n#[cfg(test)]\nmod more;\nfn d() {}\n";
        let code = without_tests(&code_of(source));
        assert!(code.contains("fn a()") && code.contains("fn d()"), "{code}");
        assert!(!code.contains("fn b()") && !code.contains("more"), "{code}");
        assert_eq!(lines_naming(&code, "d"), [8]);
    }

    #[test]
    fn a_word_is_found_only_as_a_whole() {
        assert_eq!(lines_naming("sledge\nuse sled::Db;\nmy_sled\n", "sled"), [2]);
    }
}
