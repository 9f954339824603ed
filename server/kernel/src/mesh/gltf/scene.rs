//! The meshes of a scene, each where its node puts it.

use super::accessor::{Numbers, Values};
use super::{NGON_EXTENSION, container, malformed};
use crate::mesh::error::{FileLocation, MeshError};
use crate::mesh::text::within;
use crate::mesh::weld::weld;
use crate::mesh::{Attributes, CornerLayer, FaceLabels, Limits, NONE, PolyMesh, Polygons, Vec3};
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::scene::Node;
use ::gltf::json::validation::Checked;
use nalgebra::{Matrix4, Point3, Quaternion, Translation3, UnitQuaternion};

/// Uses of primitives by nodes.
const PRIMITIVES_MAX: usize = 1_000_000;

/// Reads the triangles (and encoded polygons) of the default scene. Equal points are joined.
///
/// # Errors
/// What is wrong with the file, a reference to another file, a required extension, or the limit that is exceeded.
pub(in crate::mesh) fn read(bytes: &[u8], limits: &Limits) -> Result<PolyMesh, MeshError> {
    let document = container::open(bytes, limits)?;
    let numbers = Numbers::new(document, bytes.len(), limits);
    let mut soup = Soup::new(limits);
    for (mesh, transform, name) in instances(&numbers) {
        let Some(found) = numbers.document.root.meshes.get(mesh) else {
            let found = format!("mesh {mesh} of {}", numbers.document.root.meshes.len());
            return Err(malformed(FileLocation::File, "references to what is in the file", found));
        };
        let name = name.or(found.name.clone()).unwrap_or_else(|| format!("mesh {mesh}"));
        for primitive in &found.primitives {
            soup.primitive(&numbers, primitive, &transform, &name)?;
        }
    }
    Ok(soup.finish())
}

/// Meshes with their transforms and their nodes' names, each node once.
fn instances(numbers: &Numbers<'_>) -> Vec<(usize, Matrix4<f64>, Option<String>)> {
    let root = &numbers.document.root;
    let nodes = &root.nodes;
    if nodes.is_empty() {
        return (0..root.meshes.len()).map(|mesh| (mesh, Matrix4::identity(), None)).collect();
    }
    let scene = root.scene.map_or(0, |scene| scene.value());
    let starts: Vec<usize> = match root.scenes.get(scene) {
        Some(scene) => scene.nodes.iter().map(|node| node.value()).collect(),
        None => {
            let mut is_child = vec![false; nodes.len()];
            for child in nodes.iter().flat_map(|node| node.children.iter().flatten()) {
                if let Some(is_child) = is_child.get_mut(child.value()) {
                    *is_child = true;
                }
            }
            (0..nodes.len()).filter(|node| !is_child[*node]).collect()
        }
    };
    let mut seen = vec![false; nodes.len()];
    let mut stack: Vec<(usize, Matrix4<f64>)> =
        starts.into_iter().rev().map(|node| (node, Matrix4::identity())).collect();
    let mut found = Vec::new();
    while let Some((index, parent)) = stack.pop() {
        // A node that is met again, as in a cycle, is passed over.
        let Some(node) = nodes.get(index).filter(|_| !std::mem::replace(&mut seen[index], true)) else { continue };
        let transform = parent * local(node);
        if let Some(mesh) = node.mesh {
            found.push((mesh.value(), transform, node.name.clone()));
        }
        stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), transform)));
    }
    found
}

/// The transform of a node in its parent's space.
fn local(node: &Node) -> Matrix4<f64> {
    if let Some(matrix) = node.matrix {
        return Matrix4::from_column_slice(&matrix.map(f64::from));
    }
    let [x, y, z] = node.translation.unwrap_or_default().map(f64::from);
    let [i, j, k, w] = node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |rotation| rotation.0).map(f64::from);
    let scale = Vec3::from(node.scale.unwrap_or([1.0; 3]).map(f64::from));
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    Translation3::new(x, y, z).to_homogeneous() * rotation.to_homogeneous() * Matrix4::new_nonuniform_scaling(&scale)
}

