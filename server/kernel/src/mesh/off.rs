//! OFF, the object file format of Geomview, with its header variants (`OFF`, `COFF`, `NOFF`, `STOFF`, `STCNOFF`, …).
//!
//! The header word may be missing, counts may stand on its line, and `#` starts a comment anywhere. Four-dimensional,
//! n-dimensional and binary files are refused. Colours of faces are not kept.

use super::error::{FileLocation, MeshError, quoted};
use super::format::is_off_header;
use super::text::{Lines, TextPosition, Words, decoded, number, push_integer, push_number, within};
use super::{Attributes, CornerLayer, Format, Limits, PolyMesh, Polygons, Vec3};

/// Reads an OFF file.
///
/// # Errors
/// The line that breaks the rules, or the limit that is exceeded.
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<PolyMesh, MeshError> {
    let bytes = decoded(Format::Off, bytes)?;
    let mut rows = Rows { lines: Lines::new(bytes) };
    let (at, mut words) = rows.next("a header")?;
    let mut layout = Layout::default();
    if is_off_header(words.rest()) {
        layout = Layout::new(at, words.next().unwrap_or_default())?;
        if words.rest().eq_ignore_ascii_case(b"binary") {
            return Err(at.error("an ascii file", "a binary one".into(), "export it as ascii OFF, PLY or OBJ"));
        }
    }
    let (at, mut words) = if words.rest().is_empty() { rows.next("the counts")? } else { (at, words) };
    let [vertices, faces] = counts(at, &mut words, bytes.len(), limits)?;
    let mut mesh = Parts::default();
    for _ in 0..vertices {
        let (at, words) = rows.next("a vertex")?;
        mesh.vertex(at, words, layout)?;
    }
    for _ in 0..faces {
        let (at, words) = rows.next("a face")?;
        mesh.face(at, words, limits)?;
    }
    Ok(mesh.finish())
}

const REMEDY: &str = "correct the line or export the file again";

/// Lines with something on them, without comments.
struct Rows<'a> {
    lines: Lines<'a>,
}

impl<'a> Rows<'a> {
    fn next(&mut self, expected: &'static str) -> Result<(TextPosition, Words<'a>), MeshError> {
        loop {
            let line = self.lines.next();
            let at = TextPosition { format: Format::Off, line: self.lines.number() };
            let Some(line) = line else {
                return Err(at.error(expected, "the end of the file".into(), "the file is cut short: export it again"));
            };
            let text = &line[..memchr::memchr(b'#', line).unwrap_or(line.len())];
            if !text.trim_ascii().is_empty() {
                return Ok((at, Words::new(text)));
            }
        }
    }
}

/// What a vertex line holds besides the position.
#[derive(Clone, Copy, Default)]
struct Layout {
    uvs: bool,
    normals: bool,
    colors: bool,
}

impl Layout {
    fn new(at: TextPosition, word: &[u8]) -> Result<Self, MeshError> {
        let prefix = word.strip_suffix(b"OFF").unwrap_or(word);
        let (uvs, rest) = match prefix.strip_prefix(b"ST") {
            Some(rest) => (true, rest),
            None => (false, prefix),
        };
        let (mut colors, mut normals) = (false, false);
        for b in rest {
            match b {
                b'C' => colors = true,
                b'N' => normals = true,
                _ => {
                    let remedy = "export three-dimensional positions";
                    return Err(at.error("OFF with ST, C or N before it", quoted(word), remedy));
                }
            }
        }
        Ok(Self { uvs, normals, colors })
    }
}

