//! Where a program goes on: subprograms, branches and loops.
//!
//! Invariant: a jump lands on a line of the same label and kind of block; loops that a jump leaves are closed, and a call's loops end
//! with it.

use crate::codes::Code;
use crate::control::{Control, Keyword, Label, scan};
use crate::diag::{Outcome, fault};
use crate::interp::Interpreter;
use crate::lines::Lines;
use crate::params::Frame;
use std::collections::HashMap;
use std::io::BufRead;

/// Calls that may be open at once, as in LinuxCNC.
const MOST_CALLS: usize = 9;

#[derive(Debug)]
struct Call {
    label: Label,
    /// The line of the call.
    line: u32,
    frame: Frame,
    /// Loops that were open before.
    loops: usize,
}

#[derive(Debug)]
struct Loop {
    label: Label,
    /// Its first line: while, do or repeat.
    line: u32,
    begin: Keyword,
    /// Rounds of a repeat that are still to come.
    rounds: i64,
}

/// What is open, and where labels have been found.
#[derive(Debug, Default)]
pub(crate) struct Nesting {
    calls: Vec<Call>,
    loops: Vec<Loop>,
    /// Lines of sub.
    subs: HashMap<Label, u32>,
    /// Where the search from a line for an end of a kind has ended.
    ends: HashMap<(u32, Keyword), u32>,
    /// No branch of this if has been taken yet.
    undecided: Option<Label>,
    has_jumped: bool,
}

impl Nesting {
    /// Carries out the line's O word: evaluates its values and makes another line the next one where it asks for that.
    pub(crate) fn carry_out<R: BufRead>(
        &mut self,
        control: &Control,
        lines: &mut Lines<R>,
        interpreter: &mut Interpreter,
    ) -> Outcome<()> {
        lines.keep();
        self.has_jumped = true;
        let line = lines.number();
        match control.keyword {
            Keyword::Sub => {
                self.subs.insert(control.label.clone(), line);
                self.skip_to(control, Keyword::EndSub, lines)
            }
            Keyword::Call => self.call(control, lines, interpreter),
            Keyword::Return | Keyword::EndSub => self.leave(control, lines, interpreter),
            Keyword::If => self.branch(control, lines, interpreter),
            Keyword::ElseIf if self.undecided.as_ref() == Some(&control.label) => {
                self.branch(control, lines, interpreter)
            }
            Keyword::Else if self.undecided.as_ref() == Some(&control.label) => {
                self.undecided = None;
                Ok(())
            }
            Keyword::ElseIf | Keyword::Else => self.skip_to(control, Keyword::EndIf, lines),
            Keyword::EndIf => {
                self.undecided = None;
                Ok(())
            }
            Keyword::While => self.while_line(control, lines, interpreter),
            Keyword::Do => {
                self.open(control, line, 0);
                Ok(())
            }
            Keyword::Repeat => {
                let rounds = interpreter.control_value()?.round() as i64;
                if rounds < 1 {
                    return self.skip_to(control, Keyword::EndRepeat, lines);
                }
                self.open(control, line, rounds);
                Ok(())
            }
            Keyword::EndWhile | Keyword::EndRepeat => self.end_loop(control, lines),
            Keyword::Break | Keyword::Continue => self.leave_round(control, lines),
        }
    }

    /// Whether the program has had an O word.
    pub(crate) fn has_jumped(&self) -> bool {
        self.has_jumped
    }

    fn open(&mut self, control: &Control, line: u32, rounds: i64) {
        let (label, begin) = (control.label.clone(), control.keyword);
        self.loops.push(Loop { label, line, begin, rounds });
    }

    /// Loops that were open before the innermost call.
    fn outer_loops(&self) -> usize {
        self.calls.last().map_or(0, |call| call.loops)
    }

    /// Goes to the line behind the one that ends the block, or for a branch to the line that decides on.
    fn skip_to<R: BufRead>(&mut self, control: &Control, end: Keyword, lines: &mut Lines<R>) -> Outcome<()> {
        let from = lines.number();
        if let Some(target) = self.ends.get(&(from, end)) {
            lines.go_to(*target);
            return Ok(());
        }
        let found = self.search(lines, |found| found.label == control.label && found.keyword == end);
        self.arrive(control, from, end, found, lines)
    }

    fn arrive<R: BufRead>(
        &mut self,
        control: &Control,
        from: u32,
        end: Keyword,
        found: bool,
        lines: &mut Lines<R>,
    ) -> Outcome<()> {
        if found {
            self.ends.insert((from, end), lines.number());
            return Ok(());
        }
        lines.go_to(from);
        fault(Code::ControlWithoutEnd, control.at, format!("{} has no end", control.label))
    }

    /// Takes lines until one has the wanted O word; every subprogram on the way is noted.
    fn search<R: BufRead>(&mut self, lines: &mut Lines<R>, wanted: impl Fn(&Control) -> bool) -> bool {
        while lines.advance().unwrap_or(false) {
            let Some(found) = scan(lines.text()) else { continue };
            if found.keyword == Keyword::Sub {
                self.subs.insert(found.label.clone(), lines.number());
            }
            if wanted(&found) {
                return true;
            }
        }
        false
    }

