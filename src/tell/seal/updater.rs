//! The host that updates a box: one at a time.

use super::Peer;
use super::channel::Channel;
use super::listeners::Caller;

/// A host that has been silent for this long gives its place to another. Hosts ask twice a second.
const SILENT_NS: u64 = 3_000_000_000;

/// Which program updates the box: the number that it has drawn at its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UpdaterId(pub u32);

/// The host that updates the box.
#[derive(Debug)]
pub(super) struct Updater {
    pub(super) peer: Peer,
    pub(super) caller: Caller,
    pub(super) channel: Channel,
    pub(super) heard_ns: u64,
}

impl Updater {
    pub(super) fn id(&self) -> UpdaterId {
        UpdaterId(self.caller.process)
    }

    /// Whether another program may take its place.
    pub(super) fn yields_to(&self, caller: &Caller, now_ns: u64) -> bool {
        self.caller.process == caller.process || now_ns.saturating_sub(self.heard_ns) >= SILENT_NS
    }
}
