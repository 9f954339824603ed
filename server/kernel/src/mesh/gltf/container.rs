//! The JSON of a glTF file and its binary chunk.

use super::malformed;
use crate::mesh::Limits;
use crate::mesh::error::{FileLocation, MeshError, quoted};
use crate::mesh::text::within;
use ::gltf::json::Root;

/// Objects and arrays in the JSON. An empty node of 3 bytes takes hundreds in memory.
const JSON_CONTAINERS_MAX: usize = 500_000;
/// Values in the JSON.
const JSON_VALUES_MAX: usize = 4_000_000;

const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;

/// The parsed JSON and the binary chunk, if there is one.
pub(super) struct Document<'a> {
    pub(super) root: Root,
    pub(super) binary: Option<&'a [u8]>,
}

/// Splits and parses a file.
///
/// # Errors
/// What is wrong with the container or with the JSON, or the limit that is exceeded.
pub(super) fn open<'a>(bytes: &'a [u8], limits: &Limits) -> Result<Document<'a>, MeshError> {
    let (json, binary) = if bytes.starts_with(b"glTF") { split(bytes)? } else { (bytes, None) };
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    check_json(json, limits)?;
    let root = ::gltf::json::deserialize::from_slice(json).map_err(|error| {
        let found = quoted(error.to_string().as_bytes());
        malformed(FileLocation::Line(error.line() as u64), "JSON as glTF 2.0 demands", found)
    })?;
    check_extensions(&root)?;
    Ok(Document { root, binary })
}

/// The JSON chunk and the binary chunk of a `.glb`.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), MeshError> {
    let version = word(bytes, 4)?;
    if version != 2 {
        return Err(malformed(FileLocation::Byte(4), "glTF version 2", format!("version {version}")));
    }
    let length = word(bytes, 8)? as usize;
    if length > bytes.len() {
        let found = format!("{length} bytes announced and {} there", bytes.len());
        return Err(malformed(FileLocation::Byte(8), "as many bytes as announced", found));
    }
    let (mut json, mut binary, mut at) = (None, None, 12);
    while at + 8 <= length && (json.is_none() || binary.is_none()) {
        let (size, kind) = (word(bytes, at)? as usize, word(bytes, at + 4)?);
        let Some(chunk) = bytes.get(at + 8..).and_then(|rest| rest.get(..size)) else {
            let found = format!("{size} bytes announced and {} there", bytes.len() - at - 8);
            return Err(malformed(FileLocation::Byte(at as u64), "as many bytes as the chunk announces", found));
        };
        match kind {
            JSON_CHUNK if json.is_none() => json = Some(chunk),
            BINARY_CHUNK if json.is_some() => binary = Some(chunk),
            _ if json.is_none() => {
                return Err(malformed(
                    FileLocation::Byte(at as u64),
                    "a JSON chunk first",
                    format!("a chunk of kind {kind:#010x}"),
                ));
            }
            _ => {}
        }
        at += 8 + size.next_multiple_of(4);
    }
    match json {
        Some(json) => Ok((json, binary)),
        None => Err(malformed(FileLocation::Byte(12), "a JSON chunk", "the end of the file".into())),
    }
}

fn word(bytes: &[u8], at: usize) -> Result<u32, MeshError> {
    match bytes.get(at..at + 4).map(<[u8; 4]>::try_from) {
        Some(Ok(word)) => Ok(u32::from_le_bytes(word)),
        _ => Err(malformed(
            FileLocation::Byte(at as u64),
            "a header of 12 bytes and a chunk",
            "the end of the file".into(),
        )),
    }
}

/// Checks depth and size of the JSON before it is parsed.
fn check_json(json: &[u8], limits: &Limits) -> Result<(), MeshError> {
    let (mut depth, mut containers, mut values) = (0usize, 0usize, 0usize);
    let mut at = 0;
    while let Some(byte) = json.get(at) {
        at += 1;
        match byte {
            b'"' => at += string_length(&json[at..]),
            b'{' | b'[' => {
                depth += 1;
                containers += 1;
                within("levels of nested JSON", depth, limits.nesting_max)?;
            }
            b'}' | b']' => depth = depth.saturating_sub(1),
            b',' => values += 1,
            _ => {}
        }
    }
    within("JSON objects and arrays", containers, JSON_CONTAINERS_MAX)?;
    within("JSON values", values, JSON_VALUES_MAX)
}

/// Bytes up to and with the quote that ends a string.
fn string_length(text: &[u8]) -> usize {
    let mut at = 0;
    while let Some(offset) = memchr::memchr2(b'"', b'\\', &text[at..]) {
        at += offset + 1;
        if text[at - 1] == b'"' {
            return at;
        }
        at = (at + 1).min(text.len());
    }
    text.len()
}

/// Extensions that change neither positions nor faces may be required.
fn check_extensions(root: &Root) -> Result<(), MeshError> {
    const HARMLESS: [&str; 7] = [
        "KHR_materials_",
        "KHR_texture_",
        "EXT_texture_",
        "KHR_lights_",
        "KHR_xmp",
        "KHR_mesh_quantization",
        "FB_ngon_encoding",
    ];
    let is_harmless = |name: &String| HARMLESS.iter().any(|prefix| name.starts_with(prefix));
    match root.extensions_required.iter().find(|name| !is_harmless(name)) {
        Some(name) => Err(MeshError::Extension { name: quoted(name.as_bytes()) }),
        None => Ok(()),
    }
}
