//! A trial that was recorded with the wrong files, and corrected, is the trial with the right ones.

use nalgebra::{Matrix3, Vector2};
use plumbline::config::Config;
use plumbline::target::Origin;
use plumbline_files::camera::{Camera, Provenance};
use plumbline_files::lens_id::LensId;
use plumbline_files::scene::SceneFile;
use plumbline_files::targets::{description, to_toml};
use plumbline_stream::fixture::config;
use tempfile::TempDir;

use super::*;
use crate::Trial;
use crate::derived::{Changes, remake};
use crate::frame::Trunk;
use crate::test_trial::{Made, scene_from_target};
use crate::verdict::Grade;

/// Positions come in single precision, 6e-5 mm at a metre: of the poses, and of the points.
const ROUNDING_MM: f64 = 2e-4;

/// Enough for a good verdict.
const WHOLE: u32 = 1800;

/// Enough for poses in many attitudes.
const SHORT: u32 = 300;

fn write(folder: &TempDir, name: &str, text: &str) -> Option<PathBuf> {
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    Some(path)
}

fn scene_file(folder: &TempDir, config: &Config) -> Option<PathBuf> {
    let cam_from_scene_theta = config.cam_from_scene_theta.unwrap();
    let (source, camera) = ("a test".to_owned(), Some(LensId::of(&config.lens)));
    let scene = SceneFile { cam_from_scene_theta, source, camera };
    write(folder, "scene.toml", &scene::to_toml(&scene))
}

fn targets_file(folder: &TempDir, config: &Config) -> Option<PathBuf> {
    let targets = config.targets.iter().map(|it| description(&it.name, &it.geometry));
    write(folder, "targets.toml", &to_toml(&targets.collect::<Vec<_>>()))
}

fn camera_file(folder: &TempDir, config: &Config) -> Option<PathBuf> {
    let (lens, readout_ns) = (config.lens, config.readout_ns);
    let camera = Camera { lens, readout_ns, provenance: Provenance::default() };
    write(folder, "camera.toml", &camera::to_toml(&camera))
}

fn replace(trial: &Trial, replacements: Replacements) -> Result<Trial, BadInput> {
    let changes = Changes { replaced: Some(replacements), ..Changes::default() };
    remake(&trial.folder, &changes)
}

/// A target with another role, pitch or virtual point.
fn target(config: &mut Config, from: Role, change: impl Fn(&TargetGeometry) -> TargetGeometry) {
    let target = config.targets.iter_mut().find(|it| it.geometry.role() == from).unwrap();
    target.geometry = change(&target.geometry);
}

fn rebuilt(
    geometry: &TargetGeometry,
    role: Role,
    pitch_mm: f64,
    point_mm: [f64; 3],
) -> TargetGeometry {
    let (columns, rows) = (geometry.columns() as u8, geometry.rows() as u8);
    TargetGeometry::checker(columns, rows, pitch_mm, Origin::Center, role, point_mm).unwrap()
}

/// The largest difference of two trials' positions, and of their standard deviations as a share.
fn difference(found: &Trial, wanted: &Trial) -> (f64, f64) {
    assert_eq!(found.frames.len(), wanted.frames.len());
    let (mut of_positions_mm, mut of_sds) = (0.0_f64, 0.0_f64);
    for (found, wanted) in found.frames.iter().zip(&wanted.frames) {
        for trunk in Trunk::ALL {
            let [found, wanted] = [found, wanted].map(|it| it.point(trunk).expect("it was seen"));
            let sd = |covariance: Option<Matrix3<f64>>, at| covariance.unwrap()[(at, at)].sqrt();
            for axis in 0..3 {
                let off_mm = found.position_mm[axis] - wanted.position_mm[axis];
                of_positions_mm = of_positions_mm.max(off_mm.abs());
                let ratio = sd(found.covariance_mm2, axis) / sd(wanted.covariance_mm2, axis);
                of_sds = of_sds.max((ratio - 1.0).abs());
            }
        }
    }
    (of_positions_mm, of_sds)
}

