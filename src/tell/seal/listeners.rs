//! Who listens to a box: some programs, each in its place until it has left.

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use super::Peer;
use super::channel::Channel;
use super::resends::Resends;

/// Most programs that listen at the same time.
pub const LISTENERS_MAX: usize = 4;

/// Longest name of a program that listens.
pub const CALLER_NAME_BYTES_MAX: usize = 32;

/// A listener that has been silent for this long gives its place to another program if there is no
/// other. Hosts send something twice a second.
pub(super) const SILENT_NS: u64 = 3_000_000_000;

/// A listener that has been silent for this long has left: longer than a host can be cut off and
/// still get what it has missed.
const LEFT_NS: u64 = 120_000_000_000;

/// The program that listens.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Caller {
    /// Drawn at random by the program when it starts: by it a listener is known again after another
    /// handshake.
    pub process: u32,
    /// What it is, and on which computer, for people.
    pub name: String<CALLER_NAME_BYTES_MAX>,
}

/// One listener, as long as it listens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ListenerId {
    /// Which of the [`LISTENERS_MAX`] places it has.
    pub place: usize,
    /// How many listeners had joined before.
    joined: u32,
}

#[derive(Debug)]
pub(super) struct Listener {
    joined: u32,
    pub(super) peer: Peer,
    pub(super) caller: Caller,
    pub(super) channel: Channel,
    pub(super) heard_ns: u64,
    pub(super) records: bool,
    /// Every such pose is sent, none for 0.
    every: u16,
    /// Poses since the last one that was sent.
    passed: u16,
    pub(super) resends: Resends,
}

impl Listener {
    /// Every such pose is for this listener from now on.
    pub(super) fn send_poses(&mut self, every: u16) {
        if self.every != every {
            (self.every, self.passed) = (every, 0);
        }
    }

    /// Whether the next pose is for this listener; counts it.
    pub(super) fn takes_pose(&mut self) -> bool {
        self.passed = self.passed.saturating_add(1);
        let is_due = self.every > 0 && self.passed >= self.every;
        if is_due {
            self.passed = 0;
        }
        is_due
    }
}

/// All who listen.
#[derive(Debug)]
pub(super) struct Listeners {
    places: [Option<Listener>; LISTENERS_MAX],
    /// How many have joined.
    joined: u32,
}

impl Listeners {
    pub(super) fn new() -> Self {
        Self { places: [const { None }; LISTENERS_MAX], joined: 0 }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Listener> {
        self.places.iter().flatten()
    }

    pub(super) fn get_mut(&mut self, id: ListenerId) -> Option<&mut Listener> {
        self.places.get_mut(id.place)?.as_mut().filter(|it| it.joined == id.joined)
    }

    pub(super) fn ids(&self) -> Vec<(ListenerId, Peer), LISTENERS_MAX> {
        let present = self.places.iter().enumerate().filter_map(|(place, listener)| {
            let listener = listener.as_ref()?;
            Some((ListenerId { place, joined: listener.joined }, listener.peer))
        });
        present.collect()
    }

    /// The listener whose channel a packet is of.
    pub(super) fn of_channel(
        &mut self,
        peer: Peer,
        session: u16,
    ) -> Option<(ListenerId, &mut Listener)> {
        self.places.iter_mut().enumerate().find_map(|(place, listener)| {
            let listener = listener.as_mut()?;
            let id = ListenerId { place, joined: listener.joined };
            (listener.peer == peer && listener.channel.session() == session)
                .then_some((id, listener))
        })
    }

    /// Whether somebody at this address has been heard in the last seconds.
    pub(super) fn hears(&self, peer: Peer, now_ns: u64) -> bool {
        self.iter().any(|it| it.peer == peer && now_ns.saturating_sub(it.heard_ns) < SILENT_NS)
    }

    /// Frees the place of a program that leaves, if it has one.
    pub(super) fn leave(&mut self, process: u32) {
        self.retain(|it| it.caller.process != process);
    }

    /// Forgets those who have left without a word.
    pub(super) fn pass(&mut self, now_ns: u64) {
        self.retain(|it| now_ns.saturating_sub(it.heard_ns) < LEFT_NS);
    }

    /// Gives a place to a program that has shown that it has the key: its own, if it has one, a free
    /// one, or that of one that is silent. `None` if there is none.
    pub(super) fn join(
        &mut self,
        peer: Peer,
        caller: &Caller,
        channel: &Channel,
        now_ns: u64,
    ) -> Option<ListenerId> {
        // At one address there is one program; any other was there before.
        self.retain(|it| it.peer != peer || it.caller.process == caller.process);
        for (place, listener) in self.places.iter_mut().enumerate() {
            if let Some(listener) = listener
                && listener.caller.process == caller.process
            {
                // After another handshake what it has asked for goes on.
                (listener.peer, listener.heard_ns) = (peer, now_ns);
                listener.channel = channel.clone();
                return Some(ListenerId { place, joined: listener.joined });
            }
        }
        let heard_ns = |place: &Option<Listener>| place.as_ref().map(|it| it.heard_ns);
        // A free one comes before all others.
        let place = (0..LISTENERS_MAX).min_by_key(|&place| heard_ns(&self.places[place]))?;
        if heard_ns(&self.places[place]).is_some_and(|then| now_ns.saturating_sub(then) < SILENT_NS)
        {
            return None;
        }
        self.joined = self.joined.wrapping_add(1);
        self.places[place] = Some(Listener {
            joined: self.joined,
            peer,
            caller: caller.clone(),
            channel: channel.clone(),
            heard_ns: now_ns,
            records: false,
            every: 1,
            passed: 0,
            resends: Resends::default(),
        });
        Some(ListenerId { place, joined: self.joined })
    }

    fn retain(&mut self, mut is_kept: impl FnMut(&Listener) -> bool) {
        for place in &mut self.places {
            if place.as_ref().is_some_and(|it| !is_kept(it)) {
                *place = None;
            }
        }
    }
}
