//! Where a mesh is seen from: the view's upright frame, its turn and tilt, and a projection that fills the picture.

use super::colour::Palette;
use super::surface::{EdgeKind, Origin, Surface};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use quadmuse_kernel::mesh::{PolyMesh, Vec3};

/// Distance of the eye in radii of the mesh: a long lens, some 20° wide.
const EYE_DISTANCE: f64 = 5.5;
/// Part of the picture's side that the mesh fills.
const FILL: f64 = 0.90;
/// Turn of the three-quarter view, in radians (30°).
const YAW: f64 = 0.52;
/// Tilt of the three-quarter view, in radians (10°).
const PITCH: f64 = 0.17;
/// A guessed upright direction this close to a file axis (cosine of 35°) is that axis.
const SNAP_COSINE: f64 = 0.82;
/// A boundary this much longer than wide (ratio of variances) is a tube's two openings.
const TUBE: f64 = 2.5;

/// Whether polygon edges are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wires {
    /// The polygons' own edges, never the tessellation's.
    #[default]
    Polygons,
    /// Shading only.
    Hidden,
}

/// Whether extraordinary vertices are marked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Poles {
    /// Blue below valence 4, orange for 5, purple above; only on meshes of mostly quads.
    #[default]
    Marked,
    /// No mark.
    Unmarked,
}

/// What faces are painted with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paint {
    /// The palette's clay.
    #[default]
    Clay,
    /// A colour for each segment number, and clay where faces have none.
    Segments,
    /// Clay for one segment, and a cold grey for the rest.
    Segment(i64),
}

/// How a mesh is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Direction that points up in the picture, in the mesh's axes.
    pub up: Vec3,
    /// Direction that the mesh's face looks in, in the mesh's axes.
    pub front: Vec3,
    /// Turn of the camera around `up`, in radians; positive shows more of the mesh's left side (its +x when `up` is
    /// +y and `front` is +z).
    pub yaw: f64,
    /// Tilt of the camera, in radians; positive looks down.
    pub pitch: f64,
    /// Colours.
    pub palette: Palette,
    /// Polygon edges.
    pub wires: Wires,
    /// Marks of extraordinary vertices.
    pub poles: Poles,
    /// Paint of the faces.
    pub paint: Paint,
}

impl Default for View {
    /// Three-quarter view of a mesh that stands along +y and looks along +z.
    fn default() -> Self {
        Self {
            up: Vec3::y(),
            front: Vec3::z(),
            yaw: YAW,
            pitch: PITCH,
            palette: Palette::light(),
            wires: Wires::Polygons,
            poles: Poles::Marked,
            paint: Paint::Clay,
        }
    }
}

impl View {
    /// The default view in other colours.
    pub fn with_palette(self, palette: Palette) -> Self {
        Self { palette, ..self }
    }

    /// The view turned to `yaw` and tilted to `pitch`, in radians.
    pub fn turned(self, yaw: f64, pitch: f64) -> Self {
        Self { yaw, pitch, ..self }
    }

    /// A view guessed from the mesh, for uploads in any pose.
    ///
    /// An open surface stands on its boundary (a head on its neck), a tube along its length with the wider opening
    /// up unless the file's +y says otherwise; a closed one keeps the file's +y. A direction near a file axis is taken
    /// to be that axis, and never −y (a foot is open above). The front of a mesh of quads that stands along a file axis
    /// is what modelling programs make it, +z (or −y where +z is up); of any other, the side where the surface is most
    /// detailed: the sum of its normals weighted by how much they turn.
    pub fn guess(mesh: &PolyMesh) -> Self {
        let surface = Surface::of(mesh);
        let up = snapped(upright(&surface).unwrap_or_else(Vec3::y));
        let up = if up == -Vec3::y() { Vec3::y() } else { up };
        let usual = if up == Vec3::y() {
            Some(Vec3::z())
        } else if up == Vec3::z() {
            Some(-Vec3::y())
        } else {
            None
        };
        let front = usual.filter(|_| surface.origin == Origin::Modelled).unwrap_or_else(|| {
            let detail = detail_direction(&surface);
            let level = detail - up * up.dot(&detail);
            level.try_normalize(1e-3 * detail.norm().max(1e-12)).map_or_else(|| across(&up), snapped)
        });
        Self { up, front, ..Self::default() }
    }
}

/// From the boundary's centre to the surface's; along a tube whose two openings balance; `None` for closed surfaces.
fn upright(surface: &Surface) -> Option<Vec3> {
    let mut rim = Mean::default();
    for edge in surface.edges.iter().filter(|e| e.kind == EdgeKind::Rim) {
        let [a, b] = edge.vertices.map(|v| surface.points[v as usize]);
        rim.add((a + b) * 0.5, (b - a).norm());
    }
    let mut body = Mean::default();
    for t in &surface.triangles {
        let [a, b, c] = t.map(|v| surface.points[v as usize]);
        body.add((a + b + c) / 3.0, (b - a).cross(&(c - a)).norm());
    }
    let (rim_centre, body_centre) = (rim.centre()?, body.centre()?);
    // The rim's long axis: of two openings far apart, the line between them.
    let mut spread = Matrix3::zeros();
    for edge in surface.edges.iter().filter(|e| e.kind == EdgeKind::Rim) {
        let [a, b] = edge.vertices.map(|v| surface.points[v as usize]);
        let d = (a + b) * 0.5 - rim_centre;
        spread += d * d.transpose() * (b - a).norm();
    }
    let eigen = SymmetricEigen::new(spread / rim.weight);
    let longest = eigen.eigenvalues.imax();
    let others: f64 = (0..3).filter(|&k| k != longest).map(|k| eigen.eigenvalues[k]).sum();
    if eigen.eigenvalues[longest] > TUBE * others {
        let axis: Vec3 = eigen.eigenvectors.column(longest).into();
        let wider: f64 = surface
            .edges
            .iter()
            .filter(|e| e.kind == EdgeKind::Rim)
            .map(|e| {
                let [a, b] = e.vertices.map(|v| surface.points[v as usize]);
                ((a + b) * 0.5 - body_centre).dot(&axis).signum() * (b - a).norm()
            })
            .sum();
        let sense = if axis.y.abs() > 0.5 { axis.y } else { wider };
        return Some(if sense < 0.0 { -axis } else { axis });
    }
    Some(body_centre - rim_centre).filter(|d| d.norm() > 0.05)?.try_normalize(1e-9)
}

