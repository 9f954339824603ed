//! An input cut as an example is: the transfer of a segmentation.
//!
//! The example is laid on the input whole, and each point of the input takes the part of the example's triangle that lies
//! nearest to it. *Source:* paper §6 asks for segmentations that are compatible, and has users make them by hand. *Ours,
//! not the paper's:* the map of the whole carries the parts, so that they are matched by where they lie, and border on each
//! other as the example's do.

use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh};
use crate::segment::{Segmented, segment_by};
use crate::topology::{Patch, Topology, TopologyError};

/// Why an input was not cut alike.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnlikeError {
    /// A part of the input would be no primitive.
    #[error(transparent)]
    Topology(#[from] TopologyError),
    /// A part of the example has no place on the input.
    #[error("expected {expected} parts on the input as on the example, found {found}")]
    Count {
        /// Parts of the example.
        expected: usize,
        /// Parts of the input.
        found: usize,
    },
    /// A part is another primitive on the input than on the example.
    #[error("expected part {part} of the input to be of topology {expected} as on the example, found {found}")]
    Primitive {
        /// The part.
        part: usize,
        /// What it is on the example.
        expected: Topology,
        /// What it is on the input.
        found: Topology,
    },
    /// A part borders on others than on the example.
    #[error("expected part {part} of the input to border on the same parts as on the example, found other neighbours")]
    Neighbours {
        /// The part.
        part: usize,
    },
}

/// The input cut as `example` is. `whole` is the example's surface uncut, its triangles numbered as the example's, and
/// `positions` tells where the vertices of `whole` go on the input. Part k of the result is part k of the example.
///
/// # Errors
/// [`UnlikeError`] where the parts would not be the same primitives, or not border on each other alike.
pub fn alike(
    example: &Segmented,
    whole: &Patch,
    positions: &[Vec3],
    input: &TriMesh,
) -> Result<Segmented, UnlikeError> {
    let mapped =
        TriMesh { positions: positions.to_vec(), triangles: whole.mesh.triangles.clone(), ..TriMesh::default() };
    let bvh = Bvh::new(&mapped);
    let label_at = |x: Vec3| {
        let nearest = bvh.closest(x).triangle;
        let there = if nearest == NONE { None } else { whole.triangle_of.get(nearest as usize) };
        there.and_then(|&t| example.part_of.get(t as usize)).copied().unwrap_or(0)
    };
    segment_by(input, &label_at, &|cut| is_alike(example, cut))
}

/// Whether part k of one is the same primitive as part k of the other, and borders on the same parts.
fn is_alike(example: &Segmented, cut: &Segmented) -> Result<(), UnlikeError> {
    let (expected, found) = (example.parts.len(), cut.parts.len());
    if found != expected {
        return Err(UnlikeError::Count { expected, found });
    }
    for (part, (one, two)) in example.parts.iter().zip(&cut.parts).enumerate() {
        let (expected, found) = (one.topology, two.topology);
        if found != expected {
            return Err(UnlikeError::Primitive { part, expected, found });
        }
        if example.neighbours(part as u32) != cut.neighbours(part as u32) {
            return Err(UnlikeError::Neighbours { part });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology;
    use crate::topology::tests::grid;

    /// An open cylinder of rings and columns, bent by `bend`, and its triangles cut into three bands by height.
    fn cylinder(columns: u32, rings: u32, bend: impl Fn(Vec3) -> Vec3) -> TriMesh {
        let mut mesh = grid(columns, rings, true, false);
        mesh.positions.iter_mut().for_each(|x| *x = bend(*x));
        mesh
    }

    fn banded(mesh: &TriMesh, height: impl Fn(Vec3) -> f64) -> Segmented {
        let middle = |t: &[u32; 3]| t.iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / 3.0;
        let (low, high) =
            mesh.positions.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(height(*x)), h.max(height(*x))));
        let band = |t: &[u32; 3]| i64::from((3.0 * (height(middle(t)) - low) / (high - low)) as u32);
        let mut labels = vec![0; mesh.polygon_of.iter().max().map_or(0, |p| *p as usize + 1)];
        mesh.triangles.iter().zip(&mesh.polygon_of).for_each(|(t, &p)| labels[p as usize] = band(t));
        Segmented::by_labels(mesh, &labels).expect("bands")
    }

    #[test]
    fn the_bands_of_a_tube_lie_on_another_tube_where_the_map_takes_them() {
        let example = cylinder(18, 12, |x| x);
        let cut = banded(&example, |x| x.z);
        assert_eq!(cut.parts.len(), 3);
        let whole = topology::whole(&example).expect("an annulus");
        // Twice as tall, and finer; the map stretches.
        let stretch = |x: Vec3| Vec3::new(x.x, x.y, 2.0 * x.z);
        let input = cylinder(37, 31, stretch);
        let positions: Vec<Vec3> = example.positions.iter().map(|x| stretch(*x)).collect();
        let alike = alike(&cut, &whole, &positions, &input).expect("cut alike");
        let share = |s: &Segmented, k: usize| s.parts[k].mesh.total_area() / s.mesh.total_area();
        for k in 0..3 {
            assert_eq!(alike.parts[k].topology, cut.parts[k].topology);
            assert!((share(&alike, k) - share(&cut, k)).abs() < 0.03, "{k}: {} {}", share(&alike, k), share(&cut, k));
        }
        assert_eq!(alike.neighbours(1), [0, 2]);
    }

    #[test]
    fn a_map_that_leaves_out_a_part_is_refused() {
        let example = cylinder(18, 12, |x| x);
        let cut = banded(&example, |x| x.z);
        let whole = topology::whole(&example).expect("an annulus");
        let (low, high) = example.positions.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x.z), h.max(x.z)));
        // Everything goes beyond one end of the input: only one band is nearest to anything.
        let away = |x: &Vec3| Vec3::new(x.x, x.y, x.z + 5.0 * (high - low));
        let positions: Vec<Vec3> = example.positions.iter().map(away).collect();
        let refused = alike(&cut, &whole, &positions, &example).expect_err("one part");
        assert_eq!(refused, UnlikeError::Count { expected: 3, found: 1 });
    }
}
