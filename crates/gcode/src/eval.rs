//! Evaluation of compiled expressions on a fixed stack.
//!
//! Invariant: it allocates nothing, and every result is a finite number, unknown or an error; from known values it is
//! never unknown. The compiler bounds the depth.

use crate::angle;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::expr::{Function, Op, OpKind, Operator, STACK};
use crate::params::{NameId, Parameters};
use crate::system::SystemParameter;
use crate::unknown::{UNKNOWN, has_unknown_existence};

/// Values closer than this are equal to EQ, NE, LE and GE, as in LinuxCNC 2.9.9. GT and LT compare exactly.
pub(crate) const EQUAL: f64 = 1e-6;

/// Maximum deviation of a value from a whole number, where one is required.
const WHOLE: f64 = 1e-4;

/// Source of parameter values for the evaluation.
pub(crate) trait Environment {
    fn numbered(&self, number: usize) -> Option<f64>;
    /// Whether an expression may use the numbered parameter now. A comment may always show it.
    fn is_readable(&self, _number: usize) -> bool {
        true
    }
    fn named(&self, name: NameId) -> Option<f64>;
    fn name(&self, name: NameId) -> &str;
    /// Returns the name with a value that is most similar to a name without one.
    fn nearest_name(&self, _name: NameId) -> Option<&str> {
        None
    }
    fn system(&self, parameter: SystemParameter) -> f64;
}

/// Executes the operations. The last value is the result; the value below it, if any, is returned first.
pub(crate) fn evaluate(ops: &[Op], environment: &impl Environment) -> BlockResult<(f64, f64)> {
    let mut stack = [0.0_f64; STACK + 3];
    let mut top = 1;
    for op in ops {
        let value = match op.kind {
            OpKind::Constant(value) => {
                top += 1;
                value
            }
            OpKind::Numbered if stack[top].is_nan() => UNKNOWN,
            OpKind::Numbered => numbered(stack[top], *op, environment)?,
            OpKind::Named(name) => {
                top += 1;
                match environment.named(name) {
                    Some(value) if value.is_nan() => UNKNOWN,
                    Some(value) => value,
                    None => {
                        let near = environment.nearest_name(name);
                        let near = near.map_or_else(String::new, |near| format!("; did you mean #<{near}>?"));
                        let name = environment.name(name);
                        return fault(
                            ErrorCode::ParameterUndefined,
                            op.span(),
                            format!("#<{name}> has no value yet{near}"),
                        );
                    }
                }
            }
            OpKind::System(parameter) => {
                top += 1;
                environment.system(parameter)
            }
            OpKind::ExistsNumbered => {
                if stack[top].is_nan() {
                    continue;
                }
                let number = to_whole_number(stack[top], op.span(), "#")?;
                let exists = usize::try_from(number).is_ok_and(Parameters::has);
                f64::from(u8::from(exists))
            }
            OpKind::Exists(name) => {
                top += 1;
                match environment.named(name) {
                    Some(value) if has_unknown_existence(value) => UNKNOWN,
                    value => f64::from(u8::from(value.is_some())),
                }
            }
            OpKind::Negate => -stack[top],
            OpKind::Function(_) if stack[top].is_nan() => UNKNOWN,
            OpKind::Function(function) => apply(function, stack[top], *op)?,
            OpKind::Atan => {
                top -= 1;
                angle::to_degrees(stack[top].atan2(stack[top + 1]))
            }
            OpKind::Binary(operator) => {
                top -= 1;
                combine(operator, stack[top], stack[top + 1], *op)?
            }
        };
        // Known values give a NaN nowhere but in an operation that has noticed it itself.
        if value.is_infinite() {
            return not_finite(*op);
        }
        stack[top] = value;
    }
    Ok((stack[top - 1], stack[top]))
}

fn numbered(number: f64, op: Op, environment: &impl Environment) -> BlockResult<f64> {
    let number = to_whole_number(number, op.span(), "#")?;
    if usize::try_from(number).is_ok_and(|number| !environment.is_readable(number)) {
        return fault(ErrorCode::CompensationPosition, op.span(), ErrorCode::CompensationPosition.title());
    }
    match usize::try_from(number).ok().and_then(|number| environment.numbered(number)) {
        Some(value) => Ok(value),
        None => fault(ErrorCode::ParameterRange, op.span(), format!("there is no parameter #{number}")),
    }
}

