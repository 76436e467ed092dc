//! Where marks come from: the keyboard, datagrams, a serial device. Each has a thread of its own,
//! so that a mark gets the time at which it came.

use std::io::{BufRead, BufReader, ErrorKind, IsTerminal, Read};
use std::net::{SocketAddr, UdpSocket};
use std::thread;
use std::time::{Duration, Instant};

use plumbline_files::BadInput;
use plumbline_stream::link::BAUD;
use plumbline_trial::mark::{Mark, MarkSender, Marks, Source, channel};

/// A serial device is silent most of the time.
const LINE_WAIT: Duration = Duration::from_secs(3600);

/// The longest line that a device may send.
const LINE_BYTES_MAX: u64 = 1024;

/// Listens to what is named. Further marks may be sent by the sender: those of the keyboard.
///
/// # Errors
/// When an address or a device cannot be used.
pub(super) fn listen(
    udp: Option<SocketAddr>,
    serial: Option<&str>,
) -> Result<(MarkSender, Marks), BadInput> {
    let (sender, marks) = channel();
    if let Some(address) = udp {
        let place = format!("--mark-udp {address}");
        let socket = UdpSocket::bind(address).map_err(|error| BadInput::io(place, &error))?;
        let sender = sender.clone();
        thread::spawn(move || datagrams(&socket, &sender));
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
    Ok((sender, marks))
}

/// Takes lines from the keyboard, if there is one, where the terminal is not a screen.
pub(super) fn listen_to_lines(sender: MarkSender) {
    // A script's standard input is not this program's to read.
    if has_keyboard() {
        thread::spawn(move || lines(std::io::stdin().lock(), Source::Key, &sender));
    }
}

/// Whether somebody can type a mark.
pub(super) fn has_keyboard() -> bool {
    std::io::stdin().is_terminal()
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

fn datagrams(socket: &UdpSocket, sender: &MarkSender) {
    let mut buffer = [0; LINE_BYTES_MAX as usize];
    while let Ok((length, _)) = socket.recv_from(&mut buffer) {
        let at = Instant::now();
        let label = String::from_utf8_lossy(&buffer[..length]);
        if !sender.send(at, Mark::new(Source::Udp, &label)) {
            return;
        }
    }
}

fn lines(mut input: impl BufRead, source: Source, sender: &MarkSender) {
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
    fn a_datagram_is_a_mark() {
        let address = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let (_, marks) = listen(Some(address), None).unwrap();
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
