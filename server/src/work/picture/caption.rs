//! Discs, rings and captions on finished pictures, and pictures side by side.

use super::{Picture, SIDE_MAX};

/// Gap between pictures and around them, in pixels.
const GAP: u32 = 8;
/// Height of a caption's letters in dots.
const LETTER_ROWS: u32 = 7;
/// Width of a letter and the gap after it, in dots.
const LETTER_STEP: u32 = 6;
/// Most pictures in one row.
const ROW_MAX: usize = 16;
const PAPER: [u8; 3] = [244, 244, 246];
const INK: [u8; 3] = [44, 44, 52];

/// A filled disc with a soft edge, `radius` in pixels.
pub(super) fn disc(picture: &mut Picture, centre: (f32, f32), radius: f32, colour: [u8; 3], opacity: f32) {
    around(picture, centre, radius, |picture, x, y, distance| {
        picture.blend(x, y, colour, opacity * (radius + 0.5 - distance).clamp(0.0, 1.0));
    });
}

/// A circle one pixel wide.
pub(super) fn ring(picture: &mut Picture, centre: (f32, f32), radius: f32, colour: [u8; 3]) {
    around(picture, centre, radius, |picture, x, y, distance| {
        picture.blend(x, y, colour, (1.1 - (distance - radius).abs()).clamp(0.0, 1.0));
    });
}

fn around(
    picture: &mut Picture,
    (cx, cy): (f32, f32),
    radius: f32,
    mut paint: impl FnMut(&mut Picture, u32, u32, f32),
) {
    let reach = radius + 1.5;
    let range = |c: f32, n: u32| ((c - reach).floor().max(0.0) as u32, ((c + reach).ceil().max(0.0) as u32).min(n));
    let ((x0, x1), (y0, y1)) = (range(cx, picture.width()), range(cy, picture.height()));
    for y in y0..y1 {
        for x in x0..x1 {
            let distance = (x as f32 + 0.5 - cx).hypot(y as f32 + 0.5 - cy);
            paint(picture, x, y, distance);
        }
    }
}

/// Pictures in a row on light paper, aligned at the top; at most 16 of them.
pub fn side_by_side(pictures: &[Picture]) -> Picture {
    let captioned: Vec<(&Picture, &str)> = pictures.iter().map(|p| (p, "")).collect();
    side_by_side_captioned(&captioned)
}

/// Pictures in a row, each with a line of text below it. Letters are drawn as capitals; a text that is too wide is cut
/// off; a character without a glyph is a gap.
pub fn side_by_side_captioned(pictures: &[(&Picture, &str)]) -> Picture {
    let row = &pictures[..pictures.len().min(ROW_MAX)];
    let narrowest = row.iter().map(|(p, _)| p.width()).min().unwrap_or(1);
    let dot = (narrowest / 220).clamp(1, 4);
    let text_height = if row.iter().any(|(_, text)| !text.is_empty()) { dot * LETTER_ROWS + GAP } else { 0 };
    let width = row.iter().map(|(p, _)| p.width() + GAP).sum::<u32>() + GAP;
    let height = row.iter().map(|(p, _)| p.height()).max().unwrap_or(1) + 2 * GAP + text_height;
    let mut sheet = Picture::filled(width.min(ROW_MAX as u32 * (SIDE_MAX + GAP) + GAP), height, PAPER);
    let mut x = GAP;
    for (picture, text) in row {
        sheet.paste(picture, x, GAP);
        let fitting = (picture.width() / (dot * LETTER_STEP)) as usize;
        let text: String = text.chars().take(fitting).collect();
        let indent = (picture.width() - dot * LETTER_STEP * text.chars().count() as u32) / 2;
        write(&mut sheet, (x + indent, height - GAP - dot * LETTER_ROWS), dot, &text);
        x += picture.width() + GAP;
    }
    sheet
}

fn write(picture: &mut Picture, (x, y): (u32, u32), dot: u32, text: &str) {
    for (k, letter) in text.chars().enumerate() {
        let Some(rows) = glyph(letter) else { continue };
        for (j, bits) in rows.into_iter().enumerate() {
            for i in (0..5).filter(|i| bits >> (4 - i) & 1 == 1) {
                let (left, top) = (x + dot * (LETTER_STEP * k as u32 + i), y + dot * j as u32);
                for n in 0..dot * dot {
                    picture.set(left + n % dot, top + n / dot, INK);
                }
            }
        }
    }
}

