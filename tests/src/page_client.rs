//! A client of the page's server: the command, plain requests, and the WebSocket of a page.
//!
//! Invariant: it uses nothing of retrace, so that it judges what is sent on the wire.

use std::io::ErrorKind::{Interrupted, WouldBlock};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use crate::command::Bench;

/// Longest wait for something to appear.
const TIMEOUT: Duration = Duration::from_secs(60);

/// A `retrace serve` that runs.
#[derive(Debug)]
pub struct PageServer {
    child: Child,
    /// Host and port.
    pub host: String,
    /// Token for operating.
    pub token: String,
    /// Token for watching.
    pub watch_token: String,
    /// Key for uploads, if there is one.
    pub upload_key: Option<String>,
}

/// An answer to a plain request.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Status code.
    pub status: u16,
    /// Headers, in lower case, one a line.
    pub headers: String,
    /// Body.
    pub body: String,
}

impl Answer {
    /// The body as JSON.
    ///
    /// # Panics
    /// Where it is none.
    #[must_use]
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.body))
    }

    /// The number of its error.
    #[must_use]
    pub fn error_number(&self) -> String {
        self.json()["error"]["number"].as_str().unwrap_or_default().to_owned()
    }
}

impl PageServer {
    /// Starts the command on a free port with these arguments besides.
    ///
    /// # Panics
    /// Where it does not print its address.
    #[must_use]
    pub fn start(arguments: &[&str]) -> Self {
        Self::start_as(std::process::Command::new(crate::command::binary()), arguments)
    }

    /// Starts the command with this program, and opens a page that is in control and ready.
    ///
    /// # Panics
    /// Where it does not become ready.
    #[must_use]
    pub fn in_control(bench: &Bench, program: &str, arguments: &[&str]) -> (Self, Page) {
        let program = bench.file("program.ngc", program).display().to_string();
        let journal = bench.path("jobs").display().to_string();
        let server = Self::start(&[&[&program, "--journal", &journal], arguments].concat());
        let mut page = server.page(&server.token);
        page.take_control();
        page.wait_for_word("READY");
        (server, page)
    }

    /// Starts the command as this process, to which its arguments are added.
    ///
    /// # Panics
    /// Where it does not print its address.
    #[must_use]
    pub fn start_as(mut command: std::process::Command, arguments: &[&str]) -> Self {
        command.args(["serve", "--listen", "127.0.0.1:0"]).args(arguments);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the command starts");
        let mut lines = BufReader::new(child.stdout.take().expect("a pipe")).lines().map_while(Result::ok);
        let mut after = |mark: &str| {
            let line = lines.find(|line| line.contains(mark)).expect("it prints its addresses");
            line.split_once(mark).map(|(_, rest)| rest.to_owned()).unwrap_or_default()
        };
        let page = after("page: http://");
        let (host, token) = page.split_once("/#t=").expect("an address with a token");
        let (host, token) = (host.to_owned(), token.to_owned());
        let watch_token = after("/#t=");
        let upload_key = arguments.contains(&"--upload-key").then(|| after("(X-Api-Key): "));
        // Its output is read on, so that the pipe never fills.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, host, token, watch_token, upload_key }
    }

    /// Sends a request with these headers besides `Host`.
    ///
    /// # Panics
    /// Where no answer comes.
    #[must_use]
    pub fn request(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut text = format!("{method} {path} HTTP/1.1\r\n");
        if !headers.iter().any(|(name, _)| name.eq_ignore_ascii_case("host")) {
            text += &format!("Host: {}\r\n", self.host);
        }
        for (name, value) in headers {
            text += &format!("{name}: {value}\r\n");
        }
        if !headers.iter().any(|(name, _)| name.eq_ignore_ascii_case("content-length")) {
            text += &format!("Content-Length: {}\r\n", body.len());
        }
        text += "Connection: close\r\n\r\n";
        let mut stream = TcpStream::connect(&self.host).expect("it listens");
        stream.set_read_timeout(Some(TIMEOUT)).expect("a socket");
        let _ = stream.write_all(text.as_bytes()).and_then(|()| stream.write_all(body));
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        Answer { status, headers: head.to_ascii_lowercase(), body: body.to_owned() }
    }

