//! The colours and the font of all plots, on light and on dark pages.

use std::fmt::Write as _;

use plotters::style::{RGBColor, WHITE};

pub const FONT: &str = "sans-serif";
pub const INK: RGBColor = RGBColor(51, 60, 69);
pub const GRID: RGBColor = RGBColor(233, 236, 239);

/// Where nothing was measured.
pub const GAP: RGBColor = RGBColor(208, 214, 220);
/// What was measured but not analysed.
pub const SOFT: RGBColor = RGBColor(150, 158, 166);

// Colours that stay apart for every kind of colour vision (after Okabe and Ito).
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
pub const ORANGE: RGBColor = RGBColor(213, 94, 0);
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
pub const PINK: RGBColor = RGBColor(204, 121, 167);
pub const YELLOW: RGBColor = RGBColor(230, 159, 0);

/// The paper of dark pages.
pub const ON_DARK_PAPER: RGBColor = RGBColor(20, 25, 30);

/// Each colour, and the one that replaces it on a dark page.
const ON_DARK: [(RGBColor, RGBColor); 10] = [
    (WHITE, ON_DARK_PAPER),
    (INK, RGBColor(211, 218, 225)),
    (GRID, RGBColor(43, 51, 58)),
    (GAP, RGBColor(70, 80, 90)),
    (SOFT, RGBColor(139, 148, 157)),
    (BLUE, RGBColor(86, 180, 233)),
    (ORANGE, RGBColor(255, 132, 64)),
    (GREEN, RGBColor(53, 196, 149)),
    (PINK, RGBColor(232, 163, 203)),
    (YELLOW, RGBColor(240, 208, 96)),
];

/// The notation of CSS and SVG, in which plotters writes colours too.
pub fn hex(colour: RGBColor) -> String {
    format!("#{:02X}{:02X}{:02X}", colour.0, colour.1, colour.2)
}

/// The style sheet of plots that are drawn in these colours on white, for a reader who prefers
/// dark pages; paper is white. Style sheets come before the colours that plotters gives each
/// shape.
pub fn dark_style() -> String {
    let mut rules = String::from("@media screen and (prefers-color-scheme: dark) {");
    for (light, dark) in ON_DARK.map(|(light, dark)| (hex(light), hex(dark))) {
        // Writing to a String does not fail.
        let _ = write!(
            rules,
            " svg [fill=\"{light}\"] {{ fill: {dark} }} svg [stroke=\"{light}\"] {{ stroke: {dark} }}"
        );
    }
    rules + " }"
}

/// A plot that is a file of its own, for light and dark.
pub fn for_light_and_dark(svg: &str) -> String {
    match svg.find("<svg").and_then(|at| Some(at + svg[at..].find('>')? + 1)) {
        Some(inside) => {
            [&svg[..inside], "<style>", &dark_style(), "</style>", &svg[inside..]].concat()
        }
        None => svg.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance of WCAG 2.2.
    fn luminance(RGBColor(r, g, b): RGBColor) -> f64 {
        let linear = |it: u8| {
            let it = f64::from(it) / 255.0;
            if it <= 0.04045 { it / 12.92 } else { ((it + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b)
    }

    fn contrast(one: RGBColor, other: RGBColor) -> f64 {
        let (one, other) = (luminance(one), luminance(other));
        (one.max(other) + 0.05) / (one.min(other) + 0.05)
    }

    /// WCAG 2.2 asks for 3 of what a plot shows, and for 4.5 of text.
    #[test]
    fn lines_are_seen_on_dark_pages_and_text_is_read_on_both() {
        for (light, dark) in ON_DARK {
            if [SOFT, BLUE, ORANGE, GREEN, PINK, YELLOW].contains(&light) {
                assert!(contrast(dark, ON_DARK_PAPER) > 5.0, "{}", hex(light));
            }
            if light == INK {
                assert!(contrast(light, WHITE).min(contrast(dark, ON_DARK_PAPER)) > 10.0);
            }
            // Every colour is replaced by one rule: none is twice in the table.
            assert_eq!(ON_DARK.iter().filter(|it| it.0 == light).count(), 1, "{}", hex(light));
        }
    }
}