/// Faces whose points are not joined yet.
struct Soup<'l> {
    limits: &'l Limits,
    points: Vec<Vec3>,
    uvs: Vec<[f64; 2]>,
    uv_of: Vec<u32>,
    faces: Polygons,
    groups: FaceLabels,
    materials: FaceLabels,
    primitives: usize,
}

impl<'l> Soup<'l> {
    fn new(limits: &'l Limits) -> Self {
        let labels = || FaceLabels { names: Vec::new(), of_face: Vec::new() };
        Self {
            limits,
            points: Vec::new(),
            uvs: Vec::new(),
            uv_of: Vec::new(),
            faces: Polygons::default(),
            groups: labels(),
            materials: labels(),
            primitives: 0,
        }
    }

    fn primitive(
        &mut self,
        numbers: &Numbers<'_>,
        primitive: &Primitive,
        transform: &Matrix4<f64>,
        name: &str,
    ) -> Result<(), MeshError> {
        self.primitives += 1;
        within("primitives", self.primitives, PRIMITIVES_MAX)?;
        let Checked::Valid(mode) = primitive.mode else { return Ok(()) };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let Some(position) = attribute(Semantic::Positions) else { return Ok(()) };
        let count = usize::try_from(numbers.accessor(position)?.count.0).unwrap_or(usize::MAX);
        within("vertices", self.points.len().saturating_add(count), self.limits.vertices_max)?;
        let positions = triples(position.value(), numbers.values(position)?)?;
        let base = self.points.len() as u32;
        self.points.extend(positions.iter().map(|p| transform.transform_point(&Point3::from(*p)).coords));
        self.read_uvs(numbers, attribute(Semantic::TexCoords(0)), positions.len())?;
        let indices = match primitive.indices {
            Some(accessor) => {
                let count = usize::try_from(numbers.accessor(accessor)?.count.0).unwrap_or(usize::MAX);
                within("corners", self.faces.corners().len().saturating_add(count), self.limits.corners_max)?;
                vertex_indices(accessor.value(), &numbers.values(accessor)?, positions.len())?
            }
            None => (0..positions.len() as u32).collect(),
        };
        let mut faces = faces(mode, &indices);
        if mode == Mode::Triangles && numbers.document.root.extensions_used.iter().any(|name| name == NGON_EXTENSION) {
            faces = polygons(&faces, self.limits.degree_max);
        }
        within("faces", self.faces.len() + faces.len(), self.limits.faces_max)?;
        let mirrored = transform.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        let mut row = Vec::new();
        for face in faces.iter() {
            row.clear();
            row.extend(face.iter().map(|v| base + v));
            if mirrored {
                row.reverse();
            }
            self.faces.push(&row);
        }
        within("corners", self.faces.corners().len(), self.limits.corners_max)?;
        label(&mut self.groups, name.to_string(), faces.len());
        match primitive.material {
            Some(material) => {
                let found = numbers.document.root.materials.get(material.value()).and_then(|m| m.name.clone());
                label(
                    &mut self.materials,
                    found.unwrap_or_else(|| format!("material {}", material.value())),
                    faces.len(),
                );
            }
            None => self.materials.of_face.resize(self.faces.len(), NONE),
        }
        Ok(())
    }

    fn read_uvs(
        &mut self,
        numbers: &Numbers<'_>,
        accessor: Option<::gltf::json::Index<::gltf::json::Accessor>>,
        count: usize,
    ) -> Result<(), MeshError> {
        if let Some(index) = accessor
            && numbers.accessor(index)?.count.0 == count as u64
        {
            let values = numbers.values(index)?;
            if values.width == 2 {
                let first = self.uvs.len() as u32;
                self.uv_of.extend(first..first + count as u32);
                // glTF's v points down, everybody else's up.
                self.uvs.extend(values.numbers.chunks_exact(2).map(|uv| [uv[0], 1.0 - uv[1]]));
            }
        }
        self.uv_of.resize(self.points.len(), NONE);
        Ok(())
    }

