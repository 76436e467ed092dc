//! The pipeline: owns every buffer, and turns one frame into one report.
//!
//! [`Pipeline::step`] first measures the targets that are being tracked, looking only near
//! their predicted positions. If a target is then missing, it continues the search: through the
//! whole area when nothing is tracked, by a small share of it otherwise. It allocates nothing,
//! does not recurse, and every loop in it has a bound.

use heapless::Vec;

use crate::find::corner::Corner;
use crate::find::grid::{Grid, GridRejection};
use crate::find::search::{Area, Goal, Search};
use crate::fit::edge::Appearance;
use crate::fit::measure::{Measurement, Rolling, View, Workspace, delay_ns, extent_is_certain};
use crate::follow::region::region;
use crate::follow::track::State;
use crate::limits::TARGETS_MAX;
use crate::model::config::{Config, ConfigError};
use crate::model::image::{GreyImage, Pixel};
use crate::model::lens_table::LensTable;
use crate::model::pose::{Cam, Pose, Target};
use crate::model::scene::SceneFrame;
use crate::model::shutter::Shutter;
use crate::model::target::GridShape;
use crate::model::target::{Role, TargetGeometry};
use crate::tell::report::{NoPose, Report, TargetReport, TargetState};
use crate::tell::view::{FrameView, TargetView, frame_view, squares};

/// One configured target and its track.
struct Track {
    geometry: TargetGeometry,
    /// As in the last grid that gave a pose.
    first_square_dark: bool,
    /// As it was last measured.
    appearance: Appearance,
    state: State,
    outcome: Result<Measurement, NoPose>,
}

/// The whole measurement: lens, targets, tracks and every buffer.
///
/// Large (see `memory.md`): keep it in a `static` or behind a pointer.
pub struct Pipeline {
    /// That of no lens until configured.
    lens: LensTable,
    shutter: Shutter,
    scene: Option<SceneFrame>,
    tracks: Vec<Track, TARGETS_MAX>,
    search: Search,
    /// The target that the next sweep is for, if it is missing; after the last one comes the first.
    search_turn: usize,
    workspace: Workspace,
    corners_dropped: u32,
    sequence: u32,
}

/// A target's grid in a frame, found by a search that is not the pipeline's own.
#[derive(Debug, Clone, Copy)]
pub struct FoundTarget<'a> {
    /// The numbered grid; its indices refer to `corners`.
    pub grid: &'a Grid,
    /// Corners, in pixels of the frame.
    pub corners: &'a [Corner],
}

/// Pixels that a pipeline measures.
///
/// What is generic is compiled by each crate that uses it. This trait's functions are not generic once
/// it is implemented: they, and with them all that measures a frame, are compiled with this crate alone.
pub trait Measurable: Pixel {
    /// As [`Pipeline::step`].
    fn step(pipeline: &mut Pipeline, frame: &GreyImage<'_, Self>, capture_time_ns: u64) -> Report;

    /// As [`Pipeline::step_found`].
    fn step_found(
        pipeline: &mut Pipeline,
        frame: &GreyImage<'_, Self>,
        capture_time_ns: u64,
        found: &[Result<FoundTarget<'_>, GridRejection>],
    ) -> Report;

    /// As [`Pipeline::view`].
    fn view(
        pipeline: &mut Pipeline,
        frame: &GreyImage<'_, Self>,
    ) -> (FrameView, Vec<TargetView, TARGETS_MAX>);
}

macro_rules! measurable {
    ($($pixel:ty),+) => {$(
        impl Measurable for $pixel {
            fn step(pipeline: &mut Pipeline, frame: &GreyImage<'_, Self>, time_ns: u64) -> Report {
                pipeline.measure(frame, time_ns)
            }

            fn step_found(
                pipeline: &mut Pipeline,
                frame: &GreyImage<'_, Self>,
                time_ns: u64,
                found: &[Result<FoundTarget<'_>, GridRejection>],
            ) -> Report {
                pipeline.measure_found(frame, time_ns, found)
            }

            fn view(
                pipeline: &mut Pipeline,
                frame: &GreyImage<'_, Self>,
            ) -> (FrameView, Vec<TargetView, TARGETS_MAX>) {
                pipeline.appearances(frame)
            }
        }
    )+};
}

measurable!(u8, u16);

/// What all targets of a frame have in common.
#[derive(Clone, Copy)]
struct Camera<'a> {
    lens: &'a LensTable,
    shutter: Shutter,
    /// The frame's time.
    time_ns: u64,
}

impl Track {
    /// What is looked at in a frame.
    fn view<'a, P: Pixel>(
        &'a self,
        frame: &'a GreyImage<'a, P>,
        camera: &Camera<'a>,
        first_square_dark: bool,
    ) -> View<'a, P> {
        let Camera { lens, shutter, time_ns } = *camera;
        let rolling = Rolling { shutter, time_ns, motion: self.state.motion() };
        View {
            image: frame,
            lens,
            target: &self.geometry,
            first_square_dark,
            rolling: (!shutter.is_global()).then_some(rolling),
        }
    }

