//! `plumb gateway`: a ward of boxes, for an MQTT broker.

use std::io::{IsTerminal as _, Write as _};
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use plumbline_desk::http::For;
use plumbline_files::BadInput;
use plumbline_gateway::broker::{self, PORT, PORT_PLAIN};
use plumbline_gateway::list::List;
use plumbline_gateway::{Gateway, Recorded, Settings, topics};
use plumbline_stream::link::PORT as BOX_PORT;

use crate::arguments::{address, program, seconds};
use crate::ui::password;
use crate::ui::stop::stop_on_signals;

mod screen;

use screen::Screen;

/// The end is noticed within this time.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// How everything is, is looked at this often.
const SHOW_EVERY: Duration = Duration::from_secs(1);

/// Without a terminal a line is written this often.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// The longest trial.
const TRIAL_MAX: Duration = Duration::from_secs(3600);

/// Receive from all boxes of a ward, record them, and publish how they are to an MQTT 5 broker.
///
/// It hears every box whose key is on this computer (`plumb keys list`), all at one port, and publishes
/// below plumbline/1/WARD/ as JSON, retained, with QoS 1: of each box its state, its health, what the
/// doctor finds amiss, and of each trial the verdict and a summary with its figures; of itself whether it
/// is there (with a last will) and what it hears, records and loses. README lists the topics. No pose is
/// published, no name of a person, and no code of a participant.
///
/// Trials are recorded into FOLDER/trials/BOX/, as by `plumb receive`: without end with --record, one
/// trial after the other, and by command with --commands. A command is a message to
/// plumbline/1/WARD/BOX/command: {"do":"start"}, which may have a "name" and "seconds", or {"do":"stop"}.
/// An answer goes to the message's response topic, which has to lie below plumbline/1/WARD/reply/. Who may
/// command is decided by the broker's users and access rules. Retained commands are ignored.
///
/// The connection is by TLS; the broker's certificate must be signed by an authority that this computer
/// trusts, or that of --ca. While the broker is away, verdicts and summaries are kept in FOLDER/outbox
/// until it has them, also over an end of this program; of everything else the newest state counts.
/// A message may come twice. What has to be dropped is counted, and said.
///
/// --page serves the desk's page with the boxes of the ward: each by its name, how it is, and what the
/// doctor finds. It only shows; a desk beside the gateway would contend for the boxes.
///
/// A terminal shows a table of the boxes; elsewhere a line is written every ten seconds. Ctrl-C ends it:
/// trials are ended, judged and kept. Pressed once more, it does not wait for verdicts, which then come
/// after the next start.
///
/// Exit code 0: done; 2: the address, the folder or an option could not be used.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  plumb gateway --broker mqtt.ward --user gateway --password-file gateway.txt\n  \
    plumb gateway --broker mqtt.ward --ca ward-ca.pem --user gateway --ward north --commands\n  \
    plumb gateway --broker mqtt.ward --user gateway --record all --trial-seconds 120\n  \
    plumb gateway --broker localhost --plain         # a broker on this computer, to try it\n  \
    mosquitto_sub -V 5 -h mqtt.ward --cafile ward-ca.pem -u desk -P ... -v -t 'plumbline/1/north/#'"
)]
pub struct Arguments {
    /// The broker: its name or address, and its port [default port: 8883, with --plain 1883]
    #[arg(long, value_name = "HOST[:PORT]", value_parser = Place::parse)]
    broker: Place,

    /// The user at the broker
    #[arg(long, value_name = "NAME")]
    user: Option<String>,

    /// The file whose first line is the password [default: it is asked for]
    #[arg(long, value_name = "FILE", requires = "user")]
    password_file: Option<PathBuf>,

    /// Authorities that may sign the broker's certificate (PEM) [default: those of this computer]
    #[arg(long, value_name = "FILE", conflicts_with = "plain")]
    ca: Option<PathBuf>,

    /// Without TLS: everybody on the way can read and forge everything, the password too
    #[arg(long)]
    plain: bool,

