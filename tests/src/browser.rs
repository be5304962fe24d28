//! A browser without a window, which is driven over its own debugging protocol: no driver program, no version to match.
//!
//! Invariant: a browser that hangs is ended; it never hangs the tests.

use std::io::ErrorKind::{Interrupted, WouldBlock};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError, Weak, mpsc};
use std::time::{Duration, Instant};

use retrace_task_support::tools;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

/// Longest wait for an answer of the browser.
const CALL_TIMEOUT: Duration = Duration::from_secs(60);

/// Longest time from start to its first line.
const START_TIMEOUT: Duration = Duration::from_secs(60);

/// Longest time that it has to end by itself.
const END_TIMEOUT: Duration = Duration::from_secs(3);

/// How long one read waits.
const POLL: Duration = Duration::from_millis(50);

/// Arguments of every start.
const ARGUMENTS: &[&str] = &[
    "--headless=new",
    "--remote-debugging-port=0",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    // No process for a page that may never be opened.
    "--disable-features=SpareRendererForSitePerProcess",
    "--metrics-recording-only",
    "--mute-audio",
    "--hide-scrollbars",
    // The picture is made in software, as on a machine without a graphics card; shared memory of containers is small.
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
    "--disable-gpu-rasterization",
    "--disable-dev-shm-usage",
    "--force-color-profile=srgb",
    "--font-render-hinting=none",
    // Its sandbox needs user namespaces and refuses root. The only page that it shows is our own.
    "--no-sandbox",
    // Every page is at work, also the one that is behind another.
    "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows",
    "--disable-background-timer-throttling",
    "--enable-precise-memory-info",
    "about:blank",
];

/// A browser with connections of a test's own. The tests of a process share one while any of them uses it: to start one
/// takes more time of the processor than most tests.
#[derive(Debug)]
pub struct Browser {
    running: Arc<RunningBrowser>,
    socket: DebuggingSocket,
}

/// A browser that listens.
#[derive(Debug)]
struct RunningBrowser {
    process: Mutex<BrowserProcess>,
    host: String,
    path: String,
    /// Its profile, which is removed behind it.
    _profile: TempDir,
}

/// The browser that is shared.
static SHARED: Mutex<Weak<RunningBrowser>> = Mutex::new(Weak::new());

impl Browser {
    /// Connects to the browser, which is started if there is none yet. `None` where there is none on this machine.
    ///
    /// # Panics
    /// Where it does not start.
    #[must_use]
    pub fn start() -> Option<Self> {
        let program = tools::browser()?;
        let running = {
            let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
            let running = shared.upgrade().unwrap_or_else(|| Arc::new(RunningBrowser::start(&program)));
            *shared = Arc::downgrade(&running);
            running
        };
        let socket = DebuggingSocket::connect(&running.host, &running.path);
        Some(Self { running, socket })
    }

    /// Opens an empty page with cookies and storage of its own, as in another browser. It is closed at the end of the
    /// test at the latest.
    ///
    /// # Panics
    /// Where the browser does not answer.
    #[must_use]
    pub fn new_page(&mut self) -> DebuggingSocket {
        let context = self.socket.call("Target.createBrowserContext", json!({"disposeOnDetach": true}));
        let target = json!({"url": "about:blank", "browserContextId": context["browserContextId"]});
        let target = self.socket.call("Target.createTarget", target);
        let number = target["targetId"].as_str().expect("a page").to_owned();
        DebuggingSocket::connect(&self.running.host, &format!("devtools/page/{number}"))
    }

    /// Number of its process.
    #[must_use]
    pub fn process(&self) -> u32 {
        self.running.process.lock().unwrap_or_else(PoisonError::into_inner).0.id()
    }
}

impl RunningBrowser {
    fn start(program: &Path) -> Self {
        let profile = TempDir::new().expect("a temporary folder");
        let mut command = Command::new(program);
        command.arg(format!("--user-data-dir={}", profile.path().display())).args(ARGUMENTS);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut process = BrowserProcess(command.spawn().expect("the browser can be started"));
        let errors = BufReader::new(process.0.stderr.take().expect("a pipe"));
        let (address_tx, address_rx) = mpsc::channel();
        // Its output is read on, so that the pipe never fills.
        std::thread::spawn(move || {
            for line in errors.lines().map_while(Result::ok) {
                if let Some((_, address)) = line.split_once("DevTools listening on ws://") {
                    let _ = address_tx.send(address.trim().to_owned());
                }
            }
        });
        let address = address_rx.recv_timeout(START_TIMEOUT).expect("the browser listens");
        let (host, path) = address.split_once('/').expect("an address with a path");
        Self { process: Mutex::new(process), host: host.to_owned(), path: path.to_owned(), _profile: profile }
    }
}

