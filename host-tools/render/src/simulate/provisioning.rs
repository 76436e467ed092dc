//! The configuration with which a box would be provisioned for the simulated scene.

use plumbline::config::{Config, Links, Machine, TargetConfig};

use super::Simulation;

impl Simulation {
    /// Camera, targets and scene as they truly are; no camera device and no links.
    #[must_use]
    pub fn config(&self) -> Config {
        let targets = self.targets().iter().map(|target| TargetConfig {
            name: target.layout.name.try_into().expect("the standard names are short"),
            geometry: target.geometry.clone(),
        });
        Config {
            device: "simulation".try_into().expect("a short name"),
            serial_number: heapless::String::new(),
            lens: *self.camera(),
            readout_ns: 0,
            targets: targets.collect(),
            cam_from_scene_theta: Some(self.cam_from_scene().theta()),
            links: Links::default(),
            capture: None,
            machine: Machine::default(),
        }
    }
}
