//! What people give to the host's programs: descriptions as TOML, YAML and JSON, tables as CSV, and
//! recordings of motion capture as TRC and C3D.
//!
//! The first byte chooses the reader, the rest is the file.
//!
//! Laws: what is read is sound: its numbers are finite, its lists have the lengths that they should; and
//! what this project writes itself is read again to the same.

use std::cell::OnceCell;
use std::fs;
use std::path::PathBuf;

use plumbline::pose::{Cam, Pose};
use plumbline_analysis::agreement::axes::Axes;
use plumbline_analysis::series::Series;
use plumbline_bedside::box_settings;
use plumbline_files::lens_id::LensId;
use plumbline_files::{camera, poses, scene, targets};
use plumbline_session::protocol::Protocol;
use plumbline_stream::fixture;
use plumbline_trial::markers::Markers;
use plumbline_trial::positions::{Columns, Table, Unit};
use plumbline_trial::verdict::Criteria;
use tempfile::TempDir;

/// The name of a file in errors.
const PLACE: &str = "input";

/// A reader, and a good file for it.
struct Kind {
    read: fn(&[u8]),
    good: fn() -> Vec<Vec<u8>>,
}

const KINDS: [Kind; 9] = [
    Kind { read: |bytes| camera_file(&text(bytes)), good: cameras },
    Kind { read: |bytes| targets_file(&text(bytes)), good: target_files },
    Kind { read: |bytes| scene_file(&text(bytes)), good: scenes },
    Kind { read: |bytes| settings_file(&text(bytes)), good: settings },
    Kind { read: |bytes| protocol_file(&text(bytes)), good: protocols },
    Kind { read: pose_table, good: pose_tables },
    Kind { read: position_table, good: position_tables },
    Kind { read: |bytes| markers("a.trc", bytes), good: trc },
    Kind { read: |bytes| markers("a.c3d", bytes), good: c3d },
];

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    if let Some((kind, file)) = bytes.split_first() {
        (KINDS[usize::from(*kind) % KINDS.len()].read)(file);
    }
}

