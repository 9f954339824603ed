//! An example that covers an input alone: as it was mapped where it lies close; else its vertices are moved until its faces,
//! not the vertices alone, lie on the input; and where its quads are too large for what is there, each is split in four.
//! All of the example comes with it: extraordinary vertices, UVs, groups.

use super::error::{PipelineError, Stop};
use super::grouped::Pieces;
use super::model::Model;
use super::notes::MISS_NOTED_PCT;
use super::stitch::{Part, StitchOptions, StitchResult, stitched};
use super::stitched::{LayoutOwner, Stitched};
use crate::compose::{self, Miss, surface::ComposedSurface};
use crate::mesh::PolyMesh;
use std::iter::repeat_n;
use std::sync::Arc;

/// A map that misses its input by no more than this, in percent of the diagonal, stays as it is.
const CLOSE_PCT: f64 = 0.15;
/// One that misses by more than this does not lie where it should: smaller quads do not help it.
const ASTRAY_PCT: f64 = 1.0;
/// Share of the input's area that may be passed over once vertices were moved; beyond it the quads are too large.
const PASSED_MAX: f64 = 0.005;
/// Share of the faces that are no quads from which on a layout is a cage to be split.
const MIXED: f64 = 0.02;
/// Times that quads are split, and how many there may be afterwards.
const SPLITS_MAX: u32 = 2;
const QUADS_MAX: usize = 8_000;

/// What is told where vertices were moved.
const MOVED: &str = "the map's vertices were moved so that its faces lie on the input; its layout is the example's own";

/// `None` for a map that does not follow the input.
pub(crate) fn as_one(
    ground: &ComposedSurface<'_>,
    whole: &Arc<PolyMesh>,
    how: StitchOptions,
    stop: Stop,
) -> Result<Option<Stitched>, PipelineError> {
    let split = |mesh: &PolyMesh| Arc::new(compose::split(ground.input(), mesh));
    let (mut mesh, mut splits) = (Arc::clone(whole), 0);
    let others = whole.faces.iter().filter(|face| face.len() != 4).count();
    if others > 0 {
        // A few triangles are resolved in pairs.
        if (others as f64) < MIXED * whole.faces.len() as f64 || !may_split(whole, splits) {
            return Ok(None);
        }
        (mesh, splits) = (split(whole), 1);
    }
    let Some(miss) = compose::miss(ground.input(), &mesh).filter(|miss| 100.0 * miss.mean <= ASTRAY_PCT) else {
        return Ok(None);
    };
    if splits == 0 && 100.0 * miss.mean <= CLOSE_PCT {
        return Ok(Some(Stitched::as_it_is(Arc::clone(whole), vec![LayoutOwner::Example])));
    }
    let follows = |miss: Miss| 100.0 * miss.mean <= MISS_NOTED_PCT;
    let as_it_is =
        (splits == 0 && follows(miss)).then(|| Stitched::as_it_is(Arc::clone(whole), vec![LayoutOwner::Example]));
    let mut best: Option<(Miss, Stitched)> = None;
    loop {
        // What misses by more needs smaller quads at once.
        if splits > 0 || follows(miss) {
            let made = moved(ground, &mesh, splits, how, stop)?.filter(|(after, _)| follows(*after));
            let is_good = |after: Miss| 100.0 * after.mean <= CLOSE_PCT && after.passed <= PASSED_MAX;
            let is_done = made.as_ref().is_some_and(|(after, _)| is_good(*after));
            best = best.into_iter().chain(made).min_by(|a, b| a.0.mean.total_cmp(&b.0.mean));
            if is_done {
                break;
            }
        }
        if !may_split(&mesh, splits) {
            break;
        }
        (mesh, splits) = (split(&mesh), splits + 1);
    }
    Ok(best.map(|best| best.1).or(as_it_is))
}

/// Tells whether the faces of a mesh that was split so many times may be split again.
fn may_split(mesh: &PolyMesh, splits: u32) -> bool {
    splits < SPLITS_MAX && mesh.faces.corners().len() <= QUADS_MAX
}

