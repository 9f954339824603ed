//! A whole map made anew part by part.
//!
//! A whole example and a whole input, and a map between them from one chart or a few: the example is cut into parts, one a
//! protrusion; the input is cut alike, where the map says that the parts lie; each part is unfolded and registered on its
//! partner, from where the map sent its features; and the parts' maps are joined. Nothing is stitched: the example stays
//! whole. *Source:* paper §6 (one example on all segments). *Ours, not the paper's:* the input's cuts come from the map,
//! so that parts are matched, and border on each other, as the example's do.

use super::rejoin::{Net, Piece, blend};
use super::{CrossMap, cross_map};
use crate::encode::index::{Location, PlanarIndex};
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh};
use crate::register::{Flip, Level, Query, Registration, Solver, query_images};
use crate::segment::{PartCount, Segmented, segment, segment_by};
use crate::topology::{Patch, Topology};
use crate::unfold::{Chart, UnfoldOptions, Uv};

/// Level to which parts are registered.
const SIDE: usize = 128;

/// A map of the whole, by which parts are found and guided.
#[derive(Clone, Copy, Debug)]
pub struct Whole<'a> {
    /// The example's patch.
    pub mesh: &'a TriMesh,
    /// Where its vertices go.
    pub cross: &'a CrossMap,
    /// The chart on whose mesh they lie.
    pub input: &'a Chart,
    /// Whether the map mirrors.
    pub mirrored: bool,
}

/// The map of `whole`, each part made anew; `None` where the example has no parts, the input cannot be cut alike, or it
/// was stopped.
pub fn by_parts(whole: &Whole<'_>, solver: &dyn Solver, stop: &dyn Fn() -> bool) -> Option<CrossMap> {
    let example = segment(whole.mesh, PartCount::Protrusions).ok()?.between_polygons(whole.mesh).ok()?;
    if example.parts.len() < 2 {
        return None;
    }
    let carrier = Carrier::new(whole);
    let input = alike(whole, &example)?;
    let mut positions = Vec::new();
    for (one, two) in example.parts.iter().zip(&input.parts) {
        if stop() {
            return None;
        }
        positions.push(part(one, two, &carrier, solver, stop)?);
    }
    let pieces: Vec<Piece<'_>> = example
        .parts
        .iter()
        .zip(&positions)
        .map(|(part, positions)| Piece { vertices: &part.vertex_of, positions })
        .collect();
    let bvh = Bvh::new(&whole.input.mesh);
    let positions = blend(&whole.mesh.positions, &Net::of(whole.mesh), &pieces, &bvh);
    Some(on_surface(positions, &bvh, whole.input))
}

/// The input cut where the map says that the example's parts lie; `None` where these are not the same primitives, or do
/// not border on each other alike.
pub fn alike(whole: &Whole<'_>, example: &Segmented) -> Option<Segmented> {
    let mapped = TriMesh {
        positions: whole.cross.positions.clone(),
        triangles: whole.mesh.triangles.clone(),
        ..TriMesh::default()
    };
    let bvh = Bvh::new(&mapped);
    let label_at = |x: Vec3| example.part_of.get(bvh.closest(x).triangle as usize).copied().unwrap_or(0);
    let input = segment_by(&whole.input.mesh, &label_at).ok()?;
    let count = example.parts.len();
    let same = input.parts.len() == count
        && input.parts.iter().zip(&example.parts).all(|(a, b)| a.topology == b.topology)
        && (0..count as u32).all(|part| input.neighbours(part) == example.neighbours(part));
    same.then_some(input)
}

/// Places on the input for places near the example's surface.
struct Carrier<'a> {
    whole: &'a Whole<'a>,
    bvh: Bvh,
}

impl<'a> Carrier<'a> {
    fn new(whole: &'a Whole<'a>) -> Self {
        Self { whole, bvh: Bvh::new(whole.mesh) }
    }

    /// Where the whole map sends a point of the example.
    fn carry(&self, x: Vec3) -> Vec3 {
        let closest = self.bvh.closest(x);
        let Some(corners) = self.whole.mesh.triangles.get(closest.triangle as usize) else { return x };
        (0..3).map(|k| self.whole.cross.positions[corners[k] as usize] * closest.barycentric[k]).sum()
    }
}

