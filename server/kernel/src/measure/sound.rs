//! Whether a delivered mesh can be used at all: measured against the surface that it was laid on, whatever laid it.
//!
//! The verdict on a map weighs how well two shapes agree. Here nothing is known of the example: a face that crosses from
//! one finger to another, a spike, a part that lies off the surface or looks into it are wrong whatever was meant. Lengths
//! are compared with the surface's diagonal and with the mesh's own edges near by, so that a coarse layout, whose chords
//! leave the surface by a share of their length, is not taken for a broken one. *Ours, not the paper's.*

use std::sync::{Arc, OnceLock};

use super::way::Ways;
use crate::compose::fit::MeasuredSurface;
use crate::mesh::bvh::Bvh;
use crate::mesh::facing::{Facing, TurnedArea};
use crate::mesh::poly::sides;
use crate::mesh::tri::{NONE, TriMesh};
use crate::mesh::{PolyMesh, Vec3, diagonal};
use crate::topology::holes::is_filling;

/// An edge that leaves the surface by less than this share of the diagonal runs along it.
const LEAVES_MIN: f64 = 0.012;
/// The same as a share of the usual edge near by. The chord over half a circle, in a cross-section of two edges, leaves it by
/// half its length.
const LEAVES_EDGES: f64 = 0.5;
/// An edge that leaves the surface and is so many times as long as the usual one near by is a spike.
const SPIKE_EDGES: f64 = 2.0;
/// Such an edge leaps where the way between its ends along the edges of the surface is longer than it by this factor: half a
/// circle is 1.6 times its chord, and a way along edges up to 1.3 times the straightest.
const LEAP: f64 = 2.5;
/// Where edges are looked at, besides their ends.
const ALONG: [f64; 3] = [0.25, 0.5, 0.75];
/// A face's centre that is farther from the surface than this share of the diagonal lies off it …
const FAR: f64 = 0.03;
/// … and a point of the surface that is so far from all faces is bare: those that bridge a shoe are within 3 % of most of its inside.
const FAR_BARE: f64 = 0.02;
/// Either may be off by this share of the edges near by.
const FAR_EDGES: f64 = 0.5;
/// A point of the surface that is farther is bare, however long the edges are: the mesh is too coarse to have its form.
const FAR_MAX: f64 = 0.06;
/// A face of less area than this share of the square of the usual edge near by has collapsed.
const COLLAPSED: f64 = 1e-3;

/// A surface that meshes are measured against.
#[derive(Clone, Debug)]
pub struct ReferenceSurface {
    surface: TriMesh,
    tree: Arc<Bvh>,
    measured: MeasuredSurface,
    diagonal: f64,
    ways: OnceLock<Ways>,
}

/// What is wrong with a mesh, as shares from 0 to 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Flaws {
    /// Of the mesh's area: faces with an edge that leaves the surface between its ends.
    pub astray: f64,
    /// Number of those edges.
    pub astray_edges: usize,
    /// Length of the longest of them that is long for its place and leaps to another part of the surface, as a share of the
    /// surface's diagonal.
    pub spike: f64,
    /// Of the mesh's area: faces that lie off the surface.
    pub off: f64,
    /// Of the surface's area: what has no face near it.
    pub bare: f64,
    /// The part of it that is far from all faces: a limb, or the end of one.
    pub missed: f64,
    /// Of the mesh's area: faces that look into the surface.
    pub inward: f64,
    /// Of the faces: those without area.
    pub collapsed: f64,
    /// The faces that are astray or off, in order.
    pub faces: Vec<u32>,
}

