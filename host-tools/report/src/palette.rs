//! The colours and the font of all plots, on light and on dark pages.

use std::fmt::Write as _;

use plotters::style::{RGBColor, WHITE};

/// The letters of all plots.
pub const FONT: &str = "sans-serif";
/// Letters and axes.
pub const INK: RGBColor = RGBColor(51, 60, 69);
/// The lines behind a plot.
pub const GRID: RGBColor = RGBColor(233, 236, 239);

/// Where nothing was measured.
pub const GAP: RGBColor = RGBColor(208, 214, 220);
/// What was measured but not analysed.
pub const SOFT: RGBColor = RGBColor(150, 158, 166);

// Colours that stay apart for every kind of colour vision (after Okabe and Ito).
/// Blue: the first of several things.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// Orange: the second.
pub const ORANGE: RGBColor = RGBColor(213, 94, 0);
/// Green: the third.
pub const GREEN: RGBColor = RGBColor(0, 158, 115);

// With BLUE and ORANGE, colours that even thin lines keep apart, by their lightness too.
/// Nearly black; nearly white on a dark page.
pub const DEEP: RGBColor = RGBColor(25, 20, 40);
/// Brown; sand on a dark page.
pub const BROWN: RGBColor = RGBColor(110, 45, 5);
/// Violet.
pub const VIOLET: RGBColor = RGBColor(150, 20, 230);

/// The colours of time bins, and of whatever else lies side by side.
pub const SERIES: [RGBColor; 5] = [BLUE, ORANGE, DEEP, BROWN, VIOLET];

/// The paper of dark pages.
pub const ON_DARK_PAPER: RGBColor = RGBColor(20, 25, 30);

/// Each colour, and the one that replaces it on a dark page.
const ON_DARK: [(RGBColor, RGBColor); 11] = [
    (WHITE, ON_DARK_PAPER),
    (INK, RGBColor(211, 218, 225)),
    (GRID, RGBColor(43, 51, 58)),
    (GAP, RGBColor(70, 80, 90)),
    (SOFT, RGBColor(139, 148, 157)),
    (BLUE, RGBColor(86, 180, 233)),
    (ORANGE, RGBColor(255, 132, 64)),
    (GREEN, RGBColor(53, 196, 149)),
    (DEEP, RGBColor(240, 250, 225)),
    (BROWN, RGBColor(240, 190, 150)),
    (VIOLET, RGBColor(190, 110, 255)),
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

    fn linear(it: u8) -> f64 {
        let it = f64::from(it) / 255.0;
        if it <= 0.04045 { it / 12.92 } else { ((it + 0.055) / 1.055).powf(2.4) }
    }

    /// Relative luminance of WCAG 2.2.
    fn luminance(RGBColor(r, g, b): RGBColor) -> f64 {
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
            if SERIES.contains(&light) || [SOFT, GREEN].contains(&light) {
                assert!(contrast(dark, ON_DARK_PAPER) > 5.0, "{}", hex(light));
            }
            if light == INK {
                assert!(contrast(light, WHITE).min(contrast(dark, ON_DARK_PAPER)) > 10.0);
            }
            // Every colour is replaced by one rule: none is twice in the table.
            assert_eq!(ON_DARK.iter().filter(|it| it.0 == light).count(), 1, "{}", hex(light));
        }
    }

    /// What a colour is to each kind of colour vision: Machado, Oliveira & Fernandes 2009 (IEEE
    /// Trans. Vis. Comput. Graph. 15:1291), severity 1.
    const VISIONS: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        // Protanopia, deuteranopia, tritanopia.
        [
            [0.152_286, 1.052_583, -0.204_868],
            [0.114_503, 0.786_281, 0.099_216],
            [-0.003_882, -0.048_116, 1.051_998],
        ],
        [
            [0.367_322, 0.860_646, -0.227_968],
            [0.280_085, 0.672_501, 0.047_413],
            [-0.011_820, 0.042_940, 0.968_881],
        ],
        [
            [1.255_528, -0.076_749, -0.178_779],
            [-0.078_411, 0.930_809, 0.147_602],
            [0.004_733, 0.691_367, 0.303_900],
        ],
    ];

    /// sRGB (D65) to CIE 1931 XYZ, divided by the white's.
    const XYZ: [[f64; 3]; 3] = [
        [0.4124 / 0.9505, 0.3576 / 0.9505, 0.1805 / 0.9505],
        [0.2126, 0.7152, 0.0722],
        [0.0193 / 1.089, 0.1192 / 1.089, 0.9505 / 1.089],
    ];

    fn times(matrix: &[[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
        matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
    }

    /// CIE L*a*b* of a colour as a kind of colour vision sees it.
    fn lab(RGBColor(r, g, b): RGBColor, vision: &[[f64; 3]; 3]) -> [f64; 3] {
        let seen = times(vision, [r, g, b].map(linear)).map(|it| it.clamp(0.0, 1.0));
        let [x, y, z] = times(&XYZ, seen)
            .map(|it: f64| if it > 0.008_856 { it.cbrt() } else { 7.787 * it + 16.0 / 116.0 });
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    /// The smallest difference (CIE 1976) that any kind of colour vision sees; one of 2 is just
    /// noticed between large patches.
    fn difference(one: RGBColor, other: RGBColor) -> f64 {
        let of = |vision| {
            let pairs = lab(one, vision).into_iter().zip(lab(other, vision));
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
        };
        VISIONS.iter().map(of).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn time_bins_are_told_apart_by_every_kind_of_colour_vision() {
        let dark = |light: RGBColor| ON_DARK.iter().find(|it| it.0 == light).unwrap().1;
        // Thin lines need ten times what is just noticed.
        let colours: Vec<RGBColor> = SERIES.into_iter().chain([SOFT]).collect();
        for (at, one) in colours.iter().enumerate() {
            for other in &colours[..at] {
                for (one, other) in [(*one, *other), (dark(*one), dark(*other))] {
                    let difference = difference(one, other);
                    assert!(difference > 20.0, "{} {} {difference}", hex(one), hex(other));
                }
            }
        }
        // A pair that those who see no blue hardly tell apart is found out.
        assert!(difference(BLUE, GREEN) < 20.0);
    }
}
