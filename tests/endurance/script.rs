//! What happens in front of the camera and to it, frame by frame: chosen at random, and the same for
//! the same seed, so that whoever plays it and whoever judges the box have each their own copy.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::show::{Kinds, RATE_HZ};

/// Frames from one happening to the next.
const UNDISTURBED: std::ops::RangeInclusive<u32> = 100..=1500;

/// Frames in which a target may be searched for after something has happened.
pub const SETTLING: u32 = 30;

/// What can happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Happening {
    /// Somebody puts the cap on the lens.
    LensCap,
    /// Nobody is there but a board that is none of the box's targets.
    Stranger,
    /// Frames never come, and the person moves on meanwhile.
    Dropout,
    /// The light is another one: dimmer, with a haze.
    Relit,
    /// The camera is lost, and comes back later.
    Loss,
}

impl Happening {
    /// Those that come of themselves; losses are as many as asked for.
    const BY_CHANCE: [Self; 4] = [Self::LensCap, Self::Stranger, Self::Dropout, Self::Relit];
}

/// The light in the room, as what it makes of each grey level.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    gain: f32,
    offset: f32,
}

impl Light {
    /// A picture in this light.
    pub fn show(self, picture: &[u8], relit: &mut [u8]) {
        let table: [u8; 256] =
            std::array::from_fn(|grey| (self.gain * grey as f32 + self.offset) as u8);
        for (to, &from) in relit.iter_mut().zip(picture) {
            *to = table[usize::from(from)];
        }
    }
}

/// One frame.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    /// Of the show.
    pub picture: usize,
    /// If not as rendered.
    pub light: Option<Light>,
    /// Which frame of the person it is, if the person is there.
    pub person: Option<usize>,
    /// Whether nothing has happened for [`SETTLING`] frames, so that both targets must be measured.
    pub is_settled: bool,
    /// How many frames never came before it.
    pub missed: u32,
    /// Whether the camera was lost before it.
    pub is_lost: bool,
    /// On the camera's clock.
    pub time_ns: u64,
}

/// The frames, without end.
#[derive(Debug, Clone)]
pub struct Script {
    random: ChaCha8Rng,
    kinds: Kinds,
    /// One loss in each block of this many frames.
    loss_every: Option<u64>,
    loss_at: u64,
    index: u64,
    /// Frames on the camera's clock.
    time: u64,
    /// What is happening, and for how many more frames; or, undisturbed, until when.
    now: Option<Happening>,
    left: u32,
    light: Light,
    /// Frames since something has happened.
    since: u32,
    /// How often each has happened.
    happened: [u64; 5],
    /// Frames that never came.
    pub missed: u64,
}

impl Script {
    pub fn new(seed: u64, kinds: Kinds, loss_every: Option<u64>) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let left = random.random_range(UNDISTURBED);
        Self {
            random,
            kinds,
            loss_every,
            loss_at: 0,
            index: 0,
            time: 0,
            now: None,
            left,
            light: Light { gain: 1.0, offset: 0.0 },
            since: 0,
            happened: [0; 5],
            missed: 0,
        }
    }

    pub fn happened(&self, what: Happening) -> u64 {
        self.happened[what as usize]
    }

    fn count(&mut self, what: Happening) {
        self.happened[what as usize] += 1;
        self.since = 0;
    }

    /// Ends what is happening, or lets something happen; the number of frames that never came.
    fn turn(&mut self) -> u32 {
        if self.now.take().is_some() {
            self.since = 0;
            self.left = self.random.random_range(UNDISTURBED);
            return 0;
        }
        let what = Happening::BY_CHANCE[self.random.random_range(0..Happening::BY_CHANCE.len())];
        self.count(what);
        let frames = match what {
            Happening::LensCap => 5..=240,
            Happening::Stranger => 5..=120,
            Happening::Relit => 60..=600,
            Happening::Dropout | Happening::Loss => {
                self.left = self.random.random_range(UNDISTURBED);
                let missed = self.random.random_range(2..=90);
                self.missed += u64::from(missed);
                return missed;
            }
        };
        self.now = Some(what);
        self.left = self.random.random_range(frames);
        let gain = self.random.random_range(0.35..1.0);
        self.light = Light { gain, offset: self.random.random_range(0.0..25.0) };
        0
    }

    /// Whether the camera is lost before the frame of this number.
    fn loses(&mut self) -> bool {
        let Some(every) = self.loss_every else { return false };
        if self.index.is_multiple_of(every) {
            // Not before the first frame of all: a camera must be there to be lost.
            self.loss_at = self.index + self.random.random_range(1..every);
        }
        self.index == self.loss_at
    }
}

impl Iterator for Script {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
        let mut missed = 0;
        if self.left == 0 {
            missed = self.turn();
        }
        self.left -= 1;
        let is_lost = self.loses();
        let mut away = 0;
        if is_lost {
            self.count(Happening::Loss);
            away = self.random.random_range(10..200);
        }
        self.time += u64::from(missed) + away;
        let hidden = matches!(self.now, Some(Happening::LensCap | Happening::Stranger));
        let frame = frame_of(self.time, self.kinds.person);
        let Kinds { person, dark, strange } = self.kinds;
        let picture = match self.now {
            Some(Happening::LensCap) => person + self.random.random_range(0..dark),
            Some(Happening::Stranger) => person + dark + self.random.random_range(0..strange),
            _ => frame,
        };
        let step = Step {
            picture,
            light: (self.now == Some(Happening::Relit)).then_some(self.light),
            person: (!hidden).then_some(frame),
            is_settled: !hidden && self.since >= SETTLING,
            missed,
            is_lost,
            time_ns: self.time * 1_000_000_000 / RATE_HZ,
        };
        self.index += 1;
        self.time += 1;
        self.since = if hidden { 0 } else { self.since.saturating_add(1) };
        Some(step)
    }
}

/// Forwards and backwards in turn, so that the motion has no jump of its own.
fn frame_of(time: u64, count: usize) -> usize {
    let turn = (time % (2 * count as u64 - 2)) as usize;
    turn.min(2 * count - 2 - turn)
}
