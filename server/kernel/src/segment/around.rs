//! Cutting a surface along the rim of what was laid on a part of it.
//!
//! The part within comes first. The rest falls into protrusions and other primitives, and small gaps in these count as filled.
//! *Ours, not the paper's.*

use super::parts::{Count, parts};
use super::{Order, Segmented, cut_at_zero, merge};
use crate::mesh::tri::TriMesh;
use crate::topology::holes::filled;
use crate::topology::{self, Patch, Topology, TopologyError, borders_on_another, primitive};

/// A piece with a smaller share of the area goes to its neighbour.
const SMALL_COMPONENT_SHARE: f64 = 0.002;
/// The label that [`cut_at_zero`] gives to what lies within.
const WITHIN: u32 = 0;
/// The label of what lies beyond, while it is not cut up yet.
const BEYOND: u32 = 1;
/// The label of the first part that stays as it is, until it is known how many there are before it.
const KEPT: u32 = 1 << 24;

/// Cuts a surface along the curve on which `field`, one value a vertex, is 0. The largest piece where it is positive comes
/// first; then those where it is not, each cut into its protrusions and primitives; then what is `kept`: a number for each triangle
/// of a part that stays as it is.
///
/// # Errors
/// [`TopologyError::Empty`].
pub fn segment_around(surface: &TriMesh, field: &[f64], kept: &[Option<u32>]) -> Result<Segmented, TopologyError> {
    let (refined, mut label_of) = cut_at_zero(surface, field)?;
    let mesh = &refined.mesh;
    let kept_of = |t: usize| kept.get(refined.source_of[t] as usize).copied().flatten();
    for (t, label) in label_of.iter_mut().enumerate() {
        *label = kept_of(t).map_or(*label, |part| KEPT + part);
    }
    relabel(mesh, &mut label_of, WITHIN, f64::INFINITY);
    relabel(mesh, &mut label_of, BEYOND, SMALL_COMPONENT_SHARE * mesh.total_area());
    let mut first = BEYOND;
    for piece in pieces(mesh, &label_of, BEYOND) {
        let labels = cut_up(mesh, &piece);
        piece.iter().zip(&labels).for_each(|(&t, label)| label_of[t as usize] = first + label);
        first += 1 + labels.iter().max().copied().unwrap_or(0);
    }
    // What filled gaps alone held to its part.
    merge::absorb_small_components(mesh, &mut label_of);
    label_of.iter_mut().filter(|label| **label >= KEPT).for_each(|label| *label = *label - KEPT + first);
    let mut made = Segmented::assemble(surface, refined, &label_of, Order::Labels);
    for (number, part) in made.parts.iter_mut().enumerate() {
        let found = meant(&made.mesh, part);
        // What was laid spans whatever gap it lies on.
        let spanned = || (number == 0).then(|| spanned(&made.mesh, part)).flatten();
        if let Some((topology, holes)) = spanned().or(found.ok()) {
            *part = Patch { topology, holes, ..part.clone() };
        }
    }
    Ok(made)
}

/// Cuts a surface along the curve on which `field`, one value a vertex, is 0. The largest piece where it is positive comes first; then
/// those where it is not, the largest first.
///
/// # Errors
/// [`TopologyError::Empty`].
pub fn segment_beyond(surface: &TriMesh, field: &[f64]) -> Result<Segmented, TopologyError> {
    let (refined, mut label_of) = cut_at_zero(surface, field)?;
    let mesh = &refined.mesh;
    relabel(mesh, &mut label_of, WITHIN, f64::INFINITY);
    relabel(mesh, &mut label_of, BEYOND, SMALL_COMPONENT_SHARE * mesh.total_area());
    for (piece, label) in largest_first(mesh, pieces(mesh, &label_of, BEYOND)).iter().zip(BEYOND..) {
        piece.iter().for_each(|&t| label_of[t as usize] = label);
    }
    Ok(Segmented::assemble(surface, refined, &label_of, Order::Labels))
}

