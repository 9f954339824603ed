//! dev truth
#![allow(missing_docs)]
use quadmuse_kernel::{encode, encode::index::PlanarIndex, map, mesh::*, register::*, topology, unfold};
use std::time::Instant;
#[path = "probe.rs"]
#[allow(dead_code)]
mod probe;

struct Shape { chart: unfold::Chart, enc: encode::Encoding, patch: topology::Patch }
fn shape(path: &str) -> (Shape, f64) {
    let mesh = probe::tri(path);
    let patch = topology::whole(&mesh).unwrap();
    let t = Instant::now();
    let chart = unfold::unfold(&patch, &Default::default()).unwrap();
    let enc = encode::encode(&chart);
    (Shape { chart, enc, patch }, t.elapsed().as_secs_f64())
}
fn register(a: &Shape, b: &Shape, solver: &dyn Solver, side: usize) -> (Vec<Registration>, f64) {
    let t = Instant::now();
    let images = query_images(&b.enc, side);
    let never = || false;
    let levels: Vec<Level> = images.iter().map(|im| Level::new(&a.enc, im).unwrap()).collect();
    let mut regs = coarse(&levels[0], solver, &never);
    for level in &levels[1..] {
        for r in &mut regs { r.advance(level, solver, &never); }
    }
    (regs, t.elapsed().as_secs_f64())
}
fn errors(reg: &Registration, a: &Shape, b: &Shape, index: &PlanarIndex, truth: &[Vec3], area: f64) -> (f64, f64) {
    let places = map::vertex_locations(reg, &a.chart, &b.chart, index);
    let mut e: Vec<f64> = places.iter().zip(truth).map(|(l, t)| 100.0 * (l.point(&b.chart) - t).norm() / area.sqrt()).collect();
    e.sort_by(f64::total_cmp);
    (e[e.len() / 2], e[e.len() * 95 / 100])
}
fn main() {
    let g = "/work/shared/meshes/groundtruth";
    let kinds: Vec<String> = std::env::args().skip(1).collect();
    let text = std::fs::read_to_string(format!("{g}/pairs.csv")).unwrap();
    let mut sums: std::collections::BTreeMap<String, Vec<[f64; 4]>> = Default::default();
    for line in text.lines().skip(1) {
        let c: Vec<&str> = line.split(',').collect();
        if !kinds.iter().any(|k| k == c[0]) { continue }
        let (a, _) = shape(&format!("{g}/{}", c[5]));
        let (b, tb) = shape(&format!("{g}/{}", c[6]));
        let truth_mesh = probe::tri(&format!("{g}/{}", c[7]));
        let area = truth_mesh.total_area();
        let index = PlanarIndex::new(&b.chart);
        let (regs, t) = register(&a, &b, &LevenbergMarquardt::default(), 128);
        let side0 = Registration { q: regs[0].q.clone(), ..regs[0].clone() };
        let _ = side0;
        let mut line = String::new();
        let mut order: Vec<usize> = (0..regs.len()).collect();
        let score = |r: &Registration| r.energy / r.variance * if r.flip.is_mirror() { 1.1 } else { 1.0 };
        order.sort_by(|&i, &j| score(&regs[i]).total_cmp(&score(&regs[j])));
        let best = &regs[order[0]];
        let e = errors(best, &a, &b, &index, &truth_mesh.positions, area);
        // translation only
        let images = query_images(&b.enc, 32);
        let l = Level::new(&a.enc, &images[0]).unwrap();
        struct Nothing;
        impl Solver for Nothing { fn solve(&self, p: &problem::Problem, q: &mut Vec<unfold::Uv>, _: &dyn Fn() -> bool) -> (f64, Termination) { (p.energy(q), Termination::Converged) } }
        let tr = coarse(&l, &Nothing, &|| false);
        let tb0 = tr.iter().find(|r| r.flip == best.flip).unwrap();
        let et = errors(tb0, &a, &b, &index, &truth_mesh.positions, area);
        for r in &regs { line += &format!(" {}{}:{:.4}/{}", if r.flip.u {"U"} else {"-"}, if r.flip.v {"V"} else {"-"}, r.energy / r.variance, r.p.len()); }
        if std::env::var("POLES").is_ok() {
            let t = Instant::now();
            let mesh = unfold::solve_mesh(&b.patch);
            let un = unfold::Unfolder::new(&mesh, b.patch.topology, b.patch.mesh.positions.len()).unwrap();
            let solver = LevenbergMarquardt::default();
            let mut all = vec![];
            for poles in un.pole_candidates().unwrap() {
                for &flip in Flip::all(b.patch.topology) {
                    let mut e = pole_search::evaluate(&un, &poles, &a.enc, flip, &solver, &|| false).unwrap();
                    if flip.is_mirror() { e.cost *= 1.1; }
                    all.push(e);
                }
            }
            all.sort_by(|x, y| x.cost.total_cmp(&y.cost));
            let c0: Vec<String> = all.iter().map(|x| format!("{:.3}{}", x.cost, if x.registration.flip.is_mirror() {"M"} else {""})).collect();
            let mut tried = vec![];
            for s in all.into_iter().take(2) {
                let m = s.registration.flip.is_mirror();
                let mut r = pole_search::refine(&mesh, &un, s, &a.enc, &solver, &|| false);
                if m { r.cost *= 1.1; }
                tried.push(r);
            }
            tried.sort_by(|x, y| x.cost.total_cmp(&y.cost));
            let best = &tried[0];
            let chart = un.chart(&best.poles).unwrap();
            let enc = encode::encode(&chart);
            let bb = Shape { chart, enc, patch: b.patch.clone() };
            let images = query_images(&bb.enc, 128);
            let mut r = best.registration.clone();
            let l = Level::new(&a.enc, &images[2]).unwrap();
            r.advance(&l, &solver, &|| false);
            let idx = PlanarIndex::new(&bb.chart);
            let e2 = errors(&r, &a, &bb, &idx, &truth_mesh.positions, area);
            println!("{:9} {:46} POLE med {:6.3} p95 {:6.2} cost {:.4} final {:.4} unf {} {:.0} ms mirror {} cands {:?}", c[0], &c[6][6..c[6].len().min(52)], e2.0, e2.1, best.cost, r.energy / r.variance, best.unfoldings, t.elapsed().as_secs_f64()*1e3, r.flip.is_mirror(), c0);
            sums.entry(format!("{} POLE", c[0])).or_default().push([e2.0, e2.1, 0.0, 0.0]);
        }
        println!("{:9} {:46} med {:6.3} p95 {:6.2} | transl {:6.3} {:6.2} | flip {} folds {} m {:.3}/{:.3} enc {:.0} ms reg {:.0} ms |{}", c[0], &c[6][6..c[6].len().min(52)], e.0, e.1, et.0, et.1, if best.flip.is_mirror() {"MIRROR"} else {"-"}, best.folds, a.chart.modulus, b.chart.modulus, tb*1e3, t*1e3, line);
        sums.entry(c[0].to_string()).or_default().push([e.0, e.1, et.0, et.1]);
    }
    for (k, v) in sums {
        let mean = |j: usize| v.iter().map(|x| x[j]).sum::<f64>() / v.len() as f64;
        println!("{k}: n {} mean median {:.3} mean p95 {:.3} max median {:.3} | translation {:.3} {:.3}", v.len(), mean(0), mean(1), v.iter().map(|x| x[0]).fold(0.0, f64::max), mean(2), mean(3));
    }
}
