use plumbline_test_support::data;

use super::*;

const GOOD: &str = "width_px = 1456\nheight_px = 1088\nfx_px = 1740\nfy_px = 1741.5\ncx_px = 727.5\ncy_px = 543.5\nmodel = \"radial2\"\ndistortion = [-0.1, 0.02]\n";

fn opencv_yaml(header: &str, coefficients: &str) -> String {
    format!(
        "{header}\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 535.5, 0., 342.25, 0.,\n       536.5, 235.75, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ {coefficients} ]\navg_reprojection_error: 0.39\nnframes: 13\n"
    )
}

#[test]
fn a_camera_toml_comes_back() {
    let camera = parse(GOOD, "camera.toml").unwrap();
    assert_eq!(camera.lens.fx_px, 1740.0);
    assert_eq!(camera.lens.skew_px, 0.0);
    assert_eq!(camera.readout_ns, 0);
    assert_eq!(camera.lens.distortion, Distortion::Radial2([-0.1, 0.02]));
    let camera = Camera {
        lens: Lens {
            skew_px: 0.1 + 0.2,
            distortion: Distortion::Brown5([-0.2, 0.1, 1e-3, -2e-4, 1e-17]),
            ..camera.lens
        },
        readout_ns: -16_000_001,
        provenance: Provenance {
            readout_sd_ms: Some(0.021),
            rms_px: Some(0.25),
            images: Some(36),
            date: Some("2026-11-21".to_owned()),
            source: Some("a \"quoted\" = source".to_owned()),
            details: Some(Details {
                verdict: vec!["the board is bent by 0.5 mm".to_owned()],
                coverage: vec!["..12".to_owned(), "9...".to_owned()],
                correlations: (0..10).map(|row| vec![1.0 / 3.0; row]).collect(),
                freedom: Some(812),
                sd: Deviations {
                    fx_px: 0.3,
                    fy_px: 0.4,
                    cx_px: 0.5,
                    cy_px: 0.6,
                    skew_px: 0.01,
                    distortion: vec![1e-3, 2e-3, 3e-3, 4e-3, 5e-3],
                },
                photographs: vec![DetailsOfPhotograph {
                    file: "a.png".to_owned(),
                    rms_px: Some(0.1),
                    corners: Some(63),
                    refused: None,
                }],
            }),
        },
    };
    assert_eq!(parse(&to_toml(&camera), "camera.toml"), Ok(camera));
}

/// A camera file with what `plumb calibrate` says of its uncertainty.
fn calibrated(correlations: &str, sd_of_distortion: &str) -> String {
    format!(
        "{GOOD}[calibration]\nverdict = []\ncoverage = []\nphotographs = []\n{correlations}\n\
         [calibration.sd]\nfx_px = 1\nfy_px = 1\ncx_px = 1\ncy_px = 1\nskew_px = 1\n\
         distortion = {sd_of_distortion}\n"
    )
}

#[test]
fn a_calibration_of_an_older_program_has_no_correlations() {
    let camera = parse(&calibrated("", "[1e-3, 2e-3]"), "camera.toml").unwrap();
    let details = camera.provenance.details.unwrap();
    assert_eq!((details.correlations.len(), details.freedom), (0, None));
}

#[test]
fn an_uncertainty_that_is_none_is_named() {
    let rows = |last: &str| {
        format!(
            "correlations = [[], [0], [0, 0], [0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 0, {last}]]"
        )
    };
    assert!(parse(&calibrated(&rows("-1"), "[1e-3, 2e-3]"), "c.toml").is_ok());
    let cases = [
        (rows("1.1"), "[1e-3, 2e-3]", "calibration.correlations", "1.1"),
        (rows("nan"), "[1e-3, 2e-3]", "calibration.correlations", "NaN"),
        (rows("0, 0"), "[1e-3, 2e-3]", "calibration.correlations", "7 numbers"),
        ("correlations = [[], [0]]".to_owned(), "[1e-3, 2e-3]", "calibration.correlations", "7"),
        (rows("0"), "[1e-3]", "calibration.sd.distortion", "1 sd, but 2 coefficients"),
        (rows("0"), "[1e-3, -2e-3]", "calibration.sd", "-0.002"),
        (rows("0"), "[1e-3, inf]", "calibration.sd", "inf"),
    ];
    for (correlations, sd, field, found) in cases {
        let error = parse(&calibrated(&correlations, sd), "c.toml").unwrap_err();
        assert_eq!(error.field, field, "{error}");
        assert!(error.found.contains(found), "{error}");
    }
    let none = calibrated("freedom = 0", "[1e-3, 2e-3]");
    assert_eq!(parse(&none, "c.toml").unwrap_err().field, "calibration.freedom");
    assert!(parse(&none.replace("freedom = 0", "freedom = 1"), "c.toml").is_ok());
}

