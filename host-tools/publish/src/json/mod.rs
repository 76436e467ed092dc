//! Lines of JSON over TCP: a line that describes the stream, then a line for each frame, gap, mark
//! and notice. [The page on the formats](../../FORMATS.md) has every field.
//!
//! Each client has a thread and a queue of [`LINES_MAX`] lines. One that reads too slowly loses the
//! oldest frames in it, and a line says how many; all others, and the reception, go on.
//!
//! A late frame is published when it comes, marked as late.

pub mod lines;

use std::collections::VecDeque;
use std::io::Write;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use plumbline_files::BadInput;
use plumbline_files::counting::counted;

use crate::item::Item;

/// The lines that wait for a client: half a minute of a camera of 60 Hz, 2 MB.
pub const LINES_MAX: usize = 2048;

/// Clients at a time.
pub const CLIENTS_MAX: usize = 32;

/// A new client waits no longer than this.
const ACCEPT_EVERY: Duration = Duration::from_millis(20);

/// At the end, what waits for a client is sent for no longer than this.
const END_WITHIN: Duration = Duration::from_secs(1);

/// Whom the lines go to.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    clients: Vec<Arc<Client>>,
    /// The latest line that describes the stream.
    stream: Arc<str>,
    served: u64,
    refused: u64,
    dropped: u64,
}

