//! dev
#![allow(missing_docs)]
use quadmuse_kernel::{encode, register::*, topology};
#[path = "probe.rs"]
#[allow(dead_code)]
mod probe;
fn main() {
    let path = std::env::args().nth(1).unwrap();
    let patch = topology::whole(&probe::tri(&path)).unwrap();
    let q = Query::new(&patch, &Default::default()).unwrap();
    for &t in q.protrusions() {
        let c = q.quick_chart(&[t]).unwrap();
        let e = encode::encode_to(&c, 32);
        let p = &e.pyramid[0];
        let x = q.chart_for(&[t]).unwrap();
        let ex = encode::encode_to(&x, 32);
        let bad = c.uv.iter().filter(|u| !u[0].is_finite() || !u[1].is_finite()).count();
        println!("tip {t} mean {:.4} max {:.2} features {} bad {} exact mean {:.4} max {:.2} m {:.3} {:.3}", p.mean(), p.values.iter().copied().fold(0.0, f32::max), e.features.len(), bad, ex.pyramid[0].mean(), ex.pyramid[0].values.iter().copied().fold(0.0, f32::max), c.modulus, x.modulus);
    }
}
