//! Where marks come from: datagrams, a serial device, and lines of whatever else, such as the
//! keyboard. Each has a thread of its own, so that a mark gets the time at which it came.

use std::io::{BufRead, BufReader, ErrorKind, Read as _};
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::link::BAUD;
use plumbline_trial::mark::{Mark, MarkSender, Marks, Source, channel};

use super::modem_line::Watch;

/// A serial device is silent most of the time.
const LINE_WAIT: Duration = Duration::from_secs(3600);

/// The longest line that a device may send.
const LINE_BYTES_MAX: u64 = 1024;

/// Another computer whose marks are taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MarkFrom {
    name: String,
    address: IpAddr,
}

impl MarkFrom {
    /// Parses `NAME=ADDRESS`.
    ///
    /// # Errors
    /// The text says what to give instead.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wanted = || "give the computer's name and numeric address: treadmill=192.168.1.40";
        let (name, address) = text.split_once('=').ok_or_else(wanted)?;
        let is_name = |name: &str| {
            (1..=32).contains(&name.len())
                && name.chars().all(|letter| letter.is_alphanumeric() || "-_.".contains(letter))
        };
        if !is_name(name) {
            return Err("a name has 1 to 32 letters, digits, -, _ and .".to_owned());
        }
        let address = address.parse().map_err(|_| wanted())?;
        Ok(Self { name: name.to_owned(), address })
    }
}

/// The datagrams that were no marks, because of where they came from.
#[derive(Debug, Clone, Default)]
pub struct Strangers(Arc<AtomicU64>);