#[test]
fn each_wrong_field_of_a_camera_toml_is_named() {
    let cases = [
        ("fx_px = 1740\n", "", "fx_px", "missing"),
        ("fx_px = 1740", "fx = 1740", "fx ", "unknown field"),
        ("fx_px = 1740", "fx_px = 0", "fx_px, fy_px", "0 and 1741.5"),
        ("fx_px = 1740", "fx_px = nan", "fx_px, fy_px", "NaN"),
        ("fx_px = 1740", "fx_px = \"1740\"", "fx_px (line 3)", "string"),
        ("width_px = 1456", "width_px = 1e9", "width_px", "1000000000"),
        ("width_px = 1456", "width_px = 9000", "width_px, height_px", "9000"),
        ("cx_px = 727.5", "cx_px = -99999", "cx_px, cy_px", "-99999"),
        ("[-0.1, 0.02]", "[-0.1, 0.02]\nreadout_ms = 1000.1", "readout_ms", "1000.1"),
        ("[-0.1, 0.02]", "[-0.1, 0.02]\nreadout_ms = nan", "readout_ms", "NaN"),
        ("[-0.1, 0.02]", "[-0.1, 0.02]\nreadout_sd_ms = -0.1", "readout_sd_ms", "-0.1"),
        ("[-0.1, 0.02]", "[-0.1, 0.02]\nreadout_sd_ms = nan", "readout_sd_ms", "NaN"),
        ("[-0.1, 0.02]", "[-0.1]", "distortion", "1 coefficient"),
        ("[-0.1, 0.02]", "[-0.9, 0.0]", "distortion", "-0.9"),
        ("[-0.1, 0.02]", "[inf, 0.0]", "distortion", "inf"),
        ("\"radial2\"", "\"fisheye\"", "model", "fisheye"),
        ("fy_px = 1741.5", "fx_px = 1741.5", "fx_px", "duplicate"),
        ("fy_px = 1741.5", "fy_px 1741.5", "", ""),
    ];
    for (good, bad, field, found) in cases {
        let error = parse(&GOOD.replacen(good, bad, 1), "camera.toml").unwrap_err();
        assert!(error.field.starts_with(field), "{bad}: {error}");
        assert!(error.found.contains(found), "{bad}: {error}");
        assert!(!error.to_string().contains('\n'), "{error}");
    }
}

#[test]
fn opencv_yaml_of_both_headers_is_read() {
    for header in ["%YAML:1.0", "%YAML 1.2"] {
        let camera = parse(&opencv_yaml(header, "-0.26, -0.03, 1.7e-03, -3e-04, .5"), "c").unwrap();
        let Lens { width_px, height_px, fx_px, fy_px, cx_px, cy_px, skew_px, .. } = camera.lens;
        assert_eq!((width_px, height_px), (640, 480));
        assert_eq!([fx_px, fy_px, cx_px, cy_px, skew_px], [535.5, 536.5, 342.25, 235.75, 0.0]);
        let brown = Distortion::Brown5([-0.26, -0.03, 1.7e-3, -3e-4, 0.5]);
        assert_eq!(camera.lens.distortion, brown);
        assert_eq!((camera.provenance.rms_px, camera.provenance.images), (Some(0.39), Some(13)));
    }
}

