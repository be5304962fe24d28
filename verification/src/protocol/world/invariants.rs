//! What has to hold in every state, and that everything settles on a line without further faults.
//!
//! Invariant: what a session requested and did not see yet is all that is remembered of the past, so that states with
//! different pasts and the same future are one.

use std::collections::VecDeque;

use retrace_core::{Place, Rate, RateTarget, RecordIndex};
use retrace_link::{HostCommand, LinkError};

use super::{Controller, World};
use crate::protocol::counting_card::{CoreEvent, WINDOW};

/// One connection: what its host has requested, and the card has to do once and in that order.
#[derive(Clone, Debug, Hash)]
pub(super) struct Session {
    /// Number of the session: the card knows it from the settings, and every value that is sent contains it.
    pub(super) id: u16,
    /// Whether the card has opened it.
    pub(super) opened: bool,
    /// Commands that the card has not received.
    pub(super) pending: VecDeque<HostCommand<1>>,
    /// Rates that are not applied, nor older than an applied one.
    pub(super) rates: VecDeque<RateTarget>,
    /// The last one requested.
    pub(super) target: RateTarget,
    /// Control periods that the host has not published.
    pub(super) periods: VecDeque<Period>,
    /// Number of commands sent, and of those that the card received.
    pub(super) sent: u16,
    pub(super) received: u16,
    /// Windows of the card after each command, from number `first_window` on.
    pub(super) windows: VecDeque<(RecordIndex, RecordIndex)>,
    pub(super) first_window: u16,
}

/// What the card did in a period.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Period {
    pub(super) place: Place,
    pub(super) rate: Rate,
    pub(super) at_rest: bool,
    pub(super) count: i64,
    pub(super) output: i32,
}

impl World {
    /// Compares what the card's core was asked to do with what its session requested.
    pub(super) fn record(&mut self, event: CoreEvent) {
        let id = self.core.session;
        match event {
            CoreEvent::Opened(id) => {
                let session = self.session(id);
                assert!(session.received == 0 && session.sent == 0, "a session is opened once");
                assert!(!session.opened);
                session.opened = true;
            }
            CoreEvent::Closed => {}
            CoreEvent::Rate(target) => {
                let rates = &mut self.session(id).rates;
                let at = rates.iter().position(|&requested| requested == target);
                let at = at.expect("a rate is applied that was not requested, or is older than the last one");
                rates.drain(..=at);
            }
            CoreEvent::Command(command, low, high) => {
                let session = self.session(id);
                let due = session.pending.pop_front();
                assert_eq!(due, Some(command), "commands are applied once, in order, in their own epoch");
                session.received += 1;
                session.windows.push_back((low, high));
            }
        }
    }

    pub(super) fn session(&mut self, id: u16) -> &mut Session {
        self.sessions.iter_mut().find(|session| session.id == id).expect("the card serves a session that exists")
    }

    /// Everything that has to hold in every state.
    pub(super) fn check(&mut self) {
        let (host_session, card_session) = (self.host_session, self.core.session);
        let opening_is_late = self.host_late.is_some();
        self.sessions.retain(|session| {
            session.id == host_session || session.id == card_session || !session.opened && opening_is_late
        });
        // each record that the card holds is the one that its own session sent under this number
        let (low, high) = (self.core.status.low, self.core.status.high);
        assert!(high.since(low) <= WINDOW);
        for offset in 0..if card_session == 0 { 0 } else { high.since(low) } {
            let place = low + offset;
            assert_eq!(self.core.record(place), Some(&Self::record_of(card_session, place)), "one content");
        }
        if host_session == 0 {
            return;
        }
        self.check_predicted_window();
        let session_is_gone = host_session != card_session;
        match self.host.fault() {
            None => {}
            Some(LinkError::Restarted) => assert!(session_is_gone, "the card has not been restarted"),
            Some(fault) => panic!("the host reports {fault:?}"),
        }
    }

    /// The host's window is the card's as of the last acknowledged command, with the effect of the commands in transit.
    fn check_predicted_window(&mut self) {
        let unacknowledged = self.host.unacknowledged_commands();
        let (low, high) = (self.host.status().low, self.host.status().high);
        let reported_high = self.host.acknowledged_high();
        let id = self.host_session;
        let session = self.session(id);
        let acknowledged = session.sent - unacknowledged;
        assert!(acknowledged <= session.received, "a command is acknowledged that the card has not received");
        while session.first_window < acknowledged {
            session.first_window += 1;
            session.windows.pop_front();
        }
        let &(card_low, card_high) = session.windows.front().expect("one for each command, and one before");
        assert_eq!(reported_high, card_high, "the end of the window is that of the last acknowledged command");
        assert!(high.since(low) <= WINDOW, "the predicted window is larger than the card's");
        let reach = u32::from(unacknowledged);
        assert!(
            !(card_high + reach).is_before(high) && !low.is_before(card_low - reach),
            "the predicted window has records that were not sent"
        );
        if unacknowledged == 0 {
            assert_eq!((low, high), (card_low, card_high), "nothing is in transit: the windows are equal");
        }
    }

    /// All frames of both ends arrive, and a period passes.
    pub(super) fn exchange(&mut self) {
        for _ in 0..8 {
            let Some(frame) = self.host_frame() else { break };
            self.deliver_to_card(&frame);
            self.check();
        }
        for _ in 0..8 {
            let Some(frame) = self.card_frame() else { break };
            self.deliver_to_host(&frame);
            self.check();
        }
        self.run_period();
    }

    /// Whether the host's opening was overtaken by a late one, of a host that was restarted since. Each host opens the
    /// epoch after the one that it was told of: both have the same number, and different keys. The new host hears
    /// nothing, and its opening times out ([`retrace_link::LinkTimeouts`]).
    fn opening_times_out(&self) -> bool {
        self.controller == Controller::Runs && !self.host.is_open() && self.core.session != self.host_session
    }

    /// Whether everything that was requested is done and published, or the session has ended.
    pub(super) fn is_settled(&self) -> bool {
        let (host, card) = (self.host_session, self.core.session);
        if self.host.fault() == Some(LinkError::Restarted) {
            return host != card;
        }
        let Some(session) = self.sessions.iter().find(|session| session.id == host) else { return false };
        match self.controller {
            Controller::Connects => false,
            Controller::Closes => self.host.is_closed() && card == 0,
            Controller::Runs => {
                host == card
                    && self.host.is_open()
                    && self.host.is_acknowledged()
                    && session.pending.is_empty()
                    && self.core.target == session.target
                    && session.periods.len() <= 1
                    && self.core.status.at_rest
            }
        }
    }

    /// On a line without further faults, both ends come to rest or go on: within this many periods everything is
    /// settled. What was delayed arrives first. Returns the periods; `seen` has the states from which this is known.
    pub(in crate::protocol) fn settle(mut self, seen: &mut impl FnMut(u128) -> bool) -> u32 {
        const MOST: u32 = 40;
        if let Some(frame) = self.host_late.take() {
            self.deliver_to_card(&frame);
            self.check();
        }
        if let Some(frame) = self.card_late.take() {
            self.deliver_to_host(&frame);
            self.check();
        }
        for periods in 0..MOST {
            if self.is_settled() || !seen(self.fingerprint()) {
                return periods;
            }
            self.exchange();
        }
        if self.opening_times_out() {
            return MOST;
        }
        panic!(
            "not settled after {MOST} periods: fault {:?}, open {}, acknowledged {}, sessions {:?}, card {}",
            self.host.fault(),
            self.host.is_open(),
            self.host.is_acknowledged(),
            self.sessions,
            self.core.session
        );
    }
}
