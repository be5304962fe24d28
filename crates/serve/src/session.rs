//! Sessions: which rights a request has, by its cookie or its key.
//!
//! Invariant: a secret is compared in a time that does not depend on where it differs, and is never written to a page,
//! a log or an address that is sent.

use std::collections::HashMap;
use std::net::IpAddr;
use std::time::{Duration, Instant};

use axum::http::{HeaderMap, header};

/// Number of wrong tokens from one address within [`WINDOW`] after which it must wait.
const MAX_WRONG: u32 = 5;

/// Time in which wrong tokens are counted.
const WINDOW: Duration = Duration::from_secs(60);

/// Maximum number of addresses whose wrong tokens are counted.
const MAX_ADDRESSES: usize = 1_000;

/// Maximum number of sessions; the oldest one ends where there are more.
const MAX_SESSIONS: usize = 256;

/// Time after which a session ends.
const SESSION_TIME: Duration = Duration::from_secs(30 * 24 * 3600);

/// Attributes of the cookie, without and with TLS.
const PLAIN: &str = "HttpOnly; SameSite=Strict; Path=/";
const SECURE: &str = "Secure; HttpOnly; SameSite=Strict; Path=/";

/// What a session may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rights {
    /// Store programs, and nothing else.
    Upload,
    /// Watch, and hold.
    Watch,
    /// Everything.
    Operate,
}

impl Rights {
    /// Name as an identifier.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Upload => "upload",
            Self::Watch => "watch",
            Self::Operate => "operate",
        }
    }

    /// Whether these rights include others.
    pub(crate) fn include(self, needed: Self) -> bool {
        match needed {
            Self::Upload => self != Self::Watch,
            Self::Watch => self != Self::Upload,
            Self::Operate => self == Self::Operate,
        }
    }
}

/// A secret of 128 random bits, in hexadecimal.
///
/// # Errors
/// The system has no random numbers.
pub(crate) fn new_secret() -> Result<String, getrandom::Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The keys of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Keys {
    /// Token of the address that the command prints.
    pub(crate) operate: String,
    /// Token of an address for watching.
    pub(crate) watch: String,
    /// Key for uploads, if they are permitted.
    pub(crate) upload: Option<String>,
}

impl Keys {
    /// New keys.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub(crate) fn new(permits_uploads: bool) -> Result<Self, getrandom::Error> {
        let upload = if permits_uploads { Some(new_secret()?) } else { None };
        Ok(Self { operate: new_secret()?, watch: new_secret()?, upload })
    }

    /// Rights of a key.
    fn rights(&self, key: &str) -> Option<Rights> {
        let known = [
            (Some(&self.operate), Rights::Operate),
            (Some(&self.watch), Rights::Watch),
            (self.upload.as_ref(), Rights::Upload),
        ];
        // Every key is compared, so that the time is the same for all.
        known.into_iter().filter(|(known, _)| known.is_some_and(|known| is_same(known, key))).map(|(_, it)| it).next()
    }
}

/// Compares in a time that does not depend on where the texts differ.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
}

#[derive(Clone, Copy, Debug)]
struct Session {
    rights: Rights,
    begun: Instant,
}

/// Why no session begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LoginError {
    /// The token is wrong.
    WrongToken,
    /// Too many wrong tokens came from this address.
    TooMany,
    /// The system has no random numbers.
    NoRandomNumbers,
}

impl std::fmt::Display for LoginError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::WrongToken => "the token is wrong",
            Self::TooMany => "too many wrong tokens came from this address",
            Self::NoRandomNumbers => "the system has no random numbers",
        })
    }
}

impl std::error::Error for LoginError {}

/// The sessions of a server.
#[derive(Debug)]
pub(crate) struct Sessions {
    keys: Keys,
    cookie: String,
    /// What a cookie has after its value.
    attributes: &'static str,
    sessions: HashMap<String, Session>,
    wrong: HashMap<IpAddr, (Instant, u32)>,
}

impl Sessions {
    /// No sessions yet.
    pub(crate) fn new(keys: Keys) -> Self {
        Self { keys, cookie: String::new(), attributes: PLAIN, sessions: HashMap::new(), wrong: HashMap::new() }
    }

    /// Names the cookie. Cookies ignore ports, so that the port is in the cookie's name.
    /// Over TLS it is bound to this host and never sent in the clear.
    pub(crate) fn set_port(&mut self, port: u16, is_secure: bool) {
        (self.cookie, self.attributes) = match is_secure {
            true => (format!("__Host-retrace-{port}"), SECURE),
            false => (format!("retrace-{port}"), PLAIN),
        };
    }

    /// Begins a session with a token. Returns its rights and the header that sets its cookie.
    pub(crate) fn begin(&mut self, token: &str, from: IpAddr, now: Instant) -> Result<(Rights, String), LoginError> {
        let is_recent = |since: Instant| now.duration_since(since) < WINDOW;
        let count = self.wrong.get(&from).filter(|(since, _)| is_recent(*since)).map_or(0, |(_, count)| *count);
        if count >= MAX_WRONG {
            return Err(LoginError::TooMany);
        }
        let Some(rights) = self.keys.rights(token) else {
            self.wrong.retain(|_, (since, _)| is_recent(*since));
            if self.wrong.len() < MAX_ADDRESSES || self.wrong.contains_key(&from) {
                self.wrong.entry(from).or_insert((now, 0)).1 += 1;
            }
            return Err(LoginError::WrongToken);
        };
        let secret = new_secret().map_err(|_| LoginError::NoRandomNumbers)?;
        self.sessions.retain(|_, session| now.duration_since(session.begun) < SESSION_TIME);
        if self.sessions.len() >= MAX_SESSIONS {
            let oldest =
                self.sessions.iter().min_by_key(|(_, session)| session.begun).map(|(secret, _)| secret.clone());
            oldest.and_then(|oldest| self.sessions.remove(&oldest));
        }
        let seconds = SESSION_TIME.as_secs();
        let cookie = format!("{}={secret}; {}; Max-Age={seconds}", self.cookie, self.attributes);
        self.sessions.insert(secret, Session { rights, begun: now });
        Ok((rights, cookie))
    }

