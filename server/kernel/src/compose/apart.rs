//! The components of an input are composed apart: a small component that can't be stitched costs the others nothing.
//! *Ours, not the paper's:* its inputs are connected.

use super::stitching::InputSize;
use super::{Composed, Input, Report, Way};
use crate::mesh::tri::TriMesh;
use crate::mesh::{PolyMesh, diagonal};
use crate::numerics::stop;
use crate::topology::{components, submesh};
use std::borrow::Cow;
use std::cmp::Reverse;

/// Some components of an input, with the segments on them.
#[derive(Clone, Debug)]
pub struct Component {
    /// Their surface.
    pub surface: TriMesh,
    /// Segment of each triangle, numbered anew.
    pub owner: Vec<u32>,
    /// The segments, by their numbers in the whole.
    pub segments: Vec<usize>,
}

impl Component {
    /// As an input of its own.
    pub fn input(&self) -> Input<'_> {
        Input { surface: &self.surface, owner: &self.owner, count: self.segments.len() }
    }
}

/// The components of an input, in the order of their lowest triangles; those on which one segment lies together stay
/// together. Triangles of no segment belong to none, nor do segments without a triangle.
pub fn apart(input: Input<'_>) -> Vec<Component> {
    let (component_of, count) = components(input.surface);
    // Which components are one, by the segments that they share.
    let mut root: Vec<usize> = (0..count).collect();
    let mut first: Vec<Option<usize>> = vec![None; input.count];
    let find = |root: &[usize], mut c: usize| {
        while root[c] != c {
            c = root[c];
        }
        c
    };
    for (&c, &s) in component_of.iter().zip(input.owner) {
        stop::pass(1);
        let Some(slot) = first.get_mut(s as usize) else { continue };
        let c = find(&root, c as usize);
        let other = find(&root, *slot.get_or_insert(c));
        root[c.max(other)] = c.min(other);
    }
    let mut triangles: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (t, &c) in component_of.iter().enumerate() {
        if (input.owner[t] as usize) < input.count {
            triangles[find(&root, c as usize)].push(t as u32);
        }
    }
    triangles.retain(|list| !list.is_empty());
    triangles.iter().map(|list| component(input, list)).collect()
}

/// For each component whether it is worth work beyond what it needs: all are where there are at most `few` segments, else those
/// of most area, `most` of them.
pub fn worth(components: &[Component], few: usize, most: usize) -> Vec<bool> {
    if components.iter().map(|c| c.segments.len()).sum::<usize>() <= few {
        return vec![true; components.len()];
    }
    let mut by_area: Vec<(f64, usize)> =
        components.iter().enumerate().map(|(k, c)| (c.surface.total_area(), k)).collect();
    by_area.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut worth = vec![false; components.len()];
    by_area.iter().take(most).for_each(|&(_, k)| worth[k] = true);
    worth
}

/// The components in two groups of about as many triangles, by their numbers: each joins the smaller group, the largest first.
pub fn in_two_groups(components: &[Component]) -> [Vec<usize>; 2] {
    let triangles = |k: &usize| components[*k].surface.triangles.len();
    let mut order: Vec<usize> = (0..components.len()).collect();
    order.sort_by_key(|k| Reverse(triangles(k)));
    let (mut groups, mut sizes) = ([Vec::new(), Vec::new()], [0; 2]);
    for k in order {
        let smaller = usize::from(sizes[1] < sizes[0]);
        sizes[smaller] += triangles(&k);
        groups[smaller].push(k);
    }
    groups
}

/// The triangles that belong to segments.
pub fn owned(input: Input<'_>) -> Cow<'_, TriMesh> {
    let is_owned = |t: &u32| (input.owner[*t as usize] as usize) < input.count;
    let triangles: Vec<u32> = (0..input.owner.len() as u32).filter(is_owned).collect();
    if triangles.len() == input.owner.len() {
        return Cow::Borrowed(input.surface);
    }
    Cow::Owned(submesh(input.surface, &triangles).0)
}

fn component(input: Input<'_>, triangles: &[u32]) -> Component {
    let mut segments: Vec<usize> = triangles.iter().map(|&t| input.owner[t as usize] as usize).collect();
    segments.sort_unstable();
    segments.dedup();
    let number = |&t: &u32| segments.partition_point(|&s| s < input.owner[t as usize] as usize) as u32;
    let owner = triangles.iter().map(number).collect();
    Component { surface: submesh(input.surface, triangles).0, owner, segments }
}

/// One mesh of those of the components, and one report of theirs; `fit` is to be measured.
pub fn together(made: Vec<(Vec<usize>, Composed)>, segments: usize) -> (PolyMesh, Report) {
    let mesh = side_by_side(made.iter().map(|(_, composed)| &composed.mesh));
    let mut all = Report { subdivided: vec![0; segments], ..Report::default() };
    let is_lone = made.len() == 1;
    for (of, Composed { report, .. }) in made {
        let way = match report.way {
            Way::InputSubdivided if !is_lone => Way::PartsReplaced,
            way => way,
        };
        all.way = all.way.max(way);
        all.extraordinary_before += report.extraordinary_before;
        all.merged += report.merged;
        all.filled += report.filled;
        all.closed += report.closed;
        all.resolved.joined += report.resolved.joined;
        all.resolved.cuts += report.resolved.cuts;
        all.resolved.strip_quads += report.resolved.strip_quads;
        all.resolved.doublets += report.resolved.doublets;
        all.refined = all.refined.max(report.refined);
        of.iter().zip(&report.subdivided).for_each(|(&s, &n)| all.subdivided[s] = n);
        all.replaced.extend(report.replaced.iter().map(|&s| of[s]));
        all.too_dense.extend(report.too_dense.iter().map(|&s| of[s]));
        all.missing.extend(report.missing.iter().map(|&s| of[s]));
        all.own.extend(report.own.iter().map(|&s| of[s]));
    }
    all.replaced.sort_unstable();
    all.too_dense.sort_unstable();
    all.missing.sort_unstable();
    all.own.sort_unstable();
    (mesh, all)
}

/// The vertices and faces of several meshes as those of one, in their order.
pub fn side_by_side<'a>(meshes: impl IntoIterator<Item = &'a PolyMesh>) -> PolyMesh {
    let mut all = PolyMesh::default();
    let mut corners = Vec::new();
    for mesh in meshes {
        let first = all.positions.len() as u32;
        all.positions.extend(&mesh.positions);
        for face in mesh.faces.iter() {
            corners.clear();
            corners.extend(face.iter().map(|v| first + v));
            all.faces.push(&corners);
        }
    }
    all
}

