//! Values that a cycle reads: the state of its caller, and the path of stock removal.
//!
//! Invariant: reading changes nothing, except that the host calculates the path once.

use super::{Step, VmRun, VmTrap, trap};
use crate::alarm::alarm_text;
use crate::code::System;
use crate::error_codes::ErrorCode;
use crate::host::{Query, StockCall, StockFeed};

impl VmRun<'_> {
    /// Returns the value of a system variable.
    pub(super) fn system(&self, system: System) -> f64 {
        let ask = |what| self.host.ask(what);
        match system {
            System::Feed => ask(Query::Feed),
            System::Speed => ask(Query::SpindleSpeed),
            System::SpindleDirection => ask(Query::SpindleDirection),
            System::Offset => ask(Query::OffsetNumber),
            System::ToolRadius | System::Radius => ask(Query::ToolRadius),
            System::ModalCycle => ask(Query::ModalCycle),
            System::EdgePosition => ask(Query::EdgePosition),
            System::ClearanceAngle => ask(Query::ClearanceAngle),
            // Groups are numbered from 1 in the order of their codes, as on the control.
            System::MotionGroup => ask(Query::Motion) + 1.0,
            System::PlaneGroup => ask(Query::Plane) - 16.0,
            System::CompensationGroup => ask(Query::Compensation) - 39.0,
            System::UnitsGroup => 2.0 - ask(Query::Inch),
            System::DistanceGroup => ask(Query::Distance) - 89.0,
            System::FeedGroup if ask(Query::SpindleMode) == 96.0 => 4.0,
            System::FeedGroup => ask(Query::FeedMode) - 92.0,
            System::DiameterGroup => 1.0 + ask(Query::Diameter),
        }
    }

    /// Executes the built-in of CYCLE95: the host calculates the path.
    pub(super) fn stock_path(&mut self) -> Step {
        let mut numbers = [0.0; 7];
        for number in numbers.iter_mut().rev() {
            *number = self.number();
        }
        let contour = self.pop();
        let [mid, fal_z, fal_x, fal, vari, dam, vrt] = numbers;
        let contour = self.text(contour);
        let call = StockCall { contour, mid, fal_z, fal_x, fal, vari: vari as i32, dam, vrt };
        match self.host.stock(&call) {
            Ok(moves) => self.push(f64::from(moves)),
            Err(fault) => {
                let number = alarm_text(fault.alarm).map_or(fault.alarm, |text| text.number);
                return Err(Box::new(VmTrap::Alarm(ErrorCode::CycleAlarm, Some(number), fault.text)));
            }
        }
        Ok(())
    }

    /// Returns a column of a move of the path.
    pub(super) fn stock_read(&mut self) -> Step {
        let (column, index) = (self.number(), self.number());
        let found = if (0.0..4e9).contains(&index) { self.host.stock_move(index as u32) } else { None };
        let Some(found) = found else {
            return trap(ErrorCode::IndexRange, format!("the path has no move {index}"));
        };
        let value = match column as i64 {
            0 => f64::from(found.motion),
            1 => found.end[0],
            2 => found.end[1],
            3 => found.centre[0],
            4 => found.centre[1],
            5 => f64::from(match found.feed {
                StockFeed::Rapid => 0_u8,
                StockFeed::Rough => 1,
                StockFeed::Plunge => 2,
                StockFeed::Finish => 3,
            }),
            6 => f64::from(found.compensation),
            7 => f64::from(found.dwell),
            _ => return trap(ErrorCode::IndexRange, format!("a move of the path has no column {column}")),
        };
        self.push(value);
        Ok(())
    }
}
