//! The body of a PLY file.

use super::header::{self, Element, Encoding, Header, Scalar};
use super::strips;
use crate::mesh::error::{FileLocation, MeshError, quoted};
use crate::mesh::text::{Lines, TextPosition, Words, number, within};
use crate::mesh::{Attributes, CornerLayer, Format, Limits, PolyMesh, Polygons, Vec3};

/// Reads a PLY file.
///
/// # Errors
/// The line (ascii) or element (binary) that breaks the rules, or the limit that is exceeded.
pub(in crate::mesh) fn read(bytes: &[u8], limits: &Limits) -> Result<PolyMesh, MeshError> {
    let header = header::read(bytes, limits)?;
    let mut body = Body::new(&header);
    let mut mesh = Parts::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" if mesh.positions.is_empty() => mesh.vertices(element, &mut body)?,
            "face" if mesh.faces.is_empty() => mesh.faces(element, &mut body, limits)?,
            "tristrips" if mesh.faces.is_empty() => strips::read(element, &mut body, &mut mesh.faces, limits)?,
            _ => skip(element, &mut body)?,
        }
    }
    mesh.finish()
}

/// Where the next number of the body comes from.
pub(super) enum Body<'a> {
    Ascii { lines: Lines<'a>, words: Words<'a> },
    Binary { rest: &'a [u8], big_endian: bool, row: (&'a str, u64) },
}

impl<'a> Body<'a> {
    fn new(header: &Header<'a>) -> Self {
        match header.encoding {
            Encoding::Ascii => {
                Self::Ascii { lines: Lines::after(header.body, header.body_line), words: Words::new(b"") }
            }
            encoding => {
                Self::Binary { rest: header.body, big_endian: encoding == Encoding::BigEndian, row: ("row", 0) }
            }
        }
    }

    /// Goes to row `row` of an element; blank lines of ascii bodies are passed over.
    pub(super) fn begin_row(&mut self, element: &'a Element, row: u64) -> Result<(), MeshError> {
        match self {
            Self::Ascii { lines, words } => loop {
                let Some(line) = lines.next() else {
                    let at = TextPosition { format: Format::Ply, line: lines.number() };
                    let found =
                        format!("the end of the file after {row} of {} rows of `{}`", element.count, element.name);
                    return Err(at.error("a row", found, "the file is cut short: export it again"));
                };
                if !line.trim_ascii().is_empty() {
                    *words = Words::new(line);
                    return Ok(());
                }
            },
            Self::Binary { row: at, .. } => {
                *at = (&element.name, row);
                Ok(())
            }
        }
    }

    /// The next number of the row.
    #[inline]
    pub(super) fn scalar(&mut self, scalar: Scalar) -> Result<f64, MeshError> {
        match self {
            Self::Ascii { lines, words } => {
                let word = words.next().unwrap_or_default();
                number(word).ok_or_else(|| {
                    let at = TextPosition { format: Format::Ply, line: lines.number() };
                    at.no_number(word, "as many numbers as the header declares")
                })
            }
            Self::Binary { rest, big_endian, row } => {
                let Some((bytes, tail)) = rest.split_at_checked(scalar.size()) else { return Err(cut_short(*row)) };
                *rest = tail;
                Ok(decode(scalar, bytes, *big_endian))
            }
        }
    }

    /// The count of a list; no more than the rest of the file can hold.
    pub(super) fn count(&mut self, count: Scalar, value: Scalar) -> Result<usize, MeshError> {
        let found = self.scalar(count)?;
        let room = match self {
            Self::Ascii { words, .. } => words.bytes_left() / 2,
            Self::Binary { rest, .. } => rest.len() / value.size(),
        };
        if found >= 0.0 && found <= room as f64 && found.fract() == 0.0 {
            return Ok(found as usize);
        }
        let expected = "a list that fits into the rest of the file";
        Err(self.error(
            expected,
            format!("a list of {found} values"),
            "the file is damaged or cut short: export it again",
        ))
    }

    /// Passes over the values of a list.
    pub(super) fn skip_list(&mut self, count: usize, value: Scalar) -> Result<(), MeshError> {
        for _ in 0..count {
            self.scalar(value)?;
        }
        Ok(())
    }

    /// A vertex's number, as it was read.
    #[inline]
    pub(super) fn index(&self, index: f64) -> Result<u32, MeshError> {
        if (0.0..4e9).contains(&index) && index.fract() == 0.0 {
            return Ok(index as u32);
        }
        let remedy = "the file is damaged: export it again";
        Err(self.error("vertex indices (whole numbers from 0)", index.to_string(), remedy))
    }

