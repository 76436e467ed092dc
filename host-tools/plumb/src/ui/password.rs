//! Passwords: of a file, or typed. None is taken from the command line, which every program of this
//! computer can read.

use std::io::{BufRead, IsTerminal as _};
use std::path::Path;

use plumbline_files::BadInput;
use zeroize::Zeroizing;

/// The first line of a file.
///
/// # Errors
/// When it cannot be read.
pub fn of_file(file: &Path) -> Result<Zeroizing<String>, BadInput> {
    let text = Zeroizing::new(plumbline_files::read_text(file)?);
    Ok(Zeroizing::new(text.lines().next().unwrap_or_default().to_owned()))
}

/// A line from the terminal, which does not show it; `nobody` is the error where there is no terminal.
///
/// # Errors
/// When there is nobody to type it, or it is not given.
pub fn typed(what: &str, nobody: impl FnOnce() -> BadInput) -> Result<Zeroizing<String>, BadInput> {
    if !std::io::stdin().is_terminal() {
        return Err(nobody());
    }
    eprint!("{what}: ");
    let hidden = Hidden::begin();
    let typed = typed_line(std::io::stdin().lock());
    drop(hidden);
    eprintln!();
    typed.map(Zeroizing::new)
}

/// What Ctrl-C sends where the terminal makes no signal of it.
const CTRL_C: u8 = 3;

/// What the key that takes the last letter back sends there.
const BACKSPACE: u8 = 8;
const DELETE: u8 = 0x7f;

/// The longest line that a terminal gives.
const LINE_BYTES_MAX: usize = 4096;

/// A line from a terminal that hides it.
fn typed_line(terminal: impl BufRead) -> Result<String, BadInput> {
    const PLACE: &str = "the password";
    let mut line = Vec::new();
    for byte in terminal.bytes().take(LINE_BYTES_MAX) {
        match byte.map_err(|error| BadInput::io(PLACE, &error))? {
            b'\n' | b'\r' => break,
            // Where the terminal does not take the last letter back itself.
            BACKSPACE | DELETE => {
                while line.pop().is_some_and(|byte| byte & 0b1100_0000 == 0b1000_0000) {}
            }
            CTRL_C => {
                return Err(BadInput::whole(PLACE, "it was not given", "start again"));
            }
            byte => line.push(byte),
        }
    }
    String::from_utf8(line).map_err(|_| {
        BadInput::whole(PLACE, "it is not UTF-8", "set the terminal's letters to UTF-8")
    })
}

/// A terminal that shows nothing of what is typed, until this is dropped. Ctrl-C ends the line, because a
/// program that it ended would leave the terminal so.
#[cfg(unix)]
struct Hidden(Option<nix::sys::termios::Termios>);

#[cfg(unix)]
impl Hidden {
    fn begin() -> Self {
        use nix::sys::termios::SpecialCharacterIndices::VEOL;
        use nix::sys::termios::{LocalFlags, SetArg, tcgetattr, tcsetattr};
        let stdin = std::io::stdin();
        let before = tcgetattr(&stdin).ok();
        if let Some(mut settings) = before.clone() {
            settings.local_flags.remove(LocalFlags::ECHO | LocalFlags::ISIG);
            settings.control_chars[VEOL as usize] = CTRL_C;
            let _ = tcsetattr(&stdin, SetArg::TCSAFLUSH, &settings);
        }
        Self(before)
    }
}

#[cfg(unix)]
impl Drop for Hidden {
    fn drop(&mut self) {
        if let Some(before) = &self.0 {
            let how = nix::sys::termios::SetArg::TCSANOW;
            let _ = nix::sys::termios::tcsetattr(std::io::stdin(), how, before);
        }
    }
}

/// A console that shows nothing of what is typed, until this is dropped. Ctrl-C is a letter as well.
#[cfg(not(unix))]
struct Hidden;

#[cfg(not(unix))]
impl Hidden {
    fn begin() -> Self {
        let _ = crossterm::terminal::enable_raw_mode();
        Self
    }
}

#[cfg(not(unix))]
impl Drop for Hidden {
    fn drop(&mut self) {
        let _ = crossterm::terminal::disable_raw_mode();
    }
}
