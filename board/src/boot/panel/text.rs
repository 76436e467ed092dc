//! Breaks texts into lines of a width in characters, which are all equally wide.

/// What follows a line that was cut.
pub const MORE: &str = "...";

/// One line: its part of the text, and whether [`MORE`] follows.
#[derive(Debug, PartialEq, Eq)]
pub struct Line<'a> {
    pub text: &'a str,
    pub is_cut: bool,
}

/// The text in at most `lines_max` lines of at most `columns` characters, broken at spaces
/// where possible. Text that does not fit is cut off, and the last line is marked as cut.
pub fn lines(text: &str, columns: usize, lines_max: usize) -> impl Iterator<Item = Line<'_>> {
    let mut rest = text.trim();
    let mut left = if columns > MORE.len() { lines_max } else { 0 };
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        left = left.checked_sub(1)?;
        let (fits, after) = split(rest, columns);
        if after.is_empty() {
            rest = after;
            return Some(Line { text: fits, is_cut: false });
        }
        if left == 0 {
            let (fits, _) = split(rest, columns - MORE.len());
            return Some(Line { text: fits.trim_end(), is_cut: true });
        }
        let (line, after) = if after.starts_with(char::is_whitespace) {
            (fits, after)
        } else {
            // A word longer than the line is broken.
            rest.split_at(fits.rfind(char::is_whitespace).unwrap_or(fits.len()))
        };
        rest = after.trim_start();
        Some(Line { text: line.trim_end(), is_cut: false })
    })
}

/// The first `columns` characters, and the rest.
fn split(text: &str, columns: usize) -> (&str, &str) {
    let end = text.char_indices().nth(columns).map_or(text.len(), |(at, _)| at);
    text.split_at(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_broken_at_spaces_and_cut_where_they_must() {
        let table: [(&str, usize, usize, &[&str]); 9] = [
            ("ward 3 (PL-0001)", 16, 1, &["ward 3 (PL-0001)"]),
            ("ward 3 (PL-0001)", 15, 1, &["ward 3 (PL-0..."]),
            ("ward 3 (PL-0001)", 10, 1, &["ward 3..."]),
            ("looking for the targets", 13, 2, &["looking for", "the targets"]),
            ("one two three", 7, 2, &["one two", "three"]),
            ("one  two three four", 7, 2, &["one", "two..."]),
            ("a-word-without-spaces", 10, 3, &["a-word-wit", "hout-space", "s"]),
            ("\u{e9}\u{e9}\u{e9}\u{e9}\u{e9}\u{e9}", 5, 1, &["\u{e9}\u{e9}..."]),
            ("  ", 10, 3, &[]),
        ];
        for (text, columns, lines_max, expected) in table {
            let found: Vec<String> = lines(text, columns, lines_max)
                .map(|line| format!("{}{}", line.text, if line.is_cut { MORE } else { "" }))
                .collect();
            assert_eq!(found, expected, "{text:?} in {columns} columns");
        }
    }

    #[test]
    fn no_room_is_no_lines() {
        assert_eq!(lines("tracking", 20, 0).count(), 0);
        assert_eq!(lines("tracking", MORE.len(), 5).count(), 0);
    }
}
