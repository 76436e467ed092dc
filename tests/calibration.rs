//! Cameras that are known, from rendered photographs of a board; and real photographs.

use std::process::Output;

use common::binary;
use common::photographer::{LENS, PITCH_MM, board, photographs, posed, save};
use nalgebra::DVector;
use plumbline::lens::{Distortion, Lens};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_calibration::{Calibration, Choice, Picture, calibrate};
use plumbline_test_support::data;
use rayon::prelude::*;

/// A usual lens, a wide one, and one whose pixels are no rectangles.
fn lenses() -> [Lens; 3] {
    let wide = Distortion::Radial2([-0.28, 0.09]);
    [
        LENS,
        Lens { fx_px: 520.0, fy_px: 521.0, distortion: wide, ..LENS },
        Lens { fy_px: 990.0, skew_px: 3.0, ..LENS },
    ]
}

fn calibrated(lens: &Lens, photographs: &[Picture]) -> Calibration {
    let mut start = lens.distortion;
    start.coefficients_mut().fill(0.0);
    calibrate(photographs, &board(), Choice::Alone(start), || ())
        .unwrap_or_else(|failure| panic!("{failure:?}"))
}

/// All numbers of a lens, in the order of their standard deviations.
fn numbers(lens: &Lens) -> DVector<f64> {
    let pinhole = [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, lens.skew_px];
    let all = pinhole.into_iter().chain(lens.distortion.coefficients().iter().copied());
    DVector::from_iterator(5 + lens.distortion.coefficients().len(), all)
}

/// The errors of 100 calibrations, in the standard deviations that each states.
#[test]
fn errors_are_as_large_as_they_are_said_to_be() {
    let errors: Vec<([f64; 3], f64)> = (0..100)
        .into_par_iter()
        .map(|seed| {
            let truth = lenses()[(seed % 3) as usize];
            let found = calibrated(&truth, &photographs(&truth, &board(), 10, seed));
            let errors = numbers(&found.lens) - numbers(&truth);
            let normalised = errors.component_div(&DVector::from_column_slice(&found.sd));
            let joint = found.correlations.clone().cholesky().expect("a correlation matrix");
            let square = normalised.dot(&joint.solve(&normalised));
            ([normalised[0], normalised[2], normalised[5]], square)
        })
        .collect();
    for (place, name) in ["fx", "cx", "k1"].into_iter().enumerate() {
        let squares: f64 = errors.iter().map(|(error, _)| error[place] * error[place]).sum();
        let sd = (squares / errors.len() as f64).sqrt();
        println!("{name}: normalised errors' SD {sd:.3} of {}", errors.len());
        // 100 of them know it to 7 %.
        assert!((sd - 1.0).abs() < 0.2, "{name}: {sd}");
    }
    // With their correlations the squares of all seven follow chi-squared with 7 degrees of
    // freedom: the mean of 100 of them is 7 +- 0.37. Without correlations it would be far larger.
    let mean = errors.iter().map(|(_, square)| square).sum::<f64>() / errors.len() as f64;
    println!("joint squares of 7 numbers: mean {mean:.2}");
    assert!((mean - 7.0).abs() < 4.0 * 0.37, "{mean}");
}

/// One camera does not see how large a board is: a wrong --pitch-mm makes its distances wrong by as
/// much, of which nothing is kept.
#[test]
fn the_size_of_the_board_does_not_matter_to_the_camera() {
    let photographs = photographs(&LENS, &board(), 8, 3);
    let (columns, rows) = (board().columns() as u8, board().rows() as u8);
    let larger = PITCH_MM * 13.0 / 12.0;
    let larger =
        TargetGeometry::checker(columns, rows, larger, Origin::Center, Role::Scene, [0.0; 3]);
    let right = calibrated(&LENS, &photographs);
    let mut start = LENS.distortion;
    start.coefficients_mut().fill(0.0);
    let wrong = calibrate(&photographs, &larger.unwrap(), Choice::Alone(start), || ()).unwrap();
    let apart = (numbers(&wrong.lens) - numbers(&right.lens)).abs();
    // Where the fit ends depends on its steps, which are in millimetres too.
    let share = apart.component_div(&DVector::from_column_slice(&right.sd));
    assert!(share.amax() < 1e-2, "{share}");
}