    /// The ward's name, in every topic
    #[arg(long, value_name = "NAME", value_parser = topics::ward, default_value = "ward")]
    ward: String,

    /// Take commands from the broker: to start and to stop trials
    #[arg(long)]
    commands: bool,

    /// Record this box always, one trial after the other: its name, serial number or key, or all; may be
    /// repeated
    #[arg(long, value_name = "BOX")]
    record: Vec<String>,

    /// How long a trial lasts, unless a command says otherwise; an hour at most
    #[arg(long, value_name = "SECONDS", value_parser = trial_seconds, default_value = "600")]
    trial_seconds: Duration,

    /// Publish the names of trials that commands give them: they must not tell who was measured
    #[arg(long)]
    publish_names: bool,

    /// Publish healths this often
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "10")]
    every: Duration,

    /// Where trials are kept, and what waits for the broker [default: Plumbline/ward in the home
    /// directory]
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,

    /// Where boxes announce themselves to this computer [default: 0.0.0.0:4210]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    udp: Option<SocketAddr>,

    /// Show the boxes on a page as well, as the desk does; its address is printed
    #[arg(long)]
    page: bool,

    /// The port of the page, which is for this computer only [default: 4270, or a free one]
    #[arg(long, value_name = "PORT", requires = "page")]
    page_port: Option<u16>,

    /// Show nothing but warnings
    #[arg(long)]
    quiet: bool,
}

/// Where a broker is.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Place {
    host: String,
    port: Option<u16>,
}

impl Place {
    fn parse(text: &str) -> Result<Self, String> {
        let (host, port) = match text.rsplit_once(':') {
            Some((host, port)) => {
                let port = port.parse().ok().filter(|port| *port > 0);
                (host, Some(port.ok_or("give a port from 1 to 65535 after the colon")?))
            }
            None => (text, None),
        };
        let is_plain = |letter: char| letter.is_ascii_alphanumeric() || ".-_".contains(letter);
        if host.is_empty() || !host.chars().all(is_plain) {
            return Err(
                "give a name such as mqtt.ward or an IPv4 address, and no scheme".to_owned()
            );
        }
        Ok(Self { host: host.to_owned(), port })
    }

    /// Whether it is on this computer, as far as its name tells.
    fn is_here(&self) -> bool {
        self.host == "localhost" || self.host.parse().is_ok_and(|it: IpAddr| it.is_loopback())
    }
}

fn trial_seconds(text: &str) -> Result<Duration, String> {
    let lasts = seconds(text)?;
    if lasts > TRIAL_MAX { Err("no trial lasts longer than an hour".to_owned()) } else { Ok(lasts) }
}

impl Arguments {
    fn broker(&self) -> Result<broker::Settings, BadInput> {
        let tls = match self.plain {
            true => None,
            false => Some(broker::tls(self.ca.as_deref())?),
        };
        let usual = if self.plain { PORT_PLAIN } else { PORT };
        let user = match &self.user {
            None => None,
            Some(user) => {
                let password = match &self.password_file {
                    Some(file) => password::of_file(file)?,
                    None => password::typed(
                        &format!("the password of {user:?} (it is not shown)"),
                        || {
                            BadInput::whole(
                                "--user",
                                "there is no password, and nobody can be asked for one",
                                "give --password-file",
                            )
                        },
                    )?,
                };
                Some((user.clone(), password))
            }
        };
        let port = self.broker.port.unwrap_or(usual);
        Ok(broker::Settings { host: self.broker.host.clone(), port, tls, user })
    }

    fn folder(&self) -> Result<PathBuf, BadInput> {
        if let Some(folder) = &self.folder {
            return Ok(folder.clone());
        }
        let home = std::env::home_dir().ok_or_else(|| {
            BadInput::whole("HOME", "this user has no home directory", "give --folder")
        })?;
        Ok(home.join("Plumbline").join("ward"))
    }

