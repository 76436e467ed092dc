//! A recording as a proof needs it: in which of its frames each board was seen, and why not in the
//! others.

use std::fmt::Display;

use plumbline::config::Config;
use plumbline::lens::Lens;
use plumbline::packet::{MeasuredPose, PosePacket};
use plumbline::report::NoPose;
use plumbline::target::TargetGeometry;
use plumbline_bedside::missing::{self, Missing};
use plumbline_evidence::sighting::Sighting;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;

/// A board that is covered for a shorter time is being handled.
const GONE_S: f64 = 2.0;

/// One recording.
pub struct Recording {
    /// Its name.
    pub place: String,
    /// Its camera.
    pub lens: Lens,
    /// The number of its frames.
    pub frames: usize,
    /// The boards that were looked for.
    pub boards: Vec<Board>,
    /// The time of the last frame.
    until_s: f64,
}

/// A board in a recording.
pub struct Board {
    /// Its name.
    pub name: String,
    /// Its geometry.
    pub geometry: TargetGeometry,
    /// In each frame: seen, or not.
    pub seen: Vec<Option<Sighting>>,
    /// Frames without a pose, by the reason.
    without: Vec<(NoPose, usize)>,
    /// Why it has not been seen since it was seen last.
    lately: Option<NoPose>,
}

impl Board {
    fn new(name: &str, geometry: &TargetGeometry) -> Self {
        Self {
            name: name.to_owned(),
            geometry: geometry.clone(),
            seen: Vec::new(),
            without: Vec::new(),
            lately: None,
        }
    }

    /// One more frame, in which it was found or not.
    pub fn take(&mut self, found: Result<Sighting, NoPose>) {
        if let Err(why) = found {
            match self.without.iter_mut().find(|(known, _)| *known == why) {
                Some((_, frames)) => *frames += 1,
                None => self.without.push((why, 1)),
            }
        }
        match found {
            Ok(_) => self.lately = None,
            Err(NoPose::Searching) => {}
            Err(why) => self.lately = Some(why),
        }
        self.seen.push(found.ok());
    }

    /// When it was seen last; the time of the first frame where it never was.
    fn last_seen_s(&self) -> f64 {
        self.seen.iter().rev().flatten().next().map_or(0.0, |it| it.time_s)
    }

    /// The frames in which it was seen.
    #[must_use]
    pub fn sightings(&self) -> Vec<Sighting> {
        self.seen.iter().flatten().copied().collect()
    }

    /// The number of them.
    #[must_use]
    pub fn count(&self) -> usize {
        self.seen.iter().flatten().count()
    }

    /// Why it was not seen in most of the other frames, and what to do.
    fn trouble(&self, is_other_seen: bool) -> (String, &'static str) {
        let longer = "record for longer";
        match missing::most(self.without.iter().copied()) {
            Some((why, frames)) => {
                let missing = Missing::new(why, is_other_seen);
                let words = format!("{} in {frames}", missing.words());
                (words, missing.remedy().unwrap_or(longer))
            }
            None => ("no frame".to_owned(), longer),
        }
    }
}

impl Recording {
    /// One without frames, with the camera and the targets of a configuration.
    pub fn new(place: impl Display, config: &Config) -> Self {
        Self {
            place: place.to_string(),
            lens: config.lens,
            frames: 0,
            boards: config.targets.iter().map(|it| Board::new(&it.name, &it.geometry)).collect(),
            until_s: 0.0,
        }
    }

    /// One more frame, as a box has sent it, and its time.
    pub fn take(&mut self, frame_time_s: f64, packet: &PosePacket) {
        for board in &mut self.boards {
            let role = board.geometry.role();
            let sent = packet.targets.iter().find(|it| it.role == role);
            let pose = sent.map_or(Err(NoPose::Searching), |it| it.pose);
            board.take(pose.map(|it| sighting(frame_time_s, &it)));
        }
        self.until_s = frame_time_s;
        self.frames += 1;
    }

