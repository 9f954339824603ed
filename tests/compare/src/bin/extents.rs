//! Lays examples on inputs that end elsewhere, every hypothesis, and prints how far off each is.
//!
//! `extents [--set extents|cross] [--kind KIND] [--name PART]`

use quadmuse_compare::ground_truth::loaded::Loaded;
use quadmuse_kernel::fit::{Fit, Surface, fits};
use quadmuse_kernel::mesh::Vec3;
use quadmuse_kernel::register::LevenbergMarquardt;
use quadmuse_kernel::settle::{Manner, Options, settle};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Where the vertices of an example, in the order of its file, belong; `None` where they have no place on the input.
type Truth = Vec<Option<Vec3>>;

struct Case {
    kind: String,
    name: String,
    example: PathBuf,
    input: PathBuf,
    truth: Truth,
    /// What errors are measured in.
    unit: f64,
}

fn main() {
    let mut words = std::env::args().skip(1);
    let (mut set, mut kind, mut name) = (String::from("extents"), String::new(), String::new());
    while let (Some(word), Some(value)) = (words.next(), words.next()) {
        match word.as_str() {
            "--set" => set = value,
            "--kind" => kind = value,
            "--name" => name = value,
            _ => eprintln!("unknown {word}"),
        }
    }
    let Some(shared) = quadmuse_tests::shared::folder_or_say("extents") else { return };
    let folder = shared.join("meshes").join(&set);
    let mut cases = if set == "cross" { cross(&folder) } else { extents(&folder) };
    cases.retain(|c| c.kind.contains(&kind) && c.name.contains(&name));
    let next = std::sync::atomic::AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, std::sync::atomic::Ordering::Relaxed)) {
                    println!("{}", run(case).unwrap_or_else(|e| format!("{} {e}", case.name)));
                }
            });
        }
    });
}

fn run(case: &Case) -> Result<String, String> {
    let begun = Instant::now();
    let (example, input) = (Loaded::read(&case.example)?, Loaded::read(&case.input)?);
    let of_surface = in_order(&example, &case.truth);
    let one = Surface::new(example.patch.clone()).map_err(|e| e.to_string())?;
    let two = Surface::new(input.patch.clone()).map_err(|e| e.to_string())?;
    let all = fits(&one, &two, &LevenbergMarquardt::default(), &|| false).map_err(|e| e.to_string())?;
    let mut out = format!("{} {} ({:.1} s)", case.kind, case.name, begun.elapsed().as_secs_f64());
    for fit in &all {
        out += &format!("\n    {}", line(fit, &of_surface, case.unit));
        for manner in [Manner::Whole, Manner::Following] {
            let options = Options { manner, ..Options::default() };
            let mirror = if fit.laid.mirrored { -1.0 } else { 1.0 };
            let begun = Instant::now();
            let Some(s) = settle(&one.patch.mesh, &two.patch.mesh, &fit.start(&one), mirror, &options, &|| false)
            else {
                continue;
            };
            let e = s.evidence;
            let off = |v: usize| of_surface[v].filter(|_| !s.lost[v]).map(|t| (s.positions[v] - t).norm() / case.unit);
            let mut errors: Vec<f64> = (0..of_surface.len()).filter_map(off).collect();
            errors.sort_by(f64::total_cmp);
            let at = |share: usize| errors.get(errors.len() * share / 100).copied().unwrap_or(f64::NAN);
            let inside = of_surface.iter().flatten().count();
            out += &format!(
                "\n        {manner:?} {:.1} s residual {:.4} ndis {:.4} shear {:.3} spread {:.3} bend {:.1} relief {:.3} lost {:.2} | mean {:.3} median {:.3} p95 {:.3} missing {:.3}",
                begun.elapsed().as_secs_f64(),
                e.residual,
                e.normal_disagreement,
                e.shear,
                e.scale_spread,
                e.bend,
                e.relief,
                e.lost,
                errors.iter().sum::<f64>() / errors.len().max(1) as f64,
                at(50),
                at(95),
                1.0 - errors.len() as f64 / inside as f64
            );
        }
    }
    Ok(out)
}

