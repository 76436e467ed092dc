//! The connection to the broker: MQTT 5, over TLS unless it is told otherwise.
//!
//! Each connection is a new client with a clean start, and [`Outbox`] knows what has to be sent again:
//! what a client of rumqttc remembers of a connection is not relied on.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline_files::BadInput;
use rumqttc::v5::mqttbytes::Error;
use rumqttc::v5::mqttbytes::QoS;
use rumqttc::v5::mqttbytes::v5::{ConnectReturnCode, LastWill, Packet, PubAckReason};
use rumqttc::v5::{AsyncClient, ConnectionError, Event, MqttOptions, StateError};
use rumqttc::{Outgoing, TlsConfiguration, Transport};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use rustls::{ClientConfig, RootCertStore};
use zeroize::Zeroizing;

use crate::commands::{self, Asked};
use crate::notices::Notices;
use crate::outbox::{Outbox, WINDOW};
use crate::topics::Topics;

/// The port of brokers with TLS.
pub const PORT: u16 = 8883;

/// The port of brokers without TLS.
pub const PORT_PLAIN: u16 = 1883;

/// A broker that is silent for twice this is not there.
const KEEP_ALIVE: Duration = Duration::from_secs(10);

/// The first wait before a connection is tried again; each further one is twice as long.
const AGAIN_AFTER: Duration = Duration::from_millis(500);

/// A connection that lasted so long was a good one: the waits begin anew. One that ends sooner may well
/// end so again.
const STEADY: Duration = Duration::from_secs(5);

/// No wait is longer.
const AGAIN_AFTER_MAX: Duration = Duration::from_secs(30);

/// The longest message that is taken.
const INCOMING_BYTES_MAX: u32 = 16 * 1024;

/// Where the broker is, and who we are there.
#[derive(Clone)]
pub struct Settings {
    /// Its name or address.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// How the connection is secured; `None`: not at all.
    pub tls: Option<Arc<ClientConfig>>,
    /// A user and a password.
    pub user: Option<(String, Zeroizing<String>)>,
}

/// TLS to a broker whose certificate one of these authorities has signed: of a file (PEM), or without one
/// those that this computer trusts.
///
/// # Errors
/// When there is none.
pub fn tls(authorities: Option<&Path>) -> Result<Arc<ClientConfig>, BadInput> {
    let mut roots = RootCertStore::empty();
    match authorities {
        Some(path) => {
            let place = path.display().to_string();
            let text = plumbline_files::read_text(path)?;
            let found = CertificateDer::pem_slice_iter(text.as_bytes());
            for certificate in found {
                let added = certificate
                    .map_err(|error| error.to_string())
                    .and_then(|it| roots.add(it).map_err(|error| error.to_string()));
                added.map_err(|error| {
                    BadInput::whole(&place, error, "give certificates in PEM: BEGIN CERTIFICATE")
                })?;
            }
            if roots.is_empty() {
                let remedy = "give the certificate of the authority that signed the broker's";
                return Err(BadInput::whole(place, "there is no certificate in it", remedy));
            }
        }
        None => {
            roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
            if roots.is_empty() {
                return Err(BadInput::whole(
                    "TLS",
                    "this computer trusts no authority",
                    "install the system's certificates (Debian: ca-certificates), or give the broker's \
                     with --ca",
                ));
            }
        }
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| BadInput::whole("TLS", error, "report it"))?;
    Ok(Arc::new(config.with_root_certificates(roots).with_no_client_auth()))
}

/// What the thread of the connection has.
pub(crate) struct Courier {
    pub settings: Settings,
    pub client_id: String,
    pub topics: Topics,
    /// What is published for the gateway when its connection breaks.
    pub will: String,
    pub outbox: Arc<Outbox>,
    pub notices: Arc<Notices>,
    /// To whoever carries out commands, if they are taken.
    pub asked: Option<SyncSender<Asked>>,
    pub stop: Arc<AtomicBool>,
}

