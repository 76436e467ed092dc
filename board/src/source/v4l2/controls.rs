//! Sets exposure and gain, and switches off what would disturb the measurement.
//!
//! Always: a frame rate that drops in the dark, and automatic focus (a calibration
//! holds for one focus), are switched off if the camera has them; if it does not
//! allow that, this is a warning. If an exposure or a gain is configured: the
//! automatic control is switched off, the value is set and read back, and a value
//! that the camera changed is a warning.
//!
//! A configured value for which the camera has no control is refused: the
//! technician must learn at once that the box cannot measure with the planned
//! exposure, and what to configure instead.

use std::io;

use anyhow::{Context, Result, bail};
use plumbline::config::Capture;
use v4l::control::{Control, Value};
use v4l::v4l_sys::{
    V4L2_CID_ANALOGUE_GAIN, V4L2_CID_AUTOGAIN, V4L2_CID_EXPOSURE, V4L2_CID_EXPOSURE_ABSOLUTE,
    V4L2_CID_EXPOSURE_AUTO, V4L2_CID_EXPOSURE_AUTO_PRIORITY, V4L2_CID_FOCUS_AUTO, V4L2_CID_GAIN,
    V4L2_CID_HBLANK, V4L2_CID_PIXEL_RATE, V4L2_CTRL_FLAG_DISABLED,
    v4l2_exposure_auto_type_V4L2_EXPOSURE_MANUAL as MANUAL,
    v4l2_exposure_auto_type_V4L2_EXPOSURE_SHUTTER_PRIORITY as SHUTTER_PRIORITY,
};

use super::driver::Driver;

/// The unit of the absolute exposure.
const EXPOSURE_STEP_US: u32 = 100;

/// A camera's controls.
pub trait Controls {
    /// Whether it has this control.
    fn has(&self, id: u32) -> bool;

    /// The control's value.
    fn get(&self, id: u32) -> io::Result<i64>;

    /// Sets the control; the camera may choose another value.
    fn set(&self, id: u32, value: i64) -> io::Result<()>;
}

impl Controls for Driver {
    fn has(&self, id: u32) -> bool {
        self.query_control(id).is_ok_and(|control| control.flags & V4L2_CTRL_FLAG_DISABLED == 0)
    }

    fn get(&self, id: u32) -> io::Result<i64> {
        match self.device().control(id)?.value {
            Value::Integer(value) => Ok(value),
            Value::Boolean(value) => Ok(value.into()),
            _ => Err(io::ErrorKind::InvalidData.into()),
        }
    }

    fn set(&self, id: u32, value: i64) -> io::Result<()> {
        self.device().set_control(Control { id, value: Value::Integer(value) })
    }
}

/// Sets the camera up as configured; `width_px` is the width of the frames.
///
/// Returns warnings about what differs from the configuration, to be logged.
///
/// # Errors
/// When a configured value cannot be set; the message names it and the remedy.
pub fn set_up(camera: &impl Controls, capture: &Capture, width_px: usize) -> Result<Vec<String>> {
    let mut warnings = Vec::new();
    for (id, what) in [
        (V4L2_CID_EXPOSURE_AUTO_PRIORITY, "a frame rate that falls in the dark"),
        (V4L2_CID_FOCUS_AUTO, "the automatic focus"),
    ] {
        if camera.has(id) && (camera.set(id, 0).is_err() || camera.get(id).is_ok_and(|on| on != 0))
        {
            warnings.push(format!("the camera does not let {what} be switched off"));
        }
    }
    if let Some(exposure_us) = capture.exposure_us {
        warnings.extend(set_exposure(camera, exposure_us, width_px).with_context(|| {
            format!(
                "capture.exposure_us: {exposure_us} cannot be set; leave it out to let the \
                     camera choose"
            )
        })?);
    }
    if let Some(gain) = capture.gain {
        warnings.extend(set_gain(camera, gain).with_context(|| {
            format!("capture.gain: {gain} cannot be set; leave it out to let the camera choose")
        })?);
    }
    Ok(warnings)
}

