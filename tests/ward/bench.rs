//! A folder with the keys of a ward's boxes, and the gateway.

use std::fs::File;
use std::io::Read as _;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use common::keys;
use plumbline_test_support::{command, free_address, program};
use tempfile::TempDir;

use crate::boxes::{key, serial_number};
use crate::broker::{Broker, password};

/// A test that waits this long has failed.
pub const PATIENCE: Duration = Duration::from_secs(60);

fn plumb() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| program("plumb").expect("plumb builds"))
}

#[track_caller]
pub fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let give_up = Instant::now() + PATIENCE;
    while !is_so() {
        assert!(Instant::now() < give_up, "{what}: not within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Sends a signal to a child of this program.
pub fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
}

/// A folder, a broker, and the port of the gateway.
pub struct Bench {
    folder: TempDir,
    pub broker: Broker,
    pub host: SocketAddr,
}

impl Bench {
    /// With the keys of so many boxes; `None` where there is no broker.
    pub fn new(boxes: usize) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let broker = Broker::start(folder.path())?;
        let host = free_address();
        for number in 0..boxes {
            keys::know(folder.path(), &key(number));
            let file =
                keys::data(folder.path()).join(format!("plumbline/keys/{}.toml", key(number).id()));
            let text = std::fs::read_to_string(&file).unwrap();
            let serial_number = serial_number(number);
            std::fs::write(&file, format!("{text}serial_number = \"{serial_number}\"\n")).unwrap();
            std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
        }
        std::fs::write(folder.path().join("gateway.txt"), password("gateway") + "\n").unwrap();
        std::fs::write(folder.path().join("narrow.txt"), password("narrow") + "\n").unwrap();
        Some(Self { folder, broker, host })
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The gateway, connected as it should be.
    pub fn gateway(&self, arguments: &str) -> Running {
        self.gateway_as("gateway", "broker/ca.pem", arguments)
    }

    /// The gateway of another user, or with another authority.
    pub fn gateway_as(&self, user: &str, ca: &str, arguments: &str) -> Running {
        let (host, port) = (self.host, self.broker.port);
        let common = format!(
            "gateway --broker localhost:{port} --user {user} --password-file {user}.txt --ca {ca} \
             --folder ward --udp {host} {arguments}"
        );
        let common = if arguments.contains("--every") { common } else { common + " --every 1" };
        let said = self.path("gateway-said.txt");
        let file = File::options().create(true).append(true).open(&said).unwrap();
        let mut command = command(plumb());
        command.args(common.split_whitespace()).current_dir(self.folder.path());
        command.env("XDG_DATA_HOME", keys::data(self.folder.path()));
        command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file);
        Running { child: command.spawn().unwrap(), said }
    }

    /// The folders of a box's trials.
    pub fn trials(&self, number: usize) -> Vec<PathBuf> {
        let folder = self.path("ward/trials").join(serial_number(number));
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let mut trials: Vec<PathBuf> = entries.map(|it| it.unwrap().path()).collect();
        trials.sort();
        trials
    }
}

/// A gateway that runs.
pub struct Running {
    pub child: Child,
    said: PathBuf,
}

impl Running {
    /// What it has said.
    pub fn said(&self) -> String {
        let mut text = String::new();
        File::open(&self.said).unwrap().read_to_string(&mut text).unwrap();
        text
    }

    #[track_caller]
    pub fn wait_until_it_says(&self, part: &str) {
        let give_up = Instant::now() + PATIENCE;
        while !self.said().contains(part) {
            assert!(Instant::now() < give_up, "it does not say {part:?}:\n{}", self.said());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Ends it as Ctrl-C does; what it has said.
    #[track_caller]
    pub fn end(mut self) -> String {
        signal(&self.child, "INT");
        let status = self.child.wait().unwrap();
        let said = self.said();
        assert_eq!(status.code(), Some(0), "{said}");
        said
    }

    /// Ends it as a loss of power does.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
