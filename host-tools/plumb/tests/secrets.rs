//! Where a box's key is, after everything that a user does with a box: in its two files. No program
//! says it, and no other file has it, in any form.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use plumbline::seal::{KEY_FILE_NAME, Key};
use plumbline_test_support::command;

use crate::common::keys;
use crate::live_box::{Bench, PAIR, board, recording};

/// Bytes of the key that show it when they are seen in a row: by chance that happens once in 2^64
/// places.
const BYTES: usize = 8;

/// A key without repetitions.
fn key() -> Key {
    Key::new(std::array::from_fn(|at| (at * 37 + 11) as u8)).unwrap()
}

/// Every form in which part of the key could be written, in small letters, and its name.
fn forms() -> Vec<(&'static str, Vec<u8>)> {
    let key = key();
    let mut forms = Vec::new();
    for part in key.bytes().windows(BYTES) {
        let listed = |each: fn(&u8) -> String, between: &str| {
            part.iter().map(each).collect::<Vec<_>>().join(between).into_bytes()
        };
        let hex = |byte: &u8| format!("{byte:02x}");
        forms.push(("bytes", part.to_ascii_lowercase()));
        for between in ["", " ", ":", "-", ", "] {
            forms.push(("hexadecimal digits", listed(hex, between)));
        }
        forms.push(("hexadecimal numbers", listed(|byte| format!("0x{byte:02x}"), ", ")));
        forms.push(("hexadecimal escapes", listed(|byte| format!("\\x{byte:02x}"), "")));
        for between in [", ", ",", " "] {
            forms.push(("numbers", listed(u8::to_string, between)));
        }
        // As `{:#?}` lists them.
        forms.push(("numbers in lines", listed(u8::to_string, ",\n    ")));
    }
    // Four letters stand for three bytes: one of three alignments is that of the whole.
    for part in key.bytes().windows(2 * BYTES - 1) {
        forms.push(("Base64", base64(&part[..2 * BYTES - 1 - (2 * BYTES - 1) % 3])));
    }
    forms
}

/// The letters of bytes whose number is a multiple of three, in small letters.
fn base64(bytes: &[u8]) -> Vec<u8> {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let letters = bytes.chunks_exact(3).flat_map(|three| {
        let bits = three.iter().fold(0_usize, |bits, byte| bits << 8 | usize::from(*byte));
        [18, 12, 6, 0].map(|shift| LETTERS[bits >> shift & 63])
    });
    letters.collect::<Vec<u8>>().to_ascii_lowercase()
}

/// Looks for the key.
struct Search {
    forms: Vec<(&'static str, Vec<u8>)>,
    /// By their first two bytes, so that most bytes of a file are looked at once.
    by_start: Vec<Vec<usize>>,
}

impl Search {
    fn new() -> Self {
        let mut search = Self { forms: forms(), by_start: vec![Vec::new(); 1 << 16] };
        for (index, (_, form)) in search.forms.iter().enumerate() {
            search.by_start[start(form)].push(index);
        }
        search
    }

    /// The form in which these bytes show the key, if they do.
    fn shown(&self, bytes: &[u8]) -> Option<&'static str> {
        let bytes = bytes.to_ascii_lowercase();
        // Base64 for addresses and names of files has other signs for two letters.
        let other = bytes.iter().map(|byte| match byte {
            b'-' => b'+',
            b'_' => b'/',
            other => *other,
        });
        self.in_small_letters(&bytes).or_else(|| self.in_small_letters(&other.collect::<Vec<_>>()))
    }

    fn in_small_letters(&self, bytes: &[u8]) -> Option<&'static str> {
        (0..bytes.len().saturating_sub(1)).find_map(|at| {
            let here = self.by_start[start(&bytes[at..])].iter();
            let mut here = here.map(|index| &self.forms[*index]);
            here.find(|(_, form)| bytes[at..].starts_with(form)).map(|(name, _)| *name)
        })
    }
}

/// The first two bytes, as a number.
fn start(bytes: &[u8]) -> usize {
    usize::from(u16::from_le_bytes([bytes[0], bytes[1]]))
}

/// All files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// The box's program, whose words go to a file; it is stopped when this is dropped.
struct TheBox(Child);

impl TheBox {
    fn start(board: &Path, bench: &Bench, said: &str) -> Self {
        let file = File::create(bench.path(said)).unwrap();
        let mut command = command(board);
        command.args(["--config", "box.plb", "--replay", "trial.y4m", "--supervised"]);
        command.args(["--record", "sent.bin", "--boot-count-file", "starts"]);
        command.current_dir(bench.folder.path()).stdin(Stdio::null());
        command.stdout(file.try_clone().unwrap()).stderr(file);
        Self(command.spawn().unwrap())
    }

    /// As Ctrl-C does: it says its last words.
    fn end(mut self) {
        let id = self.0.id().to_string();
        assert!(command("kill").args(["-s", "INT", &id]).status().unwrap().success());
        assert!(self.0.wait().unwrap().success());
    }
}

