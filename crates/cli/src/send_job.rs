//! `retrace send --job`: a piece of a shop job, sent to an old control; the operator says what became of it (SHP-30).
//!
//! Invariant: the ledger has the run before the control has a character of it. Without the operator's word the piece is
//! neither good nor scrap, and no other one is sent.

use std::io::IsTerminal;

use retrace_config::NumberedError;
use retrace_shop::ShopFile;

use crate::args::Send;
use crate::send;
use crate::shop;
use crate::shop_piece::{JobPiece, piece_of, read_jobs, ready_job};

/// Sends the next piece of a job.
///
/// # Errors
/// `E5004` where there is no such job, `E5012` where it is not ready, `E5013` where it has all its pieces, `E5006`
/// where its files were changed, and those of [`send::transfer`].
pub fn run(args: &Send, name: &str) -> Result<(), NumberedError> {
    let file = ShopFile::load(args.shop_file.as_deref())?;
    let jobs = read_jobs(&file)?;
    let id = jobs.find(name)?.id();
    let JobPiece { recorder, program, .. } = piece_of(&jobs, ready_job(&jobs, id)?)?;
    let machine = args.machine.as_deref().or(file.machine_file.as_deref());
    let mut run = None;
    let done = send::transfer(args, machine, &program, &mut || {
        run = Some(recorder.record_sent()?);
        Ok(())
    });
    let Some(run) = run else { return done };
    let (id, later) = (id.to_string(), format!("`retrace shop good {id} {run}` or `retrace shop scrap {id} {run}`"));
    if done.is_err() || !std::io::stdin().is_terminal() {
        say!("whether the piece is good is not known: {later}, once it is");
        return done;
    }
    say!("cut it at the control; then: y the piece is good, s it is scrap, anything else: later, by {later}");
    let mut word = String::new();
    // a terminal that is closed has said nothing
    let _ = std::io::stdin().read_line(&mut word);
    match word.trim() {
        "y" => shop::good(&file, &id, &run),
        "s" => shop::scrap(&file, &id, &run),
        _ => Ok(()),
    }
}