fn whole(word: &[u8]) -> Option<u64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Numbers of vertices and faces, which the file must be long enough for.
fn counts(at: TextPosition, words: &mut Words<'_>, bytes: usize, limits: &Limits) -> Result<[usize; 2], MeshError> {
    let mut counts = [0; 2];
    for (k, (what, limit)) in [("vertices", limits.vertices_max), ("faces", limits.faces_max)].into_iter().enumerate() {
        let word = words.next().unwrap_or_default();
        let count = whole(word).ok_or_else(|| at.error("the numbers of vertices and faces", quoted(word), REMEDY))?;
        if count > limit as u64 {
            return Err(MeshError::TooLarge { what, found: count, limit: limit as u64 });
        }
        counts[k] = count as usize;
    }
    // A vertex takes 6 bytes at least (`0 0 0` and a line end), a face 8.
    if 6 * counts[0] + 8 * counts[1] > bytes + 8 {
        let found = format!("{} vertices and {} faces announced in {bytes} bytes", counts[0], counts[1]);
        return Err(at.error("as many elements as announced", found, "the file is cut short: export it again"));
    }
    Ok(counts)
}

#[derive(Default)]
struct Parts {
    positions: Vec<Vec3>,
    normals: Vec<[f64; 3]>,
    colors: Vec<[f32; 4]>,
    uvs: Vec<[f64; 2]>,
    faces: Polygons,
    face: Vec<u32>,
}

impl Parts {
    fn vertex(&mut self, at: TextPosition, mut words: Words<'_>, layout: Layout) -> Result<(), MeshError> {
        self.positions.push(at.point(&mut words, "three coordinates of a vertex")?);
        if layout.normals {
            self.normals.push(at.point(&mut words, "a normal after the position")?.into());
        }
        let uv_count = if layout.uvs { 2 } else { 0 };
        if layout.colors {
            let channels = words.clone().count().saturating_sub(uv_count);
            let mut color = [1.0f64; 4];
            for channel in color.iter_mut().take(channels) {
                *channel = at.number(&mut words, "a colour after the position")?;
            }
            // Whole numbers above 1 are of 0–255.
            let scale = if color[..3].iter().any(|c| *c > 1.0) { 255.0 } else { 1.0 };
            let alpha = if channels > 3 { color[3] / scale } else { 1.0 };
            let channel = |c: f64| if c.is_finite() { (c / scale) as f32 } else { 1.0 };
            self.colors.push([channel(color[0]), channel(color[1]), channel(color[2]), alpha as f32]);
        }
        if layout.uvs {
            let u = at.number(&mut words, "texture coordinates at the end")?;
            self.uvs.push([u, at.number(&mut words, "texture coordinates at the end")?]);
        }
        Ok(())
    }

    fn face(&mut self, at: TextPosition, mut words: Words<'_>, limits: &Limits) -> Result<(), MeshError> {
        let word = words.next().unwrap_or_default();
        let degree = whole(word).ok_or_else(|| at.error("a number of corners", quoted(word), REMEDY))?;
        if degree < 3 {
            return Err(at.error("at least three corners", format!("{degree} corners"), "remove the face"));
        }
        within("corners in one face", usize::try_from(degree).unwrap_or(usize::MAX), limits.degree_max)?;
        self.face.clear();
        for _ in 0..degree {
            let word = words.next().unwrap_or_default();
            let index =
                whole(word).or_else(|| number(word).filter(|x| x.fract() == 0.0 && *x >= 0.0).map(|x| x as u64));
            let index = index.ok_or_else(|| at.error("vertex indices (whole numbers from 0)", quoted(word), REMEDY))?;
            if index >= self.positions.len() as u64 {
                return Err(MeshError::IndexOutOfRange {
                    format: Format::Off,
                    place: FileLocation::Line(at.line),
                    what: "a vertex",
                    found: format!("{index} (OFF counts from 0)"),
                    available: self.positions.len(),
                });
            }
            self.face.push(index as u32);
        }
        self.faces.push(&self.face);
        within("corners", self.faces.corners().len(), limits.corners_max)
    }