    /// Ends the session of a request. Returns the header that removes its cookie.
    pub(crate) fn end(&mut self, headers: &HeaderMap) -> String {
        if let Some(secret) = self.cookie_of(headers).map(str::to_owned) {
            self.sessions.remove(&secret);
        }
        format!("{}=; {}; Max-Age=0", self.cookie, self.attributes)
    }

    fn cookie_of<'h>(&self, headers: &'h HeaderMap) -> Option<&'h str> {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.find(|(name, _)| *name == self.cookie).map(|(_, secret)| secret)
    }

    /// Rights of a request, by its cookie, or by a key in its header, as programs send it.
    pub(crate) fn rights(&self, headers: &HeaderMap, now: Instant) -> Option<Rights> {
        self.credential(headers, now).map(|(rights, _)| rights)
    }

    /// Rights of a request, with the secret of its session or the key that gives them.
    pub(crate) fn credential<'h>(&self, headers: &'h HeaderMap, now: Instant) -> Option<(Rights, &'h str)> {
        let of_session = self.cookie_of(headers).and_then(|secret| {
            let session = self.sessions.get(secret)?;
            (now.duration_since(session.begun) < SESSION_TIME).then_some((session.rights, secret))
        });
        of_session.or_else(|| {
            let text = |name: &str| headers.get(name).and_then(|value| value.to_str().ok());
            let bearer = text("authorization").and_then(|value| value.strip_prefix("Bearer "));
            let mut keys = [bearer, text("x-api-key")].into_iter().flatten();
            keys.find_map(|key| self.keys.rights(key).map(|rights| (rights, key)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(name: &'static str, value: &str) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(name, value.parse().expect("a header"));
        headers
    }

    fn sessions() -> (Sessions, Keys) {
        let keys = Keys::new(true).expect("random numbers");
        let mut sessions = Sessions::new(keys.clone());
        sessions.set_port(8181, false);
        (sessions, keys)
    }

    const HOME: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

    #[test]
    fn a_token_becomes_a_cookie_and_the_cookie_has_its_rights() {
        let (mut sessions, keys) = sessions();
        let now = Instant::now();
        let (rights, cookie) = sessions.begin(&keys.operate, HOME, now).expect("the right token");
        assert_eq!(rights, Rights::Operate);
        assert!(cookie.contains("HttpOnly; SameSite=Strict") && !cookie.contains(&keys.operate), "{cookie}");
        let pair = cookie.split(';').next().expect("a pair");
        let sent = headers("cookie", &format!("other=1; {pair}"));
        assert_eq!(sessions.rights(&sent, now), Some(Rights::Operate));
        assert_eq!(sessions.rights(&sent, now + SESSION_TIME), None, "it ends");
        assert_eq!(sessions.rights(&headers("cookie", &pair.replace("8181", "8182")), now), None);
        sessions.end(&sent);
        assert_eq!(sessions.rights(&sent, now), None);
    }

    #[test]
    fn over_tls_the_cookie_is_secure_and_of_this_host() {
        let (mut sessions, keys) = sessions();
        sessions.set_port(8181, true);
        let (_, cookie) = sessions.begin(&keys.watch, HOME, Instant::now()).expect("the right token");
        assert!(cookie.starts_with("__Host-retrace-8181=") && cookie.contains("; Secure; HttpOnly;"), "{cookie}");
        let pair = cookie.split(';').next().expect("a pair");
        assert_eq!(sessions.rights(&headers("cookie", pair), Instant::now()), Some(Rights::Watch));
        let plain = pair.replace("__Host-", "");
        assert_eq!(sessions.rights(&headers("cookie", &plain), Instant::now()), None);
    }

    #[test]
    fn keys_have_their_rights_and_no_others() {
        let (sessions, keys) = sessions();
        let (now, upload) = (Instant::now(), keys.upload.expect("permitted"));
        assert_eq!(sessions.rights(&headers("x-api-key", &upload), now), Some(Rights::Upload));
        assert_eq!(
            sessions.rights(&headers("authorization", &format!("Bearer {}", keys.watch)), now),
            Some(Rights::Watch)
        );
        for wrong in ["", "00", &keys.watch[1..]] {
            assert_eq!(sessions.rights(&headers("x-api-key", wrong), now), None);
        }
        assert!(!Rights::Upload.include(Rights::Watch) && !Rights::Watch.include(Rights::Upload));
        assert!(Rights::Operate.include(Rights::Upload) && !Rights::Watch.include(Rights::Operate));
    }

    #[test]
    fn wrong_tokens_are_counted_for_each_address() {
        let (mut sessions, keys) = sessions();
        let (now, other) = (Instant::now(), IpAddr::V4(std::net::Ipv4Addr::new(192, 168, 1, 7)));
        for _ in 0..MAX_WRONG {
            assert_eq!(sessions.begin("wrong", HOME, now).expect_err("wrong"), LoginError::WrongToken);
        }
        assert_eq!(sessions.begin(&keys.operate, HOME, now).expect_err("too many"), LoginError::TooMany);
        assert!(sessions.begin(&keys.operate, other, now).is_ok());
        assert!(sessions.begin(&keys.operate, HOME, now + WINDOW).is_ok());
    }
}
