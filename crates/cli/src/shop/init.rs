//! `retrace shop init`: keys, shop files and the configuration of a broker for a shop of machines (SHP-24).
//!
//! Invariant: a seed or shop file that exists is kept; the configuration of the server is written anew.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_shop::{BrokerRole, BrokerUser, MachineName, ServerSettings, new_seed, public_key, server_config};

use crate::args;

/// Name of the computer that makes the streams.
const HOST: &str = "host";

/// Runs the command.
///
/// # Errors
/// `E5002` for a name, `E5001` for contradictory options, `E5010` and `E5036` where a file cannot be read or written.
pub fn run(args: &args::ShopInit) -> Result<(), NumberedError> {
    let shop = ShopPlan::of(args)?;
    let folder = &args.folder;
    fs::create_dir_all(folder).map_err(|error| unusable(folder, &error))?;
    let mut users = Vec::new();
    for (name, role) in &shop.roles {
        let seed = folder.join(format!("{name}.seed"));
        let key = if seed.exists() { public_key(&seed)? } else { new_seed(&seed)? };
        users.push(BrokerUser { name: name.clone(), key, role: role.clone() });
    }
    let submitters: Vec<&BrokerUser> =
        users.iter().filter(|user| !matches!(user.role, BrokerRole::Machine(_))).collect();
    let settings = shop.server(folder)?;
    let config = server_config(&settings, &users);
    if args.print_config {
        crate::out::line(config.trim_end());
        return Ok(());
    }
    for user in &users {
        let path = folder.join(format!("{}.toml", user.name));
        if path.exists() {
            say!("{} is kept as it is", path.display());
        } else {
            write(&path, &shop.shop_file(user, &submitters))?;
        }
    }
    let path = folder.join("nats-server.conf");
    write(&path, &config)?;
    say!("{} computers: each gets its NAME.toml and NAME.seed; {} is for nats-server", users.len(), path.display());
    Ok(())
}

/// What the options say.
struct ShopPlan<'a> {
    args: &'a args::ShopInit,
    roles: BTreeMap<MachineName, BrokerRole>,
}

impl std::fmt::Debug for ShopPlan<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ShopPlan").field("roles", &self.roles).finish_non_exhaustive()
    }
}

impl<'a> ShopPlan<'a> {
    fn of(args: &'a args::ShopInit) -> Result<Self, NumberedError> {
        let wrong = |what: String, remedy: &str| NumberedError::new("E5001", what, remedy.to_owned());
        let mut groups = BTreeMap::<String, Vec<MachineName>>::new();
        for group in &args.group {
            let Some((name, machines)) = group.split_once('=') else {
                return Err(wrong(format!("--group {group}"), "write --group NAME=MACHINE,MACHINE"));
            };
            let name = MachineName::parse(name)?;
            for machine in machines.split(',') {
                if !args.machine.iter().any(|known| known == machine) {
                    return Err(wrong(format!("--group {name}: no machine {machine}"), "name it with --machine, too"));
                }
                groups.entry(machine.to_owned()).or_default().push(name.clone());
            }
        }
        let mut roles = BTreeMap::from([(MachineName::parse(HOST)?, BrokerRole::Host)]);
        let machine =
            |name: &String| (name.clone(), BrokerRole::Machine(groups.get(name).cloned().unwrap_or_default()));
        let submitters = args.submitter.iter().map(|name| (name.clone(), BrokerRole::Submitter));
        for (name, role) in args.machine.iter().map(machine).chain(submitters) {
            if roles.insert(MachineName::parse(&name)?, role).is_some() {
                return Err(wrong(format!("two computers are named {name}"), "give each a name of its own"));
            }
        }
        Ok(Self { args, roles })
    }

    fn server(&self, folder: &Path) -> Result<ServerSettings, NumberedError> {
        let absolute = |path: &Path| std::path::absolute(path).map_err(|error| unusable(path, &error));
        let text = |path: PathBuf| path.to_string_lossy().into_owned();
        let tls = match (&self.args.tls_cert, &self.args.tls_key) {
            (Some(certificate), Some(key)) => Some([text(absolute(certificate)?), text(absolute(key)?)]),
            _ => None,
        };
        let store = text(absolute(&folder.join("jetstream"))?);
        Ok(ServerSettings { listen: self.args.listen.clone(), store, tls, is_always_synced: self.args.always_synced })
    }

    fn shop_file(&self, user: &BrokerUser, submitters: &[&BrokerUser]) -> String {
        let BrokerUser { name, role, .. } = user;
        let server = self.args.server.clone().unwrap_or_else(|| format!("nats://{}", self.args.listen));
        let mut text = format!("name = \"{name}\"\n\n[broker]\nservers = [{server:?}]\nseed = \"{name}.seed\"\n");
        if let Some(ca) = &self.args.ca {
            text += &format!("ca = {:?}\n", ca.to_string_lossy());
        }
        if self.args.insecure {
            text += "insecure = true\n";
        }
        if let BrokerRole::Machine(groups) = role {
            if !groups.is_empty() {
                let groups: Vec<String> = groups.iter().map(|group| format!("\"{group}\"")).collect();
                text += &format!("groups = [{}]\n", groups.join(", "));
            }
            text += "\n[broker.submitters]\n";
            for BrokerUser { name, key, .. } in submitters {
                text += &format!("{name} = \"{key}\"\n");
            }
        }
        text
    }
}

fn write(path: &Path, text: &str) -> Result<(), NumberedError> {
    fs::write(path, text).map_err(|error| unusable(path, &error))
}

fn unusable(path: &Path, error: &std::io::Error) -> NumberedError {
    let what = format!("{}: {error}", path.display());
    NumberedError::new("E5010", what, "name a folder that can be written")
}
