//! What a gateway is to do.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use crate::broker;

/// Which boxes are recorded always.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Recorded {
    /// None, unless it is commanded.
    #[default]
    None,
    /// These, by their names, serial numbers or keys.
    These(Vec<String>),
    /// All of them.
    All,
}

/// What the gateway is to do.
#[derive(Clone)]
pub struct Settings {
    /// Where trials are kept, and what waits for the broker; it is made where there is none.
    pub folder: PathBuf,
    /// Where boxes announce themselves to this computer.
    pub udp: SocketAddr,
    /// What this program is called at boxes.
    pub program: String,
    /// The ward's name in topics.
    pub ward: String,
    /// The broker.
    pub broker: broker::Settings,
    /// Whether commands are taken from the broker.
    pub commands: bool,
    /// Which boxes are recorded without a command.
    pub record: Recorded,
    /// How long a trial lasts, unless a command says otherwise.
    pub lasts: Duration,
    /// Whether the names of trials are published.
    pub names: bool,
    /// Healths are published this often.
    pub every: Duration,
}