    /// The board of this name or, if none is given, the one that was seen most often.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn chosen(&self, name: Option<&str>) -> Result<&Board, BadInput> {
        name.map_or_else(|| Ok(self.by_sightings()[0]), |name| self.named(name))
    }

    /// The two boards of these names or, if none are given, those that were seen most often.
    ///
    /// # Errors
    /// When there are no two.
    pub fn chosen_pair(&self, names: Option<&[String; 2]>) -> Result<[&Board; 2], BadInput> {
        let boards = match names {
            Some(names) => names.iter().map(|it| self.named(it)).collect::<Result<Vec<_>, _>>()?,
            None => self.by_sightings(),
        };
        let [first, second, ..] = boards[..] else {
            return Err(BadInput::whole(
                &self.place,
                format!("only one board, {:?}, is looked for, and two are needed", boards[0].name),
                "describe both boards of the plate in the targets file: `plumb target --standard` \
                 prints two, and writes it",
            ));
        };
        Ok([first, second])
    }

    /// As [`chosen`](Self::chosen).
    ///
    /// # Errors
    /// Also when it was never seen.
    pub fn board(&self, name: Option<&str>) -> Result<&Board, BadInput> {
        self.seen(self.chosen(name)?)
    }

    /// As [`chosen_pair`](Self::chosen_pair).
    ///
    /// # Errors
    /// Also when one of them was never seen.
    pub fn pair(&self, names: Option<&[String; 2]>) -> Result<[&Board; 2], BadInput> {
        let [first, second] = self.chosen_pair(names)?;
        Ok([self.seen(first)?, self.seen(second)?])
    }

    fn seen<'b>(&self, board: &'b Board) -> Result<&'b Board, BadInput> {
        if board.count() == 0 { Err(self.not_seen(board)) } else { Ok(board) }
    }

    /// Why a board has not been seen for a while; `None` if it was.
    #[must_use]
    pub fn gone(&self, board: &Board) -> Option<Missing> {
        let is_gone = |it: &Board| self.until_s - it.last_seen_s() > GONE_S;
        let is_other_seen = self.boards.iter().any(|it| it.name != board.name && !is_gone(it));
        let why = board.lately.unwrap_or(NoPose::Searching);
        is_gone(board).then(|| Missing::new(why, is_other_seen))
    }

    fn named(&self, name: &str) -> Result<&Board, BadInput> {
        self.boards.iter().find(|it| it.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.boards.iter().map(|it| it.name.as_str()).collect();
            let found = format!("no board is called {name:?}");
            BadInput::whole(&self.place, found, format!("give one of {}", names.join(", ")))
        })
    }

    fn by_sightings(&self) -> Vec<&Board> {
        let mut boards: Vec<&Board> = self.boards.iter().collect();
        boards.sort_by_key(|it| std::cmp::Reverse(it.count()));
        boards
    }

    fn not_seen(&self, board: &Board) -> BadInput {
        let others: Vec<&str> =
            self.boards.iter().filter(|it| it.count() > 0).map(|it| it.name.as_str()).collect();
        let (why, remedy) = board.trouble(!others.is_empty());
        let seen = match others.is_empty() {
            true => String::new(),
            false => format!("; only {} is seen", others.join(" and ")),
        };
        BadInput::whole(
            &self.place,
            format!(
                "the board {:?} is seen in none of {} ({why}){seen}",
                board.name,
                counted(self.frames, "frame")
            ),
            remedy,
        )
    }
}

fn sighting(frame_time_s: f64, pose: &MeasuredPose) -> Sighting {
    Sighting {
        time_s: frame_time_s + 1e-9 * f64::from(pose.delay_ns),
        cam_from_board: pose.cam_from_target(),
        covariance: pose.covariance(),
    }
}

#[cfg(test)]
mod tests {
    use plumbline::report::GridRejection;
    use plumbline_stream::fixture::{config, pose_packet};

    use super::*;

    #[test]
    fn each_board_is_seen_at_its_own_time() {
        let mut recording = Recording::new("box", &config());
        let mut packet = pose_packet(0);
        for (target, delay_ns) in packet.targets.iter_mut().zip([2_000_000, 9_000_000]) {
            target.pose.as_mut().unwrap().delay_ns = delay_ns;
        }
        recording.take(5.0, &packet);
        for (target, time_s) in packet.targets.iter().zip([5.002, 5.009]) {
            let board = recording.boards.iter().find(|it| it.geometry.role() == target.role);
            let seen_s = board.unwrap().sightings()[0].time_s;
            assert!((seen_s - time_s).abs() < 1e-12, "{seen_s}");
        }
    }

    #[test]
    fn a_board_is_gone_when_it_has_not_been_seen_for_a_while() {
        const CUT: NoPose = NoPose::NotFound(GridRejection::Cut);
        let mut recording = Recording::new("box", &config());
        let mut packet = pose_packet(0);
        recording.take(0.0, &packet);
        for (why, time_s) in [(CUT, 1.0), (NoPose::Searching, 1.9), (NoPose::Searching, 2.1)] {
            let [seen, cut] = [0, 1].map(|at| &recording.boards[at]);
            assert!(recording.gone(seen).is_none() && recording.gone(cut).is_none(), "{time_s}");
            let role = recording.boards[1].geometry.role();
            let target = packet.targets.iter_mut().find(|it| it.role == role);
            target.unwrap().pose = Err(why);
            recording.take(time_s, &packet);
        }
        assert_eq!(recording.gone(&recording.boards[0]), None);
        // A search that goes on is no reason where there was one.
        assert_eq!(recording.gone(&recording.boards[1]), Some(Missing::Because(CUT)));
    }
}
