//! A desk for other computers: TLS alone, a password, and few guesses.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use nix::pty::{OpenptyResult, openpty};
use nix::sys::termios::{LocalFlags, tcgetattr};
use plumbline_test_support::{command, free_port};
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::ring;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::{ClientConfig, ClientConnection, DigitallySignedStruct, SignatureScheme, StreamOwned};
use serde_json::{Value, json};

use super::client::{Answer, connect, exchange};
use crate::stand::{PATIENCE, Stand};

const PASSWORD: &str = "correct horse battery";

/// Whoever knows the certificate by its fingerprint, as a person who has compared it does.
#[derive(Debug)]
struct Known(String);

impl ServerCertVerifier for Known {
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        use sha2::Digest as _;
        let digest = sha2::Sha256::digest(certificate.as_ref());
        let shown: Vec<String> = digest.iter().map(|byte| format!("{byte:02X}")).collect();
        assert_eq!(shown.join(":"), self.0, "the fingerprint that was printed");
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = ring::default_provider().signature_verification_algorithms;
        rustls::crypto::verify_tls12_signature(message, certificate, signature, &algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = ring::default_provider().signature_verification_algorithms;
        rustls::crypto::verify_tls13_signature(message, certificate, signature, &algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        ring::default_provider().signature_verification_algorithms.supported_schemes()
    }
}

/// A computer that has compared the fingerprint.
struct Other {
    port: u16,
    config: Arc<ClientConfig>,
}

impl Other {
    fn new(port: u16, fingerprint: &str) -> Self {
        let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .dangerous()
            .with_custom_certificate_verifier(Arc::new(Known(fingerprint.to_owned())))
            .with_no_client_auth();
        Self { port, config: Arc::new(config) }
    }

    fn stream(&self) -> StreamOwned<ClientConnection, TcpStream> {
        let name = ServerName::try_from("127.0.0.1").unwrap();
        let connection = ClientConnection::new(Arc::clone(&self.config), name).unwrap();
        StreamOwned::new(connection, connect(self.port))
    }

    fn ask(&self, method: &str, path: &str, cookie: &str, body: &[u8]) -> Answer {
        let head = [
            format!("{method} {path} HTTP/1.1"),
            format!("Host: 127.0.0.1:{}", self.port),
            format!("Origin: https://127.0.0.1:{}", self.port),
            format!("Cookie: {cookie}"),
            "Content-Type: application/json".to_owned(),
            format!("Content-Length: {}", body.len()),
            "Connection: close".to_owned(),
        ];
        exchange(self.stream(), &head, body)
    }

