//! The compiled form of a cycle: flat code for a stack machine, with slots for parameters and variables.
//!
//! Invariant: every instruction has its source line. Instructions read from arbitrary bytes are memory-safe to run,
//! because the virtual machine checks every slot, index and jump again.

use crate::parameter::{Parameter, Type};

/// A compiled source, before its calls are linked to the cycles that they name.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Unit {
    /// Name, in capitals.
    pub(crate) name: String,
    pub(crate) parameters: Vec<Parameter>,
    pub(crate) saves: bool,
    pub(crate) is_pattern: bool,
    /// Number of slots of a frame: the parameters first, then variables, arrays and R parameters.
    pub(crate) slots: u16,
    pub(crate) ops: Vec<Op>,
    /// Source line of each instruction.
    pub(crate) lines: Vec<u32>,
    pub(crate) texts: Vec<String>,
    pub(crate) calls: Vec<CallSite>,
    /// Parameter that names a contour for `STOCKPATH`.
    pub(crate) contour: Option<u16>,
}

/// A call of another cycle.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CallSite {
    /// Name, in capitals.
    pub(crate) name: String,
    pub(crate) line: u32,
    pub(crate) start: u32,
    pub(crate) end: u32,
    pub(crate) arguments: Vec<Passed>,
}

/// Argument that a call passes for a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Passed {
    Nothing,
    Number,
    Text,
    /// The caller's own text parameter, passed on.
    Parameter(u16),
}

/// Converts a value to the type in which it is stored.
pub(crate) fn converted(of: Type, value: f64) -> f64 {
    match of {
        Type::Real | Type::Text(_) => value,
        Type::Int => value.round(),
        Type::Bool => f64::from(value != 0.0),
    }
}

/// Defines a plain enumeration whose values have names in the language, and which is stored as a byte.
macro_rules! named {
    ($(#[$note:meta])* $enum:ident { $($variant:ident $name:literal,)* }) => {
        $(#[$note])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $enum { $($variant,)* }

        impl $enum {
            pub(crate) const ALL: &'static [($enum, &'static str)] = &[$(($enum::$variant, $name),)*];

            /// Returns the value of this name, in capitals.
            pub(crate) fn named(name: &str) -> Option<Self> {
                Self::ALL.iter().find(|(_, known)| *known == name).map(|(this, _)| *this)
            }
        }

        impl Operand for $enum {
            fn put(self, out: &mut Vec<u8>) {
                out.push(self as u8);
            }

            fn take(input: &mut Input<'_>) -> Option<Self> {
                Self::ALL.get(usize::from(u8::take(input)?)).map(|(this, _)| *this)
            }
        }
    };
}

named! {
    /// Functions of numbers; angles are in degrees.
    Function {
        Abs "ABS", Sin "SIN", Cos "COS", Tan "TAN", Asin "ASIN", Acos "ACOS", Atan2 "ATAN2", Sqrt "SQRT", Square "POT",
        Trunc "TRUNC", Round "ROUND", Ln "LN", Exp "EXP", Least "MINVAL", Greatest "MAXVAL", Bound "BOUND",
    }
}

impl Function {
    /// Returns the number of arguments.
    pub(crate) const fn arguments(self) -> usize {
        match self {
            Self::Atan2 | Self::Least | Self::Greatest => 2,
            Self::Bound => 3,
            _ => 1,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        Self::ALL.iter().find(|(this, _)| *this == self).map_or("", |(_, name)| name)
    }
}

named! {
    /// Operators between two numbers, and the two unary ones.
    Operator {
        Add "+", Subtract "-", Multiply "*", Divide "/", WholeDivide "DIV", Modulo "MOD", Equal "==", Unequal "<>",
            Less "<",
        LessEqual "<=", Greater ">", GreaterEqual ">=", And "AND", Or "OR", Xor "XOR", Not "NOT", Negate "NEGATE",
    }
}

named! {
    /// System variables without an index, or with a constant one.
    System {
        Feed "$P_F", Speed "$P_S", SpindleDirection "$P_SDIR", Offset "$P_TOOL", ToolRadius "$P_TOOLR",
            ModalCycle "$P_MC",
        EdgePosition "$P_AD[2]", Radius "$P_AD[6]", ClearanceAngle "$P_AD[24]", MotionGroup "$P_GG[1]",
            PlaneGroup "$P_GG[6]",
        CompensationGroup "$P_GG[7]", UnitsGroup "$P_GG[13]", DistanceGroup "$P_GG[14]", FeedGroup "$P_GG[15]",
        DiameterGroup "$P_GG[29]",
    }
}

/// A value that is stored as bytes.
pub(crate) trait Operand: Copy {
    fn put(self, out: &mut Vec<u8>);
    fn take(input: &mut Input<'_>) -> Option<Self>;
}

/// Bytes that are read from the front.
#[derive(Debug)]
pub(crate) struct Input<'a>(pub(crate) &'a [u8]);

impl<'a> Input<'a> {
    pub(crate) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }
}

