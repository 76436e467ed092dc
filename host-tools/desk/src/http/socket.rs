//! The WebSocket of a page: the state when it changes, frames as they come, tones when they are due.
//!
//! Each page has a task of its own, that reads what stations show and where the page is in the frames.
//! A page that takes nothing stops its own task, and nobody else's; after [`SILENT_S`] s it is
//! disconnected.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use tokio::sync::broadcast;
use tokio::time::{MissedTickBehavior, interval, timeout};

use super::App;
use super::body::Failure;
use crate::hub::Hub;
use crate::station::Shared;
use crate::wire::{
    BATCHES_MAX, FromDesk, FromPage, MESSAGE_BYTES_MAX, PAGES_MAX, Problem, SILENT_S,
};

/// Frames are sent this often.
const FRAMES_EVERY: Duration = Duration::from_millis(33);

/// The state is sent no more often than this.
const STATE_EVERY: Duration = Duration::from_millis(200);

/// Messages that cannot be understood, after which a page is disconnected.
const REFUSED_MAX: u32 = 10;

/// A place among the pages, which is free again when it is dropped.
struct Place(Arc<Hub>);

impl Place {
    fn take(hub: &Arc<Hub>) -> Option<Self> {
        let taken = hub.pages.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |pages| {
            (pages < PAGES_MAX).then_some(pages + 1)
        });
        taken.ok()?;
        hub.changed();
        Some(Self(Arc::clone(hub)))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.pages.fetch_sub(1, Ordering::Relaxed);
        self.0.changed();
    }
}

/// Opens one.
pub async fn open(State(app): State<App>, upgrade: WebSocketUpgrade) -> Response {
    let Some(place) = Place::take(&app.desk.hub) else {
        return Failure::of(
            StatusCode::SERVICE_UNAVAILABLE,
            "this page",
            format!("{PAGES_MAX} pages are open"),
            "close one of them",
        )
        .into_response();
    };
    upgrade.max_message_size(MESSAGE_BYTES_MAX).max_frame_size(MESSAGE_BYTES_MAX).on_upgrade(
        move |socket| async move {
            let page = Page { app, socket, watched: None, batch: 0, acknowledged: 0, refused: 0 };
            page.run().await;
            drop(place);
        },
    )
}

/// What a page watches, and the last frame that it has got.
struct Watched {
    box_id: String,
    shared: Arc<Shared>,
    after: u64,
}

struct Page {
    app: App,
    socket: WebSocket,
    watched: Option<Watched>,
    batch: u64,
    acknowledged: u64,
    refused: u32,
}

/// The page is gone.
struct Gone;

impl Page {
    async fn run(mut self) {
        // Whoever is gone needs no word.
        let _ = self.serve().await;
    }

    async fn serve(&mut self) -> Result<(), Gone> {
        let hub = Arc::clone(&self.app.desk.hub);
        let (mut changes, mut tones) = (hub.changes(), hub.tones());
        let mut frames = interval(FRAMES_EVERY);
        frames.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut heard = Instant::now();
        let mut is_changed = true;
        let mut shown: Option<Instant> = None;
        loop {
            tokio::select! {
                message = self.socket.recv() => {
                    heard = Instant::now();
                    match message {
                        Some(Ok(Message::Text(text))) => self.take(&text).await?,
                        Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                        Some(Ok(Message::Binary(_))) => self.refuse("it is no text").await?,
                        Some(Ok(Message::Close(_)) | Err(_)) | None => return Err(Gone),
                    }
                }
                tone = tones.recv() => match tone {
                    Ok(tone) => self.send(&tone).await?,
                    Err(broadcast::error::RecvError::Lagged(_)) => {}
                    Err(broadcast::error::RecvError::Closed) => return Err(Gone),
                },
                change = changes.changed() => {
                    change.map_err(|_| Gone)?;
                    changes.borrow_and_update();
                    is_changed = true;
                }
                _ = frames.tick() => {
                    if hub.is_over() || heard.elapsed() > Duration::from_secs(SILENT_S) {
                        return Err(Gone);
                    }
                    self.send_frames().await?;
                }
            }
            if is_changed && shown.is_none_or(|at| at.elapsed() >= STATE_EVERY) {
                is_changed = false;
                shown = Some(Instant::now());
                let state = Box::new(self.app.desk.state());
                self.send(&FromDesk::State { state }).await?;
            }
        }
    }

    async fn send(&mut self, message: &FromDesk) -> Result<(), Gone> {
        let text = serde_json::to_string(message).map_err(|_| Gone)?;
        let sent = self.socket.send(Message::Text(text.into()));
        match timeout(Duration::from_secs(SILENT_S), sent).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) | Err(_) => Err(Gone),
        }
    }

    /// Sends what this page does not have, unless too much is under way to it.
    async fn send_frames(&mut self) -> Result<(), Gone> {
        if self.batch - self.acknowledged >= BATCHES_MAX {
            return Ok(());
        }
        let Some(watched) = &mut self.watched else { return Ok(()) };
        let (frames, dropped) = watched.shared.frames.after(watched.after);
        let Some(last) = frames.last() else { return Ok(()) };
        watched.after = last.number;
        self.batch += 1;
        let message = FromDesk::Frames {
            box_id: watched.box_id.clone(),
            batch: self.batch,
            frames,
            dropped,
            reference: watched.shared.reference(),
        };
        self.send(&message).await
    }

    async fn take(&mut self, text: &str) -> Result<(), Gone> {
        match serde_json::from_str(text) {
            Ok(FromPage::Watch { box_id: None, .. }) => self.watched = None,
            Ok(FromPage::Watch { box_id: Some(box_id), after }) => {
                let Some(station) = self.app.desk.station(&box_id) else {
                    return self.refuse("there is no such box").await;
                };
                let shared = Arc::clone(&station.shared);
                let after = after.unwrap_or_else(|| shared.frames.newest());
                self.watched = Some(Watched { box_id, shared, after });
            }
            Ok(FromPage::Ack { batch, screen_ms }) => {
                if batch > self.batch {
                    return self.refuse("there was no such batch").await;
                }
                self.acknowledged = self.acknowledged.max(batch);
                if let (Some(watched), Some(screen_ms)) = (&self.watched, screen_ms) {
                    watched.shared.drawn(screen_ms);
                }
            }
            Ok(FromPage::Ping { page_ms }) => {
                let desk_ms = self.app.desk.hub.now_ms();
                self.send(&FromDesk::Pong { page_ms, desk_ms }).await?;
            }
            Err(error) => {
                let found = plumbline_files::text::printable(&error.to_string()).to_string();
                return self.refuse(&found).await;
            }
        }
        Ok(())
    }

    async fn refuse(&mut self, found: &str) -> Result<(), Gone> {
        self.refused += 1;
        if self.refused > REFUSED_MAX {
            return Err(Gone);
        }
        let problem = Problem::new("the message", found, "send what wire.rs describes");
        self.send(&FromDesk::Refused { problem }).await
    }
}
