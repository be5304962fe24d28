//! The WebSocket of one page: sends it what changes, and passes on what it says.
//!
//! Invariant: a page that cannot keep up is sent the newest state, never a queue; its end ends what it held.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use retrace_config::NumberedError;
use retrace_tui::Rejection;
use std::time::Instant;
use tokio::time::MissedTickBehavior;

use crate::answers::{self, ClientView, ControlView};
use crate::control::{Client, Control};
use crate::failure::failure;
use crate::hello::HelloView;
use crate::messages::PageMessage;
use crate::operator_desk::OrderContext;
use crate::path_levels::PathLevels;
use crate::publisher::Snapshot;
use crate::server_state::{Server, Shared};
use crate::session::Rights;

/// Largest message of a page, bytes.
const MAX_MESSAGE: usize = 64 << 10;

/// Maximum number of chunks of the path that wait to be sent to a page.
const MAX_WANTED: usize = 4_096;

/// Minimum time between two messages with live figures.
const LIVE_INTERVAL: Duration = Duration::from_millis(16);

/// Time without a message after which a page is sent a ping, so that it knows that its link is alive.
const PING_INTERVAL: Duration = Duration::from_millis(200);

/// Minimum time between two messages with the log.
const LOG_INTERVAL: Duration = Duration::from_millis(250);

/// Time for a page to take a message. A page that takes longer is disconnected.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

/// Opens the WebSocket of a page.
pub(crate) async fn open(State(server): Shared, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response {
    let credential = server.sessions().credential(&headers, Instant::now());
    let Some((rights, credential)) = credential.map(|(rights, credential)| (rights, credential.to_owned())) else {
        return StatusCode::UNAUTHORIZED.into_response();
    };
    let Some(client) = server.connect(credential) else {
        let error = NumberedError::new("E2417", "16 pages are open", "close one of them");
        return failure(StatusCode::SERVICE_UNAVAILABLE, &error);
    };
    let failed = Arc::clone(&server);
    upgrade
        .protocols(["retrace.1"])
        .max_message_size(MAX_MESSAGE)
        .max_frame_size(MAX_MESSAGE)
        .on_failed_upgrade(move |_| failed.disconnect(client))
        .on_upgrade(async move |socket| {
            let mut page = Page::new(client, rights, &server);
            let _ = page.serve(socket).await;
            server.disconnect(client);
        })
}

/// A page with what it was sent.
struct Page<'s> {
    client: Client,
    rights: Rights,
    server: &'s Server,
    sent: Option<Snapshot>,
    control: Option<(Control, Option<u64>, u64)>,
    live_sent: Instant,
    log_sent: Option<Instant>,
    /// Whether the newest log was sent.
    log_is_sent: bool,
    /// Number of the last offer of a program, and of the last rejection, that this page knows.
    known: (u64, Option<u64>),
    wanted: VecDeque<(Arc<PathLevels>, u8, u32)>,
    answers: VecDeque<String>,
}

impl<'s> Page<'s> {
    fn new(client: Client, rights: Rights, server: &'s Server) -> Self {
        Self {
            client,
            rights,
            server,
            sent: None,
            control: None,
            live_sent: Instant::now(),
            log_sent: None,
            log_is_sent: false,
            known: (server.offer().0, None),
            wanted: VecDeque::new(),
            answers: VecDeque::new(),
        }
    }

