//! `retrace shop submit`: puts a job into the queue of a machine, or into the outbox for a machine elsewhere.
//!
//! Invariant: when the name of the job is printed, the job is stored, whole and durable.

use std::path::Path;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_shop::{
    ContentHash, JobQueue, JobTarget, MachineFileDemand, MachineName, Outbox, ShopFile, ShopJob, ShopJobId, SourceFile,
};

use super::host;
use crate::args;
use crate::files;

/// Runs the command.
///
/// # Errors
/// `E5002`, `E5003` for the machine; `E5005` to `E5008` for the files; `E5010`; `E5040` without a broker.
pub fn run(file: &ShopFile, args: &args::Submit) -> Result<(), NumberedError> {
    let machine = args.machine.as_deref().map_or(Ok(file.name.clone()), MachineName::parse)?;
    let group = args.group.as_deref().map(MachineName::parse).transpose()?;
    let is_elsewhere = group.is_some() || (file.broker.is_some() && machine != file.name);
    let target = group.map_or(JobTarget::Machine(machine.clone()), JobTarget::Group);
    let machine_file = args.made_for.as_deref().map(|path| demand(path, args.only_made_for)).transpose()?;
    let sources = SourceFile::of_paths(&args.files)?;
    if is_elsewhere {
        let broker = host::settings(file)?;
        let outbox = Outbox::open(&file.root)?;
        let staged = outbox.stage(&sources, file.limits)?;
        let job = job(args, target, machine_file, staged.bundle().hash())?;
        outbox.submit(staged, &job)?;
        say!("{}", job.id);
        return host::send_submitted(file, broker, &outbox, job.id, args.wait);
    }
    let folder = file.folder_of(&machine)?;
    folder.create()?;
    let staged = JobQueue::of(&folder).stage(&sources, file.limits)?;
    let job = job(args, target, machine_file, staged.bundle().hash())?;
    staged.submit(&job)?;
    say!("{}", job.id);
    Ok(())
}

fn job(
    args: &args::Submit,
    target: JobTarget,
    machine_file: Option<MachineFileDemand>,
    bundle: ContentHash,
) -> Result<ShopJob, NumberedError> {
    Ok(ShopJob {
        id: ShopJobId::new_now()?,
        bundle,
        target,
        quantity: args.quantity,
        may_repeat: args.may_repeat,
        order_number: args.order.clone(),
        note: args.note.clone(),
        material: args.material.clone(),
        submitter: submitter(),
        machine_file,
        submitted: Timestamp::now(),
    })
}

/// The machine file that a job was made for.
fn demand(path: &Path, is_required: bool) -> Result<MachineFileDemand, NumberedError> {
    let text = files::text(path, "machine file")?;
    Ok(MachineFileDemand { hash: ContentHash::of(text.as_bytes()), is_required })
}

/// Name of the user, as the environment has it.
fn submitter() -> String {
    let named = |name| std::env::var(name).ok().filter(|user| !user.is_empty());
    let user = named("USER").or_else(|| named("LOGNAME")).or_else(|| named("USERNAME"));
    let user = user.unwrap_or_else(|| "unknown".into());
    user.chars().filter(|letter| !letter.is_control()).take(100).collect()
}