    /// When a target at a pose is exposed.
    fn time_ns(&self, camera: &Camera<'_>, cam_from_target: &Pose<Cam, Target>) -> u64 {
        let Camera { lens, shutter, time_ns } = camera;
        let delay_ns = delay_ns(shutter, lens, &self.geometry, cam_from_target);
        time_ns.saturating_add(delay_ns.into())
    }

    /// When the target is exposed, as far as that is known before it is measured.
    fn expected_time_ns(&self, camera: &Camera<'_>) -> u64 {
        self.state.motion().map_or(camera.time_ns, |motion| {
            // The row changes by a few from frame to frame, and the time by some 0.1 ms.
            self.time_ns(camera, &motion.cam_from_target)
        })
    }

    /// The state after a frame.
    fn next_state(&self, camera: &Camera<'_>) -> State {
        match &self.outcome {
            Ok(found) => {
                self.state.next(Some(found.cam_from_target), found.own_time_ns(camera.time_ns))
            }
            Err(_) => self.state.next(None, self.expected_time_ns(camera)),
        }
    }

    /// Measures the target from a grid.
    #[inline(never)]
    fn acquire<P: Pixel>(
        &mut self,
        workspace: &mut Workspace,
        frame: &GreyImage<'_, P>,
        camera: &Camera<'_>,
        found: &FoundTarget<'_>,
    ) {
        let first_square_dark = found.grid.first_square_dark;
        let view = self.view(frame, camera, first_square_dark);
        let fitted = workspace.acquire(&view, found.grid, found.corners);
        self.outcome = fitted.map_err(NoPose::from).map(|fitted| {
            // A rejected grid must not change what is known of a coasting target.
            self.first_square_dark = first_square_dark;
            self.appearance = fitted.appearance;
            fitted.measurement
        });
    }
}

