//! Mosquitto, as a ward would have it: TLS, users with passwords, an ACL; and its own clients.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use plumbline_test_support::{Absent, free_port, is_emulated, skip};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};

use crate::bench::{PATIENCE, wait_for};

/// The users, and what they may do.
const USERS: [&str; 4] = ["gateway", "reader", "nurse", "narrow"];

/// The example that the gateway's documentation gives, for the ward of the tests.
const ACL: &str = include_str!("../../host-tools/gateway/mosquitto/acl");

/// A broker in a folder of its own.
pub struct Broker {
    folder: PathBuf,
    pub port: u16,
    child: Option<Child>,
}

/// The password of a user.
pub fn password(user: &str) -> String {
    format!("the password of {user}")
}

/// A program of Mosquitto's packages.
fn program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::env::split_paths(&path).chain(["/usr/sbin".into()]);
    folders.map(|it| it.join(name)).find(|it| it.exists())
}

impl Broker {
    /// A broker that has started; `None`, with the test recorded as skipped, where there is no Mosquitto.
    pub fn start(folder: &Path) -> Option<Self> {
        if is_emulated() {
            skip(Absent::Emulator, "a ward in an emulator does not keep pace with its boxes");
            return None;
        }
        let needed = ["mosquitto", "mosquitto_passwd", "mosquitto_sub", "mosquitto_rr"];
        if let Some(missing) = needed.iter().find(|it| program(it).is_none()) {
            skip(
                Absent::Tool,
                &format!("there is no {missing}: Debian's mosquitto, mosquitto-clients"),
            );
            return None;
        }
        let folder = folder.join("broker");
        std::fs::create_dir(&folder).unwrap();
        certificates(&folder);
        let passwords: String = USERS.iter().map(|it| format!("{it}:{}\n", password(it))).collect();
        std::fs::write(folder.join("passwords"), passwords).unwrap();
        let hashed = Command::new(program("mosquitto_passwd")?)
            .arg("-U")
            .arg(folder.join("passwords"))
            .status()
            .unwrap();
        assert!(hashed.success());
        std::fs::write(folder.join("acl"), ACL.replace("/north/", "/ward/") + NARROW).unwrap();
        let port = free_port();
        let mut broker = Self { folder, port, child: None };
        let here = broker.folder.display();
        let settings = format!(
            "user root\nlistener {port} 127.0.0.1\ncertfile {here}/server.pem\nkeyfile {here}/server.key\n\
             tls_version tlsv1.2\nallow_anonymous false\npassword_file {here}/passwords\n\
             acl_file {here}/acl\npersistence true\npersistence_location {here}/\n\
             autosave_on_changes true\nautosave_interval 1\nmax_queued_messages 0\n"
        );
        std::fs::write(broker.folder.join("mosquitto.conf"), settings).unwrap();
        broker.restart();
        Some(broker)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Starts it again.
    pub fn restart(&mut self) {
        let log = File::options().create(true).append(true).open(self.path("log.txt")).unwrap();
        let child = Command::new(program("mosquitto").unwrap())
            .arg("-c")
            .arg(self.path("mosquitto.conf"))
            .stdin(Stdio::null())
            .stdout(log.try_clone().unwrap())
            .stderr(log)
            .spawn()
            .unwrap();
        self.child = Some(child);
        let port = self.port;
        wait_for("the broker", || std::net::TcpStream::connect(("127.0.0.1", port)).is_ok());
    }

    /// Ends it in good order: what it keeps is on the disk.
    pub fn stop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        crate::bench::signal(&child, "TERM");
        child.wait().unwrap();
    }

    /// Ends it as a loss of power would.
    pub fn kill(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        child.kill().unwrap();
        child.wait().unwrap();
    }

    /// A client of Mosquitto with a user's name and password.
    fn client(&self, name: &str, user: &str) -> Command {
        let mut command = Command::new(program(name).unwrap());
        command.args(["-V", "5", "-h", "localhost", "-q", "1"]);
        command.args(["-p", &self.port.to_string(), "-u", user, "-P", &password(user)]);
        command.arg("--cafile").arg(self.path("ca.pem"));
        command
    }

