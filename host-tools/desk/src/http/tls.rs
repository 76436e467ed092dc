//! TLS for a desk that others reach: a certificate that is given, or the desk's own, which is made once
//! and kept in this user's data, so that browsers know it again.

use std::path::Path;
use std::sync::Arc;

use axum_server::tls_rustls::RustlsConfig;
use plumbline_bedside::kept;
use plumbline_files::BadInput;
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use sha2::{Digest as _, Sha256};

/// The desk's own certificate, and its key.
const CERTIFICATE: &str = "certificate.pem";
const KEY: &str = "certificate-key.pem";

/// What a server needs.
pub struct Tls {
    /// The configuration.
    pub config: RustlsConfig,
    /// The SHA-256 of the certificate, as browsers show it.
    pub fingerprint: Option<String>,
}

/// With a certificate and a key of these files.
///
/// # Errors
/// When they cannot be read or do not belong together.
pub fn given(certificate: &Path, key: &Path) -> Result<Tls, BadInput> {
    let certificate_text = plumbline_files::read_text(certificate)?;
    let key_text = plumbline_files::read_text(key)?;
    of(&certificate_text, &key_text, &certificate.display().to_string())
}

/// With the desk's own certificate, which is made where there is none for these names.
///
/// # Errors
/// When it cannot be made, read or kept.
pub fn own(names: &[String]) -> Result<Tls, BadInput> {
    let folder = kept::folder("desk")?;
    // One for other names is another one.
    let digest = Sha256::digest(names.join(" ").as_bytes());
    let folder = folder
        .join(format!("{:02x}{:02x}{:02x}{:02x}", digest[0], digest[1], digest[2], digest[3]));
    let (certificate, key) = (folder.join(CERTIFICATE), folder.join(KEY));
    if !certificate.exists() || !key.exists() {
        plumbline_files::make_directory(&folder)?;
        let failed = |error: rcgen::Error| {
            BadInput::whole(
                "the desk's certificate",
                error,
                "give one with --certificate and --key",
            )
        };
        let made = rcgen::generate_simple_self_signed(names.to_vec()).map_err(failed)?;
        plumbline_files::replace(&key, made.signing_key.serialize_pem().as_bytes())?;
        plumbline_files::replace(&certificate, made.cert.pem().as_bytes())?;
    }
    given(&certificate, &key)
}

fn of(certificate: &str, key: &str, place: &str) -> Result<Tls, BadInput> {
    let failed = |found: String| {
        let remedy = "give PEM files: the certificate with those above it, and its private key";
        BadInput::whole(place, found, remedy)
    };
    let chain: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(certificate.as_bytes()).collect();
    let chain = chain.map_err(|error| failed(error.to_string()))?;
    let fingerprint = chain.first().map(|it| {
        let pairs = Sha256::digest(it.as_ref())
            .iter()
            .map(|byte| format!("{byte:02X}"))
            .collect::<Vec<_>>();
        pairs.join(":")
    });
    let key =
        PrivateKeyDer::from_pem_slice(key.as_bytes()).map_err(|error| failed(error.to_string()))?;
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| failed(error.to_string()))?
        .with_no_client_auth()
        .with_single_cert(chain, key)
        .map_err(|error| failed(error.to_string()))?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(Tls { config: RustlsConfig::from_config(Arc::new(config)), fingerprint })
}