impl Courier {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system gives none.
    pub fn start(self) -> Result<JoinHandle<()>, BadInput> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|error| BadInput::io("the connection to the broker", &error))?;
        std::thread::Builder::new()
            .name("broker".to_owned())
            .spawn(move || runtime.block_on(self.run()))
            .map_err(|error| BadInput::io("a thread for the broker", &error))
    }

    fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn options(&self) -> MqttOptions {
        let Settings { host, port, tls, user } = &self.settings;
        let mut options = MqttOptions::new(&self.client_id, host, *port);
        if let Some(tls) = tls {
            options.set_transport(Transport::Tls(TlsConfiguration::Rustls(Arc::clone(tls))));
        }
        if let Some((user, password)) = user {
            options.set_credentials(user, password.as_str());
        }
        let topic = self.topics.gateway_state();
        let will = LastWill::new(topic, self.will.clone(), QoS::AtLeastOnce, true, None);
        options.set_last_will(will);
        options.set_keep_alive(KEEP_ALIVE);
        options.set_clean_start(true);
        options.set_max_packet_size(Some(INCOMING_BYTES_MAX));
        options.set_outgoing_inflight_upper_limit(WINDOW);
        options
    }

    async fn run(self) {
        let mut wait = AGAIN_AFTER;
        let mut told = None;
        while !self.is_over() {
            // Room for the subscription, too.
            let (client, mut connection) =
                AsyncClient::new(self.options(), usize::from(WINDOW) + 2);
            let mut since = None;
            let why = loop {
                match connection.poll().await {
                    Ok(event) => {
                        if let Event::Incoming(Packet::ConnAck(_)) = event {
                            since = Some(Instant::now());
                            told = None;
                            let commands = self.asked.as_ref().map(|_| self.topics.commands());
                            self.outbox.up(client.clone(), commands);
                            self.notices.say("the broker is there");
                        } else {
                            self.take(event);
                        }
                    }
                    Err(error) => break words(&error, &self.settings),
                }
            };
            self.outbox.down(why.clone());
            if self.is_over() {
                return;
            }
            if told.as_ref() != Some(&why) {
                let Settings { host, port, .. } = &self.settings;
                self.notices
                    .say(format!("warning: no connection to the broker at {host}:{port}: {why}"));
                told = Some(why);
            }
            if since.is_some_and(|since: Instant| since.elapsed() >= STEADY) {
                wait = AGAIN_AFTER;
            }
            self.pause(wait).await;
            wait = (2 * wait).min(AGAIN_AFTER_MAX);
        }
    }

    /// Waits for this time, or up to a quarter less: gateways that lost one broker come back one after the
    /// other.
    async fn pause(&self, wait: Duration) {
        const SLICE: Duration = Duration::from_millis(100);
        let mut byte = [0];
        let _ = getrandom::fill(&mut byte);
        let mut left = wait.mul_f64(1.0 - 0.25 * f64::from(byte[0]) / 256.0);
        while !self.is_over() && !left.is_zero() {
            let slice = left.min(SLICE);
            tokio::time::sleep(slice).await;
            left -= slice;
        }
    }

    fn take(&self, event: Event) {
        match event {
            Event::Outgoing(Outgoing::Publish(number)) => self.outbox.numbered(number),
            Event::Incoming(Packet::PubAck(ack)) => {
                let is_taken = matches!(
                    ack.reason,
                    PubAckReason::Success | PubAckReason::NoMatchingSubscribers
                );
                let refusal = (!is_taken).then(|| format!("{:?}", ack.reason));
                self.outbox.acknowledged(ack.pkid, refusal);
            }
            Event::Incoming(Packet::Publish(publish)) => self.command(&publish),
            Event::Incoming(Packet::SubAck(ack)) => {
                use rumqttc::v5::mqttbytes::v5::SubscribeReasonCode::Success;
                for code in ack.return_codes.iter().filter(|it| !matches!(it, Success(_))) {
                    self.notices.say(format!(
                        "warning: the broker passes no commands on ({code:?}): check what its ACL lets \
                         this user read"
                    ));
                }
            }
            _ => {}
        }
    }

    fn command(&self, publish: &rumqttc::v5::mqttbytes::v5::Publish) {
        let Some(sender) = &self.asked else { return };
        match commands::read(publish, &self.topics) {
            Ok(asked) => {
                if let Err(TrySendError::Full(asked)) = sender.try_send(asked) {
                    asked.refuse(&self.outbox, "too many commands wait", "try again in a second");
                    self.notices.say("warning: a command was refused: too many wait");
                }
            }
            Err(refused) => {
                self.notices.say(format!("warning: a command was refused: {}", refused.found));
                refused.answer(&self.outbox);
            }
        }
    }
}

/// Why there is no connection, and what to do.
fn words(error: &ConnectionError, settings: &Settings) -> String {
    match error {
        ConnectionError::ConnectionRefused(
            ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized,
        ) => "it does not know this user with this password: see --user and --password-file"
            .to_owned(),
        ConnectionError::Tls(error) => {
            format!("{error}: compare the broker's certificate, its names and --ca")
        }
        ConnectionError::Timeout(_) => "it does not answer in time".to_owned(),
        ConnectionError::Io(error) if settings.tls.is_some() => format!(
            "{error} (with TLS; a broker without it needs --plain, which anybody can read and forge)"
        ),
        ConnectionError::MqttState(
            StateError::Io(error) | StateError::Deserialization(Error::Io(error)),
        ) => format!("it has ended: {error}; the broker's log may say why"),
        ConnectionError::MqttState(StateError::ConnectionAborted) => {
            "the broker has ended it; its log may say why".to_owned()
        }
        ConnectionError::MqttState(StateError::AwaitPingResp) => {
            "the broker does not answer any more".to_owned()
        }
        error => error.to_string(),
    }
}