    /// Begins a session with a token. Returns its cookie, or the answer that refuses it.
    ///
    /// # Errors
    /// The answer.
    pub fn sign_in(&self, token: &str) -> Result<String, Answer> {
        let body = json!({"token": token}).to_string();
        let json = [("Content-Type", "application/json")];
        let answer = self.request("POST", "/api/v1/session", &json, body.as_bytes());
        let cookie = answer.headers.lines().find_map(|line| line.strip_prefix("set-cookie: "));
        let pair = cookie.and_then(|cookie| cookie.split(';').next()).map(str::to_owned);
        pair.ok_or(answer)
    }

    /// A `GET` with the cookie of a session for operating.
    ///
    /// # Panics
    /// Where no session begins.
    #[must_use]
    pub fn get(&self, path: &str) -> Answer {
        let cookie = self.sign_in(&self.token).expect("the token is right");
        self.request("GET", path, &[("Cookie", &cookie)], b"")
    }

    /// Opens a page with this token.
    ///
    /// # Panics
    /// Where it is refused.
    #[must_use]
    pub fn page(&self, token: &str) -> Page {
        let cookie = self.sign_in(token).expect("the token is right");
        let headers = [("Cookie", cookie.as_str()), ("Origin", &format!("http://{}", self.host))];
        Page { cookie: cookie.clone(), ..self.page_with(&headers).expect("it is accepted") }
    }

    /// Opens a WebSocket with these headers, if the server is there.
    #[must_use]
    pub fn try_page(&self, headers: &[(&'static str, &str)]) -> Option<Page> {
        TcpStream::connect(&self.host).is_ok().then(|| self.page_with(headers).ok())?
    }

    /// Opens a WebSocket with these headers.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn page_with(&self, headers: &[(&'static str, &str)]) -> Result<Page, String> {
        let mut request = format!("ws://{}/api/v1/ws", self.host).into_client_request().expect("a request");
        for (name, value) in headers {
            request.headers_mut().insert(*name, value.parse().expect("a header"));
        }
        let stream = TcpStream::connect(&self.host).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_millis(20))).expect("a socket");
        stream.set_nodelay(true).expect("a socket");
        let mut handshake = tungstenite::client(request, stream);
        loop {
            match handshake {
                Ok((socket, _)) => return Ok(Page::new(socket)),
                Err(tungstenite::HandshakeError::Interrupted(again)) => handshake = again.handshake(),
                Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                    let body = answer.body().as_deref().map(String::from_utf8_lossy);
                    return Err(format!("{} {}", answer.status(), body.unwrap_or_default()));
                }
                Err(tungstenite::HandshakeError::Failure(error)) => return Err(error.to_string()),
            }
        }
    }

    /// Number of its process.
    #[must_use]
    pub fn process(&self) -> u32 {
        self.child.id()
    }
}