/// A weighted mean of points.
#[derive(Default)]
struct Mean {
    sum: Vec3,
    weight: f64,
}

impl Mean {
    fn add(&mut self, point: Vec3, weight: f64) {
        self.sum += point * weight;
        self.weight += weight;
    }

    fn centre(&self) -> Option<Vec3> {
        (self.weight > 1e-12).then(|| self.sum / self.weight)
    }
}

fn detail_direction(surface: &Surface) -> Vec3 {
    let mut sum = Vec3::zeros();
    for (t, normals) in surface.triangles.iter().zip(&surface.normals) {
        let [a, b, c] = t.map(|v| surface.points[v as usize]);
        let doubled = (b - a).cross(&(c - a));
        let turn: f32 = (0..3).map(|k| 1.0 - normals[k].dot(&normals[(k + 1) % 3])).sum();
        let size = doubled.norm().sqrt().max(1e-9);
        sum += doubled * f64::from(turn.max(0.0).sqrt()) / size;
    }
    sum
}

fn snapped(direction: Vec3) -> Vec3 {
    let axis = direction.iamax();
    let mut snapped = Vec3::zeros();
    snapped[axis] = direction[axis].signum();
    if direction[axis].abs() > SNAP_COSINE * direction.norm() { snapped } else { direction }
}

/// A unit vector at right angles to `up`: +z made level, or +x where `up` is the z axis.
fn across(up: &Vec3) -> Vec3 {
    let level = |d: Vec3| (d - up * up.dot(&d)).try_normalize(0.3);
    level(Vec3::z()).or_else(|| level(Vec3::x())).unwrap_or_else(Vec3::z)
}

/// A surface in sample coordinates: x to the right, y down, and the inverse depth (larger is nearer).
pub(super) struct Projected {
    pub(super) points: Vec<Vector3<f32>>,
    /// From mesh axes to camera axes (x right, y up, z towards the eye).
    pub(super) rotation: Matrix3<f32>,
    /// Samples a unit of the unit ball, at its centre.
    pub(super) scale: f32,
}

pub(super) fn project(surface: &Surface, view: &View, side: usize) -> Projected {
    let rotation = camera_axes(view);
    let plane = |p: &Vec3| {
        let q = rotation * p;
        let depth = EYE_DISTANCE - q.z;
        Vec3::new(q.x * EYE_DISTANCE / depth, q.y * EYE_DISTANCE / depth, 1.0 / depth)
    };
    let flat: Vec<Vec3> = surface.points.iter().map(plane).collect();
    let mut bounds: Option<(Vec3, Vec3)> = None;
    for p in surface.triangles.iter().flatten().map(|&v| flat[v as usize]) {
        bounds = Some(bounds.map_or((p, p), |(low, high)| (low.inf(&p), high.sup(&p))));
    }
    let (low, high) = bounds.unwrap_or((-Vec3::repeat(1.0), Vec3::repeat(1.0)));
    let extent = (high.x - low.x).max(high.y - low.y).max(1e-6);
    let (scale, middle) = (FILL * side as f64 / extent, 0.5 * side as f64);
    let centre = (low + high) * 0.5;
    let place = |p: &Vec3| {
        Vector3::new((middle + (p.x - centre.x) * scale) as f32, (middle - (p.y - centre.y) * scale) as f32, p.z as f32)
    };
    Projected { points: flat.iter().map(place).collect(), rotation: rotation.cast(), scale: scale as f32 }
}

fn camera_axes(view: &View) -> Matrix3<f64> {
    let finite = |d: Vec3, fallback: Vec3| {
        if d.iter().all(|x| x.is_finite()) { d.try_normalize(1e-12).unwrap_or(fallback) } else { fallback }
    };
    let up = finite(view.up, Vec3::y());
    let front = (view.front - up * up.dot(&view.front)).try_normalize(1e-9).filter(|d| d.iter().all(|x| x.is_finite()));
    let front = front.unwrap_or_else(|| across(&up));
    let left = up.cross(&front);
    let angle = |a: f64| if a.is_finite() { a } else { 0.0 };
    let (turn, tilt) = (angle(view.yaw), angle(view.pitch));
    let level = front * turn.cos() + left * turn.sin();
    let eye = level * tilt.cos() + up * tilt.sin();
    let right = up.cross(&level);
    Matrix3::from_rows(&[right.transpose(), eye.cross(&right).transpose(), eye.transpose()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_axes_are_a_rotation_even_for_a_useless_view() {
        let bad = View { up: Vec3::zeros(), front: Vec3::repeat(f64::NAN), yaw: f64::INFINITY, ..View::default() };
        for view in [View::default(), bad, View { up: Vec3::z(), ..View::default() }] {
            let r = camera_axes(&view);
            assert!((r * r.transpose() - Matrix3::identity()).norm() < 1e-12);
            assert!((r.determinant() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_plain_front_view_keeps_x_right_and_y_up() {
        let r = camera_axes(&View::default().turned(0.0, 0.0));
        assert!((r - Matrix3::identity()).norm() < 1e-12);
    }
}
