//! `retrace shop`: jobs of this machine, from their submission to the audit.
//!
//! Invariant: nothing here starts, resumes, stops or overrides anything (SHP-12, SHP-13); `cargo xtask tidy` checks
//! that no file here names what could.

mod agent;
mod audit;
mod broker_link;
mod doctor;
mod host;
mod init;
mod job_changes;
mod job_check;
mod job_list;
mod key;
#[cfg(unix)]
mod machine_observer;
#[cfg(unix)]
mod mtconnect;
mod shop_jobs;
#[cfg(unix)]
mod sparkplug;
mod submit;
mod watch;

use retrace_config::NumberedError;
use retrace_shop::ShopFile;

use crate::args::{self, ShopAction};

pub use self::job_changes::{good, scrap};
pub use self::job_list::{JobRow, check_text, details, rows};
pub use self::shop_jobs::ShopJobs;

/// Runs the command.
///
/// # Errors
/// See the actions.
pub fn run(args: &args::Shop) -> Result<(), NumberedError> {
    match &args.action {
        ShopAction::Key { file, new } => return key::run(file, *new),
        ShopAction::Init(init) => return init::run(init),
        _ => {}
    }
    let file = ShopFile::load(args.shop_file.as_deref())?;
    match &args.action {
        ShopAction::Submit(submit) => submit::run(&file, submit),
        ShopAction::Agent { once } => agent::run(&file, *once),
        ShopAction::Jobs { format, all } => job_list::list(&ShopJobs::read(&file)?, format.json, *all),
        ShopAction::Show { id, format } => job_list::show(&ShopJobs::read(&file)?, id, format.json),
        ShopAction::Host { once } => host::run(&file, *once),
        ShopAction::Watch { once, format } => watch::run(&file, *once, format.json),
        ShopAction::Recall { id } => job_changes::recall(&file, id),
        ShopAction::Say { machine, text } => host::say(&file, machine, text),
        // run above, without a shop file
        ShopAction::Key { .. } | ShopAction::Init(_) => Ok(()),
        ShopAction::GiveUp { id } => job_changes::give_up(&file, id),
        ShopAction::Good { id, run } => job_changes::good(&file, id, run),
        ShopAction::Scrap { id, run } => job_changes::scrap(&file, id, run),
        #[cfg(unix)]
        ShopAction::Mtconnect(adapter) => mtconnect::run(&file, adapter),
        ShopAction::Audit { broker: true, format, .. } => audit::run_broker(&file, format.json),
        ShopAction::Audit { root, format, .. } => audit::run(&file, root, format.json),
        #[cfg(unix)]
        ShopAction::Sparkplug { machine } => sparkplug::run(&file, machine.as_deref()),
        ShopAction::Doctor => doctor::run(&file),
    }
}
