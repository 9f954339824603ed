//! How far the quads of a net are from having right angles. *Ours, not the paper's.*

use super::net::Net;
use super::resolve::deviations_deg;
use crate::mesh::Vec3;

/// Mean deviation of a quad's angles from 90°, in degrees; an angle at an edge without length counts 90.
pub fn deviation_deg(p: [Vec3; 4]) -> f64 {
    deviations_deg(p).into_iter().map(|d| d.unwrap_or(90.0)).sum::<f64>() / 4.0
}

/// The same of a face; `None` where it is no quad.
fn of_face(net: &Net, face: &[u32]) -> Option<f64> {
    let corners: [u32; 4] = face.try_into().ok()?;
    Some(deviation_deg(corners.map(|v| net.positions[v as usize])))
}

/// Mean deviation over a net's quads, in degrees.
pub fn mean_deviation_deg(net: &Net) -> f64 {
    let (sum, count) =
        net.faces().filter_map(|(_, face)| of_face(net, face)).fold((0.0, 0.0), |(sum, n), d| (sum + d, n + 1.0));
    sum / f64::max(count, 1.0)
}

/// Mean deviation over the quads at each vertex, in degrees; 0 where there is none.
pub fn deviations_at_deg(net: &Net) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); net.positions.len()];
    for (_, face) in net.faces() {
        let Some(deviation) = of_face(net, face) else { continue };
        face.iter().for_each(|&v| sums[v as usize] = (sums[v as usize].0 + deviation, sums[v as usize].1 + 1.0));
    }
    sums.into_iter().map(|(sum, count)| sum / f64::max(count, 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;

    #[test]
    fn squares_deviate_by_nothing_and_a_sheared_row_by_its_angle_at_its_vertices_alone() {
        let mut net = sheet(3, 3);
        assert!(mean_deviation_deg(&net) < 1e-12);
        // The top row leans by 45°: two edges of length √2 with the upright.
        net.positions.iter_mut().filter(|p| p.y > 2.5).for_each(|p| p.x += 1.0);
        assert!((mean_deviation_deg(&net) - 15.0).abs() < 1e-9);
        let at = deviations_at_deg(&net);
        assert!(at[0] < 1e-12 && (at[9] - 22.5).abs() < 1e-9 && (at[13] - 45.0).abs() < 1e-9, "{at:?}");
    }
}
