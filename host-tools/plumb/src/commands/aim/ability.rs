//! What a terminal can show, as far as it answers.

use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

/// A terminal answers within this, also over a network.
const ANSWER_WITHIN: Duration = Duration::from_millis(500);

/// The query for the size of a cell, which few answer, then the one for the attributes, which
/// every terminal answers: once its answer has come, none to the first will follow.
const QUESTIONS: &[u8] = b"\x1b[16t\x1b[c";

/// The attribute of those that show sixels.
const SIXEL: u16 = 4;

/// What a terminal has answered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Ability {
    /// It shows sixels.
    pub sixel: bool,
    /// Width and height of a cell, in pixels.
    pub cell_px: Option<[u16; 2]>,
}

/// Asks the terminal, which must be in raw mode.
///
/// # Errors
/// When it cannot be written to or read from.
pub fn ask(out: &mut impl Write) -> io::Result<Ability> {
    out.write_all(QUESTIONS)?;
    out.flush()?;
    // The standard library would read ahead, and keep a key that was pressed meanwhile.
    let mut terminal = File::from(io::stdin().as_fd().try_clone_to_owned()?);
    let until = Instant::now() + ANSWER_WITHIN;
    let mut answer = Vec::new();
    while !is_complete(&answer) {
        let left = until.saturating_duration_since(Instant::now());
        let timeout = PollTimeout::try_from(left).unwrap_or(PollTimeout::ZERO);
        let mut waiting = [PollFd::new(terminal.as_fd(), PollFlags::POLLIN)];
        if poll(&mut waiting, timeout)? == 0 {
            break;
        }
        let mut buffer = [0; 64];
        match terminal.read(&mut buffer)? {
            0 => break,
            count => answer.extend_from_slice(&buffer[..count]),
        }
    }
    Ok(understood(&answer))
}

/// The answers in what has come: after ESC [, numbers and a letter.
fn answers(bytes: &[u8]) -> impl Iterator<Item = (Vec<u16>, char)> {
    let text: String = bytes.iter().map(|&byte| char::from(byte)).collect();
    let parts: Vec<String> = text.split("\x1b[").skip(1).map(str::to_owned).collect();
    parts.into_iter().filter_map(|part| {
        let (numbers, rest) = part.split_at(part.find(|c: char| c.is_ascii_alphabetic())?);
        let numbers = numbers.trim_start_matches('?').split(';');
        Some((numbers.filter_map(|number| number.parse().ok()).collect(), rest.chars().next()?))
    })
}

fn is_complete(bytes: &[u8]) -> bool {
    answers(bytes).any(|(_, letter)| letter == 'c')
}

fn understood(bytes: &[u8]) -> Ability {
    let mut ability = Ability::default();
    for (numbers, letter) in answers(bytes) {
        match (letter, &numbers[..]) {
            // The first number is the terminal's kind.
            ('c', [_, attributes @ ..]) => ability.sixel = attributes.contains(&SIXEL),
            ('t', &[6, height, width]) if height > 0 && width > 0 => {
                ability.cell_px = Some([width, height]);
            }
            _ => {}
        }
    }
    ability
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminals_are_understood() {
        let cases: [(&[u8], Ability); 5] = [
            (b"\x1b[6;18;9t\x1b[?62;4;22c", Ability { sixel: true, cell_px: Some([9, 18]) }),
            (b"\x1b[?65;1;9c", Ability::default()),
            // 4 is the kind of a terminal here, not an attribute.
            (b"\x1b[?4c", Ability::default()),
            (b"q\x1b[?64;4c", Ability { sixel: true, cell_px: None }),
            (b"\x1b[6;0;0t", Ability::default()),
        ];
        for (answer, ability) in cases {
            assert_eq!(understood(answer), ability, "{answer:?}");
        }
        assert!(is_complete(b"\x1b[?62;4c") && !is_complete(b"\x1b[?62;4") && !is_complete(b""));
    }
}
