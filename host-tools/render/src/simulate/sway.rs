//! How a standing person sways: an inverted pendulum that hinges at the hip.
//!
//! Two segments, legs and trunk, stand on the ankle joint. Stiffness and damping at ankle and hip
//! (a PD controller) hold them against gravity, and random torques at both joints (low-pass
//! filtered noise) disturb them. For angles of about a degree the equations are linear, so the
//! steady motion is a sum of sinusoids: the spectrum of the torques times the frequency response of
//! the pendulum. It is computed in this way, not integrated, because the pose at any instant then
//! needs no history: the motion is the same for any frame and any rate.
//!
//! The sagittal and the frontal plane move independently with the same mechanics (the frontal plane
//! is stiffer because of the width of the stance); the trunk also twists slightly.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix2, Vector2, Vector3};
use plumbline::pose::{Pose, Scene, rotation_from_vector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The trunk's frame: origin at the hip joint, axes along the scene's when standing upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trunk;

/// The amplitude of the sway: long-term standard deviations at the height of the shoulder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwaySettings {
    /// Forward and backward, at the shoulder.
    pub ap_sd_mm: f64,
    /// Sideways, at the shoulder.
    pub ml_sd_mm: f64,
    /// The trunk's twist about the vertical.
    pub twist_sd_rad: f64,
}

impl Default for SwaySettings {
    /// Quiet standing of a healthy adult: 5 to 10 mm AP and 2 to 4 mm ML at the shoulder.
    fn default() -> Self {
        Self { ap_sd_mm: 6.5, ml_sd_mm: 3.0, twist_sd_rad: 0.005 }
    }
}

impl SwaySettings {
    /// The usual proportions at another amplitude.
    #[must_use]
    pub fn of_ap_sd_mm(ap_sd_mm: f64) -> Self {
        let usual = Self::default();
        let scale = ap_sd_mm / usual.ap_sd_mm;
        Self {
            ap_sd_mm,
            ml_sd_mm: usual.ml_sd_mm * scale,
            twist_sd_rad: usual.twist_sd_rad * scale,
        }
    }
}

/// Ankle to hip joint, mm, of a person of 1.8 m.
pub const LEGS_MM: f64 = 850.0;

/// Hip joint to the height of the shoulder, mm.
pub const SHOULDER_ABOVE_HIP_MM: f64 = 560.0;

/// Masses, lengths and moments of inertia of a person of 1.8 m and 73 kg, without the feet: segment
/// data from Winter's tables. kg, m, kg m^2.
mod body {
    pub const LEGS_KG: f64 = 23.0;
    pub const LEGS_CENTRE_M: f64 = 0.50;
    pub const LEGS_INERTIA: f64 = 1.4;
    pub const TRUNK_KG: f64 = 47.0;
    pub const TRUNK_CENTRE_M: f64 = 0.33;
    pub const TRUNK_INERTIA: f64 = 3.0;
    pub const GRAVITY: f64 = 9.81;
}

/// The stiffness and damping that hold the body upright in one plane.
struct Stiffness {
    /// Stiffness, N m / rad, and damping, N m s / rad.
    ankle: [f64; 2],
    hip: [f64; 2],
}

/// A third more than gravity requires (657 N m/rad for the stiff body), which gives the slow modes
/// of quiet standing at 0.2 Hz.
const SAGITTAL: Stiffness = Stiffness { ankle: [890.0, 180.0], hip: [600.0, 60.0] };

/// The legs form a frame: stiffer sideways.
const FRONTAL: Stiffness = Stiffness { ankle: [1100.0, 200.0], hip: [700.0, 70.0] };

/// The spectrum of the torque noise is flat up to this frequency, then falls.
const TORQUE_CORNER_HZ: f64 = 0.8;

/// The ratio of the torque noise at the hip to that at the ankle: with it, the hip angle varies by
/// a third of the ankle angle.
const HIP_TORQUE_RATIO: f64 = 0.6;

/// The band that is synthesised; above it lies less than a thousandth of the power.
const BAND_HZ: [f64; 2] = [0.02, 3.0];

/// Sinusoids per noise source: the motion repeats no sooner than after hours.
const SINUSOIDS: usize = 120;

/// One frequency component: complex amplitudes of two angles.
struct Part {
    rad_per_s: f64,
    amplitude_rad: Vector2<Complex<f64>>,
}

/// The angles of legs and trunk from the vertical in one plane.
struct Plane(Vec<Part>);