/// Converts a value that must be a whole number within 0.0001.
pub(crate) fn to_whole_number(value: f64, span: Span, of: &str) -> BlockResult<i32> {
    let rounded = value.round();
    if (value - rounded).abs() > WHOLE {
        return fault(ErrorCode::NotAnInteger, span, format!("{of} must be a whole number, not {value}"));
    }
    if rounded.abs() > f64::from(i32::MAX) {
        return fault(ErrorCode::NumberTooLarge, span, format!("{value} is too large for {of}"));
    }
    Ok(rounded as i32)
}

fn apply(function: Function, x: f64, op: Op) -> BlockResult<f64> {
    let in_domain = match function {
        Function::Acos | Function::Asin => (-1.0..=1.0).contains(&x),
        Function::Ln => x > 0.0,
        Function::Sqrt => x >= 0.0,
        Function::Round => x.abs() < f64::from(i32::MAX),
        _ => true,
    };
    if !in_domain {
        return fault(ErrorCode::OutOfDomain, op.span(), format!("{function:?} has no value at {x}"));
    }
    Ok(match function {
        // A negative zero stays negative, as in LinuxCNC.
        Function::Abs if x < 0.0 => -x,
        Function::Abs => x,
        Function::Acos => angle::to_degrees(x.acos()),
        Function::Asin => angle::to_degrees(x.asin()),
        Function::Cos => angle::cosine(x),
        Function::Exp => x.exp(),
        Function::Fix => x.floor(),
        Function::Fup => x.ceil(),
        Function::Ln => x.ln(),
        // Half away from zero, by truncation after adding a half; the result zero has no sign.
        Function::Round => (x + 0.5_f64.copysign(x)).trunc() + 0.0,
        Function::Sin => angle::sine(x),
        Function::Sqrt => x.sqrt(),
        Function::Tan => angle::tangent(x),
    })
}

/// Applies an operator to known values, or to values of which one is unknown. The result is finite, infinite or
/// unknown.
fn combine(operator: Operator, left: f64, right: f64, op: Op) -> BlockResult<f64> {
    if !left.is_nan() && !right.is_nan() {
        let result = combine_known(operator, left, right, op)?;
        return if result.is_nan() { not_finite(op) } else { Ok(result) };
    }
    Ok(match operator {
        // One side decides alone.
        Operator::And if left == 0.0 || right == 0.0 => 0.0,
        Operator::Or if is_true(left) || is_true(right) => 1.0,
        Operator::Divide | Operator::Modulo if right == 0.0 => return combine_known(operator, 0.0, right, op),
        _ => UNKNOWN,
    })
}

/// Whether a value is known and not 0.
fn is_true(value: f64) -> bool {
    !value.is_nan() && value != 0.0
}

fn not_finite<T>(op: Op) -> BlockResult<T> {
    fault(ErrorCode::NotFinite, op.span(), ErrorCode::NotFinite.title())
}

fn combine_known(operator: Operator, left: f64, right: f64, op: Op) -> BlockResult<f64> {
    let truth = |condition: bool| f64::from(u8::from(condition));
    let near = (left - right).abs() < EQUAL;
    Ok(match operator {
        Operator::And => truth(left != 0.0 && right != 0.0),
        Operator::Or => truth(left != 0.0 || right != 0.0),
        Operator::Xor => truth((left != 0.0) != (right != 0.0)),
        Operator::Equal => truth(near),
        Operator::NotEqual => truth(!near),
        Operator::Greater => truth(left > right),
        Operator::GreaterOrEqual => truth(left >= right || near),
        Operator::Less => truth(left < right),
        Operator::LessOrEqual => truth(left <= right || near),
        Operator::Add => left + right,
        Operator::Subtract => left - right,
        Operator::Multiply => left * right,
        Operator::Divide | Operator::Modulo if right == 0.0 => {
            return fault(ErrorCode::DivisionByZero, op.span(), ErrorCode::DivisionByZero.title());
        }
        Operator::Divide => left / right,
        Operator::Modulo => {
            let rest = left % right;
            if rest < 0.0 { rest + right.abs() } else { rest }
        }
        Operator::Power if left < 0.0 && right.fract() != 0.0 => {
            return fault(
                ErrorCode::OutOfDomain,
                op.span(),
                format!("{left} cannot be raised to the power of {right}"),
            );
        }
        Operator::Power => left.powf(right),
    })
}
