//! Marks of other programs and devices, for whichever boxes are recorded.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Mutex, PoisonError};

use plumbline_bedside::recording::marks::{self, MarkFrom, Strangers, Uncounted};
use plumbline_bedside::recording::modem_line::{self, ModemLine, Watch};
use plumbline_files::BadInput;
use plumbline_publish::lsl::Lsl;
use plumbline_publish::lsl::markers::Markers;
use plumbline_publish::lsl::outlet::MARKS_SUFFIX;
use plumbline_trial::mark::{Mark, MarkSender, Marks, Source};

use crate::hub::Hub;

/// Marks wait no longer than this; each has the time at which it was made.
const EVERY: std::time::Duration = std::time::Duration::from_millis(20);

/// Where marks of other programs and devices come from.
#[derive(Debug, Clone, Default)]
pub struct MarkSettings {
    /// Datagrams to this address.
    pub udp: Option<SocketAddr>,
    /// The computers whose datagrams count, beside this one.
    pub from: Vec<MarkFrom>,
    /// Lines from this serial device.
    pub serial: Option<String>,
    /// Each time this modem line of a serial device is asserted.
    pub line: Option<ModemLine>,
    /// The markers of this stream of the Lab Streaming Layer.
    pub lsl: Option<String>,
}

/// The sources of marks, for as long as the desk runs.
pub struct MarkSources {
    strangers: Strangers,
    watch: Option<Watch>,
    markers: Option<Markers>,
}

impl MarkSources {
    /// Listens to what is named; the marks that come, if any source is named. `own` is the desk's stream
    /// of the Lab Streaming Layer.
    ///
    /// # Errors
    /// When an address, a device or a stream cannot be used.
    pub fn open(
        settings: &MarkSettings,
        lsl: Option<Lsl>,
        own: Option<&str>,
    ) -> Result<(Self, Option<Marks>), BadInput> {
        let MarkSettings { udp, from, serial, line, lsl: name } = settings;
        let is_any = udp.is_some() || serial.is_some() || line.is_some() || name.is_some();
        let (sender, marks, strangers) = marks::listen(*udp, from, serial.as_deref())?;
        let watch = line.as_ref().map(|line| modem_line::watch(line, &sender)).transpose()?;
        let markers = match (name, lsl) {
            (Some(name), Some(library)) => Some(markers(library, name, own, sender)?),
            _ => None,
        };
        Ok((Self { strangers, watch, markers }, is_any.then_some(marks)))
    }

    /// What did not count until now.
    pub fn amiss(&self) -> Vec<BadInput> {
        let refused = self.markers.as_ref().map_or(0, Markers::refused);
        let (strangers, watch) = (self.strangers.clone(), self.watch.clone());
        Uncounted { strangers, watch, refused }.amiss()
    }
}

/// The markers of a stream, which is not the desk's own.
fn markers(
    library: Lsl,
    name: &str,
    own: Option<&str>,
    sender: MarkSender,
) -> Result<Markers, BadInput> {
    if own.is_some_and(|own| name == format!("{own}{MARKS_SUFFIX}")) {
        return Err(BadInput::whole(
            format!("--mark-lsl {name}"),
            "is the stream in which the marks of this desk are published",
            "name another program's stream",
        ));
    }
    let take = move |at, label: &str| sender.send(at, Mark::new(Source::Lsl, label));
    Markers::of(library, name, take)
}

/// The recordings that go on, by the ids of their boxes.
#[derive(Debug, Default)]
pub struct MarkBoard {
    takers: Mutex<HashMap<String, MarkSender>>,
}

impl MarkBoard {
    /// A recording takes marks from now on.
    pub fn take(&self, box_id: &str, sender: MarkSender) {
        self.lock().insert(box_id.to_owned(), sender);
    }

    /// It is over.
    pub fn forget(&self, box_id: &str) {
        self.lock().remove(box_id);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<String, MarkSender>> {
        self.takers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands a mark to every recording.
    fn mark(&self, at: std::time::Instant, mark: &Mark) {
        self.lock().retain(|_, sender| sender.send(at, mark.clone()));
    }

    /// Hands on what comes, until the desk ends. Marks while nothing is recorded belong to no trial.
    pub fn follow(&self, marks: &Marks, hub: &Hub) {
        while !hub.is_over() {
            while let Some((at, mark)) = marks.next() {
                self.mark(at, &mark);
            }
            std::thread::sleep(EVERY);
        }
    }
}
