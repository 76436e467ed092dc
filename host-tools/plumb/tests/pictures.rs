//! Photographs that are taken for a recording.

use image::{GrayImage, Luma};

use crate::common::finished::plumb;

const CAMERA: &str = "width_px = 640\nheight_px = 480\nfx_px = 800.0\nfy_px = 800.0\ncx_px = 319.5\n\
    cy_px = 239.5\nmodel = \"radial2\"\ndistortion = [0.0, 0.0]\n";

const TARGETS: &str = "[[target]]\nname = \"board\"\nrole = \"scene\"\ncolumns = 6\nrows = 5\n\
    pitch_mm = 12.0\n";

/// In a recording a target is looked for near its last place, or in a part of the frame only. Of
/// photographs that do not follow each other many would have no pose, without a word on why.
#[test]
fn photographs_that_are_taken_for_a_recording_are_doubted() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("camera.toml"), CAMERA).unwrap();
    std::fs::write(folder.path().join("targets.toml"), TARGETS).unwrap();
    for name in ["a.png", "b.png"] {
        let picture = GrayImage::from_pixel(640, 480, Luma([128]));
        picture.save(folder.path().join(name)).unwrap();
    }
    let track = ["track", "--camera", "camera.toml", "--targets", "targets.toml"];
    for (more, is_doubted) in [
        (&["a.png", "b.png"][..], true),
        (&["--independent", "a.png", "b.png"], false),
        (&["a.png"], false),
    ] {
        let done = plumb(folder.path(), &[&track[..], more].concat());
        assert_eq!(done.code, Some(0), "{more:?}: {}", done.stderr);
        let hint = "if they are photographs that do not follow each other, give --independent";
        assert_eq!(done.stderr.contains(hint), is_doubted, "{more:?}: {}", done.stderr);
    }
}
