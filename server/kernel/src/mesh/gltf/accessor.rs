//! Buffers, views and accessors.

use super::container::Document;
use super::malformed;
use crate::mesh::Limits;
use crate::mesh::error::{FileLocation, MeshError, quoted};
use ::gltf::json::accessor::{Accessor, ComponentType};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, buffer};
use std::borrow::Cow;
use std::cell::OnceCell;

/// The numbers of a document.
pub(super) struct Numbers<'a> {
    pub(super) document: Document<'a>,
    buffers: Vec<OnceCell<Cow<'a, [u8]>>>,
    file_bytes: usize,
    vertices_max: usize,
}

/// Values of an accessor: `width` numbers an element.
pub(super) struct Values {
    pub(super) width: usize,
    pub(super) numbers: Vec<f64>,
}

/// Elements in a view.
#[derive(Clone, Copy)]
struct Layout {
    offset: u64,
    count: usize,
    width: usize,
    component: ComponentType,
    normalized: bool,
}

impl<'a> Numbers<'a> {
    pub(super) fn new(document: Document<'a>, file_bytes: usize, limits: &Limits) -> Self {
        let buffers = (0..document.root.buffers.len()).map(|_| OnceCell::new()).collect();
        Self { document, buffers, file_bytes, vertices_max: limits.vertices_max }
    }

    /// The accessor of an index.
    pub(super) fn accessor(&self, index: Index<Accessor>) -> Result<&Accessor, MeshError> {
        let accessors = &self.document.root.accessors;
        accessors.get(index.value()).ok_or_else(|| missing("accessor", index.value(), accessors.len()))
    }

    /// The values of an accessor; normalised integers become fractions.
    ///
    /// # Errors
    /// What is missing, out of range or too large.
    pub(super) fn values(&self, index: Index<Accessor>) -> Result<Values, MeshError> {
        let accessor = self.accessor(index)?;
        let place = FileLocation::Element("accessor", index.value() as u64);
        let (Checked::Valid(component), Checked::Valid(kind)) = (accessor.component_type, accessor.type_) else {
            return Err(malformed(place, "a known component type and type", "another".into()));
        };
        let count = accessor.count.0;
        if count > self.vertices_max as u64 {
            return Err(MeshError::TooLarge {
                what: "accessor elements",
                found: count,
                limit: self.vertices_max as u64,
            });
        }
        let layout = Layout {
            offset: accessor.byte_offset.map_or(0, |offset| offset.0),
            count: count as usize,
            width: kind.multiplicity(),
            component: component.0,
            normalized: accessor.normalized,
        };
        let mut numbers = match accessor.buffer_view {
            Some(view) => self.elements(place, view, layout)?,
            // Zeros, of which a file cannot need more than it has bytes.
            None if accessor.sparse.is_some() && layout.count <= self.file_bytes => {
                vec![0.0; layout.count * layout.width]
            }
            None => return Err(malformed(place, "a buffer view", format!("none for {count} elements"))),
        };
        if let Some(sparse) = &accessor.sparse {
            let Checked::Valid(index_type) = sparse.indices.component_type else {
                return Err(malformed(place, "a known component type of sparse indices", "another".into()));
            };
            let count = usize::try_from(sparse.count.0).unwrap_or(usize::MAX).min(layout.count);
            let indices = Layout {
                offset: sparse.indices.byte_offset.0,
                count,
                width: 1,
                component: index_type.0,
                normalized: false,
            };
            let indices = self.elements(place, sparse.indices.buffer_view, indices)?;
            let values = Layout { offset: sparse.values.byte_offset.0, count, ..layout };
            let values = self.elements(place, sparse.values.buffer_view, values)?;
            for (index, value) in indices.iter().zip(values.chunks_exact(layout.width)) {
                let start = *index as usize * layout.width;
                let Some(slot) = numbers.get_mut(start..start + layout.width) else {
                    return Err(malformed(place, "sparse indices below the count", index.to_string()));
                };
                slot.copy_from_slice(value);
            }
        }
        Ok(Values { width: layout.width, numbers })
    }

