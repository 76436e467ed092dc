//! The update as a state machine: every step from every state that it can be in, tried with the real one
//! on a card in files, against what is obviously right.
//!
//! - A box runs from a slot with a whole system, whatever was cut, forged or damaged.
//! - What chooses names the slot that runs, or ran before a trial; only a trial that was passed changes it.
//! - The slot that runs is never written to; what is tried is what was signed.

use std::collections::{HashMap, HashSet, VecDeque};

use plumbline::packet::{UPDATE_PART_BYTES_MAX, UpdateStep};
use plumbline_test_support::{evidence, is_emulated};
use plumbline_update::card::{SECTOR_BYTES, Slot};
use plumbline_update::chooser;
use plumbline_update::header::slot_hash;

use super::tests::{Bench, HOST, file, header, state};
use super::*;

/// Two sectors are enough to be cut between.
const SLOT: usize = 2 * SECTOR_BYTES;

/// What may happen to a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Event {
    /// A host begins to send.
    Begins,
    /// The head of a good update comes, or one that was changed.
    Head,
    ForgedHead,
    /// The first sector of its slot comes; then the other, or another one.
    First,
    Rest,
    OtherRest,
    /// A host asks for the trial.
    Tries,
    /// The session sees frames and a host, or nothing.
    SeesAll,
    SeesNothing,
    /// The box gives the trial up by itself.
    GivesUp,
    /// It restarts as it wants to: as it should, without the power on the way, or with a key that cannot
    /// be read.
    Restarts,
    RestartsWithoutPower,
    RestartsWithoutKey,
    /// The power is cut, or the watchdog resets it; so it happens between the choice and the note.
    Cut,
    CutAfterChoice,
    /// Likewise, and the card has lost the note.
    CutAndNoteLost,
}

const EVENTS: [Event; 16] = [
    Event::Begins,
    Event::Head,
    Event::ForgedHead,
    Event::First,
    Event::Rest,
    Event::OtherRest,
    Event::Tries,
    Event::SeesAll,
    Event::SeesNothing,
    Event::GivesUp,
    Event::Restarts,
    Event::RestartsWithoutPower,
    Event::RestartsWithoutKey,
    Event::Cut,
    Event::CutAfterChoice,
    Event::CutAndNoteLost,
];

/// What is in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum System {
    /// What was there first.
    Old,
    /// The update.
    New,
    /// Something of both.
    Torn,
}

/// How much of an update has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Come {
    Nothing,
    Begun,
    Head,
    First,
    All,
    Unusable,
}

/// What became of the last one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Became {
    Trying,
    Installed,
    Failed,
}

/// A box and its card.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Model {
    chosen: Slot,
    running: Slot,
    /// Whether it runs for this start only.
    is_on_trial: bool,
    /// Whether what it has shown still counts, and whether it has its key.
    has_to_show: bool,
    has_key: bool,
    slots: [System; 2],
    come: Come,
    /// On the card, and as it is known: of the update in this slot.
    note: Option<(Slot, Became)>,
    known: Option<(Slot, Became)>,
    /// Whether it wants to restart, and then to try.
    restarts_to_try: Option<bool>,
}

impl Model {
    fn new() -> Self {
        Self {
            chosen: Slot::A,
            running: Slot::A,
            is_on_trial: false,
            has_to_show: false,
            has_key: true,
            slots: [System::Old; 2],
            come: Come::Nothing,
            note: None,
            known: None,
            restarts_to_try: None,
        }
    }

    /// What an event leaves; `None` where it cannot happen.
    fn after(self, event: Event) -> Option<Self> {
        let idle = self.running.other() as usize;
        let mut next = self;
        match (event, self.come) {
            // Nothing may be written to what it goes back to, nor to what is about to be tried.
            (Event::Begins, _) if !self.is_on_trial && self.restarts_to_try.is_none() => {
                next.come = Come::Begun;
            }
            (Event::Head, Come::Begun) => next.come = Come::Head,
            (Event::ForgedHead, Come::Begun) => next.come = Come::Unusable,
            (Event::First, Come::Head) => {
                (next.come, next.slots[idle]) = (Come::First, System::Torn);
            }
            (Event::Rest, Come::First) => (next.come, next.slots[idle]) = (Come::All, System::New),
            (Event::OtherRest, Come::First) => next.come = Come::Unusable,
            (Event::Tries, Come::All) => {
                next.note = Some((self.running.other(), Became::Trying));
                (next.known, next.restarts_to_try) = (next.note, Some(true));
            }
            (Event::SeesAll, _) if self.has_to_show && self.has_key => {
                next.chosen = self.running;
                (next.is_on_trial, next.has_to_show) = (false, false);
                next.becomes(Became::Installed);
            }
            (Event::SeesAll | Event::SeesNothing, _) if self.has_to_show && !self.has_key => {
                next.fails();
            }
            (Event::GivesUp, _) if self.is_on_trial => next.fails(),
            (Event::Restarts, _) => next.starts(self.restarts_to_try?, true),
            (Event::RestartsWithoutKey, _) => next.starts(self.restarts_to_try?, false),
            (Event::RestartsWithoutPower, _) => {
                self.restarts_to_try?;
                next.starts(false, true);
            }
            (Event::Cut, _) => next.starts(false, true),
            (Event::CutAfterChoice, _) if self.has_to_show && self.has_key => {
                next.chosen = self.running;
                next.starts(false, true);
            }
            (Event::CutAfterChoice, _) => return None,
            (Event::CutAndNoteLost, _) => {
                next.note = None;
                next.starts(false, true);
            }
            _ => {}
        }
        Some(next)
    }