macro_rules! operand {
    ($($type:ty),*) => {$(
        impl Operand for $type {
            fn put(self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }

            fn take(input: &mut Input<'_>) -> Option<Self> {
                let bytes = input.bytes(size_of::<Self>())?;
                bytes.try_into().ok().map(Self::from_le_bytes)
            }
        }
    )*};
}

operand!(u8, u16, u32, f64);

impl Operand for bool {
    fn put(self, out: &mut Vec<u8>) {
        out.push(u8::from(self));
    }

    fn take(input: &mut Input<'_>) -> Option<Self> {
        match u8::take(input)? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

impl Operand for Type {
    fn put(self, out: &mut Vec<u8>) {
        let (tag, length) = match self {
            Self::Real => (0_u8, 0),
            Self::Int => (1, 0),
            Self::Bool => (2, 0),
            Self::Text(length) => (3, length),
        };
        tag.put(out);
        length.put(out);
    }

    fn take(input: &mut Input<'_>) -> Option<Self> {
        let (tag, length) = (u8::take(input)?, u16::take(input)?);
        match tag {
            0 => Some(Self::Real),
            1 => Some(Self::Int),
            2 => Some(Self::Bool),
            3 => Some(Self::Text(length)),
            _ => None,
        }
    }
}

/// Defines the instructions, and their storage as bytes, from one list.
macro_rules! instructions {
    ($($(#[$note:meta])* $name:ident $(($($field:ident: $type:ty),+))?,)*) => {
        /// An instruction. "Pops" is from the top of the stack, the last named on top; "pushes" is onto it.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub(crate) enum Op { $($(#[$note])* $name $(($($type),+))?,)* }

        #[derive(Clone, Copy)]
        enum Tag { $($name,)* }

        impl Operand for Op {
            fn put(self, out: &mut Vec<u8>) {
                match self {
                    $(Op::$name $(($($field),+))? => {
                        out.push(Tag::$name as u8);
                        $($($field.put(out);)+)?
                    })*
                }
            }

            fn take(input: &mut Input<'_>) -> Option<Self> {
                let tag = u8::take(input)?;
                $(if tag == Tag::$name as u8 {
                    return Some(Op::$name $(($(<$type>::take(input)?),+))?);
                })*
                None
            }
        }
    };
}

instructions! {
    /// Pushes a number.
    Number(value: f64),
    /// Pushes a text of the unit.
    Text(index: u16),
    /// Pushes the value of a slot.
    Load(slot: u16),
    /// Pops a value, and stores it in a slot.
    Store(slot: u16, of: Type),
    /// Pops an index, pushes the element of an array of so many slots.
    LoadAt(base: u16, length: u16),
    /// Pops an index and a value, and stores the value there.
    StoreAt(base: u16, length: u16, of: Type),
    /// Pops row and column, pushes the index of an element of an array with so many rows and columns.
    Element(rows: u16, columns: u16),
    /// Pops one or two numbers, pushes one.
    Operate(operator: Operator),
    /// Pops as many numbers as the function has arguments, pushes one.
    Call1(function: Function),
    /// Pops two texts, pushes 1 if they are equal, or if they are not.
    CompareTexts(unequal: bool),
    /// Jumps.
    Jump(target: u32),
    /// Pops a number, and jumps if it is 0.
    JumpIfNot(target: u32),
    /// Pops a number, and jumps unless it is 0.
    JumpIf(target: u32),
    /// Pops the arguments of a call, and runs another cycle.
    CallCycle(site: u16),
    /// Ends the cycle.
    Return,
    /// Pops the number of a parameter, from 1; pushes 1 if the call passed it.
    Programmed,
    /// Pushes a system variable.
    Ask(system: System),
    /// Pops the number of an axis of the plane, 1 … 3; pushes its programmed position.
    PositionAt,
    /// Pushes the programmed position of the axis of this letter.
    PositionOf(letter: u8),
    /// Begins a block.
    Begin,
    /// Adds a G code, in tenths.
    CodeG(tenths: u16),
    /// Pops a number, and adds it as an M code.
    CodeM,
    /// Pops a number, and adds a word.
    Word(letter: u8),
    /// Pops the number of an axis of the plane and a value, and adds the axis' word.
    AxisWord,
    /// Pops the number of an axis of the plane and a value, and adds the word of the centre along that axis.
    CentreWord,
    /// Pops a number of revolutions, and adds their duration in seconds.
    DwellTurns,
    /// Pops an angle, and adds M19 with it.
    Orient,
    /// Passes the block to the host.
    Emit,
    /// Clears the message.
    Clear,
    /// Pops a value, and appends it to the message.
    Join,
    /// Sends the message.
    Show,
    /// Pops a number, and raises the alarm or warning of that number with the message.
    Raise,
    /// Pops the eight arguments of STOCKPATH, pushes the number of moves.
    StockPath,
    /// Pops the number of a move and of a column, pushes the value there.
    StockRead,
}
