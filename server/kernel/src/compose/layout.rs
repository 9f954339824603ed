//! The curves along which the segments of an input meet: arcs between junctions, each with the segments on its sides.
//!
//! A *junction* is a point of the surface at which other than two cut edges meet, a cut edge being one between two
//! segments or on the true boundary. An *arc* runs from junction to junction, or is closed. Every boundary loop of a
//! segment is a row of arcs. *Ours, not the paper's:* the paper merges nearest vertices wherever they lie; knowing which
//! curve a vertex lies on makes the topology of the result that of the input, by construction.

use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh, nearest_share};
use crate::numerics::stop;
use crate::topology::submesh;
use std::collections::BTreeMap;

/// A curve is smoothed over this share of its length to each side, with so many samples.
const SMOOTHED_SHARE: f64 = 0.015;
const SMOOTHED_SAMPLES: usize = 8;
/// It is jagged if that leaves less than this share of its length.
const JAGGED: f64 = 0.75;

/// A part of a boundary loop that is one arc.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// The arc's number.
    pub arc: u32,
    /// Where on the loop it starts, as a length.
    pub start: f64,
    /// Its length.
    pub length: f64,
    /// The junction at its start; [`NONE`] for a closed arc.
    pub junction: u32,
}

/// A boundary loop of a segment, with the segment on its left.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its points; the last is joined to the first.
    pub points: Vec<Vec3>,
    /// Length up to each point, and the whole length last.
    pub along: Vec<f64>,
    /// The arcs it consists of, in order.
    pub runs: Vec<Run>,
    /// Length of the curve without its jags up to each point, and the whole last; empty where there are none.
    pub smoothed: Vec<f64>,
}

/// A place where an arc occurs: segment, loop, run.
pub type Occurrence = [u32; 3];

/// An arc: two occurrences on a seam, one on the true boundary. The second runs against the first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Arc {
    /// Where it occurs.
    pub sides: Vec<Occurrence>,
}

/// All curves of a segmentation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    /// The loops of each segment.
    pub curves: Vec<Vec<Curve>>,
    /// The arcs.
    pub arcs: Vec<Arc>,
    /// Where the junctions lie: a vertex of the surface each.
    pub junctions: Vec<u32>,
}

/// The curves of a surface whose triangle t belongs to segment `owner[t]`, of `count`.
pub fn layout(surface: &TriMesh, owner: &[u32], count: usize) -> Layout {
    stop::ask();
    let junctions = junctions(surface, owner);
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (t, &s) in owner.iter().enumerate() {
        if let Some(list) = members.get_mut(s as usize) {
            list.push(t as u32);
        }
    }
    let mut arc_of: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut arcs: Vec<Arc> = Vec::new();
    let mut curves = Vec::with_capacity(count);
    for (segment, triangles) in members.iter().enumerate() {
        let (part, vertex_of) = submesh(surface, triangles);
        let mut of_segment = Vec::new();
        for ring in part.boundary_loops() {
            let vertices: Vec<u32> = ring.iter().map(|&h| vertex_of[part.tail(h) as usize]).collect();
            let (curve, keys) = curve(surface, vertices, &junctions);
            let mut curve = curve;
            for (run, key) in keys.into_iter().enumerate() {
                let arc = *arc_of.entry(key).or_insert_with(|| {
                    arcs.push(Arc::default());
                    arcs.len() as u32 - 1
                });
                curve.runs[run].arc = arc;
                arcs[arc as usize].sides.push([segment as u32, of_segment.len() as u32, run as u32]);
            }
            of_segment.push(curve);
        }
        curves.push(of_segment);
    }
    Layout { curves, arcs, junctions }
}

/// Vertices at which other than two (and other than no) cut edges meet, in order.
fn junctions(surface: &TriMesh, owner: &[u32]) -> Vec<u32> {
    let mut cuts = vec![0u32; surface.positions.len()];
    for h in 0..surface.twins.len() as u32 {
        let g = surface.twin(h);
        if g == NONE || (h < g && owner[h as usize / 3] != owner[g as usize / 3]) {
            cuts[surface.tail(h) as usize] += 1;
            cuts[surface.head(h) as usize] += 1;
        }
    }
    (0..cuts.len() as u32).filter(|&v| cuts[v as usize] != 2 && cuts[v as usize] != 0).collect()
}

