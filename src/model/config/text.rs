//! Which characters the texts of a box may have: names go to terminals, tables and pages.

/// Whether a reader sees a character, and sees it in its place.
///
/// Not so are control characters, with which a text could command a terminal; breaks of a line; and
/// characters that have no width or turn the direction of writing, with which a text could look like
/// another: Unicode's default-ignorable characters, and those of category Cf that are marks of
/// direction. Joiners and variation selectors are among them: no name of a box or a target needs
/// them.
#[must_use]
pub fn is_visible(letter: char) -> bool {
    let is_hidden = matches!(
        letter,
        '\u{ad}'
            | '\u{34f}'
            | '\u{61c}'
            | '\u{115f}'..='\u{1160}'
            | '\u{17b4}'..='\u{17b5}'
            | '\u{180b}'..='\u{180f}'
            | '\u{200b}'..='\u{200f}'
            | '\u{2028}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}'
            | '\u{3164}'
            | '\u{fe00}'..='\u{fe0f}'
            | '\u{feff}'
            | '\u{ffa0}'
            | '\u{fff0}'..='\u{fffb}'
            | '\u{1bca0}'..='\u{1bca3}'
            | '\u{1d173}'..='\u{1d17a}'
            | '\u{e0000}'..='\u{e0fff}'
    );
    !is_hidden && !letter.is_control()
}
