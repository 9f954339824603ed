//! dev probe
#![allow(missing_docs)]
use quadmuse_kernel::{encode, mesh::*, topology, unfold};
use std::time::Instant;

pub fn load(path: &str) -> (Vec<Vec3>, Vec<Vec<u32>>) {
    let text = std::fs::read_to_string(path).unwrap();
    let (mut v, mut f) = (vec![], vec![]);
    for line in text.lines() {
        if let Some(r) = line.strip_prefix("v ") {
            let x: Vec<f64> = r.split_whitespace().take(3).map(|x| x.parse().unwrap()).collect();
            v.push(Vec3::new(x[0], x[1], x[2]));
        } else if let Some(r) = line.strip_prefix("f ") {
            f.push(r.split_whitespace().map(|c| c.split('/').next().unwrap().parse::<u32>().unwrap() - 1).collect());
        }
    }
    (v, f)
}
pub fn tri(path: &str) -> TriMesh {
    let (v, f) = load(path);
    let mut t = vec![];
    for face in &f {
        for k in 1..face.len() - 1 {
            t.push([face[0], face[k], face[k + 1]]);
        }
    }
    TriMesh::from_triangles(v, t).unwrap()
}
fn main() {
    for path in std::env::args().skip(1) {
        let mesh = tri(&path);
        let name = path.rsplit('/').next().unwrap();
        let patch = match topology::whole(&mesh) {
            Ok(p) => p,
            Err(e) => {
                println!("{name}: {e}");
                continue;
            }
        };
        let t0 = Instant::now();
        let chart = unfold::unfold(&patch, &Default::default()).unwrap();
        let t1 = Instant::now();
        let enc = encode::encode(&chart);
        let t2 = Instant::now();
        let _index = encode::index::PlanarIndex::new(&chart);
        let t3 = Instant::now();
        println!(
            "{name:50} {:?} tris {} -> {} unfold {:.0} ms encode {:.0} ms index {:.0} ms; m {:.4} uvflips {} ({:.3}%) angle {:.2} flips {} feat {} max {:.1} clamp {} moll {:.1e}",
            patch.topology,
            mesh.triangles.len(),
            chart.mesh.triangles.len(),
            (t1 - t0).as_secs_f64() * 1e3,
            (t2 - t1).as_secs_f64() * 1e3,
            (t3 - t2).as_secs_f64() * 1e3,
            chart.modulus,
            chart.report.uv_flips,
            100.0 * chart.report.uv_flips as f64 / chart.mesh.triangles.len() as f64,
            chart.report.angle_deviation_deg,
            chart.report.flips,
            enc.features.len(),
            enc.pyramid[4].values.iter().copied().fold(0.0, f32::max),
            chart.report.clamped,
            chart.report.mollified
        );
    }
}
