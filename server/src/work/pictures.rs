//! Pictures as PNG files: thumbnails of examples, previews of maps, encodings.

use super::picture::{Paint, Poles, SIDE_MAX, SIDE_MIN, View, encoding_picture, render};
use super::{Caller, REQUEST_TIME_MAX, Work, WorkError, ingest};
use crate::pool::{Lane, User};
use bytes::Bytes;
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_proto::ExampleId;
use quadmuse_proto::query::LEVELS;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Side of a picture when the caller names none, in pixels.
pub const SIZE_DEFAULT: u32 = 256;

/// Side that an encoding's picture is enlarged to, in pixels.
const ENCODING_SIDE: u32 = 512;

/// Most bytes of thumbnails that are kept.
const CACHE_BYTES_MAX: usize = 64 << 20;

/// Thumbnails that were drawn; the oldest make room. An example's mesh never changes, so they never grow stale.
#[derive(Default)]
pub struct Thumbnails(Mutex<Drawn>);

/// An example, the side of its picture, and the segment that stands out.
type Drawing = (ExampleId, u32, Option<u32>);

#[derive(Default)]
struct Drawn {
    pictures: HashMap<Drawing, Bytes>,
    order: VecDeque<Drawing>,
    bytes: usize,
}

impl Thumbnails {
    fn lock(&self) -> MutexGuard<'_, Drawn> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn get(&self, of: Drawing) -> Option<Bytes> {
        self.lock().pictures.get(&of).cloned()
    }

    fn put(&self, of: Drawing, picture: &Bytes) {
        let mut drawn = self.lock();
        if drawn.pictures.insert(of, picture.clone()).is_some() {
            return;
        }
        drawn.bytes += picture.len();
        drawn.order.push_back(of);
        while drawn.bytes > CACHE_BYTES_MAX {
            let Some(oldest) = drawn.order.pop_front() else { return };
            let freed = drawn.pictures.remove(&oldest).map_or(0, |picture| picture.len());
            drawn.bytes -= freed;
        }
    }
}

/// An example, shaded, with its quads; a segment of it may stand out.
///
/// # Errors
/// What is not there, the size, refusals of the pool.
pub async fn thumbnail(
    work: &Arc<Work>,
    caller: Caller,
    id: ExampleId,
    (size, segment): (u32, Option<u32>),
) -> Result<Bytes, WorkError> {
    let size = checked(size)?;
    let example = work.catalogue.example(id)?;
    let (of, count) = ("the example", example.segments.len());
    if let Some(segment) = segment.filter(|segment| *segment as usize >= count) {
        return Err(WorkError::NoSuchSegment { of, count, segment });
    }
    // A whole stands out from nothing.
    let is_whole =
        |segment: &u32| example.segments.get(*segment as usize).is_none_or(|s| s.faces >= example.counts.faces);
    let segment = segment.filter(|segment| !is_whole(segment));
    if let Some(drawn) = work.thumbnails.get((id, size, segment)) {
        return Ok(drawn);
    }
    let job =
        work.admit(caller.user, work.engine.memory_estimate(example.bytes) + drawing_bytes(size), REQUEST_TIME_MAX)?;
    // Behind what people wait for: a page asks for many at once.
    let model = ingest::model(work, &job, Lane::Fine, &example).await?;
    let engine = Arc::clone(&work.engine);
    let draw = move |_: &_| -> Result<Vec<u8>, WorkError> {
        let view = View::guess(&model.mesh);
        Ok(match segment {
            None => render(&model.mesh, &view, size).to_png(),
            Some(segment) => {
                // Marks of the rest would hide what is meant.
                let view = View { paint: Paint::Segment(segment.into()), poles: Poles::Unmarked, ..view };
                render(&*engine.labelled_by_segment(&model)?, &view, size).to_png()
            }
        })
    };
    let picture = Bytes::from(work.pool.run(&job, Lane::Fine, draw).await??);
    work.thumbnails.put((id, size, segment), &picture);
    Ok(picture)
}

/// A mesh, shaded, with its quads.
///
/// # Errors
/// The size, refusals of the pool.
pub async fn preview(work: &Arc<Work>, user: User, mesh: &Arc<PolyMesh>, size: u32) -> Result<Bytes, WorkError> {
    let size = checked(size)?;
    let job = work.admit(user, drawing_bytes(size), REQUEST_TIME_MAX)?;
    let mesh = Arc::clone(mesh);
    let draw = move |_: &_| render(&mesh, &View::guess(&mesh), size).to_png();
    let picture = work.pool.run(&job, Lane::Edit, draw).await?;
    Ok(work.hold(user, picture.len() as u64)?.held(picture))
}

/// λ of a segment at a level, with its features.
///
/// # Errors
/// What is not there, the level, refusals of the pool.
pub async fn encoding(
    work: &Arc<Work>,
    caller: Caller,
    id: ExampleId,
    segment: u32,
    level: u32,
) -> Result<Bytes, WorkError> {
    if !LEVELS.contains(&level) {
        return Err(WorkError::parameter("level", "one of 32, 64, 128, 256, 512", level));
    }
    let example = work.catalogue.example(id)?;
    let (of, count) = ("the example", example.segments.len());
    if segment as usize >= count {
        return Err(WorkError::NoSuchSegment { of, count, segment });
    }
    let job = work.admit(caller.user, drawing_bytes(ENCODING_SIDE), REQUEST_TIME_MAX)?;
    let this = Arc::clone(work);
    let draw = move |_: &_| -> Result<Bytes, WorkError> {
        let packed = this.corpus.encoding(id, segment, level)?;
        let pixels = packed.levels.iter().find(|(side, _)| *side == level).map_or(&[][..], |(_, pixels)| pixels);
        let features: Vec<[f64; 2]> = packed.features.iter().map(|f| f.uv).collect();
        let picture = encoding_picture(pixels, level as usize, &features, ENCODING_SIDE / level);
        Ok(picture.to_png().into())
    };
    work.pool.run(&job, Lane::Edit, draw).await?
}

/// Memory that drawing a picture of `side` pixels takes: colour and depth, four samples a pixel, and the file.
fn drawing_bytes(side: u32) -> u64 {
    u64::from(side) * u64::from(side) * 4 * (4 * 4 + 8)
}

fn checked(size: u32) -> Result<u32, WorkError> {
    if (SIDE_MIN..=SIDE_MAX).contains(&size) {
        return Ok(size);
    }
    Err(WorkError::parameter("size", format!("from {SIDE_MIN} to {SIDE_MAX}"), size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_thumbnails_make_room() {
        let thumbnails = Thumbnails::default();
        let picture = Bytes::from(vec![0; CACHE_BYTES_MAX / 4]);
        let ids: Vec<ExampleId> = (0..6).map(|_| ExampleId::generate()).collect();
        ids.iter().for_each(|id| thumbnails.put((*id, 64, None), &picture));
        let kept: Vec<bool> = ids.iter().map(|id| thumbnails.get((*id, 64, None)).is_some()).collect();
        assert_eq!(kept, [false, false, true, true, true, true]);
        assert_eq!(thumbnails.get((ids[5], 32, None)), None);
        assert_eq!(thumbnails.get((ids[5], 64, Some(1))), None);
        assert_eq!(thumbnails.lock().bytes, CACHE_BYTES_MAX);
    }
}