impl Drop for TheBox {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn every_form_of_a_key_is_known_when_it_is_seen() {
    let (key, search) = (key(), Search::new());
    let bytes = key.bytes();
    let hex = |between: &str| bytes.map(|byte| format!("{byte:02X}")).join(between).into_bytes();
    let written = [
        bytes.to_vec(),
        bytes[3..11].to_vec(),
        key.text().as_str().into(),
        hex(""),
        hex(":"),
        format!("{bytes:?}").into(),
        format!("Key {{\n    bytes: {bytes:#?} }}").into(),
        format!("{bytes:#04x?}").replace("\n   ", "").into(),
        serde_json::to_vec(&bytes.to_vec()).unwrap(),
        base64(&[&[0], &bytes[..], &[0, 0, 0]].concat()),
        base64(&[&[1, 2], &bytes[..], &[0, 0]].concat()),
        base64(&bytes[..30]),
    ];
    for written in written {
        let text = String::from_utf8_lossy(&written);
        assert!(search.shown(&[b"before ", &written[..], b" behind"].concat()).is_some(), "{text}");
    }
    // By which it is known, and others.
    let others = [format!("{key:?}"), key.id().to_string(), format!("{:?}", [7; 32])];
    for other in others {
        assert_eq!(search.shown(other.as_bytes()), None, "{other}");
    }
}

#[test]
fn no_command_says_a_key_and_no_file_but_its_own_two_has_it() {
    let Some(board) = board() else { return };
    let bench = Bench::new(PAIR);
    let key = key();
    std::fs::remove_dir_all(keys::data(bench.folder.path())).unwrap();
    keys::know(bench.folder.path(), &key, "ward 3", "PL-0001");
    bench.write(KEY_FILE_NAME, key.text().as_str());
    bench.write(
        "scene.toml",
        "theta1_rad = 0\ntheta2_rad = 0\ntheta3_rad = 0\nx_mm = 0\ny_mm = 0\nz_mm = 650\n",
    );
    std::fs::write(bench.path("trial.y4m"), recording(0.0)).unwrap();
    let mut said = Vec::new();
    let mut does = |code: i32, arguments: &str| {
        let done = bench.plumb(arguments).exits(code);
        said.push((arguments.to_owned(), done.text().to_owned()));
    };
    does(
        0,
        "provision --camera camera.toml --targets targets.toml --scene scene.toml \
             --box box.toml --out box.plb",
    );
    let the_box = TheBox::start(&board, &bench, "box-1.txt");
    does(0, "keys list");
    does(0, "show box.plb");
    does(0, "show --udp UDP --out shown");
    does(0, "doctor --udp UDP --seconds 1 --config box.plb");
    does(0, "aim --udp UDP --once --png view.png");
    does(0, "receive --udp UDP --check-seconds 1 --duration 3 --out trial");
    does(0, "analyze trial --bins 0-1 --json figures.json");
    does(0, "report trial --bins 0-1 --out report.html");
    does(0, "export trial --format csv --out csv");
    does(0, "replay trial --tables");
    does(
        0,
        "provision --camera camera.toml --targets targets.toml --scene scene.toml \
             --box box.toml --send --no-restart --via-udp UDP",
    );
    // What goes wrong is said without the key too.
    does(2, "keys export PL-0001");
    does(2, "keys import box.key --serial PL-0002");
    let text = key.text();
    let slip = text.as_str().replacen('0', "1", 1);
    assert_ne!(slip, text.as_str());
    bench.write("slip.key", &slip);
    does(2, "keys import slip.key");
    std::fs::remove_file(bench.path("slip.key")).unwrap();
    the_box.end();
    // A box whose own key has lost a character.
    bench.write(KEY_FILE_NAME, &text.as_str()[..88]);
    let the_box = TheBox::start(&board, &bench, "box-2.txt");
    does(2, "show --udp UDP");
    the_box.end();
    bench.write(KEY_FILE_NAME, text.as_str());
    // A file of the store that has, as well.
    let own = keys::data(bench.folder.path()).join(format!("plumbline/keys/{}.toml", key.id()));
    let whole = std::fs::read_to_string(&own).unwrap();
    std::fs::write(&own, whole.replace(text.as_str(), &slip)).unwrap();
    does(2, "show --udp UDP");
    does(0, "keys list");
    std::fs::write(&own, whole).unwrap();

    let search = Search::new();
    for (arguments, text) in &said {
        assert_eq!(search.shown(text.as_bytes()), None, "{arguments}: {text}");
    }
    let own = [own, bench.path(KEY_FILE_NAME)];
    let mut searched = 0;
    for path in files(bench.folder.path()).into_iter().filter(|it| !it.ends_with("trial.y4m")) {
        let form = search.shown(&std::fs::read(&path).unwrap());
        assert_eq!(form.is_some(), own.contains(&path), "{}: {form:?}", path.display());
        searched += 1;
    }
    // The settings, the trial's tables, the page, pictures, and what the box has said and recorded.
    assert!(searched >= 25, "{searched} files");
}
