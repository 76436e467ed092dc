//! What is done with a box in one go: the doctor, another configuration, the scene.

use std::sync::Arc;
use std::time::{Duration, Instant};

use plumbline::target::Role;
use plumbline_bedside::box_settings::BoxSettings;
use plumbline_bedside::keys::Store;
use plumbline_bedside::{calibration, delivery, doctor, scene, setup};
use plumbline_files::targets::{self, Targets};
use plumbline_files::{BadInput, camera};
use plumbline_stream::link::BoxLink;

use super::can::Stage;
use super::{Job, Next, Reach, Shared, Worker};
use crate::wire::{
    CalibrationDeliver, CheckGrade, CheckState, Examination, SceneMeasure, SceneState,
};
use crate::words::on_page;
use crate::{prints, settings};

/// How long a box is examined.
const EXAMINED_FOR: Duration = Duration::from_secs(3);

/// How long the board is watched, unless somebody says otherwise, seconds.
const MEASURED_FOR_S: f64 = 2.0;

/// And no shorter or longer than this.
const MEASURED_S: std::ops::RangeInclusive<f64> = 1.0..=30.0;

/// A board that leans further is warned of: as `plumb scene` does.
const UPRIGHT_DEG: f64 = 3.0;

/// Shows what the doctor found.
pub fn show_checks(shared: &Shared, checks: &[doctor::Check]) {
    let mut shown: Vec<_> = checks.iter().map(CheckState::of).collect();
    shown.sort_by_key(|it| std::cmp::Reverse(it.verdict));
    let worst = shown.first().map_or(CheckGrade::Skipped, |it| it.verdict);
    let examination = Examination { at_ms: shared.hub.now_ms(), worst, checks: shown };
    shared.update(|state| state.examination = Some(examination));
}

impl Worker {
    /// Does it; a failure is shown, and the box is watched again.
    pub(super) fn job(&mut self, mut link: BoxLink, job: Job) -> Result<(BoxLink, Next), BadInput> {
        let (result, next) = match job {
            Job::Examine => (self.examine(&mut link), Next::Watch),
            Job::Deliver(deliver) => (self.deliver(&mut link, &deliver), Next::Meet),
            Job::Measure(measure) => (self.measure(&mut link, &measure), Next::Watch),
            Job::StoreScene => (self.store_scene(&mut link), Next::Meet),
            Job::Settings(settings) => (self.send_settings(&mut link, &settings), Next::Meet),
        };
        if let Err(error) = result {
            self.shared.update(|state| {
                state.job = None;
                state.failed = Some(error.into());
            });
        }
        Ok((link, next))
    }

    fn examine(&mut self, link: &mut BoxLink) -> Result<(), BadInput> {
        self.examine_tried = Some(Instant::now());
        self.enter(Stage::Examining);
        self.show_session(Instant::now());
        let shared = Arc::clone(&self.shared);
        let checks = doctor::examine(link, EXAMINED_FOR, &mut |told| shared.told(told))?;
        show_checks(&self.shared, &checks);
        let boot_id = self.hello.as_ref().map_or(0, |it| it.boot_id);
        self.examined = Some((Instant::now(), boot_id, checks));
        Ok(())
    }

    fn deliver(&mut self, link: &mut BoxLink, asked: &CalibrationDeliver) -> Result<(), BadInput> {
        let Some(calibrated) = &self.calibrated else { return Ok(()) };
        let camera = calibrated.camera.clone();
        let targets = match &asked.targets {
            Some(text) => Some(targets::parse(text, "the targets")?),
            None => self.described_targets()?,
        };
        self.enter(Stage::Delivering);
        let shared = Arc::clone(&self.shared);
        let mut tell = move |told| shared.told(told);
        for warning in targets.iter().flat_map(|it| &it.warnings) {
            self.shared.notice(true, warning);
        }
        calibration::store(link, &camera, targets.as_ref(), &mut tell)?;
        self.measured = None;
        self.shared.update(|state| {
            state.scene = None;
            if let Some(calibration) = &mut state.calibration {
                calibration.is_delivered = true;
            }
        });
        Ok(())
    }