    async fn serve(&mut self, mut socket: WebSocket) -> Result<(), axum::Error> {
        let name = self.server.page_name(self.client);
        let greeting = HelloView::of(self.server).for_page(self.rights, self.client, name);
        send(&mut socket, answers::message(&greeting)).await?;
        let mut news = self.server.news.subscribe();
        let mut tick = tokio::time::interval(LIVE_INTERVAL);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                biased;
                message = socket.recv() => match message {
                    Some(Ok(Message::Text(text))) => self.receive(&text),
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return Ok(()),
                    Some(Ok(_)) => {}
                },
                changed = news.changed() => if changed.is_err() { return Ok(()) },
                _ = tick.tick() => {}
            }
            while let Some(answer) = self.answers.pop_front() {
                send(&mut socket, answer).await?;
            }
            self.send_news(&mut socket).await?;
        }
    }

    /// Sends what has changed, the most urgent first.
    async fn send_news(&mut self, socket: &mut WebSocket) -> Result<(), axum::Error> {
        let (snapshot, control) = self.server.desk.newest();
        let request = self.server.desk.control_request(&control);
        let shown = (control, request.map(|(_, left)| left), self.server.names_version.load(Ordering::Relaxed));
        if self.control.as_ref() != Some(&shown) {
            send(socket, self.control_message(&shown.0, request)).await?;
            self.control = Some(shown);
        }
        let Some(snapshot) = snapshot else { return Ok(()) };
        let sent = self.sent.take();
        let is_new = |now: &Arc<str>, before: Option<&Arc<str>>| before.is_none_or(|before| !Arc::ptr_eq(before, now));
        let path = snapshot.path.as_ref().map(|path| path.number);
        if let Some(new) = snapshot.path.as_ref().filter(|_| sent.as_ref().is_none_or(|it| it.path_number() != path)) {
            self.wanted.clear();
            send(socket, new.description()).await?;
        }
        if is_new(&snapshot.state, sent.as_ref().map(|it| &it.state)) {
            send(socket, snapshot.state.as_ref().to_owned()).await?;
        }
        let mut now_sent = snapshot.clone();
        let elapsed = self.live_sent.elapsed();
        if is_new(&snapshot.live, sent.as_ref().map(|it| &it.live)) {
            if elapsed >= LIVE_INTERVAL || sent.is_none() {
                send(socket, snapshot.live.as_ref().to_owned()).await?;
                self.live_sent = Instant::now();
            } else if let Some(before) = &sent {
                now_sent.live = Arc::clone(&before.live);
            }
        } else if elapsed >= PING_INTERVAL {
            send(socket, r#"{"t":"ping"}"#.to_owned()).await?;
            self.live_sent = Instant::now();
        }
        self.log_is_sent &= !is_new(&snapshot.log, sent.as_ref().map(|it| &it.log));
        if !self.log_is_sent && self.log_sent.is_none_or(|at| at.elapsed() >= LOG_INTERVAL) {
            send(socket, snapshot.log.as_ref().to_owned()).await?;
            (self.log_is_sent, self.log_sent) = (true, Some(Instant::now()));
        }
        self.send_notices(socket, &snapshot.rejection).await?;
        self.sent = Some(now_sent);
        self.send_chunk(socket).await
    }

    /// Sends what is noticed once: a program that is offered, and to the page in control an order that was rejected.
    async fn send_notices(&mut self, socket: &mut WebSocket, rejection: &Rejection) -> Result<(), axum::Error> {
        let before = self.known.1.replace(rejection.count);
        let is_holder = self.control.as_ref().is_some_and(|(control, ..)| control.holder() == Some(self.client));
        if is_holder && before.is_some_and(|before| before != rejection.count) {
            send(socket, answers::rejected(rejection)).await?;
        }
        let (number, offer) = self.server.offer();
        if let Some(offer) = offer.filter(|_| number != self.known.0) {
            self.known.0 = number;
            send(socket, answers::message(&offer)).await?;
        }
        Ok(())
    }

    /// Sends one wanted chunk of the path, so that live figures go between.
    async fn send_chunk(&mut self, socket: &mut WebSocket) -> Result<(), axum::Error> {
        let begun = Instant::now();
        while let Some((path, level, first)) = self.wanted.pop_front() {
            if let Some(chunk) = path.chunk(usize::from(level), first as usize) {
                deliver(socket, Message::Binary(chunk.into())).await?;
            }
            if begun.elapsed() > Duration::from_millis(5) {
                break;
            }
        }
        Ok(())
    }

    fn control_message(&self, control: &Control, request: Option<(Client, u64)>) -> String {
        let view = |client: Client| ClientView::new(client, self.server.page_name(client));
        let asks = request.map(|(client, left_s)| (view(client), left_s));
        let is_you = control.holder() == Some(self.client);
        answers::message(&ControlView::new(control.holder().map(view), is_you, control.turn(), asks))
    }

    fn answer(&mut self, id: u32, done: Result<(), NumberedError>) {
        self.answers.push_back(answers::answer(id, done));
    }

    fn receive(&mut self, text: &str) {
        let message = match PageMessage::read(text) {
            Ok(message) => message,
            Err(error) => {
                let cause = format!("the message is not understood: {error}");
                return self.answer(0, Err(NumberedError::new("E2418", cause, "see docs/serve-api.md")));
            }
        };
        let (client, rights) = (self.client, self.rights);
        let context = |turn, seen| OrderContext { client, rights, turn, seen };
        let desk = &self.server.desk;
        match message {
            PageMessage::Hold {} => desk.hold(client),
            PageMessage::Do { id, turn, seen, words } => {
                let done = desk.order(context(turn, seen), &words);
                self.answer(id, done);
            }
            PageMessage::Wheel { turn, counts } => {
                if let Err(error) = desk.turn_wheel(context(turn, 0), counts) {
                    self.answer(0, Err(error));
                }
            }
            PageMessage::Jog { id, turn, seen, axis, up, speed, beat } => {
                let done = desk.jog(context(turn, seen), (&axis, up, speed.into()), beat);
                self.answer(id, done);
            }
            PageMessage::Beat { beat } => desk.beat(client, beat),
            PageMessage::JogEnd {} => desk.end_jog(client),
            PageMessage::Control { action } => desk.change_control(client, rights, action),
            PageMessage::Want { path, level, firsts } => self.want(path, level, &firsts),
            PageMessage::Where { id, path, record, line } => self.locate(id, path, record, line),
            PageMessage::Name { name } => self.server.name_page(client, &name),
        }
    }

    fn path(&self, number: u32) -> Option<Arc<PathLevels>> {
        let path = self.server.desk.newest().0?.path?;
        (path.number == number).then_some(path)
    }

    fn want(&mut self, path: u32, level: u8, firsts: &[u32]) {
        let Some(path) = self.path(path) else { return };
        let room = MAX_WANTED.saturating_sub(self.wanted.len());
        self.wanted.extend(firsts.iter().take(room).map(|&first| (Arc::clone(&path), level, first)));
    }

    fn locate(&mut self, id: u32, path: u32, record: Option<u32>, line: Option<u32>) {
        let found = self.path(path).and_then(|levels| {
            let line = line.or_else(|| levels.path.line_of(record?.saturating_sub(1)))?;
            let records = match record {
                Some(record) => levels.path.run_of(record.saturating_sub(1)),
                None => levels.path.records_of(line),
            };
            Some((line, records))
        });
        let (line, records) = found.map_or((line, None), |(line, records)| (Some(line), records));
        self.answers.push_back(answers::place(id, line, records));
    }
}

async fn send(socket: &mut WebSocket, text: String) -> Result<(), axum::Error> {
    deliver(socket, Message::Text(text.into())).await
}

async fn deliver(socket: &mut WebSocket, message: Message) -> Result<(), axum::Error> {
    match tokio::time::timeout(SEND_TIMEOUT, socket.send(message)).await {
        Ok(sent) => sent,
        Err(late) => Err(axum::Error::new(late)),
    }
}
