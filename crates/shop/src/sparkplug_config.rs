//! The section `[sparkplug]` of the shop file (SHP-23).
//!
//! Invariant: a broker on another computer is reached with TLS, or the file says `insecure = true`.

use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use serde::Deserialize;

/// The keys of the section, for the nearest one to a misspelt key.
pub(crate) const KEYS: [&str; 10] =
    ["sparkplug", "broker", "group", "user", "password_file", "ca", "certificate", "key", "primary_host", "insecure"];
/// Longest name of a group or host.
const MAX_NAME: usize = 64;

/// How a machine reports to an MQTT broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SparkplugConfig {
    /// Name or address of the broker.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// File with the root certificates of the broker, in PEM; `None` is a connection without TLS.
    pub ca: Option<PathBuf>,
    /// Files with the certificate of this machine, and those that issued it, and with its private key, in PEM.
    pub identity: Option<(PathBuf, PathBuf)>,
    /// Group that the machine belongs to.
    pub group: String,
    /// User.
    pub user: Option<String>,
    /// File whose first line is the password of the user.
    pub password_file: Option<PathBuf>,
    /// Host application that is awaited before each birth.
    pub primary_host: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SparkplugToml {
    broker: String,
    #[serde(default = "default_group")]
    group: String,
    user: Option<String>,
    password_file: Option<PathBuf>,
    ca: Option<PathBuf>,
    certificate: Option<PathBuf>,
    key: Option<PathBuf>,
    primary_host: Option<String>,
    #[serde(default)]
    insecure: bool,
}

fn default_group() -> String {
    "shop".into()
}

impl SparkplugToml {
    /// Checks the section. Relative paths in it begin at the folder of `file`.
    ///
    /// # Errors
    /// `E5021` for a value that is not allowed; `E5022` for a broker on another computer without TLS.
    pub(crate) fn check(self, file: &Path) -> Result<SparkplugConfig, NumberedError> {
        let wrong = |key: &str, value: &str, remedy: &str| {
            let what = format!("{}: [sparkplug] {key} = \"{value}\"", file.display());
            NumberedError::new("E5021", what, remedy)
        };
        let (is_tls, host, port) = address(&self.broker).ok_or_else(|| {
            wrong("broker", &self.broker, "write `mqtts://HOST:PORT`, or `mqtt://HOST:PORT` without TLS")
        })?;
        for (key, name) in [("group", Some(&self.group)), ("primary_host", self.primary_host.as_ref())] {
            if let Some(name) = name.filter(|name| !is_name(name)) {
                let remedy = "use 1 to 64 characters, without `/`, `+`, `#` and control characters";
                return Err(wrong(key, name, remedy));
            }
        }
        if is_tls && host.contains(':') {
            return Err(wrong("broker", &self.broker, "write the name that is in the broker's certificate"));
        }
        if is_tls && self.ca.is_none() {
            let remedy = "name the file of its root certificate: ca = \"root.pem\"";
            return Err(wrong("broker", &self.broker, remedy));
        }
        if !is_tls && self.ca.is_some() {
            return Err(wrong("broker", &self.broker, "write `mqtts://` for TLS, or remove `ca`"));
        }
        let identity = match (self.certificate, self.key) {
            (None, None) => None,
            (Some(certificate), Some(key)) if is_tls => Some((certificate, key)),
            (Some(_), Some(_)) => {
                return Err(wrong(
                    "broker",
                    &self.broker,
                    "write `mqtts://` for TLS, or remove `certificate` and `key`",
                ));
            }
            (Some(file), None) | (None, Some(file)) => {
                let remedy = "name both: certificate = \"mill-3.pem\" and key = \"mill-3.key\"";
                return Err(wrong("certificate and key", &file.display().to_string(), remedy));
            }
        };
        if !is_tls && !is_this_computer(&host) && !self.insecure {
            let what = format!("{}: the connection to the broker {host} would not be encrypted", file.display());
            let remedy = "write `mqtts://` with `ca`; `insecure = true` allows a connection that others can read";
            return Err(NumberedError::new("E5022", what, remedy));
        }
        let beside = |path: PathBuf| file.parent().unwrap_or(Path::new("")).join(path);
        Ok(SparkplugConfig {
            host,
            port,
            ca: self.ca.map(beside),
            identity: identity.map(|(certificate, key)| (beside(certificate), beside(key))),
            group: self.group,
            user: self.user,
            password_file: self.password_file.map(beside),
            primary_host: self.primary_host,
        })
    }
}

impl SparkplugConfig {
    /// Address of the broker, as it is printed.
    #[must_use]
    pub fn address(&self) -> String {
        let scheme = if self.ca.is_some() { "mqtts" } else { "mqtt" };
        format!("{scheme}://{}:{}", self.url_host(), self.port)
    }

    /// The host as it is written before a port.
    pub(crate) fn url_host(&self) -> String {
        if self.host.contains(':') { format!("[{}]", self.host) } else { self.host.clone() }
    }

