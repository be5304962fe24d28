//! Operators and functions of the language.
//!
//! Invariant: every result is finite; an operation without a finite result raises an alarm.

use super::{Step, VmRun, trap};
use crate::code::{Function, Operator};
use crate::error_codes::ErrorCode;

/// Relative difference below which numbers are equal, as on the control.
const SAME: f64 = 1e-12;

fn same(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= SAME * a.abs().max(b.abs())
}

/// Returns sine and cosine of an angle in degrees: exact at multiples of 90, so that a circle of holes closes.
pub(super) fn sin_cos(degrees: f64) -> (f64, f64) {
    let turned = degrees % 360.0;
    let quarter = (turned / 90.0).round();
    let (sin, cos) = (turned - quarter * 90.0).to_radians().sin_cos();
    match (quarter as i32).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

impl VmRun<'_> {
    pub(super) fn operate(&mut self, operator: Operator) -> Step {
        let b = self.number();
        let a = if matches!(operator, Operator::Not | Operator::Negate) { 0.0 } else { self.number() };
        let truth = |value: bool| f64::from(value);
        let value = match operator {
            Operator::Add => a + b,
            Operator::Subtract => a - b,
            Operator::Multiply => a * b,
            Operator::Divide | Operator::WholeDivide | Operator::Modulo if b == 0.0 => {
                return trap(ErrorCode::Arithmetic, "division by zero");
            }
            Operator::Divide => a / b,
            Operator::WholeDivide => (a / b).trunc(),
            Operator::Modulo => a % b,
            Operator::Equal => truth(same(a, b)),
            Operator::Unequal => truth(!same(a, b)),
            Operator::Less => truth(a < b && !same(a, b)),
            Operator::LessEqual => truth(a < b || same(a, b)),
            Operator::Greater => truth(a > b && !same(a, b)),
            Operator::GreaterEqual => truth(a > b || same(a, b)),
            Operator::And => truth(a != 0.0 && b != 0.0),
            Operator::Or => truth(a != 0.0 || b != 0.0),
            Operator::Xor => truth((a != 0.0) != (b != 0.0)),
            Operator::Not => truth(b == 0.0),
            Operator::Negate => -b,
        };
        self.result(value)
    }

    pub(super) fn function(&mut self, function: Function) -> Step {
        let mut arguments = [0.0; 3];
        let count = function.arguments();
        for argument in arguments[..count].iter_mut().rev() {
            *argument = self.number();
        }
        let [x, y, z] = arguments;
        let in_domain = match function {
            Function::Asin | Function::Acos => x.abs() <= 1.0,
            Function::Sqrt => x >= 0.0,
            Function::Ln => x > 0.0,
            Function::Tan => sin_cos(x).1 != 0.0,
            _ => true,
        };
        if !in_domain {
            return trap(ErrorCode::Arithmetic, format!("{} has no value at {x}", function.name()));
        }
        let value = match function {
            Function::Abs => x.abs(),
            Function::Sin => sin_cos(x).0,
            Function::Cos => sin_cos(x).1,
            Function::Tan => sin_cos(x).0 / sin_cos(x).1,
            Function::Asin => x.asin().to_degrees(),
            Function::Acos => x.acos().to_degrees(),
            Function::Atan2 => x.atan2(y).to_degrees(),
            Function::Sqrt => x.sqrt(),
            Function::Square => x * x,
            Function::Trunc => x.trunc(),
            Function::Round => x.round(),
            Function::Ln => x.ln(),
            Function::Exp => x.exp(),
            Function::Least => x.min(y),
            Function::Greatest => x.max(y),
            // Arguments: minimum, maximum, value. Not `clamp`, which panics where the minimum is above the maximum.
            Function::Bound => z.min(y).max(x),
        };
        self.result(value)
    }

    fn result(&mut self, value: f64) -> Step {
        if !value.is_finite() {
            return trap(ErrorCode::Arithmetic, "the result of a calculation is too large");
        }
        self.push(value);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_exact_at_right_angles_and_close_elsewhere() {
        for quarter in -8..9 {
            let (sin, cos) = sin_cos(90.0 * f64::from(quarter));
            assert!(sin * cos == 0.0 && (sin + cos).abs() == 1.0, "{quarter}: {sin} {cos}");
        }
        for degrees in -800..800 {
            let (sin, cos) = sin_cos(f64::from(degrees));
            let (s, c) = f64::from(degrees).to_radians().sin_cos();
            assert!((sin - s).abs() < 1e-13 && (cos - c).abs() < 1e-13, "{degrees}");
        }
    }

    #[test]
    fn equality_forgives_the_last_digits_only() {
        assert!(same(0.1 + 0.2, 0.3) && same(0.0, 0.0));
        assert!(!same(1.0, 1.0 + 1e-9) && !same(0.0, 1e-300));
    }
}
