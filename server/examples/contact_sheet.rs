//! Draws every built-in sample into one contact sheet, each from two sides: `contact_sheet [FILE [NAME [SIDE]]]`.

use quadmuse_server::demo;
use quadmuse_server::work::picture::{Palette, Picture, View, render, side_by_side_captioned};

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().unwrap_or_else(|| "contact_sheet.png".to_owned());
    let only = arguments.next().unwrap_or_default();
    let side: u32 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(420);
    let mut rows = Vec::new();
    let start = std::time::Instant::now();
    let (corpus, made) = (demo::corpus(), start.elapsed());
    let inputs = demo::inputs();
    println!("corpus made in {made:?}, inputs in {:?}", start.elapsed() - made);
    for sample in corpus {
        if !sample.name.contains(&only) {
            continue;
        }
        let start = std::time::Instant::now();
        let front = render(&sample.mesh, &View::guess(&sample.mesh), side);
        println!("{}: {} quads, drawn in {:?}", sample.name, sample.mesh.faces.len(), start.elapsed());
        let profile = render(&sample.mesh, &View::default().turned(-1.45, 0.05).with_palette(Palette::dark()), side);
        rows.push((front, profile, sample.name));
    }
    for sample in inputs {
        if !sample.name.contains(&only) {
            continue;
        }
        let view = View::guess(&sample.mesh).with_palette(Palette::scan());
        let start = std::time::Instant::now();
        let (front, profile) =
            (render(&sample.mesh, &view, side), render(&sample.mesh, &view.turned(-1.45, 0.05), side));
        println!("{}: {} triangles, drawn twice in {:?}", sample.name, sample.mesh.faces.len(), start.elapsed());
        rows.push((front, profile, sample.name));
    }
    let captioned: Vec<(&Picture, &str)> = rows.iter().flat_map(|(f, p, n)| [(f, n.as_str()), (p, "")]).collect();
    let strips: Vec<Picture> = captioned.chunks(6).map(side_by_side_captioned).collect();
    let width = strips.iter().map(Picture::width).max().unwrap_or(1);
    let mut sheet = Picture::filled(width, strips.iter().map(Picture::height).sum(), [244, 244, 246]);
    let mut y = 0;
    for strip in &strips {
        sheet.paste(strip, 0, y);
        y += strip.height();
    }
    std::fs::write(&file, sheet.to_png())
}
