//! The server: its routes, its thread, and its pages.
//!
//! Invariant: it runs in one thread of its own, which no other thread waits for; where that thread no longer responds,
//! [`ServeHandle::is_stuck`] says so, and whoever operates the machine holds it.

use std::io;
use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{delete, get, post, put};
use axum::{Router, middleware::Next};
use retrace_config::NumberedError;
use retrace_tui::ScreenModel;
use tokio::time::MissedTickBehavior;
use tokio_rustls::TlsAcceptor;

use crate::assets::page_file;
use crate::connection::{BoundedListener, Peer};
use crate::guard::{Guard, guard_requests};
use crate::host::{ServeHost, ServeOptions};
use crate::identity::ServeIdentity;
use crate::operator_desk::OperatorDesk;
use crate::requests::{self, require};
use crate::server_state::Server;
use crate::session::Rights;
use crate::shop_job_list;
use crate::socket;
use crate::table_requests;
use crate::tls::TlsFiles;
use crate::uploads::{self, MAX_UPLOAD};
use crate::watched_folder::WatchedFolder;

/// Interval of the snapshots, and of the check of a held jog.
const TICK: Duration = Duration::from_millis(16);

/// Time after which a thread that no longer responds is taken for stuck: nobody can operate the machine on its pages.
const STUCK_AFTER: Duration = Duration::from_secs(5);

/// The same while a page holds a jog, which this thread must end where the beats end.
const STUCK_IN_JOG_AFTER: Duration = Duration::from_millis(250);

/// Interval at which the watched folder is looked at.
const WATCH_INTERVAL: Duration = Duration::from_secs(1);

/// Time that the thread may take to end.
const END_TIMEOUT: Duration = Duration::from_millis(500);

/// A server that runs.
pub struct ServeHandle {
    addresses: [String; 2],
    upload: Option<String>,
    ends: Arc<AtomicBool>,
    server: Arc<Server>,
    thread: Option<JoinHandle<()>>,
    was_stuck: bool,
}

/// Starts a server for the machine that this model shows.
///
/// # Errors
/// `E2419` where the address cannot be listened at; `E2427` and `E2428` where the certificate cannot be used.
pub fn start(
    options: ServeOptions,
    model: Arc<Mutex<ScreenModel>>,
    host: Arc<dyn ServeHost>,
    identity: &Arc<ServeIdentity>,
) -> Result<ServeHandle, NumberedError> {
    // The pages find the server again at the address that it had.
    let listen = identity.address().unwrap_or(options.listen);
    let refused = |error: &dyn std::fmt::Display| {
        let remedy = "choose another address with --listen, for example 127.0.0.1:8282";
        NumberedError::new("E2419", format!("the page cannot be served at {listen}: {error}"), remedy)
    };
    let tls = options.tls.as_ref().map(TlsFiles::acceptor).transpose()?;
    let scheme = if tls.is_some() { "https" } else { "http" };
    let listener = TcpListener::bind(listen).map_err(|error| refused(&error))?;
    listener.set_nonblocking(true).map_err(|error| refused(&error))?;
    let address = listener.local_addr().map_err(|error| refused(&error))?;
    identity.set_address(address, tls.is_some());
    let keys = identity.keys();
    let shown = match (&options.name, address.ip().is_unspecified()) {
        (Some(name), _) => format!("{name}:{}", address.port()),
        (None, true) => format!("localhost:{}", address.port()),
        (None, false) => address.to_string(),
    };
    let addresses = [&keys.operate, &keys.watch].map(|token| format!("{scheme}://{shown}/#t={token}"));
    let guard = Guard::new(address.port(), options.name.as_deref(), tls.is_some());
    let desk = OperatorDesk::new(model, host, options.folders.clone(), options.lost_control);
    let server = Arc::new(Server::new(desk, identity, options));
    // The first request is answered with a state, however early it comes.
    let _ = server.desk.advance();
    let ends = Arc::new(AtomicBool::new(false));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .max_blocking_threads(4)
        .build()
        .map_err(|error| refused(&error))?;
    let (told, shared) = (Arc::clone(&ends), Arc::clone(&server));
    let work = move || {
        // Where the whole process is in real time, pages are not.
        let _ = retrace_real_time::leave();
        runtime.block_on(async move {
            let serving = serve(listener, tls, guard, Arc::clone(&shared));
            tokio::select! {
                _ = serving => {}
                () = publish(&shared, &told) => {}
                () = watch_folder(&shared) => {}
            }
        });
    };
    let thread = std::thread::Builder::new().name("serve".into()).spawn(work).map_err(|error| refused(&error))?;
    Ok(ServeHandle { addresses, upload: keys.upload.clone(), ends, server, thread: Some(thread), was_stuck: false })
}

/// Publishes snapshots until the server is to end.
async fn publish(server: &Server, ends: &AtomicBool) {
    let mut tick = tokio::time::interval(TICK);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut control = None;
    while !ends.load(Ordering::Relaxed) {
        // A jog without beats ends at its time, and not at the tick behind it.
        let left = server.desk.jog_left().unwrap_or(TICK);
        tokio::select! {
            _ = tick.tick() => {}
            () = tokio::time::sleep(left), if left < TICK => {}
        }
        let (snapshot, now) = server.desk.advance();
        server.show_life();
        if snapshot.is_some() || control.as_ref() != Some(&now) {
            server.news.send_modify(|number| *number += 1);
            control = Some(now);
        }
    }
}

