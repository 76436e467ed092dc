//! The thread that receives from all boxes: it hands each what has come for it, carries out commands, and
//! tells how everything is.

use std::cell::RefCell;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use plumbline::seal::KeyId;
use plumbline_bedside::keys::{KnownBox, Store};
use plumbline_stream::transport::{self, Link, Memory, Udp};

use crate::bed::{Around, Bed};
use crate::commands::{Asked, Command};
use crate::judge::Judge;
use crate::notices::Notices;
use crate::outbox::Outbox;
use crate::overview::Overview;
use crate::post::Post;
use crate::settings::Settings;
use crate::teller::Teller;
use crate::topics::{Topics, levels};

/// The longest wait for datagrams, and between two turns of a box: so often what is missing is asked for.
const TURN_EVERY: Duration = Duration::from_millis(20);

/// At the end, trials wait no longer than this for what was lost on the way.
const ENDS_WITHIN: Duration = Duration::from_secs(5);

/// What the receiving thread has.
pub(crate) struct Ward {
    pub known: Vec<KnownBox>,
    pub always: Vec<usize>,
    pub asked: Receiver<Asked>,
    pub topics: Topics,
    pub judge: Judge,
    pub settings: Settings,
    pub store: Store,
    pub outbox: Arc<Outbox>,
    pub notices: Arc<Notices>,
    pub overview: Arc<Mutex<Overview>>,
    pub stop: Arc<AtomicBool>,
}

/// Where a link's box is, for the post and for the store.
struct Met {
    at: Rc<RefCell<Option<SocketAddr>>>,
    store: SyncSender<(KeyId, SocketAddr)>,
}

impl Memory for Met {
    fn met_at(&mut self, key_id: KeyId, address: SocketAddr) {
        *self.at.borrow_mut() = Some(address);
        // The store is a convenience: a box that is not noted announces itself.
        let _ = self.store.try_send((key_id, address));
    }

    fn take_start(&mut self, _: KeyId, _: u32) -> bool {
        // Lines without a way back are serial ones.
        false
    }
}

impl Ward {
    /// Receives until it is told to stop.
    pub fn run(self, udp: Udp) {
        let addresses: Vec<_> = self.known.iter().map(|it| (it.key.id(), it.address)).collect();
        let mut post = Post::new(udp, &addresses);
        let levels = levels(&self.known);
        let (noted, note) = sync_channel(2 * self.known.len());
        let beds = self.beds(&levels, &mut post, &noted);
        let around = Around {
            trials: self.settings.folder.join("trials"),
            due: self.settings.folder.join("due"),
            judge: self.judge,
            notices: Arc::clone(&self.notices),
            lasts: self.settings.lasts,
            place: format!("UDP {}", self.settings.udp),
        };
        // A disk may take its time, and nothing waits for it here.
        let noting = std::thread::spawn({
            let (store, notices) = (self.store, self.notices);
            move || note_addresses(&store, &note, &notices)
        });
        let outbox = Arc::clone(&self.outbox);
        let teller =
            Teller::new(self.topics, self.outbox, self.overview, self.settings.every, levels);
        teller.arrive();
        let mut round = Round {
            post,
            beds,
            around,
            teller,
            outbox,
            asked: self.asked,
            sweep_at: Instant::now(),
            ends_at: None,
        };
        while round.goes_on(&self.stop) {}
        round.leave();
        drop(noted);
        let _ = noting.join();
    }

    /// All boxes, each with its link.
    fn beds(
        &self,
        levels: &[String],
        post: &mut Post,
        noted: &SyncSender<(KeyId, SocketAddr)>,
    ) -> Vec<Bed> {
        let mut beds = Vec::with_capacity(levels.len());
        for (place, (level, it)) in levels.iter().zip(&self.known).enumerate() {
            let met = Rc::<RefCell<_>>::default();
            let memory = Met { at: Rc::clone(&met), store: noted.clone() };
            let the_box =
                transport::KnownBox { name: it.title(), key: it.key.clone(), address: it.address };
            let link = Link::new(post.letterbox(place), vec![the_box], &self.settings.program);
            let link = link.remembering(Box::new(memory));
            let mut bed = Bed::new(level.clone(), it, link, met);
            bed.records_always = self.always.contains(&place);
            beds.push(bed);
        }
        beds
    }
}

