//! Pieces of the shop's jobs that are started at the screen (SHP-12, SHP-36).
//!
//! Invariant: a piece is started as `retrace run --job` does it: from its first block, with a journal, its files
//! verified, and `started` in the ledger before anything moves.

use retrace_config::NumberedError;
use retrace_tui::{ScreenStage, lock_model};

use super::MachineThread;
use crate::shop_piece::{self, JobPiece};

impl<const A: usize> MachineThread<'_, '_, A> {
    /// Starts the next pieces of a job, one after the other, which the operator has confirmed. The series ends with a
    /// piece that does not come to its end, with a hold between two pieces, and where the page in control is gone.
    pub(super) fn start_shop_job(&mut self, id: &str, pieces: u32) {
        if lock_model(&self.router.model).stage == ScreenStage::Job {
            return self.reject_text("a program is running: its end comes first");
        }
        for number in 1..=pieces {
            if number > 1 && self.router.has_series_ended(self.start) {
                let left = pieces - number + 1;
                self.add_message(format!("the series has ended: {left} of {pieces} pieces were not started"));
                break;
            }
            self.pieces_behind = pieces - number;
            self.has_completed = false;
            self.start_piece(id);
            if !self.has_completed {
                break;
            }
            if self.pieces_behind > 0 {
                self.add_message(format!("piece {number} of {pieces} has ended; the next one follows"));
            }
        }
        self.pieces_behind = 0;
    }

    /// Starts the next piece of a job, once all of it was verified.
    fn start_piece(&mut self, id: &str) {
        if let Err(refusal) = self.homing.check(&self.machine).and_then(|()| self.check_records_pieces()) {
            return self.refuse_start(refusal);
        }
        let (args, text) = (self.args.clone(), self.machine_and_card.0.clone());
        let (id, more) = (id.to_owned(), self.pieces_behind);
        let prepared = self.while_idle(move || {
            let shop_file = args.shop.shop_file.as_deref();
            shop_piece::prepare_at_screen(shop_file, (&id, more), (args.machine_file.path(), &text))
        });
        let JobPiece { recorder, program, cycles } = match prepared {
            Ok(prepared) => prepared,
            Err(refusal) => return self.refuse_start(refusal),
        };
        // The recorder stays: `c` starts the next piece of the program that is loaded then.
        if self.load_program(program, cycles) {
            self.args.shop.recorder = Some(recorder);
            self.run_job(self.args.clone());
        }
    }

    /// Checks that a run at this screen can count as a piece.
    fn check_records_pieces(&self) -> Result<(), NumberedError> {
        let (what, remedy) = if self.args.page.demo {
            ("the demonstration makes no piece of a job of the shop", "start it at the screen of its machine")
        } else if self.machine.inhibits_outputs {
            ("a dry run makes no piece of a job of the shop", "switch the dry run off (d)")
        } else if self.args.no_journal {
            ("a job of the shop needs its journal, and this screen writes none", "start it without --no-journal")
        } else {
            return Ok(());
        };
        Err(NumberedError::new("E5030", what, remedy))
    }

    /// Writes to the ledger which runs have ended, so that the next piece can be started.
    pub(super) fn record_ended_pieces(&mut self) {
        let Some(ledger) = self.args.shop.recorder.as_ref().map(|recorder| recorder.ledger()) else { return };
        if let Err(refusal) = self.while_idle(move || shop_piece::record_ended_runs(&ledger)) {
            self.reject(refusal);
        }
    }
}

/// Error of a start inside the program of a job.
pub(super) fn begins_inside_piece() -> NumberedError {
    let remedy = "start it at its beginning (c), and skip contours there (C); or run a copy of the program";
    NumberedError::new("E5031", "a piece of a job of the shop begins at its first block", remedy)
}