impl Server {
    /// Listens at this address.
    ///
    /// # Errors
    /// When that is not possible.
    pub fn bind(address: SocketAddr) -> Result<Self, BadInput> {
        let bound = TcpListener::bind(address).and_then(|listener| {
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        });
        let (listener, address) = bound.map_err(|error| {
            BadInput::whole(
                format!("--json {address}"),
                error,
                "give an address of this computer and a port that no other program uses",
            )
        })?;
        Ok(Self {
            listener,
            address,
            clients: Vec::new(),
            stream: lines::unknown_stream().into(),
            served: 0,
            refused: 0,
            dropped: 0,
        })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sends until nothing more comes; what came of it, in words.
    #[must_use]
    pub fn run(mut self, items: &Receiver<Item>) -> Vec<String> {
        let mut zero_unix_s = 0.0;
        loop {
            match items.recv_timeout(ACCEPT_EVERY) {
                Ok(item) => {
                    if let Item::Stream(stream) = &item {
                        zero_unix_s = stream.zero_unix_s;
                    }
                    let line: Arc<str> = lines::line(&item, zero_unix_s).into();
                    if matches!(item, Item::Stream(_)) {
                        self.stream = Arc::clone(&line);
                    }
                    self.hand_out(&line, matches!(item, Item::Frame(_)));
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.accept();
        }
        self.end()
    }

    fn hand_out(&mut self, line: &Arc<str>, is_frame: bool) {
        let dropped = &mut self.dropped;
        self.clients.retain(|client| {
            let mut queue = client.queue();
            if queue.state == State::Gone {
                return false;
            }
            *dropped += queue.push(line, is_frame);
            drop(queue);
            client.changed.notify_one();
            true
        });
    }

    fn accept(&mut self) {
        // Fails where nobody waits, too, and otherwise for reasons of that one client.
        while let Ok((stream, _)) = self.listener.accept() {
            self.clients.retain(|client| client.queue().state != State::Gone);
            if self.clients.len() == CLIENTS_MAX {
                self.refused += 1;
                let line =
                    lines::notice("this is one client too many: end another, and connect again");
                // A line always fits into the buffer of a new connection.
                let _ = stream
                    .set_nonblocking(true)
                    .and_then(|()| (&stream).write_all(line.as_bytes()));
                continue;
            }
            if let Ok(client) = Client::start(stream, &self.stream) {
                self.served += 1;
                self.clients.push(client);
            }
        }
    }

    fn end(mut self) -> Vec<String> {
        self.hand_out(&lines::end().into(), false);
        for client in &self.clients {
            let mut queue = client.queue();
            if queue.state == State::Open {
                queue.state = State::Ending;
            }
            client.changed.notify_one();
        }
        let begun = Instant::now();
        let mut waits = self.clients.iter();
        while begun.elapsed() < END_WITHIN
            && waits.clone().any(|client| client.queue().state != State::Gone)
        {
            thread::sleep(Duration::from_millis(5));
        }
        // Ends the writing to those who do not read.
        let cut = waits.by_ref().filter(|client| client.queue().state != State::Gone);
        cut.for_each(|client| {
            let _ = client.stream.shutdown(Shutdown::Both);
        });
        let mut said =
            vec![format!("JSON at {}: {}", self.address, counted(self.served, "client"))];
        if self.dropped > 0 {
            said.push(format!(
                "warning: JSON: {} dropped for clients that read too slowly",
                counted(self.dropped, "line")
            ));
        }
        if self.refused > 0 {
            said.push(format!(
                "warning: JSON: {} refused, beyond {CLIENTS_MAX} at a time",
                counted(self.refused, "client")
            ));
        }
        said
    }
}

/// One client.
struct Client {
    stream: TcpStream,
    queue: Mutex<Queue>,
    changed: Condvar,
}

/// What waits for a client.
struct Queue {
    /// The lines, and whether each is a frame.
    lines: VecDeque<(Arc<str>, bool)>,
    /// Lines dropped since the client was last told.
    dropped: u64,
    state: State,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Open,
    /// Nothing more comes.
    Ending,
    /// Nothing more is sent.
    Gone,
}

impl Queue {
    /// Returns how many lines were dropped for it: the oldest frame, or if there is none the oldest
    /// line.
    fn push(&mut self, line: &Arc<str>, is_frame: bool) -> u64 {
        let is_full = self.lines.len() >= LINES_MAX;
        if is_full {
            let oldest = self.lines.iter().position(|(_, is_frame)| *is_frame).unwrap_or(0);
            self.lines.remove(oldest);
            self.dropped += 1;
        }
        self.lines.push_back((Arc::clone(line), is_frame));
        u64::from(is_full)
    }
}

impl Client {
    fn start(stream: TcpStream, first: &Arc<str>) -> std::io::Result<Arc<Self>> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        let lines = VecDeque::from([(Arc::clone(first), false)]);
        let queue = Mutex::new(Queue { lines, dropped: 0, state: State::Open });
        let client = Arc::new(Self { stream, queue, changed: Condvar::new() });
        let own = Arc::clone(&client);
        thread::Builder::new().name("JSON client".to_owned()).spawn(move || own.serve())?;
        Ok(client)
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        // A queue is whole, whoever has panicked.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends what comes, until the end or until the client is gone.
    fn serve(&self) {
        while let Some(text) = self.next() {
            if (&self.stream).write_all(text.as_bytes()).is_err() {
                break;
            }
        }
        self.queue().state = State::Gone;
        let _ = self.stream.shutdown(Shutdown::Both);
    }

    /// All lines that wait, once there are any; `None` at the end.
    fn next(&self) -> Option<String> {
        let mut queue = self.queue();
        loop {
            if !queue.lines.is_empty() {
                break;
            }
            if queue.state != State::Open {
                return None;
            }
            queue = self.changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
        let dropped = std::mem::take(&mut queue.dropped);
        let mut text = String::new();
        if dropped > 0 {
            text += &lines::dropped(dropped);
        }
        queue.lines.drain(..).for_each(|(line, _)| text += &line);
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader};
    use std::sync::mpsc::{Sender, channel};
    use std::thread::JoinHandle;

    use serde_json::Value;

    use super::*;
    use crate::json::lines::tests::{sample, stream};

    struct Running {
        address: SocketAddr,
        items: Sender<Item>,
        thread: JoinHandle<Vec<String>>,
    }

    fn start() -> Running {
        let server = Server::bind("127.0.0.1:0".parse().unwrap()).unwrap();
        let address = server.address();
        let (items, receiver) = channel();
        Running { address, items, thread: thread::spawn(move || server.run(&receiver)) }
    }

    /// A client that has read its first line, so that it gets all that follow.
    fn connected(address: SocketAddr) -> (BufReader<TcpStream>, Value) {
        let mut reader = BufReader::new(TcpStream::connect(address).unwrap());
        let first = next(&mut reader).unwrap();
        (reader, first)
    }

    fn next(reader: &mut BufReader<TcpStream>) -> Option<Value> {
        let mut line = String::new();
        (reader.read_line(&mut line).unwrap() > 0).then(|| serde_json::from_str(&line).unwrap())
    }

    fn frames(reader: &mut BufReader<TcpStream>) -> Vec<u64> {
        let lines = std::iter::from_fn(|| next(reader));
        lines.filter(|it| it["kind"] == "frame").map(|it| it["frame"].as_u64().unwrap()).collect()
    }

    #[test]
    fn eight_clients_get_every_line_and_one_that_goes_away_disturbs_nobody() {
        let Running { address, items, thread } = start();
        let (_, first) = connected(address);
        assert_eq!((&first["kind"], &first["box"]), (&"stream".into(), &Value::Null));
        items.send(Item::Stream(Arc::new(stream()))).unwrap();
        let mut clients: Vec<_> = (0..8)
            .map(|_| {
                loop {
                    let (client, first) = connected(address);
                    if first["box"]["device"] == "ward 3" {
                        break client;
                    }
                }
            })
            .collect();
        for number in 0..600 {
            items.send(Item::Frame(Arc::new(sample(number)))).unwrap();
            if number == 300 {
                drop(clients.pop());
            }
        }
        drop(items);
        for client in &mut clients {
            assert!(frames(client).into_iter().eq(0..600));
        }
        let said = thread.join().unwrap();
        assert!(said[0].starts_with("JSON at 127.0.0.1:") && said.len() == 1, "{said:?}");
    }

    #[test]
    fn a_client_that_does_not_read_loses_the_oldest_frames_and_is_told_how_many() {
        const FRAMES: u64 = 30_000;
        let Running { address, items, thread } = start();
        let (mut slow, _) = connected(address);
        let (mut quick, _) = connected(address);
        items.send(Item::Stream(Arc::new(stream()))).unwrap();
        // As fast as the quick one reads, which is far faster than a camera.
        for number in 0..FRAMES {
            items.send(Item::Frame(Arc::new(sample(number as u32)))).unwrap();
            if number % 500 == 499 {
                let mut frame = || next(&mut quick).unwrap()["frame"].as_u64();
                let wanted = number - 499..=number;
                let found: Vec<u64> =
                    std::iter::from_fn(|| Some(frame())).flatten().take(500).collect();
                assert!(found.into_iter().eq(wanted));
            }
        }
        let mut lines = Vec::new();
        while lines.last().is_none_or(|it: &Value| it["frame"] != FRAMES - 1) {
            lines.push(next(&mut slow).unwrap());
        }
        let of = |kind: &str| lines.iter().filter(|it| it["kind"] == kind).collect::<Vec<_>>();
        assert_eq!(of("stream").len(), 1);
        let told: u64 = of("dropped").iter().map(|it| it["lines"].as_u64().unwrap()).sum();
        assert!(told > 0);
        assert_eq!(of("frame").len() as u64 + told, FRAMES);
        let numbers: Vec<u64> =
            of("frame").iter().map(|it| it["frame"].as_u64().unwrap()).collect();
        assert!(numbers.is_sorted());
        drop(items);
        assert_eq!(next(&mut slow).unwrap()["kind"], "end");
        let said = thread.join().unwrap();
        assert!(said[1].contains(&format!("{told} lines dropped")), "{said:?}");
    }

    #[test]
    fn clients_beyond_the_limit_are_told() {
        let Running { address, items, thread } = start();
        let clients: Vec<_> = (0..CLIENTS_MAX).map(|_| connected(address)).collect();
        let (_, first) = connected(address);
        assert!(first["text"].as_str().unwrap().contains("one client too many"), "{first}");
        drop(clients);
        drop(items);
        assert!(thread.join().unwrap()[1].contains("1 client refused"));
    }
}
