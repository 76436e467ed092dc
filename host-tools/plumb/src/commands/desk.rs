//! `plumb desk`: a page for the person who measures.

use std::io::{IsTerminal as _, Write as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Args;
use plumbline_bedside::recording::marks::MarkFrom;
use plumbline_bedside::recording::modem_line::ModemLine;
use plumbline_desk::desk::{Desk, Settings};
use plumbline_desk::http::{CONNECTIONS_MAX, For, Password, Server};
use plumbline_desk::marks::MarkSettings;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::link::{BAUD, PORT};
use zeroize::Zeroizing;

use crate::arguments::streams::{StreamArguments, library};
use crate::arguments::{address, program};
use crate::ui::password;
use crate::ui::stop::stop_on_signals;

/// The end is noticed within this time.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// The variable that may hold the password.
const PASSWORD_VARIABLE: &str = "PLUMBLINE_DESK_PASSWORD";

/// Open a page for the person who measures: everything by mouse and keyboard, nothing to type here.
///
/// The page leads through the whole way. Print: the sheets with the targets. Boxes: a new one with its key
/// and the files for its card; each by its name, how it is, what the doctor finds, and its settings.
/// Aim: the camera's picture, and the next thing to do in one sentence. Calibrate: photographs of the
/// board, how much of the frame they cover, each one's error, the verdict. Scene: which way is forward.
/// Study: a protocol of conditions, and participants by codes. Session: instructions, countdown, tones,
/// marks, the sway as it happens, and after each trial its verdict, to be accepted or repeated. Trials:
/// each with its report, and the study's.
///
/// It knows the boxes whose keys are on this computer (`plumb keys list`), and makes new ones; several at
/// once are no matter. What it records is what `plumb receive` records, and a study is a folder that
/// `plumb study` reads. A page that is slow, closed or opened eight times touches no recording. When the page, the
/// desk or the computer was ended in the middle of a session, it goes on where it was; of a trial no
/// more than its last second is lost.
///
/// The page is for this computer: its address holds a token that is new each time, and no page from
/// elsewhere in the same browser gets anything. --listen opens it to others, by TLS and with a password:
/// for a tablet, for example. The browser then shows a warning once, because nobody vouches for the
/// desk's certificate; compare its fingerprint with the one that is printed here.
///
/// Ctrl-C ends it; a trial that is being recorded is ended and kept.
///
/// Exit code 0: done; 2: the address, the folder or an option could not be used.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  plumb desk\n  \
    plumb desk --folder ~/sway                       # studies and photographs are kept there\n  \
    plumb desk --serial /dev/ttyUSB0                 # a box on a serial line, too\n  \
    plumb desk --lsl --mark-lsl Stimuli              # with the Lab Streaming Layer\n  \
    plumb desk --listen 0.0.0.0:4270 --password-file desk.txt    # for a tablet, by TLS")]
pub struct Arguments {
    /// Where studies and photographs are kept [default: Plumbline, in the home directory]
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,

    /// The page's port at this computer [default: 4270, or a free one]
    #[arg(long, value_name = "PORT", conflicts_with = "listen")]
    port: Option<u16>,

    /// Serve the page to other computers too, at this address: by TLS, and with a password
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    listen: Option<SocketAddr>,

    /// The file whose first line is the password [default: the variable PLUMBLINE_DESK_PASSWORD, or it
    /// is asked for]
    #[arg(long, value_name = "FILE", requires = "listen")]
    password_file: Option<PathBuf>,

    /// A certificate to show (PEM), instead of the desk's own
    #[arg(long, value_name = "FILE", requires_all = ["listen", "key"])]
    certificate: Option<PathBuf>,

    /// The private key of --certificate (PEM)
    #[arg(long, value_name = "FILE", requires = "certificate")]
    key: Option<PathBuf>,

    /// Print the page's address, and open no browser
    #[arg(long)]
    no_browser: bool,

    /// Where boxes announce themselves to this computer; may be repeated [default: 0.0.0.0:4210]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    udp: Vec<SocketAddr>,

    /// A serial device of this computer with a box at its other end; may be repeated
    #[arg(long, value_name = "DEVICE")]
    serial: Vec<String>,

    /// Bits per second of the serial devices
    #[arg(long, value_name = "RATE", default_value_t = BAUD, requires = "serial")]
    baud: u32,

    /// Streams for other programs; of several boxes, each has the next port, and its name.
    #[command(flatten)]
    streams: StreamArguments,

    /// Take marks from datagrams to this address: the text of each is its name
    ///
    /// Only from this computer, unless others are named with --mark-from. Marks of other programs go into
    /// every trial that is being recorded.
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    mark_udp: Option<SocketAddr>,

    /// Take marks from this computer too, whose name is written beside them; may be repeated
    #[arg(long, value_name = "NAME=ADDRESS", value_parser = MarkFrom::parse, requires = "mark_udp")]
    mark_from: Vec<MarkFrom>,

    /// Take marks from this serial device: each line is a mark
    #[arg(long, value_name = "DEVICE[:BAUD]")]
    mark_serial: Option<String>,

    /// Take marks from a modem line of this serial device: cts (default), dsr, dcd or ri
    ///
    /// Each time the line is asserted is a mark, named after the line, whose uncertainty is stored with it.
    /// A trigger at the box's own line is known better: it is among the box's settings.
    #[arg(long, value_name = "DEVICE[:LINE]", value_parser = ModemLine::parse)]
    mark_line: Option<ModemLine>,

    /// Take marks from the Lab Streaming Layer: the markers of the stream with this name
    #[arg(long, value_name = "NAME")]
    mark_lsl: Option<String>,
}

/// Runs the subcommand.
///
/// # Errors
/// When the address, the folder or an option cannot be used.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let whom = whom(arguments)?;
    let ways = arguments.streams.ways();
    let lsl = library([ways.lsl.as_ref(), arguments.mark_lsl.as_ref()])?;
    let udp = match &arguments.udp[..] {
        [] => vec![SocketAddr::from(([0, 0, 0, 0], PORT))],
        given => given.to_vec(),
    };
    let stop = stop_on_signals()?;
    let desk = Desk::start(Settings {
        folder: folder(arguments)?,
        udp,
        serial: arguments.serial.iter().map(|it| (it.clone(), arguments.baud)).collect(),
        program: program(),
        ways,
        lsl,
        marks: MarkSettings {
            udp: arguments.mark_udp,
            from: arguments.mark_from.clone(),
            serial: arguments.mark_serial.clone(),
            line: arguments.mark_line.clone(),
            lsl: arguments.mark_lsl.clone(),
        },
    })?;
    for warning in desk.warnings() {
        eprintln!("warning: {warning}");
    }
    let desk = Arc::new(desk);
    let mut server = Server::start(Arc::clone(&desk), whom)?;
    // A closed pipe must not end a session.
    let _ = writeln!(std::io::stdout(), "the desk: {}", server.url);
    if let Some(fingerprint) = &server.fingerprint {
        let _ = writeln!(std::io::stdout(), "its certificate (SHA-256): {fingerprint}");
    }
    eprintln!("studies and photographs are kept in {}; Ctrl-C ends it", desk.folder.display());
    let is_terminal = std::io::stdout().is_terminal();
    if is_terminal && !arguments.no_browser && open::that_detached(&server.url).is_err() {
        eprintln!("no browser could be opened: open this address in one");
    }
    while !stop.load(Ordering::Relaxed) && server.runs() {
        std::thread::sleep(LOOK_EVERY);
    }
    // First of all the trial; pages are shown what becomes of it.
    desk.stop();
    server.end();
    let gave_way = server.gave_way();
    if gave_way > 0 {
        eprintln!(
            "warning: {} had to give way to others: {CONNECTIONS_MAX} are open at most",
            counted(gave_way, "connection")
        );
    }
    Ok(())
}