/// The work that is done again and again.
struct Round {
    post: Post,
    beds: Vec<Bed>,
    around: Around,
    teller: Teller,
    outbox: Arc<Outbox>,
    asked: Receiver<Asked>,
    /// When every box has its turn, whether something came for it or not.
    sweep_at: Instant,
    /// The end is not waited for any longer than until then.
    ends_at: Option<Instant>,
}

impl Round {
    /// Takes what has come, and does what is due; whether there will be another round.
    fn goes_on(&mut self, stop: &AtomicBool) -> bool {
        let touched = self.post.poll(TURN_EVERY).unwrap_or_else(|error| {
            self.around.notices.say(format!("error: {error}"));
            stop.store(true, Ordering::Relaxed);
            Vec::new()
        });
        let now = Instant::now();
        let places = if now >= self.sweep_at { self.sweep(now) } else { touched };
        for place in places {
            if let Some(address) = self.beds[place].turn(&self.around) {
                self.post.heard(place, address, now);
            }
        }
        self.teller.tell(&mut self.beds, &self.post, &self.around, now);
        !(stop.load(Ordering::Relaxed) && self.has_ended(now))
    }

    /// What is due now and then; returns the places of all boxes.
    fn sweep(&mut self, now: Instant) -> Vec<usize> {
        self.sweep_at = now + TURN_EVERY;
        for words in self.post.take_notices() {
            self.around.notices.say(words);
        }
        for one in self.asked.try_iter() {
            carry_out(one, &mut self.beds, &self.around, &self.outbox);
        }
        (0..self.beds.len()).collect()
    }

    /// Has every trial end; whether all have, or were waited for long enough.
    fn has_ended(&mut self, now: Instant) -> bool {
        let give_up = *self.ends_at.get_or_insert_with(|| {
            for bed in &mut self.beds {
                bed.records_always = false;
                bed.stop();
            }
            now + ENDS_WITHIN
        });
        now >= give_up || self.beds.iter().all(|it| it.trial().is_none())
    }

    /// Boxes are told, and trials that are still open are cut off: they are judged after the next start.
    fn leave(mut self) {
        self.teller.leave(&mut self.beds);
        drop(self.beds);
        let counts = Arc::clone(&self.around.judge.counts);
        self.around.judge.end();
        self.teller.judged(&counts);
    }
}

fn note_addresses(store: &Store, note: &Receiver<(KeyId, SocketAddr)>, notices: &Notices) {
    for (id, address) in note {
        if let Err(error) = store.note_address(id, address) {
            notices.say(format!("warning: where a box is was not noted: {error}"));
        }
    }
}

/// Carries out a command.
fn carry_out(asked: Asked, beds: &mut [Bed], around: &Around, outbox: &Outbox) {
    let Some(bed) = beds.iter_mut().find(|it| it.level == asked.level) else {
        return asked.refuse(outbox, "no such box", "the gateway's state lists those it knows");
    };
    match asked.command.clone() {
        Command::Start { name, seconds } => {
            let lasts = Command::lasts(seconds, around.lasts);
            match bed.start(name, lasts, around) {
                Ok(trial) => {
                    around.notices.say(format!("{}: trial {trial} begins, by command", bed.level));
                    asked.done(outbox, &trial);
                }
                Err((found, remedy)) => asked.refuse(outbox, &found, &remedy),
            }
        }
        Command::Stop { trial } => {
            let is_other = trial.is_some() && trial.as_deref() != bed.trial();
            if bed.trial().is_none() || is_other {
                return asked.refuse(
                    outbox,
                    "that trial is not being recorded",
                    "see the box's state",
                );
            }
            // Whoever stops a box that is always recorded does not want the next trial either.
            bed.records_always = false;
            if let Some(trial) = bed.stop() {
                asked.done(outbox, &trial);
            }
        }
    }
}
