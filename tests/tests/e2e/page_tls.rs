//! The page over TLS: what is printed, what is sent in the clear, and certificates that cannot be used.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use retrace_tests::command::{binary, root};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use serde_json::json;

fn file(name: &str) -> PathBuf {
    root().join("tests/data/tls").join(name)
}

/// A command that serves over TLS, with its host and token.
struct Server {
    child: Child,
    host: String,
    token: String,
}

impl Server {
    fn start() -> Self {
        let mut command = Command::new(binary());
        command.args(["serve", "--listen", "127.0.0.1:0", "--tls"]);
        command.args([file("certificate.pem"), file("key.pem")]);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the command starts");
        let mut lines = BufReader::new(child.stdout.take().expect("a pipe")).lines().map_while(Result::ok);
        let page = lines.find_map(|line| line.strip_prefix("page: ").map(str::to_owned)).expect("an address");
        std::thread::spawn(move || lines.for_each(drop));
        let address = page.strip_prefix("https://").expect("the address of TLS");
        let (host, token) = address.split_once("/#t=").expect("an address with a token");
        Self { child, host: host.to_owned(), token: token.to_owned() }
    }

    /// A connection of a client that trusts the authority of the tests alone.
    fn connect(&self) -> StreamOwned<ClientConnection, TcpStream> {
        let mut trusted = RootCertStore::empty();
        let authority = CertificateDer::from_pem_file(file("authority.pem")).expect("a certificate");
        trusted.add(authority).expect("an authority");
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
        let config = config.expect("versions").with_root_certificates(trusted).with_no_client_auth();
        let name = ServerName::try_from("localhost").expect("a name");
        let connection = ClientConnection::new(Arc::new(config), name).expect("a client");
        let stream = TcpStream::connect(&self.host).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a socket");
        StreamOwned::new(connection, stream)
    }

    fn request(&self, text: &str) -> String {
        let mut stream = self.connect();
        stream.write_all(text.replace("HOST", &self.host).as_bytes()).expect("sent");
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Page, session and WebSocket are encrypted, the cookie is for TLS alone, and nothing is answered in the clear.
#[test]
fn the_page_is_served_over_tls_and_in_no_other_way() {
    let server = Server::start();
    let page = server.request("GET / HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n\r\n");
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("<title>retrace</title>"), "{page}");
    let body = json!({"token": server.token}).to_string();
    let sign_in = format!(
        "POST /api/v1/session HTTP/1.1\r\nHost: HOST\r\nOrigin: https://HOST\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    );
    let signed_in = server.request(&sign_in);
    let cookie = signed_in.lines().find_map(|line| line.strip_prefix("set-cookie: ")).expect("a cookie");
    assert!(
        cookie.starts_with("__Host-retrace-") && cookie.contains("; Secure; HttpOnly; SameSite=Strict"),
        "{cookie}"
    );
    let foreign = server.request(&sign_in.replace("https://HOST", "http://HOST"));
    assert!(foreign.starts_with("HTTP/1.1 403"), "a page in the clear is not its own: {foreign}");
    let pair = cookie.split(';').next().expect("a pair");
    let mut socket = server.connect();
    let upgrade = format!(
        "GET /api/v1/ws HTTP/1.1\r\nHost: {}\r\nCookie: {pair}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
        server.host
    );
    socket.write_all(upgrade.as_bytes()).expect("sent");
    let mut received = Vec::new();
    while !String::from_utf8_lossy(&received).contains("\"t\":\"hello\"") {
        let mut part = [0; 4096];
        let count = socket.read(&mut part).expect("an answer");
        assert!(count > 0, "{}", String::from_utf8_lossy(&received));
        received.extend(&part[..count]);
    }
    assert!(received.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&received));
    // In the clear there is no answer of the page; and whoever begins a handshake and waits delays nobody.
    let _waits = TcpStream::connect(&server.host).expect("it listens");
    let mut plain = TcpStream::connect(&server.host).expect("it listens");
    plain.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("sent");
    let mut answer = Vec::new();
    let _ = plain.read_to_end(&mut answer);
    assert!(!String::from_utf8_lossy(&answer).contains("HTTP"), "{answer:?}");
    let again = server.request("GET / HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n\r\n");
    assert!(again.starts_with("HTTP/1.1 200"), "{again}");
}

/// A file that is missing, one that is none, and a key of another certificate.
#[test]
fn a_certificate_that_cannot_be_used_is_refused() {
    let run = |certificate: PathBuf, key: PathBuf| {
        let arguments = ["serve", "--listen", "127.0.0.1:0", "--tls"];
        let output = Command::new(binary()).args(arguments).args([certificate, key]).output().expect("it runs");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let manifest = root().join("Cargo.toml");
    for (certificate, key, number) in [
        (file("missing.pem"), file("key.pem"), "E2427"),
        (file("certificate.pem"), file("missing.pem"), "E2427"),
        (manifest.clone(), file("key.pem"), "E2427"),
        (file("certificate.pem"), manifest, "E2427"),
        (file("certificate.pem"), file("other_key.pem"), "E2428"),
    ] {
        let (code, text) = run(certificate, key);
        assert!(code == Some(2) && text.contains(number), "{code:?} {text}");
    }
}
