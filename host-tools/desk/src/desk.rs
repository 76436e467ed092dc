//! The desk: its stations, its studies and what it remembers.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::thread::{self, JoinHandle};

use plumbline_bedside::keys::{KnownBox, Store};
use plumbline_files::BadInput;
use plumbline_files::text::printable;
use plumbline_publish::Ways;
use plumbline_publish::lsl::Lsl;

use crate::cards;
use crate::hub::Hub;
use crate::marks::{MarkBoard, MarkSettings, MarkSources};
use crate::memory::Memory;
use crate::porter::{Known, Porter, Strangers};
use crate::station::{Around, Reach, Refusal, Shared, Station};
use crate::wire::{BoxState, DeskState, LinkState, NewBox, Problem, State};
use crate::words::on_page;

/// The ids of boxes on serial lines begin with it.
const SERIAL_ID: &str = "serial-";

/// What the desk is to do.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Where studies and photographs are kept; it is made where there is none.
    pub folder: PathBuf,
    /// Where boxes announce themselves to this computer.
    pub udp: Vec<SocketAddr>,
    /// Serial lines with a box, and their rates.
    pub serial: Vec<(String, u32)>,
    /// What this program is called at boxes.
    pub program: String,
    /// Streams for other programs.
    pub ways: Ways,
    /// The library of the Lab Streaming Layer, where it is needed.
    pub lsl: Option<Lsl>,
    /// Marks of other programs.
    pub marks: MarkSettings,
}

/// The desk.
pub struct Desk {
    /// Its clock and its news.
    pub hub: Arc<Hub>,
    /// What it remembers.
    pub memory: Arc<Memory>,
    /// Where studies and photographs are kept.
    pub folder: PathBuf,
    /// Where boxes announce themselves.
    pub udp: Vec<SocketAddr>,
    computer: String,
    around: Around,
    stations: RwLock<Vec<Arc<Station>>>,
    known: Arc<Known>,
    strangers: Arc<Strangers>,
    problems: Mutex<Vec<BadInput>>,
    streams: Mutex<Vec<String>>,
    /// One box is made after the other.
    making: Mutex<()>,
    threads: Mutex<Vec<JoinHandle<()>>>,
    mark_sources: MarkSources,
    /// Whether boxes are only shown: another part of the program has them.
    only_shows: bool,
}

impl Desk {
    /// A desk that shows these boxes, which another part of the program has: nothing is done with them from
    /// its page. [`show`](Self::show) says how they are.
    ///
    /// # Errors
    /// When the folder cannot be used.
    pub fn showing(folder: PathBuf, boxes: &[KnownBox]) -> Result<Self, BadInput> {
        let desk = Self::set_up(Settings { folder, ..Settings::default() }, true)?;
        let stations = boxes.iter().map(|it| {
            let (id, number) = (it.key.id().to_string(), it.serial_number.clone());
            let shared = Shared::new(Arc::clone(&desk.hub), id, name_of(it), number);
            Arc::new(Station::shown(Arc::new(shared)))
        });
        *desk.stations.write().unwrap_or_else(PoisonError::into_inner) = stations.collect();
        Ok(desk)
    }

    /// Changes what is shown of a box.
    pub fn show(&self, id: &str, change: impl FnOnce(&mut BoxState)) {
        if let Some(station) = self.station(id) {
            station.shared.update(change);
        }
    }

    /// Whether boxes are only shown.
    #[must_use]
    pub fn only_shows(&self) -> bool {
        self.only_shows
    }

    /// Starts the stations of all boxes whose keys are known here.
    ///
    /// # Errors
    /// When the folder, the keys or a source of marks cannot be used.
    pub fn start(settings: Settings) -> Result<Self, BadInput> {
        let serial = settings.serial.clone();
        let known = Store::open()?.all()?;
        let desk = Self::set_up(settings, false)?;
        desk.problems.lock().unwrap_or_else(PoisonError::into_inner).splice(0..0, known.refused);
        let several = known.known.len() + serial.len() > 1;
        for it in &known.known {
            desk.add_known(it, several)?;
        }
        for (at, (device, baud)) in serial.iter().enumerate() {
            let id = format!("{SERIAL_ID}{}", at + 1);
            let shared = Shared::new(Arc::clone(&desk.hub), id, device.clone(), None);
            let reach = Reach::Serial { device: device.clone(), baud: *baud };
            desk.add(Arc::new(shared), reach, several)?;
        }
        Ok(desk)
    }

