//! The OBJ reader.

use crate::mesh::error::{FileLocation, MeshError, quoted};
use crate::mesh::text::{Lines, TextPosition, Words, decoded, number, within};
use crate::mesh::{Attributes, CornerLayer, Crease, FaceLabels, Format, Limits, NONE, PolyMesh, Polygons, Vec3};
use std::borrow::Cow;
use std::collections::HashMap;

/// Reads an OBJ file.
///
/// # Errors
/// The line that breaks the rules, or the limit that is exceeded.
pub(in crate::mesh) fn read(bytes: &[u8], limits: &Limits) -> Result<PolyMesh, MeshError> {
    let bytes = decoded(Format::Obj, bytes)?;
    let mut reader = Reader::new(limits);
    let mut lines = Lines::new(bytes);
    while let Some(line) = lines.next() {
        let at = TextPosition { format: Format::Obj, line: lines.number() };
        let line = continued(line, &mut lines);
        reader.statement(at, &line)?;
    }
    reader.finish()
}

/// A line together with those that a `\` at its end continues it on.
fn continued<'a>(line: &'a [u8], lines: &mut Lines<'a>) -> Cow<'a, [u8]> {
    let is_continued = |line: &[u8]| line.trim_ascii_end().ends_with(b"\\");
    if !is_continued(line) || line.trim_ascii_start().starts_with(b"#") {
        return Cow::Borrowed(line);
    }
    let mut whole = line.to_vec();
    while is_continued(&whole) {
        whole.truncate(whole.trim_ascii_end().len() - 1);
        whole.push(b' ');
        let Some(more) = lines.next() else { break };
        whole.extend_from_slice(more);
    }
    Cow::Owned(whole)
}

/// The largest index used of a pool, and where.
#[derive(Clone, Copy, Default)]
struct LargestIndex {
    index: i64,
    line: u64,
}

struct Reader<'l> {
    limits: &'l Limits,
    positions: Vec<Vec3>,
    colors: Vec<[f32; 4]>,
    uvs: Vec<[f64; 2]>,
    normals: Vec<[f64; 3]>,
    faces: Polygons,
    uv_corners: Vec<u32>,
    normal_corners: Vec<u32>,
    reach: [LargestIndex; 3],
    face: Vec<u32>,
    groups: Labels,
    objects: Labels,
    materials: Labels,
    creases: Vec<(Crease, u64)>,
}

impl<'l> Reader<'l> {
    fn new(limits: &'l Limits) -> Self {
        Self {
            limits,
            positions: Vec::new(),
            colors: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            faces: Polygons::default(),
            uv_corners: Vec::new(),
            normal_corners: Vec::new(),
            reach: [LargestIndex::default(); 3],
            face: Vec::new(),
            groups: Labels::default(),
            objects: Labels::default(),
            materials: Labels::default(),
            creases: Vec::new(),
        }
    }

    fn statement(&mut self, at: TextPosition, line: &[u8]) -> Result<(), MeshError> {
        let mut words = Words::new(line);
        match words.next() {
            Some(b"v") => self.vertex(at, words),
            Some(b"f" | b"fo") => self.face(at, words),
            Some(b"vt") => self.uv(at, words),
            Some(b"vn") => {
                let normal = at.point(&mut words, "three numbers after `vn`")?;
                self.normals.push(normal.into());
                within("normals", self.normals.len(), self.limits.vertices_max)
            }
            Some(b"t") => self.tag(at, words),
            Some(keyword) => {
                match keyword {
                    b"g" => self.groups.set(words.rest()),
                    b"o" => self.objects.set(words.rest()),
                    b"usemtl" => self.materials.set(words.rest()),
                    _ => {}
                }
                Ok(())
            }
            None => Ok(()),
        }
    }

