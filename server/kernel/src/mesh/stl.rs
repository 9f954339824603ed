//! STL: ascii (several solids) and binary, also binary files whose header starts with `solid`.
//!
//! The triangles of the file share no vertices. Equal points are joined in order of first use, except where that would
//! make an edge with more than two faces; nearly equal ones are left to [`prepare`](super::prepare()), which reports them.

use super::error::{FileLocation, MeshError, quoted};
use super::text::{Lines, TextPosition, Words, within};
use super::weld::weld;
use super::{Attributes, FaceLabels, Format, Limits, NONE, PolyMesh, Polygons, Vec3};

/// Bytes before the triangles of a binary file: a comment and a count.
const HEADER_BYTES: usize = 84;
/// Bytes of a binary triangle: normal, three points, an attribute.
const TRIANGLE_BYTES: usize = 50;

/// Reads an STL file.
///
/// # Errors
/// The line (ascii) or byte (binary) that breaks the rules, or the limit that is exceeded.
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<PolyMesh, MeshError> {
    let announced = match bytes.get(HEADER_BYTES - 4..HEADER_BYTES).map(<[u8; 4]>::try_from) {
        Some(Ok(count)) => Some(u32::from_le_bytes(count) as usize),
        _ => None,
    };
    let exact = announced.is_some_and(|count| bytes.len() == HEADER_BYTES + TRIANGLE_BYTES * count);
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    let starts_solid = text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let head = &text[..text.len().min(1024)];
    let is_text = starts_solid && !head.contains(&0);
    let soup = match announced {
        Some(count) if exact || !is_text => binary(bytes, count, limits)?,
        _ => ascii(bytes, limits)?,
    };
    Ok(soup.finish())
}

/// Triangles that share no vertices.
#[derive(Default)]
struct Soup {
    points: Vec<Vec3>,
    names: Vec<String>,
    name_of: Vec<u32>,
}

impl Soup {
    fn finish(self) -> PolyMesh {
        let faces: Polygons = {
            let indices: Vec<u32> = (0..self.points.len() as u32).collect();
            indices.chunks_exact(3).collect()
        };
        let (vertex_of, first) = weld(&self.points, &faces);
        let groups = (!self.names.is_empty()).then_some(FaceLabels { names: self.names, of_face: self.name_of });
        PolyMesh {
            positions: first.iter().map(|k| self.points[*k as usize]).collect(),
            faces: vertex_of.chunks_exact(3).collect(),
            attributes: Attributes { groups, ..Attributes::default() },
        }
    }
}

fn binary(bytes: &[u8], count: usize, limits: &Limits) -> Result<Soup, MeshError> {
    let body = bytes.get(HEADER_BYTES..).unwrap_or_default();
    let room = body.len() / TRIANGLE_BYTES;
    if count > room {
        return Err(MeshError::Malformed {
            format: Format::Stl,
            place: FileLocation::Byte(HEADER_BYTES as u64 - 4),
            expected: "as many triangles as announced".into(),
            found: format!("{count} triangles announced and room for {room}"),
            remedy: "the file is cut short or no STL: export it again",
        });
    }
    within("faces", count, limits.faces_max)?;
    let coordinate = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let point = |b: &[u8]| Vec3::new(coordinate(b), coordinate(&b[4..]), coordinate(&b[8..]));
    let triangles = body.chunks_exact(TRIANGLE_BYTES).take(count);
    let points = triangles.flat_map(|b| [point(&b[12..]), point(&b[24..]), point(&b[36..])]).collect();
    Ok(Soup { points, ..Soup::default() })
}

fn ascii(bytes: &[u8], limits: &Limits) -> Result<Soup, MeshError> {
    let bytes = super::text::decoded(Format::Stl, bytes)?;
    const REMEDY: &str = "correct the line or export the file again";
    let mut soup = Soup::default();
    let mut name = NONE;
    let mut lines = Lines::new(bytes);
    while let Some(line) = lines.next() {
        let at = TextPosition { format: Format::Stl, line: lines.number() };
        let mut words = Words::new(line);
        // Keywords may share a line.
        while let Some(word) = words.next() {
            match word.to_ascii_lowercase().as_slice() {
                b"vertex" => soup.points.push(at.point(&mut words, "three numbers after `vertex`")?),
                b"endloop" => {
                    within("faces", soup.name_of.len() + 1, limits.faces_max)?;
                    soup.name_of.push(name);
                    if soup.points.len() != 3 * soup.name_of.len() {
                        let found = format!("{}", (soup.points.len() + 3).saturating_sub(3 * soup.name_of.len()));
                        return Err(at.error("three vertices in a loop", found, REMEDY));
                    }
                }
                b"solid" => {
                    name = NONE;
                    if !words.rest().is_empty() {
                        let text = String::from_utf8_lossy(words.rest()).into_owned();
                        name = match soup.names.last() {
                            Some(last) if *last == text => soup.names.len() as u32 - 1,
                            _ => {
                                soup.names.push(text);
                                soup.names.len() as u32 - 1
                            }
                        };
                    }
                    break;
                }
                b"facet" | b"endsolid" | b"color" => break,
                b"outer" | b"loop" | b"endfacet" => {}
                _ => {
                    return Err(at.error(
                        "solid, facet, outer loop, vertex, endloop, endfacet or endsolid",
                        quoted(word),
                        REMEDY,
                    ));
                }
            }
        }
    }
    if soup.points.len() != 3 * soup.name_of.len() {
        let at = TextPosition { format: Format::Stl, line: lines.number() };
        return Err(at.error("`endloop`", "the end of the file".into(), "the file is cut short: export it again"));
    }
    soup.keep_used_names();
    Ok(soup)
}

