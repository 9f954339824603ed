//! Bytes spoilt in a few places: bits, words that readers stumble over, pieces lost, doubled and cut off.

use crate::dice::Dice;

/// What is put into texts and binaries.
const WORDS: [&[u8]; 18] = [
    b"4294967295",
    b"-1",
    b"nan",
    b"1e999",
    b"18446744073709551616",
    b" ",
    b"\n",
    b"0",
    b"\\\n",
    b"f 1 1 1\n",
    b"{",
    b"[[[[",
    b"\xff\xff\xff\xff",
    b"\x00\x00\x00\x80",
    b"\xdd\xff\xff\xff\xff",
    b"null",
    b"\"",
    b"-",
];
/// Places that are spoilt at most.
const PLACES_MAX: usize = 4;
/// Longest piece that is lost, and that is doubled.
const LOST_MAX: usize = 20;
const DOUBLED_MAX: usize = 40;

/// The same bytes, spoilt.
pub fn damaged(bytes: &[u8], dice: &mut Dice) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..=dice.below(PLACES_MAX) {
        let at = dice.below(out.len());
        match dice.below(6) {
            0 if at < out.len() => out[at] ^= 1 << dice.below(8),
            1 if at < out.len() => out[at] = dice.below(256) as u8,
            2 => out.truncate(at),
            3 => drop(out.drain(at..(at + dice.below(LOST_MAX)).min(out.len()))),
            4 => {
                let piece = out[at..(at + dice.below(DOUBLED_MAX)).min(out.len())].to_vec();
                let to = dice.below(out.len() + 1);
                out.splice(to..to, piece);
            }
            _ => {
                let end = (at + dice.below(4)).min(out.len());
                out.splice(at..end, WORDS[dice.below(WORDS.len())].iter().copied());
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_of_what_is_damaged_differs_and_the_seed_tells_how() {
        let whole = b"a text of some length, to be spoilt here and there".to_vec();
        let spoilt = |seed| damaged(&whole, &mut Dice::new(seed));
        assert!((0..100).filter(|seed| spoilt(*seed) != whole).count() > 80);
        assert!((0..100).all(|seed| spoilt(seed) == spoilt(seed)));
        assert_eq!(damaged(&[], &mut Dice::new(1)).len(), damaged(&[], &mut Dice::new(1)).len());
    }
}
