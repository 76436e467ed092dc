//! Where everything stands: camera, person, targets. All numbers of the standard scene are here,
//! with their reasons.

use nalgebra::{Rotation3, Vector3};
use plumbline::lens::{Distortion, Lens};
use plumbline::pose::{Cam, Pose, Scene, Target};
use plumbline::target::Role;

use super::sway::{SHOULDER_ABOVE_HIP_MM, Trunk};

/// The lens in front of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum LensChoice {
    /// No distortion, f 1740 px.
    None,
    /// The distortion of a common 6 mm lens, f 1740 px.
    #[default]
    Mild,
    /// A wide-angle lens, f 800 px.
    Wide,
    /// A USB camera of 1280 x 720: the same view as the others, f 1150 px, mildly distorted.
    Hd,
    /// A microcontroller's camera of 640 x 480: the same view, f 767 px, mildly distorted.
    Vga,
}

impl LensChoice {
    /// The whole camera: except for `Hd` and `Vga`, a 1456 x 1088 global-shutter sensor with 3.45
    /// um pixels.
    #[must_use]
    pub fn lens(self) -> Lens {
        let standard = Lens {
            width_px: 1456,
            height_px: 1088,
            // 6 mm / 3.45 um.
            fx_px: 1740.0,
            fy_px: 1740.0,
            // A mounted lens never sits exactly on the sensor's centre (727.5, 543.5).
            cx_px: 731.4,
            cy_px: 540.2,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0, 0.0]),
        };
        match self {
            Self::None => standard,
            // Barrel distortion of 3 % (26 px) in the frame's corners: usual for
            // a C-mount lens of this focal length without special correction.
            Self::Mild => Lens { distortion: Distortion::Radial2([-0.12, 0.05]), ..standard },
            // 25 % in the corners: stronger than any lens that is sensible here.
            Self::Wide => Lens {
                fx_px: 800.0,
                fy_px: 805.0,
                skew_px: 0.7,
                distortion: Distortion::Brown5([-0.28, 0.09, 0.001, -0.0008, -0.008]),
                ..standard
            },
            // Its 720 rows see what the standard camera's 1088 rows see.
            Self::Hd => Lens {
                width_px: 1280,
                height_px: 720,
                fx_px: 1150.0,
                fy_px: 1150.0,
                cx_px: 642.1,
                cy_px: 357.3,
                distortion: Distortion::Radial2([-0.12, 0.05]),
                ..standard
            },
            // So do its 480 rows.
            Self::Vga => Lens {
                width_px: 640,
                height_px: 480,
                fx_px: 767.0,
                fy_px: 767.0,
                cx_px: 321.3,
                cy_px: 238.1,
                distortion: Distortion::Radial2([-0.12, 0.05]),
                ..standard
            },
        }
    }

    /// From the camera to the person's back: 1 m, and for the wide angle so close that the targets
    /// keep three quarters of their size in the image.
    #[must_use]
    pub fn distance_mm(self) -> f64 {
        match self {
            Self::None | Self::Mild | Self::Hd | Self::Vga => 1000.0,
            Self::Wide => 600.0,
        }
    }
}

/// From the scene's origin, which is on the midline of the back halfway between the targets'
/// heights, to the point at which the camera aims: to the side by half the lateral distance of the
/// targets, so that both are equally far from the centre of the image.
const AIM_MM: Vector3<f64> = Vector3::new(-85.0, 0.0, 0.0);

/// Height of the shoulder target above the lumbar one: acromion above L3 for a person of 1.8 m.
pub const SHOULDER_ABOVE_LUMBAR_MM: f64 = 430.0;

/// The hip joint's axis lies this far below L3.
const LUMBAR_ABOVE_HIP_MM: f64 = SHOULDER_ABOVE_HIP_MM - SHOULDER_ABOVE_LUMBAR_MM;

/// The hip joint's axis lies this far inside the back's surface.
const HIP_INSIDE_SKIN_MM: f64 = 100.0;

fn degrees(angles: [f64; 3]) -> [f64; 3] {
    angles.map(f64::to_radians)
}