/// Limits beyond which a mesh is broken. On 69 right meshes of heads, hands, bodies and animals nothing is astray, off,
/// bare or collapsed, and at most 0.3 % look inward. Of 35 maps the worst has 0.7 % astray, edges of 4 % of the diagonal
/// among them; a regular layout that leaps the hollows of a skull has 2.4 % (tests/records). One spike is enough, however small
/// its share of the area.
const SPIKE_MAX: f64 = 0.08;
const ASTRAY_MAX: f64 = 0.04;
const OFF_MAX: f64 = 0.02;
/// Of 116 results of six sets 112 leave at most 5 % bare. Two busts on shoes, which were called fair, leave 10 and 12 %
/// (tests/records/handles-2026-11-30.md).
const BARE_MAX: f64 = 0.08;
/// Two shins of a camel are 6.5 % of it, the ears of a dog 1.6 %, a horn and the root of a cow's tail 1.1 %
/// (tests/records/stretch-2026-11-27.md).
const MISSED_MAX: f64 = 0.025;
/// From here on a reason says so: all else that was looked at misses nothing.
const MISSED_NOTED: f64 = 0.0075;
const INWARD_MAX: f64 = 0.1;
const COLLAPSED_MAX: f64 = 0.1;

impl Flaws {
    /// Why a mesh is broken, a sentence each; none where it is not. `left_out` is the share of the surface's area that the
    /// mesh is not meant to cover, `spanned` the share of the faces that lie flat on purpose.
    pub fn reasons(&self, left_out: f64, spanned: f64) -> Vec<String> {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let mut reasons = Vec::new();
        let mut is_wrong = |share: f64, most: f64, why: String| {
            if share.is_nan() || share > most {
                reasons.push(why);
            }
        };
        let (edges, area) = (self.astray_edges, percent(self.astray));
        let astray = format!("{edges} edges cut through the scan or leap over a gap, on {area} of the quads' area");
        is_wrong(self.astray, ASTRAY_MAX, astray);
        let spike = format!("a spike: an edge as long as {} of the scan's diagonal leaves it", percent(self.spike));
        is_wrong(self.spike, SPIKE_MAX, spike);
        is_wrong(self.off, OFF_MAX, format!("{} of the quads' area hangs off the scan", percent(self.off)));
        let bare = self.bare - left_out.clamp(0.0, 1.0);
        is_wrong(bare, BARE_MAX, format!("{} of the scan that should be covered has no quads near it", percent(bare)));
        let missed = if bare > BARE_MAX { 0.0 } else { self.missed(left_out) };
        is_wrong(missed, MISSED_MAX, why_missed(missed));
        is_wrong(self.inward, INWARD_MAX, format!("{} of the quads' area is inside out", percent(self.inward)));
        let collapsed = format!("{} of the quads have collapsed to lines or points", percent(self.collapsed));
        is_wrong(self.collapsed - spanned, COLLAPSED_MAX, collapsed);
        reasons
    }

    /// Says that limbs are missed, where that is too little to make a mesh broken.
    pub fn note(&self, left_out: f64) -> Option<String> {
        let missed = self.missed(left_out);
        (missed > MISSED_NOTED && missed <= MISSED_MAX).then(|| why_missed(missed))
    }

    /// The same of a mesh that reaches all of the surface.
    #[must_use]
    pub fn reached(&self) -> Self {
        Self { bare: 0.0, missed: 0.0, ..self.clone() }
    }

    fn missed(&self, left_out: f64) -> f64 {
        self.missed - left_out.clamp(0.0, 1.0)
    }
}

/// How the reason begins that limbs of the surface are missed.
pub const MISSED_LIMBS: &str = "the quads end before the scan does";

fn why_missed(share: f64) -> String {
    format!("{MISSED_LIMBS}: {:.1} % of it, limbs or their ends, are missed", 100.0 * share)
}

impl ReferenceSurface {
    /// Of a surface with an area.
    pub fn new(surface: TriMesh) -> Self {
        let tree = Arc::new(Bvh::new(&surface));
        Self::with_tree(surface, tree)
    }

    /// The same with the surface's tree.
    pub fn with_tree(surface: TriMesh, tree: Arc<Bvh>) -> Self {
        let finite = surface.positions.iter().filter(|p| p.iter().all(|x| x.is_finite()));
        let diagonal = diagonal(finite).max(f64::MIN_POSITIVE);
        let measured = MeasuredSurface::with_tree(&surface, Arc::clone(&tree));
        Self { tree, measured, diagonal, surface, ways: OnceLock::new() }
    }

