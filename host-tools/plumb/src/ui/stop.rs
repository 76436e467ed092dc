//! Ending a long run in good order.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use plumbline_files::BadInput;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// A flag that is set by Ctrl-C, by a request to end, and by a terminal that is closed.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>, BadInput> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|error| BadInput::whole("Ctrl-C", error, "report it: it can be handled"))?;
    }
    Ok(stop)
}
