//! The configuration with which a box would be provisioned for the simulated scene.

use plumbline::config::{Config, Links, Machine, TargetConfig};

use super::Simulation;

impl Simulation {
    /// The readout as files and boxes have it.
    #[must_use]
    pub fn readout_ns(&self) -> i32 {
        // Within a second: the settings were checked.
        (self.settings().readout_ms * 1e6).round() as i32
    }

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
            readout_ns: self.readout_ns(),
            targets: targets.collect(),
            cam_from_scene_theta: Some(self.cam_from_scene().theta()),
            links: Links::default(),
            capture: None,
            machine: Machine::default(),
            trigger: None,
        }
    }
}