    /// The same with gaps that faces may bridge: the fillings among the triangles of these meshes.
    pub fn with_gaps(mut self, filled: impl Iterator<Item = TriMesh>) -> Self {
        let count = self.surface.triangles.len();
        for mesh in filled {
            let first = self.surface.positions.len() as u32;
            let fillings = (0u32..).zip(&mesh.triangles).filter(|(t, _)| is_filling(&mesh, *t));
            self.surface.triangles.extend(fillings.map(|(_, corners)| corners.map(|v| v + first)));
            self.surface.positions.extend(&mesh.positions);
        }
        if self.surface.triangles.len() > count {
            self.tree = Arc::new(Bvh::new(&self.surface));
            self.ways = OnceLock::new();
        }
        self
    }

    /// Finds the edges that leap from one part of the surface to another, and keeps their order. Such an edge leaves the surface, is
    /// long for its place, and is far shorter than the way between its ends along the surface.
    pub fn leaps(&self, positions: &[Vec3], edges: &[[u32; 2]]) -> Vec<[u32; 2]> {
        let usual = usual_edges(positions.len(), edges.iter().copied(), positions);
        let is_leap = |edge: &&[u32; 2]| {
            let usual = edge.iter().map(|v| usual[*v as usize]).fold(0.0, f64::max);
            let ends = edge.map(|v| positions[v as usize]);
            let is_long = (ends[1] - ends[0]).norm() > SPIKE_EDGES * usual;
            is_long && self.leaves(ends, (LEAVES_MIN * self.diagonal).max(LEAVES_EDGES * usual)) && self.is_leap(ends)
        };
        edges.iter().filter(is_leap).copied().collect()
    }

    /// Tells whether the way between two points along the surface is far longer than the straight line.
    fn is_leap(&self, [a, b]: [Vec3; 2]) -> bool {
        let ways = self.ways.get_or_init(|| Ways::new(&self.surface));
        let ends = [self.tree.closest(a), self.tree.closest(b)];
        // An end that hangs off the surface is as far from the other as it is off.
        let limit = LEAP * ((b - a).norm() - ends[0].distance - ends[1].distance);
        !ways.is_within(&self.surface, [&ends[0], &ends[1]], limit)
    }

    /// Measures a mesh of polygons; one without faces lies nowhere. `bridging` are faces, in order, that span a gap of the surface on
    /// purpose: they may leave it, but for spikes.
    pub fn flaws(&self, mesh: &PolyMesh, bridging: &[u32]) -> Flaws {
        let usual = usual_edges(mesh.positions.len(), mesh.faces.iter().flat_map(sides), &mesh.positions);
        let (mut all, mut off, mut inward, mut astray) = (0.0, 0.0, 0.0, 0.0);
        let (mut astray_edges, mut collapsed) = (0usize, 0usize);
        let mut long: Vec<(f64, [Vec3; 2])> = Vec::new();
        let mut faces = Vec::new();
        for (face, f) in mesh.faces.iter().zip(0u32..) {
            let points: Vec<Vec3> = face.iter().map(|&v| mesh.positions[v as usize]).collect();
            let usual = face.iter().map(|&v| usual[v as usize]).fold(0.0, f64::max);
            let normal = area_vector(&points);
            let area = normal.norm();
            all += area;
            collapsed += usize::from(area <= COLLAPSED * usual * usual);
            let centre = points.iter().sum::<Vec3>() / points.len().max(1) as f64;
            let near = self.tree.closest(centre);
            let bridges = bridging.binary_search(&f).is_ok();
            let is_off = near.triangle == NONE || near.distance > (FAR * self.diagonal).max(FAR_EDGES * usual);
            let is_off = is_off && !bridges;
            if is_off {
                off += area;
            }
            if !bridges && near.triangle != NONE && self.surface.area_vector(near.triangle as usize).dot(&normal) < 0.0
            {
                inward += area;
            }
            let leaves = (LEAVES_MIN * self.diagonal).max(LEAVES_EDGES * usual);
            let edges = (0..points.len()).map(|k| [points[k], points[(k + 1) % points.len()]]);
            let mut gone = 0;
            for [a, b] in edges.filter(|edge| self.leaves(*edge, leaves)) {
                gone += usize::from(!bridges);
                let length = (b - a).norm();
                if length > SPIKE_EDGES * usual {
                    long.push((length, [a, b]));
                }
            }
            astray_edges += gone;
            astray += if gone > 0 { area } else { 0.0 };
            if is_off || gone > 0 {
                faces.push(f);
            }
        }
        long.sort_by(|a, b| b.0.total_cmp(&a.0));
        let spike = long.iter().find(|(_, edge)| self.is_leap(*edge)).map_or(0.0, |(length, _)| length / self.diagonal);
        let all = all.max(f64::MIN_POSITIVE);
        let [bare, missed] = self.bare(mesh, &usual);
        Flaws {
            astray: astray / all,
            // Edges between two faces were counted twice; those of the boundary, which lie beside one, count for half.
            astray_edges: astray_edges.div_ceil(2),
            spike,
            off: off / all,
            bare,
            missed,
            inward: inward / all,
            collapsed: collapsed as f64 / mesh.faces.len().max(1) as f64,
            faces,
        }
    }

