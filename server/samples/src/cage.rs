//! Control cages of quads, the modeller's two moves on them (extrude a region, cap a loop), and Catmull–Clark.
//!
//! A cage vertex carries a *base* point and an *offset*. Subdivision smooths both; a shape places the vertex at
//! sculpt(base) + offset. So rings of quads can be laid on a chart (a head's peg) while ears grow freely out of it,
//! and a cage whose sculpt is the identity is plain polygon modelling.
//!
//! *Source:* E. Catmull, J. Clark, Recursively generated B-spline surfaces, 1978; boundary edges by the cubic B-spline
//! rule.

use super::loft::Hoop;
use quadmuse_kernel::mesh::Vec3;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Index of a cage face.
pub(super) type Face = usize;

/// A quad mesh under construction.
#[derive(Clone, Debug, Default)]
pub(super) struct Cage {
    pub(super) bases: Vec<Vec3>,
    pub(super) offsets: Vec<Vec3>,
    pub(super) quads: Vec<[u32; 4]>,
    pub(super) group_of: Vec<u32>,
    pub(super) groups: Vec<String>,
}

/// What [`Cage::extrude`] made: a ring of quads around the region.
#[derive(Clone, Debug)]
pub(super) struct Ring {
    /// The new quads, in loop order.
    pub(super) faces: Vec<Face>,
    /// The region's new boundary vertices, in loop order (counter-clockwise seen from outside).
    pub(super) inner: Vec<u32>,
}