#[test]
fn a_flat_board_is_not_said_to_be_bent() {
    let lens = LENS;
    let flat = calibrated(&lens, &photographs(&lens, &board(), 12, 5));
    let (shape, sd) = flat.shape.expect("a shape");
    for (value, sd) in shape.bend_per_mm.iter().chain([&shape.stretch]).zip(&sd) {
        // Four numbers: one in 4,000 such tests would fail by chance.
        assert!(value.abs() < 4.0 * sd, "{value} +- {sd}");
    }
}

/// Photographs as files, and `plumb calibrate` over them.
struct Session(tempfile::TempDir);

impl Session {
    fn new(photographs: &[Picture]) -> Self {
        let session = Self(tempfile::tempdir().unwrap());
        for (index, photograph) in photographs.iter().enumerate() {
            save(photograph, &session.0.path().join(format!("photograph-{index}.png")));
        }
        session
    }

    fn calibrate(&self, arguments: &[&str]) -> Output {
        let mut images: Vec<_> = std::fs::read_dir(self.0.path())
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|extension| extension == "png"))
            .collect();
        images.sort();
        binary::plumb()
            .args(["calibrate", "--pitch-mm", "20", "--out", "camera.toml"])
            .args(arguments)
            .args(images.iter().map(|path| path.file_name().unwrap()))
            .current_dir(self.0.path())
            .output()
            .expect("plumb runs")
    }

    fn refused(&self, arguments: &[&str]) -> String {
        let output = self.calibrate(arguments);
        let text = binary::messages(&output);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(!self.0.path().join("camera.toml").exists());
        text
    }
}

const BOARD: [&str; 2] = ["--board", "9x7"];

