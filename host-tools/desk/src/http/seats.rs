//! The connections that are open: as many as pages need, and never more.
//!
//! Whoever reaches the desk can open connections and say nothing on them, or one letter an hour. When all
//! seats are taken, the connection that has been still for the longest gives its seat to the new one: a
//! page's requests are new, and answered at once. The WebSocket of a page keeps its seat; there are at
//! most [`PAGES_MAX`](crate::wire::PAGES_MAX).

use std::future::{Future, poll_fn};
use std::io::{self, ErrorKind};
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::Instant;

use axum_server::accept::Accept;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

use crate::wire::PAGES_MAX;

/// The most connections: a browser opens six beside a page's WebSocket, and half of the pages are loaded at
/// once.
pub const CONNECTIONS_MAX: usize = PAGES_MAX + 6 * PAGES_MAX / 2;

/// The answer with which a page's WebSocket begins.
const SWITCHES: &[u8] = b"HTTP/1.1 101 ";

/// The seats of all connections.
#[derive(Debug, Default)]
pub struct Seats {
    taken: Mutex<Vec<Arc<Seat>>>,
    gave_way: AtomicU64,
}

#[derive(Debug)]
struct Seat(Mutex<Sitting>);

/// Of a connection.
#[derive(Debug)]
struct Sitting {
    /// When it was opened, or something was answered last.
    still_since: Instant,
    keeps: bool,
    has_to_go: bool,
    waker: Option<Waker>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is in them is whole after every statement.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Seats {
    /// The connections that had to give way.
    pub fn gave_way(&self) -> u64 {
        self.gave_way.load(Ordering::Relaxed)
    }

    /// A seat; `None` if nobody gives way.
    fn take(self: &Arc<Self>) -> Option<Taken> {
        let mut taken = locked(&self.taken);
        if taken.len() >= CONNECTIONS_MAX {
            self.gave_way.fetch_add(1, Ordering::Relaxed);
            let stillest = taken.iter().enumerate().filter_map(|(at, seat)| {
                let sitting = locked(&seat.0);
                (!sitting.keeps).then_some((sitting.still_since, at))
            });
            let (_, at) = stillest.min()?;
            taken.swap_remove(at).has_to_go();
        }
        let sitting =
            Sitting { still_since: Instant::now(), keeps: false, has_to_go: false, waker: None };
        let seat = Arc::new(Seat(Mutex::new(sitting)));
        taken.push(Arc::clone(&seat));
        Some(Taken { seat, seats: Arc::clone(self) })
    }
}

impl Seat {
    fn has_to_go(&self) {
        let mut sitting = locked(&self.0);
        sitting.has_to_go = true;
        let waker = sitting.waker.take();
        drop(sitting);
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    /// Ready once the connection has to give way.
    fn poll_gone(&self, context: &Context<'_>) -> Poll<()> {
        let mut sitting = locked(&self.0);
        if sitting.has_to_go {
            return Poll::Ready(());
        }
        sitting.waker = Some(context.waker().clone());
        Poll::Pending
    }

    /// Something is answered.
    fn answers(&self, bytes: &[u8]) {
        let mut sitting = locked(&self.0);
        sitting.still_since = Instant::now();
        sitting.keeps |= bytes.starts_with(SWITCHES);
    }
}

/// A seat that is taken, until this is dropped.
#[derive(Debug)]
struct Taken {
    seat: Arc<Seat>,
    seats: Arc<Seats>,
}

impl Drop for Taken {
    fn drop(&mut self) {
        locked(&self.seats.taken).retain(|it| !Arc::ptr_eq(it, &self.seat));
    }
}

/// Gives each connection a seat, from before its handshake on.
#[derive(Debug, Clone)]
pub struct Seated<A> {
    inner: A,
    seats: Arc<Seats>,
}

impl<A> Seated<A> {
    /// Of these seats.
    pub fn new(inner: A, seats: Arc<Seats>) -> Self {
        Self { inner, seats }
    }
}

impl<A, S> Accept<TcpStream, S> for Seated<A>
where
    A: Accept<TcpStream, S>,
    A::Future: Send + 'static,
    A::Stream: Send,
    A::Service: Send,
{
    type Stream = Held<A::Stream>;
    type Service = A::Service;
    type Future = Pin<Box<dyn Future<Output = io::Result<(Self::Stream, A::Service)>> + Send>>;

    fn accept(&self, stream: TcpStream, service: S) -> Self::Future {
        let taken = self.seats.take();
        let accepts = self.inner.accept(stream, service);
        Box::pin(async move {
            let taken = taken.ok_or(ErrorKind::ConnectionRefused)?;
            let (inner, service) = tokio::select! {
                accepted = accepts => accepted?,
                () = poll_fn(|context| taken.seat.poll_gone(context)) => {
                    return Err(ErrorKind::ConnectionAborted.into());
                }
            };
            Ok((Held { inner, taken }, service))
        })
    }
}

/// A connection with its seat: it ends when it has to give way.
#[derive(Debug)]
pub struct Held<S> {
    inner: S,
    taken: Taken,
}

impl<S: AsyncRead + Unpin> AsyncRead for Held<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.taken.seat.poll_gone(context).is_ready() {
            return Poll::Ready(Err(ErrorKind::ConnectionAborted.into()));
        }
        Pin::new(&mut self.inner).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Held<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.taken.seat.answers(bytes);
        Pin::new(&mut self.inner).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stillest_gives_way_and_a_page_keeps_its_seat() {
        let seats = Arc::<Seats>::default();
        let mut taken: Vec<_> = (0..CONNECTIONS_MAX).map(|_| seats.take().unwrap()).collect();
        taken[0].seat.answers(b"HTTP/1.1 101 Switching Protocols\r\n");
        taken[1].seat.answers(b"HTTP/1.1 200 OK\r\n");
        let has_to_go = |it: &Taken| locked(&it.seat.0).has_to_go;
        let more = [(); 3].map(|()| seats.take().unwrap());
        assert_eq!(taken.iter().filter(|it| has_to_go(it)).count(), 3);
        assert!(taken[2..5].iter().all(has_to_go) && !more.iter().any(has_to_go));
        assert_eq!(seats.gave_way(), 3);
        // Those that are closed leave room.
        taken.truncate(CONNECTIONS_MAX / 2);
        assert_eq!(locked(&seats.taken).len(), CONNECTIONS_MAX / 2);
        let _next = seats.take().unwrap();
        assert_eq!(seats.gave_way(), 3);
        // Where all keep their seats, nobody is let in.
        taken.extend(std::iter::from_fn(|| {
            let room = locked(&seats.taken).len() < CONNECTIONS_MAX;
            room.then(|| seats.take().unwrap())
        }));
        let pages: Vec<_> = locked(&seats.taken).clone();
        pages.iter().for_each(|it| it.answers(SWITCHES));
        assert!(seats.take().is_none());
    }
}
