//! The standard scene, rendered.

use plumbline::image::GreyImage;
use plumbline_render::simulate::Simulation;
use rayon::prelude::*;

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
