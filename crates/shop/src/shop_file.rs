//! The shop file of a machine, `shop.toml`.
//!
//! Invariant: without a file everything has a value; an unknown key is refused.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use retrace_config::{NumberedError, nearest};
use retrace_journal::JobStore;
use serde::Deserialize;

use crate::broker::BrokerSettings;
use crate::broker::broker_settings::{BROKER_KEYS, BrokerToml};
use crate::inbox_limits::InboxLimits;
use crate::machine_folder::{MachineFolder, unusable};
use crate::machine_name::MachineName;
use crate::sparkplug_config::{self, SparkplugConfig, SparkplugToml};

/// Bytes of a GiB.
const GIB: f64 = 1_073_741_824.0;
/// The keys of the file, and those of `[watch]`.
const KEYS: [&str; 12] = [
    "name",
    "root",
    "inbox_gib",
    "machine_file",
    "watch",
    "broker",
    "path",
    "machine",
    "done",
    "failed",
    "allow_repeats",
    "ready_file",
];

/// Settings of a machine in a shop.
#[derive(Clone, Debug, PartialEq)]
pub struct ShopFile {
    /// Name of this machine.
    pub name: MachineName,
    /// Root of the shop's folders.
    pub root: PathBuf,
    /// How much the inbox may take.
    pub limits: InboxLimits,
    /// The machine file that jobs are checked against; `None` is the built-in machine.
    pub machine_file: Option<PathBuf>,
    /// The watched folder.
    pub watch: Option<WatchConfig>,
    /// The broker between the computers of the shop.
    pub broker: Option<BrokerSettings>,
    /// How the machine reports to an MQTT broker.
    pub sparkplug: Option<SparkplugConfig>,
}