/// A loop, started at a junction (else at its lowest vertex, so that both sides agree), and a key for each of its runs:
/// the lowest edge on it.
fn curve(surface: &TriMesh, mut vertices: Vec<u32>, junctions: &[u32]) -> (Curve, Vec<(u32, u32)>) {
    let junction = |v: u32| junctions.binary_search(&v).ok();
    let n = vertices.len();
    let start =
        (0..n).find(|&k| junction(vertices[k]).is_some()).or_else(|| (0..n).min_by_key(|&k| vertices[k])).unwrap_or(0);
    vertices.rotate_left(start);
    let points: Vec<Vec3> = vertices.iter().map(|&v| surface.positions[v as usize]).collect();
    let mut along = vec![0.0];
    let (mut runs, mut keys): (Vec<Run>, Vec<(u32, u32)>) = (Vec::new(), Vec::new());
    for k in 0..n {
        let (a, b) = (vertices[k], vertices[(k + 1) % n]);
        if k == 0 || junction(a).is_some() {
            let number = junction(a).map_or(NONE, |j| j as u32);
            runs.push(Run { arc: NONE, start: along[k], length: 0.0, junction: number });
            keys.push((u32::MAX, u32::MAX));
        }
        let step = (points[(k + 1) % n] - points[k]).norm();
        along.push(along[k] + step);
        if let (Some(run), Some(key)) = (runs.last_mut(), keys.last_mut()) {
            run.length += step;
            *key = (*key).min((a.min(b), a.max(b)));
        }
    }
    (Curve { points, along, runs, smoothed: Vec::new() }.without_jags(), keys)
}

impl Curve {
    /// With its lengths smoothed, if it is jagged: each point goes to the mean of the curve around it.
    fn without_jags(mut self) -> Self {
        let reach = SMOOTHED_SHARE * self.length();
        let mean = |&s: &f64| {
            let around = (0..=2 * SMOOTHED_SAMPLES).map(|k| k as f64 / SMOOTHED_SAMPLES as f64 - 1.0);
            around.map(|x| self.point(s + reach * x)).sum::<Vec3>() / (2 * SMOOTHED_SAMPLES + 1) as f64
        };
        let means: Vec<Vec3> = self.along.iter().map(mean).collect();
        let mut smoothed = vec![0.0];
        for pair in means.windows(2) {
            smoothed.push(smoothed[smoothed.len() - 1] + (pair[1] - pair[0]).norm());
        }
        if smoothed.last().is_some_and(|whole| *whole < JAGGED * self.length()) {
            self.smoothed = smoothed;
        }
        self
    }

    /// The length of a part of it without its jags.
    pub fn smooth_length(&self, run: &Run) -> f64 {
        self.smooth_at(run.start + run.length) - self.smooth_at(run.start)
    }

    /// The places that part a run into `n` alike, by its length without jags: from its start on, both ends included.
    pub fn even_places(&self, run: &Run, n: usize) -> Vec<f64> {
        let (first, whole) = (self.smooth_at(run.start), self.smooth_length(run));
        if self.smoothed.is_empty() || whole <= 0.0 {
            return (0..=n).map(|k| run.length * k as f64 / n as f64).collect();
        }
        let inside = |k: usize| self.place_of_smooth(first + whole * k as f64 / n as f64) - run.start;
        let mut places = vec![0.0];
        places.extend((1..n).map(|k| inside(k).clamp(0.0, run.length)));
        places.push(run.length);
        places
    }

    /// The length without jags up to a length, at most the whole.
    fn smooth_at(&self, s: f64) -> f64 {
        if self.smoothed.len() != self.along.len() {
            return s;
        }
        interpolated(&self.along, &self.smoothed, s)
    }

    fn place_of_smooth(&self, x: f64) -> f64 {
        interpolated(&self.smoothed, &self.along, x)
    }

    /// Its whole length.
    pub fn length(&self) -> f64 {
        self.along.last().copied().unwrap_or(0.0)
    }

    /// The place on the curve nearest to a point: its length from the start, and the distance.
    pub fn nearest(&self, p: Vec3) -> (f64, f64) {
        let n = self.points.len();
        let mut best = (0.0, f64::INFINITY);
        for k in 0..n {
            let [a, b] = [self.points[k], self.points[(k + 1) % n]];
            let t = nearest_share([a, b], p);
            let distance = (a + (b - a) * t - p).norm_squared();
            if distance < best.1 {
                best = (self.along[k] + t * (self.along[k + 1] - self.along[k]), distance);
            }
        }
        (best.0, best.1.sqrt())
    }

