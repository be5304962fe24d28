//! Guard of every request: it must be addressed to this server, and a page that sends it must be this server's own.
//!
//! Invariant: a name that an attacker has rebound to this address is refused, and so is a page from elsewhere.
//! Browsers do not apply the same-origin rule to WebSockets, so that the origin is checked here.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Headers of every answer.
const SECURITY_HEADERS: [(&str, &str); 6] = [
    (
        "content-security-policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    ("x-content-type-options", "nosniff"),
    ("referrer-policy", "no-referrer"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    ("permissions-policy", "camera=(), microphone=(), geolocation=()"),
];

/// Names by which this server may be addressed.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    names: Arc<[String]>,
    port: u16,
    is_secure: bool,
}

impl Guard {
    /// Guard of a server at this port, which may also be addressed by a name.
    pub(crate) fn new(port: u16, name: Option<&str>, is_secure: bool) -> Self {
        let names = ["localhost"].into_iter().chain(name).map(str::to_ascii_lowercase);
        Self { names: names.collect(), port, is_secure }
    }

    /// Whether a `Host` is one of this server: a known name, or an address as such. An address cannot be rebound.
    fn is_own_host(&self, host: &str) -> bool {
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !port.contains(']') => (name, port.parse::<u16>().ok()),
            _ => (host, Some(if self.is_secure { 443 } else { 80 })),
        };
        if port != Some(self.port) {
            return false;
        }
        let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        address.parse::<IpAddr>().is_ok() || self.names.iter().any(|own| name.eq_ignore_ascii_case(own))
    }

    /// Whether a request is addressed to this server, and comes from its own page or from no page.
    fn permits(&self, headers: &HeaderMap) -> bool {
        let text = |name| headers.get(name).map(|value: &HeaderValue| value.to_str().unwrap_or("?"));
        let Some(host) = text(header::HOST) else { return false };
        let origin_is_own = text(header::ORIGIN).is_none_or(|origin| {
            let plain = origin.strip_prefix("http://").filter(|_| !self.is_secure);
            // Without TLS here, something before this server may add it.
            plain.or_else(|| origin.strip_prefix("https://")) == Some(host)
        });
        let site = headers.get("sec-fetch-site").map(|value| value.to_str().unwrap_or("?"));
        let site_is_own = site.is_none_or(|site| matches!(site, "same-origin" | "none"));
        self.is_own_host(host) && origin_is_own && site_is_own
    }
}

/// Refuses a request that is not permitted, and adds the headers to every answer.
pub(crate) async fn guard_requests(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    let mut response = if guard.permits(request.headers()) {
        next.run(request).await
    } else {
        (StatusCode::FORBIDDEN, "wrong Host or Origin\n").into_response()
    };
    for (name, value) in SECURITY_HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_own_names_and_addresses_are_hosts() {
        let guard = Guard::new(8181, Some("table.local"), false);
        for own in
            ["127.0.0.1:8181", "localhost:8181", "LOCALHOST:8181", "[::1]:8181", "192.168.1.5:8181", "table.local:8181"]
        {
            assert!(guard.is_own_host(own), "{own}");
        }
        for foreign in [
            "",
            "127.0.0.1",
            "127.0.0.1:80",
            "127.0.0.1.attacker.example:8181",
            "attacker.example:8181",
            "localhost.attacker.example:8181",
            "table.local.attacker.example:8181",
            "127.0.0.1:8181:8181",
            "[::1:8181",
        ] {
            assert!(!guard.is_own_host(foreign), "{foreign}");
        }
    }

    #[test]
    fn pages_from_elsewhere_are_refused() {
        let guard = Guard::new(8181, None, false);
        let with = |pairs: &[(&'static str, &str)]| {
            let mut headers = HeaderMap::new();
            for &(name, value) in pairs {
                headers.insert(name, value.parse().expect("a value"));
            }
            guard.permits(&headers)
        };
        let origin = |host: &str| format!("http:{}{host}", "//");
        let host = ("host", "127.0.0.1:8181");
        assert!(with(&[host]) && with(&[host, ("origin", &origin("127.0.0.1:8181"))]));
        assert!(with(&[host, ("sec-fetch-site", "same-origin")]) && with(&[host, ("sec-fetch-site", "none")]));
        assert!(!with(&[]) && !with(&[host, ("origin", "null")]));
        assert!(!with(&[host, ("origin", &origin("attacker.example"))]));
        assert!(!with(&[host, ("origin", &origin("localhost:8181"))]), "another name is another origin");
        assert!(!with(&[host, ("sec-fetch-site", "cross-site")]) && !with(&[host, ("sec-fetch-site", "same-site")]));
    }

    #[test]
    fn over_tls_only_pages_of_tls_are_its_own() {
        let guard = Guard::new(443, None, true);
        let with = |scheme: &str| {
            let mut headers = HeaderMap::new();
            headers.insert("host", "127.0.0.1".parse().expect("a value"));
            headers.insert("origin", format!("{scheme}:{}127.0.0.1", "//").parse().expect("a value"));
            guard.permits(&headers)
        };
        assert!(with("https") && !with("http"));
    }
}
