//! What all plots look alike in.

use plotters::style::RGBColor;

pub const FONT: &str = "sans-serif";
pub const INK: RGBColor = RGBColor(51, 60, 69);
pub const GRID: RGBColor = RGBColor(233, 236, 239);

// Two colours that stay apart for every kind of colour vision (after Okabe and Ito).
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
pub const ORANGE: RGBColor = RGBColor(213, 94, 0);