    fn error(&self, expected: &'static str, found: String, remedy: &'static str) -> MeshError {
        let place = match self {
            Self::Ascii { lines, .. } => FileLocation::Line(lines.number()),
            Self::Binary { row: (name, row), .. } => place(name, *row),
        };
        MeshError::Malformed { format: Format::Ply, place, expected: expected.into(), found, remedy }
    }
}

fn place(name: &str, row: u64) -> FileLocation {
    match name {
        "vertex" => FileLocation::Element("vertex", row),
        "face" => FileLocation::Element("face", row),
        _ => FileLocation::Element("row of another element", row),
    }
}

fn cut_short((name, row): (&str, u64)) -> MeshError {
    MeshError::Malformed {
        format: Format::Ply,
        place: place(name, row),
        expected: "as many values as the header declares".into(),
        found: "the end of the file".into(),
        remedy: "the file is cut short: export it again",
    }
}

/// A number from exactly its bytes.
#[inline]
fn decode(scalar: Scalar, bytes: &[u8], big_endian: bool) -> f64 {
    let mut raw = [0; 8];
    for (k, slot) in raw.iter_mut().take(bytes.len()).enumerate() {
        *slot = bytes[if big_endian { bytes.len() - 1 - k } else { k }];
    }
    let [a, b, c, d, ..] = raw;
    match scalar {
        Scalar::I8 => f64::from(a as i8),
        Scalar::U8 => f64::from(a),
        Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
        Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
        Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
        Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        Scalar::F64 => f64::from_le_bytes(raw),
    }
}

fn skip<'a>(element: &'a Element, body: &mut Body<'a>) -> Result<(), MeshError> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for row in 0..element.count {
        body.begin_row(element, row)?;
        for property in &element.properties {
            match property.list {
                Some(list) => {
                    let count = body.count(list, property.value)?;
                    body.skip_list(count, property.value)?;
                }
                None => drop(body.scalar(property.value)?),
            }
        }
    }
    Ok(())
}

/// What has been read.
#[derive(Default)]
struct Parts {
    positions: Vec<Vec3>,
    vertex_uvs: Option<Vec<[f64; 2]>>,
    normals: Option<Vec<[f64; 3]>>,
    colors: Option<Vec<[f32; 4]>>,
    faces: Polygons,
    corner_uvs: Option<Vec<[f64; 2]>>,
    segments: Option<Vec<i64>>,
}

/// Property names of texture coordinates a vertex, by program.
const UV_NAMES: [[&str; 2]; 4] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

