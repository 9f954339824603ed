//! The input of a map that covers a part of it, cut along the map's rim.

use super::continued::own_faces;
use super::model::Model;
use crate::fit::openings::{closed_within, off_rim};
use crate::fit::within;
use crate::mesh::{NONE, PolyMesh, TriMesh, prepare};
use crate::segment::segment_around;
use crate::topology::{Patch, submesh};
use std::sync::Arc;

/// Of more parts, beside those that stay, the rest is ragged: none of them is worth a layout.
const PARTS_MAX: usize = 24;

/// An input cut along the rim of a map that lies on a part of it, and the map's own faces, save those at a cut of its segment.
/// Segment 0 is the surface under the map, the others are the rest; other segments of the input stay as they are, unless it was cut
/// at its waist. `None` where the map has no rim, nothing lies beyond it, or the rest is ragged.
///
/// `segment` is the one that the map lies on, `mesh` the map's, `own` its [`MapExtent::own`](super::MapExtent::own).
pub fn around(
    query: &Model,
    segment: u32,
    mesh: &Arc<PolyMesh>,
    own: Option<(u64, u64)>,
) -> Option<(Model, Arc<PolyMesh>)> {
    let own = own_faces(mesh, own).unwrap_or_else(|| Arc::clone(mesh));
    let patch = query.patch(segment).ok()?;
    let (surface, part_of) = of_parts(query)?;
    let own = match query.segmented.parts.len() {
        1 => own,
        _ => Arc::new(off_rim(&own, &patch.mesh, &at_cut(&query.segmented.mesh, patch))?),
    };
    let laid = prepare(&own).ok()?;
    let mut field = within(&laid.mesh, &laid.mesh.positions, &surface)?;
    // Beyond the cut nothing belongs to the layout, even where it lies next to it, as a base does beneath a belly.
    let mut is_beyond = vec![true; field.len()];
    let triangles = surface.triangles.iter().zip(&part_of).filter(|(_, part)| **part == segment);
    triangles.flat_map(|(corners, _)| corners).for_each(|&v| is_beyond[v as usize] = false);
    field.iter_mut().zip(is_beyond).filter(|(_, beyond)| *beyond).for_each(|(x, _)| *x = -x.abs());
    let others = |part: &u32| (!query.is_at_waist() && *part != segment).then_some(*part);
    let kept: Vec<Option<u32>> = part_of.iter().map(others).collect();
    let segmented = segment_around(&surface, &field, &kept).ok()?;
    let stay = if query.is_at_waist() { 0 } else { query.segmented.parts.len().saturating_sub(1) };
    if !(2..=stay + PARTS_MAX).contains(&segmented.parts.len()) {
        return None;
    }
    // Eyes and a mouth that are open on the example are none of the openings that the rest borders on.
    let own = Arc::new(closed_within(&own, &segmented.parts.first()?.mesh));
    Some((Model { besides: None, ..query.recut(segmented, true) }, own))
}

/// The surface of all parts of an input, without what was left out beside them, and the part of each of its triangles.
fn of_parts(query: &Model) -> Option<(TriMesh, Vec<u32>)> {
    let of_one = |(part, patch): (u32, &Patch)| patch.triangle_of.iter().map(|&t| (t, part)).collect::<Vec<_>>();
    let mut all: Vec<(u32, u32)> = (0..).zip(&query.segmented.parts).flat_map(of_one).collect();
    all.sort_unstable();
    let (triangles, part_of): (Vec<u32>, Vec<u32>) = all.into_iter().unzip();
    (!triangles.is_empty()).then(|| (submesh(&query.segmented.mesh, &triangles).0, part_of))
}