impl Pipeline {
    /// A pipeline without a configuration: it reports no targets.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            lens: LensTable::new(),
            shutter: Shutter::GLOBAL,
            scene: None,
            tracks: Vec::new(),
            search: Search::new(),
            search_turn: 0,
            workspace: Workspace::new(),
            corners_dropped: 0,
            sequence: 0,
        }
    }

    /// Takes a configuration and starts afresh.
    ///
    /// # Errors
    /// The first field that is out of range; the pipeline then has no configuration.
    pub fn configure(&mut self, config: &Config) -> Result<(), ConfigError> {
        self.lens.clear();
        self.tracks.clear();
        config.check()?;
        self.lens.fill(&config.lens)?;
        self.shutter = Shutter::new(config.readout_ns, config.lens.height_px);
        self.scene = config.cam_from_scene().map(SceneFrame::new);
        for target in &config.targets {
            let track = Track {
                geometry: target.geometry.clone(),
                first_square_dark: true,
                appearance: Appearance::START,
                state: State::Acquiring,
                outcome: Err(NoPose::Searching),
            };
            // The configuration's own list has the same capacity.
            let _ = self.tracks.push(track);
        }
        self.search.stop();
        self.search_turn = 0;
        self.corners_dropped = 0;
        self.sequence = 0;
        Ok(())
    }

    /// Forgets where the targets are: the next frame is searched afresh.
    pub fn forget(&mut self) {
        for track in &mut self.tracks {
            track.state = State::Acquiring;
        }
        self.search.stop();
    }

    /// Measures one frame.
    ///
    /// `capture_time_ns` is the middle of the exposure of the row that was read first, on the
    /// capture clock; only differences matter.
    pub fn step<P: Measurable>(
        &mut self,
        frame: &GreyImage<'_, P>,
        capture_time_ns: u64,
    ) -> Report {
        P::step(self, frame, capture_time_ns)
    }

    /// Measures a frame that stands for itself, from what the caller's search has found: for each
    /// target its grid, or why there is none. Targets beyond the end of `found` are not measured.
    /// One frame does not tell a velocity: with a rolling shutter the targets should stand still, and
    /// their covariances are those of targets that may sway.
    pub fn step_found<P: Measurable>(
        &mut self,
        frame: &GreyImage<'_, P>,
        capture_time_ns: u64,
        found: &[Result<FoundTarget<'_>, GridRejection>],
    ) -> Report {
        P::step_found(self, frame, capture_time_ns, found)
    }

    /// The appearance of the frame that was measured last, and of each target measured in it. This
    /// changes no result, and takes about as long as a tracked frame.
    #[must_use]
    pub fn view<P: Measurable>(
        &mut self,
        frame: &GreyImage<'_, P>,
    ) -> (FrameView, Vec<TargetView, TARGETS_MAX>) {
        P::view(self, frame)
    }

    /// As [`step`](Self::step).
    fn measure<P: Pixel>(&mut self, frame: &GreyImage<'_, P>, capture_time_ns: u64) -> Report {
        if lens_fits(&self.lens, frame) {
            self.measure_tracked(frame, capture_time_ns);
            self.search_missing(frame, capture_time_ns);
        } else {
            self.refuse_size();
        }
        self.finish(capture_time_ns)
    }

    /// As [`step_found`](Self::step_found).
    fn measure_found<P: Pixel>(
        &mut self,
        frame: &GreyImage<'_, P>,
        capture_time_ns: u64,
        found: &[Result<FoundTarget<'_>, GridRejection>],
    ) -> Report {
        self.forget();
        if lens_fits(&self.lens, frame) {
            for (index, track) in self.tracks.iter_mut().enumerate() {
                match found.get(index) {
                    Some(Ok(found)) => {
                        let camera = Camera {
                            lens: &self.lens,
                            shutter: self.shutter,
                            time_ns: capture_time_ns,
                        };
                        track.acquire(&mut self.workspace, frame, &camera, found);
                    }
                    Some(Err(rejection)) => track.outcome = Err(NoPose::NotFound(*rejection)),
                    None => track.outcome = Err(NoPose::Searching),
                }
            }
        } else {
            self.refuse_size();
        }
        self.finish(capture_time_ns)
    }

    fn refuse_size(&mut self) {
        for track in &mut self.tracks {
            track.outcome = Err(NoPose::FrameSize);
        }
    }

    /// What follows from the targets' outcomes: their next states, and the report.
    ///
    /// Never inlined: what it needs would stay on the stack during a search.
    #[inline(never)]
    fn finish(&mut self, capture_time_ns: u64) -> Report {
        let camera = Camera { lens: &self.lens, shutter: self.shutter, time_ns: capture_time_ns };
        for track in &mut self.tracks {
            track.state = track.next_state(&camera);
        }
        let report = self.report(capture_time_ns);
        self.sequence = self.sequence.wrapping_add(1);
        report
    }

    /// As [`view`](Self::view).
    fn appearances<P: Pixel>(
        &mut self,
        frame: &GreyImage<'_, P>,
    ) -> (FrameView, Vec<TargetView, TARGETS_MAX>) {
        let Self { lens, workspace, .. } = self;
        let targets = self.tracks.iter().filter_map(|track| {
            let measured = track.outcome.as_ref().ok().filter(|_| lens_fits(lens, frame))?;
            let view = View {
                image: frame,
                lens,
                target: &track.geometry,
                first_square_dark: track.first_square_dark,
                // A deformation by less than a pixel does not change how bright the squares are.
                rolling: None,
            };
            let nodes = workspace.nodes(&view, &measured.cam_from_target)?;
            let squares = squares(frame, nodes, view.first_square_dark)?;
            Some(TargetView {
                role: track.geometry.role(),
                light: squares.light,
                dark: squares.dark,
                saturated: squares.saturated,
                blur_px: [track.appearance.x_blur_px as f32, track.appearance.y_blur_px as f32],
                pitch_px: squares.pitch_px,
            })
        });
        (frame_view(frame), targets.collect())
    }

    /// Measures the targets whose motion is known.
    ///
    /// Never inlined: what it needs would stay on the stack during a search.
    #[inline(never)]
    fn measure_tracked<P: Pixel>(&mut self, frame: &GreyImage<'_, P>, time_ns: u64) {
        let camera = Camera { lens: &self.lens, shutter: self.shutter, time_ns };
        for track in &mut self.tracks {
            let Some(motion) = track.state.motion() else {
                track.outcome = Err(NoPose::Searching);
                continue;
            };
            let time_ns = track.expected_time_ns(&camera);
            let view = track.view(frame, &camera, track.first_square_dark);
            let fitted = self.workspace.track(&view, &motion.predict(time_ns), track.appearance);
            let fitted = fitted.map_err(NoPose::from).and_then(|fitted| {
                let found = &fitted.measurement.cam_from_target;
                let identified = extent_is_certain(&track.geometry, fitted.used)
                    || motion.identifies_corners(time_ns, &track.geometry, found)
                        && !self.workspace.pattern_goes_on(&view);
                if identified { Ok(fitted) } else { Err(NoPose::ExtentUnknown) }
            });
            track.outcome = fitted.map(|fitted| {
                track.appearance = fitted.appearance;
                fitted.measurement
            });
        }
    }

    /// Continues the search, and measures the targets that it has found.
    ///
    /// Never inlined: what it needs would stay on the stack during tracking.
    #[inline(never)]
    fn search_missing<P: Pixel>(&mut self, frame: &GreyImage<'_, P>, time_ns: u64) {
        let missing = self.tracks.iter().filter(|track| track.outcome.is_err()).count();
        if missing == 0 {
            self.search.stop();
            return;
        }
        if let Some(Goal::Region { target }) = self.search.goal()
            && self.tracks[target].outcome.is_ok()
        {
            self.search.stop();
        }
        if self.search.goal().is_none() {
            let (goal, area) = self.next_sweep(frame, time_ns);
            self.search.begin(goal, area);
        }
        let goal = self.search.goal();
        let nothing_tracked = missing == self.tracks.len();
        if !self.search.advance(frame, nothing_tracked) {
            return;
        }
        let wanted: Vec<GridShape, TARGETS_MAX> =
            self.tracks.iter().map(|track| track.geometry.shape()).collect();
        let grids = self.search.grids(frame, &wanted);
        let dropped = self.search.corners().dropped();
        self.corners_dropped = self.corners_dropped.saturating_add(dropped);
        let camera = Camera { lens: &self.lens, shutter: self.shutter, time_ns };
        for (index, (track, grid)) in self.tracks.iter_mut().zip(&grids).enumerate() {
            // A region may cut through another target, and says nothing about that one.
            let searched_for = goal.is_none_or(|goal| match goal {
                Goal::WholeFrame => true,
                Goal::Region { target } => target == index,
            });
            if track.outcome.is_ok() || !searched_for {
                continue;
            }
            match grid {
                Ok(grid) => {
                    let found = FoundTarget { grid, corners: self.search.corners().as_slice() };
                    track.acquire(&mut self.workspace, frame, &camera, &found);
                }
                // A coasting target keeps the reason why its edges gave no pose.
                Err(rejection) if track.state == State::Acquiring => {
                    track.outcome = Err(NoPose::NotFound(*rejection));
                }
                Err(_) => {}
            }
        }
    }

    /// The next sweep: the missing targets take turns, each searched for where it may be.
    fn next_sweep<P: Pixel>(&mut self, frame: &GreyImage<'_, P>, time_ns: u64) -> (Goal, Area) {
        let count = self.tracks.len();
        let turn = (0..count)
            .map(|step| (self.search_turn + step) % count)
            .find(|&index| self.tracks[index].outcome.is_err());
        let whole = Area { columns: 0..frame.width(), rows: 0..frame.height() };
        let Some(target) = turn else { return (Goal::WholeFrame, whole) };
        self.search_turn = target + 1;
        let track = &self.tracks[target];
        let region = track
            .state
            .motion()
            .and_then(|motion| region(&self.lens, &track.geometry, &motion.predict(time_ns)));
        match region {
            Some(area) => (Goal::Region { target }, area),
            None => (Goal::WholeFrame, whole),
        }
    }

    fn report(&self, capture_time_ns: u64) -> Report {
        let targets: Vec<TargetReport, TARGETS_MAX> = self
            .tracks
            .iter()
            .map(|track| TargetReport {
                role: track.geometry.role(),
                state: match track.state {
                    State::Acquiring => TargetState::Acquiring,
                    State::Tracking(_) => TargetState::Tracking,
                    State::Coasting(_) => TargetState::Coasting,
                },
                measurement: track.outcome,
            })
            .collect();
        let trunk = |role: Role| {
            let track = self.tracks.iter().find(|track| track.geometry.role() == role)?;
            let cam_from_target = &track.outcome.as_ref().ok()?.cam_from_target;
            let scene = self.scene.as_ref()?;
            match role {
                Role::Upper => Some(scene.upper_trunk(cam_from_target)),
                Role::Lower => {
                    Some(scene.lower_trunk(cam_from_target, &track.geometry.virtual_point_mm()))
                }
                Role::Scene => None,
            }
        };
        Report {
            sequence: self.sequence,
            capture_time_ns,
            targets,
            upper_trunk: trunk(Role::Upper),
            lower_trunk: trunk(Role::Lower),
            corners_dropped: self.corners_dropped,
        }
    }
}

impl Default for Pipeline {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether a frame has the size that the camera was calibrated for.
fn lens_fits<P: Pixel>(lens: &LensTable, frame: &GreyImage<'_, P>) -> bool {
    usize::from(lens.width_px()) == frame.width() && usize::from(lens.height_px()) == frame.height()
}

#[cfg(test)]
mod tests;
