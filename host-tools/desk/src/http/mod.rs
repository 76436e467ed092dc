//! The desk by HTTP: who may ask, and what is answered.
//!
//! ```text
//! a request ─▶ guard: Host, Origin, who is signed in, headers ─┬▶ assets: the page's files
//!                                                              ├▶ api: actions, studies
//!                                                              ├▶ setting_up: prints, new boxes
//!                                                              ├▶ reports
//!                                                              └▶ socket: state, frames
//! ```

mod api;
mod assets;
mod body;
mod guard;
mod password;
mod reports;
mod seats;
mod setting_up;
mod sign_in;
mod socket;
mod tls;

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{get, post};
use plumbline_files::BadInput;

use crate::desk::Desk;
use crate::wire::BODY_BYTES_MAX;

pub use password::Password;
pub use seats::CONNECTIONS_MAX;

use self::seats::{Seated, Seats};
use self::sign_in::Gate;

/// The port of the desk, unless another one is asked for or it is taken.
pub const PORT: u16 = 4270;

/// Requests that are under way are waited for no longer than this at the end.
const ENDS_WITHIN: Duration = Duration::from_secs(2);

/// A connection that has not asked anything, wholly, is closed after this; so is one that asks nothing more.
const ASKS_WITHIN: Duration = Duration::from_secs(15);

/// The threads that answer; a box needs none of them.
const THREADS: usize = 2;

/// For whom the desk is.
#[derive(Debug)]
pub enum For {
    /// Programs of this computer, at this port; `None`: [`PORT`], or a free one where that is taken.
    ThisComputer(Option<u16>),
    /// Whoever reaches this address and knows the password, by TLS.
    Others {
        /// The address and the port.
        address: SocketAddr,
        /// The password.
        password: Password,
        /// A certificate and its key; otherwise the desk makes its own.
        certificate: Option<(PathBuf, PathBuf)>,
    },
}

/// What a handler has.
#[derive(Clone)]
struct App {
    desk: Arc<Desk>,
    gate: Arc<Gate>,
}

/// A server that runs.
pub struct Server {
    /// Where it is.
    pub address: SocketAddr,
    /// What a person opens.
    pub url: String,
    /// The fingerprint of the desk's own certificate.
    pub fingerprint: Option<String>,
    seats: Arc<Seats>,
    handle: axum_server::Handle<SocketAddr>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves a desk.
    ///
    /// # Errors
    /// When nobody can listen there, or the certificate cannot be used.
    pub fn start(desk: Arc<Desk>, whom: For) -> Result<Self, BadInput> {
        let (listener, tls, password) = match whom {
            For::ThisComputer(port) => (on_this_computer(port)?, None, None),
            For::Others { address, password, certificate } => {
                let names = guard::names(desk.computer(), address.ip());
                let tls = match certificate {
                    Some((certificate, key)) => tls::given(&certificate, &key)?,
                    None => tls::own(&names)?,
                };
                (listen(address)?, Some(tls), Some(password))
            }
        };
        let address = listener.local_addr().map_err(|error| BadInput::io("the desk", &error))?;
        listener.set_nonblocking(true).map_err(|error| BadInput::io("the desk", &error))?;
        let gate =
            Arc::new(Gate::new(Arc::clone(&desk.memory), address, password, desk.computer()));
        let url = gate.url();
        let app = router(App { desk, gate });
        let handle = axum_server::Handle::new();
        let (fingerprint, config) = match tls {
            Some(tls) => (tls.fingerprint, Some(tls.config)),
            None => (None, None),
        };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(THREADS)
            .thread_name("the desk's pages")
            .enable_all()
            .build()
            .map_err(|error| BadInput::io("the desk's threads", &error))?;
        let seats = Arc::<Seats>::default();
        let (ends, for_server) = (handle.clone(), Arc::clone(&seats));
        let serve = async move {
            let service = app.into_make_service_with_connect_info::<SocketAddr>();
            // An error ends the server, which its user sees.
            let _ = match config {
                None => match axum_server::from_tcp(listener) {
                    Ok(server) => bounded(server, for_server, ends).serve(service).await,
                    Err(error) => Err(error),
                },
                Some(config) => match axum_server::from_tcp_rustls(listener, config) {
                    Ok(server) => bounded(server, for_server, ends).serve(service).await,
                    Err(error) => Err(error),
                },
            };
        };
        let thread = std::thread::Builder::new()
            .name("the desk's server".to_owned())
            .spawn(move || {
                runtime.block_on(serve);
                runtime.shutdown_timeout(ENDS_WITHIN);
            })
            .map_err(|error| BadInput::io("the desk's server", &error))?;
        Ok(Self { address, url, fingerprint, seats, handle, thread: Some(thread) })
    }

