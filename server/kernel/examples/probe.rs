//! dev probe
#![allow(missing_docs)]
use quadmuse_kernel::{mesh::*, topology, unfold};
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
        let patch = match topology::whole(&mesh) { Ok(p) => p, Err(e) => { println!("{name}: {e}"); continue } };
        let sm = unfold::solve_mesh(&patch);
        let un = unfold::Unfolder::new(sm, patch.topology, patch.mesh.positions.len()).unwrap();
        let poles = un.pole_candidates().unwrap();
        let t = Instant::now();
        let tips = un.protrusions(&poles[0]).unwrap();
        let e = t.elapsed();
        let pts: Vec<String> = tips.iter().map(|&t| { let p = un.mesh().positions[t as usize]; format!("({:.2} {:.2} {:.2})", p.x, p.y, p.z) }).collect();
        println!("{name:50} tips {} {:.0} ms {}", tips.len(), e.as_secs_f64()*1e3, pts.join(" "));
    }
}
