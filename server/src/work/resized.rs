//! Results with more or fewer rows of quads than their examples have, made for whoever downloads them.

use super::engine::{Model, Resized, SizeTarget, faces_within_max};
use super::{REQUEST_TIME_MAX, Work, WorkError, ingest};
use crate::pool::{Lane, User};
use bytes::Bytes;
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_proto::MeshFormat;
use std::sync::Arc;

/// Memory that resizing takes for each face, and for each face of the scan.
const MEMORY_PER_FACE: u64 = 800;

/// A mesh in the size that is wanted, as a file; with its faces, and its distance from the scan in % of that one's diagonal.
///
/// # Errors
/// Refusals of the format and of the pool.
pub async fn file(
    work: &Arc<Work>,
    user: User,
    (scan, mesh): (&Arc<Model>, &Arc<PolyMesh>),
    wanted: SizeTarget,
    format: MeshFormat,
) -> Result<(Bytes, u64, f64), WorkError> {
    let own = mesh.faces.len();
    let most = match wanted {
        SizeTarget::Quads(count) => own.max(count),
        SizeTarget::Within(_) => faces_within_max(own),
    };
    let faces = (most + scan.mesh.faces.len()) as u64;
    let job = work.admit(user, faces * MEMORY_PER_FACE, REQUEST_TIME_MAX)?;
    let (engine, scan, from) = (Arc::clone(&work.engine), Arc::clone(scan), Arc::clone(mesh));
    let made = work.pool.run(&job, Lane::Lay, move |stop| engine.resized(&scan, &from, wanted, stop)).await??;
    let Resized { mesh, within } = made;
    let (faces, mesh) = (mesh.faces.len() as u64, Arc::new(mesh));
    Ok((ingest::mesh_file(work, user, &mesh, format).await?, faces, 100.0 * within))
}