fn set_exposure(
    camera: &impl Controls,
    exposure_us: u32,
    width_px: usize,
) -> Result<Option<String>> {
    if camera.has(V4L2_CID_EXPOSURE_AUTO) {
        // With a fixed iris both mean the same, and some cameras offer only the second.
        let manual = i64::from(MANUAL);
        camera
            .set(V4L2_CID_EXPOSURE_AUTO, manual)
            .or_else(|_| camera.set(V4L2_CID_EXPOSURE_AUTO, i64::from(SHUTTER_PRIORITY)))
            .context("the camera does not let the automatic exposure be switched off")?;
    }
    if camera.has(V4L2_CID_EXPOSURE_ABSOLUTE) {
        let steps = exposure_us.saturating_add(EXPOSURE_STEP_US / 2) / EXPOSURE_STEP_US;
        let (id, asked) = (V4L2_CID_EXPOSURE_ABSOLUTE, i64::from(steps.max(1)));
        let taken = set_and_read(camera, id, asked)?;
        let taken_us = taken * i64::from(EXPOSURE_STEP_US);
        return Ok((taken_us != i64::from(exposure_us))
            .then(|| format!("exposure_us: asked {exposure_us}, the camera took {taken_us}")));
    }
    if !camera.has(V4L2_CID_EXPOSURE) {
        bail!("the camera has no control of the exposure");
    }
    // The unit of this control is the driver's own; for sensors it is rows.
    let row_us = row_us(camera, width_px)
        .context("the camera's exposure is in rows, and it does not say how long a row takes")?;
    let rows = ((f64::from(exposure_us) / row_us).round() as i64).max(1);
    let taken = set_and_read(camera, V4L2_CID_EXPOSURE, rows)?;
    Ok((taken != rows).then(|| {
        let taken_us = taken as f64 * row_us;
        format!("exposure_us: asked {exposure_us}, the camera took {taken_us:.0}")
    }))
}

/// The time that the sensor takes for a row.
fn row_us(camera: &impl Controls, width_px: usize) -> Option<f64> {
    let pixels_hz = camera.get(V4L2_CID_PIXEL_RATE).ok().filter(|&rate_hz| rate_hz > 0)?;
    let blank_px = camera.get(V4L2_CID_HBLANK).ok().filter(|&blank_px| blank_px >= 0)?;
    let row_us = (width_px as f64 + blank_px as f64) * 1e6 / pixels_hz as f64;
    (row_us > 0.0).then_some(row_us)
}

fn set_gain(camera: &impl Controls, gain: f32) -> Result<Option<String>> {
    if camera.has(V4L2_CID_AUTOGAIN) {
        camera
            .set(V4L2_CID_AUTOGAIN, 0)
            .context("the camera does not let the automatic gain be switched off")?;
    }
    let id = [V4L2_CID_GAIN, V4L2_CID_ANALOGUE_GAIN]
        .into_iter()
        .find(|&id| camera.has(id))
        .context("the camera has no control of the gain")?;
    let taken = set_and_read(camera, id, gain.round() as i64)?;
    Ok((taken as f64 != f64::from(gain))
        .then(|| format!("gain: asked {gain}, the camera took {taken}")))
}