/// What a box makes of a target, if it is told another lens and another geometry: the corners that
/// it sees are those of the truth.
fn as_told(
    truth: &Config,
    told: &Config,
    shape: &TargetGeometry,
    cam_from_target: &Pose<Cam, Target>,
) -> Pose<Cam, Target> {
    let of = |config: &Config| {
        let found = config.targets.iter().find(|it| it.geometry.shape() == shape.shape());
        found.unwrap().geometry.clone()
    };
    let (seen, believed) = (of(truth), of(told));
    let corners: Vec<SeenCorner> = (0..seen.corner_count())
        .map(|corner| {
            let point_cam_mm = cam_from_target.transform(&seen.corner_mm(corner));
            let raw_px: Vector2<f64> = truth.lens.project(&point_cam_mm).unwrap();
            let ray = told.lens.ray_from_raw(&raw_px).unwrap();
            let (_, raw_by_ray) = told.lens.raw_from_ray_with_jacobian(&ray);
            let point_target_mm = believed.corner_mm(corner);
            SeenCorner { point_target_mm, ray, raw_by_ray, sigma_px: 1.0 }
        })
        .collect();
    solve(cam_from_target, &corners[..], 30).unwrap().cam_from_target
}

/// The trial with the right files, and the same person before a box that was told others. `role_of`
/// is the role by which that box knows a target.
fn pair(
    truth: &Config,
    told: &Config,
    frames: u32,
    role_of: impl Fn(Role) -> Role,
) -> [(TempDir, Trial); 2] {
    let scene = truth.cam_from_scene().unwrap();
    let at = |role, sequence| scene * scene_from_target(role, sequence);
    let right = Made::with_poses(truth, frames, |sequence, role| at(role, sequence));
    let wrong = Made::with_poses(told, frames, |sequence, told_role| {
        let role = role_of(told_role);
        let found = truth.targets.iter().find(|it| it.geometry.role() == role).unwrap();
        as_told(truth, told, &found.geometry, &at(role, sequence))
    });
    [right.trial(), wrong.trial()]
}

/// Of a box that was told every role as it is.
fn same_role(role: Role) -> Role {
    role
}

#[test]
fn a_scene_given_afterwards_is_as_good_as_one_given_before() {
    let truth = config();
    let told = Config { cam_from_scene_theta: None, ..truth.clone() };
    let [(_right, right), (folder, wrong)] = pair(&truth, &told, WHOLE, same_role);
    assert!(wrong.manifest.verdict().line().starts_with("unusable: no frame has a position"));
    let packets = std::fs::read(wrong.folder.join(names::JOURNAL)).unwrap();
    let blob = std::fs::read(wrong.folder.join(names::CONFIG)).unwrap();

    let scene = scene_file(&folder, &truth);
    let found = replace(&wrong, Replacements { scene, ..Replacements::default() }).unwrap();
    let (of_positions_mm, of_sds) = difference(&found, &right);
    assert!(of_positions_mm < ROUNDING_MM && of_sds < 1e-5, "{of_positions_mm} mm, {of_sds}");
    assert_eq!(found.manifest.verdict(), right.manifest.verdict());
    let corrected = found.manifest.corrected.as_ref().unwrap();
    assert_eq!(corrected.files[0].what, "scene");
    assert_eq!(corrected.config_crc, format!("{:08x}", truth.crc()));
    // Who reads the folder next reads the same; the tables have it too.
    let again = Trial::open(&wrong.folder).unwrap();
    assert_eq!(again.frames, found.frames);
    assert!(again.warnings.iter().any(|it| it.contains("scene.toml")), "{:?}", again.warnings);
    let rows = plumbline_files::poses::read(&wrong.folder.join(names::CSV)).unwrap();
    assert!(rows.iter().all(|row| row.ap_mm.is_some()));
    assert_eq!(crate::poses::read(&wrong.folder).unwrap().config, truth);
    // What was recorded is untouched, and comes back.
    assert_eq!(std::fs::read(wrong.folder.join(names::JOURNAL)).unwrap(), packets);
    assert_eq!(std::fs::read(wrong.folder.join(names::CONFIG)).unwrap(), blob);
    let back = Changes { as_recorded: true, ..Changes::default() };
    let back = remake(&wrong.folder, &back).unwrap();
    assert_eq!((back.frames, back.manifest.corrected), (wrong.frames, None));
    assert!(!wrong.folder.join(names::CORRECTED).exists());
}