impl Cage {
    /// A tube open at both ends: row 0 below, columns counter-clockwise seen from above, so that the outside is
    /// outside where `point(row, column)` turns around +y. Face (r, c) has index r·columns + c.
    pub(super) fn tube(rows: usize, columns: usize, group: &str, point: impl Fn(usize, usize) -> Vec3) -> Self {
        let mut cage = Self::default();
        for k in 0..rows * columns {
            cage.vertex(point(k / columns, k % columns));
        }
        for k in 0..(rows - 1) * columns {
            let (r, c) = (k / columns, k % columns);
            let at = |r: usize, c: usize| (r * columns + c % columns) as u32;
            cage.face([at(r, c), at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)], group);
        }
        cage
    }

    /// Adds a vertex without offset.
    pub(super) fn vertex(&mut self, base: Vec3) -> u32 {
        self.bases.push(base);
        self.offsets.push(Vec3::zeros());
        (self.bases.len() - 1) as u32
    }

    /// Adds a quad, counter-clockwise seen from outside.
    pub(super) fn face(&mut self, corners: [u32; 4], group: &str) -> Face {
        self.quads.push(corners);
        let group = self.group(group);
        self.group_of.push(group);
        self.quads.len() - 1
    }

    /// Puts faces into a group.
    pub(super) fn name(&mut self, faces: &[Face], group: &str) {
        let group = self.group(group);
        faces.iter().for_each(|&f| self.group_of[f] = group);
    }

    fn group(&mut self, name: &str) -> u32 {
        if let Some(found) = self.groups.iter().position(|g| g == name) {
            return found as u32;
        }
        self.groups.push(name.to_owned());
        (self.groups.len() - 1) as u32
    }

    /// The boundary of a disc of faces, counter-clockwise seen from outside, starting at its lowest vertex.
    pub(super) fn outline(&self, region: &[Face]) -> Vec<u32> {
        let mut next: BTreeMap<(u32, u32), ()> = BTreeMap::new();
        for &f in region {
            for k in 0..4 {
                let (a, b) = (self.quads[f][k], self.quads[f][(k + 1) % 4]);
                if next.remove(&(b, a)).is_none() {
                    next.insert((a, b), ());
                }
            }
        }
        let follow: BTreeMap<u32, u32> = next.into_keys().collect();
        let mut outline = Vec::with_capacity(follow.len());
        let mut at = follow.keys().next().copied();
        while let Some(v) = at.filter(|v| outline.first() != Some(v)) {
            outline.push(v);
            at = follow.get(&v).copied();
        }
        debug_assert_eq!(outline.len(), follow.len(), "a region must be a disc");
        outline
    }

    /// The vertices of a region, ascending.
    pub(super) fn vertices(&self, region: &[Face]) -> Vec<u32> {
        let mut all: Vec<u32> = region.iter().flat_map(|&f| self.quads[f]).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Lifts a disc of faces off along new boundary vertices (at the old places) and closes the gap by a ring of
    /// quads. The region keeps its face numbers; moving its vertices makes the inset or the extrusion.
    pub(super) fn extrude(&mut self, region: &[Face], group: &str) -> Ring {
        let outer = self.outline(region);
        let inner: Vec<u32> = outer
            .iter()
            .map(|&v| {
                let copy = self.vertex(self.bases[v as usize]);
                self.offsets[copy as usize] = self.offsets[v as usize];
                copy
            })
            .collect();
        let moved: BTreeMap<u32, u32> = outer.iter().copied().zip(inner.iter().copied()).collect();
        for &f in region {
            self.quads[f].iter_mut().for_each(|v| *v = moved.get(v).copied().unwrap_or(*v));
        }
        let n = outer.len();
        let faces =
            (0..n).map(|k| self.face([outer[k], outer[(k + 1) % n], inner[(k + 1) % n], inner[k]], group)).collect();
        Ring { faces, inner }
    }

    /// Lays a region's outline on a hoop, evenly, turned so that its vertices move least in angle; the vertices inside
    /// keep their place among them, drawn in to half.
    pub(super) fn lay(&mut self, region: &[Face], hoop: &Hoop) {
        let rim = self.outline(region);
        let all = self.vertices(region);
        let centre = self.centre(&rim);
        let n = rim.len() as f64;
        let (u, v) = (hoop.u.normalize(), hoop.v.normalize());
        let seen = |p: &Vec3| [(p - centre).dot(&u), (p - centre).dot(&v)];
        let (mut s, mut c, mut reach) = (0.0, 0.0, 1e-9);
        for (k, &w) in rim.iter().enumerate() {
            let [x, y] = seen(&self.bases[w as usize]);
            let turn = y.atan2(x) - TAU * k as f64 / n;
            (s, c, reach) = (s + turn.sin(), c + turn.cos(), f64::max(reach, x.hypot(y)));
        }
        let start = s.atan2(c);
        for &w in all.iter().filter(|w| !rim.contains(w)) {
            let [x, y] = seen(&self.bases[w as usize]).map(|d| d / reach * 0.5);
            self.bases[w as usize] = hoop.centre + hoop.u * x + hoop.v * y;
        }
        for (k, &w) in rim.iter().enumerate() {
            self.bases[w as usize] = hoop.at(start + TAU * k as f64 / n);
        }
    }

    /// Extrudes a region along hoops, one ring of quads each.
    pub(super) fn grow(&mut self, region: &[Face], hoops: &[Hoop], group: &str) {
        self.name(region, group);
        for hoop in hoops {
            self.extrude(region, group);
            self.lay(region, hoop);
        }
    }

    /// Insets a region: each factor adds a ring, scaled about the region's centre, then moved by its step.
    pub(super) fn inset(&mut self, region: &[Face], rings: &[(f64, Vec3)], group: &str) {
        self.name(region, group);
        for &(factor, step) in rings {
            self.extrude(region, group);
            let vertices = self.vertices(region);
            let centre = self.centre(&vertices);
            self.shift(&vertices, |p| centre + (p - centre) * factor + step);
        }
    }

    /// Moves the base points of some vertices.
    pub(super) fn shift(&mut self, vertices: &[u32], to: impl Fn(Vec3) -> Vec3) {
        for &v in vertices {
            self.bases[v as usize] = to(self.bases[v as usize]);
        }
    }

    /// Mean base point of some vertices.
    pub(super) fn centre(&self, vertices: &[u32]) -> Vec3 {
        vertices.iter().map(|&v| self.bases[v as usize]).sum::<Vec3>() / vertices.len().max(1) as f64
    }

    /// Closes an even loop (counter-clockwise seen from outside the new patch) by a grid of quads `wide` columns wide,
    /// blended from its four sides. Returns the faces, row after row.
    pub(super) fn cap(&mut self, rim: &[u32], wide: usize, group: &str) -> Vec<Face> {
        let high = rim.len() / 2 - wide;
        let side = |k: usize| rim[k % rim.len()];
        let mut at = vec![0u32; (wide + 1) * (high + 1)];
        for j in 0..=high {
            for i in 0..=wide {
                let bottom = side(i);
                let top = side(wide + high + (wide - i));
                let left = side(rim.len() - j);
                let right = side(wide + j);
                at[j * (wide + 1) + i] = match (i, j) {
                    (_, 0) => bottom,
                    (_, j) if j == high => top,
                    (0, _) => left,
                    (i, _) if i == wide => right,
                    _ => {
                        let (s, t) = (i as f64 / wide as f64, j as f64 / high as f64);
                        let p = |v: u32| self.bases[v as usize];
                        let corners = [side(0), side(wide), side(wide + high), side(2 * wide + high)].map(p);
                        let bilinear = (corners[0] * (1.0 - s) + corners[1] * s) * (1.0 - t)
                            + (corners[3] * (1.0 - s) + corners[2] * s) * t;
                        let coons = p(bottom) * (1.0 - t) + p(top) * t + p(left) * (1.0 - s) + p(right) * s - bilinear;
                        self.vertex(coons)
                    }
                };
            }
        }
        let row = wide + 1;
        (0..wide * high)
            .map(|k| {
                let a = k / wide * row + k % wide;
                self.face([at[a], at[a + 1], at[a + row + 1], at[a + row]], group)
            })
            .collect()
    }

    /// One Catmull–Clark step; face f becomes the faces 4f..4f + 4, one a corner.
    pub(super) fn subdivided(&self) -> Self {
        let values: Vec<[Vec3; 2]> = self.bases.iter().zip(&self.offsets).map(|(b, o)| [*b, *o]).collect();
        let (points, quads) = catmull_clark(&values, &self.quads);
        Self {
            bases: points.iter().map(|p| p[0]).collect(),
            offsets: points.iter().map(|p| p[1]).collect(),
            quads,
            group_of: self.group_of.iter().flat_map(|&g| [g; 4]).collect(),
            groups: self.groups.clone(),
        }
    }
}