    fn vertex(&mut self, at: TextPosition, mut words: Words<'_>) -> Result<(), MeshError> {
        self.positions.push(at.point(&mut words, "three numbers after `v`")?);
        within("vertices", self.positions.len(), self.limits.vertices_max)?;
        let (mut more, mut found) = ([f64::NAN; 4], 0);
        // Some tools mark vertices with words behind their numbers, such as those that a user held in place.
        for value in words.map_while(number) {
            if let Some(slot) = more.get_mut(found) {
                *slot = value;
            }
            found += 1;
        }
        if found >= 3 {
            let channel = |k: usize| if more[k].is_finite() { more[k] as f32 } else { 1.0 };
            self.colors.resize(self.positions.len() - 1, [1.0; 4]);
            self.colors.push([channel(0), channel(1), channel(2), channel(3)]);
        }
        Ok(())
    }

    fn uv(&mut self, at: TextPosition, mut words: Words<'_>) -> Result<(), MeshError> {
        let u = at.number(&mut words, "one to three numbers after `vt`")?;
        let v = match words.next() {
            Some(word) => number(word).ok_or_else(|| at.no_number(word, "one to three numbers after `vt`"))?,
            None => 0.0,
        };
        self.uvs.push([u, v]);
        within("texture coordinates", self.uvs.len(), self.limits.vertices_max)
    }

    fn face(&mut self, at: TextPosition, words: Words<'_>) -> Result<(), MeshError> {
        let mut face = std::mem::take(&mut self.face);
        face.clear();
        for word in words.take_while(|word| !word.starts_with(b"#")) {
            let [v, t, n] = self.corner(at, word)?;
            face.push(v);
            self.uv_corners.push(t);
            self.normal_corners.push(n);
            within("corners in one face", face.len(), self.limits.degree_max)?;
        }
        if face.len() < 3 {
            let found = format!("{} corners", face.len());
            return Err(at.error("at least three corners after `f`", found, "use `l` for lines or remove the face"));
        }
        self.faces.push(&face);
        self.face = face;
        within("faces", self.faces.len(), self.limits.faces_max)?;
        within("corners", self.uv_corners.len(), self.limits.corners_max)?;
        self.groups.face();
        self.objects.face();
        self.materials.face();
        Ok(())
    }

    /// One corner `v`, `v/t`, `v//n` or `v/t/n` as indices from 0.
    #[inline]
    fn corner(&mut self, at: TextPosition, word: &[u8]) -> Result<[u32; 3], MeshError> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut indices = [NONE; 3];
        for (k, part) in word.split(|b| *b == b'/').enumerate() {
            if k > 2 || (k == 0 && part.is_empty()) {
                let remedy = "correct the line or export the file again";
                return Err(at.error("corners as v, v/t, v//n or v/t/n", quoted(word), remedy));
            }
            if !part.is_empty() {
                indices[k] = self.index(at, k, part, counts[k])?;
            }
        }
        Ok(indices)
    }

    #[inline]
    fn index(&mut self, at: TextPosition, pool: usize, part: &[u8], available: usize) -> Result<u32, MeshError> {
        let index = integer(part).ok_or_else(|| {
            at.error("whole numbers as indices", quoted(part), "correct the line or export the file again")
        })?;
        let from_zero = if index < 0 { available as i64 + index } else { index - 1 };
        if from_zero < 0 || from_zero >= self.limits.vertices_max as i64 {
            return Err(out_of_range(pool, at.line, quoted(part), available));
        }
        if from_zero >= self.reach[pool].index {
            self.reach[pool] = LargestIndex { index: from_zero + 1, line: at.line };
        }
        Ok(from_zero as u32)
    }

    /// OpenSubdiv's tag `t crease 2/1/0 a b sharpness` (vertices from 0); other tags are not read.
    fn tag(&mut self, at: TextPosition, mut words: Words<'_>) -> Result<(), MeshError> {
        if words.next() != Some(b"crease") || words.next().is_none_or(|counts| !counts.starts_with(b"2/1/")) {
            return Ok(());
        }
        let mut vertices = [0; 2];
        for vertex in &mut vertices {
            let word = words.next().unwrap_or_default();
            let index = integer(word).and_then(|index| u32::try_from(index).ok());
            *vertex = index.ok_or_else(|| at.no_number(word, "two vertices (from 0) in a crease"))?;
        }
        let sharpness = at.number(&mut words, "a sharpness in a crease")? as f32;
        self.creases.push((Crease { vertices, sharpness }, at.line));
        within("creases", self.creases.len(), self.limits.vertices_max)
    }

    fn finish(mut self) -> Result<PolyMesh, MeshError> {
        let available = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for pool in 0..3 {
            let LargestIndex { index, line } = self.reach[pool];
            // Some programs leave out all UVs or normals, but not what faces say of them.
            let is_left_out = pool > 0 && available[pool] == 0;
            if !is_left_out && index > available[pool] as i64 {
                return Err(out_of_range(pool, line, index.to_string(), available[pool]));
            }
        }
        for (crease, line) in &self.creases {
            if let Some(vertex) = crease.vertices.iter().find(|v| **v as usize >= self.positions.len()) {
                return Err(out_of_range(0, *line, format!("{vertex} (creases count from 0)"), available[0]));
            }
        }
        let colors = (!self.colors.is_empty()).then(|| {
            self.colors.resize(self.positions.len(), [1.0; 4]);
            unit_colors(self.colors)
        });
        let attributes = Attributes {
            uvs: layer(self.uvs, self.uv_corners),
            normals: layer(self.normals, self.normal_corners),
            colors,
            groups: self.groups.finish().or(self.objects.finish()),
            materials: self.materials.finish(),
            segments: None,
            creases: self.creases.into_iter().map(|(crease, _)| crease).collect(),
        };
        Ok(PolyMesh { positions: self.positions, faces: self.faces, attributes })
    }
}