/// A watched folder: files that arrive there are submitted (SHP-35).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WatchConfig {
    /// The folder.
    pub path: PathBuf,
    /// Machine that the jobs are for.
    pub machine: MachineName,
    /// Folder for files that were submitted.
    pub done: PathBuf,
    /// Folder for files that were not.
    pub failed: PathBuf,
    /// Whether a file of the same name and content is another job.
    pub allow_repeats: bool,
    /// Whether a file is whole when `NAME.ready` lies beside it, and not before.
    pub needs_ready_file: bool,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ShopToml {
    name: Option<String>,
    root: Option<PathBuf>,
    inbox_gib: Option<f64>,
    machine_file: Option<PathBuf>,
    watch: Option<WatchToml>,
    broker: Option<BrokerToml>,
    sparkplug: Option<SparkplugToml>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WatchToml {
    path: PathBuf,
    machine: Option<String>,
    done: Option<PathBuf>,
    failed: Option<PathBuf>,
    #[serde(default)]
    allow_repeats: bool,
    #[serde(default)]
    ready_file: bool,
}

impl ShopFile {
    /// Reads a shop file: the one that is named, or `shop.toml` in the user's state folder if it exists.
    ///
    /// # Errors
    /// `E5001` where it is not a shop file, or there is no folder for the shop; `E5010` where it cannot be read.
    pub fn load(path: Option<&Path>) -> Result<Self, NumberedError> {
        let state = JobStore::state_folder();
        let usual = state.as_ref().map(|folder| folder.join("shop.toml"));
        let Some(file) = path.or(usual.as_deref()) else {
            let what = "no folder for the shop: neither XDG_STATE_HOME nor HOME names one";
            return Err(NumberedError::new("E5001", what, "name a shop file with a `root` by --shop FILE.toml"));
        };
        let text = match fs::read_to_string(file) {
            Ok(text) => text,
            Err(error) if path.is_none() && error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => return Err(unusable(file, &error)),
        };
        Self::parse(&text, file, state.as_deref())
    }

    /// Parses the text of a shop file. Relative paths in it begin at its folder; `state` is the user's state folder.
    ///
    /// # Errors
    /// `E5001` for a text that is not a shop file, with line and column; `E5002` for the name of a machine; `E5021`,
    /// `E5022` for the section `[sparkplug]`.
    pub fn parse(text: &str, file: &Path, state: Option<&Path>) -> Result<Self, NumberedError> {
        let wrong =
            |why: &str, remedy: String| NumberedError::new("E5001", format!("{}: {why}", file.display()), remedy);
        let toml: ShopToml = toml::from_str(text)
            .map_err(|error| wrong(error.to_string().trim_end(), misread_remedy(error.message())))?;
        let beside = |path: PathBuf| file.parent().unwrap_or(Path::new("")).join(path);
        let name = toml.name.as_deref().map_or(Ok(MachineName::local()), MachineName::parse)?;
        let root = toml.root.map(beside).or_else(|| state.map(|folder| folder.join("shop")));
        let root =
            root.ok_or_else(|| wrong("it names no root, and the user has no state folder", "set `root`".into()))?;
        let gib = toml.inbox_gib.unwrap_or(2.0);
        if !(gib > 0.0 && gib <= 1024.0) {
            return Err(wrong(&format!("inbox_gib = {gib}"), "set a number above 0, up to 1024".into()));
        }
        let limits = InboxLimits { max_bytes: (gib * GIB) as u64, ..InboxLimits::default() };
        let watch = toml.watch.map(|watch| {
            let path = beside(watch.path);
            let machine = watch.machine.as_deref().map_or(Ok(name.clone()), MachineName::parse)?;
            Ok(WatchConfig {
                done: watch.done.map_or_else(|| path.join("done"), beside),
                failed: watch.failed.map_or_else(|| path.join("failed"), beside),
                path,
                machine,
                allow_repeats: watch.allow_repeats,
                needs_ready_file: watch.ready_file,
            })
        });
        let machine_file = toml.machine_file.map(beside);
        let broker = toml.broker.map(|broker| broker.settings(beside).map_err(|(why, remedy)| wrong(&why, remedy)));
        let sparkplug = toml.sparkplug.map(|section| section.check(file)).transpose()?;
        let watch = watch.transpose()?;
        Ok(Self { name, root, limits, machine_file, watch, broker: broker.transpose()?, sparkplug })
    }

    /// The folder of this machine.
    #[must_use]
    pub fn machine_folder(&self) -> MachineFolder {
        MachineFolder::of(&self.root, &self.name)
    }

    /// The folder of a machine of this root.
    ///
    /// # Errors
    /// `E5003` where there is none of this name.
    pub fn folder_of(&self, name: &MachineName) -> Result<MachineFolder, NumberedError> {
        let folder = MachineFolder::of(&self.root, name);
        if *name == self.name || folder.exists() {
            return Ok(folder);
        }
        let what = format!("there is no machine {name} in {}", self.root.display());
        let known = MachineFolder::all(&self.root)?;
        let remedy = match nearest(name.as_str(), known.iter().map(|known| known.name().as_str())) {
            Some(near) => format!("did you mean {near}?"),
            None => format!("this machine is {}; another one begins with its own `retrace shop agent`", self.name),
        };
        Err(NumberedError::new("E5003", what, remedy))
    }
}

/// What may have been meant by an unknown key.
fn misread_remedy(message: &str) -> String {
    let key = message.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next());
    match key.and_then(|key| nearest(key, KEYS.into_iter().chain(BROKER_KEYS).chain(sparkplug_config::KEYS))) {
        Some(near) => format!("did you mean `{near}`?"),
        None => "correct the line; docs/shop.md describes the keys of a shop file".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<ShopFile, NumberedError> {
        ShopFile::parse(text, Path::new("/etc/shop.toml"), Some(Path::new("/state")))
    }

    #[test]
    fn an_empty_file_has_every_value_and_paths_begin_at_the_file() {
        let empty = parse("").expect("a shop file");
        assert_eq!((empty.name.as_str(), empty.root.as_path()), ("local", Path::new("/state/shop")));
        assert_eq!((empty.limits, &empty.machine_file, &empty.watch), (InboxLimits::default(), &None, &None));
        let full = parse(
            "name = \"mill-3\"\nroot = \"data\"\ninbox_gib = 0.5\nmachine_file = \"mill.toml\"\n[watch]\n\
             path = \"in\"\ndone = \"/done\"\nallow_repeats = true\nready_file = true\n",
        )
        .expect("a shop file");
        assert_eq!(full.root, Path::new("/etc/data"));
        assert_eq!((full.limits.max_bytes, full.machine_file), (1 << 29, Some("/etc/mill.toml".into())));
        let watch = full.watch.expect("a folder");
        assert_eq!((watch.machine.as_str(), watch.path.as_path()), ("mill-3", Path::new("/etc/in")));
        assert_eq!((watch.done.as_path(), watch.failed.as_path()), (Path::new("/done"), Path::new("/etc/in/failed")));
        assert!(watch.allow_repeats && watch.needs_ready_file);
    }

    #[test]
    fn what_is_not_a_shop_file_is_refused_with_its_line() {
        let refusal = parse("name = \"a\"\nrot = \"x\"\n").expect_err("misspelt");
        assert_eq!((refusal.number, refusal.remedy.as_str()), ("E5001", "did you mean `root`?"));
        assert!(refusal.cause.contains("line 2"), "{}", refusal.cause);
        for bad in
            ["inbox_gib = 0", "inbox_gib = nan", "inbox_gib = 2000", "[watch]\n", "[watch]\npath = 1\n", "servers = []"]
        {
            assert_eq!(parse(bad).expect_err(bad).number, "E5001", "{bad}");
        }
        assert_eq!(parse("name = \"Mill\"").expect_err("a name").number, "E5002");
        assert_eq!(ShopFile::parse("", Path::new("f"), None).expect_err("no root").number, "E5001");
        assert_eq!(ShopFile::load(Some(Path::new("/no/such/file"))).expect_err("missing").number, "E5010");
    }

    #[test]
    fn a_machine_that_is_not_there_is_named() {
        let root = tempfile::tempdir().expect("a folder");
        let file = ShopFile { root: root.path().into(), ..parse("").expect("a shop file") };
        let mill = MachineName::parse("mill").expect("a name");
        file.folder_of(&file.name).expect("its own");
        assert_eq!(file.folder_of(&mill).expect_err("missing").number, "E5003");
        MachineFolder::of(root.path(), &mill).create().expect("created");
        file.folder_of(&mill).expect("there");
    }
}