    /// Whoever reads everything, also what is published while the broker starts again.
    pub fn reader(&self) -> Reader {
        let said = self.path("read.txt");
        let file = File::options().create(true).append(true).open(&said).unwrap();
        let mut command = self.client("mosquitto_sub", "reader");
        command.args(["-i", "reader", "-c", "-x", "3600", "-t", "plumbline/#"]);
        command.args(["-F", "%r\t%t\t%p"]).stdin(Stdio::null());
        let stop = Arc::<AtomicBool>::default();
        let is_over = Arc::clone(&stop);
        // It ends when the broker does.
        let thread = std::thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                let mut child = command.stdout(file.try_clone().unwrap()).spawn().unwrap();
                while child.try_wait().unwrap().is_none() {
                    if is_over.load(Ordering::Relaxed) {
                        child.kill().unwrap();
                    }
                    std::thread::sleep(Duration::from_millis(20));
                }
            }
        });
        Reader { stop, thread: Some(thread), said }
    }

    /// The answer to a command of a user.
    pub fn command(&self, user: &str, level: &str, payload: &str) -> String {
        let reply = format!("plumbline/1/ward/reply/{user}/{}", payload.len());
        let mut command = self.client("mosquitto_rr", user);
        command.args(["-t", &format!("plumbline/1/ward/{level}/command"), "-m", payload]);
        command.args(["-e", &reply, "-W", "10"]);
        let Output { stdout, .. } = command.output().unwrap();
        String::from_utf8(stdout).unwrap().trim().to_owned()
    }

    /// Publishes something.
    pub fn publish(&self, user: &str, topic: &str, payload: &str, options: &[&str]) {
        let mut command = self.client("mosquitto_pub", user);
        command.args(["-t", topic, "-m", payload]).args(options);
        assert!(command.status().unwrap().success());
    }

    /// What is retained, by topic.
    pub fn retained(&self) -> Vec<(String, String)> {
        let mut command = self.client("mosquitto_sub", "reader");
        command.args(["-t", "plumbline/#", "--retained-only", "-W", "2", "-F", "%t\t%p"]);
        let Output { stdout, .. } = command.output().unwrap();
        let text = String::from_utf8(stdout).unwrap();
        let line =
            |line: &str| line.split_once('\t').map(|(topic, it)| (topic.to_owned(), it.to_owned()));
        text.lines().filter_map(line).collect()
    }
}

impl Drop for Broker {
    fn drop(&mut self) {
        self.kill();
    }
}

/// May not publish the states of boxes.
const NARROW: &str = "\nuser narrow\ntopic write plumbline/1/ward/gateway/#\n\
                      topic write plumbline/1/ward/+/health\ntopic write plumbline/1/ward/+/examination\n";

/// An authority, and the broker's certificate; and another authority, that signed nothing.
fn certificates(folder: &Path) {
    let write = |name: &str, text: String| {
        File::create(folder.join(name)).unwrap().write_all(text.as_bytes()).unwrap();
    };
    let authority = |name: &str| {
        let mut params = CertificateParams::new(vec![]).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.distinguished_name.push(rcgen::DnType::CommonName, name);
        let key = KeyPair::generate().unwrap();
        let certificate = params.self_signed(&key).unwrap();
        (certificate.pem(), Issuer::new(params, key))
    };
    let (ca, issuer) = authority("a ward");
    let (other, _) = authority("somebody else");
    let names = vec!["localhost".to_owned(), "127.0.0.1".to_owned()];
    let key = KeyPair::generate().unwrap();
    let server = CertificateParams::new(names).unwrap().signed_by(&key, &issuer).unwrap();
    write("ca.pem", ca);
    write("other.pem", other);
    write("server.pem", server.pem());
    write("server.key", key.serialize_pem());
}

/// A subscriber to everything.
pub struct Reader {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    said: PathBuf,
}

/// A message that a subscriber got.
#[derive(Debug, Clone, PartialEq)]
pub struct Got {
    pub is_retained: bool,
    pub topic: String,
    pub text: String,
}

impl Got {
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.text).unwrap_or_else(|error| panic!("{self:?}: {error}"))
    }
}

impl Reader {
    /// All messages until now.
    pub fn got(&self) -> Vec<Got> {
        let text = std::fs::read_to_string(&self.said).unwrap();
        // The last line may not be whole.
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        let line = |line: &str| {
            let mut parts = line.splitn(3, '\t');
            let [retained, topic, text] = std::array::from_fn(|_| parts.next().unwrap_or_default());
            Got { is_retained: retained == "1", topic: topic.to_owned(), text: text.to_owned() }
        };
        whole.lines().map(line).collect()
    }

    /// All messages of a topic, the prefix left out.
    pub fn of(&self, topic: &str) -> Vec<Got> {
        let topic = format!("plumbline/1/ward/{topic}");
        self.got().into_iter().filter(|it| it.topic == topic).collect()
    }

    /// Waits for a message of a topic that is so.
    #[track_caller]
    pub fn wait(&self, topic: &str, is: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
        let mut found = None;
        let give_up = std::time::Instant::now() + PATIENCE;
        while found.is_none() {
            found = self.of(topic).iter().map(Got::json).find(&is);
            if std::time::Instant::now() > give_up {
                panic!("no such message of {topic}: {:?}", self.of(topic));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        found.unwrap()
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
