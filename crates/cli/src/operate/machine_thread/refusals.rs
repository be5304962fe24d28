//! What is shown of an order that is not carried out, and of a program that is not started.
//!
//! Invariant: a refusal is among the messages, and at the screen that has given the order.

use retrace_config::NumberedError;
use retrace_tui::{AlarmShown, diagnostic_lines, lock_model};

use super::MachineThread;

impl<const A: usize> MachineThread<'_, '_, A> {
    /// Reports that an order was not carried out: among the messages, and where it was given.
    pub(super) fn reject(&mut self, NumberedError { number, cause, remedy }: NumberedError) {
        self.add_message(format!("{number}: {cause} · {remedy}"));
        lock_model(&self.router.model).reject(Some(number), cause, remedy);
    }

    /// The same for an order without a number.
    pub(super) fn reject_text(&mut self, cause: &str) {
        self.add_message(cause);
        lock_model(&self.router.model).reject(None, cause, "");
    }

    /// Shows why a program is refused, one line per finding.
    pub(super) fn show_refusal(&mut self, why: &str) {
        let findings = diagnostic_lines(why);
        let cause = findings.first().cloned().unwrap_or_default();
        findings.into_iter().for_each(|finding| self.add_message(finding));
        let remedy = "g shows all messages; correct the program or its work zero, then start it again (c)".to_owned();
        let mut model = lock_model(&self.router.model);
        model.alarm = Some(AlarmShown { number: "program refused".into(), cause, remedy, is_refusal: true });
    }

    /// Shows why a start was refused, with its own remedy.
    pub(super) fn refuse_start(&mut self, NumberedError { number, cause, remedy }: NumberedError) {
        self.add_message(format!("{number}: {cause} · {remedy}"));
        let mut model = lock_model(&self.router.model);
        model.alarm = Some(AlarmShown { number: number.into(), cause, remedy, is_refusal: true });
        model.changes += 1;
    }
}
