//! Ctrl-C: what the service still makes for this program is cancelled before the program ends.

use crate::{api::Api, error::EXIT_INTERRUPTED};
use std::{process, thread, time::Duration};

/// How long the service may take to cancel.
const CANCELS_WITHIN: Duration = Duration::from_secs(2);

/// Waits for Ctrl-C beside the command, cancels what is unfinished, and ends the program.
///
/// The wait has a thread of its own, so that a command that waits for a line or for the disk can be interrupted, too. Where
/// the signal cannot be awaited, it ends the program as it would have without this.
pub(crate) fn watch(api: &Api) {
    let api = api.clone();
    let waiting = move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
        if runtime.block_on(tokio::signal::ctrl_c()).is_err() {
            return;
        }
        let cancelled = async { tokio::time::timeout(CANCELS_WITHIN, api.cancel_unfinished()).await };
        // Nobody is left to be told that the service did not answer.
        let _ = runtime.block_on(cancelled);
        process::exit(i32::from(EXIT_INTERRUPTED));
    };
    // Without the thread, Ctrl-C does what it always does.
    let _ = thread::Builder::new().name("interrupt".into()).spawn(waiting);
}