/// Which vertices of a part lie where another part of the surface begins.
fn at_cut(surface: &TriMesh, part: &Patch) -> Vec<bool> {
    let mut at_cut = vec![false; part.mesh.positions.len()];
    for h in (0..part.mesh.twins.len() as u32).filter(|&h| part.mesh.twin(h) == NONE) {
        if part.borders_on_another(surface, h) {
            [part.mesh.tail(h), part.mesh.head(h)].iter().for_each(|&v| at_cut[v as usize] = true);
        }
    }
    at_cut
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Format, Limits, Polygons, Vec3, write};
    use crate::pipeline::{
        AllowedFlaws, Cut, LayoutOwner, Part, StitchOptions, appraise, compose, encode, in_primitives, read,
    };
    use crate::segment::PartCount;
    use crate::topology::tests::voxels;

    /// n × n quads of a dome over the square from `from` to `to` of the unit square.
    fn dome(n: u32, [from, to]: [f64; 2]) -> PolyMesh {
        let at = |k: u32| from + (to - from) * f64::from(k) / f64::from(n);
        let point = |(i, j): (u32, u32)| {
            let (x, y) = (at(i), at(j));
            Vec3::new(x, y, 4.0 * x * (1.0 - x) * y * (1.0 - y))
        };
        let quad = |(i, j): (u32, u32)| [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| j * (n + 1) + i);
        let mut faces = Polygons::default();
        (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).for_each(|at| faces.push(&quad(at)));
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).map(point).collect();
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    #[test]
    fn a_layout_on_a_part_of_a_scan_is_surrounded_by_quads_that_end_where_the_scan_does() {
        let bytes = write(&dome(48, [0.0, 1.0]), Format::Obj).expect("writable");
        let scan = Arc::new(read(&bytes, None, &Cut::default(), &Limits::default()).expect("a disc"));
        let map = Arc::new(dome(10, [0.3, 0.7]));
        let (cut, own) = around(&scan, 0, &map, None).expect("a rest");
        assert!(own == map, "the map's own faces");
        let regular = |segment| Part::Template(Arc::new(encode(&cut, segment, &|| false).expect("encodable")));
        let rest = (1..cut.segments().len() as u32).map(regular);
        let parts: Vec<Part> = [Part::Kept(own)].into_iter().chain(rest).collect();
        let how = StitchOptions { smoothing: 5, density: 0 };
        let made = compose(&cut, &parts, how, &|| false).expect("stitched");
        let [first, others @ ..] = &made.standing[..] else { panic!("no segments") };
        assert!(*first == LayoutOwner::Example && !others.contains(first), "{:?}", made.standing);
        assert!(made.mesh.faces.iter().all(|face| face.len() == 4) && made.mesh.faces.len() > 150);
        let found = appraise(&cut, &made, AllowedFlaws::default());
        assert!(found.flaws.is_empty() && found.covered > 0.99, "{found:?}");
        assert!((found.examples[0] - 0.2).abs() < 0.06, "{found:?}");
    }

    #[test]
    fn a_piece_beside_the_one_that_is_laid_on_stays_as_it_is() {
        let (one, mut scan) = (dome(48, [0.3, 0.7]), dome(48, [0.0, 1.0]));
        let before = scan.positions.len() as u32;
        scan.positions.extend(one.positions.iter().map(|x| x + Vec3::new(3.0, 0.0, 0.0)));
        one.faces.iter().for_each(|face| scan.faces.push(&face.iter().map(|v| v + before).collect::<Vec<u32>>()));
        let bytes = write(&scan, Format::Obj).expect("writable");
        let cut = Cut { parts: Some(PartCount::AsNeeded), ..Cut::default() };
        let scan = read(&bytes, None, &cut, &Limits::default()).expect("two discs");
        let areas = |model: &Model| model.segmented.parts.iter().map(|p| p.mesh.total_area()).collect::<Vec<f64>>();
        let [large, small] = areas(&scan)[..] else { panic!("{:?}", areas(&scan)) };
        let map = Arc::new(dome(10, [0.35, 0.65]));
        let (cut, own) = around(&scan, u32::from(large < small), &map, None).expect("a rest");
        assert!(own.faces.len() == map.faces.len() && cut.segments().len() >= 3);
        let found = areas(&cut);
        let last = found.last().expect("parts");
        assert!((last - small.min(large)).abs() < 1e-9, "{found:?}");
        assert!((found.iter().sum::<f64>() - large - small).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn a_layout_on_a_figure_is_kept_down_to_its_ankles_and_the_base_is_a_segment_of_its_own() {
        // A slab of cells on four legs on another: what was laid on the upper one has soles where the lower one begins.
        let within = |x: i32, y: i32| (0..12).contains(&x) && (0..20).contains(&y);
        let is_leg = |x: i32, n: i32| (2..4).contains(&x) || (n - 4..n - 2).contains(&x);
        let is_figure = move |[x, y, z]: [i32; 3]| {
            within(x, y) && ((9..14).contains(&z) || ((5..9).contains(&z) && is_leg(x, 12) && is_leg(y, 20)))
        };
        let is_solid = move |[x, y, z]: [i32; 3]| is_figure([x, y, z]) || (within(x, y) && (0..5).contains(&z));
        let bytes = write(&voxels(&is_solid, [12, 20, 14]), Format::Obj).expect("writable");
        let at_waist = Cut { parts: Some(PartCount::AtWaist), ..Cut::default() };
        let scan = read(&bytes, None, &at_waist, &Limits::default()).expect("a figure on its base");
        assert!(scan.is_at_waist() && scan.segments().len() == 2 && in_primitives(&scan).is_ok());
        let figure = scan.segmented.parts.iter().position(|part| part.mesh.positions.iter().all(|x| x.z > 4.0));
        let laid = Arc::new(voxels(&is_figure, [12, 20, 14]));
        let (cut, own) = around(&scan, figure.expect("the upper side") as u32, &laid, None).expect("a rest");
        let lost = laid.faces.len() - own.faces.len();
        // At each of four ankles a sole of four quads, and up to four rings of eight that reach beyond the cut.
        assert!((16..=16 + 4 * 4 * 8).contains(&lost), "{lost}");
        assert!(!cut.is_at_waist() && cut.segments().len() >= 2);
        let lowest = cut.patch(0).expect("the figure").mesh.positions.iter().map(|x| x.z).fold(f64::MAX, f64::min);
        assert!(lowest > 4.0, "nothing of the base: {lowest}");
    }
}
