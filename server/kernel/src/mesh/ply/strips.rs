//! Strips of triangles, as the scans of Stanford's repository have them in place of faces.

use super::header::Element;
use super::read::Body;
use crate::mesh::error::{MeshError, quoted};
use crate::mesh::text::{TextPosition, within};
use crate::mesh::{Format, Limits, Polygons};

/// This value ends a strip where a list holds several.
const END: f64 = -1.0;

/// Reads strips: each vertex after the second makes a triangle with the two before it, wound in turn one way and the other.
/// Triangles with a corner twice only lead to the next and are left out.
///
/// # Errors
/// The row that breaks the rules, or the limit that is exceeded.
pub(super) fn read<'a>(
    element: &'a Element,
    body: &mut Body<'a>,
    faces: &mut Polygons,
    limits: &Limits,
) -> Result<(), MeshError> {
    let Some(indices) = element.property(&["vertex_indices", "vertex_index"]) else {
        let at = TextPosition { format: Format::Ply, line: element.line };
        let names: Vec<_> = element.properties.iter().map(|p| p.name.as_str()).collect();
        let found = quoted(names.join(" ").as_bytes());
        return Err(at.error("the list property vertex_indices", found, "export faces in place of strips"));
    };
    for row in 0..element.count {
        body.begin_row(element, row)?;
        for (p, property) in element.properties.iter().enumerate() {
            let Some(list) = property.list else {
                body.scalar(property.value)?;
                continue;
            };
            let count = body.count(list, property.value)?;
            if p != indices {
                body.skip_list(count, property.value)?;
                continue;
            }
            let mut strip = Strip::default();
            for _ in 0..count {
                let index = body.scalar(property.value)?;
                if index == END {
                    strip = Strip::default();
                    continue;
                }
                if let Some(triangle) = strip.goes_on(body.index(index)?) {
                    faces.push(&triangle);
                    within("faces", faces.len(), limits.faces_max)?;
                }
            }
        }
    }
    Ok(())
}

/// The last two vertices of a strip.
#[derive(Default)]
struct Strip {
    last: [Option<u32>; 2],
    is_turned: bool,
}

impl Strip {
    /// The triangle that a vertex makes with the two before it.
    fn goes_on(&mut self, c: u32) -> Option<[u32; 3]> {
        let [a, b] = self.last;
        self.last = [b, Some(c)];
        let (a, b) = (a?, b?);
        let is_turned = self.is_turned;
        self.is_turned = !is_turned;
        let is_triangle = a != b && b != c && c != a;
        is_triangle.then_some(if is_turned { [b, a, c] } else { [a, b, c] })
    }
}