    fn becomes(&mut self, became: Became) {
        // What nobody remembers is not noted either.
        if let Some((slot, _)) = self.known {
            self.known = Some((slot, became));
            self.note = self.known;
        }
    }

    fn fails(&mut self) {
        (self.has_to_show, self.restarts_to_try) = (false, Some(false));
        self.becomes(Became::Failed);
    }

    fn starts(&mut self, is_try: bool, has_key: bool) {
        self.running = if is_try { self.chosen.other() } else { self.chosen };
        (self.is_on_trial, self.has_to_show, self.has_key) = (is_try, is_try, has_key || !is_try);
        (self.come, self.restarts_to_try) = (Come::Nothing, None);
        // Only a start that is no trial can tell what became of one.
        self.known = self.note.map(|(slot, became)| match became {
            Became::Trying if is_try => (slot, became),
            Became::Trying if slot == self.running => (slot, Became::Installed),
            Became::Trying => (slot, Became::Failed),
            _ => (slot, became),
        });
    }

    /// What it says of itself.
    fn says(&self) -> UpdateState {
        let next = |sectors: usize| UpdateState::Receiving {
            next: (HEADER_BYTES + sectors * SECTOR_BYTES) as u32,
        };
        match (self.come, self.known) {
            _ if self.has_to_show => UpdateState::OnTrial,
            (Come::Begun, _) => UpdateState::Receiving { next: 0 },
            (Come::Head, _) => next(0),
            (Come::First, _) => next(1),
            (Come::All, _) => UpdateState::Ready,
            (Come::Unusable, _) => UpdateState::Unusable,
            (Come::Nothing, None) => UpdateState::None,
            (Come::Nothing, Some((_, Became::Failed))) => UpdateState::GivenUp,
            (Come::Nothing, Some(_)) => UpdateState::Installed,
        }
    }

    /// Whether a host that asks is told that it is done.
    fn does(&self, event: Event) -> bool {
        match event {
            Event::Begins => !self.is_on_trial && self.restarts_to_try.is_none(),
            Event::Tries => self.come == Come::All,
            _ => true,
        }
    }
}

/// The real one.
struct Real {
    bench: Bench,
    updates: Updates,
    update: std::vec::Vec<u8>,
}

impl Real {
    fn new() -> Self {
        let mut bench = Bench::with_slots_of(SLOT);
        let slot: std::vec::Vec<u8> = (0..SLOT).map(|at| (at % 251) as u8).collect();
        let head = Header { slot_bytes: SLOT as u32, slot_hash: slot_hash(&slot), ..header() };
        let updates = bench.start_with(true);
        Self { bench, updates, update: file(&head, &slot) }
    }

    /// Whether what was asked is done.
    fn does(&mut self, event: Event) -> bool {
        match event {
            Event::Begins => return self.asks(UpdateStep::Begin { is_forced: false }),
            Event::Tries => return self.asks(UpdateStep::Try { is_forced: false }),
            Event::Head => self.comes(0, HEADER_BYTES, |_| {}),
            Event::ForgedHead => self.comes(0, HEADER_BYTES, |bytes| bytes[80] ^= 1),
            Event::First => self.comes(HEADER_BYTES, SECTOR_BYTES, |_| {}),
            Event::Rest => self.comes(HEADER_BYTES + SECTOR_BYTES, SECTOR_BYTES, |_| {}),
            Event::OtherRest => {
                self.comes(HEADER_BYTES + SECTOR_BYTES, SECTOR_BYTES, |bytes| bytes[7] ^= 1);
            }
            Event::SeesAll => drop(self.updates.look_after(trial::FRAMES, true)),
            Event::SeesNothing => drop(self.updates.look_after(0, false)),
            Event::GivesUp => self.updates.give_up("a test wants it"),
            Event::Restarts => self.restarts(true),
            Event::RestartsWithoutKey => self.restarts(false),
            Event::CutAfterChoice => {
                let card = self.updates.card.as_ref().expect("it has a card");
                card.slots.commit().expect("a disk");
                self.cut();
            }
            Event::CutAndNoteLost => {
                let _ = fs::remove_file(self.bench.path("update.txt"));
                self.cut();
            }
            Event::Cut | Event::RestartsWithoutPower => self.cut(),
        }
        true
    }

    fn asks(&mut self, step: UpdateStep) -> bool {
        let outcome = self.updates.answer(HOST, step, None).expect("an answer");
        matches!(outcome, UpdateOutcome::State { .. })
    }