/// Where studies are kept.
fn folder(arguments: &Arguments) -> Result<PathBuf, BadInput> {
    if let Some(folder) = &arguments.folder {
        return Ok(folder.clone());
    }
    let home = std::env::home_dir().ok_or_else(|| {
        BadInput::whole("HOME", "this user has no home directory", "give --folder")
    })?;
    Ok(home.join("Plumbline"))
}

/// For whom the page is.
fn whom(arguments: &Arguments) -> Result<For, BadInput> {
    let Some(address) = arguments.listen else { return Ok(For::ThisComputer(arguments.port)) };
    let password = Password::new(&password(arguments.password_file.as_deref())?)?;
    let certificate = arguments.certificate.clone().zip(arguments.key.clone());
    Ok(For::Others { address, password, certificate })
}

/// The password: of a file, of the environment, or typed.
fn password(file: Option<&Path>) -> Result<Zeroizing<String>, BadInput> {
    if let Some(file) = file {
        return password::of_file(file);
    }
    if let Ok(password) = std::env::var(PASSWORD_VARIABLE) {
        return Ok(password.into());
    }
    password::typed("a password for the desk (it is not shown)", || {
        BadInput::whole(
            "--listen",
            "the desk has no password, and nobody can be asked for one",
            format!("give --password-file, or set {PASSWORD_VARIABLE}"),
        )
    })
}