impl Plane {
    /// Scales the motion so that the displacement of the shoulder has this standard deviation.
    fn new(stiffness: &Stiffness, shoulder_sd_mm: f64, random: &mut ChaCha8Rng) -> Self {
        let mut parts = Vec::new();
        // Torque noise at the ankle acts on the legs; at the hip it acts on both segments, in
        // opposite directions.
        for source in [Vector2::new(1.0, 0.0), Vector2::new(-1.0, 1.0) * HIP_TORQUE_RATIO] {
            for (hz, width_hz) in frequencies(random) {
                let torque = (width_hz / (1.0 + (hz / TORQUE_CORNER_HZ).powi(2))).sqrt();
                let phase = turn(random.random_range(0.0..TAU)) * torque;
                let response = frequency_response(stiffness, hz * TAU);
                let amplitude_rad: Vector2<_> = response * source.map(|value| phase * value);
                parts.push(Part { rad_per_s: hz * TAU, amplitude_rad });
            }
        }
        let shoulder = |part: &Part| {
            part.amplitude_rad[0] * LEGS_MM + part.amplitude_rad[1] * SHOULDER_ABOVE_HIP_MM
        };
        let variance: f64 = parts.iter().map(|part| shoulder(part).norm_sqr() / 2.0).sum();
        let scale = Complex::from(shoulder_sd_mm / variance.sqrt());
        for part in &mut parts {
            part.amplitude_rad *= scale;
        }
        Self(parts)
    }

    /// The angles of [legs, trunk] from the vertical, rad.
    fn angles_rad(&self, time_s: f64) -> Vector2<f64> {
        self.0.iter().fold(Vector2::zeros(), |sum, part| {
            let turned = turn(part.rad_per_s * time_s);
            sum + part.amplitude_rad.map(|amplitude| (amplitude * turned).re)
        })
    }
}

/// e^(i angle).
fn turn(angle_rad: f64) -> Complex<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Complex::new(cos, sin)
}

/// Random frequencies within equal steps of their logarithm, and the widths of the steps.
fn frequencies(random: &mut ChaCha8Rng) -> Vec<(f64, f64)> {
    let step = (BAND_HZ[1] / BAND_HZ[0]).ln() / SINUSOIDS as f64;
    let at = |position: f64| BAND_HZ[0] * (position * step).exp();
    (0..SINUSOIDS)
        .map(|index| {
            let index = index as f64;
            (at(index + random.random_range(0.0..1.0)), at(index + 1.0) - at(index))
        })
        .collect()
}

/// Angles of [legs, trunk] per torque on [legs, trunk] at one frequency:
/// (-w^2 M + i w B + K - G)^-1 of the linearised double pendulum.
fn frequency_response(stiffness: &Stiffness, rad_per_s: f64) -> Matrix2<Complex<f64>> {
    use body::*;
    let legs_m = LEGS_MM * 1e-3;
    let coupling = TRUNK_KG * legs_m * TRUNK_CENTRE_M;
    let mass = Matrix2::new(
        LEGS_INERTIA + LEGS_KG * LEGS_CENTRE_M.powi(2) + TRUNK_KG * legs_m.powi(2),
        coupling,
        coupling,
        TRUNK_INERTIA + TRUNK_KG * TRUNK_CENTRE_M.powi(2),
    );
    let toppling = Matrix2::new(
        (LEGS_KG * LEGS_CENTRE_M + TRUNK_KG * legs_m) * GRAVITY,
        0.0,
        0.0,
        TRUNK_KG * TRUNK_CENTRE_M * GRAVITY,
    );
    let joints = |index: usize| {
        let (ankle, hip) = (stiffness.ankle[index], stiffness.hip[index]);
        Matrix2::new(ankle + hip, -hip, -hip, hip)
    };
    let real = joints(0) - toppling - mass * rad_per_s.powi(2);
    let dynamic = real.zip_map(&(joints(1) * rad_per_s), Complex::new);
    // Damped at every frequency above zero, so never singular.
    dynamic.try_inverse().unwrap_or_else(Matrix2::zeros)
}

/// A person's sway, determined by a seed.
pub struct Sway {
    sagittal: Plane,
    frontal: Plane,
    twist: Plane,
    twist_scale: f64,
}

impl Sway {
    /// The sway of this seed.
    #[must_use]
    pub fn new(settings: &SwaySettings, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        Self {
            sagittal: Plane::new(&SAGITTAL, settings.ap_sd_mm, &mut random),
            frontal: Plane::new(&FRONTAL, settings.ml_sd_mm, &mut random),
            // The twist has the spectrum of the sideways motion.
            twist: Plane::new(&FRONTAL, 1.0, &mut random),
            twist_scale: settings.twist_sd_rad,
        }
    }