    fn login(&self, password: &str) -> Answer {
        let body: Value = json!({ "password": password });
        self.ask("POST", "/api/login", "", body.to_string().as_bytes())
    }
}

#[test]
fn others_need_tls_and_the_password() {
    let Some(stand) = Stand::new() else { return };
    stand.ready_box("PL-0001");
    let port = free_port();
    let listen = format!("--listen 127.0.0.1:{port}");
    let with = |file: &str| format!("{listen} --password-file {file}");
    // Without a password, or with one that is none, there is no desk.
    let mut refused = stand.plumb(&format!("desk --folder desk {listen}"));
    let output = refused.stdin(std::process::Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("no password"), "{said}");
    std::fs::write(stand.path("short.txt"), "1234\n").unwrap();
    let output = stand.plumb(&format!("desk --folder desk {}", with("short.txt"))).output();
    assert_eq!(output.unwrap().status.code(), Some(2));

    std::fs::write(stand.path("password.txt"), format!("{PASSWORD}\n")).unwrap();
    let desk = stand.desk_with(&with("password.txt"));
    assert!(desk.url.starts_with("https://") && !desk.url.contains("token"), "{}", desk.url);
    let said = desk.said();
    let (_, fingerprint) = said.split_once("(SHA-256): ").unwrap();
    let fingerprint = fingerprint.lines().next().unwrap().to_owned();
    let other = Other::new(port, &fingerprint);
    let hello = other.ask("GET", "/api/hello", "", &[]).json();
    assert_eq!((&hello["signed_in"], &hello["sign_in"]), (&json!(false), &json!("password")));
    assert_eq!(other.ask("GET", "/api/state", "", &[]).status, 401);
    // A token does not sign in here.
    assert!(other.ask("GET", "/?token=0", "", &[]).header("set-cookie").is_none());
    let answer = other.login(PASSWORD);
    let cookie = answer.header("set-cookie").unwrap().to_owned();
    assert!(cookie.contains("; Secure") && cookie.contains("HttpOnly"), "{cookie}");
    let cookie = cookie.split(';').next().unwrap();
    assert_eq!(other.ask("GET", "/api/state", cookie, &[]).status, 200);
    // A new box can be made there; its key does not leave the computer.
    let form = other.ask("GET", "/api/new-box", cookie, &[]).json();
    let mut fields = form["settings"]["fields"].clone();
    fields["device"] = json!("ward 9");
    fields["serial_number"] = json!("PL-0009");
    let asked = json!({ "settings": { "fields": fields }, "size_px": form["size_px"] });
    let made = other.ask("POST", "/api/new-box", cookie, asked.to_string().as_bytes());
    assert_eq!(made.status, 200, "{}", made.text());
    let card = format!("/api/boxes/{}/card", made.json()["id"].as_str().unwrap());
    let file = |name: &str| other.ask("POST", &format!("{card}/{name}"), cookie, b"{}");
    assert_eq!(file("config.plb").status, 200);
    let key = file("box.key");
    assert!(
        key.status == 403 && key.text().contains("no key goes over a network"),
        "{}",
        key.text()
    );
    assert_eq!(other.ask("POST", "/api/logout", cookie, b"{}").status, 200);
    assert_eq!(other.ask("GET", "/api/state", cookie, &[]).status, 401, "the cookie is void");

    // Guesses are bounded, whatever comes then.
    let guesses: Vec<u16> =
        (0..8).map(|at| other.login(&format!("wrong password {at}")).status).collect();
    assert_eq!(guesses, [401, 401, 401, 401, 401, 429, 429, 429]);
    assert_eq!(other.login(PASSWORD).status, 429);

    // Nothing is said in clear.
    let head = ["GET /api/hello HTTP/1.1".to_owned(), format!("Host: 127.0.0.1:{port}")];
    let plain = std::panic::catch_unwind(|| exchange(connect(port), &head, &[]));
    assert!(plain.is_err() || plain.is_ok_and(|it| it.status == 400));

    // The certificate is the same in the next run.
    desk.interrupt();
    let desk = stand.desk_with(&with("password.txt"));
    assert!(desk.said().contains(&fingerprint), "{}", desk.said());
    desk.interrupt();
}

/// A terminal, and a desk for others in it that asks for its password.
struct Typed {
    terminal: OpenptyResult,
    child: Child,
}

impl Typed {
    fn start(stand: &Stand, listen: &str) -> Self {
        let terminal = openpty(None, None).unwrap();
        let plumb = stand.plumb(&format!("desk --folder desk {listen} --no-browser"));
        // In a session of its own, so that Ctrl-C reaches it and nobody else.
        let mut command = command("setsid");
        command.arg("--ctty").arg(plumb.get_program()).args(plumb.get_args());
        command.envs(plumb.get_envs().filter_map(|(name, value)| Some((name, value?))));
        command.current_dir(plumb.get_current_dir().unwrap());
        let end = || Stdio::from(terminal.slave.try_clone().unwrap());
        let child = command.stdin(end()).stdout(end()).stderr(end()).spawn().unwrap();
        let mut typed = Self { terminal, child };
        typed.reads_until("a password for the desk");
        // It is asked for once nothing is shown.
        let give_up = Instant::now() + PATIENCE;
        while typed.shows() {
            assert!(Instant::now() < give_up, "what is typed is shown");
            std::thread::sleep(Duration::from_millis(10));
        }
        typed
    }

    /// Whether the terminal shows what is typed.
    fn shows(&self) -> bool {
        let settings = tcgetattr(&self.terminal.master).unwrap();
        settings.local_flags.contains(LocalFlags::ECHO | LocalFlags::ISIG)
    }

    fn types(&self, text: &str) {
        let master = File::from(self.terminal.master.try_clone().unwrap());
        (&master).write_all(text.as_bytes()).unwrap();
    }

    /// What the terminal has shown once these words are there.
    #[track_caller]
    fn reads_until(&mut self, words: &str) -> String {
        let master = File::from(self.terminal.master.try_clone().unwrap());
        let mut shown = Vec::new();
        let give_up = Instant::now() + PATIENCE;
        loop {
            let mut bytes = [0; 1024];
            let length = (&master).read(&mut bytes).unwrap();
            shown.extend_from_slice(&bytes[..length]);
            let text = String::from_utf8_lossy(&shown).into_owned();
            if text.contains(words) {
                return text;
            }
            assert!(Instant::now() < give_up, "{text}");
        }
    }
}

impl Drop for Typed {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_typed_password_is_not_shown_and_the_terminal_is_left_as_it_was() {
    let Some(stand) = Stand::new() else { return };
    let port = free_port();
    let listen = format!("--listen 127.0.0.1:{port}");
    let mut typed = Typed::start(&stand, &listen);
    typed.types(&format!("{PASSWORD}\n"));
    let said = typed.reads_until("Ctrl-C ends it");
    assert!(!said.contains("correct") && typed.shows(), "{said}");
    let (_, fingerprint) = said.split_once("(SHA-256): ").unwrap();
    let other = Other::new(port, fingerprint.lines().next().unwrap().trim());
    assert_eq!(other.login("another password").status, 401);
    assert_eq!(other.login(PASSWORD).status, 200);
    typed.types("\x03");
    assert!(typed.child.wait().unwrap().success(), "Ctrl-C ends the desk");

    // Whoever thinks better of it gets back a terminal that shows what is typed.
    let mut typed = Typed::start(&stand, &listen);
    typed.types("half a passw\x03");
    assert!(!typed.child.wait().unwrap().success());
    assert!(typed.shows(), "the terminal shows nothing any more");
}