/// A good file for each reader.
pub fn seeds() -> Vec<Vec<u8>> {
    let of = |(number, kind): (usize, &Kind)| {
        let files = (kind.good)().into_iter();
        files.map(move |file| [&[number as u8], &file[..]].concat()).collect::<Vec<_>>()
    };
    KINDS.iter().enumerate().flat_map(of).collect()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A file of this name with these bytes, in a folder of this thread.
fn file(name: &str, bytes: &[u8]) -> PathBuf {
    thread_local! {
        static FOLDER: OnceCell<TempDir> = const { OnceCell::new() };
    }
    FOLDER.with(|folder| {
        let make = || tempfile::tempdir().expect("a temporary folder");
        let path = folder.get_or_init(make).path().join(name);
        fs::write(&path, bytes).expect("a temporary file");
        path
    })
}

fn camera_file(text: &str) {
    let Ok(found) = camera::parse(text, PLACE) else {
        // The stated limits of a scene belong to a trial's verdict, which reads the same kind of text.
        let _ = Criteria::parse(text, PLACE);
        return;
    };
    found.lens.check().expect("a lens that is read is sound");
    let written = camera::to_toml(&found);
    assert_eq!(camera::parse(&written, PLACE).as_ref(), Ok(&found), "{written}");
}

fn targets_file(text: &str) {
    let Ok(found) = targets::parse(text, PLACE) else { return };
    for target in &found.targets {
        let geometry = &target.geometry;
        assert!(geometry.pitch_mm().is_finite() && geometry.pitch_mm() > 0.0);
        for corner in 0..geometry.corner_count() {
            assert!(geometry.corner_mm(corner).iter().all(|it| it.is_finite()));
        }
    }
    let described = found.targets.iter();
    let described: Vec<_> =
        described.map(|it| targets::description(&it.name, &it.geometry)).collect();
    let written = targets::to_toml(&described);
    let again = targets::parse(&written, PLACE).expect("what is written is read");
    let points = |of: &targets::Targets| -> Vec<_> {
        let each = of.targets.iter();
        each.map(|it| (it.name.clone(), it.geometry.corner_count(), it.geometry.role())).collect()
    };
    assert_eq!(points(&again), points(&found), "{written}");
}

fn scene_file(text: &str) {
    let Ok(found) = scene::parse(text, PLACE) else { return };
    let pose = Pose::<Cam, Cam>::from_theta(found.cam_from_scene_theta);
    assert!(pose.rotation.iter().chain(&pose.translation_mm).all(|it| it.is_finite()));
    let written = scene::to_toml(&found);
    let again = scene::parse(&written, PLACE).expect("what is written is read");
    assert_eq!(again.cam_from_scene_theta, found.cam_from_scene_theta, "{written}");
}

fn settings_file(text: &str) {
    let Ok(found) = box_settings::parse(text, PLACE) else { return };
    let mut config = fixture::config();
    if found.apply(&mut config, PLACE).is_ok() {
        config.check().expect("settings that are taken leave a sound configuration");
    }
    let written = found.to_toml();
    let again = box_settings::parse(&written, PLACE).expect("what is written is read");
    assert_eq!(again.to_toml(), written);
}

fn protocol_file(text: &str) {
    let Ok(found) = Protocol::parse(text, PLACE) else { return };
    found.check(PLACE).expect("a protocol that is read is sound");
    let written = found.text();
    let again = Protocol::parse(&written, PLACE).expect("what is written is read");
    assert_eq!(again.text(), written);
}

fn pose_table(bytes: &[u8]) {
    for row in poses::parse(bytes, PLACE).into_iter().flatten() {
        let numbers = row.cam_from_target().map(|it| it.translation_mm);
        assert!(numbers.is_none_or(|it| it.iter().all(|it| it.is_finite())));
        assert!(row.time_s.is_finite());
    }
}

fn series(found: &Series) {
    let time_s = found.time_s();
    assert!(time_s.iter().all(|it| it.is_finite()));
    assert!(time_s.windows(2).all(|pair| pair[0] < pair[1]), "time does not increase");
    assert!(found.rate_hz().is_finite() && found.rate_hz() > 0.0);
}

fn position_table(bytes: &[u8]) {
    let table = Table {
        path: file("plate.csv", bytes),
        columns: Columns::parse("time=time,ap=x,ml=y").expect("columns"),
        unit: Unit::Mm,
        delimiter: None,
    };
    if let Ok(found) = table.read() {
        series(&found.series);
        let letters: usize = found.warnings.iter().map(String::len).sum();
        assert!(letters < 10_000, "{letters} letters of warnings");
    }
}

fn markers(name: &str, bytes: &[u8]) {
    let Ok(found) = Markers::read(&file(name, bytes)) else { return };
    assert!(found.rate_hz.is_finite() && found.rate_hz > 0.0, "{} Hz", found.rate_hz);
    assert!(found.first_s.is_finite());
    let axes = Axes::parse("ap=X,ml=-Y,si=Z").expect("axes");
    let frames = found.markers.first().map_or(0, |marker| marker.position.len());
    for marker in &found.markers {
        assert_eq!(marker.position.len(), frames);
    }
    for marker in found.markers.iter().take(4) {
        let names = [marker.name.clone()];
        for unit in [None, Some(Unit::M)] {
            if let Ok(found) = found.series(&names, unit, &axes) {
                series(&found);
            }
        }
    }
}

fn cameras() -> Vec<Vec<u8>> {
    let toml = "width_px = 1456\nheight_px = 1088\nfx_px = 1740.0\nfy_px = 1741.5\ncx_px = 727.5\n\
        cy_px = 543.5\nskew_px = 0.0\nmodel = \"brown5\"\ndistortion = [-0.10, 0.02, 0.0, 0.0, 0.0]\n\
        readout_ms = 12.5\nreadout_sd_ms = 0.02\nrms_px = 0.1\nimages = 15\ndate = \"2026-11-21\"\n";
    let yaml = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: \
        !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 535.5, 0., 342.25, 0.,\n       \
        536.5, 235.75, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   \
        cols: 1\n   dt: d\n   data: [ -0.26, -0.04, 0.0018, -0.0003, 0.25 ]\n";
    let ros = "image_width: 640\nimage_height: 480\ncamera_name: c\ncamera_matrix:\n  rows: 3\n  \
        cols: 3\n  data: [535.5, 0, 342.25, 0, 536.5, 235.75, 0, 0, 1]\ndistortion_model: \
        plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.26, -0.04, 0, 0, 0.2]\n";
    let json = "{\"image_width\": 640, \"image_height\": 480, \"camera_matrix\": {\"type_id\": \
        \"opencv-matrix\", \"rows\": 3, \"cols\": 3, \"dt\": \"d\", \"data\": [535.5, 0.0, 342.25, \
        0.0, 536.5, 235.75, 0.0, 0.0, 1.0]}, \"distortion_coefficients\": {\"type_id\": \
        \"opencv-matrix\", \"rows\": 1, \"cols\": 5, \"dt\": \"d\", \"data\": [-0.26, -0.04, 0.0018, \
        -0.0003, 0.25]}}";
    let criteria = include_str!("../../../host-tools/trial/src/verdict/criteria.toml");
    [toml, yaml, ros, json, criteria].map(|it| it.as_bytes().to_vec()).to_vec()
}

fn target_files() -> Vec<Vec<u8>> {
    let points: Vec<String> = (0..12)
        .map(|it| format!("[{}.0, {}.0, 0.0{}]", 12 * (it % 4), 12 * (it / 4), it % 3))
        .collect();
    let listed = format!(
        "[[target]]\nname = \"a\"\nrole = \"scene\"\ncolumns = 4\nrows = 3\npoints_mm = [{}]\n",
        points.join(", ")
    );
    let mut all = targets::standard_pair();
    all.push(targets::standard_board());
    vec![targets::to_toml(&all).into_bytes(), listed.into_bytes()]
}

fn scenes() -> Vec<Vec<u8>> {
    let good = scene::SceneFile {
        cam_from_scene_theta: [0.1, -0.2, 0.3, 10.0, -20.0, 1500.0],
        source: "board.y4m".to_owned(),
        camera: Some(LensId::of(&camera::stand_in(640, 480))),
    };
    vec![scene::to_toml(&good).into_bytes()]
}

fn settings() -> Vec<Vec<u8>> {
    let own = box_settings::BoxSettings::of(&fixture::config()).to_toml();
    let more = "[links]\nudp = \"10.0.0.1:4210\"\nserial = \"/dev/ttyS0:115200\"\n[network]\n\
        address = \"192.168.1.5/24\"\n[machine]\nrealtime_priority = 50\n";
    vec![own.into_bytes(), more.as_bytes().to_vec()]
}

fn protocols() -> Vec<Vec<u8>> {
    [
        include_str!("../../../host-tools/session/src/protocol/mctsib.toml"),
        include_str!("../../../host-tools/session/src/protocol/eyes_open_closed.toml"),
        include_str!("../../../host-tools/session/src/protocol/stand.toml"),
    ]
    .map(|it| it.as_bytes().to_vec())
    .to_vec()
}

fn pose_tables() -> Vec<Vec<u8>> {
    let good = "frame,time_s,target,state,theta1_rad,theta2_rad,theta3_rad,x_mm,y_mm,z_mm\n\
        0,0.0,lumbar,tracking,0.1,0.2,-0.3,1.5,2.5,900.25\n0,0.0,\"a, b\",acquiring,,,,,,\n\
        1,0.016,lumbar,tracking,0.1,0.2,-0.3,1.5,2.5,900.25\n";
    vec![good.as_bytes().to_vec()]
}

fn position_tables() -> Vec<Vec<u8>> {
    let mut good = "Plate \"5\";\n\ntime;x;y;note\n".to_owned();
    for row in 0..12 {
        good += &format!("{:.2};{};-{row};\"a;b\"\n", f64::from(row) / 50.0, row % 5);
    }
    let mut other = "time,x [mm],x,y\r\n".to_owned();
    for row in 0..12 {
        other += &format!("{:.2},1,{},\r\n", f64::from(row) / 100.0, row * row % 7);
    }
    vec![good.into_bytes(), other.into_bytes()]
}

fn trc() -> Vec<Vec<u8>> {
    let mut good = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\t\
        Units\n100\t100\t9\t2\tmm\nFrame#\tTime\tA\t\t\tB\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
        .to_owned();
    for frame in 1..=9 {
        good += &format!("{frame}\t0.0{}\t1\t2\t3.5\t{frame}\tNaN\t6\n", frame - 1);
    }
    vec![good.into_bytes()]
}

/// A recording of one marker, by the C3D User Guide: a header, one block of parameters, frames.
fn c3d() -> Vec<Vec<u8>> {
    const BLOCK: usize = 512;
    let mut file = vec![0; 2 * BLOCK];
    let put = |file: &mut Vec<u8>, at: usize, bytes: &[u8]| {
        file[at..at + bytes.len()].copy_from_slice(bytes);
    };
    // The first block of the parameters and the mark of the format; points, analog samples, the first
    // and the last frame, the longest gap, the scale, the first block of frames.
    put(&mut file, 0, &[2, 0x50, 1, 0, 0, 0, 1, 0, 9, 0, 10, 0]);
    put(&mut file, 12, &(-1.0_f32).to_le_bytes());
    put(&mut file, 16, &[3, 0, 0, 0]);
    put(&mut file, 20, &50.0_f32.to_le_bytes());
    // Parameters: their number of blocks, and numbers as on a PC.
    put(&mut file, BLOCK, &[1, 0x50, 1, 84]);
    let mut parameters = Vec::new();
    let mut add = |name: &str, id: i8, body: &[u8]| {
        parameters.extend([name.len() as u8, id.cast_unsigned()]);
        parameters.extend(name.as_bytes());
        parameters.extend((2 + body.len() as u16).to_le_bytes());
        parameters.extend(body);
    };
    add("POINT", -1, &[0]);
    // The bytes of an element, the number of dimensions, these, the elements, and a description.
    add("LABELS", 1, &[0xFF, 2, 4, 1, b'A', b' ', b' ', b' ', 0]);
    add("UNITS", 1, &[0xFF, 1, 2, b'm', b'm', 0]);
    parameters.extend([0, 0]);
    put(&mut file, BLOCK + 4, &parameters);
    for frame in 0..9_u8 {
        for number in [f32::from(frame), 2.0, 3.0, 0.0] {
            file.extend(number.to_le_bytes());
        }
    }
    file.resize(file.len().next_multiple_of(BLOCK), 0);
    vec![file]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Otherwise nothing is tried but how files are refused.
    #[test]
    fn the_seeds_are_read() {
        for camera in &cameras()[..4] {
            camera::parse(&text(camera), PLACE).unwrap();
        }
        Criteria::parse(&text(&cameras()[4]), PLACE).unwrap();
        for file in target_files() {
            targets::parse(&text(&file), PLACE).unwrap();
        }
        for file in scenes() {
            scene::parse(&text(&file), PLACE).unwrap();
        }
        for file in settings() {
            box_settings::parse(&text(&file), PLACE).unwrap();
        }
        for bytes in trc() {
            assert_eq!(Markers::read(&file("a.trc", &bytes)).unwrap().markers.len(), 2);
        }
        for bytes in c3d() {
            assert_eq!(Markers::read(&file("a.c3d", &bytes)).unwrap().markers.len(), 1);
        }
        for table in pose_tables() {
            assert_eq!(poses::parse(&table[..], PLACE).unwrap().len(), 3);
        }
    }
}