    fn elements(&self, place: FileLocation, view: Index<buffer::View>, layout: Layout) -> Result<Vec<f64>, MeshError> {
        let views = &self.document.root.buffer_views;
        let view = views.get(view.value()).ok_or_else(|| missing("buffer view", view.value(), views.len()))?;
        let buffer = self.buffer(view.buffer.value())?;
        let range = |bytes: &'_ [u8]| {
            let start = usize::try_from(view.byte_offset.map_or(0, |offset| offset.0)).ok()?;
            let end = start.checked_add(usize::try_from(view.byte_length.0).ok()?)?;
            (end <= bytes.len()).then_some(start..end)
        };
        let Some(bytes) = range(buffer).map(|range| &buffer[range]) else {
            let found = format!("{} bytes in a buffer of {}", view.byte_length.0, buffer.len());
            return Err(malformed(place, "a buffer view inside its buffer", found));
        };
        let size = layout.component.size();
        let element = size * layout.width;
        let stride = view.byte_stride.map_or(element, |stride| stride.0);
        let enough = || {
            let start = usize::try_from(layout.offset).ok()?;
            let last = layout.count.saturating_sub(1).checked_mul(stride)?.checked_add(element)?.checked_add(start)?;
            (stride >= element && last <= bytes.len()).then_some(start)
        };
        if layout.count == 0 {
            return Ok(Vec::new());
        }
        let Some(start) = enough() else {
            let found = format!("{} elements of {stride} bytes in {}", layout.count, bytes.len());
            return Err(malformed(place, "elements that fit into the buffer view", found));
        };
        let mut numbers = Vec::with_capacity(layout.count * layout.width);
        for k in 0..layout.count {
            let at = start + k * stride;
            for component in bytes[at..at + element].chunks_exact(size) {
                numbers.push(decode(layout, component));
            }
        }
        Ok(numbers)
    }

    fn buffer(&self, index: usize) -> Result<&[u8], MeshError> {
        let buffers = &self.document.root.buffers;
        let (Some(buffer), Some(cell)) = (buffers.get(index), self.buffers.get(index)) else {
            return Err(missing("buffer", index, buffers.len()));
        };
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let place = FileLocation::Element("buffer", index as u64);
        let bytes = match &buffer.uri {
            Some(uri) => Cow::Owned(embedded(place, uri)?),
            None => match self.document.binary {
                Some(binary) => Cow::Borrowed(binary),
                None => return Err(malformed(place, "an embedded buffer or a binary chunk", "neither".into())),
            },
        };
        Ok(cell.get_or_init(|| bytes))
    }
}

fn missing(what: &'static str, found: usize, available: usize) -> MeshError {
    malformed(FileLocation::File, "references to what is in the file", format!("{what} {found} of {available}"))
}

/// A component from exactly its bytes.
fn decode(layout: Layout, bytes: &[u8]) -> f64 {
    let word = |k: usize| bytes.get(k).copied().unwrap_or(0);
    let (value, largest) = match layout.component {
        ComponentType::I8 => (f64::from(word(0) as i8), f64::from(i8::MAX)),
        ComponentType::U8 => (f64::from(word(0)), f64::from(u8::MAX)),
        ComponentType::I16 => (f64::from(i16::from_le_bytes([word(0), word(1)])), f64::from(i16::MAX)),
        ComponentType::U16 => (f64::from(u16::from_le_bytes([word(0), word(1)])), f64::from(u16::MAX)),
        ComponentType::U32 => {
            (f64::from(u32::from_le_bytes([word(0), word(1), word(2), word(3)])), f64::from(u32::MAX))
        }
        ComponentType::F32 => (f64::from(f32::from_le_bytes([word(0), word(1), word(2), word(3)])), 1.0),
    };
    if layout.normalized { (value / largest).max(-1.0) } else { value }
}

/// The bytes of a `data:` URI.
fn embedded(place: FileLocation, uri: &str) -> Result<Vec<u8>, MeshError> {
    let external = || MeshError::External { uri: quoted(uri.as_bytes()) };
    let data = uri.strip_prefix("data:").ok_or_else(external)?;
    let Some((_, base64)) = data.split_once(";base64,") else {
        return Err(malformed(place, "a data URI in base64", quoted(uri.as_bytes())));
    };
    decode_base64(base64.as_bytes()).map_err(|byte| malformed(place, "base64", format!("the byte {}", quoted(&[byte]))))
}

/// Decodes base64, with or without padding; the byte that does not belong there otherwise.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, u8> {
    let digits = text.strip_suffix(b"==").or(text.strip_suffix(b"=")).unwrap_or(text);
    if digits.len() % 4 == 1 {
        return Err(digits.last().copied().unwrap_or(b'='));
    }
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    for chunk in digits.chunks(4) {
        let mut word = 0u32;
        for k in 0..4 {
            let digit = match chunk.get(k).copied().unwrap_or(b'A') {
                b @ b'A'..=b'Z' => b - b'A',
                b @ b'a'..=b'z' => b - b'a' + 26,
                b @ b'0'..=b'9' => b - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                other => return Err(other),
            };
            word = (word << 6) | u32::from(digit);
        }
        let [_, a, b, c] = word.to_be_bytes();
        bytes.extend_from_slice(&[a, b, c][..chunk.len() - 1]);
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_decoded_as_the_standard_says() {
        for (text, bytes) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg", "foob"), ("Zm9vYmFy", "foobar")]
        {
            assert_eq!(decode_base64(text.as_bytes()).as_deref(), Ok(bytes.as_bytes()), "{text}");
        }
        assert_eq!(decode_base64(b"Zm9*"), Err(b'*'));
        assert_eq!(decode_base64(b"Zm9vY"), Err(b'Y'));
    }
}
