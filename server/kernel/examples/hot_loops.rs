//! The three hot loops, each alone, for counting instructions: see tests/callgrind.

use quadmuse_kernel::encode::Picture;
use quadmuse_kernel::encode::raster::conformal_factor;
use quadmuse_kernel::mesh::{TriMesh, Vec3};
use quadmuse_kernel::register::Flip;
use quadmuse_kernel::register::image::Image;
use quadmuse_kernel::register::mls::Domain;
use quadmuse_kernel::register::nodes::Nodes;
use quadmuse_kernel::register::problem::Problem;
use quadmuse_kernel::topology::{Topology, whole};
use quadmuse_kernel::unfold::{Chart, UnfoldOptions, unfold};
use std::hint::black_box;
use std::sync::Arc;

/// A wavy sheet of 2 · 60² triangles, unfolded.
fn sheet() -> Chart {
    let n = 60u32;
    let place = |k: u32| {
        let (x, y) = (f64::from(k % (n + 1)) / f64::from(n), f64::from(k / (n + 1)) / f64::from(n));
        Vec3::new(x, y, 0.2 * (7.0 * x).sin() * (5.0 * y).cos())
    };
    let cell = |c: u32| {
        let a = c / n * (n + 1) + c % n;
        [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
    };
    let (positions, triangles) = ((0..(n + 1) * (n + 1)).map(place).collect(), (0..n * n).flat_map(cell).collect());
    let mesh = TriMesh::from_triangles(positions, triangles).expect("a sheet is manifold");
    unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable")
}

/// λ at 512².
#[inline(never)]
fn hot_raster(chart: &Chart) {
    black_box(conformal_factor(chart, 512));
}

/// The normal equations of a 128² level with 20 controls: what every pixel shows, and ψ's Jacobian at the nodes.
#[inline(never)]
fn hot_equations(problem: &Problem, q: &[[f64; 2]]) {
    let pixels = problem.pixels(q);
    black_box(problem.normal(q, &pixels));
}

/// √λ and its gradient at each pixel of a 512² level.
#[inline(never)]
fn hot_sampling(image: &Image) {
    for k in 0..512 * 512 {
        let at = [f64::from(k % 512) / 512.0 + 0.0003, f64::from(k / 512) / 512.0 + 0.0007];
        black_box(image.sample(black_box(at)));
    }
}

fn image(side: usize) -> Image {
    let values = (0..side * side).map(|k| (k % 7) as f32).collect();
    Image::new(&Picture { side, values }, Flip::default(), false)
}

fn main() {
    let wanted = std::env::args().nth(1).unwrap_or_default();
    let p: Vec<[f64; 2]> = (0..20).map(|k| [f64::from(k * 7 % 20) / 20.0, f64::from(k) / 20.0]).collect();
    let q: Vec<[f64; 2]> = p.iter().map(|p| [p[0] + 0.1, 0.9 * p[1] + 0.05]).collect();
    match wanted.as_str() {
        "raster" => hot_raster(&sheet()),
        "equations" => {
            let domain = Domain { topology: Topology::Disc, aspect: 1.0 };
            let (nodes, image) = (Arc::new(Nodes::new(domain, 128, &p)), image(128));
            hot_equations(&Problem::new(nodes, &image, &image), &q);
        }
        "sampling" => hot_sampling(&image(512)),
        _ => {}
    }
}
