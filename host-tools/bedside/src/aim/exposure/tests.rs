//! The controller against cameras whose answers are known.

use super::*;

const RATE_HZ: f32 = 60.0;

/// Light on the paper and what a camera makes of it.
#[derive(Clone, Copy)]
struct Camera {
    /// Level of the light squares per microsecond at gain 1.
    light_per_us: f32,
    black: f32,
    /// Above this its gain stays where it is; `None`: it takes none.
    gain_max: Option<f32>,
    /// Decibels in a step of its gain; `None`: it is a factor.
    db_per_step: Option<f32>,
    /// Longer exposures are cut to this; 0: it has no control of the exposure.
    exposure_us_max: u32,
    /// Below this level of the light squares no target is found.
    found_from: f32,
}

/// Of a camera that is left alone.
const OWN_EXPOSURE_US: f32 = 4000.0;

const CAMERA: Camera = Camera {
    light_per_us: 1e-4,
    black: 0.03,
    gain_max: Some(16.0),
    db_per_step: None,
    exposure_us_max: 100_000,
    found_from: 0.15,
};

impl Camera {
    /// What a setting gives; `None` where it is refused.
    fn light(&self, setting: Setting) -> Option<Light> {
        let gain = match (setting.gain, self.gain_max, self.db_per_step) {
            (Some(_), None, _) => return None,
            (None, ..) => 1.0,
            (Some(gain), Some(most), None) => gain.clamp(1.0, most),
            (Some(gain), Some(most), Some(db)) => {
                // Whole steps, as of Video4Linux.
                10_f32.powf(db * gain.min(most).trunc() / 20.0)
            }
        };
        let exposure_us = match (setting.exposure_us, self.exposure_us_max) {
            (Some(_), 0) => return None,
            (None, _) => OWN_EXPOSURE_US,
            (Some(exposure_us), most) => exposure_us.min(most) as f32,
        };
        let level = self.black + self.light_per_us * exposure_us * gain;
        // The room has half the light of the paper.
        let (of, level) = if level < self.found_from || level >= 1.0 {
            (Judged::Frame, 0.5 * level)
        } else {
            (Judged::Target, level)
        };
        let saturated = if level >= 1.0 { 1.0 } else { 0.0 };
        Some(Light { of, level: level.min(1.0), saturated })
    }
}

/// How it ends, with the setting, the light, and the number of settings tried.
fn run(camera: &Camera, start: Setting) -> (Verdict, Setting, Light, usize) {
    let (mut controller, mut setting) =
        Controller::new(RATE_HZ, start, camera.db_per_step.map_or(0.01, |_| 1.0));
    let mut light = Light { of: Judged::Frame, level: 0.0, saturated: 0.0 };
    for tries in 1.. {
        let step = match camera.light(setting) {
            Some(seen) => {
                light = seen;
                controller.next(seen)
            }
            None => controller.refused().expect("a camera that takes one of the two"),
        };
        match step {
            Step::Try(next) => setting = next,
            Step::Done(verdict) => return (verdict, controller.current(), light, tries),
        }
    }
    unreachable!("the loop has no end of its own")
}

const CONFIGURED: Setting = Setting { exposure_us: Some(4000), gain: Some(2.0) };
const UNKNOWN: Setting = Setting { exposure_us: None, gain: None };

#[track_caller]
fn is_good(camera: &Camera, start: Setting, tries_max: usize) -> Setting {
    let (verdict, setting, light, tries) = run(camera, start);
    assert_eq!((verdict, light.of), (Verdict::Good, Judged::Target), "{setting:?} {light:?}");
    assert!((light.level - LIGHT_GOAL).abs() <= LIGHT_TOLERANCE, "{setting:?} {light:?}");
    assert!(tries <= tries_max, "{tries}");
    setting
}

#[test]
fn in_enough_light_the_exposure_is_all_that_is_needed() {
    for light_per_us in [1e-4, 2e-4, 1e-3, 5e-3] {
        for start in [CONFIGURED, UNKNOWN] {
            let setting = is_good(&Camera { light_per_us, ..CAMERA }, start, 6);
            assert_eq!(setting.gain, start.gain);
            assert!(setting.exposure_us.unwrap() <= 8333);
        }
    }
}

