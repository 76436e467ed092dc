//! Photographs of a calibration board, and of the same board standing in the scene.

use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_render::simulate::photographs::BoardPhotographs;
use plumbline_render::simulate::recorded::Form;
use plumbline_render::simulate::render::Picture;

use super::video::{Video, standard_output};
use super::{SimulateArguments, refuse_existing, save_png, write_camera, write_scene};

/// In a stream, each photograph lasts as long as `plumb aim --stills --every 5` takes for one.
const HOLD_S: f64 = 5.0;
/// Frames of the board that stands upright: more than `plumb scene` needs.
pub(super) const STANDING_FRAMES: u64 = 30;

/// Renders the board of `--board` and `--pitch-mm`.
pub(super) fn run(
    arguments: &SimulateArguments,
    [columns, rows]: [u8; 2],
    pitch_mm: f64,
) -> anyhow::Result<()> {
    let geometry =
        TargetGeometry::checker(columns, rows, pitch_mm, Origin::Center, Role::Scene, [0.0; 3])
            .map_err(|error| {
                let found = format!("{columns} x {rows} corners, {pitch_mm} mm apart");
                BadInput::whole("--board", found, error)
            })?;
    let settings = arguments.settings(Form::Grey8);
    let photographs = BoardPhotographs::new(&settings, &geometry, arguments.photographs)
        .map_err(|error| anyhow::anyhow!("--{error}"))?;
    if arguments.out.as_os_str() == "-" {
        return stream(arguments, &photographs);
    }
    write(arguments, &photographs)
}

/// The photographs one after the other, then the board standing upright, as a video.
fn stream(arguments: &SimulateArguments, photographs: &BoardPhotographs) -> anyhow::Result<()> {
    let held = (HOLD_S * arguments.fps).ceil() as u64;
    let shown = photographs.held().len() as u64 + 1;
    let mut current: Option<(u64, Picture)> = None;
    Video::of(photographs.camera(), arguments.fps, Form::Grey8, held * shown).write(
        |frame, samples| {
            let number = frame / held;
            let picture = match current.take().filter(|(of, _)| *of == number) {
                Some((_, picture)) => picture,
                None if number + 1 == shown => photographs.standing(),
                None => photographs.photograph(number as usize),
            };
            photographs.expose(&picture, frame, samples);
            current = Some((number, picture));
            Ok(())
        },
        standard_output()?,
        "standard output",
        |_, _| Ok(()),
    )
}

/// The photographs as pictures, the board standing upright as a video, and the truth.
fn write(arguments: &SimulateArguments, photographs: &BoardPhotographs) -> anyhow::Result<()> {
    let directory = &arguments.out;
    let count = photographs.held().len();
    let digits = count.to_string().len();
    let pictures = directory.join("photos");
    let pictures: Vec<_> =
        (1..=count).map(|number| pictures.join(format!("board-{number:0digits$}.png"))).collect();
    let truth = directory.join("truth");
    let video_path = directory.join("scene.y4m");
    let [camera_path, scene_path] = ["camera.toml", "scene.toml"].map(|name| truth.join(name));
    if !arguments.force {
        refuse_existing([&video_path, &camera_path, &scene_path].into_iter().chain(&pictures))?;
    }
    for directory in [&directory.join("photos"), &truth] {
        plumbline_files::make_directory(directory)?;
    }
    let source = format!("plumb simulate --board, seed {}: exact", arguments.seed);
    write_camera(&camera_path, photographs.camera(), 0, &source)?;
    write_scene(&scene_path, photographs.camera(), &photographs.cam_from_scene(), source)?;
    let mut samples = Vec::new();
    for (number, path) in pictures.iter().enumerate() {
        photographs.expose(&photographs.photograph(number), number as u64, &mut samples);
        save_png(photographs.camera(), &samples, path)?;
    }
    let standing = photographs.standing();
    let place = video_path.display().to_string();
    let file = plumbline_files::create(&video_path, true)?;
    Video::of(photographs.camera(), arguments.fps, Form::Grey8, STANDING_FRAMES).write(
        |frame, samples| {
            photographs.expose(&standing, count as u64 + frame, samples);
            Ok(())
        },
        file,
        &place,
        |_, _| Ok(()),
    )?;
    eprintln!(
        "{} and the board standing upright (scene.y4m, {}) written to {}; what is true of them is \
         in {}",
        counted(count, "photograph"),
        counted(STANDING_FRAMES, "frame"),
        directory.display(),
        truth.display()
    );
    Ok(())
}