    fn finish(self) -> PolyMesh {
        let (vertex_of, first) = weld(&self.points, &self.faces);
        let uvs = (!self.uvs.is_empty()).then(|| CornerLayer {
            corners: self.faces.corners().iter().map(|point| self.uv_of[*point as usize]).collect(),
            values: self.uvs,
        });
        let mut row = Vec::new();
        let faces = self.faces.iter().fold(Polygons::default(), |mut faces, face| {
            row.clear();
            row.extend(face.iter().map(|point| vertex_of[*point as usize]));
            faces.push(&row);
            faces
        });
        let named = |labels: FaceLabels| (!labels.names.is_empty()).then_some(labels);
        PolyMesh {
            positions: first.iter().map(|point| self.points[*point as usize]).collect(),
            faces,
            attributes: Attributes {
                uvs,
                groups: named(self.groups),
                materials: named(self.materials),
                ..Attributes::default()
            },
        }
    }
}

/// Gives the next `count` faces a name.
fn label(labels: &mut FaceLabels, name: String, count: usize) {
    if count == 0 {
        return;
    }
    let index = match labels.names.last() {
        Some(last) if *last == name => labels.names.len() - 1,
        _ => {
            labels.names.push(name);
            labels.names.len() - 1
        }
    };
    labels.of_face.resize(labels.of_face.len() + count, index as u32);
}

fn triples(accessor: usize, values: Values) -> Result<Vec<Vec3>, MeshError> {
    if values.width != 3 {
        let place = FileLocation::Element("accessor", accessor as u64);
        return Err(malformed(place, "positions of 3 components", format!("{} components", values.width)));
    }
    Ok(values.numbers.chunks_exact(3).map(|p| Vec3::new(p[0], p[1], p[2])).collect())
}

fn vertex_indices(accessor: usize, values: &Values, available: usize) -> Result<Vec<u32>, MeshError> {
    let place = FileLocation::Element("accessor", accessor as u64);
    if values.width != 1 {
        return Err(malformed(place, "scalar indices", format!("{} components", values.width)));
    }
    if let Some(index) = values.numbers.iter().find(|index| !(0.0..available as f64).contains(*index)) {
        return Err(malformed(place, "indices of vertices that exist", format!("{index} of {available}")));
    }
    Ok(values.numbers.iter().map(|index| *index as u32).collect())
}

/// The triangles of a list, strip or fan; those by which strips turn corners are left out.
fn faces(mode: Mode, indices: &[u32]) -> Polygons {
    let distinct = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    let mut faces = Polygons::default();
    match mode {
        Mode::TriangleStrip => {
            let oriented =
                |k: usize, w: &[u32]| if k.is_multiple_of(2) { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            let strip = indices.windows(3).enumerate().map(|(k, w)| oriented(k, w));
            strip.filter(distinct).for_each(|t| faces.push(&t));
        }
        Mode::TriangleFan => {
            let fan = indices.get(1..).unwrap_or_default().windows(2).map(|w| [indices[0], w[0], w[1]]);
            fan.filter(distinct).for_each(|t| faces.push(&t));
        }
        _ => indices.chunks_exact(3).for_each(|t| faces.push(t)),
    }
    faces
}

/// Polygons out of runs of triangles that fan out from the same first vertex.
fn polygons(triangles: &Polygons, degree_max: usize) -> Polygons {
    let mut polygons = Polygons::default();
    let mut polygon: Vec<u32> = Vec::new();
    for t in triangles.iter() {
        let goes_on = polygon.first() == t.first() && polygon.last() == t.get(1) && polygon.len() < degree_max;
        if goes_on {
            polygon.extend(t.get(2));
            continue;
        }
        if !polygon.is_empty() {
            polygons.push(&polygon);
        }
        polygon.clear();
        polygon.extend_from_slice(t);
    }
    if !polygon.is_empty() {
        polygons.push(&polygon);
    }
    polygons
}
