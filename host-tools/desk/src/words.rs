//! What the libraries say, as the page says it.
//!
//! Their errors and findings name commands and options of the command line where these are the remedy, in
//! backquotes: `` `plumb aim --expose` ``. Whoever reads the page has no command line before them; there
//! the same is done somewhere on the page, which is named instead. What cannot be done there is left to
//! the command line, and said so.

/// What is said otherwise, and how; longer phrases come before those that they contain.
const PHRASES: [(&str, &str); 18] = [
    ("; --force does it all the same, and spoils the trial", ""),
    ("watch for longer with --seconds", "do it again, and keep all still meanwhile"),
    ("correct the links in the box file, or give --force", "correct the links in the box file"),
    ("choose it with --box-name: see `plumb keys list`", "choose it in the step Boxes"),
    ("check --baud against the box's rate", "check the line's rate against the box's"),
    ("say with --camera-pitch-deg how", "say in degrees how"),
    ("check --board (count the INNER corners)", "check the board's size (count the INNER corners)"),
    ("or try the other --model", "or try another lens"),
    ("or try another --model", "or try another lens"),
    ("or try --model radial2", "or try another lens"),
    ("or try --model brown5", "or try another lens"),
    ("--board, --pitch-mm", "the board"),
    ("--board", "the board's inner corners"),
    ("--upright-deg ", ""),
    ("analyse the time before or after it with --span, or record again", "record again"),
    (
        "give --zero mark or --zero start",
        "set t = 0 by a mark or by the first frame, in the protocol",
    ),
    ("give another directory, or --force to replace it", "give another directory"),
    ("(--camera shows them here)", ""),
];

/// What stands for a command that nothing on the page does.
const ELSEWHERE: &str = "the command line";

/// Where the page does what a command does; longer commands come before those that they contain.
const PLACES: [(&str, &str); 12] = [
    ("plumb aim --expose", "\"Find the exposure and keep it\" in the step Aim"),
    ("plumb aim --stills", "the step Calibrate"),
    ("plumb aim", "the step Aim"),
    ("plumb calibrate --readout", ELSEWHERE),
    ("plumb calibrate", "the step Calibrate"),
    ("plumb scene --out", ELSEWHERE),
    ("plumb scene", "the step Scene"),
    ("plumb doctor --distance-mm", ELSEWHERE),
    ("plumb doctor", "\"Examine it\" in the step Boxes"),
    ("plumb keys list", "the step Boxes"),
    ("plumb desk", "the desk"),
    ("plumb show", "the trial's report"),
];

/// A text for the page.
#[must_use]
pub fn on_page(text: &str) -> String {
    let text = PHRASES.iter().fold(text.to_owned(), |text, (said, as_here)| {
        if text.contains(said) { text.replace(said, as_here) } else { text }
    });
    without_options(&without_commands(&text))
}

/// Places instead of commands.
fn without_commands(text: &str) -> String {
    let mut here = String::new();
    let mut rest = text;
    while let Some((before, command)) = rest.split_once("`plumb ") {
        let Some((command, after)) = command.split_once('`') else { break };
        let command = format!("plumb {command}");
        let place = PLACES.iter().find(|(of, _)| command.starts_with(of));
        here += before;
        here += place.map_or(ELSEWHERE, |(_, place)| place);
        rest = after;
    }
    here + rest
}

/// Options by their names alone.
fn without_options(text: &str) -> String {
    let mut here = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("--") {
        let (before, option) = rest.split_at(at);
        let option = &option["--".len()..];
        let end = option.find(|letter: char| !letter.is_ascii_lowercase() && letter != '-');
        let (name, after) = option.split_at(end.unwrap_or(option.len()));
        let begins_word = before.is_empty() || before.ends_with([' ', '(', '"', '`']);
        here += before;
        if begins_word && !name.is_empty() {
            here += "the option ";
        } else {
            here += "--";
        }
        here += name;
        rest = after;
    }
    here + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_a_place_of_the_page() {
        for (said, here) in [
            (
                "give more light, or expose for longer: `plumb aim --expose`",
                "give more light, or expose for longer: \"Find the exposure and keep it\" in the step Aim",
            ),
            (
                "fix the camera, and measure the scene again with `plumb scene --store`",
                "fix the camera, and measure the scene again with the step Scene",
            ),
            (
                "`plumb doctor` shows its state, and `plumb optics` nothing",
                "\"Examine it\" in the step Boxes shows its state, and the command line nothing",
            ),
            (
                "wait until it is over; --force does it all the same, and spoils the trial",
                "wait until it is over",
            ),
            (
                "give --fps 60, or leave --fps out",
                "give the option fps 60, or leave the option fps out",
            ),
            ("nothing of it: 3 -- 5, a--b, `plumb", "nothing of it: 3 -- 5, a--b, `plumb"),
            ("", ""),
        ] {
            assert_eq!(on_page(said), here);
        }
    }

    #[test]
    fn what_is_longer_comes_first() {
        let hides = |list: &[(&str, &str)]| {
            let later = |at: usize, of: &str| list[at + 1..].iter().any(|(it, _)| it.contains(of));
            list.iter().enumerate().any(|(at, (of, _))| later(at, of))
        };
        assert!(!hides(&PHRASES) && !hides(&PLACES));
    }
}