fn catmull_clark<const N: usize>(points: &[[Vec3; N]], quads: &[[u32; 4]]) -> (Vec<[Vec3; N]>, Vec<[u32; 4]>) {
    let zero = [Vec3::zeros(); N];
    let add = |a: [Vec3; N], b: [Vec3; N]| -> [Vec3; N] { std::array::from_fn(|k| a[k] + b[k]) };
    let times = |a: [Vec3; N], s: f64| -> [Vec3; N] { std::array::from_fn(|k| a[k] * s) };
    let at = |v: u32| points[v as usize];
    let face_points: Vec<[Vec3; N]> =
        quads.iter().map(|q| times(q.iter().fold(zero, |sum, &v| add(sum, at(v))), 0.25)).collect();

    let mut edges: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (f, q) in quads.iter().enumerate() {
        for k in 0..4 {
            let (a, b) = (q[k], q[(k + 1) % 4]);
            edges.entry((a.min(b), a.max(b))).or_default().push(f);
        }
    }
    let (n, m) = (points.len(), edges.len());
    let mut valence = vec![0.0f64; n];
    let mut faces_sum = vec![zero; n];
    let mut edges_sum = vec![zero; n];
    let mut rim_sum = vec![zero; n];
    let mut on_rim = vec![false; n];
    let mut edge_points = Vec::with_capacity(m);
    let mut edge_number: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    for (k, (&(a, b), sides)) in edges.iter().enumerate() {
        let middle = times(add(at(a), at(b)), 0.5);
        let (i, j) = (a as usize, b as usize);
        (valence[i], valence[j]) = (valence[i] + 1.0, valence[j] + 1.0);
        (edges_sum[i], edges_sum[j]) = (add(edges_sum[i], middle), add(edges_sum[j], middle));
        edge_number.insert((a, b), (n + k) as u32);
        edge_points.push(match sides.as_slice() {
            &[f, g] => times(add(add(face_points[f], face_points[g]), times(middle, 2.0)), 0.25),
            _ => {
                (on_rim[i], on_rim[j]) = (true, true);
                (rim_sum[i], rim_sum[j]) = (add(rim_sum[i], at(b)), add(rim_sum[j], at(a)));
                middle
            }
        });
    }
    for (f, q) in quads.iter().enumerate() {
        q.iter().for_each(|&v| faces_sum[v as usize] = add(faces_sum[v as usize], face_points[f]));
    }
    let mut out: Vec<[Vec3; N]> = (0..n)
        .map(|v| {
            let k = valence[v].max(1.0);
            if on_rim[v] {
                return add(times(points[v], 0.75), times(rim_sum[v], 0.125));
            }
            let around = add(times(faces_sum[v], 1.0 / k), times(edges_sum[v], 2.0 / k));
            times(add(around, times(points[v], k - 3.0)), 1.0 / k)
        })
        .collect();
    out.extend(edge_points);
    out.extend(&face_points);
    let number = |a: u32, b: u32| edge_number[&(a.min(b), a.max(b))];
    let fine = quads.iter().enumerate().flat_map(|(f, q)| {
        let centre = (n + m + f) as u32;
        std::array::from_fn::<[u32; 4], 4, _>(|k| {
            [q[k], number(q[k], q[(k + 1) % 4]), centre, number(q[(k + 3) % 4], q[k])]
        })
    });
    let fine = fine.collect();
    (out, fine)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rectangular patch; face (r, c) has index r·columns + c, counter-clockwise where rows go up and columns right.
    fn patch(rows: usize, columns: usize, group: &str, point: impl Fn(usize, usize) -> Vec3) -> Cage {
        let mut cage = Cage::default();
        for k in 0..(rows + 1) * (columns + 1) {
            cage.vertex(point(k / (columns + 1), k % (columns + 1)));
        }
        for k in 0..rows * columns {
            let (r, c) = (k / columns, k % columns);
            let at = |r: usize, c: usize| (r * (columns + 1) + c) as u32;
            cage.face([at(r, c), at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)], group);
        }
        cage
    }

    fn column() -> Cage {
        Cage::tube(4, 8, "side", |r, c| {
            let a = std::f64::consts::TAU * c as f64 / 8.0;
            Vec3::new(a.sin(), r as f64, a.cos())
        })
    }

    fn euler(cage: &Cage) -> isize {
        let mut edges: Vec<[u32; 2]> = Vec::new();
        for q in &cage.quads {
            edges.extend((0..4).map(|k| [q[k].min(q[(k + 1) % 4]), q[k].max(q[(k + 1) % 4])]));
        }
        edges.sort_unstable();
        edges.dedup();
        cage.bases.len() as isize - edges.len() as isize + cage.quads.len() as isize
    }

    #[test]
    fn a_tube_turns_its_faces_outwards() {
        let cage = column();
        for q in &cage.quads {
            let [a, b, c, d] = q.map(|v| cage.bases[v as usize]);
            let mut outward = (a + b + c + d) / 4.0;
            outward.y = 0.0;
            assert!((c - a).cross(&(d - b)).dot(&outward) > 0.0);
        }
    }

    #[test]
    fn extruding_and_capping_change_the_topology_as_they_should() {
        let mut cage = column();
        assert_eq!(euler(&cage), 0);
        let ring = cage.extrude(&[9, 10], "block");
        assert_eq!((ring.faces.len(), euler(&cage)), (6, 0));
        let rim: Vec<u32> = (24..32).collect();
        assert_eq!(cage.cap(&rim, 2, "lid").len(), 4);
        assert_eq!(euler(&cage), 1);
        let lid = cage.quads[cage.quads.len() - 1].map(|v| cage.bases[v as usize]);
        assert!((lid[2] - lid[0]).cross(&(lid[3] - lid[1])).y > 0.0, "the lid looks up");
    }

    #[test]
    fn subdivision_keeps_affine_patches_flat_and_quarters_faces() {
        let flat = patch(3, 4, "sheet", |r, c| Vec3::new(c as f64, r as f64, 2.0 * c as f64 - r as f64));
        let fine = flat.subdivided();
        assert_eq!(fine.quads.len(), 48);
        assert!(fine.bases.iter().all(|p| (p.z - 2.0 * p.x + p.y).abs() < 1e-12));
        assert_eq!(euler(&fine), 1);
    }

    #[test]
    fn a_cube_subdivided_once_has_the_points_of_the_textbook() {
        let mut cube = Cage::default();
        for k in 0..8u32 {
            cube.vertex(Vec3::from_fn(|i, _| if k >> i & 1 == 1 { 1.0 } else { -1.0 }));
        }
        for q in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            cube.face(q, "cube");
        }
        let fine = cube.subdivided();
        assert!((fine.bases[7] - Vec3::repeat(5.0 / 9.0)).norm() < 1e-12);
        assert!(fine.bases[8..20].iter().all(|p| (p.norm() - 0.75 * 2f64.sqrt()).abs() < 1e-12));
    }
}
