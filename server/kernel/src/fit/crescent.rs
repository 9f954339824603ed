//! Quads between a part of a laid example's rim and a part of the input's boundary.
//!
//! An input that was cut aslant of the example, as at the back of the neck, goes on beyond a part of the rim alone. What is left of
//! it is a disc, here a crescent: one side of its boundary lies along the rim, the other is the input's own. Rows around the rim
//! have no place there. The crescent is laid out regularly instead; its vertices along the rim are the rim's, and those on the
//! other side as many as edges of that length ask for. *Ours, not the paper's.*

use super::beyond::GrownMesh;
use crate::compose::layout::Curve;
use crate::compose::smooth::Target;
use crate::compose::template::border::Border;
use crate::compose::template::disc_between;
use crate::encode::index::PlanarIndex;
use crate::mesh::tri::{TriMesh, nearest_share};
use crate::mesh::{PolyMesh, Vec3};
use crate::unfold::Chart;

/// A part of the rim lies along the crescent if it is nearer to it than so many of its edges, on average. *Untuned.*
const ALONG: f64 = 1.0;
/// A point lies on the input's boundary if it is nearer to it than this share of the loop's length.
const SAME: f64 = 1e-9;

/// A disc that lies between the rim and the input's boundary.
pub(super) struct Crescent<'a> {
    chart: &'a Chart,
    border: Border,
    /// Numbers of the points of its loop that lie along the rim, in the loop's order.
    along_rim: Vec<usize>,
}

/// A part of the rim, in the order of the crescent's loop.
struct RimPart {
    vertices: Vec<u32>,
    /// Where on the loop each lies.
    at: Vec<f64>,
    /// Its mean edge.
    edge: f64,
    /// How far its vertices are from the loop, on average.
    away: f64,
}

impl<'a> Crescent<'a> {
    /// Of a disc of the input; `None` unless one part of its boundary is the input's own, and one is not.
    pub(super) fn of(chart: &'a Chart, input: &TriMesh) -> Option<Self> {
        let (border, ends) = (Border::new(chart), Target::new(input));
        let curve = border.only_loop()?;
        let points = &curve.points;
        let is_end = |p: &Vec3| (ends.onto_border(*p) - p).norm() < SAME * curve.length();
        let is_end: Vec<bool> = points.iter().map(is_end).collect();
        let n = points.len();
        let mut starts = (0..n).filter(|&k| !is_end[k] && is_end[(k + n - 1) % n]);
        let (first, None) = (starts.next()?, starts.next()) else { return None };
        let along = (first..first + n).take_while(|&k| !is_end[k % n]).count();
        // Where the rim meets the end of the input, both sides begin.
        let along_rim = (first + n - 1..first + n + along).map(|k| k % n).collect();
        Some(Self { chart, border, along_rim })
    }

    /// Fills it with quads that continue `mesh`, which has these `rims`. `None` where none of these lies along it.
    pub(super) fn filled(&self, mesh: &PolyMesh, rims: &[Vec<u32>], index: &PlanarIndex) -> Option<PolyMesh> {
        let curve = self.border.only_loop()?;
        let parts = rims.iter().filter_map(|rim| self.part(curve, mesh, rim));
        let part = parts.min_by(|a, b| (a.away / a.edge).total_cmp(&(b.away / b.edge)))?;
        if part.away > ALONG * part.edge {
            return None;
        }
        let (first, last) = (*part.at.first()?, *part.at.last()?);
        let mut points: Vec<Vec3> = part.vertices.iter().map(|&v| mesh.positions[v as usize]).collect();
        let rest = first + curve.length() - last;
        let mut edges = ((rest / part.edge).round() as usize).clamp(2, 4 * points.len());
        // As many vertices in all as a grid can have around it.
        edges += (points.len() - 1 + edges) % 2;
        let beyond: Vec<f64> = (1..edges).map(|k| last + rest * k as f64 / edges as f64).collect();
        points.extend(beyond.iter().map(|&s| curve.point(s)));
        let at: Vec<f64> = part.at.iter().copied().chain(beyond).collect();
        let laid = disc_between((self.chart, index), &self.border, part.edge, (&at, points))?;
        let mut grown = GrownMesh::new(mesh, Vec::new(), mesh.faces.len().saturating_sub(1));
        let mut number: Vec<Option<u32>> = vec![None; laid.net.positions.len()];
        laid.ends[0].iter().zip(&part.vertices).for_each(|(&v, &of_rim)| number[v as usize] = Some(of_rim));
        let mut faces: Vec<[u32; 4]> = Vec::new();
        for (_, corners) in laid.net.faces() {
            let corners: [u32; 4] = corners.try_into().ok()?;
            faces.push(
                corners
                    .map(|v| *number[v as usize].get_or_insert_with(|| grown.vertex(laid.net.positions[v as usize]))),
            );
        }
        // The loop runs against the rim, and so do the edges of faces that lie along it.
        let [a, b] = part.vertices.first_chunk()?;
        let runs_so = |face: &[u32; 4]| (0..4).any(|k| face[k] == *a && face[(k + 1) % 4] == *b);
        let is_turned = !faces.iter().any(runs_so);
        for mut face in faces {
            if is_turned {
                face.reverse();
            }
            grown.face(face);
        }
        Some(grown.mesh)
    }