    /// The pose of the trunk in the scene; `ankle_mm` is the position of the ankles there.
    #[must_use]
    pub fn scene_from_trunk(&self, time_s: f64, ankle_mm: &Vector3<f64>) -> Pose<Scene, Trunk> {
        let forward = self.sagittal.angles_rad(time_s);
        let right = self.frontal.angles_rad(time_s);
        let twisting = self.twist.angles_rad(time_s);
        let twist_rad =
            self.twist_scale * (twisting[0] * LEGS_MM + twisting[1] * SHOULDER_ABOVE_HIP_MM);
        // Up is -y: leaning forward (+z) is a rotation about -x, leaning right (+x) about +z.
        let legs = rotation_from_vector(&Vector3::new(-forward[0], 0.0, right[0]));
        let trunk = rotation_from_vector(&Vector3::new(-forward[1], twist_rad, right[1]));
        Pose::new(trunk, ankle_mm + legs * Vector3::new(0.0, -LEGS_MM, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The position of the shoulder above the hip, which at rest is above the scene's origin.
    fn shoulder_mm(sway: &Sway, time_s: f64) -> Vector3<f64> {
        let above = Vector3::new(0.0, -SHOULDER_ABOVE_HIP_MM, 0.0);
        sway.scene_from_trunk(time_s, &Vector3::zeros()).transform(&above)
    }

    #[test]
    fn amplitude_velocity_and_spectrum_are_those_of_quiet_standing() {
        let sway = Sway::new(&SwaySettings::default(), 1);
        let (rate_hz, count) = (20.0, 20 * 1200);
        let path: Vec<_> = (0..count).map(|i| shoulder_mm(&sway, f64::from(i) / rate_hz)).collect();
        let rms = |axis: usize, lag: usize| {
            let squares: f64 = path
                .windows(lag + 1)
                .map(|window| (window[lag][axis] - window[0][axis]).powi(2))
                .sum();
            (squares / (path.len() - lag) as f64).sqrt()
        };
        let sd = |axis: usize| {
            let squares: f64 = path.iter().map(|point| point[axis].powi(2)).sum();
            (squares / path.len() as f64).sqrt()
        };
        // The settings are long-term values; 20 minutes contain about 200 slow swings.
        assert!((sd(2) / 6.5 - 1.0).abs() < 0.1, "AP {}", sd(2));
        assert!((sd(0) / 3.0 - 1.0).abs() < 0.1, "ML {}", sd(0));
        // Force plates and motion capture report 5 to 20 mm/s.
        let speed = (rms(2, 1).hypot(rms(0, 1))) * rate_hz;
        assert!((5.0..20.0).contains(&speed), "{speed} mm/s");
        // A motion above 1 Hz would show as acceleration: at 1 Hz and full
        // amplitude it would be 6.5 (2 pi)^2 = 257 mm/s^2.
        let acceleration: f64 = path
            .windows(3)
            .map(|window| {
                ((window[2][2] - 2.0 * window[1][2] + window[0][2]) * rate_hz.powi(2)).powi(2)
            })
            .sum::<f64>()
            / (path.len() - 2) as f64;
        assert!(acceleration.sqrt() < 30.0, "{} mm/s^2", acceleration.sqrt());
    }

    #[test]
    fn the_pendulum_stands_and_would_fall_without_its_ankles() {
        // At zero frequency the response is the inverse of the net stiffness:
        // positive definite for a pendulum that stands.
        let stands = |stiffness: &Stiffness| {
            let response = frequency_response(stiffness, 0.0).map(|value| value.re);
            response.trace() > 0.0 && response.determinant() > 0.0
        };
        assert!(stands(&SAGITTAL) && stands(&FRONTAL));
        assert!(!stands(&Stiffness { ankle: [600.0, 180.0], hip: [600.0, 60.0] }));
    }

    #[test]
    fn leaning_has_the_anatomical_signs() {
        let lean = |ap_sd_mm: f64, ml_sd_mm: f64| {
            let settings = SwaySettings { ap_sd_mm, ml_sd_mm, twist_sd_rad: 0.0 };
            let sway = Sway::new(&settings, 3);
            (sway.sagittal.angles_rad(2.0), sway.frontal.angles_rad(2.0), shoulder_mm(&sway, 2.0))
        };
        let (forward, _, shoulder) = lean(5.0, 0.0);
        let expected = LEGS_MM * forward[0] + SHOULDER_ABOVE_HIP_MM * forward[1];
        assert!((shoulder.z - expected).abs() < 0.01 && shoulder.x.abs() < 1e-9);
        let (_, right, shoulder) = lean(0.0, 5.0);
        let expected = LEGS_MM * right[0] + SHOULDER_ABOVE_HIP_MM * right[1];
        assert!((shoulder.x - expected).abs() < 0.01 && shoulder.z.abs() < 1e-9);
    }

    #[test]
    fn a_seed_is_a_motion() {
        let settings = SwaySettings::default();
        let at = |seed| shoulder_mm(&Sway::new(&settings, seed), 1.0);
        assert_eq!(at(1), at(1));
        assert_ne!(at(1), at(2));
    }
}