#[test]
fn the_camera_file_says_how_well_it_is_known_and_is_read_back() {
    let truth = LENS;
    let session = Session::new(&photographs(&truth, &board(), 12, 21));
    let output = session.calibrate(&["--board", "9x7", "--plot", "residuals.svg"]);
    let text = binary::messages(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    let path = session.0.path().join("camera.toml");
    let camera = plumbline_files::camera::read(&path).unwrap();
    let details = camera.provenance.details.expect("what is known of it");
    assert_eq!(details.photographs.len(), 12);
    assert!((camera.lens.fx_px - truth.fx_px).abs() < 5.0 * details.sd.fx_px);
    let coefficients = camera.lens.distortion.coefficients().len();
    assert_eq!(details.correlations.len(), 5 + coefficients);
    assert!(details.freedom.is_some_and(|freedom| freedom > 1000), "{:?}", details.freedom);
    // Noise of 2 of 180 levels leaves a corner unsure by 0.01 px.
    assert!(camera.provenance.rms_px.is_some_and(|rms_px| rms_px < 0.03), "{text}");
    assert!(details.coverage.iter().any(|line| line.contains(|letter| letter != '.')));
    let plot = std::fs::read_to_string(session.0.path().join("residuals.svg")).unwrap();
    assert!(plot.starts_with("<svg") && plot.contains("Reprojection error of each photograph"));
    for photograph in 0..12 {
        // As a label of its own: the axes have numbers with other words about them.
        let name = format!("photograph-{photograph}\n");
        assert!(plot.contains(&name), "{name} is not in the plot");
    }
    assert!(text.contains(" of 63 corners, RMS 0.0"), "{text}");
    // A second one is not written over the first.
    let again = session.calibrate(&BOARD);
    assert!(binary::messages(&again).contains("camera.toml: exists already"));
    assert_eq!(session.calibrate(&["--board", "9x7", "--force"]).status.code(), Some(0));
}

#[test]
fn what_cannot_be_a_calibration_is_refused_with_the_reason() {
    let lens = LENS;
    let good = photographs(&lens, &board(), 4, 2);

    let session = Session::new(&good);
    let text = session.refused(&["--board", "8x6"]);
    assert!(text.contains("0 of 4 show the whole board of 8 x 6 inner corners"), "{text}");
    assert!(text.contains("count the INNER corners"), "{text}");
    let text = session.refused(&["--board", "9"]);
    assert!(text.contains("numbers of INNER corners as COLUMNSxROWS, such as 6x5"), "{text}");
    let text = session.refused(&["--board", "2x7"]);
    assert!(text.contains("at least 3 columns and 3 rows"), "{text}");

    let text = Session::new(&good[..2]).refused(&BOARD);
    assert!(text.contains("2 of 2 show the whole board") && text.contains("needs 3"), "{text}");

    let small = Lens {
        width_px: 600,
        height_px: 450,
        fx_px: 750.0,
        fy_px: 751.0,
        cx_px: 300.0,
        cy_px: 224.0,
        ..lens
    };
    let text = Session::new(&photographs(&small, &board(), 3, 3)).refused(&BOARD);
    assert!(text.contains("600 x 450 px; a calibration below 640 px is refused"), "{text}");
}

#[test]
fn boards_that_are_not_tilted_make_no_camera_or_are_warned_of() {
    let lens = LENS;
    let face_on: Vec<Pose<Cam, Target>> = (0..6)
        .map(|place| {
            let side = f64::from(place % 3 - 1) * 60.0;
            Pose::from_theta([0.0, 0.0, 0.0, side, 20.0 * f64::from(place / 3), 600.0])
        })
        .collect();
    let output = Session::new(&posed(&lens, &board(), &face_on, 7)).calibrate(&BOARD);
    let text = binary::messages(&output);
    assert!(text.contains("tilt the board by 20 to 40 degrees about both axes"), "{text}");
}

#[test]
fn a_photograph_that_does_not_fit_and_a_stretched_print_are_named() {
    let lens = LENS;
    let mut all = photographs(&lens, &board(), 10, 31);
    // One photograph of a print that is 1.5 % larger in one direction.
    let stretched = {
        let points = board_points(1.015);
        TargetGeometry::from_points(9, 7, points, Role::Scene, [0.0; 3]).unwrap()
    };
    all[4] = photographs(&lens, &stretched, 1, 77).remove(0);
    let output = Session::new(&all).calibrate(&BOARD);
    let text = binary::messages(&output);
    assert!(text.contains("photograph-4.png does not fit the others"), "{text}");

    let all = photographs(&lens, &stretched, 10, 32);
    let output = Session::new(&all).calibrate(&BOARD);
    let text = binary::messages(&output);
    assert!(text.contains("rows are 1.5"), "{text}");
    assert!(text.contains("farther apart than its columns"), "{text}");
}

#[test]
fn few_photographs_and_a_frame_that_was_not_looked_at_are_warned_of() {
    let lens = LENS;
    let session = Session::new(&photographs(&lens, &board(), 5, 4));
    let text = binary::messages(&session.calibrate(&BOARD));
    assert!(text.contains("only 5 photographs show the board; take 10 to 20"), "{text}");

    // Always at one place, far from every side, and tilted well.
    let in_one_place: Vec<Pose<Cam, Target>> = (0..10)
        .map(|turn| {
            let angle = f64::from(turn) * 0.63;
            let tilt = [0.0, 0.5 * angle.sin(), 0.5 * angle.cos()];
            Pose::from_theta([tilt[0], tilt[1], tilt[2], -120.0, 0.0, 800.0])
        })
        .collect();
    let session = Session::new(&posed(&lens, &board(), &in_one_place, 8));
    let text = binary::messages(&session.calibrate(&BOARD));
    assert!(text.contains("the board was seen in 12 % of the frame"), "{text}");
    let sides = "never near the left side, the right side, the upper side, the lower side";
    assert!(text.contains(sides), "{text}");
    assert!(text.contains("take more photographs with the board there"), "{text}");
}

/// Nine places, the board upright in the frame and tilted this way and that.
#[test]
fn a_corner_of_the_frame_that_no_board_reached_is_named() {
    let everywhere: Vec<Pose<Cam, Target>> = (0..9)
        .map(|place| {
            let [x, y] = [place % 3 - 1, place / 3 - 1].map(f64::from);
            let tilt = if place % 2 == 0 { [0.3, 0.25] } else { [-0.25, 0.3] };
            Pose::from_theta([0.0, tilt[0], tilt[1], 124.0 * x, 84.0 * y, 600.0])
        })
        .collect();
    let verdict = |poses: &[Pose<Cam, Target>]| {
        let session = Session::new(&posed(&LENS, &board(), poses, 9));
        binary::messages(&session.calibrate(&BOARD))
    };
    let text = verdict(&everywhere);
    assert!(text.contains("verdict: good"), "{text}");
    let text = verdict(&everywhere[1..]);
    assert!(text.contains("never near the upper left corner; take more"), "{text}");
    assert!(text.contains("the next one in the upper left corner"), "{text}");
    assert!(!text.contains("verdict: good"), "{text}");
}

#[test]
fn photographs_of_two_sizes_are_refused_in_words_of_this_command() {
    let lens = LENS;
    let smaller = Lens { width_px: 720, height_px: 540, cx_px: 367.0, cy_px: 264.0, ..lens };
    let mut both = photographs(&lens, &board(), 1, 6);
    both.extend(photographs(&smaller, &board(), 1, 6));
    let text = Session::new(&both).refused(&BOARD);
    assert!(text.contains("720 x 540 px, but the frames up to"), "{text}");
    assert!(text.contains("give frames of one size at a time"), "{text}");
    assert!(!text.contains("track"), "{text}");
}

#[test]
fn more_photographs_than_there_is_room_for_are_refused() {
    let session = Session::new(&photographs(&LENS, &board(), 1, 5));
    let output = binary::plumb()
        .args(["calibrate", "--pitch-mm", "20", "--out", "camera.toml", "--board", "9x7"])
        .args(std::iter::repeat_n("photograph-0.png", 201))
        .current_dir(session.0.path())
        .output()
        .expect("plumb runs");
    let text = binary::messages(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("images: more than 200; 10 to 20 photographs"), "{text}");
}

/// OpenCV's own sample, whose print was not glued to anything.
#[test]
fn a_bent_board_is_said_to_be_bent() {
    let Some(directory) = data("opencv_left") else { return };
    let out = tempfile::tempdir().unwrap();
    let photographs = std::fs::read_dir(&directory).unwrap().map(|entry| entry.unwrap().path());
    let output = binary::plumb()
        .args(["calibrate", "--board", "9x6", "--pitch-mm", "25", "--model", "brown5", "--out"])
        .arg(out.path().join("camera.toml"))
        .args(photographs.filter(|path| path.extension().is_some_and(|end| end == "jpg")))
        .output()
        .expect("plumb runs");
    let text = binary::messages(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("the board is bent by 0."), "{text}");
    assert!(text.contains("glue the print to glass or an aluminium plate"), "{text}");
}

fn board_points(stretch: f64) -> heapless::Vec<[f64; 3], 120> {
    (0..63)
        .map(|corner| {
            let (column, row) = (corner % 9, corner / 9);
            let at =
                |place: i32, count: i32| (f64::from(place) - f64::from(count - 1) / 2.0) * PITCH_MM;
            [at(column, 9), at(row, 7) * stretch, 0.0]
        })
        .collect()
}

/// What OpenCV's calibrateCamera (5.0.0, findChessboardCorners, cornerSubPix with +-5 px, k1 k2
/// p1 p2 k3) makes of the same photographs: RMS, and fx with its standard deviation.
#[test]
fn real_photographs_make_a_camera_no_worse_than_opencvs() {
    let sets = [
        ("opencv_left", "", [9, 6], 25.0, [0.1955, 532.83, 0.44]),
        ("ur3a_cam1", "intrinsic", [9, 7], 20.0, [0.3302, 1576.14, 2.07]),
    ];
    for (name, folder, [columns, rows], pitch_mm, [rms_px, fx_px, sd_px]) in sets {
        let Some(directory) = data(name) else { return };
        let mut paths: Vec<_> = std::fs::read_dir(directory.join(folder))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|extension| extension == "jpg"))
            .collect();
        paths.sort();
        let pictures: Vec<Picture> = paths
            .iter()
            .map(|path| {
                let image = image::open(path).unwrap().into_luma8();
                let (width, height) = (image.width() as usize, image.height() as usize);
                let place = path.display().to_string();
                Picture { place, samples: image.into_raw(), width, height }
            })
            .collect();
        let board =
            TargetGeometry::checker(columns, rows, pitch_mm, Origin::Center, Role::Scene, [0.0; 3]);
        let found = calibrate(
            &pictures,
            &board.unwrap(),
            Choice::Alone(Distortion::Brown5([0.0; 5])),
            || (),
        );
        let found = found.unwrap_or_else(|failure| panic!("{name}: {failure:?}"));
        println!(
            "{name}: RMS {:.4} px, fx {:.2} +- {:.2} px",
            found.rms_px, found.lens.fx_px, found.sd[0]
        );
        assert!(found.rms_px <= rms_px, "{name}: {}", found.rms_px);
        let off_px = (found.lens.fx_px - fx_px).abs();
        assert!(off_px < 3.0 * sd_px.min(found.sd[0]), "{name}: {}", found.lens.fx_px);
        assert!(found.outcomes.iter().all(|outcome| outcome.used().is_some()), "{name}");
    }
}