/// What a part is with all loops filled that are no border with another; `None` where none is one.
fn spanned(mesh: &TriMesh, part: &Patch) -> Option<(Topology, Vec<Vec<u32>>)> {
    let is_border = |edges: &Vec<u32>| edges.iter().any(|&h| part.borders_on_another(mesh, h));
    let (ends, gaps): (Vec<_>, Vec<_>) = part.mesh.boundary_loops().into_iter().partition(is_border);
    let topology = primitive::with_ends(&part.mesh, ends.len()).ok()?;
    (!ends.is_empty()).then_some((topology, gaps))
}

/// Gives the pieces of a label that have less than `least` of the area, its largest excepted, the other label.
fn relabel(mesh: &TriMesh, label_of: &mut [u32], label: u32, least: f64) {
    let all = largest_first(mesh, pieces(mesh, label_of, label));
    for piece in all.iter().skip(1).filter(|piece| area(mesh, piece) < least) {
        piece.iter().for_each(|&t| label_of[t as usize] = WITHIN + BEYOND - label);
    }
}

fn area(mesh: &TriMesh, piece: &[u32]) -> f64 {
    piece.iter().map(|&t| mesh.area(t as usize)).sum()
}

/// Pieces, as triangles, by area.
fn largest_first(mesh: &TriMesh, mut pieces: Vec<Vec<u32>>) -> Vec<Vec<u32>> {
    pieces.sort_by(|a, b| area(mesh, b).total_cmp(&area(mesh, a)).then(a.cmp(b)));
    pieces
}

/// The connected pieces of a label, as triangles.
fn pieces(mesh: &TriMesh, label_of: &[u32], label: u32) -> Vec<Vec<u32>> {
    topology::connected(mesh, label_of).into_iter().filter(|piece| label_of[piece[0] as usize] == label).collect()
}

/// A label for each triangle of a piece: a part for each protrusion, and primitives of the rest, gaps filled.
fn cut_up(mesh: &TriMesh, piece: &[u32]) -> Vec<u32> {
    let (own, _) = topology::submesh(mesh, piece);
    let (gaps, _) = gaps(mesh, &own, piece);
    let mut labels = parts(&filled(&own, &gaps), Count::Natural);
    labels.truncate(piece.len());
    labels
}

/// The loops of a part that are gaps of the surface, and how many are ends: a border with another part is one, however short.
fn gaps(mesh: &TriMesh, part: &TriMesh, triangle_of: &[u32]) -> (Vec<Vec<u32>>, usize) {
    primitive::gaps(part, &|edges| edges.iter().any(|&h| borders_on_another(mesh, triangle_of, h)))
}

