//! The part `[broker]` of a shop file: the server that connects the computers of a shop, and whom a machine trusts.
//!
//! Invariant: without `insecure`, nothing is sent unencrypted to another computer (SHP-23).

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::state_file;
use serde::Deserialize;

use crate::machine_name::MachineName;

/// Keys of `[broker]`.
pub(crate) const BROKER_KEYS: [&str; 6] = ["servers", "seed", "ca", "insecure", "groups", "submitters"];
/// Maximum number of servers, groups and submitters.
const MAX_ENTRIES: usize = 1000;

/// Settings of the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerSettings {
    /// Servers of one cluster, `nats://HOST:PORT` or `tls://HOST:PORT`.
    pub servers: Vec<String>,
    /// File with the seed of this computer's key.
    pub seed: PathBuf,
    /// File with the root certificates that the servers are verified with; `None` takes those of the system.
    pub ca: Option<PathBuf>,
    /// Whether an unencrypted connection to another computer is allowed.
    pub is_insecure: bool,
    /// Groups whose jobs this machine takes.
    pub groups: Vec<MachineName>,
    /// Public keys whose jobs this machine takes, with the name of each.
    pub submitters: BTreeMap<String, String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BrokerToml {
    servers: Vec<String>,
    seed: PathBuf,
    ca: Option<PathBuf>,
    #[serde(default)]
    insecure: bool,
    #[serde(default)]
    groups: Vec<String>,
    #[serde(default)]
    submitters: BTreeMap<String, String>,
}

impl BrokerToml {
    /// Checks the settings; `beside` makes a path relative to the shop file.
    ///
    /// # Errors
    /// What is wrong, and its remedy.
    pub(crate) fn settings(self, beside: impl Fn(PathBuf) -> PathBuf) -> Result<BrokerSettings, (String, String)> {
        let is_too_many = self.servers.len().max(self.groups.len()).max(self.submitters.len()) > MAX_ENTRIES;
        if self.servers.is_empty() || is_too_many {
            return Err(("[broker]: no servers, or too many entries".into(), "name one to 1000".into()));
        }
        for server in &self.servers {
            check_server(server, self.insecure)?;
        }
        for (name, key) in &self.submitters {
            if name.is_empty() || name.len() > 100 || name.chars().any(char::is_control) {
                return Err((format!("[broker.submitters]: `{}` is not a name", name.escape_default()), NAME.into()));
            }
            if !is_public_key(key) {
                let remedy = "`retrace shop key FILE` prints the public key of a seed; it begins with U";
                return Err((format!("[broker.submitters]: {name} = {key:?} is not a public key"), remedy.into()));
            }
        }
        let groups = self.groups.iter().map(|name| MachineName::parse(name));
        let groups = groups
            .collect::<Result<_, NumberedError>>()
            .map_err(|error| (error.cause.clone(), error.remedy.clone()))?;
        // by key: the name of a sender is looked up for each message
        let submitters = self.submitters.into_iter().map(|(name, key)| (key, name)).collect();
        Ok(BrokerSettings {
            servers: self.servers,
            seed: credential(&self.seed, credentials().as_deref()).unwrap_or_else(|| beside(self.seed)),
            ca: self.ca.map(beside),
            is_insecure: self.insecure,
            groups,
            submitters,
        })
    }
}

const NAME: &str = "use one line of at most 100 bytes";

fn is_public_key(key: &str) -> bool {
    key.starts_with('U') && nkeys::KeyPair::from_public_key(key).is_ok()
}

fn check_server(server: &str, is_insecure: bool) -> Result<(), (String, String)> {
    let wrong = |remedy: &str| Err((format!("[broker]: {server:?} cannot be used"), remedy.to_owned()));
    let Some((scheme, rest)) = server.split_once("://") else {
        return wrong("write `tls://HOST:PORT`, or `nats://HOST:PORT` on one computer");
    };
    let host = rest
        .strip_prefix('[')
        .and_then(|rest| rest.split_once(']'))
        .map_or_else(|| rest.rsplit_once(':').map_or(rest, |(host, _)| host), |(host, _)| host);
    let is_here = host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback());
    match scheme {
        _ if host.is_empty() || rest.contains(['/', '@', ' ', ',']) => wrong("write HOST:PORT behind the scheme"),
        "tls" => Ok(()),
        "nats" if is_here || is_insecure => Ok(()),
        "nats" => wrong("write `tls://`, or set `insecure = true` if everyone on that network may read the programs"),
        _ => wrong("the scheme is `tls` or `nats`"),
    }
}

/// Folder with the credentials that systemd gives to this service (`LoadCredential=`, systemd.exec(5)); `None` where it
/// is not started so.
fn credentials() -> Option<PathBuf> {
    std::env::var_os("CREDENTIALS_DIRECTORY").map(PathBuf::from)
}

/// The credential of this name, if the service has it. A name with a path in it is that of a file.
fn credential(name: &Path, folder: Option<&Path>) -> Option<PathBuf> {
    let path = folder?.join(name.file_name().filter(|file| Path::new(file) == name)?);
    path.is_file().then_some(path)
}

/// Reads the seed of a key: the first line of the file that begins with `SU`.
///
/// # Errors
/// `E5036` where the file cannot be read, others can read it, or it has no seed of a user.
pub(crate) fn read_seed(path: &Path) -> Result<nkeys::KeyPair, NumberedError> {
    read_protected_seed(path, credentials().as_deref())
}