#[test]
fn opencv_json_is_read() {
    let text = r#"{
    "image_width": 640,
    "image_height": 480,
    "camera_matrix": { "type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d",
        "data": [ 535.9, 0.0, 342.3, 0.0, 535.8, 235.6, 0.0, 0.0, 1.0 ] },
    "distortion_coefficients": { "type_id": "opencv-matrix", "rows": 1, "cols": 4, "dt": "d",
        "data": [ -0.26, 0.1, 0.0017, -0.0003 ] },
    "avg_reprojection_error": 0.39
}"#;
    let lens = parse(text, "c.json").unwrap().lens;
    assert_eq!((lens.fx_px, lens.cy_px), (535.9, 235.6));
    assert_eq!(lens.distortion, Distortion::Brown5([-0.26, 0.1, 0.0017, -0.0003, 0.0]));
}

const ROS: &str = "image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [438.783367, 0.000000, 305.593336, 0.000000, 437.302876, 243.738352, 0.000000, 0.000000, 1.000000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [393.653800, 0, 322.797939, 0, 0, 393.6538, 241.090902, 0, 0, 0, 1, 0]
";

#[test]
fn ros_camera_info_is_read() {
    let camera = parse(ROS, "camera.yaml").unwrap();
    assert_eq!((camera.lens.fx_px, camera.lens.fy_px), (438.783367, 437.302876));
    assert_eq!(camera.provenance.source.unwrap(), "camera.yaml, camera narrow_stereo");
}

#[test]
fn every_model_of_opencv_and_ros_is_read() {
    let ros = |model: &str, coefficients: &str| {
        let text = ROS.replace("plumb_bob", model);
        let five = "-0.361976, 0.110510, 0.001014, 0.000505, 0.000000";
        parse(&text.replace(five, coefficients), "c.yaml")
    };
    let fisheye = Distortion::Fisheye4([-0.01, 0.02, 0.0, 0.001]);
    for model in ["equidistant", "fisheye"] {
        let camera = ros(model, "-0.01, 0.02, 0, 0.001").unwrap();
        assert_eq!(camera.lens.distortion, fisheye);
    }
    let named = opencv_yaml("%YAML:1.0", "-0.01, 0.02, 0., 0.001") + "fisheye_model: 1\n";
    assert_eq!(parse(&named, "c.yaml").unwrap().lens.distortion, fisheye);

    let rational = Distortion::Rational8([0.1, 0.02, 1e-3, 2e-3, 0.0, 0.3, 0.02, 1e-3]);
    let eight = "0.1, 0.02, 1e-3, 2e-3, 0., 0.3, 0.02, 1e-3";
    assert_eq!(ros("rational_polynomial", eight).unwrap().lens.distortion, rational);
    let prism = format!("{eight}, 1e-3, 0., -1e-3, 0.");
    let expected = [0.1, 0.02, 1e-3, 2e-3, 0.0, 0.3, 0.02, 1e-3, 1e-3, 0.0, -1e-3, 0.0];
    for text in [prism.clone(), format!("{prism}, 0., 0.")] {
        let camera = parse(&opencv_yaml("%YAML:1.0", &text), "c.yaml").unwrap();
        assert_eq!(camera.lens.distortion, Distortion::ThinPrism12(expected));
    }
    // What is not used is no other model.
    let zeros = opencv_yaml("%YAML:1.0", "0.1, 0., 0., 0., 0.2, 0., 0., 0.");
    let lens = parse(&zeros, "c.yaml").unwrap().lens;
    assert_eq!(lens.distortion, Distortion::Brown5([0.1, 0.0, 0.0, 0.0, 0.2]));

    // And in camera.toml, there and back.
    for distortion in [fisheye, rational, Distortion::ThinPrism12(expected)] {
        let camera = Camera {
            lens: Lens { distortion, ..lens },
            readout_ns: 0,
            provenance: Provenance::default(),
        };
        assert_eq!(parse(&to_toml(&camera), "camera.toml"), Ok(camera));
    }
}

