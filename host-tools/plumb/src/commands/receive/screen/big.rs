//! Large digits, to be read from two metres.
//!
//! Each is three dots wide and five high; a dot is two columns by one row, about a square.

/// The characters that can be written, each with its rows of three dots from the top.
const DOTS: [(char, [u8; 5]); 11] = [
    ('0', [0b111, 0b101, 0b101, 0b101, 0b111]),
    ('1', [0b010, 0b110, 0b010, 0b010, 0b111]),
    ('2', [0b111, 0b001, 0b111, 0b100, 0b111]),
    ('3', [0b111, 0b001, 0b111, 0b001, 0b111]),
    ('4', [0b101, 0b101, 0b111, 0b001, 0b001]),
    ('5', [0b111, 0b100, 0b111, 0b001, 0b111]),
    ('6', [0b111, 0b100, 0b111, 0b101, 0b111]),
    ('7', [0b111, 0b001, 0b001, 0b001, 0b001]),
    ('8', [0b111, 0b101, 0b111, 0b101, 0b111]),
    ('9', [0b111, 0b101, 0b111, 0b001, 0b111]),
    (':', [0b000, 0b010, 0b000, 0b010, 0b000]),
];

/// A text in large digits, five lines of seven columns per character; `dot` is what a dot is made of.
/// Other characters are left blank.
pub(super) fn lines(text: &str, dot: char) -> [String; 5] {
    std::array::from_fn(|row| {
        let mut line = String::new();
        for character in text.chars() {
            let dots =
                DOTS.iter().find(|(it, _)| *it == character).map_or(0, |(_, dots)| dots[row]);
            for column in [0b100, 0b010, 0b001] {
                let filled = if dots & column > 0 { dot } else { ' ' };
                line.extend([filled, filled]);
            }
            line.push(' ');
        }
        line
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_drawn_in_dots() {
        let wanted = [
            "  ##          ",
            "####     ##   ",
            "  ##          ",
            "  ##     ##   ",
            "######        ",
        ];
        assert_eq!(lines("1:", '#'), wanted);
    }
}