    /// Bytes of the update come, in parts; then it is looked at until nothing is being checked.
    fn comes(&mut self, from: usize, bytes: usize, change: impl Fn(&mut [u8])) {
        let mut bytes = self.update[from..from + bytes].to_vec();
        change(&mut bytes);
        for (index, part) in bytes.chunks(UPDATE_PART_BYTES_MAX).enumerate() {
            let offset = (from + index * UPDATE_PART_BYTES_MAX) as u32;
            let bytes = part.iter().copied().collect();
            assert_eq!(self.updates.answer(HOST, UpdateStep::Part { offset, bytes }, None), None);
        }
        let give_up = Instant::now() + std::time::Duration::from_secs(60);
        while state(&self.updates).0 == UpdateState::Checking {
            assert!(Instant::now() < give_up, "it is never checked");
            std::thread::sleep(std::time::Duration::from_micros(200));
            self.updates.look_after(0, false);
        }
    }

    fn restarts(&mut self, has_key: bool) {
        if self.updates.leave() == Some(Leave::ToTry) {
            self.bench.flag.ask_for_try();
        }
        self.updates = self.bench.start_with(has_key);
    }

    fn cut(&mut self) {
        self.bench.flag.lose_power();
        self.updates = self.bench.start_with(true);
    }

    fn assert_is(&self, model: &Model, way: &dyn std::fmt::Debug) {
        assert_eq!(state(&self.updates).0, model.says(), "{way:?}");
        let leave =
            model.restarts_to_try.map(|to_try| if to_try { Leave::ToTry } else { Leave::ToGiveUp });
        assert_eq!(self.updates.leave(), leave, "{way:?}");
        let slots = &self.updates.card.as_ref().expect("it has a card").slots;
        assert_eq!(
            (slots.running, slots.is_on_trial),
            (model.running, model.is_on_trial),
            "{way:?}"
        );
        let sector = fs::read(self.bench.path("chooser")).expect("a file");
        assert_eq!(chooser::chosen(&sector), Some(model.chosen), "{way:?}");
        for (index, name) in ["a", "b"].into_iter().enumerate() {
            let system = fs::read(self.bench.path(name)).expect("a file");
            let is_it = match model.slots[index] {
                System::Old => system == vec![name.as_bytes()[0]; SLOT],
                System::New => system == self.update[HEADER_BYTES..],
                System::Torn => index != model.running as usize,
            };
            assert!(is_it, "{name} is not {:?}: {way:?}", model.slots[index]);
        }
    }
}

/// Where each event leads from each state that can be reached.
fn graph() -> HashMap<Model, std::vec::Vec<(Event, Model)>> {
    let mut graph = HashMap::new();
    let mut new = vec![Model::new()];
    while let Some(model) = new.pop() {
        if graph.contains_key(&model) {
            continue;
        }
        let steps = EVENTS.into_iter().filter_map(|it| Some((it, model.after(it)?)));
        let steps: std::vec::Vec<_> = steps.collect();
        new.extend(steps.iter().map(|(_, next)| *next));
        graph.insert(model, steps);
    }
    graph
}

/// The shortest way from a state over a step that has not been tried, if there is one.
fn way_to_new(
    graph: &HashMap<Model, std::vec::Vec<(Event, Model)>>,
    tried: &HashSet<(Model, Event)>,
    from: Model,
) -> Option<std::vec::Vec<(Event, Model)>> {
    let mut seen = HashSet::from([from]);
    let mut ways = VecDeque::from([(from, std::vec::Vec::new())]);
    while let Some((at, way)) = ways.pop_front() {
        for &(event, next) in &graph[&at] {
            let mut way = way.clone();
            way.push((event, next));
            if !tried.contains(&(at, event)) {
                return Some(way);
            }
            if seen.insert(next) {
                ways.push_back((next, way));
            }
        }
    }
    None
}

#[test]
fn every_step_from_every_state_is_as_it_must_be() {
    let graph = graph();
    let steps: usize = graph.values().map(std::vec::Vec::len).sum();
    // A box that is never without a system that it can start from.
    for model in graph.keys() {
        assert_ne!(model.slots[model.chosen as usize], System::Torn, "{model:?}");
        assert_ne!(model.slots[model.running as usize], System::Torn, "{model:?}");
    }
    // In an emulator each takes ten times as long.
    let most = if is_emulated() { steps / 10 } else { steps };
    let mut tried = HashSet::new();
    let mut boxes = 0;
    while tried.len() < most {
        boxes += 1;
        let (mut real, mut at) = (Real::new(), Model::new());
        real.assert_is(&at, &"at first");
        let before = tried.len();
        while tried.len() < most
            && let Some(way) = way_to_new(&graph, &tried, at)
        {
            for (event, next) in way {
                let way = (at, event);
                assert_eq!(real.does(event), at.does(event), "{way:?}");
                real.assert_is(&next, &way);
                tried.insert((at, event));
                at = next;
            }
        }
        assert!(tried.len() > before, "some states cannot be reached");
    }
    evidence(
        "updates of a box: every step (parts, forgeries, trials, restarts, cuts of the power) from every \
         state that it can be in",
        &format!("{} states, {} steps, {boxes} cards", graph.len(), tried.len()),
        "each led where it must; the box always ran from a whole system, and tried none but a signed one",
    );
}
