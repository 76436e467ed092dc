//! Large letters and digits, to be read from two metres.
//!
//! Each is three dots wide and five high; a dot is two columns by one row, about a square.

/// The columns of a character, with the space after it.
const COLUMNS: usize = 7;

/// Its rows.
pub(super) const ROWS: usize = 5;

/// The characters that can be written, each with its rows of three dots from the top.
const DOTS: [(char, [u8; ROWS]); 23] = [
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
    ('-', [0b000, 0b000, 0b111, 0b000, 0b000]),
    ('A', [0b010, 0b101, 0b111, 0b101, 0b101]),
    ('D', [0b110, 0b101, 0b101, 0b101, 0b110]),
    ('G', [0b111, 0b100, 0b101, 0b101, 0b111]),
    ('I', [0b111, 0b010, 0b010, 0b010, 0b111]),
    ('K', [0b101, 0b101, 0b110, 0b101, 0b101]),
    ('L', [0b100, 0b100, 0b100, 0b100, 0b111]),
    ('O', [0b111, 0b101, 0b101, 0b101, 0b111]),
    ('P', [0b111, 0b101, 0b111, 0b100, 0b100]),
    ('S', [0b111, 0b100, 0b111, 0b001, 0b111]),
    ('T', [0b111, 0b010, 0b010, 0b010, 0b010]),
    ('W', [0b101, 0b101, 0b101, 0b111, 0b101]),
];

/// The number of columns that a text takes.
pub(super) fn columns(text: &str) -> usize {
    COLUMNS * text.chars().count()
}

/// A text in large characters; `dot` is what a dot is made of. Other characters are left blank.
pub(super) fn lines(text: &str, dot: char) -> [String; ROWS] {
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
        assert!(lines("1:", '#').iter().all(|line| line.len() == columns("1:")));
    }

    #[test]
    fn every_word_of_the_verdict_can_be_written_and_told_from_the_others() {
        let words = ["GOOD", "LOOK", "STOP", "WAIT"];
        for word in words {
            for letter in word.chars() {
                assert!(DOTS.iter().any(|(it, _)| *it == letter), "{letter}");
            }
        }
        let drawn: std::collections::BTreeSet<_> =
            words.iter().map(|word| lines(word, '#')).collect();
        assert_eq!(drawn.len(), words.len());
    }
}