    /// How much of each face of a mesh looks more than 60° away from the surface: spikes and crumples, which are ugly and no reason
    /// by themselves to call it broken. Faces that are `bridging` a gap, in order, count for nothing.
    pub(crate) fn turned(&self, mesh: &PolyMesh, bridging: &[u32]) -> Vec<TurnedArea> {
        let usual = usual_edges(mesh.positions.len(), mesh.faces.iter().flat_map(sides), &mesh.positions);
        let facing = Facing::new(&self.surface, &self.tree, middle_of(&usual));
        let of_face = |(face, f): (&[u32], u32)| match bridging.binary_search(&f) {
            Ok(_) => TurnedArea::default(),
            Err(_) => facing.turned(&face.iter().map(|&v| mesh.positions[v as usize]).collect::<Vec<Vec3>>()),
        };
        mesh.faces.iter().zip(0u32..).map(of_face).collect()
    }

    /// Whether an edge leaves the surface by more than a length.
    fn leaves(&self, [a, b]: [Vec3; 2], by: f64) -> bool {
        // Between ends on the surface no point of a shorter one is that far from it.
        (b - a).norm() > 2.0 * by && ALONG.iter().any(|t| self.tree.closest(a + (b - a) * *t).distance > by)
    }

    /// Shares of the surface's area with no face near them, and far from all.
    fn bare(&self, mesh: &PolyMesh, usual: &[f64]) -> [f64; 2] {
        let [_, back] = self.measured.distances(mesh);
        let far = (FAR_EDGES * middle_of(usual)).clamp(FAR_BARE * self.diagonal, FAR_MAX * self.diagonal);
        let beyond = |far: f64| back.iter().filter(|(_, away)| *away > far).count() as f64;
        [far, FAR_MAX * self.diagonal].map(|far| beyond(far) / back.len().max(1) as f64)
    }
}