    /// Whether others on the network can read the connection.
    #[must_use]
    pub fn is_readable_by_others(&self) -> bool {
        self.ca.is_none() && !is_this_computer(&self.host)
    }
}

/// TLS or not, host and port of `mqtt://HOST:PORT`.
fn address(broker: &str) -> Option<(bool, String, u16)> {
    let (scheme, rest) = broker.split_once("://")?;
    let (is_tls, usual) = match scheme {
        "mqtt" => (false, 1883),
        "mqtts" => (true, 8883),
        _ => return None,
    };
    let (host, port) = match rest.strip_prefix('[') {
        // an IPv6 address
        Some(rest) => {
            let (host, port) = rest.split_once(']')?;
            host.parse::<std::net::Ipv6Addr>().ok()?;
            (host, if port.is_empty() { None } else { Some(port.strip_prefix(':')?) })
        }
        None => rest.split_once(':').map_or((rest, None), |(host, port)| (host, Some(port))),
    };
    let is_host = |c: char| c.is_ascii_alphanumeric() || ".-_:".contains(c);
    let port = port.map_or(Some(usual), |port| port.parse().ok().filter(|&port| port > 0))?;
    (!host.is_empty() && host.chars().all(is_host)).then(|| (is_tls, host.to_owned(), port))
}

fn is_this_computer(host: &str) -> bool {
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Whether it is one element of a topic.
fn is_name(name: &str) -> bool {
    let is_allowed = |c: char| !c.is_control() && !"/+#".contains(c);
    (1..=MAX_NAME).contains(&name.chars().count()) && name.chars().all(is_allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str) -> Result<SparkplugConfig, NumberedError> {
        toml::from_str::<SparkplugToml>(text).expect("a section").check(Path::new("/etc/shop.toml"))
    }

    #[test]
    fn a_section_has_its_values() {
        let usual = check("broker = \"mqtt://[::1]\"").expect("a section");
        assert_eq!((usual.address().as_str(), usual.group.as_str()), ("mqtt://[::1]:1883", "shop"));
        let full = check(
            "broker = \"mqtts://mill.example\"\nca = \"root.pem\"\ngroup = \"hall 2\"\nuser = \"m1\"\n\
             password_file = \"/run/secret\"\nprimary_host = \"scada\"\n",
        )
        .expect("a section");
        assert_eq!((full.address().as_str(), full.group.as_str()), ("mqtts://mill.example:8883", "hall 2"));
        assert_eq!((full.ca, full.password_file), (Some("/etc/root.pem".into()), Some("/run/secret".into())));
        assert_eq!((full.user.as_deref(), full.primary_host.as_deref()), (Some("m1"), Some("scada")));
    }

    #[test]
    fn what_is_not_allowed_is_refused() {
        for broker in ["localhost", "http://a", "mqtt://", "mqtt://a:0", "mqtt://a:b", "mqtt://a/b", "mqtt://[a]:1"] {
            assert_eq!(check(&format!("broker = \"{broker}\"")).expect_err(broker).number, "E5021", "{broker}");
        }
        for rest in ["group = \"\"", "group = \"a/b\"", "primary_host = \"+\"", "ca = \"root.pem\""] {
            let refused = check(&format!("broker = \"mqtt://[::1]\"\n{rest}")).expect_err(rest);
            assert_eq!(refused.number, "E5021", "{rest}");
        }
        for tls in ["mqtts://mill.example", "mqtts://[::1]\"\nca = \"root.pem"] {
            assert_eq!(check(&format!("broker = \"{tls}\"")).expect_err(tls).number, "E5021", "{tls}");
        }
    }

    #[test]
    fn a_broker_elsewhere_needs_tls_or_the_word_insecure() {
        for host in ["mill.example", "192.168.1.7", "[fe80::1]"] {
            let broker = format!("broker = \"mqtt://{host}:1883\"\n");
            assert_eq!(check(&broker).expect_err(host).number, "E5022", "{host}");
            assert!(check(&format!("{broker}insecure = true")).expect("allowed").is_readable_by_others(), "{host}");
        }
        for host in ["localhost", "127.0.0.1", "[::1]"] {
            let own = check(&format!("broker = \"mqtt://{host}\"")).expect(host);
            assert!(!own.is_readable_by_others(), "{host}");
        }
    }

    #[test]
    fn a_certificate_of_the_machine_has_its_key_and_needs_tls() {
        let tls = "broker = \"mqtts://mill.example\"\nca = \"root.pem\"\n";
        let both = "certificate = \"m.pem\"\nkey = \"m.key\"\n";
        assert!(check(&format!("{tls}{both}")).expect("allowed").identity.is_some());
        assert!(check(tls).expect("allowed").identity.is_none());
        for wrong in [
            format!("{tls}certificate = \"m.pem\""),
            format!("{tls}key = \"m.key\""),
            format!("broker = \"mqtt://{}\"\n{both}", "localhost"),
        ] {
            assert_eq!(check(&wrong).expect_err("refused").number, "E5021", "{wrong}");
        }
    }
}
