//! A desk for other computers: TLS alone, a password, and few guesses.

use std::net::TcpStream;
use std::sync::Arc;

use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::ring;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::{ClientConfig, ClientConnection, DigitallySignedStruct, SignatureScheme, StreamOwned};
use serde_json::{Value, json};

use super::client::{Answer, connect, exchange};
use crate::stand::{Stand, free_port};

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
