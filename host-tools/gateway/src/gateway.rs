//! The gateway: one thread that receives from all boxes, one that judges, one for the broker.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline_bedside::keys::{KnownBox, Store};
use plumbline_files::BadInput;
use plumbline_stream::transport::Udp;

use crate::broker::Courier;
use crate::commands::{self, Asked};
use crate::judge::Judge;
use crate::notices::Notices;
use crate::outbox::Outbox;
use crate::overview::Overview;
use crate::settings::{Recorded, Settings};
use crate::teller::gateway_state;
use crate::topics::Topics;
use crate::ward::Ward;

/// At the end, what is waited for is looked at this often.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// At the end, the broker gets what waits within this time; what is kept on the disk stays there.
const LEAVES_WITHIN: Duration = Duration::from_secs(3);

/// For each box, so many trials can wait for their verdict.
const WAITING_PER_BOX: usize = 4;

/// A gateway that runs.
pub struct Gateway {
    overview: Arc<Mutex<Overview>>,
    notices: Arc<Notices>,
    outbox: Arc<Outbox>,
    stop: Arc<AtomicBool>,
    hurry: Arc<AtomicBool>,
    leave: Arc<AtomicBool>,
    ward: Option<JoinHandle<()>>,
    broker: Option<JoinHandle<()>>,
    boxes: Vec<KnownBox>,
}

impl Gateway {
    /// Starts it, for all boxes whose keys are known on this computer.
    ///
    /// # Errors
    /// When there is no key, or the folder, the address or a box that is named cannot be used.
    pub fn start(settings: Settings) -> Result<Self, BadInput> {
        let notices = Arc::<Notices>::default();
        let store = Store::open()?;
        let known = store.all()?;
        for refused in &known.refused {
            notices.say(format!("warning: {refused}"));
        }
        let known = known.known;
        if known.is_empty() {
            return Err(BadInput::whole(
                store.folder().display(),
                "no key of a box is known here, and a box talks to nobody else",
                "bring the keys of the ward's boxes with `plumb keys import`",
            ));
        }
        let always = always(&store, &settings.record, &known)?;
        let udp = Udp::bind(settings.udp)?;
        plumbline_files::make_directory(&settings.folder)?;
        let outbox = Outbox::open(settings.folder.join("outbox"), Arc::clone(&notices))?;
        let outbox = Arc::new(outbox);
        let topics = Topics::new(&settings.ward);
        let [stop, hurry, leave]: [Arc<AtomicBool>; 3] = Default::default();
        let judge = Judge::start(
            settings.folder.join("due"),
            topics.clone(),
            (Arc::clone(&outbox), Arc::clone(&notices)),
            settings.names,
            WAITING_PER_BOX * known.len(),
            Arc::clone(&hurry),
        )?;
        let (sender, asked) = sync_channel(commands::WAITING_MAX);
        let overview = Arc::new(Mutex::new(Overview {
            boxes: Vec::new(),
            standing: outbox.standing(),
            broker: outbox.counts(),
            waiting: outbox.waiting(),
            trials_begun: 0,
            trials_judged: 0,
            trials_waiting: 0,
            datagrams_unknown: 0,
            datagrams_dropped: 0,
            datagrams_dropped_by_system: None,
        }));
        let broker = courier(&settings, &topics, &outbox, &notices, &leave, sender).start()?;
        let boxes = known.clone();
        let ward = Ward {
            known,
            always,
            asked,
            topics,
            judge,
            settings,
            store,
            outbox: Arc::clone(&outbox),
            notices: Arc::clone(&notices),
            overview: Arc::clone(&overview),
            stop: Arc::clone(&stop),
        };
        let ward = std::thread::Builder::new()
            .name("ward".to_owned())
            .spawn(move || ward.run(udp))
            .map_err(|error| BadInput::io("a thread for the boxes", &error))?;
        let (ward, broker) = (Some(ward), Some(broker));
        Ok(Self { overview, notices, outbox, stop, hurry, leave, ward, broker, boxes })
    }

    /// The boxes whose keys it knows.
    #[must_use]
    pub fn boxes(&self) -> &[KnownBox] {
        &self.boxes
    }

    /// How everything is.
    #[must_use]
    pub fn overview(&self) -> Overview {
        self.overview.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What has happened since the last call.
    #[must_use]
    pub fn take_notices(&self) -> Vec<String> {
        self.notices.take()
    }

    /// It is to end: trials are ended, judged and kept.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// It is to end at once: what has no verdict yet gets one after the next start.
    pub fn hurry(&self) {
        self.hurry.store(true, Ordering::Relaxed);
    }

    /// Whether everything has ended but the connection to the broker.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.ward.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Gives the broker what waits, says goodbye to it, and waits for the end of everything.
    pub fn end(&mut self) {
        self.stop();
        if let Some(ward) = self.ward.take() {
            // A thread that has panicked has said so.
            let _ = ward.join();
        }
        let Some(broker) = self.broker.take() else { return };
        let give_up = Instant::now() + LEAVES_WITHIN;
        let is_up = || matches!(self.outbox.standing(), crate::outbox::Standing::Up(_));
        while is_up() && !self.outbox.is_empty() && Instant::now() < give_up {
            std::thread::sleep(LOOK_EVERY);
        }
        self.leave.store(true, Ordering::Relaxed);
        self.outbox.leave();
        while !broker.is_finished() && Instant::now() < give_up + LEAVES_WITHIN {
            std::thread::sleep(LOOK_EVERY);
        }
        if broker.is_finished() {
            let _ = broker.join();
        }
    }
}

impl Drop for Gateway {
    fn drop(&mut self) {
        self.hurry();
        self.end();
    }
}

/// The places of the boxes that are recorded always.
fn always(store: &Store, record: &Recorded, known: &[KnownBox]) -> Result<Vec<usize>, BadInput> {
    match record {
        Recorded::None => Ok(Vec::new()),
        Recorded::All => Ok((0..known.len()).collect()),
        Recorded::These(names) => {
            let mut places = Vec::new();
            for name in names {
                let found = store.find(name)?;
                places.extend(known.iter().position(|it| it.key == found.key));
            }
            Ok(places)
        }
    }
}

fn courier(
    settings: &Settings,
    topics: &Topics,
    outbox: &Arc<Outbox>,
    notices: &Arc<Notices>,
    leave: &Arc<AtomicBool>,
    sender: SyncSender<Asked>,
) -> Courier {
    let will = gateway_state("offline", None, &[]);
    Courier {
        settings: settings.broker.clone(),
        client_id: format!("plumbline-gateway-{}", settings.ward),
        topics: topics.clone(),
        will,
        outbox: Arc::clone(outbox),
        notices: Arc::clone(notices),
        asked: settings.commands.then_some(sender),
        stop: Arc::clone(leave),
    }
}