fn line(fit: &Fit, truth: &[Option<Vec3>], unit: f64) -> String {
    let all: Vec<u32> = (0..truth.len() as u32).collect();
    let kept = fit.one.as_ref().map_or(&all, |one| &one.segmented.parts[0].vertex_of);
    let mut errors: Vec<f64> = Vec::new();
    for (v, at) in kept.iter().zip(&fit.laid.cross.positions) {
        if let Some(there) = truth[*v as usize] {
            errors.push((at - there).norm() / unit);
        }
    }
    let inside = truth.iter().flatten().count();
    errors.sort_by(f64::total_cmp);
    let at = |share: usize| errors.get(errors.len() * share / 100).copied().unwrap_or(f64::NAN);
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let d = &fit.laid.distortion;
    let extent = fit
        .extent
        .as_ref()
        .map_or("whole".into(), |e| format!("{:.2} on {:.2} score {:.3}", e.one.share, e.two.share, e.score));
    format!(
        "{extent:28} mirrored {:5} atlas {:5} cost {:.3} angle {:.1} {:.1} laid {:.1} area {:.2} inward {:.4} badness {:.1} | mean {mean:.3} median {:.3} p95 {:.3} missing {:.3}",
        fit.laid.mirrored,
        fit.laid.is_atlas,
        fit.laid.cost,
        d.angle_deg.mean,
        d.angle_deg.p95,
        fit.laid.laid_angle_p95_deg,
        d.area_log2.p95,
        d.inward.len() as f64 / d.faces as f64,
        d.badness(),
        at(50),
        at(95),
        1.0 - errors.len() as f64 / inside as f64
    )
}

/// For each vertex of the surface the place of the file's vertex.
fn in_order(example: &Loaded, truth: &Truth) -> Truth {
    let mut of = vec![None; example.prepared.mesh.positions.len()];
    for (place, &v) in truth.iter().zip(&example.prepared.vertex_of) {
        if v != quadmuse_kernel::mesh::NONE {
            of[v as usize] = *place;
        }
    }
    example.patch.vertex_of.iter().map(|&v| of[v as usize]).collect()
}

fn extents(folder: &Path) -> Vec<Case> {
    let table = std::fs::read_to_string(folder.join("pairs.csv")).unwrap_or_default();
    let case = |row: &str| {
        let cells: Vec<&str> = row.split(',').collect();
        let truth = quadmuse_compare::ground_truth::case::poly(&folder.join(cells[3])).ok()?;
        let inside = std::fs::read_to_string(folder.join(cells[4])).ok()?;
        let inside: Vec<bool> = inside.split_whitespace().map(|w| w != "0").collect();
        let mut area = 0f64;
        for f in truth.faces.iter() {
            if f.iter().all(|&v| inside[v as usize]) {
                let p: Vec<Vec3> = f.iter().map(|&v| truth.positions[v as usize]).collect();
                area += (1..p.len() - 1).map(|k| (p[k] - p[0]).cross(&(p[k + 1] - p[0])).norm() / 2.0).sum::<f64>();
            }
        }
        let places = truth.positions.iter().zip(&inside).map(|(p, &on)| on.then_some(*p)).collect();
        Some(Case {
            kind: cells[0].into(),
            name: cells[2].trim_start_matches("input_").trim_end_matches(".ply").into(),
            example: folder.join(cells[1]),
            input: folder.join(cells[2]),
            truth: places,
            unit: 0.01 * area.sqrt(),
        })
    };
    table.lines().skip(1).filter_map(case).collect()
}

fn cross(folder: &Path) -> Vec<Case> {
    let read = |name: &str| -> serde_json::Value {
        let text = std::fs::read_to_string(folder.join(name)).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    };
    let (marks, inputs) = (read("landmarks.json"), read("inputs.json"));
    let families = ["mh", "ict"];
    let mut cases = Vec::new();
    for (from, to) in [(0, 1), (1, 0), (0, 0), (1, 1)] {
        for a in 0..4 {
            for b in 0..4 {
                if from == to && (a + 1) % 4 != b {
                    continue;
                }
                let (example, input) = (format!("{}_{a:02}", families[from]), format!("{}_{b:02}", families[to]));
                let place = |name: &str| -> Vec3 {
                    let p = &inputs[&input]["points"][name];
                    Vec3::new(p[0].as_f64().unwrap_or(0.0), p[1].as_f64().unwrap_or(0.0), p[2].as_f64().unwrap_or(0.0))
                };
                let Ok(poly) = quadmuse_compare::ground_truth::case::poly(&folder.join(format!("{example}.obj")))
                else {
                    continue;
                };
                let mut truth = vec![None; poly.positions.len()];
                for (name, vertex) in marks[families[from]].as_object().into_iter().flatten() {
                    truth[vertex.as_u64().unwrap_or(0) as usize] = Some(place(name));
                }
                cases.push(Case {
                    kind: format!("{}{}", families[from], families[to]),
                    name: format!("{example}→{input}"),
                    example: folder.join(format!("{example}.obj")),
                    input: folder.join(format!("input_{input}.ply")),
                    truth,
                    unit: (place("eye_l_out") - place("eye_r_out")).norm(),
                });
            }
        }
    }
    cases
}