impl Drop for PageServer {
    fn drop(&mut self) {
        let number = self.child.id().to_string();
        let _ = std::process::Command::new("kill").args(["-TERM", &number]).status();
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(10) {
            if matches!(self.child.try_wait(), Ok(Some(_)) | Err(_)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let _ = self.child.kill();
    }
}

/// A page: what the last message of each kind said.
#[derive(Debug)]
pub struct Page {
    socket: WebSocket<TcpStream>,
    last: serde_json::Map<String, Value>,
    /// Number of binary messages, and their bytes.
    pub chunks: (usize, usize),
    /// Number of messages `live`.
    pub live_count: usize,
    /// Cookie of its session, if it has one.
    pub cookie: String,
    orders: u32,
}

impl Page {
    fn new(socket: WebSocket<TcpStream>) -> Self {
        Self { socket, last: serde_json::Map::new(), chunks: (0, 0), live_count: 0, cookie: String::new(), orders: 0 }
    }

    /// The last message of this kind.
    #[must_use]
    pub fn last(&self, kind: &str) -> &Value {
        self.last.get(kind).unwrap_or(&Value::Null)
    }

    /// Receives one message, if one comes soon. Returns its kind.
    ///
    /// # Errors
    /// The link is gone.
    pub fn receive(&mut self) -> Result<Option<String>, String> {
        match self.socket.read() {
            Ok(Message::Text(text)) => {
                let message: Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
                let kind = message["t"].as_str().unwrap_or_default().to_owned();
                self.live_count += usize::from(kind == "live");
                self.last.insert(kind.clone(), message);
                Ok(Some(kind))
            }
            Ok(Message::Binary(bytes)) => {
                self.chunks = (self.chunks.0 + 1, self.chunks.1 + bytes.len());
                Ok(Some("chunk".into()))
            }
            Ok(Message::Close(_)) => Err("closed".into()),
            Ok(_) => Ok(None),
            // A read with a timeout is not restarted where the process was suspended meanwhile.
            Err(tungstenite::Error::Io(error)) if matches!(error.kind(), WouldBlock | Interrupted) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Receives until this is so.
    ///
    /// # Panics
    /// Where it does not come to be.
    pub fn wait_until(&mut self, what: &str, is_so: impl Fn(&Self) -> bool) {
        let begun = Instant::now();
        while !is_so(self) {
            assert!(begun.elapsed() < TIMEOUT, "`{what}` did not come: {:#?}", self.last);
            if let Err(error) = self.receive() {
                panic!("`{what}` did not come, {error}: {:#?}", self.last);
            }
        }
    }

    /// Receives until the state has this word.
    pub fn wait_for_word(&mut self, word: &str) {
        self.wait_until(word, |page| page.last("state")["word"] == word);
    }

    /// Receives until the log has this text.
    pub fn wait_for_log(&mut self, text: &str) {
        self.wait_until(text, |page| page.last("log").to_string().contains(text));
    }

    /// Receives for this long.
    pub fn listen(&mut self, time: Duration) {
        let begun = Instant::now();
        while begun.elapsed() < time {
            let _ = self.receive();
        }
    }

    /// Sends a message.
    pub fn send(&mut self, message: &Value) {
        self.send_text(&message.to_string());
    }

    /// Sends a text as it is.
    pub fn send_text(&mut self, text: &str) {
        let _ = self.socket.send(Message::text(text));
    }

    /// Takes control, and waits until this page has it.
    pub fn take_control(&mut self) {
        self.send(&json!({"t": "control", "do": "take"}));
        self.wait_until("control", |page| page.last("control")["is_you"] == true && page.last("state") != &Value::Null);
    }

    /// Gives an order with the present turn and state. Returns the answer.
    pub fn order(&mut self, words: &str) -> Value {
        let (turn, seen) = (self.last("control")["turn"].clone(), self.last("state")["n"].clone());
        self.order_as(&turn, &seen, words)
    }

    /// Gives an order once the machine is free: it may be at rest before it has finished the order before (E2421).
    pub fn order_when_free(&mut self, words: &str) -> Value {
        let begun = Instant::now();
        loop {
            let answer = self.order(words);
            if answer["number"] != "E2421" || begun.elapsed() > TIMEOUT {
                return answer;
            }
            self.listen(Duration::from_millis(20));
        }
    }

    /// Gives an order with this turn and seen state. Returns the answer.
    pub fn order_as(&mut self, turn: &Value, seen: &Value, words: &str) -> Value {
        self.orders += 1;
        let id = self.orders;
        self.send(&json!({"t": "do", "id": id, "turn": turn, "seen": seen, "words": words}));
        self.answer(id)
    }

    /// Answer to the order of this number.
    pub fn answer(&mut self, id: u32) -> Value {
        let is_it = |page: &Self, kind: &str| page.last(kind)["id"] == id;
        self.wait_until("an answer", |page| is_it(page, "done") || is_it(page, "refused"));
        let kind = if is_it(self, "done") { "done" } else { "refused" };
        self.last(kind).clone()
    }

    /// Figure of the last message `live`.
    #[must_use]
    pub fn live(&self, name: &str) -> f64 {
        self.last("live")[name].as_f64().unwrap_or(f64::NAN)
    }

    /// Machine position of an axis, mm.
    #[must_use]
    pub fn machine_mm(&self, axis: usize) -> f64 {
        self.last("live")["mm"][axis].as_f64().unwrap_or(f64::NAN)
    }
}
