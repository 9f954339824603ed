//! Views: one picture that holds those of all sub-discs about a pole.
//!
//! Above a level of v the surface has the same u and an affine v of its own, and v′ is the share of the area. So the
//! picture of the sub-disc that holds the share a of the area is made of the rows v′ ≥ 1 − a of the picture of the whole,
//! without a solve. *Source:* METHOD §9.

use crate::encode::{Encoding, Picture, from_finest};
use crate::topology::Topology;
use crate::unfold::area_fraction::MODULUS_SHARES;

/// A surface's picture about a pole, with what its sub-discs need.
#[derive(Clone, Debug)]
pub struct View {
    /// The poles; the sub-discs are those about the last.
    pub poles: Vec<u32>,
    picture: Picture,
    /// −log |w| at evenly spaced v′, from 0 to 1.
    depths: Vec<f64>,
}

impl View {
    /// A view from its picture, and from v′ and −log |w| of each vertex.
    pub fn new(poles: &[u32], picture: Picture, v: &[f64], depth: &[f64]) -> Self {
        let mut order: Vec<(f64, f64)> = v.iter().copied().zip(depth.iter().copied()).collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let count = picture.side;
        let at = |k: usize| {
            let share = k as f64 / count as f64;
            let above = order.partition_point(|x| x.0 < share).min(order.len().saturating_sub(1));
            order.get(above).map_or(0.0, |x| x.1)
        };
        Self { poles: poles.to_vec(), depths: (0..=count).map(at).collect(), picture }
    }

    /// The encoding of the sub-disc that holds a share of the area, `finest` pixels a side.
    pub fn encoding(&self, share: f64, finest: usize) -> Encoding {
        from_finest(self.crop(share, finest), Topology::Disc, self.modulus(share))
    }

    /// The modulus of that sub-disc.
    pub fn modulus(&self, share: f64) -> f64 {
        let rim = self.depth(1.0 - share);
        (self.depth(1.0 - share * (1.0 - MODULUS_SHARES[1])) - rim) / std::f64::consts::TAU
    }

    fn depth(&self, v: f64) -> f64 {
        let at = v.clamp(0.0, 1.0) * (self.depths.len() - 1) as f64;
        let k = (at as usize).min(self.depths.len() - 2);
        self.depths[k] + (at - k as f64) * (self.depths[k + 1] - self.depths[k])
    }

    /// The picture of that sub-disc.
    pub fn crop(&self, share: f64, side: usize) -> Picture {
        let from = &self.picture;
        let columns = from.side / side;
        let (low, height) = ((1.0 - share) * from.side as f64, share * from.side as f64 / side as f64);
        let mut values = vec![0f32; side * side];
        let mut line = vec![0f64; from.side];
        for row in 0..side {
            line.fill(0.0);
            let (a, b) = (low + row as f64 * height, low + (row + 1) as f64 * height);
            for y in a as usize..(b.ceil() as usize).min(from.side) {
                let weight = b.min((y + 1) as f64) - a.max(y as f64);
                let source = &from.values[y * from.side..(y + 1) * from.side];
                line.iter_mut().zip(source).for_each(|(sum, x)| *sum += weight * f64::from(*x));
            }
            for (value, pixels) in values[row * side..(row + 1) * side].iter_mut().zip(line.chunks_exact(columns)) {
                *value = (pixels.iter().sum::<f64>() / (columns as f64 * height)) as f32;
            }
        }
        let mut picture = Picture { side, values };
        // The rows' means are 1 up to the size of a vertex.
        let mean = picture.mean().max(f64::MIN_POSITIVE) as f32;
        picture.values.iter_mut().for_each(|x| *x /= mean);
        picture
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::tri::TriMesh;
    use crate::register::Query;
    use crate::segment::segment_above;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::UnfoldOptions;

    /// A sheet with a hill beside its middle.
    fn hill(n: u32) -> TriMesh {
        let mut mesh = grid(n, n, false, false);
        mesh.positions.iter_mut().for_each(|p| p.z = 0.5 * (-((p.x - 0.6).powi(2) + (p.y - 0.5).powi(2)) / 0.02).exp());
        mesh
    }

    #[test]
    fn the_upper_rows_show_what_the_part_cut_out_shows() {
        let pole = vec![61 * 30 + 36];
        let options = UnfoldOptions { poles: pole.clone() };
        let patch = whole(&hill(60)).expect("a disc");
        let query = Query::new(&patch, &options).expect("solvable");
        let view = query.view(&pole, 128).expect("a conformal map");
        let share = 0.5;
        let below = query.quick_chart(&pole).expect("a chart").uv;
        let field: Vec<f64> = below.iter().take(patch.mesh.positions.len()).map(|uv| uv[1] - (1.0 - share)).collect();
        let part = segment_above(&patch.mesh, &field).expect("a cut").parts.swap_remove(0);
        let at = patch.mesh.positions[pole[0] as usize];
        let near = |v: &usize| (part.mesh.positions[*v] - at).norm();
        let own = (0..part.mesh.positions.len()).min_by(|a, b| near(a).total_cmp(&near(b))).expect("vertices") as u32;
        let cut = Query::new(&part, &UnfoldOptions { poles: vec![own] }).expect("solvable");
        let (shown, real) = (view.encoding(share, 32), cut.encoding());
        assert!((shown.modulus / real.modulus - 1.0).abs() < 0.1, "{} {}", shown.modulus, real.modulus);
        // u starts elsewhere: the best turn is taken.
        let (a, b) = (&shown.pyramid[0].values, &real.pyramid[0].values);
        let apart = |turn: usize| {
            let at = |k: usize| (k / 32) * 32 + (k % 32 + turn) % 32;
            (0..1024).map(|k| f64::from((a[at(k)] - b[k]).abs())).sum::<f64>() / 1024.0
        };
        let least = (0..32).map(apart).fold(f64::INFINITY, f64::min);
        assert!(least < 0.1, "{least}");
        assert!((shown.pyramid[0].mean() - 1.0).abs() < 1e-5);
    }
}