/// Of a camera of the same frame size, whose poses it would turn by as much as it is another's.
#[test]
fn a_scene_of_another_camera_is_refused_and_one_of_no_camera_warned_of() {
    let truth = config();
    let told = Config { cam_from_scene_theta: None, ..truth.clone() };
    let [_, (folder, trial)] = pair(&truth, &told, SHORT, same_role);
    let mut other = truth.clone();
    other.lens.cx_px += 20.0;
    let scene = scene_file(&folder, &other);
    let with_scene = |camera| Replacements { scene: scene.clone(), camera, targets: None };
    let error = replace(&trial, with_scene(None)).unwrap_err();
    assert_eq!(error.field, "camera");
    assert!(error.place.ends_with("scene.toml") && error.remedy.contains("plumb scene"), "{error}");
    assert!(!trial.folder.join(names::CORRECTED).exists());
    // With its own camera beside it, it fits.
    let found = replace(&trial, with_scene(camera_file(&folder, &other))).unwrap();
    assert!(!found.warnings.iter().any(|it| it.contains("through which camera")));

    let path = folder.path().join("scene.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &text[..text.find("[camera]").unwrap()]).unwrap();
    let found = replace(&trial, with_scene(None)).unwrap();
    assert!(found.warnings[0].contains("through which camera"), "{:?}", found.warnings);
}

#[test]
fn exchanged_roles_and_a_wrong_virtual_point_are_put_right() {
    let truth = config();
    let mut told = truth.clone();
    // Each print with the other's role, and the lower one's point at its surface.
    let lower = told.targets.iter().position(|it| it.geometry.role() == Role::Lower).unwrap();
    for (at, target) in told.targets.iter_mut().enumerate() {
        let role = if at == lower { Role::Upper } else { Role::Lower };
        target.geometry = rebuilt(&target.geometry, role, target.geometry.pitch_mm(), [0.0; 3]);
    }
    let exchanged = |role| if role == Role::Upper { Role::Lower } else { Role::Upper };
    let [(_right, right), (folder, wrong)] = pair(&truth, &told, WHOLE, exchanged);
    let verdict = wrong.manifest.verdict();
    assert_eq!((verdict.is, &*verdict.reasons[0].key), (Grade::Unusable, "upper_above_lower_mm"));
    let targets = targets_file(&folder, &truth);
    let found = replace(&wrong, Replacements { targets, ..Replacements::default() }).unwrap();
    let (of_positions_mm, of_sds) = difference(&found, &right);
    assert!(of_positions_mm < ROUNDING_MM && of_sds < 1e-5, "{of_positions_mm} mm, {of_sds}");
    assert_eq!(found.manifest.verdict(), right.manifest.verdict());
    let names = |trial: &Trial| -> Vec<[Option<[f32; 6]>; 2]> {
        trial.frames.iter().map(|frame| frame.theta).collect()
    };
    assert_eq!(names(&found), names(&right), "the poses are the recorded ones");
}

#[test]
fn another_pitch_gives_the_poses_of_the_print_as_it_was() {
    let truth = config();
    let mut told = truth.clone();
    // A print that came out 2 % larger than its description.
    for role in [Role::Upper, Role::Lower] {
        target(&mut told, role, |it| {
            rebuilt(it, role, it.pitch_mm() / 1.02, it.virtual_point_mm().into())
        });
    }
    let [(_right, right), (folder, wrong)] = pair(&truth, &told, SHORT, same_role);
    let (before_mm, _) = difference(&wrong, &right);
    assert!(before_mm > 10.0, "{before_mm} mm");
    let targets = targets_file(&folder, &truth);
    let found = replace(&wrong, Replacements { targets, ..Replacements::default() }).unwrap();
    let (of_positions_mm, _) = difference(&found, &right);
    // The recorded pose is rounded, and its turns enter those of the pose anew.
    assert!(of_positions_mm < 2.0 * ROUNDING_MM, "{of_positions_mm} mm");
    // Noise scales with the distance: that of the wrong trial was as large, in its own millimetres.
    let sd = |trial: &Trial| trial.frames[0].upper.unwrap().covariance_mm2.unwrap()[(0, 0)].sqrt();
    assert!((sd(&found) / sd(&wrong) - 1.02).abs() < 1e-4, "{}", sd(&found) / sd(&wrong));
}

#[test]
fn another_camera_gives_its_poses_to_the_second_order() {
    let truth = config();
    let mut told = truth.clone();
    // A calibration that is off by what a touched lens does: 1 % of focal length, 5 px of centre.
    told.lens.fx_px *= 1.01;
    told.lens.fy_px *= 1.01;
    told.lens.cx_px += 5.0;
    told.lens.cy_px -= 5.0;
    let [(_right, right), (folder, wrong)] = pair(&truth, &told, SHORT, same_role);
    let (before_mm, _) = difference(&wrong, &right);
    assert!((before_mm - 8.6).abs() < 0.05, "{before_mm} mm");
    let (camera, scene) = (camera_file(&folder, &truth), scene_file(&folder, &truth));
    let files = Replacements { camera: camera.clone(), scene, ..Replacements::default() };
    let found = replace(&wrong, files).unwrap();
    let (of_positions_mm, _) = difference(&found, &right);
    // As the module says.
    assert!(of_positions_mm < 0.000_6, "{of_positions_mm} mm, of {before_mm} mm before");
    assert_eq!(found.manifest.corrected.unwrap().files.len(), 2);

    // The scene was measured through the old lens too, and its board is not known.
    let alone = Replacements { camera, ..Replacements::default() };
    let error = replace(&wrong, alone).unwrap_err().to_string();
    assert!(error.contains("camera.toml") && error.contains("--scene FILE"), "{error}");
}

#[test]
fn what_cannot_be_replaced_is_refused_and_changes_nothing() {
    let (folder, trial) = Made::of(&config(), 60).trial();
    let text = |name: &str| std::fs::read(trial.folder.join(name)).ok();
    let before = [names::MANIFEST, names::CORRECTED].map(text);
    let mut other = config();
    other.lens.width_px -= 100;
    let camera = camera_file(&folder, &other);
    let mut grids = config();
    target(&mut grids, Role::Upper, |it| {
        TargetGeometry::checker(
            it.columns() as u8 + 2,
            it.rows() as u8,
            it.pitch_mm(),
            Origin::Center,
            Role::Upper,
            [0.0; 3],
        )
        .unwrap()
    });
    let targets = targets_file(&folder, &grids);
    let scene = write(&folder, "bad.toml", "x_mm = 3\n");
    let nothing = Replacements::default;
    for (replacements, parts) in [
        (Replacements { camera, ..nothing() }, &["camera.toml", "width_px", "frame size"][..]),
        (Replacements { targets, ..nothing() }, &["targets.toml", "columns, rows", "same grid"]),
        (Replacements { scene, ..nothing() }, &["bad.toml"]),
    ] {
        let error = replace(&trial, replacements).unwrap_err().to_string();
        for part in parts {
            assert!(error.contains(part), "no {part} in {error}");
        }
    }
    assert_eq!([names::MANIFEST, names::CORRECTED].map(text), before);
    // Without what the box was told, nothing is known of the poses.
    std::fs::remove_file(trial.folder.join(names::CONFIG)).unwrap();
    let scene = scene_file(&folder, &config());
    let error = replace(&trial, Replacements { scene, ..nothing() }).unwrap_err().to_string();
    assert!(error.contains("config.plb") && error.contains("plumb provision"), "{error}");
}

#[test]
fn a_replacement_that_is_lost_or_of_another_trial_is_not_passed_over() {
    let (folder, trial) = Made::of(&config(), 60).trial();
    let scene = scene_file(&folder, &config());
    replace(&trial, Replacements { scene, ..Replacements::default() }).unwrap();
    let path = trial.folder.join(names::CORRECTED);
    let blob = std::fs::read(&path).unwrap();
    for content in [None, Some(&blob[..40]), Some(&[][..])] {
        match content {
            None => std::fs::remove_file(&path).unwrap(),
            Some(bytes) => std::fs::write(&path, bytes).unwrap(),
        }
        let error = Trial::open(&trial.folder).unwrap_err().to_string();
        assert!(error.contains("corrected.plb") && error.contains("--as-recorded"), "{error}");
    }
    let back = Changes { as_recorded: true, ..Changes::default() };
    assert_eq!(remake(&trial.folder, &back).unwrap().frames, trial.frames);
}

#[test]
fn the_carried_covariance_is_that_of_the_poses_found_anew() {
    let truth = config();
    let mut told = truth.clone();
    told.lens.fx_px *= 1.005;
    told.lens.fy_px *= 1.005;
    told.lens.cx_px += 3.0;
    let correction = Correction { recorded: told.clone(), corrected: truth.clone() };
    let geometry = &truth.targets[0].geometry;
    let old_pose = Pose::from_theta([0.1, 0.3, -0.2, 50.0, -80.0, 900.0]);
    let anew = |pose: &Pose<Cam, Target>| {
        PoseAnew::of(
            &correction.recorded_sight(geometry),
            &correction.corrected_sight(geometry),
            pose,
        )
        .unwrap()
    };
    let found = anew(&old_pose);
    for axis in 0..6 {
        // Small against the pose, large against the solver's last step.
        let step = if axis < 3 { 1e-3 } else { 0.5 };
        let mut increment = nalgebra::Vector6::zeros();
        increment[axis] = step;
        let [ahead, behind] = [increment, -increment].map(|it| anew(&old_pose.moved_by(&it)).pose);
        let difference =
            (found.pose.increment_to(&ahead) - found.pose.increment_to(&behind)) / (2.0 * step);
        let scale = found.by_old.column(axis).norm();
        let off = (difference - found.by_old.column(axis)).norm() / scale;
        // To first order in the lenses' difference; turns out of the image plane, which show least,
        // are off by some twice that difference.
        assert!(off < 0.02, "{axis}: {off}");
    }
}

#[test]
fn another_readout_moves_each_target_to_the_time_of_its_row() {
    let recorded = config();
    let corrected = Config { readout_ns: 16_000_000, ..recorded.clone() };
    let lens = corrected.lens;
    let correction = Correction { recorded, corrected };
    let geometry = &correction.recorded.targets[0].geometry;
    // On the optical axis: at the row of the principal point.
    let pose = MeasuredPose { delay_ns: 0, ..plumbline_stream::fixture::pose() };
    let pose = MeasuredPose { theta_rad: [0.0; 3], translation_mm: [0.0, 0.0, 1000.0], ..pose };
    let found = correction.pose(&pose, geometry, geometry).unwrap();
    let expected_ns = 16e6 * lens.cy_px / f64::from(lens.height_px);
    assert!((f64::from(found.delay_ns) - expected_ns).abs() < 1.0, "{}", found.delay_ns);
    assert_eq!(MeasuredPose { delay_ns: 0, ..found }, pose, "and nothing else");
}