    /// The part of a rim from one end of the crescent's side along the rim to the other. `None` where it has less than two edges, or
    /// all in one point.
    fn part(&self, curve: &Curve, mesh: &PolyMesh, rim: &[u32]) -> Option<RimPart> {
        let point = |k: usize| mesh.positions[rim[k] as usize];
        let nearest = |x: Vec3| (0..rim.len()).min_by(|&a, &b| (point(a) - x).norm().total_cmp(&(point(b) - x).norm()));
        let ends = [self.along_rim.first()?, self.along_rim.last()?].map(|&k| nearest(curve.points[k]));
        // The loop runs against the rim.
        let [Some(last), Some(first)] = ends else { return None };
        let count = (last + rim.len() - first) % rim.len() + 1;
        let part: Vec<usize> = (first..first + count).rev().map(|k| k % rim.len()).collect();
        let (mut away, mut at) = (0.0, Vec::with_capacity(count));
        for &k in &part {
            let (far, place) = self.nearest(curve, point(k))?;
            away += far / count as f64;
            // What comes back by a little stays where the one before is.
            at.push(at.last().map_or(place, |before: &f64| before.max(place)));
        }
        let ends = part.windows(2).map(|ends| (point(ends[1]) - point(ends[0])).norm());
        let edge = ends.sum::<f64>() / (part.len() - 1) as f64;
        let vertices = part.into_iter().map(|k| rim[k]).collect();
        (count > 2 && edge > 0.0).then_some(RimPart { vertices, at, edge, away })
    }

    /// How far a point is from the side along the rim, and where on the loop it is nearest, from that side's first point on.
    fn nearest(&self, curve: &Curve, x: Vec3) -> Option<(f64, f64)> {
        let first = curve.along[*self.along_rim.first()?];
        let pairs = self.along_rim.iter().zip(self.along_rim.iter().skip(1));
        let nearest = pairs.map(|(&a, &b)| {
            let ends = [curve.points[a], curve.points[b]];
            let share = nearest_share(ends, x);
            let start = if curve.along[a] < first { curve.along[a] + curve.length() } else { curve.along[a] };
            ((ends[0].lerp(&ends[1], share) - x).norm(), start + share * (ends[1] - ends[0]).norm())
        });
        nearest.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

#[cfg(test)]
mod tests {
    use crate::fit::beyond::continued;
    use crate::fit::within;
    use crate::mesh::{PolyMesh, Polygons, Vec3, prepare};
    use crate::segment::segment_above;
    use crate::topology::tests::grid;
    use std::collections::BTreeMap;

    #[test]
    fn what_lies_between_a_slanted_rim_and_the_end_of_a_sheet_is_filled() {
        // 12 × 6 quads on the lower part of the unit square, higher on the right than on the left.
        let at = |i: u32, j: u32| j * 13 + i;
        let place = |i: u32, j: u32| {
            let x = f64::from(i) / 12.0;
            Vec3::new(x, (0.4 + 0.3 * x) * f64::from(j) / 6.0, 0.0)
        };
        let positions = (0..=6).flat_map(|j| (0..=12).map(move |i| place(i, j))).collect();
        let mut faces = Polygons::default();
        for (i, j) in (0..6).flat_map(|j| (0..12).map(move |i| (i, j))) {
            faces.push(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        let (mesh, sheet) = (PolyMesh { positions, faces, ..PolyMesh::default() }, grid(40, 40, false, false));
        let surface = prepare(&mesh).expect("quads").mesh;
        let field = within(&surface, &surface.positions, &sheet).expect("a rim");
        let rest = segment_above(&sheet, &field).expect("a cut").parts.swap_remove(1);
        let grown = continued(&mesh, &rest, &sheet).expect("a crescent");
        assert_eq!(&grown.positions[..91], &mesh.positions[..]);
        assert!(grown.faces.iter().take(72).eq(mesh.faces.iter()) && grown.faces.len() > 100);
        let mut halfedges = BTreeMap::new();
        let mut area = 0.0;
        for face in grown.faces.iter() {
            let p = |k: usize| grown.positions[face[k] as usize];
            area += 0.5 * (p(2) - p(0)).cross(&(p(3) - p(1))).z;
            (0..4).for_each(|k| *halfedges.entry((face[k], face[(k + 1) % 4])).or_insert(0) += 1);
        }
        assert!(halfedges.values().all(|count| *count == 1), "faces beside each other turn alike");
        assert!((area - 1.0).abs() < 0.02, "{area}");
        let open = halfedges.keys().filter(|(a, b)| !halfedges.contains_key(&(*b, *a)));
        let end = |v: u32| {
            let p = grown.positions[v as usize];
            p.x.min(1.0 - p.x).min(p.y).min(1.0 - p.y)
        };
        assert!(open.into_iter().all(|(a, _)| end(*a) < 1e-3), "the sheet is covered to its end");
    }
}