    fn finish(self) -> PolyMesh {
        let corners = || self.faces.corners().to_vec();
        let attributes = Attributes {
            uvs: (!self.uvs.is_empty()).then(|| CornerLayer { values: self.uvs, corners: corners() }),
            normals: (!self.normals.is_empty()).then(|| CornerLayer { values: self.normals, corners: corners() }),
            colors: (!self.colors.is_empty()).then_some(self.colors),
            ..Attributes::default()
        };
        PolyMesh { positions: self.positions, faces: self.faces, attributes }
    }
}

/// Writes positions and polygons.
pub(super) fn write(mesh: &PolyMesh) -> Vec<u8> {
    let mut out = Vec::with_capacity(32 * mesh.positions.len() + 8 * mesh.faces.corners().len());
    out.extend_from_slice(b"OFF\n");
    let spaced = |out: &mut Vec<u8>, k: usize| {
        if k > 0 {
            out.push(b' ');
        }
    };
    for (k, count) in [mesh.positions.len(), mesh.faces.len(), 0].into_iter().enumerate() {
        spaced(&mut out, k);
        push_integer(&mut out, count as u64);
    }
    out.push(b'\n');
    for position in &mesh.positions {
        for (k, x) in position.iter().enumerate() {
            spaced(&mut out, k);
            push_number(&mut out, *x);
        }
        out.push(b'\n');
    }
    for face in mesh.faces.iter() {
        push_integer(&mut out, face.len() as u64);
        for v in face {
            out.push(b' ');
            push_integer(&mut out, u64::from(*v));
        }
        out.push(b'\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<PolyMesh, MeshError> {
        read(text.as_bytes(), &Limits::default())
    }

    const BODY: &str = "0 0 0\n1 0 0 # a comment\n\n0 1 0\n3 0 1 2 255 0 0\n";

    #[test]
    fn counts_stand_where_they_like() {
        for head in ["OFF\n3 1 0\n", "OFF 3 1 0\n", "OFF 3 1\n", "# c\nOFF # x\n# y\n3 1 3\n", "3 1 0\n"] {
            let mesh = parse(&format!("{head}{BODY}")).expect(head);
            assert_eq!((mesh.positions.len(), mesh.faces.face(0)), (3, [0, 1, 2].as_slice()), "{head}");
        }
    }

    #[test]
    fn vertex_lines_hold_what_the_header_says() {
        let rows = "0 0 0  0 0 1  255 0 0 51  .25 .5\n1 0 0  0 0 1  0.5 0 0  0 0\n0 1 0  0 0 1  0 0 1  1 1\n3 0 1 2\n";
        let attributes = parse(&format!("STCNOFF\n3 1 0\n{rows}")).expect("all layers").attributes;
        assert_eq!(attributes.uvs.expect("uvs").values[0], [0.25, 0.5]);
        assert_eq!(attributes.normals.expect("normals").values[2], [0.0, 0.0, 1.0]);
        assert_eq!(attributes.colors.expect("colours")[..2], [[1.0, 0.0, 0.0, 0.2], [0.5, 0.0, 0.0, 1.0]]);
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (text, line, said) in [
            ("OFF\n3 x 0\n", 2, "numbers of vertices and faces"),
            ("4OFF\n3 1 0\n", 1, "three-dimensional"),
            ("OFF BINARY\n", 1, "binary"),
            ("OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", 4, "cut short"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n", 5, "cut short"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", 6, "7 (OFF counts from 0)"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n", 6, "2 corners"),
            ("OFF\n9000000 6 0\n0 0 0\n", 2, "announced"),
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(error.contains(&format!("line {line}:")) && error.contains(said), "{text:?} → {error}");
        }
        assert!(matches!(parse("OFF\n353535235358 6 0\n"), Err(MeshError::TooLarge { what: "vertices", .. })));
    }

    #[test]
    fn a_file_written_reads_back_the_same() {
        let mesh = parse("OFF\n4 2 0\n0.1 0 0\n1 1e-9 0\n0 1 0\n0 0 -1\n3 0 1 2\n4 3 2 1 0\n").expect("readable");
        assert_eq!(read(&write(&mesh), &Limits::default()).expect("written"), mesh);
    }
}