    /// Everything but the boxes.
    fn set_up(settings: Settings, only_shows: bool) -> Result<Self, BadInput> {
        plumbline_files::make_directory(&settings.folder)?;
        let folder = settings
            .folder
            .canonicalize()
            .map_err(|error| BadInput::io(settings.folder.display(), &error))?;
        let hub = Arc::new(Hub::new());
        let memory = Arc::new(Memory::open(&folder)?);
        let board = Arc::new(MarkBoard::default());
        let mut threads = Vec::new();
        let (mark_sources, marks) =
            MarkSources::open(&settings.marks, settings.lsl, settings.ways.lsl.as_deref())?;
        if let Some(marks) = marks {
            let (hub, board) = (Arc::clone(&hub), Arc::clone(&board));
            threads.push(named("marks", move || board.follow(&marks, &hub))?);
        }
        let mut problems = Vec::new();
        let strangers = Arc::new(Strangers::default());
        let by_key = Arc::new(Known::default());
        for address in &settings.udp {
            let porter = Porter::bind(
                *address,
                Arc::clone(&by_key),
                Arc::clone(&strangers),
                Arc::clone(&hub),
            );
            match porter {
                Ok(porter) => threads.push(named("porter", move || {
                    // A socket that can be bound can be read.
                    let _ = porter.run();
                })?),
                // Boxes that were met before are called where they were.
                Err(error) => problems.push(error),
            }
        }
        Ok(Self {
            hub,
            memory: Arc::clone(&memory),
            folder: folder.clone(),
            udp: settings.udp,
            computer: plumbline_bedside::link::this_computer(),
            streams: Mutex::new(settings.ways.warnings().iter().map(|it| on_page(it)).collect()),
            around: Around {
                folder,
                program: settings.program,
                ways: settings.ways,
                lsl: settings.lsl,
                marks: board,
                memory,
            },
            stations: RwLock::default(),
            known: by_key,
            strangers,
            problems: Mutex::new(problems),
            making: Mutex::default(),
            threads: Mutex::new(threads),
            mark_sources,
            only_shows,
        })
    }

    /// Looks for a box whose key is known here.
    fn add_known(&self, known: &KnownBox, several: bool) -> Result<(), BadInput> {
        let id = known.key.id();
        let (name, number) = (name_of(known), known.serial_number.clone());
        let shared = Arc::new(Shared::new(Arc::clone(&self.hub), id.to_string(), name, number));
        shared.show_card(cards::is_waiting(&self.folder, known));
        self.known.add(id, Arc::clone(&shared));
        self.add(shared, Reach::Udp(id.to_string()), several)
    }

    /// Starts a station; of several, each has streams of its own.
    fn add(&self, shared: Arc<Shared>, reach: Reach, several: bool) -> Result<(), BadInput> {
        let mut stations = self.stations.write().unwrap_or_else(PoisonError::into_inner);
        let name = shared.state().name;
        let ways = ways_of(&self.around.ways, several.then(|| (stations.len(), name.clone())));
        let words = ways_in_words(&ways, &name);
        self.streams.lock().unwrap_or_else(PoisonError::into_inner).extend(words);
        let around = Around { ways, ..self.around.clone() };
        stations.push(Arc::new(Station::start(shared, reach, around)?));
        Ok(())
    }

    /// Makes a new box, and looks for it from now on; its id.
    ///
    /// # Errors
    /// As [`cards::make`].
    pub fn make_box(&self, asked: &NewBox) -> Result<String, Refusal> {
        let _one = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        let known = cards::make(&self.folder, asked)?;
        let id = known.key.id().to_string();
        match self.station(&id) {
            Some(station) => station.shared.update(|state| state.name = name_of(&known)),
            None => {
                let several = !self.stations().is_empty();
                self.add_known(&known, several)?;
            }
        }
        self.hub.changed();
        Ok(id)
    }

