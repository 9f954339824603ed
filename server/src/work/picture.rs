//! Pictures of meshes and encodings, drawn in software: thumbnails, previews and the demo share this one rasteriser.
//!
//! A picture is a pure function of its arguments: the same mesh and view give the same bytes on every machine.

mod camera;
mod caption;
mod colour;
mod encoding;
mod lines;
mod raster;
mod surface;

pub use camera::{Paint, Poles, View, Wires};
pub use caption::{side_by_side, side_by_side_captioned};
pub use colour::Palette;
pub use encoding::encoding_picture;

use quadmuse_kernel::mesh::PolyMesh;

/// Smallest side of a picture, in pixels; smaller requests are raised to it.
pub const SIDE_MIN: u32 = 16;
/// Largest side of a picture, in pixels; larger requests are lowered to it. Its sample buffers take 75 MB.
pub const SIDE_MAX: u32 = 1024;

/// An sRGB picture, three bytes a pixel, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: u32,
    height: u32,
    pixels: Vec<u8>,
}

impl Picture {
    /// A picture of one colour; sides of 0 are raised to 1.
    pub fn filled(width: u32, height: u32, colour: [u8; 3]) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        let pixels = colour.iter().copied().cycle().take(3 * width as usize * height as usize).collect();
        Self { width, height, pixels }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All bytes: red, green, blue of each pixel, row after row.
    pub fn bytes(&self) -> &[u8] {
        &self.pixels
    }

    /// The pixel at column `x` and row `y`; black outside.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = 3 * (y as usize * self.width as usize + x as usize);
        match (x < self.width, self.pixels.get(at..at + 3)) {
            (true, Some(&[r, g, b])) => [r, g, b],
            _ => [0; 3],
        }
    }

    /// Sets a pixel; outside nothing happens.
    pub fn set(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        let at = 3 * (y as usize * self.width as usize + x as usize);
        if x < self.width
            && let Some(pixel) = self.pixels.get_mut(at..at + 3)
        {
            pixel.copy_from_slice(&colour);
        }
    }

    /// Mixes `colour` into a pixel with weight `alpha` (0–1, in sRGB); outside nothing happens.
    pub fn blend(&mut self, x: u32, y: u32, colour: [u8; 3], alpha: f32) {
        let (under, alpha) = (self.pixel(x, y), alpha.clamp(0.0, 1.0));
        let mix = |k: usize| (f32::from(under[k]) * (1.0 - alpha) + f32::from(colour[k]) * alpha).round() as u8;
        self.set(x, y, [mix(0), mix(1), mix(2)]);
    }

    /// Copies `other` with its upper left corner at column `x` and row `y`; what falls outside is cut off.
    pub fn paste(&mut self, other: &Self, x: u32, y: u32) {
        for row in 0..other.height {
            for column in 0..other.width {
                self.set(x.saturating_add(column), y.saturating_add(row), other.pixel(column, row));
            }
        }
    }

    /// The same with each channel rounded to `bits` bits (1–8): a file that is much smaller, at a slight banding.
    #[must_use]
    pub fn rounded(mut self, bits: u32) -> Self {
        let steps = f32::from((1u16 << bits.clamp(1, 8)) - 1);
        let round = |c: u8| ((f32::from(c) / 255.0 * steps).round() / steps * 255.0).round() as u8;
        self.pixels.iter_mut().for_each(|c| *c = round(*c));
        self
    }

    /// The picture as a PNG file.
    pub fn to_png(&self) -> Vec<u8> {
        // Encoding into memory fails only for an empty picture or a wrong length; the constructors forbid both.
        self.encode().unwrap_or_default()
    }

    fn encode(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.pixels)?;
        writer.finish()?;
        Ok(bytes)
    }
}

/// Draws `mesh` into a square picture of `side` pixels (clamped to [`SIDE_MIN`]..=[`SIDE_MAX`]).
///
/// Smooth shaded clay, the polygons' own edges (hidden ones removed, boundary edges emphasised) and the
/// extraordinary vertices of quad meshes. Faces with missing or non-finite vertices are left out; an empty mesh
/// gives the bare background.
pub fn render(mesh: &PolyMesh, view: &View, side: u32) -> Picture {
    let side = side.clamp(SIDE_MIN, SIDE_MAX) as usize;
    let samples = if side <= 256 { 3 } else { 2 };
    let surface = surface::Surface::of(mesh);
    let projected = camera::project(&surface, view, side * samples);
    let mut frame = raster::Frame::new(side * samples);
    raster::triangles(&mut frame, &surface, &projected, &view.palette, view.paint);
    if view.wires == Wires::Polygons {
        lines::edges(&mut frame, &surface, &projected, samples);
    }
    let mut picture = raster::resolve(&frame, &view.palette, samples);
    if view.poles == Poles::Marked {
        lines::poles(&mut picture, &frame, &surface, &projected, &view.palette, samples);
    }
    picture
}

#[cfg(test)]
mod tests;