fn set_and_read(camera: &impl Controls, id: u32, value: i64) -> Result<i64> {
    camera.set(id, value).context("the camera refuses the value")?;
    camera.get(id).context("the camera does not say which value it took")
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::BTreeMap;

    use v4l::v4l_sys::v4l2_exposure_auto_type_V4L2_EXPOSURE_AUTO as AUTO;

    use super::*;
    use crate::test_config::config;

    /// The value of each control, and the values that it accepts.
    struct Fake(RefCell<BTreeMap<u32, (i64, Vec<i64>)>>);

    impl Controls for Fake {
        fn has(&self, id: u32) -> bool {
            self.0.borrow().contains_key(&id)
        }

        fn get(&self, id: u32) -> io::Result<i64> {
            let controls = self.0.borrow();
            controls.get(&id).map(|control| control.0).ok_or(io::ErrorKind::InvalidInput.into())
        }

        fn set(&self, id: u32, value: i64) -> io::Result<()> {
            let mut controls = self.0.borrow_mut();
            let (now, may_be) = controls.get_mut(&id).ok_or(io::ErrorKind::InvalidInput)?;
            // Menus accept what they list; numbers are clamped to their range.
            let menu = [V4L2_CID_EXPOSURE_AUTO, V4L2_CID_AUTOGAIN, V4L2_CID_FOCUS_AUTO];
            if menu.contains(&id) && !may_be.contains(&value) {
                return Err(io::ErrorKind::InvalidInput.into());
            }
            let (least, most) = (may_be[0], may_be[may_be.len() - 1]);
            *now = value.clamp(least, most);
            Ok(())
        }
    }

    fn camera(controls: &[(u32, i64, &[i64])]) -> Fake {
        let controls = controls.iter().map(|&(id, value, may_be)| (id, (value, may_be.to_vec())));
        Fake(RefCell::new(controls.collect()))
    }

    fn configured(exposure_us: Option<u32>, gain: Option<f32>) -> Capture {
        Capture { exposure_us, gain, ..config().capture.unwrap() }
    }

    /// The controls of a webcam.
    fn webcam() -> Fake {
        camera(&[
            (V4L2_CID_EXPOSURE_AUTO, 3, &[1, 3]),
            (V4L2_CID_EXPOSURE_AUTO_PRIORITY, 1, &[0, 1]),
            (V4L2_CID_EXPOSURE_ABSOLUTE, 250, &[3, 2047]),
            (V4L2_CID_FOCUS_AUTO, 1, &[0, 1]),
            (V4L2_CID_AUTOGAIN, 1, &[0, 1]),
            (V4L2_CID_GAIN, 64, &[0, 255]),
        ])
    }

    #[test]
    fn a_webcam_is_set_to_what_is_configured() {
        let camera = webcam();
        let warnings = set_up(&camera, &configured(Some(5000), Some(10.0)), 640).unwrap();
        assert_eq!(warnings, [""; 0]);
        let expected = [
            (V4L2_CID_EXPOSURE_AUTO, 1),
            (V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0),
            (V4L2_CID_EXPOSURE_ABSOLUTE, 50),
            (V4L2_CID_FOCUS_AUTO, 0),
            (V4L2_CID_AUTOGAIN, 0),
            (V4L2_CID_GAIN, 10),
        ];
        for (id, value) in expected {
            assert_eq!(camera.get(id).unwrap(), value, "{id:#x}");
        }
    }

    #[test]
    fn settings_that_are_not_configured_stay_but_rate_and_focus_are_fixed() {
        let camera = webcam();
        assert_eq!(set_up(&camera, &configured(None, None), 640).unwrap(), [""; 0]);
        for (id, value) in [
            (V4L2_CID_EXPOSURE_AUTO, 3),
            (V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0),
            (V4L2_CID_EXPOSURE_ABSOLUTE, 250),
            (V4L2_CID_FOCUS_AUTO, 0),
            (V4L2_CID_AUTOGAIN, 1),
            (V4L2_CID_GAIN, 64),
        ] {
            assert_eq!(camera.get(id).unwrap(), value, "{id:#x}");
        }
    }

    #[test]
    fn a_value_that_the_camera_changes_is_a_warning() {
        let warnings = set_up(&webcam(), &configured(Some(70), Some(300.0)), 640).unwrap();
        assert_eq!(
            warnings,
            ["exposure_us: asked 70, the camera took 300", "gain: asked 300, the camera took 255"]
        );
        let camera = camera(&[(V4L2_CID_FOCUS_AUTO, 1, &[1])]);
        let warnings = set_up(&camera, &configured(None, None), 640).unwrap();
        assert_eq!(warnings, ["the camera does not let the automatic focus be switched off"]);
    }

    #[test]
    fn a_camera_that_has_only_shutter_priority_is_set_to_that() {
        let auto = i64::from(AUTO);
        let camera = camera(&[
            (V4L2_CID_EXPOSURE_AUTO, auto, &[0, 2]),
            (V4L2_CID_EXPOSURE_ABSOLUTE, 1, &[1, 100]),
        ]);
        set_up(&camera, &configured(Some(1000), None), 640).unwrap();
        assert_eq!(camera.get(V4L2_CID_EXPOSURE_AUTO).unwrap(), 2);
        assert_eq!(camera.get(V4L2_CID_EXPOSURE_ABSOLUTE).unwrap(), 10);
    }

    /// 1000 px and 500 of blank at 100 MHz are 15 us a row.
    #[test]
    fn a_sensor_is_set_in_rows() {
        let camera = camera(&[
            (V4L2_CID_EXPOSURE, 1, &[1, 1000]),
            (V4L2_CID_PIXEL_RATE, 100_000_000, &[100_000_000]),
            (V4L2_CID_HBLANK, 500, &[500]),
            (V4L2_CID_ANALOGUE_GAIN, 0, &[0, 100]),
        ]);
        let warnings = set_up(&camera, &configured(Some(3000), Some(7.0)), 1000).unwrap();
        assert_eq!(warnings, [""; 0]);
        assert_eq!(camera.get(V4L2_CID_EXPOSURE).unwrap(), 200);
        assert_eq!(camera.get(V4L2_CID_ANALOGUE_GAIN).unwrap(), 7);
        let warnings = set_up(&camera, &configured(Some(30_000), None), 1000).unwrap();
        assert_eq!(warnings, ["exposure_us: asked 30000, the camera took 15000"]);
    }

    #[test]
    fn what_cannot_be_set_is_refused_by_name() {
        let cases: [(Fake, Capture, [&str; 2]); 4] = [
            (
                camera(&[]),
                configured(Some(5000), None),
                ["capture.exposure_us: 5000", "no control of the exposure"],
            ),
            (
                camera(&[(V4L2_CID_EXPOSURE, 1, &[1, 9])]),
                configured(Some(5000), None),
                ["capture.exposure_us: 5000", "how long a row takes"],
            ),
            (
                camera(&[(V4L2_CID_EXPOSURE_AUTO, 0, &[0])]),
                configured(Some(5000), None),
                ["capture.exposure_us: 5000", "automatic exposure"],
            ),
            (
                camera(&[]),
                configured(None, Some(2.5)),
                ["capture.gain: 2.5", "no control of the gain"],
            ),
        ];
        for (camera, capture, expected) in cases {
            let error = format!("{:#}", set_up(&camera, &capture, 640).unwrap_err());
            for part in expected {
                assert!(error.contains(part), "{error}");
            }
        }
    }
}
