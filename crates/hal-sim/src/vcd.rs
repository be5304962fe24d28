//! Value change dumps: the file format of wave viewers (IEEE 1364-2005, clause 18).
//!
//! Invariant: times never decrease, and a value is written only where it changes, so the file grows with the number of
//! changes.

use std::io::{self, Write};

/// A signal of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signal(usize);

#[derive(Clone, Debug)]
struct Variable {
    code: String,
    width: u8,
    value: Option<u64>,
}

/// A file being written; its unit of time is a nanosecond.
#[derive(Debug)]
pub struct Vcd<W: Write> {
    out: W,
    variables: Vec<Variable>,
    now_ns: Option<u64>,
    scope: Option<String>,
}

impl<W: Write> Vcd<W> {
    /// Begins a file; signals follow.
    ///
    /// # Errors
    /// The error of the writer, here as in all functions that follow.
    pub fn new(mut out: W) -> io::Result<Self> {
        writeln!(out, "$version retrace $end\n$timescale 1 ns $end")?;
        Ok(Self { out, variables: Vec::new(), now_ns: None, scope: None })
    }

    /// Declares a signal of `width` bits (1 … 64) in a group.
    pub fn signal(&mut self, scope: &str, name: &str, width: u8) -> io::Result<Signal> {
        let kind = if width == 1 { "wire" } else { "integer" };
        self.declare(scope, name, kind, width)
    }

    /// Declares a signal with a real value.
    pub fn real(&mut self, scope: &str, name: &str) -> io::Result<Signal> {
        self.declare(scope, name, "real", 0)
    }

    fn declare(&mut self, scope: &str, name: &str, kind: &str, width: u8) -> io::Result<Signal> {
        if self.scope.as_deref() != Some(scope) {
            if self.scope.is_some() {
                writeln!(self.out, "$upscope $end")?;
            }
            writeln!(self.out, "$scope module {scope} $end")?;
            self.scope = Some(scope.to_owned());
        }
        let code = code(self.variables.len());
        writeln!(self.out, "$var {kind} {} {code} {name} $end", if width == 0 { 64 } else { width })?;
        self.variables.push(Variable { code, width, value: None });
        Ok(Signal(self.variables.len() - 1))
    }

    /// Ends the declarations.
    pub fn begin(&mut self) -> io::Result<()> {
        if self.scope.take().is_some() {
            writeln!(self.out, "$upscope $end")?;
        }
        writeln!(self.out, "$enddefinitions $end")
    }

    /// Sets the value of a signal from `at_ns` on. A time before the last one counts as the last one.
    pub fn set(&mut self, at_ns: u64, signal: Signal, value: u64) -> io::Result<()> {
        let variable = &mut self.variables[signal.0];
        if variable.value == Some(value) {
            return Ok(());
        }
        variable.value = Some(value);
        if self.now_ns.is_none_or(|now| now < at_ns) {
            self.now_ns = Some(at_ns);
            writeln!(self.out, "#{at_ns}")?;
        }
        match variable.width {
            0 => writeln!(self.out, "r{} {}", f64::from_bits(value), variable.code),
            1 => writeln!(self.out, "{}{}", value & 1, variable.code),
            width => {
                let bits = if width >= 64 { value } else { value & ((1 << width) - 1) };
                writeln!(self.out, "b{bits:b} {}", variable.code)
            }
        }
    }

    /// Sets the value of a real signal from `at_ns` on.
    pub fn set_real(&mut self, at_ns: u64, signal: Signal, value: f64) -> io::Result<()> {
        self.set(at_ns, signal, value.to_bits())
    }

    /// Flushes the writer.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// The writer.
    pub fn into_inner(self) -> W {
        self.out
    }
}

/// Short name of the n-th signal: printable characters, `!` to `~`.
fn code(mut number: usize) -> String {
    let mut code = String::new();
    loop {
        code.push(char::from(b'!' + (number % 94) as u8));
        number /= 94;
        if number == 0 {
            return code;
        }
        number -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_file_in_full() {
        let mut vcd = Vcd::new(Vec::new()).expect("memory");
        let step = vcd.signal("x", "step", 1).expect("memory");
        let line = vcd.signal("card", "line", 32).expect("memory");
        let rate = vcd.real("card", "rate").expect("memory");
        vcd.begin().expect("memory");
        for (at, value) in [(0, 0), (10, 1), (10, 1), (12, 0), (11, 1)] {
            vcd.set(at, step, value).expect("memory");
        }
        vcd.set(12, line, 6).expect("memory");
        vcd.set_real(20, rate, -0.5).expect("memory");
        vcd.set_real(30, rate, -0.5).expect("memory");
        let text = String::from_utf8(vcd.into_inner()).expect("text");
        let expected = "$version retrace $end\n$timescale 1 ns $end\n$scope module x $end\n$var wire 1 ! step $end\n\
            $upscope $end\n$scope module card $end\n$var integer 32 \" line $end\n$var real 64 # rate $end\n$upscope \
            $end\n\
            $enddefinitions $end\n#0\n0!\n#10\n1!\n#12\n0!\n1!\nb110 \"\n#20\nr-0.5 #\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn short_names_differ() {
        let codes: std::collections::BTreeSet<String> = (0..20_000).map(code).collect();
        assert_eq!(codes.len(), 20_000);
        assert!(codes.iter().all(|code| code.bytes().all(|b| (b'!'..=b'~').contains(&b))));
    }
}
