//! Draws meshes side by side, each from two sides: `mesh_sheet OUT.png [--side PIXELS] [--columns N] [--yaw R] [--bits N]
//! [--view each|first|axes] FILE[=CAPTION]…`. `--view first` sees all of them as it guesses the first is seen, `axes` as what
//! stands along +y and looks along +z; `--bits` rounds
//! colours, for small files. What has triangles only is drawn as a scan, without its edges.

use quadmuse_kernel::mesh::{self, Format, Limits};
use quadmuse_server::work::picture::{Palette, Picture, View, Wires, render, side_by_side_captioned};

/// Pixels of a picture, if none are asked for.
const SIDE: u32 = 420;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut flag = |name: &str| {
        let at = arguments.iter().position(|a| a == name)?;
        let value = arguments.get(at + 1).cloned();
        arguments.drain(at..(at + 2).min(arguments.len()));
        value
    };
    let side = flag("--side").and_then(|s| s.parse().ok()).unwrap_or(SIDE);
    let columns: usize = flag("--columns").and_then(|s| s.parse().ok()).unwrap_or(2);
    let yaw: Option<f64> = flag("--yaw").and_then(|s| s.parse().ok());
    let bits: u32 = flag("--bits").and_then(|s| s.parse().ok()).unwrap_or(8);
    let how = flag("--view").unwrap_or_default();
    let Some((out, files)) = arguments.split_first() else { return Ok(()) };
    let (mut strips, mut first) = (Vec::new(), None);
    for argument in files {
        let (file, caption) = argument.split_once('=').unwrap_or((argument, ""));
        let bytes = std::fs::read(file)?;
        let mesh = mesh::read(&bytes, Format::sniff(&bytes), &Limits::default())?;
        let mut view = match first {
            Some(view) if how == "first" => view,
            _ if how == "axes" => View::default(),
            _ => View::guess(&mesh),
        };
        first = first.or(Some(view));
        if mesh.faces.iter().all(|face| face.len() == 3) {
            view = View { wires: Wires::Hidden, ..view.with_palette(Palette::scan()) };
        }
        if let Some(yaw) = yaw {
            view = view.turned(yaw, view.pitch);
        }
        let back = view.turned(view.yaw + std::f64::consts::PI, 0.3);
        let (one, two) = (render(&mesh, &view, side), render(&mesh, &back, side));
        strips.push(side_by_side_captioned(&[(&one, caption), (&two, "")]));
    }
    let width = strips.iter().map(Picture::width).max().unwrap_or(1);
    let height = strips.iter().map(Picture::height).max().unwrap_or(1);
    let rows = strips.len().div_ceil(columns) as u32;
    let mut sheet = Picture::filled(columns.min(strips.len()) as u32 * width, rows * height, [244; 3]);
    for (k, strip) in strips.iter().enumerate() {
        sheet.paste(strip, (k % columns) as u32 * width, (k / columns) as u32 * height);
    }
    std::fs::write(out, sheet.rounded(bits).to_png())?;
    Ok(())
}
