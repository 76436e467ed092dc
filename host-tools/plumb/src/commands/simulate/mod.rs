//! `plumb simulate`: a rendered person, or a board that is photographed, as files or as a stream.

mod board;
mod video;

use std::path::{Path, PathBuf};

use image::{ImageBuffer, Luma};
use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Scene};
use plumbline_files::BadInput;
use plumbline_files::camera::{self, Camera, Provenance};
use plumbline_files::counting::counted;
use plumbline_files::lens_id::LensId;
use plumbline_files::poses::Writer;
use plumbline_files::scene::{self, SceneFile};
use plumbline_files::targets::{self, OriginName, TargetDescription, grid_size};
use plumbline_render::simulate::layout::LensChoice;
use plumbline_render::simulate::occluder::Occlusion;
use plumbline_render::simulate::recorded::{Form, truth_rows};
use plumbline_render::simulate::sway::SwaySettings;
use plumbline_render::simulate::{Simulation, SimulationSettings};

use self::video::{Video, standard_output};
use crate::ui::png;

/// Render a swaying person with both targets, and the true poses; or a board to calibrate with.
///
/// Writes into the directory DIR: frames.y4m, truth.csv, camera.toml,
/// targets.toml and scene.toml, so that `plumb track --camera DIR/camera.toml
/// --targets DIR/targets.toml DIR/frames.y4m` can run on it. The same settings
/// give the same files on every machine. A frame takes 1.6 MB, of 10 bits 4.8 MB.
///
/// With --board the camera sees a calibration board instead, in the same room: photographs as a
/// careful person would take them (DIR/photos), and the board standing upright where the person
/// will stand (DIR/scene.y4m). DIR/truth holds the true camera and scene. So everything from the
/// calibration to the report can be tried without any hardware.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:
  plumb simulate --frames 1800 --out person
  plumb simulate --out - | plumbline-board --config box.plb --replay -
  plumb simulate --board 9x6 --pitch-mm 20 --out dry
  plumb calibrate --board 9x6 --pitch-mm 20 --out camera.toml dry/photos/*.png
  plumb simulate --board 9x6 --pitch-mm 20 --fps 10 --out - | plumbline-board --config new.plb --replay -
                                         # a box before its calibration, for plumb aim --stills"
)]
pub struct SimulateArguments {
    /// Directory to write into; `-` streams the Y4M to standard output and writes nothing else
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A board of so many INNER corners instead of a person; in a stream, each photograph is shown
    /// for 5 s
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = grid_size, requires = "pitch_mm",
          conflicts_with_all = ["frames", "sway_mm", "drift_mm_s", "readout_ms", "occlude", "bits", "jpeg", "png"])]
    board: Option<[u8; 2]>,
    /// The side of the board's squares
    #[arg(long, value_name = "MM", requires = "board")]
    pitch_mm: Option<f64>,
    /// How often the board is photographed
    #[arg(long, value_name = "N", requires = "board", default_value_t = 15)]
    photographs: usize,
    /// Number of frames
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..))]
    frames: u64,
    /// Frames per second
    #[arg(long, value_name = "F", default_value_t = 60.0)]
    fps: f64,
    /// Determines motion, clutter and noise
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Noise at mid grey, standard deviation in grey levels; photon and read noise together
    #[arg(long, value_name = "LEVELS", default_value_t = 2.0)]
    noise: f64,
    /// Grey of the prints' black, of 255; toner reflects about a tenth of what paper does, and
    /// stray light adds to it: 60 with a white of 180 is a picture in poor light
    #[arg(long, value_name = "GREY", default_value_t = 20.0)]
    black: f64,
    /// Grey of the prints' white, of 255; above some 240 the brightest pixels are cut off
    #[arg(long, value_name = "GREY", default_value_t = 220.0)]
    white: f64,
    /// The lens's blur, standard deviation in pixels
    #[arg(long, value_name = "PX", default_value_t = 0.6)]
    psf: f64,
    /// The lens: f 1740 px without or with mild distortion, or f 800 px with a strong one
    #[arg(long, value_enum, default_value_t)]
    lens: LensChoice,
    /// From the camera to the back, in mm [default: 1000; 600 with the wide lens]
    #[arg(long, value_name = "MM")]
    distance: Option<f64>,
    /// How far the person sways forward and backward, as the standard deviation at the shoulder in
    /// mm; sideways and in twist in proportion. Quiet standing has 5 to 10
    #[arg(long, value_name = "MM", default_value_t = SwaySettings::default().ap_sd_mm)]
    sway_mm: f64,
    /// A steady motion of the whole person besides the sway, in mm/s: forward, to the right, up
    #[arg(long, value_name = "AP,ML,SI", value_parser = three_numbers, default_value = "0,0,0")]
    drift_mm_s: [f64; 3],
    /// A rolling shutter: milliseconds from the exposure of the first row to that of the row below
    /// the last one, negative if the sensor is read from the bottom to the top. The row that is
    /// read first is exposed at the frame's time; each row shows the person at its own instant;
    /// truth.csv has each target's pose at the time of the row of its centre
    #[arg(long, value_name = "MS", default_value_t = 0.0)]
    readout_ms: f64,
    /// How much brighter the right edge is than the left one, relative to the middle
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    gradient: f64,
    /// An arm that covers FRACTION (0 to 1) of a target's width between two times; may be repeated
    #[arg(long, value_name = "TARGET:START_S:END_S[:FRACTION]")]
    occlude: Vec<Occlusion>,
    /// Bits of a sample; of 10, the Y4M is 4:2:0 without colour
    #[arg(long, value_name = "8|10", default_value = "8", value_parser = ["8", "10"])]
    bits: String,
    /// Encode each frame as JPEG of this quality, 1 to 100, and decode it again
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,
    /// Also save frame N as DIR/frame_N.png; may be repeated
    #[arg(long, value_name = "N")]
    png: Vec<u64>,
    /// Replace files of an earlier run
    #[arg(long)]
    force: bool,
}

impl SimulateArguments {
    fn form(&self) -> anyhow::Result<Form> {
        match (self.bits.as_str(), self.jpeg) {
            ("8", None) => Ok(Form::Grey8),
            ("8", Some(quality)) => Ok(Form::Jpeg(quality)),
            (_, None) => {
                anyhow::ensure!(self.png.is_empty(), "--png has 8 bits; leave out --bits 10");
                Ok(Form::Grey10)
            }
            (_, Some(_)) => anyhow::bail!("--jpeg has 8 bits; leave out --bits 10"),
        }
    }

    fn settings(&self, form: Form) -> SimulationSettings {
        SimulationSettings {
            frame_rate_hz: self.fps,
            seed: self.seed,
            noise_levels: self.noise,
            psf_sigma_px: self.psf,
            bits: form.bits(),
            lens: self.lens,
            distance_mm: self.distance,
            black: self.black,
            white: self.white,
            gradient: self.gradient,
            readout_ms: self.readout_ms,
            sway: SwaySettings::of_ap_sd_mm(self.sway_mm),
            drift_mm_s: self.drift_mm_s,
            occlusions: self.occlude.clone(),
        }
    }
}

/// `1,2.5,-3`.
fn three_numbers(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[f64; 3]>::try_from(numbers).ok())
        .ok_or_else(|| "expected three numbers, as 0,200,0".to_owned())
}

/// Runs the subcommand.
///
/// # Errors
/// When a setting is impossible, files are in the way, or writing fails.
pub fn run(arguments: &SimulateArguments) -> anyhow::Result<()> {
    if let Some((size, pitch_mm)) = arguments.board.zip(arguments.pitch_mm) {
        return board::run(arguments, size, pitch_mm);
    }
    let form = arguments.form()?;
    let settings = arguments.settings(form);
    for number in &arguments.png {
        anyhow::ensure!(
            *number < arguments.frames,
            "--png {number}: the last frame is {}; choose a smaller number",
            arguments.frames - 1
        );
    }
    let to_stdout = arguments.out.as_os_str() == "-";
    if to_stdout {
        anyhow::ensure!(
            arguments.png.is_empty(),
            "--png needs a directory to write into, and --out is `-`; give --out a directory"
        );
        let simulation = prepared(&settings)?;
        return Video::of(simulation.camera(), arguments.fps, form, arguments.frames).write(
            |frame, luma| Ok(form.render(&simulation, frame, luma)?),
            standard_output()?,
            "standard output",
            |_, _| Ok(()),
        );
    }

    let directory = &arguments.out;
    let png_paths: Vec<_> =
        arguments.png.iter().map(|number| directory.join(format!("frame_{number}.png"))).collect();
    let [frames, truth, camera, targets, scene] =
        ["frames.y4m", "truth.csv", "camera.toml", "targets.toml", "scene.toml"]
            .map(|name| directory.join(name));
    if !arguments.force {
        let wanted = [&frames, &truth, &camera, &targets, &scene].into_iter().chain(&png_paths);
        refuse_existing(wanted)?;
    }
    let simulation = prepared(&settings)?;
    plumbline_files::make_directory(directory)?;
    describe(&simulation, &camera, &targets, &scene)?;
    let mut truth = Writer::create(&truth)?;
    let mut outside = vec![0_u64; simulation.targets().len()];
    let place = frames.display().to_string();
    let file = plumbline_files::create(&frames, true)?;
    let render = |frame: u64, luma: &mut Vec<u8>| Ok(form.render(&simulation, frame, luma)?);
    let video = Video::of(simulation.camera(), arguments.fps, form, arguments.frames);
    video.write(render, file, &place, |frame, samples| {
        for (row, outside) in truth_rows(&simulation, frame).iter().zip(&mut outside) {
            truth.write(row)?;
            *outside += u64::from(row.points == Some(0));
        }
        if let Some(index) = arguments.png.iter().position(|number| *number == frame) {
            save_png(simulation.camera(), samples, &png_paths[index])?;
        }
        Ok(())
    })?;
    truth.flush()?;
    for (target, outside) in simulation.targets().iter().zip(outside) {
        if outside > 0 {
            let (name, frames) = (target.layout.name, counted(outside, "frame"));
            eprintln!(
                "warning: no corner of the {name} target is in view in {frames}; a larger --distance shows more"
            );
        }
    }
    eprintln!("{} written to {}", counted(arguments.frames, "frame"), directory.display());
    Ok(())
}

fn prepared(settings: &SimulationSettings) -> anyhow::Result<Simulation> {
    Simulation::new(settings).map_err(|error| anyhow::anyhow!("--{error}"))
}

fn refuse_existing<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> anyhow::Result<()> {
    for path in paths {
        anyhow::ensure!(
            !path.exists(),
            "{}: exists already; give another --out, or --force to replace it",
            path.display()
        );
    }
    Ok(())
}

/// Writes the three description files.
fn describe(
    simulation: &Simulation,
    camera_path: &Path,
    targets_path: &Path,
    scene_path: &Path,
) -> Result<(), BadInput> {
    let source = format!("plumb simulate, seed {}: exact", simulation.settings().seed);
    write_camera(camera_path, simulation.camera(), simulation.readout_ns(), &source)?;
    let descriptions: Vec<_> = simulation
        .targets()
        .iter()
        .map(|target| TargetDescription {
            name: target.layout.name.to_owned(),
            role: target.layout.role,
            columns: target.layout.columns,
            rows: target.layout.rows,
            pitch_mm: Some(target.layout.pitch_mm),
            origin: Some(OriginName::Center),
            virtual_point_mm: target.layout.virtual_point_mm,
            points_mm: None,
        })
        .collect();
    targets::write(targets_path, &descriptions)?;
    write_scene(scene_path, simulation.camera(), &simulation.cam_from_scene(), source)
}

fn write_camera(path: &Path, lens: &Lens, readout_ns: i32, source: &str) -> Result<(), BadInput> {
    let provenance = Provenance { source: Some(source.to_owned()), ..Provenance::default() };
    camera::write(path, &Camera { lens: *lens, readout_ns, provenance })
}

fn write_scene(
    path: &Path,
    lens: &Lens,
    cam_from_scene: &Pose<Cam, Scene>,
    source: String,
) -> Result<(), BadInput> {
    let (cam_from_scene_theta, camera) = (cam_from_scene.theta(), Some(LensId::of(lens)));
    scene::write(path, &SceneFile { cam_from_scene_theta, source, camera })
}

fn save_png(lens: &Lens, samples: &[u8], path: &Path) -> Result<(), BadInput> {
    let (width, height) = (u32::from(lens.width_px), u32::from(lens.height_px));
    let picture = ImageBuffer::<Luma<u8>, _>::from_raw(width, height, samples);
    png::write(path, &picture.expect("as many samples as pixels"))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use plumbline_files::frames::{FrameSource, Pixels};
    use plumbline_files::poses;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: SimulateArguments,
    }

    fn simulate(directory: &Path, options: &[&str]) -> anyhow::Result<()> {
        let out = directory.to_str().unwrap();
        run(&Line::parse_from(["simulate", "--out", out].iter().chain(options)).arguments)
    }

    #[test]
    fn what_is_written_is_read_back() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        simulate(directory.path(), &["--frames", "2", "--fps", "29.97", "--png", "1"]).unwrap();
        let settings = SimulationSettings { frame_rate_hz: 29.97, ..Default::default() };
        let simulation = Simulation::new(&settings).unwrap();

        let mut source = FrameSource::open(&[at("frames.y4m")], None).unwrap();
        assert!((source.rate_hz() - 29.97).abs() < 1e-9);
        let mut expected: Vec<u8> = Vec::new();
        for number in 0..2 {
            simulation.render(number, &mut expected);
            let frame = source.next_frame().unwrap().unwrap();
            assert!(matches!(frame.pixels, Pixels::Grey8(found) if found == expected));
        }
        assert!(source.next_frame().unwrap().is_none());
        let png = image::open(at("frame_1.png")).unwrap().into_luma8();
        assert!(png.into_raw() == expected);

        assert_eq!(camera::read(&at("camera.toml")).unwrap().lens, *simulation.camera());
        let scene = scene::read(&at("scene.toml")).unwrap();
        assert_eq!(scene.check_lens(simulation.camera(), ""), Ok(None));
        let scene = scene.cam_from_scene();
        assert!((scene.rotation - simulation.cam_from_scene().rotation).norm() < 1e-12);
        let read = targets::read(&at("targets.toml")).unwrap();
        assert!(read.warnings.is_empty());
        for (read, target) in read.targets.iter().zip(simulation.targets()) {
            assert_eq!(read.name, target.layout.name);
            assert_eq!(read.geometry, target.geometry);
        }
        let rows = poses::read(&at("truth.csv")).unwrap();
        assert_eq!(rows.len(), 4);
        let last = simulation.truth(1).targets[1].cam_from_target;
        let pose = rows[3].cam_from_target().unwrap();
        assert!((pose.rotation - last.rotation).norm() < 1e-12);
        assert_eq!(pose.translation_mm, last.translation_mm);

        let again = simulate(directory.path(), &["--frames", "1"]).unwrap_err().to_string();
        assert!(again.contains("frames.y4m") && again.contains("--force"), "{again}");
        simulate(directory.path(), &["--frames", "1", "--force"]).unwrap();
    }

    #[test]
    fn a_board_is_photographed_and_stands_in_the_scene() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        let board = ["--board", "5x4", "--pitch-mm", "30", "--photographs", "2"];
        simulate(directory.path(), &board).unwrap();
        for name in ["photos/board-1.png", "photos/board-2.png"] {
            let picture = image::open(at(name)).unwrap();
            assert_eq!([picture.width(), picture.height()], [1456, 1088]);
        }
        let mut source = FrameSource::open(&[at("scene.y4m")], None).unwrap();
        let mut frames = 0;
        while source.next_frame().unwrap().is_some() {
            frames += 1;
        }
        assert_eq!(frames, board::STANDING_FRAMES);
        let simulation = Simulation::new(&SimulationSettings::default()).unwrap();
        assert_eq!(camera::read(&at("truth/camera.toml")).unwrap().lens, *simulation.camera());
        let scene = scene::read(&at("truth/scene.toml")).unwrap();
        assert_eq!(scene.check_lens(simulation.camera(), ""), Ok(None));
        let scene = scene.cam_from_scene();
        assert!((scene.rotation - simulation.cam_from_scene().rotation).norm() < 1e-12);

        let again = simulate(directory.path(), &board).unwrap_err().to_string();
        assert!(again.contains("--force"), "{again}");
        let wrong = ["--board", "2x4", "--pitch-mm", "30", "--force"];
        let wrong = simulate(directory.path(), &wrong).unwrap_err().to_string();
        assert!(wrong.contains("--board") && wrong.contains("2 x 4"), "{wrong}");
        let person = ["simulate", "--out", "-", "--board", "5x4", "--pitch-mm", "9", "--jpeg", "9"];
        assert!(Line::try_parse_from(person).is_err());
    }

    #[test]
    fn a_rolling_shutter_gives_each_target_its_own_time() {
        let directory = tempfile::tempdir().unwrap();
        let options = ["--frames", "2", "--readout-ms", "-16", "--drift-mm-s", "0,200,-10"];
        simulate(directory.path(), &options).unwrap();
        let settings = SimulationSettings {
            readout_ms: -16.0,
            drift_mm_s: [0.0, 200.0, -10.0],
            ..Default::default()
        };
        let simulation = Simulation::new(&settings).unwrap();
        let camera = camera::read(&directory.path().join("camera.toml")).unwrap();
        assert_eq!(camera.readout_ns, -16_000_000);
        let rows = poses::read(&directory.path().join("truth.csv")).unwrap();
        for (row, target) in rows[2..].iter().zip(simulation.truth(1).targets) {
            assert_eq!(row.time_s, target.time_s);
            // Later than the bottom row, which is read first.
            assert!((1.0 / 60.0..1.0 / 60.0 + 0.016).contains(&row.time_s), "{}", row.time_s);
        }
        let wrong = ["simulate", "--out", "-", "--drift-mm-s", "1,2"];
        let refused = Line::try_parse_from(wrong).map(|_| ()).unwrap_err().to_string();
        assert!(refused.contains("0,200,0"), "{refused}");
    }

    #[test]
    fn ten_bits_are_read_back_and_jpeg_has_eight() {
        let directory = tempfile::tempdir().unwrap();
        simulate(directory.path(), &["--frames", "2", "--bits", "10"]).unwrap();
        let settings = SimulationSettings { bits: 10, ..Default::default() };
        let simulation = Simulation::new(&settings).unwrap();
        let mut source = FrameSource::open(&[directory.path().join("frames.y4m")], None).unwrap();
        let mut expected: Vec<u16> = Vec::new();
        for number in 0..2 {
            simulation.render(number, &mut expected);
            let frame = source.next_frame().unwrap().unwrap();
            assert_eq!(frame.white_level, 1023);
            assert!(matches!(frame.pixels, Pixels::Grey16(found) if found == expected));
        }
        assert!(source.next_frame().unwrap().is_none());

        for other in [["--jpeg", "95"], ["--png", "0"]] {
            let options = [&["--force", "--bits", "10"][..], &other].concat();
            let refused = simulate(directory.path(), &options).unwrap_err().to_string();
            assert!(refused.contains(other[0]) && refused.contains("--bits 10"), "{refused}");
        }
    }
}
