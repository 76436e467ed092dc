//! Ending a long run in good order.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use plumbline::packet::Message;
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;
use plumbline_stream::transport::{Event, Transport};

/// Ctrl-C, a request to end, and a terminal that is closed.
#[cfg(unix)]
const SIGNALS: &[i32] =
    &[signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP];

/// Ctrl-C and a request to end. Windows ends a program whose console is closed without asking it.
#[cfg(not(unix))]
const SIGNALS: &[i32] = &[signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM];

/// A flag that is set by Ctrl-C, by a request to end, and by a terminal that is closed.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>, BadInput> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in SIGNALS {
        signal_hook::flag::register(*signal, Arc::clone(&stop))
            .map_err(|error| BadInput::whole("Ctrl-C", error, "report it: it can be handled"))?;
    }
    Ok(stop)
}

/// A link on which nobody waits for the box any longer once `stop` is set: its waits end with an error.
/// So the program ends in good order, and the box hears of it. Setting the cell ends this.
pub fn until_stopped(link: BoxLink, stop: &Arc<AtomicBool>) -> (BoxLink, Rc<Cell<bool>>) {
    let (place, kind) = (link.place().to_owned(), link.kind());
    let is_over = Rc::<Cell<bool>>::default();
    let (stop, inner) = (Arc::clone(stop), link.into_transport());
    let transport = UntilStopped { inner, stop, is_over: Rc::clone(&is_over) };
    (BoxLink::new(Box::new(transport), place, kind), is_over)
}

struct UntilStopped {
    inner: Box<dyn Transport>,
    stop: Arc<AtomicBool>,
    is_over: Rc<Cell<bool>>,
}

impl Transport for UntilStopped {
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
        if self.stop.load(Ordering::Relaxed) && !self.is_over.get() {
            return Err(BadInput::whole("Ctrl-C", "the program was ended", "start it again"));
        }
        self.inner.poll(take)
    }

    fn send(&mut self, message: &Message) {
        self.inner.send(message);
    }

    fn is_missing(&self) -> bool {
        self.inner.is_missing()
    }

    fn obstacle(&self) -> Option<(String, String)> {
        self.inner.obstacle()
    }

    fn dropped_here(&self) -> Option<u64> {
        self.inner.dropped_here()
    }
}
