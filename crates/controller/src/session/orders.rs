//! The operator's words, as the session takes them.
//!
//! Invariant: an order that does not apply changes nothing and is answered with the reason.

use retrace_core::mode::{Mode, Order, Refused};
use retrace_link::{Change, MotionCard, Word};

use super::Session;
use crate::event::Happening;
use crate::operator::{Deed, percent};

impl<const A: usize, C: MotionCard<A>> Session<'_, '_, A, C> {
    pub(super) fn take_orders(&mut self) {
        let (period, line) = (self.card.status().period, self.card.status().line);
        while let Some(instruction) = self.operator.due(period, line) {
            self.tell(Happening::Operator(instruction.deed.to_string()));
            let mode = self.operation.mode();
            if let Err(why) = self.order(instruction.deed) {
                self.tell(Happening::OrderRefused(why));
            }
            if self.operation.mode() != mode {
                self.tell_mode();
            }
        }
        // the script's wheel, and one that is wired to the card
        let counts = self.operator.wheel_counts(period).saturating_add(self.card.status().wheel);
        self.wheel.turn(counts);
    }

    fn order(&mut self, deed: Deed) -> Result<(), String> {
        match deed {
            Deed::Hold => self.operation.order(Order::Hold),
            Deed::Resume if self.program_stop => {
                self.go_on = true;
                Ok(())
            }
            Deed::Resume if self.single_stop => {
                self.next_block();
                Ok(())
            }
            Deed::Resume | Deed::CycleStart => self.operation.order(Order::Resume),
            Deed::BackBy(_)
            | Deed::BackToBlock
            | Deed::BackToJet
            | Deed::Pause
            | Deed::SpindleStop
            | Deed::SpindleStart
            | Deed::Jog { .. }
            | Deed::Online => return Err("not built yet".into()),
            Deed::Override(rate) => {
                let most = self.overrides.most();
                let asked = self.overrides.ask(rate, self.card.status().reached);
                asked.map_err(|_| "too many changes of the override are on their way already".to_string())?;
                self.override_rate();
                return if rate > most { Err(format!("{:.0} % is the most", percent(most))) } else { Ok(()) };
            }
            Deed::Reverse(rate) => self.operation.order(Order::Reverse(rate)),
            Deed::Forward(rate) => self.operation.order(Order::Forward(rate)),
            Deed::Wheel { .. } if self.operation.mode() == Mode::Wheel => Ok(()),
            Deed::Wheel { .. } => {
                self.wheel.reset();
                self.operation.order(Order::Wheel)
            }
            Deed::Leave { ask } => self.operation.order(Order::Leave { ask }),
            Deed::Agree => self.operation.order(Order::Agree),
            Deed::Output { number, on } => {
                let change = Change { channel: number, value: i32::from(on) };
                return self.card.send(Word::ByHand(change)).map_err(|_| format!("the card has no output {number}"));
            }
            Deed::Single => {
                self.single = !self.single;
                if self.single {
                    self.next_block()
                } else {
                    self.supply.open_block()
                }
                Ok(())
            }
            Deed::Stop => {
                self.stopping = true;
                self.operation.order(Order::Hold)
            }
        }
        .map_err(reason)
    }

    pub(super) fn next_block(&mut self) {
        self.single_stop = false;
        if self.single {
            // beyond what was executed already: retracing is not cut into blocks
            let after = self.card.status().reached;
            self.supply.end_block(&mut self.card, after);
        } else {
            self.supply.open_block();
        }
    }
}

fn reason(refused: Refused) -> String {
    match refused {
        Refused::NotRetracing => "there is nothing to leave: the machine is in normal run",
        Refused::NothingAsked => "there is nothing to agree to",
        Refused::NotHeld => "no feed hold is in force",
        Refused::NoRate => "a rate above 0 % is needed",
    }
    .into()
}