/// Lenses that are told from those of smaller models by what 20 photographs show.
fn lenses_of_three_models() -> [Lens; 3] {
    [
        Distortion::Radial2([-0.2, 0.06]),
        Distortion::Brown5([-0.2, 0.06, 0.004, -0.003, 0.02]),
        Distortion::Fisheye4([-0.03, 0.02, -0.02, 0.01]),
    ]
    .map(|distortion| Lens { fx_px: 600.0, fy_px: 601.0, distortion, ..LENS })
}

#[test]
fn the_model_that_made_the_photographs_describes_them_as_well_as_any() {
    for (seed, truth) in (0..).zip(lenses_of_three_models()) {
        assert_eq!(truth.check(), Ok(()));
        let photographs = photographs(&truth, &board(), 20, 400 + seed);
        let found = calibrate(&photographs, &board(), Choice::Supported, || ()).expect("a camera");
        for fit in &found.models {
            println!("{}: {:?}", fit.model.name(), fit.figures);
        }
        println!("{:?} taken for {:?}", found.lens.distortion, truth.distortion);
        // The true model, or a smaller one that puts no pixel of the frame elsewhere by more than
        // the photographs can tell: a tenth of a pixel in the corners, which few boards reach.
        let mut worst_px = 0.0_f64;
        for x in [0.0, 200.0, 400.0, 600.0, 799.0] {
            for y in [0.0, 150.0, 300.0, 450.0, 599.0] {
                let ray = truth.ray_from_raw(&nalgebra::Vector2::new(x, y)).expect("a ray");
                let (found_px, _) = found.lens.raw_from_ray_with_jacobian(&ray);
                let (true_px, _) = truth.raw_from_ray_with_jacobian(&ray);
                worst_px = worst_px.max((found_px - true_px).norm());
            }
        }
        println!("worst {worst_px:.3} px");
        let is_true_model = found.lens.distortion.name() == truth.distortion.name();
        assert!(is_true_model || worst_px < 0.1, "{:?}: {worst_px} px", found.lens.distortion);
    }
}

#[test]
fn a_model_that_is_too_small_for_the_lens_is_warned_of_and_one_that_suffices_is_not() {
    let [radial, tangential, _] = lenses_of_three_models();
    for (truth, is_too_small) in [(tangential, true), (radial, false)] {
        let session = Session::new(&photographs(&truth, &board(), 12, 410));
        let output = session.calibrate(&["--board", "9x7", "--model", "radial2"]);
        let text = binary::messages(&output);
        assert_eq!(output.status.code(), Some(0), "{text}");
        let words = "describes photographs that it was not fitted to better than radial2 does; \
                     leave out --model";
        assert_eq!(text.contains(words), is_too_small, "{:?}: {text}", truth.distortion);
    }
}