#[test]
fn what_is_well_exposed_is_left_alone() {
    let camera = Camera { light_per_us: 0.9e-4, ..CAMERA };
    assert_eq!(is_good(&camera, CONFIGURED, 1), CONFIGURED);
}

#[test]
fn in_little_light_the_gain_does_the_rest() {
    let units = [(None, 16.0), (Some(1.0), 48.0), (Some(0.3), 100.0), (Some(0.1), 480.0)];
    for light_per_us in [3e-5, 2e-5, 1e-5] {
        for (db_per_step, most) in units {
            for start in [UNKNOWN, Setting { gain: Some(0.0), ..CONFIGURED }] {
                let gain_max = Some(most);
                let camera = Camera { light_per_us, gain_max, db_per_step, ..CAMERA };
                let setting = is_good(&camera, start, TRIES_MAX);
                assert_eq!(setting.exposure_us, Some(8333), "half a frame");
            }
        }
    }
}

#[test]
fn without_a_gain_the_exposure_goes_beyond_half_a_frame_and_no_further_than_a_frame() {
    let no_gain = Camera { light_per_us: 6e-5, gain_max: None, ..CAMERA };
    let setting = is_good(&no_gain, UNKNOWN, 8);
    assert!((8334..=16666).contains(&setting.exposure_us.unwrap()), "{setting:?}");
    assert_eq!(setting.gain, None);
    let limited = Camera { light_per_us: 1.5e-5, gain_max: Some(3.5), ..CAMERA };
    let setting = is_good(&limited, CONFIGURED, 10);
    assert!((8334..=16666).contains(&setting.exposure_us.unwrap()), "{setting:?}");
}

#[test]
fn a_camera_that_cuts_the_exposure_gets_gain() {
    let camera = Camera { light_per_us: 5e-5, exposure_us_max: 5000, ..CAMERA };
    let setting = is_good(&camera, UNKNOWN, 10);
    assert!(setting.gain.unwrap() > 2.0, "{setting:?}");
}

#[test]
fn a_camera_that_takes_no_exposure_gets_gain_alone() {
    let camera = Camera { light_per_us: 5e-5, exposure_us_max: 0, ..CAMERA };
    for gain in [None, Some(0.5), Some(2.0), Some(9.0)] {
        let setting = is_good(&camera, Setting { exposure_us: None, gain }, 8);
        assert_eq!(setting.exposure_us, None);
    }
    let dark = Camera { light_per_us: 1e-6, ..camera };
    assert_eq!(run(&dark, UNKNOWN).0, Verdict::TooDark);
    // Neither: there is nothing to be done.
    let nothing = Camera { gain_max: None, ..camera };
    let (mut controller, first) = Controller::new(RATE_HZ, UNKNOWN, 0.01);
    assert!(nothing.light(first).is_none() && controller.refused().is_some());
    let light = nothing.light(controller.current()).expect("as it is");
    let Step::Try(_) = controller.next(light) else { panic!("{light:?}") };
    assert_eq!(controller.refused(), Some(Step::Done(Verdict::TooDark)));
}

#[test]
fn what_no_setting_mends_is_said() {
    let dark = Camera { light_per_us: 1e-7, ..CAMERA };
    assert_eq!(run(&dark, CONFIGURED).0, Verdict::TooDark);
    let dark_without_gain = Camera { gain_max: None, ..dark };
    assert_eq!(run(&dark_without_gain, UNKNOWN).0, Verdict::TooDark);
    let bright = Camera { light_per_us: 1.0, gain_max: None, ..CAMERA };
    assert_eq!(run(&bright, UNKNOWN).0, Verdict::TooBright);
    let no_target = Camera { found_from: 2.0, ..CAMERA };
    assert_eq!(run(&no_target, CONFIGURED).0, Verdict::NoTarget);
}

#[test]
fn saturation_that_stays_lowers_the_goal() {
    let (mut controller, _) = Controller::new(RATE_HZ, CONFIGURED, 1.0);
    let shiny = Light { of: Judged::Target, level: 0.75, saturated: 0.01 };
    let Step::Try(setting) = controller.next(shiny) else { panic!("saturated") };
    assert!(setting.exposure_us < CONFIGURED.exposure_us);
    let better = Light { level: 0.64, saturated: 0.0, ..shiny };
    assert_eq!(controller.next(better), Step::Done(Verdict::Good));
}