/// Splits the faces of maps that stand as they are on a query, and were split so many times before; `None` where they would be too many.
pub fn split(query: &Model, made: &Stitched, splits: u32) -> Option<Stitched> {
    if !may_split(&made.mesh, splits) {
        return None;
    }
    let mesh = Arc::new(compose::split(query.ground().input(), &made.mesh));
    // The quads of a face follow those of the face before it.
    let faces = (0u32..).zip(made.mesh.faces.iter()).flat_map(|(f, face)| repeat_n(f, face.len()));
    let bridges = |(_, f): &(u32, u32)| made.bridging.binary_search(f).is_ok();
    let bridging = (0u32..).zip(faces).filter(bridges).map(|(quad, _)| quad).collect();
    let notes = vec![split_note(splits + 1, mesh.faces.len())];
    Some(Stitched { notes, bridging, ..Stitched::as_it_is(mesh, made.standing.clone()) })
}

/// A map, or one split so many times, with its vertices moved, and how far it misses then; `None` where its faces would
/// not stay.
fn moved(
    ground: &ComposedSurface<'_>,
    mesh: &Arc<PolyMesh>,
    splits: u32,
    how: StitchOptions,
    stop: Stop,
) -> Result<Option<(Miss, Stitched)>, PipelineError> {
    let part = [Part::Mapped { part: Arc::clone(mesh), whole: Arc::clone(mesh) }];
    let made: StitchResult = stitched(ground, &part, &Pieces::single(1), how, stop)?;
    if made.mesh.faces != mesh.faces {
        return Ok(None);
    }
    let Some(miss) = compose::miss(ground.input(), &made.mesh) else { return Ok(None) };
    let mut stitched = made.with_notes();
    stitched.notes.push(match splits {
        0 => MOVED.into(),
        _ => split_note(splits, mesh.faces.len()),
    });
    Ok(Some((miss, stitched)))
}