    fn record(&self) -> Recorded {
        match &self.record[..] {
            [] => Recorded::None,
            names if names.iter().any(|it| it == "all") => Recorded::All,
            names => Recorded::These(names.to_vec()),
        }
    }
}

/// Runs the subcommand.
///
/// # Errors
/// When the address, the folder or an option cannot be used.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let folder = arguments.folder()?;
    let broker = arguments.broker()?;
    if arguments.plain {
        let whom = if arguments.broker.is_here() {
            "other programs of this computer"
        } else {
            "everybody on the way to the broker"
        };
        eprintln!(
            "warning: --plain: the connection is not encrypted; {whom} can read and forge everything, \
             the password too"
        );
    }
    let stop = stop_on_signals()?;
    let mut gateway = Gateway::start(Settings {
        folder: folder.clone(),
        udp: arguments.udp.unwrap_or(SocketAddr::from(([0, 0, 0, 0], BOX_PORT))),
        program: program(),
        ward: arguments.ward.clone(),
        broker,
        commands: arguments.commands,
        record: arguments.record(),
        lasts: arguments.trial_seconds,
        names: arguments.publish_names,
        every: arguments.every,
    })?;
    eprintln!("trials are kept in {}; Ctrl-C ends it", folder.join("trials").display());
    let mut list = match arguments.page {
        false => None,
        true => {
            let whom = For::ThisComputer(arguments.page_port);
            let list = List::open(folder.join("page"), gateway.boxes(), whom)?;
            let _ = writeln!(std::io::stdout(), "the ward's boxes: {}", list.url());
            Some(list)
        }
    };
    let is_screen = std::io::stdout().is_terminal() && !arguments.quiet;
    let mut screen = Screen::new(is_screen);
    let mut show_at = Instant::now();
    let mut line_at = show_at + LINE_EVERY;
    let mut is_ending = false;
    while !gateway.is_over() {
        if stop.swap(false, Ordering::Relaxed) {
            if std::mem::replace(&mut is_ending, true) {
                gateway.hurry();
            } else {
                screen.say(
                    "trials are ended and judged; Ctrl-C once more leaves the verdicts for later",
                );
                gateway.stop();
            }
        }
        for words in gateway.take_notices() {
            if !arguments.quiet || words.starts_with("warning") || words.starts_with("error") {
                screen.say(&words);
            }
        }
        let now = Instant::now();
        if now >= show_at {
            show_at = now + SHOW_EVERY;
            let overview = gateway.overview();
            screen.show(&overview);
            if let Some(list) = &mut list {
                list.show(&overview);
            }
            if !is_screen && !arguments.quiet && now >= line_at {
                line_at = now + LINE_EVERY;
                // A closed pipe must not end the ward's records.
                let _ = writeln!(std::io::stdout(), "{}", overview.line());
            }
        }
        std::thread::sleep(LOOK_EVERY);
    }
    if let Some(list) = &mut list {
        list.end();
    }
    gateway.end();
    screen.end();
    for words in gateway.take_notices() {
        eprintln!("{words}");
    }
    let overview = gateway.overview();
    let _ = writeln!(std::io::stdout(), "{}", overview.summary());
    for words in overview.amiss() {
        eprintln!("warning: {words}");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brokers_are_named_with_or_without_a_port() {
        let place = |host: &str, port| Ok(Place { host: host.to_owned(), port });
        assert_eq!(Place::parse("mqtt.ward"), place("mqtt.ward", None));
        assert_eq!(Place::parse("10.0.0.3:8884"), place("10.0.0.3", Some(8884)));
        for wrong in ["", ":1883", "mqtt.ward:0", "mqtt.ward:x", "mqtts://mqtt.ward", "a b", "u@h"]
        {
            assert!(Place::parse(wrong).is_err(), "{wrong}");
        }
        assert!(Place::parse("127.0.0.1").unwrap().is_here());
        assert!(!Place::parse("mqtt.ward").unwrap().is_here());
    }
}