fn layer<T>(values: Vec<T>, corners: Vec<u32>) -> Option<CornerLayer<T>> {
    (!values.is_empty()).then_some(CornerLayer { values, corners })
}

/// Colours of 0–255 are scaled to 0–1.
fn unit_colors(mut colors: Vec<[f32; 4]>) -> Vec<[f32; 4]> {
    if colors.iter().any(|c| c[..3].iter().any(|x| *x > 1.0)) {
        for color in &mut colors {
            color[..3].iter_mut().for_each(|x| *x /= 255.0);
        }
    }
    colors
}

fn out_of_range(pool: usize, line: u64, found: String, available: usize) -> MeshError {
    let what = ["a vertex", "a texture coordinate", "a normal"][pool];
    MeshError::IndexOutOfRange { format: Format::Obj, place: FileLocation::Line(line), what, found, available }
}

/// A decimal integer with optional sign; numbers beyond `i64` count as its ends.
#[inline]
fn integer(word: &[u8]) -> Option<i64> {
    let (digits, negative) = match word {
        [b'-', rest @ ..] => (rest, true),
        [b'+', rest @ ..] => (rest, false),
        _ => (word, false),
    };
    if digits.is_empty() {
        return None;
    }
    let mut value = 0i64;
    for digit in digits {
        if !digit.is_ascii_digit() {
            return None;
        }
        value = value.saturating_mul(10).saturating_add(i64::from(digit - b'0'));
    }
    Some(if negative { -value } else { value })
}

/// Labels as statements set them; a name is kept at its first face.
#[derive(Default)]
struct Labels {
    current: Vec<u8>,
    current_index: Option<u32>,
    names: Vec<String>,
    index_of: HashMap<Vec<u8>, u32>,
    of_face: Vec<u32>,
}

impl Labels {
    /// Sets the name of the faces that follow.
    fn set(&mut self, name: &[u8]) {
        self.current = name.to_vec();
        self.current_index = name.is_empty().then_some(NONE);
    }

    fn face(&mut self) {
        if self.current.is_empty() {
            self.of_face.push(NONE);
            return;
        }
        let index = match self.current_index {
            Some(index) => index,
            None => *self.index_of.entry(self.current.clone()).or_insert_with(|| {
                self.names.push(String::from_utf8_lossy(&self.current).into_owned());
                self.names.len() as u32 - 1
            }),
        };
        self.current_index = Some(index);
        self.of_face.push(index);
    }

    fn finish(self) -> Option<FaceLabels> {
        (!self.names.is_empty()).then_some(FaceLabels { names: self.names, of_face: self.of_face })
    }
}