/// What a part is with its gaps filled.
fn meant(mesh: &TriMesh, part: &Patch) -> Result<(Topology, Vec<Vec<u32>>), TopologyError> {
    let (gaps, ends) = gaps(mesh, &part.mesh, &part.triangle_of);
    Ok((primitive::with_ends(&part.mesh, ends)?, gaps))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// A sheet of 24 × 24 squares without some triangles, cut about a point of the unit square.
    fn cut_about(at: [f64; 2], radius: f64, without: &[u32]) -> Segmented {
        let sheet = grid(24, 24, false, false);
        let kept: Vec<u32> = (0..sheet.triangles.len() as u32).filter(|t| !without.contains(t)).collect();
        let sheet = topology::submesh(&sheet, &kept).0;
        let away = |p: &crate::mesh::Vec3| radius - (p.x - at[0]).hypot(p.y - at[1]);
        segment_around(&sheet, &sheet.positions.iter().map(away).collect::<Vec<_>>(), &[]).expect("a sheet")
    }

    fn shapes(cut: &Segmented) -> Vec<(Topology, usize)> {
        cut.parts.iter().map(|part| (part.topology, part.holes.len())).collect()
    }

    /// All parts but the first are discs or rings, and no border is filled.
    fn are_primitives(cut: &Segmented) {
        for (number, part) in cut.parts.iter().enumerate().skip(1) {
            assert!(matches!(part.topology, Topology::Disc | Topology::Annulus), "{number}: {:?}", shapes(cut));
            let borders = |hole: &Vec<u32>| hole.iter().any(|&h| part.borders_on_another(&cut.mesh, h));
            assert!(!part.holes.iter().any(borders), "{number}: {:?}", shapes(cut));
        }
        let area: f64 = cut.parts.iter().map(|part| part.mesh.total_area()).sum();
        assert!((area - cut.mesh.total_area()).abs() < 1e-9 * area);
    }

    #[test]
    fn pieces_beyond_come_after_what_lies_within_the_largest_first_and_specks_go() {
        let sheet = grid(40, 40, false, false);
        let beyond = [([0.3, 0.3], 0.1), ([0.7, 0.6], 0.2), ([0.2, 0.8], 0.02)];
        let field = |p: &crate::mesh::Vec3| {
            let away = |(at, radius): ([f64; 2], f64)| (p.x - at[0]).hypot(p.y - at[1]) - radius;
            beyond.into_iter().map(away).fold(f64::INFINITY, f64::min)
        };
        let found = segment_beyond(&sheet, &sheet.positions.iter().map(field).collect::<Vec<_>>()).expect("a sheet");
        let areas: Vec<f64> = found.parts.iter().map(|part| part.mesh.total_area()).collect();
        let expected = [1.0 - 0.05 * std::f64::consts::PI, 0.04 * std::f64::consts::PI, 0.01 * std::f64::consts::PI];
        assert_eq!(areas.len(), expected.len(), "{areas:?}");
        assert!(areas.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.005), "{areas:?}");
    }

    #[test]
    fn gaps_of_what_lies_around_a_patch_are_filled_and_its_border_is_not() {
        let around = cut_about([0.5, 0.5], 0.2, &[100, 203, 1000]);
        assert_eq!(shapes(&around)[0], (Topology::Disc, 0));
        // Those that no cut crosses.
        assert!(
            (1..=3).contains(&around.parts.iter().map(|part| part.holes.len()).sum::<usize>()),
            "{:?}",
            shapes(&around)
        );
        are_primitives(&around);
        // The border of so small a patch is shorter than a gap may be; a gap within it is filled.
        let small = cut_about([0.52, 0.52], 0.05, &[24 * 2 * 12 + 24]);
        assert_eq!(shapes(&small)[0], (Topology::Disc, 1));
        are_primitives(&small);
    }

    #[test]
    fn what_falls_apart_beyond_a_band_is_in_no_part_together() {
        let sheet = grid(24, 24, false, false);
        let field: Vec<f64> = sheet.positions.iter().map(|p| 0.2 - (p.x - 0.5).abs()).collect();
        let cut = segment_around(&sheet, &field, &[]).expect("a sheet");
        are_primitives(&cut);
        assert!((cut.parts[0].mesh.total_area() / sheet.total_area() - 0.4).abs() < 0.02);
        for part in &cut.parts[1..] {
            let left = part.mesh.positions.iter().filter(|p| p.x < 0.5).count();
            assert!(left == 0 || left == part.mesh.positions.len());
        }
    }

    #[test]
    fn parts_that_are_kept_stay_as_they_are_behind_the_others() {
        let sheet = grid(24, 24, false, false);
        let right = |t: usize| sheet.triangles[t].iter().all(|&v| sheet.positions[v as usize].x >= 0.75);
        let kept: Vec<Option<u32>> = (0..sheet.triangles.len()).map(|t| right(t).then_some(0)).collect();
        let field: Vec<f64> = sheet.positions.iter().map(|p| 0.2 - (p.x - 0.4).hypot(p.y - 0.5)).collect();
        let cut = segment_around(&sheet, &field, &kept).expect("a sheet");
        are_primitives(&cut);
        let last = cut.parts.last().expect("parts");
        assert!(cut.parts.len() > 2 && last.mesh.positions.iter().all(|p| p.x >= 0.75));
        assert!((last.mesh.total_area() / sheet.total_area() - 0.25).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_primitive_is_cut_on() {
        // Two windows beside the patch: three ends.
        let window =
            |t: &u32| (2..7).contains(&(t / 48)) && (matches!(t / 2 % 24, 2..9) || matches!(t / 2 % 24, 14..21));
        let windows: Vec<u32> = (0..24 * 24 * 2).filter(window).collect();
        let cut = cut_about([0.5, 0.75], 0.12, &windows);
        assert_eq!(cut.parts[0].topology, Topology::Disc);
        assert!(cut.parts.len() > 2, "{:?}", shapes(&cut));
        are_primitives(&cut);
    }
}