    /// Where the box looks for its board alone, and the prints are described on this computer: what a
    /// person wears, and that board.
    fn described_targets(&self) -> Result<Option<Targets>, BadInput> {
        let Some(config) = &self.config else { return Ok(None) };
        let is_board = |role| role == Role::Scene;
        if !config.targets.iter().all(|it| is_board(it.geometry.role())) {
            return Ok(None);
        }
        let Some(worn) = prints::worn(&self.around.folder)? else { return Ok(None) };
        let boards = config.targets.iter();
        let boards = boards.map(|it| targets::description(&it.name, &it.geometry));
        let all: Vec<_> = worn.into_iter().chain(boards).collect();
        targets::check(&all, "the targets").map(Some)
    }

    fn send_settings(
        &mut self,
        link: &mut BoxLink,
        settings: &BoxSettings,
    ) -> Result<(), BadInput> {
        self.enter(Stage::Delivering);
        let shared = Arc::clone(&self.shared);
        let mut tell = move |told| shared.told(told);
        delivery::store_settings(link, settings, settings::PLACE, &mut tell)?;
        if let Reach::Udp(id) = &self.reach {
            let store = Store::open()?;
            store.note_name(store.find(id)?.key.id(), settings.device())?;
        }
        Ok(())
    }

    fn measure(&mut self, link: &mut BoxLink, asked: &SceneMeasure) -> Result<(), BadInput> {
        let seconds = asked.seconds.unwrap_or(MEASURED_FOR_S);
        let pitch_deg = asked.camera_pitch_deg.unwrap_or(0.0);
        if !MEASURED_S.contains(&seconds) {
            let remedy = "give seconds, within 1 to 30";
            return Err(BadInput::whole("seconds", seconds, remedy));
        }
        if !(-90.0..=90.0).contains(&pitch_deg) {
            let remedy = "give degrees, within -90 to 90";
            return Err(BadInput::whole("camera_pitch_deg", pitch_deg, remedy));
        }
        self.enter(Stage::Measuring);
        let shared = Arc::clone(&self.shared);
        let mut tell = move |told| shared.told(told);
        let hello = delivery::greet(link, &mut tell)?;
        scene::check_board(link.place(), &hello)?;
        let config = link.config()?;
        if camera::is_stand_in(&config.lens) {
            return Err(setup::not_calibrated(link.place()));
        }
        let duration = Duration::from_secs_f64(seconds);
        let seen = scene::listen(link, &hello, config.lens, duration, &mut tell)?;
        let today = jiff::Zoned::now().date();
        let measured = scene::measure(&seen, pitch_deg, UPRIGHT_DEG, today)?;
        let shown = SceneState {
            words: measured.words(),
            warnings: measured.warnings.iter().map(|it| on_page(it)).collect(),
            leans_deg: measured.leans_deg,
            spread_deg: measured.spread_deg,
            spread_mm: measured.spread_mm,
            is_stored: false,
        };
        self.shared.update(|state| state.scene = Some(shown));
        self.measured = Some((measured, seen));
        Ok(())
    }

    fn store_scene(&mut self, link: &mut BoxLink) -> Result<(), BadInput> {
        let Some((measured, seen)) = &self.measured else { return Ok(()) };
        let (file, background) = (measured.file.clone(), seen.background.clone());
        self.enter(Stage::Delivering);
        let shared = Arc::clone(&self.shared);
        let mut tell = move |told| shared.told(told);
        let hello = link.hello()?;
        let old = link.config_to_change()?;
        scene::store(link, hello, old, &file, true, &mut tell)?;
        let kept = background.map(|picture| scene::keep_background(&file, &picture));
        if let Some(Err(error)) = kept {
            let words = format!("no picture of the background is kept: {error}");
            self.shared.notice(true, words);
        }
        self.shared.update(|state| {
            if let Some(scene) = &mut state.scene {
                scene.is_stored = true;
            }
        });
        Ok(())
    }
}
