//! The link to the box is opened, and the box is met: who it is, what it runs with, what it needs next.

use std::net::{Ipv4Addr, SocketAddr};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use plumbline::config::Config;
use plumbline::packet::Hello;
use plumbline_bedside::box_settings::BoxSettings;
use plumbline_bedside::link::{Carried, Way};
use plumbline_files::{BadInput, camera};
use plumbline_publish::Tapped;
use plumbline_stream::link::{BoxLink, Introduction};
use plumbline_stream::transport::Udp;
use plumbline_trial::body::Body;

use super::can::Stage;
use super::{LISTEN, Next, Reach, Worker, show};
use crate::settings;
use crate::wire::{HelloState, LinkState, NextStep, Problem, TargetState};

/// A box is called for this long before another place is tried, milliseconds.
const TRIED_MS: f64 = 2000.0;

impl Worker {
    /// Opens the link to where the box was heard last, and to where it announces itself from then on.
    pub(super) fn open(&mut self) -> Result<BoxLink, BadInput> {
        let shared = Arc::clone(&self.shared);
        let warn = move |warning: &str| shared.notice(true, warning);
        let program = &self.around.program;
        self.called_at = self.shared.announced();
        let link = match &self.reach {
            // The port at which boxes announce themselves is the porter's.
            Reach::Udp(id) => {
                let any = SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0));
                let udp = Udp::bind(any)?.hearing(self.shared.announcements());
                let (carried, called) = (Carried::Udp(Some(any)), Some(id.clone()));
                let way = Way { carried, called, at: self.called_at };
                way.open_through(udp, &format!("UDP {any}"), program, warn)?
            }
            Reach::Serial { device, baud } => {
                let carried = Carried::Serial { device: device.clone(), baud: *baud };
                Way { carried, called: None, at: None }.open(program, false, warn)?
            }
        };
        Ok(self.tapped(link))
    }

    /// The same link, whose packets are published.
    fn tapped(&self, link: BoxLink) -> BoxLink {
        let kind = link.kind();
        let place = self.place(link.place());
        let Some(publisher) = &self.publisher else { return link };
        let transport = Tapped::new(link.into_transport(), Rc::clone(publisher));
        BoxLink::new(Box::new(transport), place, kind)
    }

    /// What the link is called in messages.
    fn place(&self, place: &str) -> String {
        match &self.reach {
            Reach::Udp(_) => self.shared.state().name,
            Reach::Serial { .. } => place.to_owned(),
        }
    }

    /// Waits for the box, and asks who it is and what it runs with.
    pub(super) fn meet(&mut self, mut link: BoxLink) -> Result<(BoxLink, Next), BadInput> {
        self.enter(Stage::Away);
        let since_at_ms = self.shared.hub.now_ms();
        while link.messages(Instant::now() + LISTEN, |_| Some(()))?.is_none() {
            self.beat();
            let (found, remedy) = link.obstacle().unwrap_or_else(|| {
                let remedy = match self.reach {
                    Reach::Udp(_) => {
                        "check that it is on, and that it sends to this computer's address and port"
                    }
                    Reach::Serial { .. } => "check that it is on, the cable and the line's rate",
                };
                ("nothing is heard of this box".to_owned(), remedy.to_owned())
            });
            let problem = Problem::new(link.place(), found, remedy);
            self.shared.update(|state| {
                state.link = LinkState::Searching { since_at_ms, problem };
            });
            let is_tried = self.shared.hub.now_ms() - since_at_ms >= TRIED_MS;
            if self.is_over() || (is_tried && self.has_moved()) || self.is_first_heard() {
                return Ok((link, Next::Reopen));
            }
        }
        let hello = match link.introduction()? {
            Introduction::Hello(hello) => hello,
            Introduction::Refusing(text) => {
                return Err(BadInput::whole(
                    link.place(),
                    format!("the box tracks nothing; it says: {text}"),
                    "send it a configuration with `plumb provision --send`",
                ));
            }
        };
        let config = link.config()?;
        self.met(hello, config);
        Ok((link, Next::Watch))
    }

    /// Whether the box announces itself, and nothing was known of where it is.
    fn is_first_heard(&self) -> bool {
        self.called_at.is_none() && self.shared.announced().is_some()
    }

    /// Whether the box announces itself from elsewhere than where it was called.
    pub(super) fn has_moved(&self) -> bool {
        let announced = self.shared.announced();
        announced.is_some() && announced != self.called_at
    }

    /// Shows who the box is.
    fn met(&mut self, hello: Hello, config: Config) {
        self.shared.frames.set_body(Body::of(&config));
        let is_calibrated = !camera::is_stand_in(&config.lens);
        let has_scene = config.cam_from_scene_theta.is_some();
        let (next_step, next) = match (is_calibrated, has_scene) {
            (false, _) => (
                NextStep::Calibrate,
                "Aim the camera, and calibrate it with photographs of the board.",
            ),
            (true, false) => (
                NextStep::Scene,
                "Set up the board where the person will stand, and measure the scene.",
            ),
            (true, true) => (NextStep::Session, "The box is ready: begin a session."),
        };
        let targets = hello.targets.iter().map(|it| TargetState {
            name: it.name.to_string(),
            role: show::role(it.role).to_owned(),
            corners: it.corners,
        });
        let shown = HelloState {
            device: hello.device.to_string(),
            serial_number: hello.serial_number.to_string(),
            firmware: hello.firmware.to_string(),
            configuration: format!("{:08x}", hello.config_crc),
            size_px: [hello.width_px, hello.height_px],
            asked_hz: config.capture.as_ref().map(|it| f64::from(it.rate_hz)),
            targets: targets.collect(),
            is_calibrated: Some(is_calibrated),
            has_scene: Some(has_scene),
            next: next.to_owned(),
            next_step,
        };
        let by = self.heard_by();
        self.shared.set_settings(settings::view(&BoxSettings::of(&config)));
        self.shared.show_card(false);
        self.shared.update(|state| {
            state.name = hello.device.to_string();
            state.serial_number = Some(hello.serial_number.to_string());
            state.hello = Some(shown);
            state.link = LinkState::Heard { by };
        });
        if self.hello.as_ref().map(|it| it.boot_id) != Some(hello.boot_id) {
            self.refer();
        }
        self.hello = Some(hello);
        self.config = Some(config);
    }

    /// How the box is heard.
    pub(super) fn heard_by(&self) -> String {
        match (&self.reach, self.shared.announced()) {
            (Reach::Serial { device, .. }, _) => device.clone(),
            (Reach::Udp(_), Some(address)) => format!("UDP {address}"),
            (Reach::Udp(_), None) => "UDP".to_owned(),
        }
    }
}