impl Drop for RunningBrowser {
    fn drop(&mut self) {
        // It ends its own processes, and is killed where it does not.
        if std::thread::panicking() {
            return;
        }
        DebuggingSocket::connect(&self.host, &self.path).post("Browser.close", json!({}));
        let process = self.process.get_mut().unwrap_or_else(PoisonError::into_inner);
        let begun = Instant::now();
        while begun.elapsed() < END_TIMEOUT && matches!(process.0.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Process of a browser, which is killed when dropped.
#[derive(Debug)]
struct BrowserProcess(Child);

impl Drop for BrowserProcess {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A connection of the debugging protocol: to the browser, or to one of its pages.
#[derive(Debug)]
pub struct DebuggingSocket {
    socket: WebSocket<TcpStream>,
    last_call: u64,
    /// What the page reports: uncaught exceptions, errors of the console, of WebGL and of the content security policy.
    pub complaints: Vec<String>,
}

impl DebuggingSocket {
    fn connect(host: &str, path: &str) -> Self {
        let stream = TcpStream::connect(host).expect("the browser listens");
        for set in [TcpStream::set_read_timeout, TcpStream::set_write_timeout] {
            set(&stream, Some(CALL_TIMEOUT)).expect("a socket");
        }
        let address = format!("ws://{host}/{path}");
        let mut handshake = tungstenite::client(address, stream);
        let socket = loop {
            match handshake {
                Ok((socket, _)) => break socket,
                Err(tungstenite::HandshakeError::Interrupted(again)) => handshake = again.handshake(),
                Err(error) => panic!("the browser speaks its protocol: {error}"),
            }
        };
        socket.get_ref().set_read_timeout(Some(POLL)).expect("a socket");
        Self { socket, last_call: 0, complaints: Vec::new() }
    }

    /// Sends a call and does not wait for its answer. Returns its number.
    pub fn post(&mut self, method: &str, parameters: Value) -> u64 {
        self.last_call += 1;
        let call = json!({"id": self.last_call, "method": method, "params": parameters});
        let _ = self.socket.send(Message::text(call.to_string()));
        self.last_call
    }

    /// Result of a call.
    ///
    /// # Errors
    /// What the browser says, or that it does not answer.
    pub fn try_call(&mut self, method: &str, parameters: Value) -> Result<Value, String> {
        let number = self.post(method, parameters);
        self.answer(number).map_err(|error| format!("{method}: {error}"))
    }

    /// Sends calls in a row, and waits for their answers only then.
    ///
    /// # Panics
    /// Where the browser refuses one or does not answer.
    pub fn call_in_a_row(&mut self, calls: impl IntoIterator<Item = (&'static str, Value)>) {
        let numbers: Vec<u64> = calls.into_iter().map(|(method, parameters)| self.post(method, parameters)).collect();
        numbers.into_iter().for_each(|number| drop(self.answer(number).unwrap_or_else(|error| panic!("{error}"))));
    }

    /// Answer to the call of this number.
    fn answer(&mut self, number: u64) -> Result<Value, String> {
        let begun = Instant::now();
        while begun.elapsed() < CALL_TIMEOUT {
            let Some(mut message) = self.receive()? else { continue };
            if message["id"] != number {
                continue;
            }
            let error = &message["error"];
            return if error.is_null() { Ok(message["result"].take()) } else { Err(error.to_string()) };
        }
        Err(format!("no answer in {CALL_TIMEOUT:?}"))
    }

    /// Result of a call.
    ///
    /// # Panics
    /// Where the browser refuses it or does not answer.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.try_call(method, parameters).unwrap_or_else(|error| panic!("{error}"))
    }

    /// The next message, if one comes soon.
    fn receive(&mut self) -> Result<Option<Value>, String> {
        let text = match self.socket.read() {
            Ok(Message::Text(text)) => text,
            Ok(_) => return Ok(None),
            Err(tungstenite::Error::Io(error)) if matches!(error.kind(), WouldBlock | Interrupted) => return Ok(None),
            Err(error) => return Err(format!("the browser is gone: {error}")),
        };
        let message: Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
        self.complaints.extend(complaint(&message));
        Ok(Some(message))
    }
}

/// Text of an event that no good page causes.
fn complaint(event: &Value) -> Option<String> {
    let parameters = &event["params"];
    match event["method"].as_str()? {
        "Runtime.exceptionThrown" => {
            let details = &parameters["exceptionDetails"];
            Some(format!("exception: {} {}", details["text"], details["exception"]["description"]))
        }
        "Runtime.consoleAPICalled" => {
            let is_error = ["error", "assert", "warning"].iter().any(|kind| parameters["type"] == *kind);
            is_error.then(|| format!("console: {}", parameters["args"]))
        }
        "Log.entryAdded" => {
            let entry = &parameters["entry"];
            let text = entry["text"].as_str().unwrap_or_default();
            // WebGL reports its errors as warnings. Its remarks on speed are those of reading pixels in software.
            let is_error = entry["level"] == "error" || (text.contains("WebGL") && !text.contains("GPU stall"));
            is_error.then(|| format!("{}: {text} {}", entry["source"], entry["url"]))
        }
        "Page.javascriptDialogOpening" => Some(format!("a script opens a dialog: {}", parameters["message"])),
        "Audits.issueAdded" => {
            let issue = &parameters["issue"];
            (issue["code"] == "ContentSecurityPolicyIssue").then(|| format!("policy: {issue}"))
        }
        _ => None,
    }
}
