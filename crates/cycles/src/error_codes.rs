//! The table of errors and warnings of cycle sources, cycle folders and cycle runs: number, title, cause and remedy.
//!
//! Invariant: a number never changes its meaning; `docs/errors.md` has a row for each.

/// Severity of a diagnostic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The block is not executed, or the cycle cannot be called.
    Error,
    /// Legal, but suspicious.
    Warning,
}

/// Generates the enumeration `ErrorCode` from a table: name, number, title, cause and remedy.
#[macro_export]
macro_rules! error_codes {
    ($($name:ident $number:literal $title:literal $cause:literal $remedy:literal;)*) => {
        /// Code of a diagnostic. Numbers from `E` are errors, from `W` warnings.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[allow(missing_docs)] // each has its title in the table below
        pub enum ErrorCode { $($name,)* }

        impl ErrorCode {
            /// All codes, in the order of the table.
            pub const ALL: &'static [ErrorCode] = &[$(ErrorCode::$name,)*];

            /// Returns the number that users see: a letter and four digits.
            #[must_use]
            pub const fn number(self) -> &'static str {
                match self { $(ErrorCode::$name => $number,)* }
            }

            /// Returns whether it is an error or a warning.
            #[must_use]
            pub const fn severity(self) -> $crate::Severity {
                if self.number().as_bytes()[0] == b'W' { $crate::Severity::Warning } else { $crate::Severity::Error }
            }

            /// Returns what is wrong, in general.
            #[must_use]
            pub const fn title(self) -> &'static str {
                match self { $(ErrorCode::$name => $title,)* }
            }

            /// Returns the cause.
            #[must_use]
            pub const fn cause(self) -> &'static str {
                match self { $(ErrorCode::$name => $cause,)* }
            }

            /// Returns the remedy.
            #[must_use]
            pub const fn remedy(self) -> &'static str {
                match self { $(ErrorCode::$name => $remedy,)* }
            }
        }
    };
}