fn split_note(splits: u32, quads: usize) -> String {
    let times = if splits == 1 { "once" } else { "twice" };
    format!(
        "each of the example's faces was split {times}, to {quads} quads, to follow the input; its layout, UVs and groups are its own"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Attributes, FaceLabels, Polygons, Vec3, prepare};
    use crate::pipeline::AS_MAPPED;
    use crate::segment::Segmented;
    use crate::topology::Components;

    /// n × n quads of two groups over a square, on a surface of a height.
    fn sheet(n: usize, height: impl Fn(f64, f64) -> f64) -> PolyMesh {
        let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        let point = |(i, j): (usize, usize)| Vec3::new(at(i), at(j), height(at(i), at(j)));
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).map(point).collect();
        let quad = |i: usize, j: usize| [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        let faces = (0..n)
            .flat_map(|j| (0..n).map(move |i| quad(i, j).map(|(i, j)| (j * (n + 1) + i) as u32).to_vec()))
            .collect::<Vec<_>>();
        let groups = FaceLabels {
            names: vec!["low".into(), "high".into()],
            of_face: (0..n * n).map(|f| u32::from(2 * f >= n * n)).collect(),
        };
        let attributes = Attributes { groups: Some(groups), ..Attributes::default() };
        PolyMesh { positions, faces: faces.iter().map(Vec::as_slice).collect::<Polygons>(), attributes }
    }

    fn dome(x: f64, y: f64) -> f64 {
        0.8 * (1.0 - x * x) * (1.0 - y * y)
    }

    /// A dome with a thorn between the vertices of a sheet of few quads.
    fn thorn(x: f64, y: f64) -> f64 {
        dome(x, y) + 0.8 * (1.0 - 9.0 * (x - 0.1).hypot(y - 0.1)).max(0.0)
    }

    /// What becomes of a map of n × n quads: the map, by how much it misses in percent, and what is made of it with the same.
    fn tried(n: usize, height: fn(f64, f64) -> f64) -> (Arc<PolyMesh>, f64, Option<(Stitched, f64)>) {
        let surface = prepare(&sheet(80, height)).expect("a disc").mesh;
        let segmented = Segmented::primitive(&surface, Components::SmallLeftOut).expect("a disc");
        let ground = ComposedSurface::of(&segmented);
        let map = Arc::new(sheet(n, height));
        let miss_pct = |mesh: &PolyMesh| 100.0 * compose::miss(ground.input(), mesh).expect("a disc of quads").mean;
        let how = StitchOptions { smoothing: 5, density: 0 };
        let made = as_one(&ground, &map, how, &|| false).expect("a layout");
        let made = made.map(|made| (miss_pct(&made.mesh), made)).map(|(pct, made)| (made, pct));
        (Arc::clone(&map), miss_pct(&map), made)
    }

    #[test]
    fn a_map_of_few_faces_is_moved_until_they_lie_on_the_input_and_keeps_all_else() {
        let (map, miss_pct, made) = tried(10, dome);
        assert!((CLOSE_PCT..MISS_NOTED_PCT).contains(&miss_pct), "{miss_pct}");
        let (moved, after_pct) = made.expect("it follows");
        assert_eq!(moved.notes, [MOVED]);
        assert!(moved.mesh.faces == map.faces && moved.mesh.attributes == map.attributes);
        assert!(after_pct < CLOSE_PCT, "{after_pct}");
        let (map, _, kept) = tried(40, dome);
        let (kept, _) = kept.expect("it follows");
        assert_eq!((&kept.mesh, &kept.notes[..]), (&map, &[AS_MAPPED.to_owned()][..]));
    }

    #[test]
    fn quads_too_large_for_what_they_pass_over_are_split_with_their_groups() {
        for (n, height, splits) in [(6, dome as fn(f64, f64) -> f64, 1), (14, thorn, 2)] {
            let (map, miss_pct, made) = tried(n, height);
            assert!((CLOSE_PCT..ASTRAY_PCT).contains(&miss_pct), "{miss_pct}");
            let (made, after_pct) = made.expect("it follows once it is split");
            let by = 4usize.pow(splits);
            let quads = by * map.faces.len();
            assert_eq!((made.mesh.faces.len(), &made.notes[..]), (quads, &[split_note(splits, quads)][..]));
            assert!(after_pct < 0.5 * miss_pct, "{miss_pct} to {after_pct}");
            let of_group = |mesh: &PolyMesh, group: u32| {
                let groups = mesh.attributes.groups.as_ref().expect("groups");
                groups.of_face.iter().filter(|&&g| g == group).count()
            };
            assert_eq!([0, 1].map(|g| of_group(&made.mesh, g)), [0, 1].map(|g| by * of_group(&map, g)));
        }
    }

    #[test]
    fn a_layout_with_triangles_is_split_into_quads() {
        let surface = prepare(&sheet(80, dome)).expect("a disc").mesh;
        let segmented = Segmented::primitive(&surface, Components::SmallLeftOut).expect("a disc");
        let quads = sheet(10, dome);
        let halves = |face: &[u32]| [vec![face[0], face[1], face[2]], vec![face[0], face[2], face[3]]];
        let faces: Vec<Vec<u32>> = quads.faces.iter().flat_map(halves).collect();
        let map = PolyMesh {
            faces: faces.iter().map(Vec::as_slice).collect(),
            positions: quads.positions,
            ..PolyMesh::default()
        };
        let how = StitchOptions { smoothing: 5, density: 0 };
        let made = as_one(&ComposedSurface::of(&segmented), &Arc::new(map), how, &|| false).expect("a layout");
        let made = made.expect("it follows");
        assert_eq!((made.mesh.faces.len(), &made.notes[..]), (600, &[split_note(1, 600)][..]));
    }

    #[test]
    fn a_map_at_the_density_that_was_asked_for_keeps_its_layers() {
        let surface = prepare(&sheet(80, dome)).expect("a disc").mesh;
        let segmented = Segmented::primitive(&surface, Components::SmallLeftOut).expect("a disc");
        let map = Arc::new(sheet(10, dome));
        let part = [Part::Mapped { part: Arc::clone(&map), whole: map }];
        let how = StitchOptions { smoothing: 5, density: 1 };
        let made =
            stitched(&ComposedSurface::of(&segmented), &part, &Pieces::single(1), how, &|| false).expect("a layout");
        let groups = made.mesh.attributes.groups.expect("groups").of_face;
        assert_eq!((groups.len(), groups.iter().filter(|&&g| g == 0).count()), (400, 200));
    }

    #[test]
    fn what_lies_astray_does_not_follow() {
        let (_, miss_pct, made) = tried(2, dome);
        assert!(miss_pct > ASTRAY_PCT && made.is_none(), "{miss_pct}");
    }
}