/// Offers programs that appear in the watched folder. It never ends.
async fn watch_folder(server: &Arc<Server>) {
    let mut folder = WatchedFolder::default();
    let mut tick = tokio::time::interval(WATCH_INTERVAL);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tick.tick().await;
        if server.desk.folders().watched.is_none() {
            return std::future::pending().await;
        }
        let of = Arc::clone(server);
        let listed = tokio::task::spawn_blocking(move || of.desk.folders().list_watched()).await;
        if let Some(offer) = listed.ok().and_then(|listed| folder.poll(&listed)) {
            server.set_offer(offer);
        }
    }
}

async fn serve(listener: TcpListener, tls: Option<TlsAcceptor>, guard: Guard, server: Arc<Server>) -> io::Result<()> {
    let listener = BoundedListener::new(tokio::net::TcpListener::from_std(listener)?, tls);
    let app = router(guard, server).into_make_service_with_connect_info::<Peer>();
    axum::serve(listener, app).await
}

fn router(guard: Guard, server: Arc<Server>) -> Router {
    let rights = |needed: Rights| {
        let server = Arc::clone(&server);
        from_fn(move |request, next: Next| require(Arc::clone(&server), needed, request, next))
    };
    let watching = Router::new()
        .route("/api/v1/hello", get(requests::get_hello))
        .route("/api/v1/state", get(requests::get_state))
        .route("/api/v1/log", get(requests::get_log))
        .route("/api/v1/program/lines", get(requests::get_lines))
        .route("/api/v1/program/contours", get(requests::get_contours))
        .route("/api/v1/programs", get(requests::get_programs))
        .route("/api/v1/offsets", get(table_requests::get_offsets))
        .route("/api/v1/tools", get(table_requests::get_tools))
        .route("/api/v1/jobs", get(requests::get_jobs))
        .route("/api/v1/shop/jobs", get(shop_job_list::get_shop_jobs))
        .route("/api/v1/jobs/{id}", get(requests::get_job))
        .route("/api/v1/profile", get(requests::get_profile))
        .route("/api/v1/session", delete(requests::end_session))
        .route("/api/v1/ws", get(socket::open))
        .layer(rights(Rights::Watch));
    let operating = Router::new()
        .route("/api/v1/programs/{name}", delete(requests::delete_program))
        .route("/api/v1/offsets", put(table_requests::put_offsets))
        .route("/api/v1/tools", put(table_requests::put_tools))
        .layer(rights(Rights::Operate));
    let uploading = Router::new()
        .route("/api/v1/programs/{name}", put(uploads::put_program))
        .route("/api/version", get(uploads::octoprint_version))
        .route("/api/files/local", post(uploads::octoprint_upload))
        // Uploads count their bytes themselves; the rest of a form is small.
        .layer(DefaultBodyLimit::max(MAX_UPLOAD + (1 << 20)))
        .layer(rights(Rights::Upload));
    Router::new()
        .merge(watching)
        .merge(operating)
        .merge(uploading)
        .route("/api/v1/session", post(requests::begin_session))
        .route("/", get(async || page_file("index.html")))
        .route("/page/{*name}", get(async |name: axum::extract::Path<String>| page_file(&name)))
        .layer(from_fn_with_state(guard, guard_requests))
        .with_state(server)
}

impl ServeHandle {
    /// Address of the page for operating, with its token in the fragment.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.addresses[0]
    }

    /// Address of the page for watching, with its token in the fragment.
    #[must_use]
    pub fn watch_address(&self) -> &str {
        &self.addresses[1]
    }

    /// Key for uploads, if there is one.
    #[must_use]
    pub fn upload_key(&self) -> Option<&str> {
        self.upload.as_deref()
    }

    /// Whether the server's thread no longer responds; true once per blockage.
    pub fn is_stuck(&mut self) -> bool {
        let limit = if self.server.desk.holds_jog() { STUCK_IN_JOG_AFTER } else { STUCK_AFTER };
        let is_stuck = self.server.silence() > limit;
        is_stuck && !std::mem::replace(&mut self.was_stuck, is_stuck) || {
            self.was_stuck &= is_stuck;
            false
        }
    }
}

impl Drop for ServeHandle {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that is stuck is left to the end of the process.
            let begun = Instant::now();
            while !thread.is_finished() && begun.elapsed() < END_TIMEOUT {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
    }
}

/// The address as a QR code of characters for a terminal, with dark modules drawn as blanks on light ones.
#[must_use]
pub fn qr_code(address: &str) -> Option<String> {
    let code = qrcode::QrCode::with_error_correction_level(address, qrcode::EcLevel::L).ok()?;
    let width = code.width() as i32;
    let is_light = |x: i32, y: i32| {
        let inside = (0..width).contains(&x) && (0..width).contains(&y);
        !inside || code[(x as usize, y as usize)] == qrcode::Color::Light
    };
    let mut text = String::new();
    for y in (-2..width + 2).step_by(2) {
        for x in -2..width + 2 {
            text.push(match (is_light(x, y), is_light(x, y + 1)) {
                (true, true) => '█',
                (true, false) => '▀',
                (false, true) => '▄',
                (false, false) => ' ',
            });
        }
        text.push('\n');
    }
    Some(text)
}
