//! The header of a PLY file.

use crate::mesh::error::{MeshError, quoted};
use crate::mesh::text::{Lines, TextPosition, Words};
use crate::mesh::{Format, Limits};

/// How the body is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one number.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// What a stored colour channel is divided by.
    pub(super) fn color_scale(self) -> f64 {
        match self {
            Self::I8 | Self::U8 => 255.0,
            Self::I16 | Self::U16 => 65_535.0,
            Self::I32 | Self::U32 => f64::from(u32::MAX),
            Self::F32 | Self::F64 => 1.0,
        }
    }
}

/// A property of an element.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Property {
    pub(super) name: String,
    /// Type of the values.
    pub(super) value: Scalar,
    /// Type of the count, if it is a list.
    pub(super) list: Option<Scalar>,
}

/// An element: `count` rows of `properties`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// Line of its declaration.
    pub(super) line: u64,
}

impl Element {
    /// Index of the property with the first of `names` that there is.
    pub(super) fn property(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.properties.iter().position(|p| p.name == *name))
    }

    /// The fewest bytes a row can take.
    pub(super) fn row_bytes_min(&self, encoding: Encoding) -> usize {
        match encoding {
            Encoding::Ascii => 2 * self.properties.len(),
            _ => self.properties.iter().map(|p| p.list.unwrap_or(p.value).size()).sum(),
        }
    }
}

/// The header, and where the body starts.
#[derive(Clone, Debug)]
pub(super) struct Header<'a> {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    pub(super) body: &'a [u8],
    pub(super) body_line: u64,
}

const REMEDY: &str = "correct the header or export the file again";

/// Reads the header.
///
/// # Errors
/// The line that breaks the grammar; a count above its limit or above what the bytes after the header can hold.
pub(super) fn read<'a>(bytes: &'a [u8], limits: &Limits) -> Result<Header<'a>, MeshError> {
    let mut lines = Lines::after(bytes, 0);
    let mut at = TextPosition { format: Format::Ply, line: 1 };
    let magic = lines.next().unwrap_or_default();
    if magic.trim_ascii() != b"ply" {
        return Err(at.error("`ply`", quoted(magic), "send a PLY file or name the right format"));
    }
    let (mut encoding, mut elements) = (None, Vec::<Element>::new());
    loop {
        let Some(line) = lines.next() else {
            at.line = lines.number();
            return Err(at.error(
                "`end_header`",
                "the end of the file".into(),
                "the file is cut short: export it again",
            ));
        };
        at.line = lines.number();
        let mut words = Words::new(line);
        match words.next() {
            None | Some(b"comment" | b"obj_info") => {}
            Some(b"format") => encoding = Some(encoding_of(at, words)?),
            Some(b"element") => elements.push(element(at, words, limits)?),
            Some(b"property") => {
                let property = property(at, words)?;
                let Some(element) = elements.last_mut() else {
                    return Err(at.error("`element` before `property`", quoted(line), REMEDY));
                };
                element.properties.push(property);
            }
            Some(b"end_header") => break,
            Some(_) => return Err(at.error("format, element, property, comment or end_header", quoted(line), REMEDY)),
        }
    }
    let Some(encoding) = encoding else {
        return Err(at.error("a `format` line before `end_header`", "none".into(), REMEDY));
    };
    let body = lines.rest();
    let header = Header { encoding, elements, body, body_line: lines.number() };
    header.check_counts()?;
    Ok(header)
}

impl Header<'_> {
    /// Whether the body can hold what is announced.
    fn check_counts(&self) -> Result<(), MeshError> {
        let mut room = self.body.len() as u64;
        for element in &self.elements {
            // The last line of an ascii body needs no line end.
            let row = element.row_bytes_min(self.encoding) as u64;
            let need = element.count.saturating_mul(row);
            if need > room.saturating_add(1) {
                let at = TextPosition { format: Format::Ply, line: element.line };
                let found =
                    format!("{} rows of `{}` announced and room for {}", element.count, element.name, room / row);
                return Err(at.error("as many rows as announced", found, "the file is cut short: export it again"));
            }
            room = room.saturating_sub(need);
        }
        Ok(())
    }
}

fn encoding_of(at: TextPosition, mut words: Words<'_>) -> Result<Encoding, MeshError> {
    let word = words.next().unwrap_or_default();
    match word {
        b"ascii" => Ok(Encoding::Ascii),
        b"binary_little_endian" => Ok(Encoding::LittleEndian),
        b"binary_big_endian" => Ok(Encoding::BigEndian),
        _ => Err(at.error("ascii, binary_little_endian or binary_big_endian", quoted(word), REMEDY)),
    }
}

fn element(at: TextPosition, mut words: Words<'_>, limits: &Limits) -> Result<Element, MeshError> {
    let name = String::from_utf8_lossy(words.next().unwrap_or_default()).into_owned();
    let word = words.next().unwrap_or_default();
    let count: Option<u64> = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
    let Some(count) = count else {
        return Err(at.error("a name and a whole number after `element`", quoted(word), REMEDY));
    };
    let limit = match name.as_str() {
        "vertex" => Some(("vertices", limits.vertices_max)),
        "face" => Some(("faces", limits.faces_max)),
        _ => None,
    };
    if let Some((what, limit)) = limit.filter(|(_, limit)| count > *limit as u64) {
        return Err(MeshError::TooLarge { what, found: count, limit: limit as u64 });
    }
    Ok(Element { name, count, properties: Vec::new(), line: at.line })
}

fn property(at: TextPosition, mut words: Words<'_>) -> Result<Property, MeshError> {
    let scalar = |word: &[u8]| {
        let expected = "char, uchar, short, ushort, int, uint, float or double";
        Scalar::from_name(word).ok_or_else(|| at.error(expected, quoted(word), REMEDY))
    };
    let first = words.next().unwrap_or_default();
    let (list, value) = if first == b"list" {
        let count = scalar(words.next().unwrap_or_default())?;
        if matches!(count, Scalar::F32 | Scalar::F64) {
            return Err(at.error("a whole-number type for a list's count", "a float".into(), REMEDY));
        }
        (Some(count), scalar(words.next().unwrap_or_default())?)
    } else {
        (None, scalar(first)?)
    };
    let Some(name) = words.next() else {
        return Err(at.error("a name at the end of a property", "nothing".into(), REMEDY));
    };
    Ok(Property { name: String::from_utf8_lossy(name).into_owned(), value, list })
}
