//! The operator's words, as the session takes them.
//!
//! Invariant: an order that does not apply changes nothing and is answered with the reason.

use retrace_core::Travel;
use retrace_core::mode::{Mode, Order};
use retrace_link::{Change, MotionCard, Word};

use super::Session;
use super::back::Wanted;
use crate::event::Happening;
use crate::operator::{Deed, OrderRefused};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    pub(super) fn take_orders(&mut self) {
        let (period, line) = (self.card.status().period, self.card.status().line);
        while let Some(deed) = self.operators.next_word(period, line) {
            self.tell(Happening::Operator(deed));
            // Somebody is there.
            self.still_periods = 0;
            let mode = self.operation.mode();
            if let Err(why) = self.order(deed) {
                self.tell(Happening::OrderRefused(why));
            }
            if self.operation.mode() != mode {
                self.tell_mode();
            }
        }
        // the script's wheel, the screen's, and one that is wired to the card
        let counts = self.operators.wheel_counts(period).saturating_add(self.card.status().wheel);
        self.wheel.turn(counts);
    }

    fn order(&mut self, deed: Deed) -> Result<(), OrderRefused> {
        if let Some(taken) = self.order_interrupted(deed) {
            return taken;
        }
        match deed {
            Deed::Resume | Deed::CycleStart => return self.cycle_start(),
            // Taken above.
            Deed::Pause | Deed::SpindleStop | Deed::SpindleStart | Deed::Jog { .. } | Deed::Online => {}
            Deed::BackBy(mm) => return self.go_back(Wanted::By(mm)),
            Deed::BackToBlock => return self.go_back(Wanted::Block),
            Deed::BackToJet => return self.go_back(Wanted::Jet),
            Deed::Override(rate) => return self.ask_override(rate),
            Deed::Output { number, on } => {
                let change = Change { channel: number, value: i32::from(on) };
                return self.card.send(Word::ByHand(change)).map_err(|_| OrderRefused::NoOutput(number));
            }
            Deed::Single => self.switch_single(),
            Deed::Hold => self.operation.order(Order::Hold)?,
            Deed::Agree => self.operation.order(Order::Agree)?,
            Deed::Stop => {
                self.stopping = true;
                self.operation.order(Order::Hold)?;
            }
            Deed::Wheel { .. } if self.operation.mode() == Mode::Wheel => {}
            Deed::Wheel { .. } => {
                self.wheel.reset();
                self.retrace(Order::Wheel)?;
            }
            Deed::Reverse(rate) => self.retrace(Order::Reverse(rate))?,
            Deed::Forward(rate) => self.retrace(Order::Forward(rate))?,
            Deed::Leave { ask } => self.retrace(Order::Leave { ask })?,
        }
        Ok(())
    }

    /// A word that changes the way the path is retraced: whatever reverse run was to end somewhere ends.
    fn retrace(&mut self, order: Order) -> Result<(), OrderRefused> {
        self.operation.order(order)?;
        self.back = None;
        Ok(())
    }

    /// *Cycle start*: at a program stop, at the end of a block, after a hold.
    fn cycle_start(&mut self) -> Result<(), OrderRefused> {
        if self.program_stop {
            self.go_on = true;
        } else if self.single_stop {
            self.next_block();
        } else {
            self.operation.order(Order::Resume)?;
        }
        Ok(())
    }

    fn ask_override(&mut self, rate: Travel) -> Result<(), OrderRefused> {
        let most = self.overrides.most();
        let reached = self.dnc.reached().unwrap_or(self.card.status().reached);
        self.overrides.ask(rate, reached).map_err(|_| OrderRefused::TooManyOverrides)?;
        self.override_rate();
        if rate > most { Err(OrderRefused::MostOverride(most)) } else { Ok(()) }
    }

    /// Sets the part of the override that the rate does.
    pub(super) fn override_rate(&mut self) {
        // Never refused.
        let _ = self.operation.order(Order::Override(self.overrides.rate()));
    }

    fn switch_single(&mut self) {
        self.single = !self.single;
        if self.single {
            self.next_block();
        } else {
            self.supply.open_block();
        }
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