impl Soup {
    /// Drops the names of solids without triangles.
    fn keep_used_names(&mut self) {
        let mut used = vec![NONE; self.names.len()];
        let mut names = Vec::new();
        for name in self.name_of.iter_mut().filter(|name| **name != NONE) {
            let slot = &mut used[*name as usize];
            if *slot == NONE {
                *slot = names.len() as u32;
                names.push(std::mem::take(&mut self.names[*name as usize]));
            }
            *name = *slot;
        }
        self.names = names;
    }
}

/// Writes a binary STL file in single precision.
///
/// # Errors
/// [`MeshError::TooLarge`] for more triangles than the format can count.
pub(super) fn write(mesh: &PolyMesh) -> Result<Vec<u8>, MeshError> {
    let triangles = super::write::fans(mesh);
    let count = u32::try_from(triangles.len()).map_err(|_| MeshError::TooLarge {
        what: "triangles",
        found: triangles.len() as u64,
        limit: u64::from(u32::MAX),
    })?;
    let mut out = vec![0; HEADER_BYTES - 4];
    out[..11].copy_from_slice(b"binary mesh");
    out.extend_from_slice(&count.to_le_bytes());
    for t in triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let normal = (b - a).cross(&(c - a));
        let length = normal.norm();
        let normal = if length > 0.0 { normal / length } else { Vec3::zeros() };
        for vector in [normal, a, b, c] {
            vector.iter().for_each(|x| out.extend_from_slice(&(*x as f32).to_le_bytes()));
        }
        out.extend_from_slice(&[0, 0]);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ASCII: &str = "solid a\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   VERTEX 1 0 0\n   vertex 0 1 0\n  endloop\n \
        endfacet\nendsolid a\nsolid empty\nendsolid\nsolid b\nfacet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\n\
        endloop\nendfacet\nendsolid\n";

    fn parse(bytes: &[u8]) -> Result<PolyMesh, MeshError> {
        read(bytes, &Limits::default())
    }

    #[test]
    fn solids_are_groups_and_equal_points_are_joined() {
        let mesh = parse(ASCII.as_bytes()).expect("two solids");
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(mesh.faces.iter().collect::<Vec<_>>(), [[0, 1, 2], [1, 3, 2]]);
        let groups = mesh.attributes.groups.expect("named");
        assert_eq!((groups.names, groups.of_face), (vec!["a".to_string(), "b".into()], vec![0, 1]));
    }

    #[test]
    fn a_binary_file_may_start_with_solid() {
        let mesh = parse(ASCII.as_bytes()).expect("readable");
        let mut bytes = write(&mesh).expect("writable");
        bytes[..6].copy_from_slice(b"solid ");
        let again = parse(&bytes).expect("binary");
        assert_eq!((again.positions, again.faces), (mesh.positions, mesh.faces));
    }

    #[test]
    fn mistakes_are_named() {
        let cut = &ASCII.as_bytes()[..ASCII.len() - 40];
        assert!(parse(cut).expect_err("cut short").to_string().contains("cut short"));
        let four = ASCII.replacen("endloop", "vertex 5 5 5\nendloop", 1);
        assert!(
            parse(four.as_bytes())
                .expect_err("a square")
                .to_string()
                .contains("line 8: expected three vertices in a loop, found 4")
        );
        let odd = ASCII.replacen("vertex 0 0 0", "vertex 0 zero 0", 1);
        assert!(parse(odd.as_bytes()).expect_err("no number").to_string().contains("line 4"));
        let mut huge = write(&parse(ASCII.as_bytes()).expect("readable")).expect("writable");
        huge[80..84].copy_from_slice(&1_000_000_000u32.to_le_bytes());
        let error = parse(&huge).expect_err("announces too much").to_string();
        assert!(error.contains("1000000000 triangles announced and room for 2"), "{error}");
    }
}
