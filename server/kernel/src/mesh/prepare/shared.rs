//! Edges of more than two faces: a sheet that ends on a surface, two bodies that touch along an edge, locks of hair that meet.
//!
//! At such an edge two faces go on into each other, and the others may, two by two; what is left over ends there, and no face
//! is lost there. First come faces of one sheet (what is connected across other edges), so that a body stays closed and what
//! stands on it comes off; then those of the largest sheets; then those that bend least. A pair that would contradict the
//! surface's two sides, or lead to two edges between the same vertices, is not made. A small sheet that came off at all such
//! edges is a leftover of modelling, mostly inside the body, and is left out.

use super::orient;
use super::stitch::take_back_bad;
use super::surface::CornerRows;
use crate::mesh::disjoint::Sides;
use crate::mesh::error::MeshError;
use crate::mesh::repair::{RepairKind, Repairs};
use crate::mesh::{NONE, Vec3};
use std::cmp::Ordering;

/// An edge of more faces is no flaw of an example's surface, nor of a scan's: such a mesh is refused. An artist can mend an example;
/// a scan is what it is.
const FACES_MAX: usize = 4;
const FACES_OF_SCAN_MAX: usize = 32;
/// A sheet is small if it has less than this share of the area.
const SMALL: f64 = 0.01;

/// Two halfedges of an edge that may be joined.
struct Pair {
    halfedges: [u32; 2],
    /// Area of the smaller of their sheets; infinite where they are of one.
    area: f64,
    /// Cosine of the angle by which the surface bends there: 1 where it goes straight on.
    straight: f64,
}

impl Pair {
    fn rank(&self, other: &Self) -> Ordering {
        let by_area = other.area.total_cmp(&self.area);
        by_area.then(other.straight.total_cmp(&self.straight)).then(self.halfedges.cmp(&other.halfedges))
    }
}

/// A surface with its edges paired and its two sides told. Small sheets that stand on it are left out. Where a
/// scan has one side it is cut.
///
/// # Errors
/// Edges of more than [`FACES_MAX`] faces, of a scan [`FACES_OF_SCAN_MAX`], and examples with one side.
pub(super) fn paired(
    mut surface: CornerRows,
    positions: &[Vec3],
    is_scan: bool,
    repairs: &mut Repairs,
) -> Result<(CornerRows, Sides), MeshError> {
    let most = if is_scan { FACES_OF_SCAN_MAX } else { FACES_MAX };
    let shared = surface.pair(most, positions)?;
    let mut sides = orient::sides(&mut surface, is_scan, repairs)?;
    let Some(first) = shared.iter().filter_map(|run| run.first()).map(|c| surface.tail(*c)).min() else {
        return Ok((surface, sides));
    };
    repairs.note_many(RepairKind::SharedEdges, shared.len() as u64, first);
    let sheets = Sheets::new(&surface, &mut sides, positions);
    mend(&mut surface, &mut sides, &sheets, &shared, positions);
    let keep = sheets.kept(&surface, &shared);
    // Of a fan of small sheets none is the body that others stand on.
    if !keep.contains(&true) {
        return Ok((surface, sides));
    }
    let Some(first) = keep.iter().position(|keep| !keep) else { return Ok((surface, sides)) };
    let gone = keep.iter().filter(|keep| !**keep).count();
    repairs.note_many(RepairKind::StandingFaces, gone as u64, surface.face_of[first]);
    surface = surface.retain(&keep);
    let shared = surface.pair(most, positions)?;
    let mut sides = orient::sides(&mut surface, is_scan, repairs)?;
    let sheets = Sheets::new(&surface, &mut sides, positions);
    mend(&mut surface, &mut sides, &sheets, &shared, positions);
    Ok((surface, sides))
}

/// What is connected across edges of two faces.
struct Sheets {
    /// The sheet of each row.
    of_row: Vec<u32>,
    /// The area of each sheet.
    area: Vec<f64>,
}

