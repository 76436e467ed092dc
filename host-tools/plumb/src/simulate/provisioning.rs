//! The simulated scene as a box is provisioned with it.

use plumbline::config::{Config, Links, Machine, TargetConfig};

use super::Simulation;

impl Simulation {
    /// Camera, targets and scene as they truly are; no camera to read, no links.
    #[must_use]
    pub fn config(&self) -> Config {
        let targets = self.targets().iter().map(|target| TargetConfig {
            name: target.layout.name.try_into().expect("the standard names are short"),
            geometry: target.geometry.clone(),
        });
        let cam_from_scene = self.cam_from_scene();
        let (angles, position_mm) = (cam_from_scene.euler(), cam_from_scene.translation_mm);
        Config {
            device: "simulation".try_into().expect("a short name"),
            serial_number: heapless::String::new(),
            lens: *self.camera(),
            targets: targets.collect(),
            cam_from_scene_theta: Some([
                angles.theta1_rad,
                angles.theta2_rad,
                angles.theta3_rad,
                position_mm.x,
                position_mm.y,
                position_mm.z,
            ]),
            links: Links::default(),
            capture: None,
            machine: Machine::default(),
        }
    }
}