#[test]
fn lens_models_that_are_not_ours_are_refused_by_name() {
    let error = parse(&ROS.replace("plumb_bob", "omnidirectional"), "c.yaml").unwrap_err();
    assert_eq!(error.field, "distortion_model");
    assert!(error.found.contains("omnidirectional"), "{error}");
    let error = parse(&ROS.replace("plumb_bob", "equidistant"), "c.yaml").unwrap_err();
    assert_eq!(error.field, "distortion_coefficients");
    assert!(error.found.contains("5 coefficients"), "{error}");
    let error = parse("<?xml version=\"1.0\"?>", "c.xml").unwrap_err();
    assert!(error.found.contains("XML"));
    let tilted = "0.1, 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0.01, 0.";
    let error = parse(&opencv_yaml("%YAML:1.0", tilted), "c.yaml").unwrap_err();
    assert!(error.found.contains("0.01"), "{error}");
    let few = opencv_yaml("%YAML:1.0", "0.1, 0., 0.");
    assert!(parse(&few, "c.yaml").unwrap_err().found.contains("3 coefficients"));
    let wrong = GOOD.replace("\"radial2\"", "\"rational8\"");
    let error = parse(&wrong, "camera.toml").unwrap_err();
    assert_eq!(error.field, "distortion");
    assert!(error.to_string().contains("8: [k1, k2, p1, p2, k3, k4, k5, k6]"), "{error}");
}

#[test]
fn broken_yaml_is_named_by_line_or_field() {
    let error = parse(&ROS.replace("image_width: 640\n", ""), "c.yaml").unwrap_err();
    assert_eq!(error.field, "image_width");
    let error = parse(&ROS.replace("438.783367", "many"), "c.yaml").unwrap_err();
    assert_eq!(error.field, "line 7", "{error}");
    let dropped = opencv_yaml("%YAML:1.0", "0.1, 0., 0., many");
    assert_eq!(parse(&dropped, "c.yaml").unwrap_err().field, "line 15");
    let error = parse(&ROS.replace("305.593336", "[1"), "c.yaml").unwrap_err();
    assert!(!error.to_string().contains('\n'), "{error}");
    let error = parse(&ROS.replace("438.783367, ", ""), "c.yaml").unwrap_err();
    assert_eq!((error.field.as_str(), error.found.as_str()), ("camera_matrix", "3 x 3, 8 numbers"));
    let error =
        parse(&ROS.replace("image_width: 640", "image_width: 99999"), "c.yaml").unwrap_err();
    assert_eq!(error.field, "image_width");
}

#[test]
fn scaling_keeps_rays_of_the_frame_edges() {
    // The robot's camera: calibrated at 1920 x 1080, used at 1280 x 720.
    let camera = parse(
        "width_px = 1920\nheight_px = 1080\nfx_px = 1572.9\nfy_px = 1582.4\ncx_px = 952.9\ncy_px = 578.2\nskew_px = 0.3\nmodel = \"radial2\"\ndistortion = [-0.1, 0.0]\n",
        "c.toml",
    )
    .unwrap();
    let small = scaled(&camera, 1280, 720, "c.toml").unwrap();
    assert!((small.lens.cx_px - (952.9 * 2.0 / 3.0 - 1.0 / 6.0)).abs() < 1e-12);
    let edge = |lens: &Lens, x: f64, y: f64| lens.ray_from_pixel(&nalgebra::Vector2::new(x, y));
    let top_left = edge(&camera.lens, -0.5, -0.5) - edge(&small.lens, -0.5, -0.5);
    let bottom_right = edge(&camera.lens, 1919.5, 1079.5) - edge(&small.lens, 1279.5, 719.5);
    assert!(top_left.norm() < 1e-12 && bottom_right.norm() < 1e-12);

    let error = scaled(&camera, 1280, 1024, "c.toml").unwrap_err();
    assert!(error.found.contains("1920 x 1080") && error.found.contains("1280 x 1024"), "{error}");
}

#[test]
fn opencvs_own_calibration_is_read() {
    let Some(path) = data("opencv_left/left_intrinsics.yml") else { return };
    let camera = read(&path).unwrap();
    assert_eq!((camera.lens.width_px, camera.lens.height_px), (640, 480));
    assert_eq!(camera.lens.fx_px, 535.915_733_961_632);
    assert_eq!(camera.lens.distortion.coefficients()[4], 0.238_391_530_808_784_86);
    assert_eq!(camera.provenance.images, Some(13));
}
