//! What a terminal can show, as far as it answers.

use std::io::{self, Write};
use std::time::{Duration, Instant};

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

/// Asks the terminal, which must be in raw mode. A Windows console is not asked: it hands over its
/// answer as keys, one by one, which nobody could tell from a person's. It counts as one that shows
/// blocks, unless sixels are wanted.
///
/// # Errors
/// When it cannot be written to or read from.
pub fn ask(out: &mut impl Write) -> io::Result<Ability> {
    if cfg!(windows) {
        return Ok(Ability::default());
    }
    out.write_all(QUESTIONS)?;
    out.flush()?;
    let until = Instant::now() + ANSWER_WITHIN;
    let mut answer = Vec::new();
    while !is_complete(&answer) && read_until(until, &mut answer)? {}
    Ok(understood(&answer))
}

/// Reads what the terminal sends, without reading ahead as the standard library would, which keeps a
/// key that was pressed meanwhile. False when nothing more comes.
#[cfg(unix)]
fn read_until(until: Instant, answer: &mut Vec<u8>) -> io::Result<bool> {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    use std::io::Read as _;
    use std::os::fd::AsFd as _;

    let stdin = io::stdin();
    let left = until.saturating_duration_since(Instant::now());
    let timeout = PollTimeout::try_from(left).unwrap_or(PollTimeout::ZERO);
    if poll(&mut [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)], timeout)? == 0 {
        return Ok(false);
    }
    let mut buffer = [0; 64];
    let count = std::fs::File::from(stdin.as_fd().try_clone_to_owned()?).read(&mut buffer)?;
    answer.extend_from_slice(&buffer[..count]);
    Ok(count > 0)
}

/// Nothing: a Windows console is not asked.
#[cfg(not(unix))]
fn read_until(_: Instant, _: &mut Vec<u8>) -> io::Result<bool> {
    Ok(false)
}

/// The answers in what has come: after ESC [, numbers and a letter.
fn answers(bytes: &[u8]) -> impl Iterator<Item = (Vec<u16>, char)> {
    let text: String = bytes.iter().map(|&byte| char::from(byte)).collect();
    let parts: Vec<String> = text.split("\x1b[").skip(1).map(str::to_owned).collect();
    parts.into_iter().filter_map(|part| {
        let (numbers, rest) = part.split_at(part.find(|c: char| c.is_ascii_alphabetic())?);
        let numbers = numbers.trim_start_matches('?').split(';');
        Some((
            numbers.filter_map(|number| number.parse::<u16>().ok()).collect(),
            rest.chars().next()?,
        ))
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