    fn stations(&self) -> Vec<Arc<Station>> {
        self.stations.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The station of a box.
    #[must_use]
    pub fn station(&self, id: &str) -> Option<Arc<Station>> {
        self.stations().into_iter().find(|it| it.shared.id() == id)
    }

    /// The box with which a session of a study goes on.
    #[must_use]
    pub fn box_of_session(&self, study: &str, session: &str) -> Option<String> {
        let stations = self.stations();
        let states = stations.iter().map(|it| it.shared.state());
        let mut of = states.filter_map(|it| Some((it.session?, it.id)));
        of.find(|(open, _)| open.study == study && open.name == session).map(|(_, id)| id)
    }

    /// The whole state now.
    #[must_use]
    pub fn state(&self) -> State {
        let version = self.hub.version();
        let mut boxes: Vec<BoxState> = self.stations().iter().map(|it| it.shared.state()).collect();
        let is_away = |it: &BoxState| matches!(it.link, LinkState::Searching { .. });
        // A box at the end of a cable is not looked for in the network as well.
        let on_a_line: Vec<String> = boxes
            .iter()
            .filter(|it| it.id.starts_with(SERIAL_ID))
            .filter_map(|it| it.serial_number.clone())
            .collect();
        boxes.retain(|it| {
            let is_there = it.serial_number.as_ref().is_some_and(|it| on_a_line.contains(it));
            it.id.starts_with(SERIAL_ID) || !is_away(it) || !is_there
        });
        boxes.sort_by(|one, other| {
            (is_away(one), &one.name, &one.id).cmp(&(is_away(other), &other.name, &other.id))
        });
        let latest_study = self.memory.latest_study();
        let latest_study = latest_study.filter(|it| crate::studies::open(&self.folder, it).is_ok());
        State {
            version,
            now_ms: self.hub.now_ms(),
            desk: DeskState {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                folder: self.folder.display().to_string(),
                computer: self.computer.clone(),
                pages: self.hub.pages.load(std::sync::atomic::Ordering::Relaxed),
                problems: self.problems().into_iter().map(Problem::from).collect(),
                streams: self.streams.lock().unwrap_or_else(PoisonError::into_inner).clone(),
                studies_version: self.hub.studies_version(),
                latest_study,
            },
            boxes,
            strangers: self.strangers.list(),
        }
    }

    /// The name of this computer.
    #[must_use]
    pub fn computer(&self) -> &str {
        &self.computer
    }

    /// What a user of the command line should know.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        self.problems().iter().map(ToString::to_string).collect()
    }

    fn problems(&self) -> Vec<BadInput> {
        let mut all = self.problems.lock().unwrap_or_else(PoisonError::into_inner).clone();
        all.extend(self.mark_sources.amiss());
        all
    }

    /// Ends everything, and waits for that: a recording that goes on is ended properly.
    pub fn stop(&self) {
        self.hub.stop.store(true, std::sync::atomic::Ordering::Relaxed);
        self.stations().iter().for_each(|it| it.join());
        let mut threads = self.threads.lock().unwrap_or_else(PoisonError::into_inner);
        for thread in threads.drain(..) {
            // A thread that has panicked has said so.
            let _ = thread.join();
        }
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        self.stop();
    }
}

/// What a box that was not heard yet is called: its number stands beside it.
fn name_of(known: &KnownBox) -> String {
    known.name.as_deref().map_or_else(|| known.title(), |name| printable(name).into_owned())
}

fn named(name: &str, run: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, BadInput> {
    let thread = thread::Builder::new().name(name.to_owned()).spawn(run);
    thread.map_err(|error| BadInput::io(format!("a thread: {name}"), &error))
}

/// The ways out of one box: of several, each has names and ports of its own.
fn ways_of(ways: &Ways, of_several: Option<(usize, String)>) -> Ways {
    let Some((at, name)) = of_several else { return ways.clone() };
    let further = |address: SocketAddr| {
        let at = u16::try_from(at).unwrap_or(u16::MAX);
        let port = if address.port() == 0 { 0 } else { address.port().saturating_add(at) };
        SocketAddr::new(address.ip(), port)
    };
    let letters = name.chars().filter(|it| it.is_alphanumeric() || " -_".contains(*it));
    let name: String = letters.collect();
    Ways {
        lsl: ways.lsl.as_ref().map(|it| format!("{it} {}", name.trim())),
        json: ways.json.map(further),
        osc: ways.osc.map(further),
    }
}

fn ways_in_words(ways: &Ways, name: &str) -> Vec<String> {
    let lsl = ways.lsl.as_ref().map(|it| format!("{name}: Lab Streaming Layer, stream {it:?}"));
    let json = ways.json.map(|it| format!("{name}: lines of JSON at {it}"));
    let osc = ways.osc.map(|it| format!("{name}: OSC to {it}"));
    [lsl, json, osc].into_iter().flatten().collect()
}
