//! How near a surface is, and how it faces, over all of the space about it: what rough poses are sifted by.
//!
//! Poses that are tried lie apart: by a quarter of the smaller surface, and by turns of 30°. Nearness that fell off faster than
//! that would tell a right pose only by chance. One that falls off as slowly is smooth enough for a grid, and is looked up there
//! instead of sought in a tree. Each cell keeps it for six directions, as an ambient cube keeps light. *Source:* McTaggart 2004
//! (ambient cubes). *Ours, not a paper's:* all else.

use super::input_surface::Samples;
use crate::mesh::{Vec3, bounding_box};

/// Distance at which nearness is 1/e, in √area of the smaller surface. *Untuned:* .15 and .2 find as many of 28 known poses.
const SIGMA: f64 = 0.12;
/// Farther than this nothing is near: less than 2 %.
const REACH: f64 = 2.0 * SIGMA;
/// Side of a cell.
const CELL: f64 = 0.5 * SIGMA;
/// Cells at most: of what is long and thin they are larger.
const CELLS_MAX: f64 = 100_000.0;
const CELL_GROWTH: f64 = 1.25;
/// Samples that are spread over the grid, at most: they lie closer than a cell is wide.
const SAMPLES_MAX: usize = 1000;

/// A grid about samples of a surface.
#[derive(Debug)]
pub(super) struct Nearness {
    low: Vec3,
    cell: f64,
    size: [usize; 3],
    /// Of each cell, x fastest, for what faces along +x, −x, +y, −y, +z and −z: 255 is 1.
    lobes: Vec<[u8; 6]>,
}

/// A row of cells along an axis: the number of each, its squared distance, and its nearness along that axis.
type CellRow = Vec<(usize, f64, f32)>;

impl Nearness {
    pub(super) fn new(samples: &Samples) -> Self {
        let Some([low, high]) = bounding_box(&samples.points) else {
            return Self { low: Vec3::zeros(), cell: CELL, size: [0; 3], lobes: Vec::new() };
        };
        let (low, sides) = (low.add_scalar(-REACH), (high - low).add_scalar(2.0 * REACH));
        let mut cell = CELL;
        while (0..3).map(|d| sides[d] / cell + 1.0).product::<f64>() > CELLS_MAX {
            cell *= CELL_GROWTH;
        }
        let size = [0, 1, 2].map(|d| (sides[d] / cell) as usize + 1);
        let mut grid = Self { low, cell, size, lobes: vec![[0; 6]; size.iter().product()] };
        let step = samples.points.len().div_ceil(SAMPLES_MAX);
        for (point, normal) in samples.points.iter().zip(&samples.normals).step_by(step) {
            grid.add(point, normal);
        }
        grid
    }

    fn add(&mut self, point: &Vec3, normal: &Vec3) {
        let [xs, ys, zs] = [0, 1, 2].map(|d| self.row(point, d));
        // Along each axis it faces one way alone.
        let facing = [0, 1, 2].map(|d| (2 * d + usize::from(normal[d] < 0.0), 255.0 * normal[d].abs() as f32));
        for (z, away_z, near_z) in &zs {
            for (y, away_y, near_y) in &ys {
                let first = self.size[0] * (y + self.size[1] * z);
                for (x, away_x, near_x) in &xs {
                    if away_x + away_y + away_z > REACH * REACH {
                        continue;
                    }
                    let near = near_x * near_y * near_z;
                    let lobes = &mut self.lobes[first + x];
                    for (lobe, facing) in facing {
                        lobes[lobe] = lobes[lobe].max((near * facing + 0.5) as u8);
                    }
                }
            }
        }
    }

    /// The cells along an axis whose middles may be within reach.
    fn row(&self, point: &Vec3, axis: usize) -> CellRow {
        let (at, reach) = ((point[axis] - self.low[axis]) / self.cell, REACH / self.cell);
        let (first, last) = ((at - reach).max(0.0) as usize, (at + reach) as usize);
        let cell = |k: usize| {
            let away = ((k as f64 + 0.5 - at) * self.cell).powi(2);
            (k, away, (-away / (SIGMA * SIGMA)).exp() as f32)
        };
        (first..=last.min(self.size[axis] - 1)).map(cell).collect()
    }

    /// How near the surface is to a point, and faces along a normal there: 1 where a sample is, which faces so.
    pub(super) fn at(&self, point: &Vec3, normal: &Vec3) -> f64 {
        let mut cell = 0;
        for axis in [2, 1, 0] {
            let at = (point[axis] - self.low[axis]) / self.cell;
            // A number that is not one lies nowhere, either.
            if !(at >= 0.0 && at < self.size[axis] as f64) {
                return 0.0;
            }
            cell = cell * self.size[axis] + at as usize;
        }
        let lobes = &self.lobes[cell];
        let along = |axis: usize| normal[axis].abs() * f64::from(lobes[2 * axis + usize::from(normal[axis] < 0.0)]);
        ((along(0) + along(1) + along(2)) / 255.0).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::input_surface::InputSurface;
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn what_is_near_and_faces_alike_counts_and_nothing_else() {
        let sheet = grid(20, 20, false, false);
        let near = Nearness::new(&InputSurface::new(&sheet).spread(900));
        let (middle, up) = (Vec3::new(0.5, 0.5, 0.0), Vec3::z());
        let facing = if near.at(&middle, &up) > 0.5 { up } else { -up };
        let at = |height: f64, normal: &Vec3| near.at(&(middle + facing * height), normal);
        assert!(at(0.0, &facing) > 0.9 && at(0.0, &-facing) == 0.0 && at(0.0, &Vec3::x()) < 1e-6);
        assert!((at(SIGMA, &facing) - (-1f64).exp()).abs() < 0.2, "{}", at(SIGMA, &facing));
        assert_eq!([REACH + CELL, -10.0, f64::NAN].map(|height| at(height, &facing)), [0.0; 3]);
        assert_eq!(Nearness::new(&Samples::default()).at(&middle, &up), 0.0);
    }

    #[test]
    fn what_is_long_takes_no_more_cells() {
        let far = |x: f64| Samples {
            points: vec![Vec3::zeros(), Vec3::repeat(x)],
            normals: vec![Vec3::z(); 2],
            ..Samples::default()
        };
        let near = Nearness::new(&far(1e3));
        assert!(near.lobes.len() <= CELLS_MAX as usize);
    }
}
