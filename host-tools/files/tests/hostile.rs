//! No bytes make a reader panic, hang or reserve more than its limits, and what a reader accepts it
//! can go on with.

use std::path::PathBuf;

use image::{GrayImage, ImageFormat, Luma};
use plumbline::pose::{Cam, Pose};
use plumbline_files::columns::TextTable;
use plumbline_files::frames::FrameSource;
use plumbline_files::lens_id::LensId;
use plumbline_files::{camera, poses, scene, targets};
use plumbline_test_support::mutations;

/// Versions of each good file.
const VERSIONS: usize = 600;

const CAMERA_TOML: &str = "width_px = 1456\nheight_px = 1088\nfx_px = 1740.0\nfy_px = 1741.5\n\
    cx_px = 727.5\ncy_px = 543.5\nskew_px = 0.0\nmodel = \"brown5\"\n\
    distortion = [-0.10, 0.02, 0.0, 0.0, 0.0]\nreadout_ms = 12.5\nreadout_sd_ms = 0.02\n\
    rms_px = 0.1\nimages = 15\ndate = \"2026-11-21\"\nsource = \"Rücken\"\n";

const CAMERA_YAML: &str = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n\
    camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 535.5, 0., \
    342.25, 0.,\n       536.5, 235.75, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   \
    rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.26, -0.04, 0.0018, -0.0003, 0.25 ]\n";

const CAMERA_JSON: &str = "{\"image_width\": 640, \"image_height\": 480, \"camera_matrix\": \
    {\"type_id\": \"opencv-matrix\", \"rows\": 3, \"cols\": 3, \"dt\": \"d\", \"data\": [535.5, \
    0.0, 342.25, 0.0, 536.5, 235.75, 0.0, 0.0, 1.0]}, \"distortion_coefficients\": {\"type_id\": \
    \"opencv-matrix\", \"rows\": 1, \"cols\": 5, \"dt\": \"d\", \"data\": [-0.26, -0.04, 0.0018, \
    -0.0003, 0.25]}}";