    /// Whether it still runs.
    #[must_use]
    pub fn runs(&self) -> bool {
        self.thread.as_ref().is_some_and(|it| !it.is_finished())
    }

    /// The connections that had to give way to others, because [`CONNECTIONS_MAX`] were open.
    #[must_use]
    pub fn gave_way(&self) -> u64 {
        self.seats.gave_way()
    }

    /// Ends it: pages are told, and requests that are under way are answered.
    pub fn end(&mut self) {
        self.handle.graceful_shutdown(Some(ENDS_WITHIN));
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

/// The answers of a desk to programs of this computer, as a [`Server`] at this address gives them, without
/// a network; and what a person opens.
pub fn answers(desk: Arc<Desk>, address: SocketAddr) -> (Router, String) {
    let gate = Arc::new(Gate::new(Arc::clone(&desk.memory), address, None, desk.computer()));
    let url = gate.url();
    (router(App { desk, gate }), url)
}

/// The same server, within bounds.
fn bounded<A>(
    server: axum_server::Server<SocketAddr, A>,
    seats: Arc<Seats>,
    ends: axum_server::Handle<SocketAddr>,
) -> axum_server::Server<SocketAddr, Seated<A>> {
    let mut server = server.map(|acceptor| Seated::new(acceptor, seats));
    server.http_builder().http1().header_read_timeout(ASKS_WITHIN);
    server.handle(ends).first_request_timeout(ASKS_WITHIN)
}

/// Listens for programs of this computer.
fn on_this_computer(port: Option<u16>) -> Result<TcpListener, BadInput> {
    let at = |port| SocketAddr::new(IpAddr::from([127, 0, 0, 1]), port);
    match port {
        Some(port) => listen(at(port)),
        None => listen(at(PORT)).or_else(|_| listen(at(0))),
    }
}

fn listen(address: SocketAddr) -> Result<TcpListener, BadInput> {
    TcpListener::bind(address).map_err(|error| match error.kind() {
        std::io::ErrorKind::AddrInUse => BadInput::whole(
            format!("the desk at {address}"),
            "another program listens there, perhaps another desk",
            "end that program, or choose another port",
        ),
        _ => BadInput::io(format!("the desk at {address}"), &error),
    })
}

fn router(app: App) -> Router {
    let api = Router::new()
        .route("/api/hello", get(api::hello))
        .route("/api/login", post(sign_in::login))
        .route("/api/logout", post(sign_in::logout))
        .route("/api/state", get(api::state))
        .route("/api/protocols", get(api::protocols))
        .route("/api/protocols/check", post(api::check_protocol))
        .route("/api/studies", get(api::studies).post(api::create_study))
        .route("/api/studies/{study}", get(api::study))
        .route("/api/studies/{study}/protocol", post(api::set_protocol))
        .route("/api/studies/{study}/participants", post(api::set_participant))
        .route("/api/prints", get(setting_up::prints).post(setting_up::describe))
        .route("/api/prints/{sheet}", get(setting_up::sheet))
        .route("/api/settings/check", post(setting_up::check_settings))
        .route("/api/new-box", get(setting_up::new_box).post(setting_up::make_box))
        .route("/api/boxes/{id}/card", get(setting_up::card))
        .route("/api/boxes/{id}/card/{file}", post(setting_up::card_file))
        .route("/api/boxes/{id}/{*action}", get(api::look).post(api::act))
        .route("/reports/{study}", get(reports::study))
        .route("/reports/{study}/{session}/{trial}", get(reports::trial))
        .route("/ws", get(socket::open))
        .fallback(assets::file)
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .layer(from_fn_with_state(app.clone(), guard::guard))
        .layer(from_fn(guard::headers));
    api.with_state(app)
}