/// Twice-ringed medians: the usual length of edges about each vertex, in the unit of the positions; 0 where there is none.
/// A median over two rings is not moved by one vertex that is drawn out.
fn usual_edges(count: usize, edges: impl Iterator<Item = [u32; 2]>, positions: &[Vec3]) -> Vec<f64> {
    let mut around: Vec<Vec<(u32, f64)>> = vec![Vec::new(); count];
    for [a, b] in edges {
        let length = (positions[b as usize] - positions[a as usize]).norm();
        around[a as usize].push((b, length));
        around[b as usize].push((a, length));
    }
    let mut lengths = Vec::new();
    let mut median = |v: usize| {
        lengths.clear();
        let rings = around[v].iter().flat_map(|&(n, _)| around[n as usize].iter().map(|e| e.1));
        lengths.extend(rings.filter(|l| l.is_finite()));
        let middle = lengths.len() / 2;
        if lengths.is_empty() { 0.0 } else { *lengths.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    (0..count).map(&mut median).collect()
}

/// The median of the lengths that are not 0; 0 where there is none.
fn middle_of(lengths: &[f64]) -> f64 {
    let mut lengths: Vec<f64> = lengths.iter().copied().filter(|e| *e > 0.0).collect();
    let middle = lengths.len() / 2;
    if lengths.is_empty() { 0.0 } else { *lengths.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// The area vector of a polygon; its length is the area.
fn area_vector(points: &[Vec3]) -> Vec3 {
    let fan = |k: usize| (points[k] - points[0]).cross(&(points[k + 1] - points[0]));
    0.5 * (1..points.len().saturating_sub(1)).map(fan).sum::<Vec3>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::prepare;

    /// A sheet bent to a U, its legs 0.3 apart and 1 long, in rows of `along` and columns of 10 quads.
    fn bent(along: usize) -> PolyMesh {
        const ACROSS: usize = 10;
        let (radius, leg) = (0.15, 1.0);
        let turn = std::f64::consts::PI * radius;
        let point = |(i, j): (usize, usize)| {
            let (s, y) = (i as f64 / along as f64 * (2.0 * leg + turn), 0.6 * j as f64 / ACROSS as f64);
            if s < leg {
                Vec3::new(-radius, y, leg - s)
            } else if s < leg + turn {
                let angle = (s - leg) / radius;
                Vec3::new(-radius * angle.cos(), y, -radius * angle.sin())
            } else {
                Vec3::new(radius, y, s - leg - turn)
            }
        };
        let positions = (0..=along).flat_map(|i| (0..=ACROSS).map(move |j| (i, j))).map(point).collect();
        let number = |i: usize, j: usize| (i * (ACROSS + 1) + j) as u32;
        let quad = |i, j| [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)].to_vec();
        let faces: Vec<Vec<u32>> =
            (0..along).flat_map(|i| (0..ACROSS).map(move |j| (i, j))).map(|(i, j)| quad(i, j)).collect();
        PolyMesh { positions, faces: faces.iter().map(Vec::as_slice).collect(), ..PolyMesh::default() }
    }

    fn grounds() -> ReferenceSurface {
        ReferenceSurface::new(TriMesh::clone(&prepare(&bent(200)).expect("a disc").mesh))
    }

    /// What is found of a sheet of 40 rows that something was done to.
    fn found(change: impl Fn(&mut PolyMesh)) -> (Flaws, Vec<String>) {
        let mut mesh = bent(40);
        change(&mut mesh);
        let flaws = grounds().flaws(&mesh, &[]);
        let reasons = flaws.reasons(0.0, 0.0);
        (flaws, reasons)
    }

    #[test]
    fn a_sheet_on_its_surface_has_no_flaw_however_coarse_it_is() {
        for along in [40, 12] {
            let flaws = grounds().flaws(&bent(along), &[]);
            assert_eq!(
                (flaws.reasons(0.0, 0.0), flaws.astray_edges, flaws.inward),
                (Vec::new(), 0, 0.0),
                "{along}: {flaws:?}"
            );
        }
    }

    #[test]
    fn faces_that_span_a_gap_on_purpose_are_no_flaw() {
        // From one leg of the U to the other.
        let mut mesh = bent(40);
        let [from, to] = [2u32, 38].map(|row| row * 11);
        for k in 0..10 {
            mesh.faces.push(&[from + k, from + k + 1, to + k + 1, to + k]);
        }
        let across: Vec<u32> = (400..410).collect();
        let reasons = |bridging: &[u32]| grounds().flaws(&mesh, bridging).reasons(0.0, 0.0);
        assert!(reasons(&[]).iter().any(|reason| reason.contains("leap over a gap")), "{:?}", reasons(&[]));
        assert!(!reasons(&across).iter().any(|reason| reason.contains("leap over a gap")), "{:?}", reasons(&across));
    }

    #[test]
    fn faces_may_bridge_a_gap_and_nothing_else() {
        use crate::topology::holes::filled;
        use crate::topology::{Components, primitive};
        let whole = prepare(&bent(200)).expect("a disc").mesh;
        // A window in one leg, and pinholes that make it ragged.
        let is_hole = |f: &u32| (10..40).contains(&(f / 10)) && (3..7).contains(&(f % 10)) || matches!(f, 915 | 955);
        let kept: Vec<u32> =
            (0..whole.triangles.len() as u32).filter(|t| !is_hole(&whole.polygon_of[*t as usize])).collect();
        let ragged = crate::topology::submesh(&whole, &kept).0;
        let patch = primitive(&ragged, Components::default()).expect("a disc with gaps");
        assert_eq!(patch.holes.len(), 3);
        let mesh = bent(40);
        let bare = ReferenceSurface::new(ragged.clone());
        assert!(!bare.flaws(&mesh, &[]).reasons(0.0, 0.0).is_empty());
        let bridged = bare.with_gaps(std::iter::once(filled(&patch.mesh, &patch.holes)));
        assert_eq!(bridged.flaws(&mesh, &[]).reasons(0.0, 0.0), Vec::<String>::new());
        let mut torn = mesh;
        torn.positions[2 * 11 + 5].x = 0.15;
        assert!(!bridged.flaws(&torn, &[]).reasons(0.0, 0.0).is_empty());
    }

    #[test]
    fn an_edge_from_one_leg_to_the_other_is_found_with_both_ends_on_the_surface() {
        // The middle of row 2 goes to the other leg.
        let (flaws, reasons) = found(|mesh| mesh.positions[2 * 11 + 5].x = 0.15);
        // They are off the surface, too, with their middles.
        assert_eq!((flaws.astray_edges, flaws.faces.len(), reasons.len()), (4, 4, 2), "{flaws:?}");
        assert!(reasons[0].contains("a spike"), "{reasons:?}");
        // A whole row of them.
        let (flaws, reasons) = found(|mesh| mesh.positions[2 * 11..3 * 11].iter_mut().for_each(|p| p.x = 0.15));
        assert_eq!(flaws.astray_edges, 20, "those of the boundary count for half: {flaws:?}");
        assert!(reasons[0].contains("20 edges"), "{reasons:?}");
    }

    #[test]
    fn a_spike_is_found() {
        let (flaws, reasons) = found(|mesh| mesh.positions[2 * 11 + 5].x = -0.8);
        assert!(flaws.astray_edges == 4 && flaws.spike > 0.3, "{flaws:?}");
        assert!(reasons.iter().any(|why| why.contains("a spike")), "{reasons:?}");
        // One is enough on a mesh of any size.
        let alone = Flaws { spike: flaws.spike, astray: 1e-4, ..Flaws::default() };
        assert_eq!(alone.reasons(0.0, 0.0).len(), 1);
    }

    #[test]
    fn a_part_that_hangs_off_the_surface_is_found() {
        let lifted = |mesh: &mut PolyMesh| mesh.positions[..8 * 11].iter_mut().for_each(|p| p.x -= 0.2);
        let (flaws, reasons) = found(lifted);
        assert!((0.15..0.25).contains(&flaws.off), "{flaws:?}");
        assert!(reasons.iter().any(|why| why.contains("hangs off")), "{reasons:?}");
    }

    #[test]
    fn what_is_left_bare_is_found_unless_it_is_meant_to_be() {
        let halved = |mesh: &mut PolyMesh| {
            let half: Vec<Vec<u32>> = mesh.faces.iter().take(200).map(<[u32]>::to_vec).collect();
            mesh.faces = half.iter().map(Vec::as_slice).collect();
        };
        let (flaws, reasons) = found(halved);
        assert!((0.4..0.5).contains(&flaws.bare), "{flaws:?}");
        assert!(reasons.len() == 1 && reasons[0].contains("no quads near it"), "{reasons:?}");
        assert!(flaws.reasons(0.5, 0.0).is_empty(), "{flaws:?}");
    }

    #[test]
    fn a_hollow_that_faces_bridge_is_bare() {
        let bridged = |radius: f64| {
            let flat = crate::topology::tests::grid(40, 40, false, false);
            let mut surface = flat.clone();
            let is_within = |p: &&mut Vec3| (p.x - 0.5).hypot(p.y - 0.5) < radius;
            surface.positions.iter_mut().filter(is_within).for_each(|p| p.z = -0.036);
            let mesh = PolyMesh {
                faces: flat.triangles.iter().map(<[u32; 3]>::as_slice).collect(),
                positions: flat.positions,
                ..PolyMesh::default()
            };
            ReferenceSurface::new(surface).flaws(&mesh, &[]).reasons(0.0, 0.0)
        };
        assert!(bridged(0.2).iter().any(|why| why.contains("no quads near it")), "{:?}", bridged(0.2));
        assert_eq!(bridged(0.1), Vec::<String>::new(), "a small one");
    }

    #[test]
    fn the_end_of_a_limb_that_is_missed_is_told_and_more_of_it_is_broken() {
        let without = |rows: usize| {
            found(|mesh| {
                let left: Vec<Vec<u32>> = mesh.faces.iter().skip(10 * rows).map(<[u32]>::to_vec).collect();
                mesh.faces = left.iter().map(Vec::as_slice).collect();
            })
        };
        let says = |why: &String| why.contains("the quads end before the scan does");
        let (flaws, reasons) = without(3);
        assert!(flaws.bare < BARE_MAX && reasons.len() == 1 && reasons.iter().all(says), "{flaws:?} {reasons:?}");
        assert_eq!(flaws.note(0.0), None, "it is a reason");
        let (flaws, reasons) = without(2);
        assert!(reasons.is_empty() && flaws.note(0.0).is_some_and(|why| says(&why)), "{flaws:?} {reasons:?}");
        assert_eq!((flaws.reached().reasons(0.0, 0.0).len(), flaws.reached().note(0.0)), (0, None));
        assert_eq!((flaws.note(0.1), without(0).0.note(0.0)), (None, None));
    }

    #[test]
    fn faces_that_are_inside_out_are_found() {
        let turned = |mesh: &mut PolyMesh| {
            let all: Vec<Vec<u32>> = mesh
                .faces
                .iter()
                .enumerate()
                .map(|(f, c)| if f < 100 { c.iter().rev().copied().collect() } else { c.to_vec() })
                .collect();
            mesh.faces = all.iter().map(Vec::as_slice).collect();
        };
        let (flaws, reasons) = found(turned);
        assert!((flaws.inward - 0.25).abs() < 0.01, "{flaws:?}");
        assert!(reasons.len() == 1 && reasons[0].contains("inside out"), "{reasons:?}");
    }

    #[test]
    fn what_looks_away_is_measured_and_what_bridges_a_gap_is_not() {
        let mut mesh = bent(40);
        let turned = |mesh: &PolyMesh, bridging: &[u32]| TurnedArea::of(grounds().turned(mesh, bridging)).share();
        assert_eq!(turned(&mesh, &[]), 0.0);
        // The middle of row 2 is drawn out to a spike of four faces.
        mesh.positions[2 * 11 + 5].x = -0.8;
        let spiked = turned(&mesh, &[]);
        let faces: Vec<u32> =
            (0u32..).zip(mesh.faces.iter()).filter(|(_, c)| c.contains(&27)).map(|(f, _)| f).collect();
        assert_eq!(faces.len(), 4);
        assert!(spiked > 0.02, "{spiked}");
        assert_eq!(turned(&mesh, &faces), 0.0);
    }

    #[test]
    fn faces_that_have_collapsed_are_found() {
        // Rows 0 to 6 fall together.
        let fallen = |mesh: &mut PolyMesh| (11..7 * 11).for_each(|v| mesh.positions[v] = mesh.positions[v % 11]);
        let (flaws, reasons) = found(fallen);
        assert!((flaws.collapsed - 6.0 / 40.0).abs() < 1e-9, "{flaws:?}");
        assert!(reasons.iter().any(|why| why.contains("collapsed")), "{reasons:?}");
    }

    #[test]
    fn a_mesh_that_is_not_finite_or_has_no_face_is_broken() {
        let (_, reasons) = found(|mesh| mesh.positions[..100].iter_mut().for_each(|p| p.x = f64::NAN));
        assert!(!reasons.is_empty());
        assert!(!grounds().flaws(&PolyMesh::default(), &[]).reasons(0.0, 0.0).is_empty());
    }
}