/// The camera looks down by 2 degrees (its tripod stands a little above the
/// middle of the back) and was set up by hand: 1 degree of yaw, half a degree of roll.
#[must_use]
pub fn cam_from_scene(distance_mm: f64) -> Pose<Cam, Scene> {
    let [roll, yaw, pitch] = degrees([0.5, 1.0, 2.0]);
    let turned = Pose::<Cam, Scene>::from_theta([roll, yaw, pitch, 0.0, 0.0, 0.0]);
    let aim_mm = turned.rotation * AIM_MM;
    Pose::new(turned.rotation, Vector3::new(0.0, 0.0, distance_mm) - aim_mm)
}

/// The ankles in the scene, vertically below the hip joints: when the person stands upright, the
/// skin of the back at the lumbar target is in the scene's plane.
#[must_use]
pub fn ankle_mm() -> Vector3<f64> {
    let hip_below_origin_mm = SHOULDER_ABOVE_LUMBAR_MM / 2.0 + LUMBAR_ABOVE_HIP_MM;
    Vector3::new(0.0, hip_below_origin_mm + super::sway::LEGS_MM, HIP_INSIDE_SKIN_MM)
}

/// The description of one target.
#[derive(Debug, Clone, Copy)]
pub struct TargetLayout {
    /// Its name in the files.
    pub name: &'static str,
    /// Its role.
    pub role: Role,
    /// Inner corners along x.
    pub columns: u8,
    /// Inner corners along y.
    pub rows: u8,
    /// The distance between neighbouring corners.
    pub pitch_mm: f64,
    /// The body point in the target frame.
    pub virtual_point_mm: [f64; 3],
    /// The target's origin in the trunk's frame.
    origin_trunk_mm: Vector3<f64>,
    /// Turns about the trunk's y, then x, then z axis, rad.
    yaw_pitch_roll_rad: [f64; 3],
}

impl TargetLayout {
    /// Where the target is on the trunk.
    #[must_use]
    pub fn trunk_from_target(&self) -> Pose<Trunk, Target> {
        let [yaw, pitch, roll] = self.yaw_pitch_roll_rad;
        let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle).into_inner();
        let rotation = about(Vector3::y_axis(), yaw)
            * about(Vector3::x_axis(), pitch)
            * about(Vector3::z_axis(), roll);
        Pose::new(rotation, self.origin_trunk_mm)
    }
}

/// White paper around the squares, one pitch wide, as `plumb target` prints it.
pub const MARGIN_MM: f64 = 12.0;

/// The standard pair: lumbar first.
#[must_use]
pub fn targets() -> [TargetLayout; 2] {
    [
        TargetLayout {
            name: "lumbar",
            role: Role::Lower,
            columns: 6,
            rows: 5,
            pitch_mm: 12.0,
            virtual_point_mm: [0.0, 0.0, 100.0],
            // On the midline, on the skin.
            origin_trunk_mm: Vector3::new(0.0, -LUMBAR_ABOVE_HIP_MM, -HIP_INSIDE_SKIN_MM),
            // Nearly frontal: the hollow of the back faces a little up; taped on by hand.
            yaw_pitch_roll_rad: degrees([3.0, -5.0, 1.5]),
        },
        TargetLayout {
            name: "shoulder",
            role: Role::Upper,
            columns: 5,
            rows: 4,
            pitch_mm: 12.0,
            virtual_point_mm: [0.0; 3],
            // The left acromion, half a shoulder breadth from the midline and slightly in front of
            // the skin at the lumbar target.
            origin_trunk_mm: Vector3::new(
                -170.0,
                -SHOULDER_ABOVE_HIP_MM,
                15.0 - HIP_INSIDE_SKIN_MM,
            ),
            // The back of the shoulder faces outwards (to the left) and up.
            yaw_pitch_roll_rad: degrees([20.0, -12.0, -4.0]),
        },
    ]
}

/// The scene's origin in the trunk's frame when standing upright: the point of the skin of the back
/// with which the clothing moves.
#[must_use]
pub fn back_origin_trunk_mm() -> Vector3<f64> {
    let hip_below_origin_mm = SHOULDER_ABOVE_LUMBAR_MM / 2.0 + LUMBAR_ABOVE_HIP_MM;
    Vector3::new(0.0, -hip_below_origin_mm, -HIP_INSIDE_SKIN_MM)
}