/// Seven rows of five dots, the leftmost dot in bit 4.
fn glyph(letter: char) -> Option<[u8; 7]> {
    let rows = match letter.to_ascii_uppercase() {
        'A' => [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        'B' => [0b11110, 0b10001, 0b10001, 0b11110, 0b10001, 0b10001, 0b11110],
        'C' => [0b01110, 0b10001, 0b10000, 0b10000, 0b10000, 0b10001, 0b01110],
        'D' => [0b11110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b11110],
        'E' => [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111],
        'F' => [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000],
        'G' => [0b01110, 0b10001, 0b10000, 0b10111, 0b10001, 0b10001, 0b01111],
        'H' => [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        'I' => [0b01110, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
        'J' => [0b00111, 0b00010, 0b00010, 0b00010, 0b00010, 0b10010, 0b01100],
        'K' => [0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001],
        'L' => [0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111],
        'M' => [0b10001, 0b11011, 0b10101, 0b10101, 0b10001, 0b10001, 0b10001],
        'N' => [0b10001, 0b11001, 0b11001, 0b10101, 0b10011, 0b10011, 0b10001],
        'O' => [0b01110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110],
        'P' => [0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000],
        'Q' => [0b01110, 0b10001, 0b10001, 0b10001, 0b10101, 0b10010, 0b01101],
        'R' => [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
        'S' => [0b01111, 0b10000, 0b10000, 0b01110, 0b00001, 0b00001, 0b11110],
        'T' => [0b11111, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100],
        'U' => [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110],
        'V' => [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01010, 0b00100],
        'W' => [0b10001, 0b10001, 0b10001, 0b10101, 0b10101, 0b11011, 0b10001],
        'X' => [0b10001, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001, 0b10001],
        'Y' => [0b10001, 0b10001, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100],
        'Z' => [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111],
        '0' => [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110],
        '1' => [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
        '2' => [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111],
        '3' => [0b11110, 0b00001, 0b00001, 0b01110, 0b00001, 0b00001, 0b11110],
        '4' => [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010],
        '5' => [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
        '6' => [0b00110, 0b01000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110],
        '7' => [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b01000, 0b01000],
        '8' => [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110],
        '9' => [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00010, 0b01100],
        '.' => [0, 0, 0, 0, 0, 0b01100, 0b01100],
        ',' => [0, 0, 0, 0, 0b01100, 0b00100, 0b01000],
        ':' => [0, 0b01100, 0b01100, 0, 0b01100, 0b01100, 0],
        '-' | '–' | '—' => [0, 0, 0, 0b11111, 0, 0, 0],
        '_' => [0, 0, 0, 0, 0, 0, 0b11111],
        '+' => [0, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0],
        '=' => [0, 0, 0b11111, 0, 0b11111, 0, 0],
        '/' => [0b00001, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b10000],
        '%' => [0b11001, 0b11001, 0b00010, 0b00100, 0b01000, 0b10011, 0b10011],
        '(' => [0b00010, 0b00100, 0b01000, 0b01000, 0b01000, 0b00100, 0b00010],
        ')' => [0b01000, 0b00100, 0b00010, 0b00010, 0b00010, 0b00100, 0b01000],
        '\'' => [0b00100, 0b00100, 0b01000, 0, 0, 0, 0],
        _ => return None,
    };
    Some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_in_a_row_with_their_captions_below() {
        let (red, blue) = (Picture::filled(40, 30, [200, 0, 0]), Picture::filled(50, 20, [0, 0, 200]));
        let bare = side_by_side(&[red.clone(), blue.clone()]);
        assert_eq!((bare.width(), bare.height()), (40 + 50 + 3 * GAP, 30 + 2 * GAP));
        assert_eq!((bare.pixel(GAP, GAP), bare.pixel(GAP + 40 + GAP, GAP)), ([200, 0, 0], [0, 0, 200]));
        let named = side_by_side_captioned(&[(&red, "I"), (&blue, "a far too long caption, cut off")]);
        let ink = (bare.height() - GAP..named.height())
            .flat_map(|y| (0..48).map(move |x| (x, y)))
            .filter(|&(x, y)| named.pixel(x, y) == INK)
            .count();
        assert_eq!(ink, 11, "the letter I has 11 dots");
    }

    #[test]
    fn no_picture_at_all_is_a_piece_of_paper() {
        assert_eq!(side_by_side(&[]).pixel(0, 0), PAPER);
    }
}