impl Sheets {
    fn new(surface: &CornerRows, sides: &mut Sides, positions: &[Vec3]) -> Self {
        let of_row: Vec<u32> = (0..surface.rows.len() as u32).map(|r| sides.root(r).0).collect();
        let mut area = vec![0.0; of_row.len()];
        for (r, row) in surface.rows.iter().enumerate() {
            let at = |k: usize| positions[row[k] as usize] - positions[row[0] as usize];
            let normal: Vec3 = (1..row.len() - 1).map(|k| at(k).cross(&at(k + 1))).sum();
            area[of_row[r] as usize] += 0.5 * normal.norm();
        }
        Self { of_row, area }
    }

    fn of(&self, surface: &CornerRows, halfedge: u32) -> usize {
        self.of_row[surface.row_of[halfedge as usize] as usize] as usize
    }

    /// For each row whether it is kept: not where all its small sheet's faces at shared edges came off.
    fn kept(&self, surface: &CornerRows, shared: &[Vec<u32>]) -> Vec<bool> {
        let total: f64 = self.area.iter().sum();
        let mut came_off = vec![false; self.area.len()];
        shared.iter().flatten().for_each(|&c| came_off[self.of(surface, c)] = true);
        let joined = shared.iter().flatten().filter(|c| surface.twins[**c as usize] != NONE);
        joined.for_each(|&c| came_off[self.of(surface, c)] = false);
        self.of_row.iter().map(|&s| !(came_off[s as usize] && self.area[s as usize] < SMALL * total)).collect()
    }
}

/// Joins faces at edges of more than two, given by their halfedges, which are open so far.
fn mend(surface: &mut CornerRows, sides: &mut Sides, sheets: &Sheets, edges: &[Vec<u32>], positions: &[Vec3]) {
    let mut made = Vec::new();
    for run in edges {
        let mut pairs = Vec::new();
        for (k, &c) in run.iter().enumerate() {
            pairs.extend(run[k + 1..].iter().filter_map(|&d| pair(surface, sheets, [c, d], positions)));
        }
        pairs.sort_by(Pair::rank);
        for Pair { halfedges: [c, d], .. } in pairs {
            let [row_c, row_d] = [c, d].map(|h| surface.row_of[h as usize]);
            let is_open = [c, d].iter().all(|h| surface.twins[*h as usize] == NONE);
            if is_open && sides.join(row_c, row_d, surface.tail(c) == surface.tail(d)) {
                surface.twins[c as usize] = d;
                surface.twins[d as usize] = c;
                made.push([c, d]);
            }
        }
    }
    take_back_bad(surface, sides, made);
}

fn pair(surface: &CornerRows, sheets: &Sheets, halfedges: [u32; 2], positions: &[Vec3]) -> Option<Pair> {
    let rows = halfedges.map(|h| surface.row_of[h as usize]);
    let [one, other] = halfedges.map(|h| sheets.of(surface, h));
    let area = if one == other { f64::INFINITY } else { sheets.area[one].min(sheets.area[other]) };
    let [away, back] = halfedges.map(|h| away_from(surface, h, positions));
    (rows[0] != rows[1]).then(|| Pair { halfedges, area, straight: -away.dot(&back) })
}

/// The direction in which a row lies of its halfedge, of length 1; zero where it has no extent.
fn away_from(surface: &CornerRows, halfedge: u32, positions: &[Vec3]) -> Vec3 {
    let at = |v: u32| positions[v as usize];
    let row = surface.rows.face(surface.row_of[halfedge as usize] as usize);
    let (from, to) = (at(surface.tail(halfedge)), at(surface.head(halfedge)));
    let along = (to - from).try_normalize(0.0).unwrap_or_default();
    let middle = row.iter().map(|&v| at(v) - from).sum::<Vec3>() / row.len() as f64;
    (middle - along * along.dot(&middle)).try_normalize(0.0).unwrap_or_default()
}