/// The texts that a mutated file holds; bytes that are no text are refused before.
fn texts(good: &str) -> impl Iterator<Item = String> {
    let mutated = mutations(good.as_bytes(), VERSIONS);
    mutated.map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

#[test]
fn camera_files() {
    for good in [CAMERA_TOML, CAMERA_YAML, CAMERA_JSON] {
        assert!(camera::parse(good, "camera").is_ok(), "{good}");
        for text in texts(good) {
            let Ok(camera) = camera::parse(&text, "camera") else { continue };
            camera.lens.check().unwrap();
            assert_eq!(camera::parse(&camera::to_toml(&camera), "again").as_ref(), Ok(&camera));
        }
    }
}

#[test]
fn targets_and_scenes() {
    let pair = targets::to_toml(&targets::standard_pair());
    let measured = "[[target]]\nname = \"a\"\nrole = \"scene\"\ncolumns = 3\nrows = 2\npoints_mm = \
        [[0.0, 0.0, 0.0], [12.0, 0.0, 0.0], [24.0, 0.0, 0.1], [0.0, 12.0, 0.0], [12.0, 12.0, 0.0], \
        [24.0, 12.0, 0.0]]\n";
    for text in texts(&pair).chain(texts(measured)) {
        let Ok(found) = targets::parse(&text, "targets.toml") else { continue };
        for target in &found.targets {
            let corners = target.geometry.corner_count();
            assert!(corners > 0 && target.geometry.pitch_mm().is_finite(), "{text}");
        }
    }
    let good = scene::to_toml(&scene::SceneFile {
        cam_from_scene_theta: [0.1, -0.2, 0.3, 10.0, -20.0, 1500.0],
        source: "board.y4m".to_owned(),
        camera: Some(LensId::of(&camera::stand_in(640, 480))),
    });
    for text in texts(&good) {
        let Ok(found) = scene::parse(&text, "scene.toml") else { continue };
        let pose = Pose::<Cam, Cam>::from_theta(found.cam_from_scene_theta);
        assert!(pose.rotation.iter().chain(&pose.translation_mm).all(|it| it.is_finite()));
    }
}

#[test]
fn tables() {
    let good = "frame,time_s,target,state,theta1_rad,theta2_rad,theta3_rad,x_mm,y_mm,z_mm\n\
        0,0.0,lumbar,tracking,0.1,0.2,-0.3,1.5,2.5,900.25\n0,0.0,\"a, b\",acquiring,,,,,,\n\
        1,0.016,lumbar,tracking,0.1,0.2,-0.3,1.5,2.5,900.25\n";
    for bytes in mutations(good.as_bytes(), VERSIONS) {
        for row in poses::parse(&bytes[..], "poses.csv").into_iter().flatten() {
            let pose = row.cam_from_target();
            assert!(pose.is_none_or(|it| it.translation_mm.iter().all(|it| it.is_finite())));
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plate.csv");
    let good = "Plate \"5\";\n\ntime;x;note\n0,0;1;\"a;b\"\n0.1;2.5;ü\r\n0.2;;\n";
    for bytes in mutations(good.as_bytes(), VERSIONS) {
        std::fs::write(&path, bytes).unwrap();
        let Ok(table) = TextTable::open(&path, &["time", "x"], None, "name them") else { continue };
        let (time, x) = (table.column("time"), table.column("x"));
        for row in table.rows() {
            let Ok(row) = row else { break };
            let numbers = [time.number(&row), x.number(&row)].into_iter().flatten().flatten();
            assert!(numbers.into_iter().all(f64::is_finite));
            assert!(row.line > 0 && time.text(&row).len() < 200);
        }
    }
}

/// Every picture and video that is opened is read to its end.
#[test]
fn pictures_and_videos() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input");
    let picture = GrayImage::from_fn(80, 64, |x, y| Luma([(7 * x + 3 * y) as u8]));
    let mut good: Vec<Vec<u8>> = Vec::new();
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Pnm] {
        let mut file = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut file, format).unwrap();
        good.push(file.into_inner());
    }
    let mut video = b"YUV4MPEG2 W80 H64 F30000:1001 Ip A1:1 C420p10\n".to_vec();
    for _ in 0..2 {
        video.extend(b"FRAME\n");
        video.extend(picture.as_raw().iter().cycle().take(2 * (80 * 64 + 2 * 40 * 32)));
    }
    good.push(video);
    // Only the headers are changed: sizes are in them.
    let heads = good.iter().map(|bytes| (bytes, bytes.len().min(120)));
    for (bytes, head) in heads {
        for mutated in mutations(&bytes[..head], 200) {
            let file = [&mutated[..], &bytes[head..]].concat();
            std::fs::write(&path, file).unwrap();
            let Ok(mut source) = FrameSource::open(&[PathBuf::from(&path)], None) else { continue };
            let (width, height) = (source.width(), source.height());
            while let Ok(Some(frame)) = source.next_frame() {
                assert_eq!((frame.width, frame.height), (width, height));
            }
        }
    }
}

/// Brackets within brackets must not use up the stack, nor references the memory.
#[test]
fn nested_and_multiplied_texts_are_refused() {
    let deep = |open: &str| open.repeat(200_000 / open.len());
    let mut bomb = "a: &a [x, x, x, x, x, x, x, x, x]\n".to_owned();
    for (one, next) in "abcdefghij".chars().zip("bcdefghijk".chars()) {
        bomb += &format!("{next}: &{next} [{}]\n", vec![format!("*{one}"); 9].join(", "));
    }
    let texts = [
        format!("distortion = {}", deep("[")),
        format!("a = {}", deep("{a = ")),
        deep("[a."),
        format!("{{\"a\": {}", deep("[")),
        format!("{{\"a\": {}", deep("{\"a\": ")),
        format!("%YAML:1.0\n---\na: {}", deep("[")),
        format!("%YAML:1.0\n---\na: {}", deep("- ")),
        format!("image_width: {}", deep("{a: ")),
        format!("%YAML:1.0\n---\n{bomb}image_width: 640\n"),
    ];
    for text in texts {
        let start: String = text.chars().take(40).collect();
        assert!(camera::parse(&text, "camera").is_err(), "{start}");
        assert!(targets::parse(&text, "targets.toml").is_err(), "{start}");
        assert!(scene::parse(&text, "scene.toml").is_err(), "{start}");
    }
}
