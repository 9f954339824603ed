//! More clients than the service has capacity for: what it still gets done, and how quickly it refuses the rest.

use super::{Did, saturate};
use crate::{scale::ScaleError, server::Server};
use std::{
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

/// What is done is counted in windows of this length.
const WINDOW: Duration = Duration::from_secs(5);

/// What came of it.
#[derive(Clone, Debug)]
pub struct Flood {
    /// Queries that ended in each window.
    pub windows: Vec<usize>,
    /// What the clients did.
    pub did: Did,
}

impl Flood {
    /// Queries a second.
    pub fn per_second(&self) -> f64 {
        self.windows.iter().sum::<usize>() as f64 / (self.windows.len() as f64 * WINDOW.as_secs_f64())
    }
}

/// Keeps `clients` sending queries for so long.
///
/// # Errors
/// [`ScaleError`].
pub fn measure(server: &Server, mesh: &[u8], clients: usize, time: Duration) -> Result<Flood, ScaleError> {
    let over = AtomicBool::new(false);
    let begun = Instant::now();
    let did = thread::scope(|scope| {
        let clients = saturate(scope, (server, mesh), clients, &over, &|_: &str| ());
        thread::sleep(time);
        over.store(true, Ordering::Relaxed);
        clients.map(Did::all)
    });
    let did = did.map_err(|source| ScaleError::Io { doing: "start a thread".into(), source })?;
    let mut windows = vec![0; (time.as_secs_f64() / WINDOW.as_secs_f64()) as usize];
    for ended in &did.ended {
        let at = (ended.duration_since(begun).as_secs_f64() / WINDOW.as_secs_f64()) as usize;
        if let Some(count) = windows.get_mut(at) {
            *count += 1;
        }
    }
    Ok(Flood { windows, did })
}