error_codes! {
    NotText "E1901" "cycle source is not text"
        "The line of a cycle source is not valid UTF-8, or has a control character."
        "Save the source as plain text.";
    BadCharacter "E1902" "character not understood in a cycle"
        "Nothing in the cycle language begins with this character."
        "Remove it, or put it after a semicolon.";
    TextNotClosed "E1903" "text in quotes not closed"
        "An opening quotation mark has no closing one in its line."
        "Close the text in the same line.";
    BadNumber "E1904" "number not understood in a cycle"
        "A number has two decimal points, no digits, or is beyond any size."
        "Write it as 12, -0.5, .5 or 1.2EX-3.";
    NotUnderstood "E1905" "block not understood"
        "Something else is needed at this place of the block."
        "Write what the message names; docs/cycles.md describes the language.";
    NameUnknown "E1906" "name not known"
        "A name is not a variable, parameter or function of this cycle."
        "Define it with DEF at the beginning, or correct the spelling.";
    NameTaken "E1907" "name cannot be defined"
        "The name is defined twice, or is a word of the language."
        "Choose another name.";
    TypeMismatch "E1908" "text and number mixed"
        "A text is used where a number is needed, or a number where a text is needed."
        "Give a value of the other type.";
    ValueMissing "E1909" "value missing"
        "An operator, a comma or an equals sign is not followed by a value."
        "Write the value.";
    NotClosed "E1910" "bracket or parenthesis not closed"
        "An opening one has no closing one in its block."
        "Close it.";
    TooDeep "E1911" "nested too deep"
        "Parentheses or structures are nested deeper than 40."
        "Use variables for parts of the expression, or another cycle for parts of the structure.";
    ComparisonChained "E1912" "comparison of a comparison"
        "AND, OR and XOR bind closer than comparisons, as on the control; or a < b < c is meant."
        "Put every comparison into parentheses: (a > 0) AND (b > 0).";
    FunctionArguments "E1913" "wrong number of arguments"
        "A function of the language is called with the wrong number of arguments."
        "Give as many as the message says.";
    NotOpen "E1914" "end without a beginning"
        "ELSE, ENDIF, ENDWHILE, ENDFOR, ENDLOOP or UNTIL has no IF, WHILE, FOR, LOOP or REPEAT, or another one is \
        still open."
        "Write the beginning, or remove the end.";
    StructureOpen "E1915" "structure not closed"
        "IF, WHILE, FOR, LOOP or REPEAT has no end in this source."
        "Write ENDIF, ENDWHILE, ENDFOR, ENDLOOP or UNTIL.";
    LabelMissing "E1916" "no such label"
        "GOTO, GOTOF or GOTOB names a label that this source does not have."
        "Write the label with a colon at the beginning of a block, or correct the name.";
    LabelTwice "E1917" "label defined twice"
        "Two blocks have the same label."
        "Rename one of them.";
    LabelDirection "E1918" "label is in the other direction"
        "GOTOF jumps towards the end, GOTOB towards the beginning."
        "Use the other one, or GOTO.";
    ProcPlace "E1919" "PROC at the wrong place"
        "PROC is not the first block of the source, or occurs in it twice."
        "Begin the source with one PROC block; one file holds one cycle.";
    AttributeUnknown "E1920" "attribute not known"
        "A word after PROC is not one of SAVE, DISPLOF, DISPLON, SBLOF and PATTERN."
        "Remove it.";
    DefinitionPlace "E1921" "DEF at the wrong place"
        "DEF is after the first block with an effect."
        "Move it to the beginning, after PROC.";
    ArraySize "E1922" "invalid size of an array"
        "An array has no element, more than two dimensions, or more than 1000 elements; or there are more values than \
        elements."
        "Give one or two sizes as whole numbers.";
    ArrayIndex "E1923" "invalid index of an array"
        "An array has no index, a simple variable has one, or the number of indices is wrong."
        "Write as many indices as the definition has sizes.";
    WordUnknown "E1924" "word not known in a cycle"
        "A block of a cycle cannot have this address."
        "Known are G M S F X Y Z A B C U V W I J K AX[] IP[] CR SPOS D.";
    CodeUnknown "E1925" "code not known in a cycle"
        "A cycle cannot have this G or M code, or it is not a constant."
        "Known are G0-G4 G17-G19 G33 G33.1 G40-G42 G60 G64 G90 G91 G94-G97, M0 M1 M3-M9 M17 M19.";
    WordTwice "E1926" "too many words in a block"
        "A block has a word twice, more than 16 words, more than 8 G codes or more than 4 M codes."
        "Remove one, or split the block.";
    TextJoin "E1928" "texts cannot be joined here"
        "<< is used outside of MSG and SETAL."
        "Join texts in MSG and SETAL only.";
    TooLarge "E1929" "cycle too large"
        "A source has more variables, texts, calls or blocks than a cycle can hold."
        "Split it into several cycles.";
    TooManyErrors "E1930" "too many errors in a cycle"
        "More errors than are shown; checking of this source has stopped."
        "Repair those shown and check again.";
    CycleUnknown "E1931" "no such cycle"
        "A cycle calls a cycle that is not in any folder."
        "Correct the name, or add the cycle.";
    CallArguments "E1932" "call of a cycle with wrong arguments"
        "There are more arguments than parameters, or a text is given for a number, or a number for a text."
        "Give the arguments in the order of the PROC line.";
    CycleTwice "E1933" "cycle defined twice"
        "Two sources of the folder define the same name."
        "Rename one of them.";
    SourceUnreadable "E1934" "cycle source cannot be read"
        "The operating system reports an error for a file or folder of cycle sources."
        "Check the file and its permissions.";
    SourceTooLong "E1935" "cycle source too long"
        "A source has more than 1 MiB, or a line more than 10 000 bytes."
        "Split the cycle, or the line.";
    CycleAlarm "E1940" "a cycle refuses its call"
        "A parameter, the tool or the modal state is not what the cycle needs; the message has the alarm number of \
        the control."
        "docs/cycles.md lists the alarms with their remedies.";
    Endless "E1941" "endless cycle"
        "A cycle executed ten million steps in addition to those that its blocks need, or emitted a million blocks."
        "Correct the condition of its loop.";
    CallsTooDeep "E1942" "cycles call too deep"
        "Cycles call each other deeper than 12."
        "Check for a cycle that calls itself.";
    Arithmetic "E1943" "calculation without a result"
        "A division by zero, the root of a negative number, or a result beyond any size."
        "Check the values of the call.";
    IndexRange "E1944" "index outside its array"
        "An index is negative, not below the size of the array, or does not name an axis of the plane."
        "Check the index.";
    BadArgument "E1945" "argument does not fit"
        "An argument is of the wrong type, too long for its parameter, or there are too many."
        "Give the arguments in the order of the PROC line.";
    NoSpeed "E1946" "dwell in revolutions without a speed"
        "G4 S needs a programmed spindle speed above zero."
        "Program S before the call, or give the dwell in seconds.";
    NameNotCallable "E1947" "name that no program can call"
        "The name of a cycle reads as words of a block, as an O word or as a control word, or is too short or too \
        long."
        "Rename the cycle: 2 to 32 letters, digits and underscores, beginning with two letters.";
    ShippedReplaced "W1901" "a shipped cycle is replaced"
        "A source of the folder has the name of a shipped cycle, and replaces it."
        "Rename it if that is not meant.";
    NameDiffers "W1902" "file and cycle have different names"
        "The PROC line names the cycle differently from its file; the PROC line counts."
        "Rename the file.";
    NotStored "W1903" "compiled form not stored"
        "The folder of compiled forms cannot be written; the cycle is recompiled at every start."
        "Check the folder and its permissions.";
    NameIsAddress "W1905" "name is also an address"
        "A variable has the name of an address such as X; in front of = at the beginning of a block it is the \
        variable."
        "Choose a name of two letters or more.";
    StoredTorn "W1906" "compiled form not usable"
        "A file of compiled forms is damaged or of another program; the cycle was recompiled."
        "Nothing needs to be done; check the disk if it recurs.";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_unique_and_in_the_range_of_cycles() {
        let mut numbers: Vec<_> = ErrorCode::ALL.iter().map(|code| code.number()).collect();
        assert!(numbers.iter().all(|number| number[1..].parse::<u32>().is_ok_and(|n| (1901..1960).contains(&n))));
        let all = numbers.len();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), all);
    }
}