/// Where the vertices of part `one` of the example go on part `two` of the input.
fn part(
    one: &Patch,
    two: &Patch,
    carrier: &Carrier<'_>,
    solver: &dyn Solver,
    stop: &dyn Fn() -> bool,
) -> Option<Vec<Vec3>> {
    let example = Query::new(one, &UnfoldOptions::default()).ok()?;
    let pole = |p: &crate::unfold::Pole| carrier.carry(example.chart.mesh.positions[p.vertex as usize]);
    let poles = example.chart.poles.iter().map(|p| nearest_inside(&two.mesh, pole(p))).collect::<Option<Vec<u32>>>()?;
    let input = Query::new(two, &UnfoldOptions { poles }).ok()?;
    let registration = guided(&example, &input, carrier, solver, stop)?;
    Some(cross_map(&registration, &example.chart, &input.chart, &PlanarIndex::new(&input.chart)).positions)
}

/// The vertex nearest to a point, off the boundary.
fn nearest_inside(mesh: &TriMesh, x: Vec3) -> Option<u32> {
    let rim = mesh.boundary_vertices();
    let inside = (0..mesh.positions.len()).filter(|&v| !rim[v]);
    let distance = |v: usize| (mesh.positions[v] - x).norm_squared();
    inside.min_by(|&a, &b| distance(a).total_cmp(&distance(b))).map(|v| v as u32)
}

/// A registration that starts where the whole map sends the example's features.
fn guided(
    example: &Query,
    input: &Query,
    carrier: &Carrier<'_>,
    solver: &dyn Solver,
    stop: &dyn Fn() -> bool,
) -> Option<Registration> {
    let bvh = Bvh::new(&input.chart.mesh);
    let image_of = |uv: Uv| {
        let place = example.index().locate(&example.chart, uv).point(&example.chart);
        let closest = bvh.closest(carrier.carry(place));
        let location = Location { triangle: closest.triangle, barycentric: closest.barycentric };
        (closest.triangle != NONE).then(|| location.uv(&input.chart))
    };
    let mut pairs: Vec<(Uv, Uv)> =
        example.encoding().features.iter().filter_map(|f| Some((f.uv, image_of(f.uv)?))).collect();
    if pairs.is_empty() {
        pairs = [[0.25, 0.5], [0.75, 0.5]].iter().filter_map(|&uv| Some((uv, image_of(uv)?))).collect();
    }
    let flip = flip_for(example.chart.topology, carrier.whole.mirrored, &pairs);
    pairs.iter_mut().for_each(|(p, _)| *p = flip.apply(*p));
    super::atlas::unwrap_shifts(&mut pairs);
    let (p, q) = pairs.into_iter().unzip();
    let mut registration = Registration::from_controls(flip, p, q);
    for image in &query_images(input.encoding(), SIDE) {
        let level = Level::new(example.encoding(), image)?;
        match registration.side {
            0 => registration.solve_level(&level, solver, stop),
            _ => registration.advance(&level, solver, stop),
        }
    }
    Some(registration)
}

/// The flip under which the pairs lie at the same height: of an annulus either end may be the lower one.
fn flip_for(topology: Topology, mirrored: bool, pairs: &[(Uv, Uv)]) -> Flip {
    let off = |f: &Flip| pairs.iter().map(|(p, q)| (f.apply(*p)[1] - q[1]).abs()).sum::<f64>();
    let fitting = Flip::all(topology).iter().filter(|f| f.is_mirror() == mirrored);
    fitting.min_by(|a, b| off(a).total_cmp(&off(b))).copied().unwrap_or_default()
}

/// The points of the input nearest to some positions.
fn on_surface(mut positions: Vec<Vec3>, bvh: &Bvh, input: &Chart) -> CrossMap {
    let place = |x: &Vec3| {
        let closest = bvh.closest(*x);
        let triangle = if closest.triangle == NONE { 0 } else { closest.triangle };
        Location { triangle, barycentric: closest.barycentric }
    };
    let locations: Vec<Location> = positions.iter().map(place).collect();
    positions.iter_mut().zip(&locations).for_each(|(x, l)| *x = l.point(input));
    CrossMap { locations, positions }
}