    fn call<R: BufRead>(
        &mut self,
        control: &Control,
        lines: &mut Lines<R>,
        interpreter: &mut Interpreter,
    ) -> Outcome<()> {
        let line = lines.number();
        if self.calls.len() >= MOST_CALLS {
            return fault(Code::TooManyCalls, control.at, Code::TooManyCalls.title());
        }
        interpreter.control_value()?;
        match self.subs.get(&control.label) {
            Some(sub) => lines.go_to(*sub),
            None => {
                let wanted = |found: &Control| found.keyword == Keyword::Sub && found.label == control.label;
                if !self.search(lines, wanted) {
                    lines.go_to(line);
                    let message = format!("the program has no subprogram {}", control.label);
                    return fault(Code::NoSuchSub, control.at, message);
                }
            }
        }
        let frame = interpreter.enter_sub();
        let (label, loops) = (control.label.clone(), self.loops.len());
        self.calls.push(Call { label, line, frame, loops });
        Ok(())
    }

    fn leave<R: BufRead>(
        &mut self,
        control: &Control,
        lines: &mut Lines<R>,
        interpreter: &mut Interpreter,
    ) -> Outcome<()> {
        if self.calls.last().is_none_or(|call| call.label != control.label) {
            let message = format!("{} is not being carried out here", control.label);
            return fault(Code::ControlWithoutBegin, control.at, message);
        }
        let value = interpreter.control_value()?;
        let value = interpreter.has_control_value().then_some(value);
        if let Some(call) = self.calls.pop() {
            self.loops.truncate(call.loops);
            self.undecided = None;
            interpreter.leave_sub(call.frame, value);
            lines.go_to(call.line);
        }
        Ok(())
    }

    /// if, elseif: on, or to the next line that decides.
    fn branch<R: BufRead>(
        &mut self,
        control: &Control,
        lines: &mut Lines<R>,
        interpreter: &mut Interpreter,
    ) -> Outcome<()> {
        self.undecided = None;
        if interpreter.control_value()? != 0.0 {
            return Ok(());
        }
        let from = lines.number();
        self.undecided = Some(control.label.clone());
        // The deciding line itself is to be taken next, so the search stops one line before it.
        let target = match self.ends.get(&(from, Keyword::Else)) {
            Some(target) => *target,
            None => {
                let decides = |keyword| matches!(keyword, Keyword::ElseIf | Keyword::Else | Keyword::EndIf);
                let found = self.search(lines, |found| found.label == control.label && decides(found.keyword));
                self.arrive(control, from, Keyword::Else, found, lines)?;
                lines.number()
            }
        };
        lines.go_to(target - 1);
        Ok(())
    }

    /// The beginning of a while, or the end of a do.
    fn while_line<R: BufRead>(
        &mut self,
        control: &Control,
        lines: &mut Lines<R>,
        interpreter: &mut Interpreter,
    ) -> Outcome<()> {
        let line = lines.number();
        let goes_on = interpreter.control_value()? != 0.0;
        let outer = self.outer_loops();
        let innermost = self.loops[outer..].last().filter(|open| open.label == control.label);
        match innermost.map(|open| (open.begin, open.line)) {
            Some((Keyword::Do, begin)) => {
                if goes_on {
                    lines.go_to(begin);
                } else {
                    self.loops.pop();
                }
                Ok(())
            }
            Some((Keyword::While, begin)) if begin == line => {
                if goes_on {
                    return Ok(());
                }
                self.loops.pop();
                self.skip_to(control, Keyword::EndWhile, lines)
            }
            _ if goes_on => {
                self.open(control, line, 0);
                Ok(())
            }
            _ => self.skip_to(control, Keyword::EndWhile, lines),
        }
    }

    /// endwhile, endrepeat: back to the beginning while there is another round.
    fn end_loop<R: BufRead>(&mut self, control: &Control, lines: &mut Lines<R>) -> Outcome<()> {
        let begin = if control.keyword == Keyword::EndWhile { Keyword::While } else { Keyword::Repeat };
        let outer = self.outer_loops();
        let innermost = self.loops[outer..].last_mut();
        let Some(open) = innermost.filter(|open| open.label == control.label && open.begin == begin) else {
            let message = format!("no loop of {} is open here", control.label);
            return fault(Code::ControlWithoutBegin, control.at, message);
        };
        if begin == Keyword::While {
            lines.go_to(open.line - 1);
            return Ok(());
        }
        open.rounds -= 1;
        if open.rounds > 0 {
            lines.go_to(open.line);
        } else {
            self.loops.pop();
        }
        Ok(())
    }

    /// break, continue: inner loops are left with it.
    fn leave_round<R: BufRead>(&mut self, control: &Control, lines: &mut Lines<R>) -> Outcome<()> {
        let outer = self.outer_loops();
        let Some(index) = self.loops[outer..].iter().rposition(|open| open.label == control.label) else {
            let message = format!("no loop of {} is open here", control.label);
            return fault(Code::ControlWithoutBegin, control.at, message);
        };
        self.loops.truncate(outer + index + 1);
        let (begin, line) = self.loops.last().map_or((Keyword::While, 1), |open| (open.begin, open.line));
        let end = match begin {
            Keyword::Repeat => Keyword::EndRepeat,
            Keyword::Do => Keyword::While,
            _ => Keyword::EndWhile,
        };
        self.undecided = None;
        if control.keyword == Keyword::Break {
            self.loops.pop();
            return self.skip_to(control, end, lines);
        }
        if begin == Keyword::While {
            lines.go_to(line - 1);
            return Ok(());
        }
        self.skip_to(control, end, lines)?;
        let end_line = lines.number();
        lines.go_to(end_line - 1);
        Ok(())
    }
}