/// Tells of each segment whether it has its components of the input to itself, so that it needs no stitching.
pub fn alone(input: Input<'_>) -> Vec<bool> {
    let mut alone = vec![false; input.count];
    for component in apart(input) {
        if let [segment] = component.segments[..] {
            alone[segment] = true;
        }
    }
    alone
}

/// What distances and lengths of edges are measured by: the whole input, also for one of its components.
pub fn scale(surface: &TriMesh) -> InputSize {
    InputSize { area: surface.total_area(), diagonal: diagonal(&surface.positions).max(f64::MIN_POSITIVE) }
}

#[cfg(test)]
mod tests {
    use super::super::check;
    use super::*;
    use crate::compose::{Options, Piece, compose};
    use crate::mesh::Vec3;
    use crate::topology::tests::grid;

    /// Two sheets side by side, the first of two segments, the second of one.
    fn two_sheets() -> (TriMesh, Vec<u32>) {
        let one = grid(8, 8, false, false);
        let n = one.positions.len() as u32;
        let moved = one.positions.iter().map(|p| p + Vec3::new(3.0, 0.0, 0.0));
        let positions: Vec<Vec3> = one.positions.iter().copied().chain(moved).collect();
        let triangles = one.triangles.iter().copied().chain(one.triangles.iter().map(|t| t.map(|v| v + n))).collect();
        let owner = (0..256).map(|t| if t < 128 { 2 * u32::from(t % 16 < 8) } else { 1 }).collect();
        (TriMesh::from_triangles(positions, triangles).expect("two sheets"), owner)
    }

    #[test]
    fn each_component_has_its_triangles_and_its_segments() {
        let (surface, owner) = two_sheets();
        let found = apart(Input { surface: &surface, owner: &owner, count: 4 });
        let of: Vec<(usize, &[usize])> = found.iter().map(|c| (c.owner.len(), &c.segments[..])).collect();
        assert_eq!(of, [(128, &[0, 2][..]), (128, &[1][..])]);
        assert_eq!(found[0].owner, owner[..128].iter().map(|s| s / 2).collect::<Vec<u32>>());
        // A segment on both keeps them together.
        let owner: Vec<u32> = owner.iter().map(|s| s / 2).collect();
        assert_eq!(apart(Input { surface: &surface, owner: &owner, count: 2 }).len(), 1);
    }

    #[test]
    fn a_segment_that_shares_its_component_is_not_alone() {
        let (surface, owner) = two_sheets();
        assert_eq!(alone(Input { surface: &surface, owner: &owner, count: 4 }), [false, true, false, false]);
    }

    #[test]
    fn of_a_ragged_input_the_largest_components_are_worth_it() {
        let (surface, owner) = two_sheets();
        let found = apart(Input { surface: &surface, owner: &owner, count: 4 });
        assert_eq!(worth(&found, 3, 1), [true, true]);
        assert_eq!(worth(&found, 2, 1), [true, false]);
    }

    #[test]
    fn a_component_that_fails_costs_the_others_nothing() {
        let (surface, owner) = two_sheets();
        let input = Input { surface: &surface, owner: &owner, count: 3 };
        let whole = compose(input, &[Piece::Nothing; 3], Options::default(), &|| false).expect("regular layouts");
        assert_eq!((whole.report.way, whole.report.own.len()), (Way::Direct, 0));
        // What is laid on segment 1 has no boundary: it can't be joined, and gives way there.
        let closed = PolyMesh {
            positions: vec![Vec3::zeros(); 4],
            faces: [[0u32, 1, 2, 3], [3, 2, 1, 0]].iter().map(|c| &c[..]).collect(),
            ..PolyMesh::default()
        };
        let pieces = [Piece::Nothing, Piece::Mapped(&closed), Piece::Nothing];
        let made = compose(input, &pieces, Options::default(), &|| false).expect("regular layouts");
        assert_eq!((made.report.way, &made.report.replaced[..]), (Way::PartsReplaced, &[1][..]));
        let first = |mesh: &PolyMesh| mesh.positions.iter().filter(|p| p.x < 2.0).copied().collect::<Vec<Vec3>>();
        assert_eq!(first(&made.mesh), first(&whole.mesh));
        assert_eq!(check::check(&made.mesh, check::TopologyCounts::of(&surface)), Ok(()));
    }
}