impl Strangers {
    /// Their number.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// What is known of marks that did not count.
#[derive(Debug, Clone, Default)]
pub struct Uncounted {
    /// Datagrams of computers that are not named.
    pub strangers: Strangers,
    /// The modem line, where there is one.
    pub watch: Option<Watch>,
    /// Markers of the Lab Streaming Layer whose time could not be.
    pub refused: u64,
}

impl Uncounted {
    /// Each kind that there was, and what to do.
    #[must_use]
    pub fn amiss(&self) -> Vec<BadInput> {
        let marks = |count: u64| (count > 0).then(|| counted(count, "mark"));
        let missed = self.watch.as_ref().map_or(0, Watch::missed);
        let is_gone = self.watch.as_ref().is_some_and(Watch::is_gone);
        let kinds = [
            marks(self.strangers.count()).map(|marks| {
                BadInput::whole(
                    "--mark-udp",
                    format!("{marks} from other computers did not count"),
                    "name them with --mark-from",
                )
            }),
            marks(missed).map(|marks| {
                BadInput::whole(
                    "--mark-line",
                    format!("{marks} came too fast one after the other and did not count"),
                    "let the device keep the line for longer, or free a contact of its bouncing",
                )
            }),
            is_gone.then(|| {
                BadInput::whole(
                    "--mark-line",
                    "its device has gone, and what it marked since then is missing",
                    "plug it in, and start this program again",
                )
            }),
            marks(self.refused).map(|marks| {
                BadInput::whole(
                    "--mark-lsl",
                    format!("{marks} did not count: the time was minutes away"),
                    "let the other program take its times from the Lab Streaming Layer",
                )
            }),
        ];
        kinds.into_iter().flatten().collect()
    }
}

/// Listens to what is named; datagrams count from this computer, and from those that are named in
/// `from`. Further marks may be sent by the sender, such as those of the keyboard.
///
/// # Errors
/// When an address or a device cannot be used.
pub fn listen(
    udp: Option<SocketAddr>,
    from: &[MarkFrom],
    serial: Option<&str>,
) -> Result<(MarkSender, Marks, Strangers), BadInput> {
    let (sender, marks) = channel();
    let strangers = Strangers::default();
    if let Some(address) = udp {
        let place = format!("--mark-udp {address}");
        let socket = UdpSocket::bind(address).map_err(|error| match error.kind() {
            ErrorKind::AddrInUse => BadInput::whole(
                place,
                "another program listens there",
                "stop that program, or choose another port, here and where marks are sent from",
            ),
            _ => BadInput::io(place, &error),
        })?;
        let (sender, from, strangers) = (sender.clone(), from.to_vec(), strangers.clone());
        thread::spawn(move || datagrams(&socket, &from, &sender, &strangers));
    }
    if let Some(device) = serial {
        let (path, baud) = path_and_baud(device)?;
        let port = serialport::new(path, baud).timeout(LINE_WAIT).open().map_err(|error| {
            BadInput::whole(
                format!("--mark-serial {device}"),
                error,
                "check that it is plugged in, and that you may use it",
            )
        })?;
        let sender = sender.clone();
        thread::spawn(move || lines(BufReader::new(port), Source::Serial, &sender));
    }
    Ok((sender, marks, strangers))
}

fn path_and_baud(device: &str) -> Result<(&str, u32), BadInput> {
    match device.rsplit_once(':') {
        None => Ok((device, BAUD)),
        Some((path, baud)) => baud.parse().map(|baud| (path, baud)).map_err(|_| {
            BadInput::whole(
                "--mark-serial",
                format!("{baud:?} is not a baud rate"),
                "give DEVICE or DEVICE:BAUD, such as /dev/ttyUSB1:9600",
            )
        }),
    }
}

fn datagrams(socket: &UdpSocket, from: &[MarkFrom], sender: &MarkSender, strangers: &Strangers) {
    let mut buffer = [0; LINE_BYTES_MAX as usize];
    while let Ok((length, address)) = socket.recv_from(&mut buffer) {
        let at = Instant::now();
        let mark = Mark::new(Source::Udp, &String::from_utf8_lossy(&buffer[..length]));
        let Some(mark) = of(mark, address.ip(), from) else {
            strangers.0.fetch_add(1, Ordering::Relaxed);
            continue;
        };
        if !sender.send(at, mark) {
            return;
        }
    }
}

/// The mark that comes from this address, if it counts.
fn of(mark: Mark, address: IpAddr, from: &[MarkFrom]) -> Option<Mark> {
    // A socket of both families gives IPv4 addresses as IPv6 ones.
    let address = address.to_canonical();
    match from.iter().find(|named| named.address.to_canonical() == address) {
        Some(named) => Some(mark.sent_by(&named.name)),
        None => address.is_loopback().then_some(mark),
    }
}

/// Makes each line a mark, until the input ends.
pub fn lines(mut input: impl BufRead, source: Source, sender: &MarkSender) {
    let mut line = Vec::new();
    loop {
        line.clear();
        match input.by_ref().take(LINE_BYTES_MAX).read_until(b'\n', &mut line) {
            Ok(0) => return,
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::TimedOut => continue,
            Err(_) => return,
        }
        let at = Instant::now();
        if !sender.send(at, Mark::new(source, &String::from_utf8_lossy(&line))) {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_line_is_a_mark() {
        let (sender, marks) = channel();
        lines(&b"stands\n\nlate\n"[..], Source::Key, &sender);
        let labels: Vec<String> =
            std::iter::from_fn(|| marks.next()).map(|(_, mark)| mark.label).collect();
        assert_eq!(labels, ["stands", "mark", "late"]);
    }

    #[test]
    fn marks_come_from_this_computer_and_from_those_that_are_named() {
        let from =
            ["treadmill=192.0.2.40", "plate=2001:db8::7"].map(|it| MarkFrom::parse(it).unwrap());
        let by = |address: &str| {
            let mark = Mark::new(Source::Udp, "zero");
            let mark = of(mark, address.parse().unwrap(), &from)?;
            Some(mark.sender.unwrap_or_else(|| "here".to_owned()))
        };
        for (address, sender) in [
            ("127.0.0.1", Some("here")),
            ("::1", Some("here")),
            ("192.0.2.40", Some("treadmill")),
            // As a socket of both families has it.
            ("::ffff:192.0.2.40", Some("treadmill")),
            ("::ffff:127.0.0.1", Some("here")),
            ("2001:db8::7", Some("plate")),
            ("192.0.2.41", None),
            ("2001:db8::8", None),
        ] {
            assert_eq!(by(address).as_deref(), sender, "{address}");
        }
    }

    #[test]
    fn what_did_not_count_is_told_with_its_number_and_a_remedy() {
        assert_eq!(Uncounted::default().amiss(), []);
        let strangers = Strangers::default();
        strangers.0.store(2, Ordering::Relaxed);
        let amiss = Uncounted { strangers, watch: None, refused: 1 }.amiss();
        let said: Vec<String> = amiss.iter().map(ToString::to_string).collect();
        assert_eq!(
            said,
            [
                "--mark-udp: 2 marks from other computers did not count; name them with --mark-from",
                "--mark-lsl: 1 mark did not count: the time was minutes away; let the other program \
                 take its times from the Lab Streaming Layer"
            ]
        );
    }

    #[test]
    fn a_computer_is_named_with_its_address() {
        for wrong in ["treadmill", "=10.0.0.1", "a b=10.0.0.1", "treadmill=lab-pc"] {
            MarkFrom::parse(wrong).unwrap_err();
        }
        let named = MarkFrom::parse("force-plate=fe80::1").unwrap();
        assert_eq!(named.address, "fe80::1".parse::<IpAddr>().unwrap());
    }

    #[test]
    fn a_datagram_is_a_mark() {
        let address = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let (_, marks, _) = listen(Some(address), &[], None).unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let sent = Instant::now();
        socket.send_to(b"eyes closed\n", address).unwrap();
        let (at, mark) = loop {
            assert!(sent.elapsed() < Duration::from_secs(10));
            if let Some(mark) = marks.next() {
                break mark;
            }
            thread::sleep(Duration::from_millis(1));
        };
        assert_eq!(mark, Mark::new(Source::Udp, "eyes closed"));
        assert!(at >= sent);
    }

    #[test]
    fn a_device_may_have_a_rate() {
        assert_eq!(path_and_baud("/dev/ttyUSB1").unwrap(), ("/dev/ttyUSB1", BAUD));
        assert_eq!(path_and_baud("/dev/ttyUSB1:9600").unwrap(), ("/dev/ttyUSB1", 9600));
        assert!(path_and_baud("/dev/ttyUSB1:fast").is_err());
    }
}
