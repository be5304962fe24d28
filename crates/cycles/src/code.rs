//! The compiled form of a cycle: flat code for a stack machine, with slots for parameters and variables.
//!
//! Invariant: every instruction has its source line; whatever bytes the instructions are read from, they are memory-safe to run,
//! because the machine checks every slot, index and jump again.

use crate::cycle::{Parameter, Type};

/// A compiled source, before its calls are joined to the cycles they name.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Unit {
    /// In capitals.
    pub(crate) name: String,
    pub(crate) parameters: Vec<Parameter>,
    pub(crate) saves: bool,
    pub(crate) is_pattern: bool,
    /// Slots of a frame: the parameters first, then variables, arrays and R parameters.
    pub(crate) slots: u16,
    pub(crate) ops: Vec<Op>,
    /// Source line of each instruction.
    pub(crate) lines: Vec<u32>,
    pub(crate) texts: Vec<String>,
    pub(crate) calls: Vec<CallSite>,
    /// The parameter that names a contour for `STOCKPATH`.
    pub(crate) contour: Option<u16>,
}

/// A call of another cycle.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CallSite {
    /// In capitals.
    pub(crate) name: String,
    pub(crate) line: u32,
    pub(crate) start: u32,
    pub(crate) end: u32,
    pub(crate) arguments: Vec<Passed>,
}

/// What a call gives for a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Passed {
    Nothing,
    Number,
    Text,
    /// The caller's own text parameter, handed on.
    Parameter(u16),
}

/// How a value is converted when it is stored.
pub(crate) fn converted(of: Type, value: f64) -> f64 {
    match of {
        Type::Real | Type::Text(_) => value,
        Type::Int => value.round(),
        Type::Bool => f64::from(value != 0.0),
    }
}

/// Makes a plain enumeration whose values have names in the language, and can be kept as a byte.
macro_rules! named {
    ($(#[$note:meta])* $enum:ident { $($variant:ident $name:literal,)* }) => {
        $(#[$note])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $enum { $($variant,)* }

        impl $enum {
            pub(crate) const ALL: &'static [($enum, &'static str)] = &[$(($enum::$variant, $name),)*];

            /// The one of this name, in capitals.
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
    /// Number of its arguments.
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
    /// Operators between two numbers, and the two before one.
    Operator {
        Add "+", Subtract "-", Multiply "*", Divide "/", WholeDivide "DIV", Modulo "MOD", Equal "==", Unequal "<>", Less "<",
        LessEqual "<=", Greater ">", GreaterEqual ">=", And "AND", Or "OR", Xor "XOR", Not "NOT", Negate "NEGATE",
    }
}

named! {
    /// System variables without an index, or with a constant one.
    System {
        Feed "$P_F", Speed "$P_S", SpindleDirection "$P_SDIR", Offset "$P_TOOL", ToolRadius "$P_TOOLR", ModalCycle "$P_MC",
        EdgePosition "$P_AD[2]", Radius "$P_AD[6]", ClearanceAngle "$P_AD[24]", MotionGroup "$P_GG[1]", PlaneGroup "$P_GG[6]",
        CompensationGroup "$P_GG[7]", UnitsGroup "$P_GG[13]", DistanceGroup "$P_GG[14]", FeedGroup "$P_GG[15]",
        DiameterGroup "$P_GG[29]",
    }
}

/// A value that can be kept as bytes.
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

/// Makes the instructions, and how they are kept as bytes, from one list.
macro_rules! instructions {
    ($($(#[$note:meta])* $name:ident $(($($field:ident: $type:ty),+))?,)*) => {
        /// An instruction. "Takes" is from the top of the stack, the last named on top; "gives" is onto it.
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
    /// Gives a number.
    Number(value: f64),
    /// Gives a text of the unit.
    Text(index: u16),
    /// Gives what a slot holds.
    Load(slot: u16),
    /// Takes a value, and keeps it in a slot.
    Store(slot: u16, of: Type),
    /// Takes an index, gives the element of an array of so many slots.
    LoadAt(base: u16, length: u16),
    /// Takes an index and a value, and keeps the value there.
    StoreAt(base: u16, length: u16, of: Type),
    /// Takes row and column, gives the index of an element of an array with so many rows and columns.
    Element(rows: u16, columns: u16),
    /// Takes one or two numbers, gives one.
    Operate(operator: Operator),
    /// Takes as many numbers as the function has arguments, gives one.
    Call1(function: Function),
    /// Takes two texts, gives 1 if they are equal, or if they are not.
    CompareTexts(unequal: bool),
    /// Goes on elsewhere.
    Jump(target: u32),
    /// Takes a number, and goes on elsewhere if it is 0.
    JumpIfNot(target: u32),
    /// Takes a number, and goes on elsewhere unless it is 0.
    JumpIf(target: u32),
    /// Takes the arguments of a call, and runs another cycle.
    CallCycle(site: u16),
    /// Ends the cycle.
    Return,
    /// Takes the number of a parameter, from 1; gives 1 if the call gave it.
    Programmed,
    /// Gives a system variable.
    Ask(system: System),
    /// Takes the number of an axis of the plane, 1 … 3; gives its programmed position.
    PositionAt,
    /// Gives the programmed position of the axis of this letter.
    PositionOf(letter: u8),
    /// Begins a block.
    Begin,
    /// Adds a G code, in tenths.
    CodeG(tenths: u16),
    /// Takes a number, and adds it as an M code.
    CodeM,
    /// Takes a number, and adds a word.
    Word(letter: u8),
    /// Takes the number of an axis of the plane and a value, and adds the axis' word.
    AxisWord,
    /// Takes the number of an axis of the plane and a value, and adds the word of the centre along that axis.
    CentreWord,
    /// Takes a number of revolutions, and adds the seconds that they last.
    DwellTurns,
    /// Takes an angle, and adds M19 with it.
    Orient,
    /// Gives the block to the host.
    Emit,
    /// Empties the message.
    Clear,
    /// Takes a value, and adds it to the message.
    Join,
    /// Shows the message.
    Show,
    /// Takes a number, and raises the alarm or warning of that number with the message.
    Raise,
    /// Takes the eight arguments of STOCKPATH, gives the number of moves.
    StockPath,
    /// Takes the number of a move and of a column, gives what stands there.
    StockRead,
}