impl Parts {
    fn vertices<'a>(&mut self, element: &'a Element, body: &mut Body<'a>) -> Result<(), MeshError> {
        let find = |name: &str| element.property(&[name]).filter(|p| element.properties[*p].list.is_none());
        let all = |names: &[&str]| names.iter().map(|name| find(name)).collect::<Option<Vec<_>>>();
        let Some(xyz) = all(&["x", "y", "z"]) else {
            let at = TextPosition { format: Format::Ply, line: element.line };
            let names: Vec<_> = element.properties.iter().map(|p| p.name.as_str()).collect();
            let found = quoted(names.join(" ").as_bytes());
            return Err(at.error("the vertex properties x, y and z", found, "export the positions as x, y, z"));
        };
        let normal = all(&["nx", "ny", "nz"]);
        let uv = UV_NAMES.iter().find_map(|names| all(names));
        let rgb = all(&["red", "green", "blue"]).or_else(|| all(&["r", "g", "b"]));
        let alpha = find("alpha").or_else(|| find("a"));
        let mut row_values = vec![0.0; element.properties.len()];
        for row in 0..element.count {
            read_row(element, row, body, &mut row_values)?;
            let at = |p: usize| row_values[p];
            self.positions.push(Vec3::new(at(xyz[0]), at(xyz[1]), at(xyz[2])));
            if let Some(n) = &normal {
                self.normals.get_or_insert_default().push([at(n[0]), at(n[1]), at(n[2])]);
            }
            if let Some(uv) = &uv {
                self.vertex_uvs.get_or_insert_default().push([at(uv[0]), at(uv[1])]);
            }
            if let Some(rgb) = &rgb {
                let channel = |p: usize| (at(p) / element.properties[p].value.color_scale()) as f32;
                let color = [channel(rgb[0]), channel(rgb[1]), channel(rgb[2]), alpha.map_or(1.0, channel)];
                self.colors.get_or_insert_default().push(color.map(|c| if c.is_finite() { c } else { 1.0 }));
            }
        }
        Ok(())
    }

    fn faces<'a>(&mut self, element: &'a Element, body: &mut Body<'a>, limits: &Limits) -> Result<(), MeshError> {
        let is_list = |p: &usize| element.properties[*p].list.is_some();
        let Some(indices) = element.property(&["vertex_indices", "vertex_index", "vertex_indexes"]).filter(is_list)
        else {
            if element.count == 0 {
                return Ok(());
            }
            let at = TextPosition { format: Format::Ply, line: element.line };
            let found = format!("a face element with {} other properties", element.properties.len());
            return Err(at.error("the list property vertex_indices", found, "export the faces as vertex_indices"));
        };
        let uvs = element.property(&["texcoord", "texcoords"]).filter(is_list);
        let segment = element.property(&["segment"]).filter(|p| !is_list(p));
        let (mut face, mut uv_list) = (Vec::<u32>::new(), Vec::<f64>::new());
        let mut has_uvs = uvs.is_some();
        for row in 0..element.count {
            body.begin_row(element, row)?;
            for (p, property) in element.properties.iter().enumerate() {
                let Some(list) = property.list else {
                    let value = body.scalar(property.value)?;
                    if Some(p) == segment {
                        self.segments.get_or_insert_default().push(value as i64);
                    }
                    continue;
                };
                let count = body.count(list, property.value)?;
                if p == indices {
                    within("corners in one face", count, limits.degree_max)?;
                    read_face(body, count, property.value, &mut face)?;
                } else if Some(p) == uvs {
                    uv_list.clear();
                    for _ in 0..count {
                        uv_list.push(body.scalar(property.value)?);
                    }
                } else {
                    body.skip_list(count, property.value)?;
                }
            }
            self.faces.push(&face);
            within("corners", self.faces.corners().len(), limits.corners_max)?;
            has_uvs &= uv_list.len() == 2 * face.len();
            if has_uvs {
                let pairs = uv_list.chunks_exact(2).map(|pair| [pair[0], pair[1]]);
                self.corner_uvs.get_or_insert_default().extend(pairs);
            }
        }
        if !has_uvs {
            self.corner_uvs = None;
        }
        Ok(())
    }

    fn finish(self) -> Result<PolyMesh, MeshError> {
        let Self { positions, vertex_uvs, normals, colors, faces, corner_uvs, segments } = self;
        for (f, face) in faces.iter().enumerate() {
            if let Some(vertex) = face.iter().find(|v| **v as usize >= positions.len()) {
                return Err(MeshError::IndexOutOfRange {
                    format: Format::Ply,
                    place: FileLocation::Element("face", f as u64),
                    what: "a vertex",
                    found: format!("{} (PLY counts from 0)", vertex),
                    available: positions.len(),
                });
            }
        }
        let of_vertices = faces.corners().to_vec();
        let uvs = match (corner_uvs, vertex_uvs) {
            (Some(values), _) => Some(CornerLayer { corners: (0..values.len() as u32).collect(), values }),
            (None, Some(values)) => Some(CornerLayer { values, corners: of_vertices.clone() }),
            (None, None) => None,
        };
        let normals = normals.map(|values| CornerLayer { values, corners: of_vertices });
        let attributes = Attributes { uvs, normals, colors, segments, ..Attributes::default() };
        Ok(PolyMesh { positions, faces, attributes })
    }
}

/// Reads a row's scalars into `values` (0 for lists).
#[inline]
fn read_row<'a>(element: &'a Element, row: u64, body: &mut Body<'a>, values: &mut [f64]) -> Result<(), MeshError> {
    body.begin_row(element, row)?;
    for (value, property) in values.iter_mut().zip(&element.properties) {
        match property.list {
            None => *value = body.scalar(property.value)?,
            Some(list) => {
                let count = body.count(list, property.value)?;
                body.skip_list(count, property.value)?;
            }
        }
    }
    Ok(())
}

fn read_face(body: &mut Body<'_>, count: usize, value: Scalar, face: &mut Vec<u32>) -> Result<(), MeshError> {
    face.clear();
    for _ in 0..count {
        let index = body.scalar(value)?;
        face.push(body.index(index)?);
    }
    if count < 3 {
        let found = format!("{count} corners");
        return Err(body.error("faces of at least three corners", found, "remove the face or export it as an edge"));
    }
    Ok(())
}
