//! A way out: a thread, and the bounded queue before it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

use crate::item::Item;

/// The items that can wait: a minute of a camera of 60 Hz, and a gap of a minute filled at once.
const WAITING_MAX: usize = 8192;

/// One way out.
pub(crate) struct Feed {
    name: &'static str,
    /// `None` once nothing more comes.
    sender: Option<SyncSender<Item>>,
    dropped: Arc<AtomicU64>,
    thread: Option<JoinHandle<Vec<String>>>,
}

impl Feed {
    /// Starts the thread; it ends when its queue does, and says then what there is to say.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(crate) fn start(
        name: &'static str,
        run: impl FnOnce(Receiver<Item>) -> Vec<String> + Send + 'static,
    ) -> std::io::Result<Self> {
        let (sender, items) = sync_channel(WAITING_MAX);
        let thread = thread::Builder::new().name(name.to_owned()).spawn(move || run(items))?;
        Ok(Self { name, sender: Some(sender), dropped: Arc::default(), thread: Some(thread) })
    }

    /// Hands over an item; where there is no room it is dropped and counted.
    pub(crate) fn push(&self, item: Item) {
        let Some(sender) = &self.sender else { return };
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = sender.try_send(item) {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Ends it; what there is to say of it.
    pub(crate) fn finish(&mut self) -> Vec<String> {
        drop(self.sender.take());
        let mut said = Vec::new();
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked has said so.
            said.extend(thread.join().unwrap_or_default());
        }
        let dropped = self.dropped.load(Ordering::Relaxed);
        if dropped > 0 {
            let name = self.name;
            said.push(format!("warning: {name}: {dropped} frames and marks were not published: this computer was too slow"));
        }
        said
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.finish();
    }
}
