//! Texts that callers give and people read: names, tags.
//!
//! A control character can garble a terminal or split a line of a log; a direction character shows a text as another than
//! it is (*Source:* Unicode UAX #9, UTS #39; CVE-2021-42574).

/// What would do.
pub const EXPECTED: &str = "without control and direction characters";

/// Characters that change the direction of text, break lines, or are seen by nobody.
const INVISIBLE: [(char, char); 8] = [
    ('\u{00AD}', '\u{00AD}'),
    ('\u{061C}', '\u{061C}'),
    ('\u{180E}', '\u{180E}'),
    ('\u{200B}', '\u{200B}'),
    ('\u{200E}', '\u{200F}'),
    ('\u{2028}', '\u{202E}'),
    ('\u{2060}', '\u{206F}'),
    ('\u{FEFF}', '\u{FEFF}'),
];

fn is_unprintable(c: char) -> bool {
    c.is_control() || INVISIBLE.iter().any(|&(first, last)| (first..=last).contains(&c))
}

/// The first character that a text may not have, in words; `None` if it is fine.
pub fn unprintable(text: &str) -> Option<String> {
    let at = text.chars().position(is_unprintable)?;
    text.chars().nth(at).map(|c| format!("U+{:04X} as its character {}", u32::from(c), at + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_garbles_a_text_is_found_and_letters_of_all_scripts_are_not() {
        for bad in ["a\u{0}b", "a\nb", "a\u{1b}[2J", "a\u{85}", "a\u{202e}cod", "\u{2066}x", "x\u{feff}", "\u{2028}"] {
            assert!(unprintable(bad).is_some(), "{bad:?}");
        }
        for good in ["", "head of a horse", "Pferdekopf, groß", "馬の頭", "رأس", "ראש", "👩\u{200d}🎨", "a\u{301}"]
        {
            assert_eq!(unprintable(good), None, "{good:?}");
        }
        assert_eq!(unprintable("ab\u{7}").expect("a bell"), "U+0007 as its character 3");
    }
}