/// Reads a seed, as [`read_seed`]. Who can read a credential is up to systemd, which shows the access of the service
/// as that of a group.
fn read_protected_seed(path: &Path, credentials: Option<&Path>) -> Result<nkeys::KeyPair, NumberedError> {
    let unusable = |why: String| {
        let what = format!("{}: {why}", path.display());
        let remedy = "name the file with this computer's seed, which only its user can read; `retrace shop key --new \
                      FILE` makes one";
        NumberedError::new("E5036", what, remedy)
    };
    let text = std::fs::read_to_string(path).map_err(|error| unusable(error.to_string()))?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(path).map_err(|error| unusable(error.to_string()))?.permissions().mode();
        if mode & 0o077 != 0 && !credentials.is_some_and(|folder| path.starts_with(folder)) {
            return Err(unusable(format!("its mode is {:o}, so that others can read it", mode & 0o777)));
        }
    }
    let seed = text.lines().map(str::trim).find(|line| line.starts_with("SU"));
    let seed = seed.ok_or_else(|| unusable("it has no line that begins with SU".into()))?;
    nkeys::KeyPair::from_seed(seed).map_err(|error| unusable(error.to_string()))
}

/// Public key of the seed in a file.
///
/// # Errors
/// `E5036`
pub fn public_key(path: &Path) -> Result<String, NumberedError> {
    Ok(read_seed(path)?.public_key())
}

/// Makes a new seed in a new file that only its user can read. Returns its public key.
///
/// # Errors
/// `E5036` where the file exists or cannot be written.
pub fn new_seed(path: &Path) -> Result<String, NumberedError> {
    let unusable = |why: String| {
        let what = format!("{}: {why}", path.display());
        NumberedError::new("E5036", what, "name a new file in a folder that can be written")
    };
    let mut random = [0; 32];
    getrandom::fill(&mut random).map_err(|error| unusable(error.to_string()))?;
    let key = nkeys::KeyPair::new_from_raw(nkeys::KeyPairType::User, random);
    let key = key.map_err(|error| unusable(error.to_string()))?;
    let seed = key.seed().map_err(|error| unusable(error.to_string()))?;
    let write = || {
        let mut file = state_file::private().write(true).create_new(true).open(path)?;
        file.write_all(format!("{seed}\n").as_bytes())?;
        file.sync_all()
    };
    write().map_err(|error: std::io::Error| unusable(error.to_string()))?;
    Ok(key.public_key())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(text: &str) -> Result<BrokerSettings, (String, String)> {
        let toml: BrokerToml = toml::from_str(text).expect("a table");
        toml.settings(|path| Path::new("/shop").join(path))
    }

    #[test]
    fn nothing_goes_unencrypted_to_another_computer_unless_it_is_allowed() {
        for (scheme, rest, is_allowed) in [
            ("nats", "127.0.0.1:4222", true),
            ("nats", "localhost", true),
            ("nats", "[::1]:4222", true),
            ("tls", "broker.shop:4222", true),
            ("nats", "broker.shop:4222", false),
            ("nats", "127.0.0.1.example.com:4222", false),
            ("nats", "127.0.0.1@broker.shop:4222", false),
            ("ws", "127.0.0.1", false),
            ("nats", "", false),
        ] {
            let server = format!("{scheme}://{rest}");
            let found = settings(&format!("servers = [{server:?}]\nseed = \"seed\""));
            assert_eq!(found.is_ok(), is_allowed, "{server}: {found:?}");
        }
        let found =
            settings("servers = [\"nats://broker.shop:4222\"]\nseed = \"seed\"\ninsecure = true").expect("good");
        assert_eq!(found.seed, Path::new("/shop/seed"));
        settings("servers = [\"127.0.0.1:4222\"]\nseed = \"seed\"").expect_err("no scheme");
        settings("servers = []\nseed = \"seed\"").expect_err("none");
    }

    #[test]
    fn submitters_are_found_by_their_keys_and_a_seed_that_others_can_read_is_refused() {
        let key = nkeys::KeyPair::new_user();
        let server = format!("nats://{}", "localhost");
        let text = format!("servers = [{server:?}]\nseed = \"s\"\n[submitters]\nann = \"{}\"", key.public_key());
        assert_eq!(settings(&text).expect("good").submitters[&key.public_key()], "ann");
        settings(&text.replace("\"U", "\"X")).expect_err("no key");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("seed");
        std::fs::write(&path, key.seed().expect("a seed")).expect("written");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o644)).expect("set");
            assert_eq!(read_seed(&path).expect_err("readable").number, "E5036");
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).expect("set");
        }
        assert_eq!(read_seed(&path).expect("a seed").public_key(), key.public_key());
        // A credential of systemd is found by its name, and its group is that of the service.
        assert_eq!(credential(Path::new("seed"), Some(folder.path())), Some(path.clone()));
        assert_eq!(credential(&path, Some(folder.path())), None, "a whole path is that of a file");
        assert_eq!(credential(Path::new("other"), Some(folder.path())), None);
        let way_out = Path::new("..").join(folder.path().file_name().expect("a name")).join("seed");
        assert_eq!(credential(&way_out, Some(folder.path())), None, "out of the folder");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).expect("set");
            assert_eq!(read_protected_seed(&path, None).expect_err("readable").number, "E5036");
            let elsewhere = folder.path().join("other");
            assert_eq!(read_protected_seed(&path, Some(&elsewhere)).expect_err("readable").number, "E5036");
            let found = read_protected_seed(&path, Some(folder.path())).expect("a seed");
            assert_eq!(found.public_key(), key.public_key());
        }
        std::fs::write(&path, "nothing").expect("written");
        assert_eq!(read_seed(&path).expect_err("no seed").number, "E5036");
    }
}
