//! dev truth
#![allow(missing_docs)]
use quadmuse_kernel::{encode, encode::index::PlanarIndex, map, mesh::*, register::*, topology, unfold};
use std::time::Instant;
#[path = "probe.rs"]
#[allow(dead_code)]
mod probe;

fn errors(reg: &Registration, a: &unfold::Chart, b: &unfold::Chart, truth: &[Vec3], area: f64) -> (f64, f64) {
    let index = PlanarIndex::new(b);
    let places = map::cross_map(reg, a, b, &index).locations;
    let mut e: Vec<f64> =
        places.iter().zip(truth).map(|(l, t)| 100.0 * (l.point(b) - t).norm() / area.sqrt()).collect();
    e.sort_by(f64::total_cmp);
    (e[e.len() / 2], e[e.len() * 95 / 100])
}
fn main() {
    let g = "/work/shared/meshes/groundtruth";
    let kinds: Vec<String> = std::env::args().skip(1).collect();
    let text = std::fs::read_to_string(format!("{g}/pairs.csv")).unwrap();
    let side: usize = std::env::var("SIDE").ok().and_then(|s| s.parse().ok()).unwrap_or(128);
    let lines: Vec<String> = text.lines().skip(1).map(String::from).collect();
    let next = std::sync::atomic::AtomicUsize::new(0);
    let sums: std::sync::Mutex<std::collections::BTreeMap<String, Vec<[f64; 6]>>> = Default::default();
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| loop {
        let k = next.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
        let Some(line) = lines.get(k) else { break };
        let c: Vec<&str> = line.split(',').collect();
        if !kinds.iter().any(|k| k == c[0]) { continue }
        let solver = LevenbergMarquardt::default();
        let never = || false;
        let patch = topology::whole(&probe::tri(&format!("{g}/{}", c[5]))).unwrap();
        let chart = unfold::unfold(&patch, &Default::default()).unwrap();
        let ex = encode::encode(&chart);
        let bmesh = probe::tri(&format!("{g}/{}", c[6]));
        let t0 = Instant::now();
        let query = Query::new(&topology::whole(&bmesh).unwrap(), &Default::default()).unwrap();
        let t1 = Instant::now();
        let truth_mesh = probe::tri(&format!("{g}/{}", c[7]));
        let area = truth_mesh.total_area();
        let mut entry = Entry::coarse(&query, &ex, &solver, &never).unwrap();
        entry.advance(&query, &ex, &solver, &never).unwrap();
        while entry.side() < side { entry.advance(&query, &ex, &solver, &never).unwrap(); }
        let t2 = Instant::now();
        let r0 = entry.best().clone();
        let e0 = errors(&r0.registration, &chart, &query.chart_for(&r0.unfolded.poles).unwrap(), &truth_mesh.positions, area);
        let t3 = Instant::now();
        entry.refine_poles(&query, &ex, &solver, &never).unwrap();
        let t4 = Instant::now();
        let r1 = entry.best().clone();
        let ch1 = query.chart_for(&r1.unfolded.poles).unwrap();
        let e1 = errors(&r1.registration, &chart, &ch1, &truth_mesh.positions, area);
        if std::env::var("ATLAS").is_ok() {
            let t = Instant::now();
            let exq = Query::new(&patch, &Default::default()).unwrap();
            let at = map::atlas::Atlas::build(&exq, &query, &solver, &never).unwrap();
            if let Some(at) = at {
                let m = at.cross_map(&[]).unwrap();
                let mut e: Vec<f64> = m.positions.iter().zip(&truth_mesh.positions).map(|(l, t)| 100.0 * (l - t).norm() / area.sqrt()).collect();
                e.sort_by(f64::total_cmp);
                let mi = |b: bool| if b { -1.0 } else { 1.0 };
                let single = map::cross_map(&entry.best().registration, &chart, &query.chart_for(&entry.best().unfolded.poles).unwrap(), &PlanarIndex::new(&query.chart_for(&entry.best().unfolded.poles).unwrap()));
                let bs = quadmuse_kernel::measure::distortion(&patch.mesh, &single.positions, &single.locations, &query.chart_for(&entry.best().unfolded.poles).unwrap(), mi(entry.best().registration.flip.is_mirror())).badness();
                let ba = quadmuse_kernel::measure::distortion(&patch.mesh, &m.positions, &m.locations, at.input().unwrap(), mi(at.mirrored)).badness();
                print!("[single {bs:.1} atlas {ba:.1}] ");
                println!("{:9} {:46} ATLAS med {:6.3} p95 {:6.2} max {:.1} matches {} of {}/{} mirrored {} cost {:.3} {:.0} ms", c[0], &c[6][6..c[6].len().min(52)], e[e.len()/2], e[e.len()*95/100], e[e.len()-1], at.matches.len(), exq.protrusions().len(), query.protrusions().len(), at.mirrored, at.cost, t.elapsed().as_secs_f64()*1e3);
                sums.lock().unwrap().entry(format!("{} ATLAS", c[0])).or_default().push([0.0, 0.0, e[e.len()/2], e[e.len()*95/100], if at.mirrored {1.0} else {0.0}, 0.0]);
            }
        }
        let mo = if r1.registration.flip.is_mirror() { 1.0 } else { 0.0 };
        println!("{:9} {:46} med {:6.3} p95 {:6.2} cost {:.4} -> med {:6.3} p95 {:6.2} cost {:.4} ctrl {} flip {}{} folds {} m {:.3}/{:.3} cands {} | query {:.0} reg {:.0} poles {:.0} ms", c[0], &c[6][6..c[6].len().min(52)], e0.0, e0.1, r0.cost(), e1.0, e1.1, r1.cost(), r1.registration.p.len(),
            if r1.registration.flip.u {"U"} else {"-"}, if r1.registration.flip.v {"V"} else {"-"}, r1.registration.folds, chart.modulus, r1.unfolded.encoding.modulus, query.candidates().len(), (t1-t0).as_secs_f64()*1e3, (t2-t1).as_secs_f64()*1e3, (t4-t3).as_secs_f64()*1e3);
        sums.lock().unwrap().entry(c[0].to_string()).or_default().push([e0.0, e0.1, e1.0, e1.1, mo, 0.0]);
    });
        }
    });
    for (k, v) in sums.into_inner().unwrap() {
        let mean = |j: usize| v.iter().map(|x| x[j]).sum::<f64>() / v.len() as f64;
        let max = |j: usize| v.iter().map(|x| x[j]).fold(0.0, f64::max);
        println!(
            "{k:9}: n {} before: median {:.3} (max {:.3}) p95 {:.3} | refined: median {:.3} (max {:.3}) p95 {:.3} mirrors {}",
            v.len(),
            mean(0),
            max(0),
            mean(1),
            mean(2),
            max(2),
            mean(3),
            mean(4) * v.len() as f64
        );
    }
}
