//! What several tests share: the standard scene as a configuration.

use heapless::{String, Vec};
use plumb::simulate::Simulation;
use plumbline::config::{Config, Links, Machine, TargetConfig};
use plumbline::image::GreyImage;
use rayon::prelude::*;

/// The simulation's camera, targets and scene, as a box is provisioned with them.
pub fn config_of(simulation: &Simulation) -> Config {
    let targets = simulation.targets().iter().map(|target| TargetConfig {
        name: String::try_from(target.layout.name).expect("the standard names are short"),
        geometry: target.geometry.clone(),
    });
    let pose = simulation.cam_from_scene();
    let angles = pose.euler();
    let position = pose.translation_mm;
    let theta = [
        angles.theta1_rad,
        angles.theta2_rad,
        angles.theta3_rad,
        position.x,
        position.y,
        position.z,
    ];
    Config {
        device: String::new(),
        serial_number: String::new(),
        lens: *simulation.camera(),
        targets: targets.collect::<Vec<_, _>>(),
        cam_from_scene_theta: Some(theta),
        links: Links::default(),
        capture: None,
        machine: Machine::default(),
    }
}

/// The first frames of the simulation, as the sensor gives them; on all cores.
pub fn render(simulation: &Simulation, count: u64) -> std::vec::Vec<std::vec::Vec<u8>> {
    let render = |frame| {
        let mut samples = std::vec::Vec::new();
        simulation.render(frame, &mut samples);
        samples
    };
    (0..count).into_par_iter().map(render).collect()
}

/// The view of one frame.
pub fn view<'a>(simulation: &Simulation, pixels: &'a [u8]) -> GreyImage<'a> {
    let (width, height) = (simulation.camera().width_px, simulation.camera().height_px);
    GreyImage::new(pixels, width.into(), height.into(), width.into()).expect("a whole frame")
}