    /// The edge at a length from the start, and which share of it lies before; `None` for a curve without points.
    pub fn place(&self, s: f64) -> Option<(usize, f64)> {
        let n = self.points.len();
        if n == 0 {
            return None;
        }
        let s = if self.length() > 0.0 { s.rem_euclid(self.length()) } else { 0.0 };
        let k = self.along.partition_point(|&x| x <= s).clamp(1, n) - 1;
        let step = self.along[k + 1] - self.along[k];
        Some((k, if step > 0.0 { (s - self.along[k]) / step } else { 0.0 }))
    }

    /// The point at a length from the start.
    pub fn point(&self, s: f64) -> Vec3 {
        let Some((k, t)) = self.place(s) else { return Vec3::zeros() };
        self.points[k] + (self.points[(k + 1) % self.points.len()] - self.points[k]) * t
    }
}

/// What `to` is where `from`, which increases, is x.
fn interpolated(from: &[f64], to: &[f64], x: f64) -> f64 {
    if from.len() < 2 {
        return x;
    }
    let k = from.partition_point(|&y| y <= x).clamp(1, from.len() - 1) - 1;
    let step = from[k + 1] - from[k];
    let t = if step > 0.0 { ((x - from[k]) / step).clamp(0.0, 1.0) } else { 0.0 };
    to[k] + (to[k + 1] - to[k]) * t
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn two_rings_of_a_tube_share_one_closed_arc() {
        let mesh = grid(8, 6, true, false);
        let owner: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| t / 48).collect();
        let found = layout(&mesh, &owner, 2);
        assert!(found.junctions.is_empty());
        let mut sides: Vec<usize> = found.arcs.iter().map(|a| a.sides.len()).collect();
        sides.sort_unstable();
        assert_eq!(sides, [1, 1, 2]);
    }

    #[test]
    fn three_parts_of_a_sheet_meet_in_junctions() {
        // Left half, and the right half cut in two: one junction inside, three on the border.
        let mesh = grid(4, 4, false, false);
        let owner: Vec<u32> = (0..32u32)
            .map(|t| {
                let (i, j) = ((t / 2) % 4, (t / 2) / 4);
                if i < 2 { 0 } else { 1 + u32::from(j >= 2) }
            })
            .collect();
        let found = layout(&mesh, &owner, 3);
        assert_eq!(found.junctions.len(), 4);
        assert_eq!(found.arcs.iter().filter(|a| a.sides.len() == 2).count(), 3);
        assert_eq!(found.arcs.iter().filter(|a| a.sides.len() == 1).count(), 3);
        for arc in found.arcs.iter().filter(|a| a.sides.len() == 2) {
            let [x, y] = [0, 1].map(|k| {
                let [s, l, r] = arc.sides[k].map(|x| x as usize);
                found.curves[s][l].runs[r].length
            });
            assert!((x - y).abs() < 1e-12);
        }
    }

    #[test]
    fn a_point_of_a_curve_is_found_again() {
        let mesh = grid(5, 5, false, false);
        let found = layout(&mesh, &[0; 50], 1);
        let curve = &found.curves[0][0];
        for s in [0.1, 1.3, 2.77, 3.9] {
            let (t, d) = curve.nearest(curve.point(s));
            assert!((t - s).abs() < 1e-12 && d < 1e-12, "{s} {t}");
        }
    }
    #[test]
    fn jags_take_no_places_of_their_own() {
        // A square of side 1; its lower side, the first quarter of the points, has teeth of height 0.04 and width 0.01.
        let lower = (0..200).map(|k| Vec3::new(f64::from(k) / 200.0, 0.04 * f64::from(k % 2), 0.0));
        let rest = (0..150).map(|k| {
            let t = f64::from(k % 50) / 50.0;
            [Vec3::new(1.0, t, 0.0), Vec3::new(1.0 - t, 1.0, 0.0), Vec3::new(0.0, 1.0 - t, 0.0)][k as usize / 50]
        });
        let points: Vec<Vec3> = lower.chain(rest).collect();
        let mut along = vec![0.0];
        (0..350).for_each(|k| along.push(along[k] + (points[(k + 1) % 350] - points[k]).norm()));
        let plain = Curve { points, along, runs: Vec::new(), smoothed: Vec::new() };
        let whole = Run { arc: 0, start: 0.0, length: plain.length(), junction: NONE };
        let lower = |curve: &Curve| curve.even_places(&whole, 100).iter().filter(|&&s| curve.point(s).y < 0.05).count();
        assert!(lower(&plain) > 65, "{}", lower(&plain));
        let smooth = plain.without_jags();
        assert!((20..45).contains(&lower(&smooth)), "{}", lower(&smooth));
        assert!(smooth.smooth_length(&whole) < 5.0);
    }
}
