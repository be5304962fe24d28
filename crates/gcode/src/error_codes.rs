//! The table of program errors and warnings: number, title, cause and remedy.
//!
//! Invariant: a number never changes its meaning; `docs/errors.md` has a row for each.

retrace_cycles::error_codes! {
    LineTooLong "E1001" "line too long"
        "A line has more than 252 bytes."
        "Split the line; shorten its comment.";
    NotText "E1002" "not text"
        "The line has bytes outside of comments that are not valid UTF-8, or a control character: the file may be \
        binary."
        "Save the program as plain text.";
    BadCharacter "E1003" "character not understood"
        "No word begins with this character."
        "Remove it, or put it into a comment.";
    UnclosedComment "E1004" "comment not closed"
        "An opening parenthesis has no closing one in its line."
        "Close the comment in the same line, or begin it with a semicolon.";
    NestedComment "E1005" "comment inside a comment"
        "A comment in parentheses holds an opening parenthesis."
        "Use brackets or nothing inside the comment.";
    NoProgramEnd "E1006" "program has no end"
        "The program ends without M2, M30 or a closing percent sign. A streamed program ended inside a line: that \
        line is not executed."
        "End the program with M2 or M30 in a line of its own. If the sender was cut off, `retrace resume --program \
        FILE` continues with the whole program.";
    EmptyProgram "E1007" "program is empty"
        "Every line is blank."
        "Check that this is the file you meant.";
    NoClosingPercent "E1008" "closing percent sign missing"
        "The program opens with a percent sign and ends without one, and without M2 or M30."
        "Add a line with a percent sign, or M2, at the end.";
    BadBlockNumber "E1009" "N word not understood"
        "N is not followed by digits, has more than 18 of them, or is not at the beginning of the block."
        "Write N and digits at the beginning of the block, or leave the N word out.";
    TooManyErrors "E1010" "too many errors"
        "More errors than are shown; checking has stopped."
        "Repair those shown and check again.";
    Unreadable "E1011" "program cannot be read further"
        "The operating system reported an error while reading."
        "Check the file and the connection that it comes through.";
    NotMdi "E1012" "not an MDI block"
        "An MDI block is one line that needs no other: no loop, branch or definition of a subprogram, no MCALL, no \
        G41 or G42, no percent sign."
        "Write it into a program, and run that.";

    LetterO "E1013" "letter O for the digit 0"
        "A word has the letter O where its value has the digit 0."
        "Write the digit 0, as in G0 X10.";
    DecimalComma "E1014" "decimal comma"
        "A number has a comma between its digits."
        "Write a decimal point, as in X10.5.";
    HashComment "E1015" "# does not begin a comment"
        "A number sign begins a parameter such as #1 or #<name>; text follows it."
        "Put the comment into parentheses, or behind a semicolon.";
    HiddenMark "E1016" "invisible character"
        "A byte-order mark or another character without a width is inside the line."
        "Delete the character, or rewrite the line.";
    NumberMissing "E1101" "number missing"
        "A word letter, sign, operator or equals sign is not followed by a value."
        "Write the value, or remove the word.";
    BadNumber "E1102" "number not understood"
        "A number has two decimal points or no digits."
        "Write it as 12, -0.5 or .5; exponents are not known in RS274/NGC.";
    NumberTooLarge "E1103" "number too large"
        "A value is beyond what the word can hold."
        "Check the number.";
    NotAnInteger "E1104" "whole number needed"
        "The word takes a whole number only."
        "Write a whole number.";
    NegativeValue "E1105" "value must not be negative"
        "The word does not accept a negative value."
        "Write a value of at least 0.";

    UnknownFunction "E1201" "function or operator not known"
        "A name in an expression is neither a function nor an operator of RS274/NGC."
        "Known are ABS ACOS ASIN ATAN COS EXISTS EXP FIX FUP LN ROUND SIN SQRT TAN, + - * / ** MOD, EQ NE GT GE LT \
        LE, AND OR XOR.";
    UnclosedBracket "E1202" "bracket not closed"
        "An opening bracket has no closing one in its line."
        "Close the bracket.";
    BracketMissing "E1203" "opening bracket missing"
        "A function's argument is not in brackets, or ATAN lacks the slash and its second argument."
        "Write FUNCTION[x], and ATAN[y]/[x].";
    DivisionByZero "E1204" "division by zero"
        "The divisor of / or MOD is zero."
        "Check the divisor before dividing.";
    OutOfDomain "E1205" "argument out of range"
        "The function has no value for this argument, such as the root of a negative number."
        "Check the argument.";
    NotFinite "E1206" "result is not a finite number"
        "The result of a calculation is infinite or undefined."
        "Check the sizes of the values in it.";
    TooDeep "E1207" "expression too deep"
        "Brackets or operators are nested deeper than 40."
        "Use parameters for parts of it.";

    EqualsCompares "E1208" "= does not compare"
        "An expression has an equals sign, which assigns; EQ compares."
        "Write EQ, as in [#1 EQ 5].";
    ParameterRange "E1301" "no such parameter"
        "Numbered parameters go from 1 to 5601."
        "Use a parameter from 1 to 5000, or a named one.";
    ParameterUndefined "E1302" "named parameter not defined"
        "A named parameter is read before a value was given to it."
        "Assign it first, or test it with EXISTS[#<name>].";
    ParameterReadOnly "E1303" "parameter is read-only"
        "The parameter shows the state of the machine."
        "Assign to another one.";
    EqualsMissing "E1304" "equals sign missing"
        "A parameter at the beginning of an assignment is not followed by =."
        "Write #1=2, or put the parameter behind a word letter.";
    NameNotClosed "E1305" "parameter name not closed"
        "#< is not followed by a name and >."
        "Write #<name>.";

    UnknownG "E1401" "no such G code"
        "RS274/NGC has no G code of this number."
        "Check the number.";
    UnknownM "E1403" "no such M code"
        "RS274/NGC has no M code of this number."
        "Check the number.";
    TwoGOfGroup "E1405" "two G codes of one modal group"
        "A block holds one G code of each modal group at most."
        "Put them into two blocks, or remove one.";
    TwoMOfGroup "E1406" "two M codes of one modal group"
        "A block holds one M code of each modal group at most."
        "Put them into two blocks, or remove one.";
    WordTwice "E1407" "word given twice"
        "A block holds each word letter but G and M once at most."
        "Remove one.";
    WordUnused "E1408" "word not used"
        "No code in the block uses the word."
        "Remove the word, or add the code that it belongs to.";
    AxisMissing "E1409" "machine has no such axis"
        "The word belongs to an axis that the machine does not have."
        "Remove the word, or check the axes in the machine file.";
    TooManyM "E1411" "too many M codes"
        "A block holds four M codes at most."
        "Put them into two blocks.";

    NoMotionMode "E1501" "axis words without a motion"
        "The block has axis words, but no G code uses them and no motion mode is in force."
        "Begin with G0, G1, G2 or G3.";
    AxisWithG80 "E1502" "axis words with G80"
        "G80 ends the motion mode, so nothing uses the axis words."
        "Remove the axis words, or G80.";
    TwoUseAxes "E1503" "two G codes would use the axis words"
        "The block has a motion and G10, G28, G30, G52 or G92."
        "Put them into two blocks.";
    AxesMissing "E1504" "axis words missing"
        "The code uses axis words and has none."
        "Add the axis words.";
    WordMissing "E1505" "word missing"
        "A code in the block needs a word that is missing."
        "Add the word.";
    G53Motion "E1506" "G53 needs G0 or G1"
        "The block with G53 is not a straight move."
        "Write G53 G0 or G53 G1.";
    G53Incremental "E1507" "G53 in incremental mode"
        "Machine coordinates are absolute."
        "Use G90 with G53.";
    ZeroFeed "E1508" "no feed rate"
        "The block has a feed move while the feed rate is zero."
        "Give an F word greater than 0 in this block or before; G94 sets it to zero.";
    InverseTimeFeed "E1509" "F word missing in inverse time mode"
        "In G93 every feed move needs its own F word."
        "Add the F word, or go back to G94.";
    BadL "E1510" "L word not understood"
        "G10 takes L0, L1, L2, L10, L11 and L20; M66 takes L0 to L4."
        "Correct the L word.";
    BadP "E1511" "P word out of range"
        "The P word does not name what the code needs: a coordinate system 0 to 9, or a number of turns of at least 1."
        "Correct the P word.";
    MoveTooLong "E1512" "move takes longer than a day"
        "The length of a feed move is too great for its feed rate."
        "Check F, the end of the move, and the radius and turns of an arc.";

    ArcWordsMissing "E1601" "arc without a centre"
        "The arc has neither R nor a centre word."
        "Add R, or the centre words of the plane: I J in G17, K I in G18, J K in G19.";
    ArcMixed "E1602" "arc with R and centre words"
        "An arc has either a radius or a centre."
        "Remove R, or I, J and K.";
    ArcWrongWord "E1603" "centre word out of the plane"
        "The centre word does not belong to the selected plane."
        "Remove it, or select the plane that was meant.";
    ArcNoEnd "E1604" "arc without an end"
        "An arc with R needs an end word of its plane."
        "Add the end words, or use centre words for a full circle.";
    ArcZeroRadius "E1605" "arc of zero radius"
        "The start or the end is at the centre."
        "Check the centre words.";
    ArcRadiiDiffer "E1606" "radii disagree"
        "The distances of start and end from the centre differ by more than 0.028 mm (0.0028 inch) and by more than \
        0.1 %."
        "Check the end and the centre; give more decimals; check G90.1 and G91.1.";
    ArcSamePoint "E1607" "arc ends where it starts"
        "With R, an arc that ends where it starts has no unique centre."
        "Use centre words for a full circle.";
    ArcRadiusTooSmall "E1608" "radius too small"
        "The distance from start to end is more than twice the radius."
        "Check R and the end.";
    ArcAbsoluteCentre "E1609" "centre word missing in G90.1"
        "With absolute centres both centre words of the plane are needed."
        "Add the centre word, or use G91.1.";
    CycleAxis "E1621" "axis that a cycle does not move"
        "A drilling cycle, G33.1 or G76 has a word of an axis other than X, Y and Z."
        "Move that axis in an earlier block.";
    CycleRepeats "E1622" "number of repeats not possible"
        "L of a drilling cycle is 0, or a block has more than 10 000 holes and pecks."
        "Write an L word of at least 1; check L, Q and the depth.";
    CycleLevels "E1623" "clearance below the bottom"
        "The clearance R of a drilling cycle is below the bottom of the hole."
        "Check R and the depth; with G91, R counts from the initial level and the depth from R.";
    CyclePeck "E1624" "depth of a peck not above zero"
        "Q of G73 or G83 is not greater than 0."
        "Write the depth of one peck as a positive Q word.";
    CycleInverseTime "E1625" "drilling cycle in inverse time mode"
        "G93 gives one time for a block, and a cycle makes many moves."
        "Use G94 or G95.";
    SpindleNotTurning "E1626" "spindle does not turn"
        "The motion is synchronised with the spindle, or stops and restarts it, while the spindle is stopped."
        "Start the spindle first, with S and M3 or M4.";
    SpindleTurnsWrongly "E1627" "spindle turns in the wrong direction"
        "G84 cuts a right-hand thread and needs M3, G74 a left-hand one and needs M4."
        "Start the spindle in the other direction, or use the other cycle.";
    ZeroSpindleSpeed "E1628" "no spindle speed in feed per turn"
        "The block has a feed move under G95 while the spindle speed is zero."
        "Give an S word greater than 0 first.";
    BadOrientation "E1629" "orientation of the spindle not possible"
        "M19 takes R from 0 to 360 degrees, P 0, 1 or 2, and Q greater than 0."
        "Correct the word.";
    NoSuchSpindle "E1630" "no such spindle"
        "$ names a spindle that the machine does not have."
        "Write $0, or leave it out.";
    ZeroPitch "E1631" "no pitch"
        "K of G33 or G33.1, the distance per turn of the spindle, is 0."
        "Write the pitch as K.";
    BadThread "E1632" "thread not possible"
        "The words of G76 contradict each other; the message has the details."
        "Correct the word: P and J above 0, I not 0, J less than K, Q below 90 degrees, L from 0 to 3.";
    TurningPlane "E1633" "turning cycle out of its plane"
        "G70 to G72 work in the plane of X and Z."
        "Select it with G18 first.";
    TurningProfile "E1634" "profile cannot be turned"
        "The subprogram Q of G70 to G72 draws no profile, or one that the cycle cannot follow; the message has the \
        reason."
        "Draw lines and arcs that never turn back along the axis of the cuts; check D.";
    TurningWord "E1635" "word of a turning cycle out of range"
        "D, E, I, P or R of G70 to G72 has an invalid value."
        "Correct the word.";

    CompensationPlane "E1651" "cutter compensation in another plane"
        "G41 and G42 work in the planes of G17 and G18 only."
        "Select G17 or G18 first.";
    CompensationTwice "E1652" "cutter compensation is on already"
        "G41 or G42 is given while one of them is in force."
        "Switch it off with G40 first.";
    CompensationLathe "E1653" "lathe tool outside of G18"
        "The tool has an orientation, from the tool table or an L word, and the plane is not G18."
        "Select G18 first, or use a tool without an orientation.";
    CompensationEntry "E1654" "entry move too short"
        "The first move under cutter compensation is not longer than the tool's radius."
        "Begin farther away from the path, or check the tool's diameter.";
    CompensationExit "E1655" "arc right after G40"
        "The first move after cutter compensation must be straight, because it leads away from the path."
        "Put a G0 or G1 before the arc.";
    CompensationRefuses "E1656" "not possible under cutter compensation"
        "The block would change data that a compensated move, whose end is still open, depends on."
        "Put it before G41 or G42, or after G40.";
    CompensationCorner "E1657" "tool does not fit into the corner"
        "The compensated paths of two moves do not meet, so the tool cannot reach this concave corner."
        "Use a smaller tool, or round the corner with a greater radius.";
    CompensationGouge "E1658" "tool would cut into the path"
        "Between two concave corners the move is too short for the tool, which would cut into its neighbours."
        "Use a smaller tool, or leave the short move out.";
    CompensationArc "E1659" "arc too small for the tool"
        "The tool runs on the inside of an arc whose radius is not greater than its own."
        "Use a smaller tool, or a greater radius.";
    CompensationLate "E1660" "concave corner after a stop"
        "The move before the corner has run to its end before M0, M1 or M60, and would have to end earlier."
        "Put the stop into another block of the path, or switch compensation off around it.";
    CompensationPosition "E1661" "position not known under cutter compensation"
        "An expression reads #5420 to #5428 between G41 or G42 and G40, while the last move waits for its end."
        "Read it before, or use a position that the program itself has stored.";
    CompensationWaits "E1662" "too many blocks wait for the next corner"
        "Under cutter compensation 10 000 moves, switches and comments have followed the last move in the plane, \
        whose end depends on the next one."
        "Switch compensation off with G40 where the path ends.";

    ToolUnknown "E1701" "tool not in the tool table"
        "No line of the tool table has this tool number."
        "Add the tool to the table, or correct the number.";
    ToolTableLine "E1702" "tool table not understood"
        "A line of the tool table has no T word, an unknown word or a bad number."
        "Write lines such as T1 P1 Z0.5 D0.25 ;comment.";
    ParameterFileLine "E1703" "parameter file not understood"
        "A line of the parameter file is not a number and a value, or the numbers do not rise."
        "Write lines such as 5221 0.000000, in rising order.";
    PolarWithoutMotion "E1711" "polar coordinates out of place"
        "@ and ^ are in a block without a motion, with G53, outside of G17, or at the origin without an angle or in \
        G91."
        "Use them with a motion in G17; at the origin use G90 and give the angle too.";
    PolarMixed "E1712" "polar coordinates with X or Y"
        "@ and ^ replace X and Y, and the block has X or Y as well."
        "Write the end in one of the two ways.";
    SplinePlane "E1713" "spline out of its plane"
        "G5 and G5.1 are in the plane of X and Y, and another one is selected."
        "Select G17 first.";
    SplineAxis "E1714" "axis word with a spline"
        "G5 and G5.1 move X and Y only."
        "Move the other axis in a block of its own.";
    SplineWords "E1715" "spline words missing or wrong"
        "G5 takes I and J, or neither, and P and Q; G5.1 takes I and J; a point of G5.2 takes X, Y and a weight P \
        above 0."
        "Add the words that are missing.";
    SplineNotBegun "E1716" "G5.3 without G5.2"
        "G5.3 ends a spline, and none has been begun."
        "Give its points with G5.2 directly before it.";
    SplineTooShort "E1717" "too few control points"
        "A spline needs at least as many points as its order, its start counted with them."
        "Give more points, or a lower order with L.";
    ProbeNowhere "E1719" "probing move without length"
        "The probing move must trip the probe (G38.2, G38.4), and ends where it begins."
        "Give an end that is farther away.";
    BadToolOrientation "E1720" "tool orientation out of range"
        "The orientation of a lathe tool is a number from 0 to 9."
        "Correct the Q word.";
    ToolLoaded "E1721" "tool in the spindle"
        "G10 L0 reads the tool table again, which needs an empty spindle."
        "Write T0 M6 before.";
    InputChoice "E1722" "input not understood"
        "M66 reads one input: a digital one with P, or an analog one with E, which is read at once."
        "Keep one of P and E; with E write L0.";
    WaitTimeout "E1723" "waiting without a limit"
        "M66 with L1 to L4 needs a Q word above 0: the maximum wait in seconds."
        "Add the Q word.";
    UserCodeUndeclared "E1724" "user code not declared"
        "The machine declares the actions of M100 to M199, and this one is not declared."
        "Declare it, or remove it.";
    NothingSaved "E1725" "no modal state is saved here"
        "M72 restores the state that M70 or M73 has saved in the same subprogram, and none is saved."
        "Write M70 first; M71 clears the saved state.";
    ArcPlane "E1727" "arc in a plane of U, V and W"
        "Arcs are not possible in the planes of G17.1, G18.1 and G19.1."
        "Select G17, G18 or G19.";
    Aborted "E1728" "program aborted"
        "A comment with ABORT was executed."
        "Read the text of the comment.";
    ToolChangeNotAlone "E1737" "tool change with other words"
        "The operator changes the tool at a position of its own, or it is measured behind the change: M6 is a call of \
        the subprogram tool_change, which cannot have more in its block than T, F and S, nor a calculated number."
        "Write M6, and the other words in the next block.";
    PythonComment "E1729" "Python in a comment"
        "Comments with PY, PYRUN and PYRELOAD run Python in LinuxCNC; retrace does not run Python."
        "Remove the comment.";
    IniLine "E1730" "machine configuration not understood"
        "A line of the INI file is neither a section in brackets, nor NAME = value, nor a comment."
        "Correct the line.";
    FanucSubsDisabled "E1732" "M98, M99 and O numbers alone are disabled"
        "The INI file has DISABLE_FANUC_STYLE_SUB = 1, and the program has M98, M99 or an O number without a keyword."
        "Use O words (sub, endsub, call), or remove the entry.";
    IniNotSupported "E1731" "machine configuration not supported"
        "An entry of the INI file changes how programs are read, and is not supported."
        "Remove the entry, or run the program without the INI file.";

    NoSuchMaterial "E1733" "no such material"
        "M190 names a material that neither the material table nor a comment of the program has."
        "Add the material to the table, or correct the number; M190 P-1 selects the default.";
    BadMaterialComment "E1734" "material comment not understood"
        "A comment that begins with o=0, o=1 or o=2 declares a material, and one of its items is unknown, missing or \
        out of range."
        "Write (o=0, na=name, ph=…, pd=…, ch=…, fr=…); o=1 and o=2 need nu=number, too.";

    NoSpottingTorch "E1735" "spotting is not supported"
        "M3, M5 or S addresses spindle 2, with which programs for QtPlasmaC mark points with the torch, and the \
        machine file declares no cutter with spindle = 2."
        "Take the marks out of the program, make them with the scribe ($1), or declare a marker with spindle = 2.";
    BadPierceFigure "E1736" "figure of a pierce out of range"
        "M159 sets a figure of the pierces to come, and its Q word is not in the range of that figure."
        "Correct the Q word: P601 has 0, 1 or 2, P602 a percentage, P604 seconds, the others lengths, and lengths per \
        minute, in the units of the program. P609 resets all of them.";

    BadControl "E1801" "O word not understood"
        "The line does not have the form of an O word: label, keyword, values in brackets."
        "Write lines such as O100 if [#1 GT 0]; by number or by name.";
    ControlWithoutEnd "E1802" "end of a block of O words missing"
        "The program ends before the endsub, endif, endwhile, endrepeat or while that belongs to the label."
        "Add the end, with the same label.";
    ControlWithoutBegin "E1803" "beginning of a block of O words missing"
        "An end, else, break or continue has no open block of its label, or a return is outside of every subprogram."
        "Check the label, and the nesting.";
    NoSuchSub "E1804" "no such subprogram"
        "Neither the program nor a file in its folder or in a folder given with --subs has a subprogram of this label."
        "Check the label; put the subprogram into the program, or into a file of its name (O<part> in part.ngc).";
    TooManyCalls "E1805" "calls too deep"
        "Subprograms call each other more than 10 deep."
        "Check for a subprogram that calls itself endlessly.";
    EndlessProgram "E1806" "endless loop without motion"
        "10 million consecutive blocks in loops and calls have been executed without a motion, a dwell, a wait or a \
        stop."
        "Check for an endless loop, or a count with too many digits.";
    CheckStopped "W1004" "checking stopped inside a loop"
        "The limit of blocks in loops and calls was reached, so the rest was not checked. An endless loop with \
        motion, such as a production loop, is reported like this."
        "Nothing, if the loop is intended to be endless; otherwise correct it, or raise the limit with \
        --max-loop-blocks.";

    LabelTwice "E1807" "label used twice"
        "An O label names two blocks of one routine."
        "Give each if, while, do and repeat of a routine a label of its own.";
    SubInSub "E1808" "subprogram inside a subprogram"
        "A sub begins before the endsub of another one."
        "Move it out, or add the missing endsub.";
    SubTwice "E1809" "subprogram defined twice"
        "Two subprograms of the program have one label."
        "Rename one of them.";
    WrongCall "E1810" "wrong kind of call"
        "A subprogram of sub and endsub is called with M98, or one of an O number and M99 with call."
        "Call sub … endsub with O… call, and O… … M99 with M98 P….";
    SubNotArrived "E1811" "call of a subprogram that has not arrived"
        "A program from standard input calls a subprogram that has not been read yet, or that cannot be stored."
        "Put the subprograms before their calls, or run the program from a file.";
    StorageFull "E1812" "program too large to store"
        "The subprograms and loops of a program from standard input exceed 16 MiB, or those of a file 128 MiB, or a \
        file with GOTO 16 MiB; or a program names more than 50 000 parameters."
        "Run the program from a file; move blocks that need not be repeated out of the loop.";
    SubFile "E1813" "subprogram file cannot be used"
        "The file of a subprogram cannot be read, or does not contain a subprogram of its name."
        "Check the file: O<part> is looked for in part.ngc, which holds O<part> sub … O<part> endsub.";

    NotAlone "E1814" "M98 or M99 not alone"
        "M98 or M99 is in a block with other words."
        "Give them a block of their own.";
    MacroControl "E1815" "control word of a macro not understood"
        "A line with WHILE, IF, GOTO, DO or END of a Fanuc macro does not have the required form."
        "Write IF [#1 GT 5] GOTO 100, IF [#1 GT 5] THEN #1=5, GOTO 100, or WHILE [#1 LT 5] DO1 ... END1 with the \
        numbers 1 to 3.";
    NoSuchLineNumber "E1816" "no line of this number"
        "GOTO names a line number (N word) that does not exist in the program, or in the enclosing subprogram of M98."
        "Check the number; N and the number are at the beginning of the line.";
    GoToIntoLoop "E1817" "GOTO into a loop"
        "The line that GOTO names is inside a WHILE loop that does not contain the GOTO."
        "Go to the line of the WHILE, or to one outside of it.";
    MixedMacros "E1818" "O words and macro control words in one file"
        "One file has O words (sub, if, while, repeat, call ...) and the control words of Fanuc macros (GOTO, IF ... \
        THEN, WHILE ... DO)."
        "Write the whole file in one of them; files that call each other may differ. M98, M99 and a program number \
        are allowed with both.";
    GoToBackward "E1819" "GOTO backward in a streamed program"
        "GOTO names a line that has been executed already; a streamed program is not stored."
        "Run the program from a file, or write a WHILE ... DO ... END loop.";
    NoSuchCycle "E1821" "no such cycle"
        "A name and a parenthesis begin the block, and no cycle has that name."
        "Check the name; `retrace cycles` lists the known cycles.";
    BadCycleCall "E1822" "call of a cycle not understood"
        "The arguments are too many, of the wrong type or not closed, or the block has other words."
        "Write NAME(argument, argument, ...), numbers or \"texts\", empty where not programmed; `retrace cycles` \
        shows the parameters.";
    CycleAlarm "E1823" "cycle refused"
        "A cycle has raised an alarm about its arguments, its contour or the state it was called in; or a block of it \
        is wrong."
        "The message has the details; docs/cycles.md lists the alarms.";
    NoContour "E1824" "no such contour"
        "The program has neither a subprogram nor labels of the name that a cycle is given."
        "Give the name of a subprogram (O<NAME> sub ... endsub), or \"START:END\" with these labels in the program.";
    ModalInCycle "E1825" "modal call not possible"
        "MCALL names a cycle that calls the modal cycle itself."
        "Give MCALL a drilling cycle.";

    TextAfterEnd "W1001" "text after the program's end"
        "Lines after M2, M30 or the closing percent sign are not read."
        "Remove them if they are not needed.";
    CycleWarning "W1003" "cycle warns"
        "A cycle has arguments that are legal but suspicious."
        "The message has the details; docs/cycles.md lists the alarms.";
    FeedOfMaterial "W1005" "feed rate differs from the material's"
        "An F word differs by more than 1 from the feed rate of the material in force."
        "Write F#<_hal[plasmac.cut-feed-rate]>, or select the material that was meant (M190).";
    ZIgnored "W1006" "Z words are ignored"
        "The cut cycle rules the height of this cutter, so Z words of straight moves and arcs have no effect. This is \
        reported once for each program."
        "Nothing, if the program is written for such a cutter; otherwise set z_words = \"obeyed\" in its [[cutter]] \
        table, or #<keep-z-motion> = 1 in the program.";
    SmallShare "W1007" "very small share of the feed rate"
        "M67 E3 or M68 E3 sets a share below 10 %, which other controls raise to 10 %."
        "Check the Q word.";
    SpeedOfCutter "W1008" "spindle speed for a cutter"
        "M3 or M4 starts a torch, a jet or a marker, and S is a speed of a spindle: the program is for a spindle, or \
        the machine file names a spindle as a cutter."
        "Use a program that is written for this cutter, or declare the output with kind = \"spindle\" in its \
        [[cutter]] table. Programs for torches have S1.";
    TorchSpeedOfSpindle "W1009" "spindle started like a torch"
        "M3 or M4 starts a spindle, and S is at most 10, as in programs for torches (S1): the machine file names a \
        cutter as a spindle, or declares no cutter. A hold or a program stop leaves a spindle on."
        "Declare what the output switches with [[cutter]] and its kind, \"torch\" or \"jet\"; or correct S.";
    MaterialWithoutTable "W1010" "material comment without effect"
        "The comment declares a material, and no cutter of the machine has a material table, so that it is a plain \
        comment. Materials, M190 and pierce delays belong to a cutter of kind \"torch\", \"jet\" or \"beam\"."
        "Name a table with materials = \"materials.toml\" in the [[cutter]] table.";
    UnknownEffect "W1011" "effect unknown to a check"
        "The number of a code, a parameter, a tool, a subprogram or a line depends on an answer of the machine (G38, \
        M66), so that a check does not know what the block does. It continues with what may have changed unknown; it \
        does not follow a GOTO to an unknown line."
        "Nothing; what follows is checked when it is planned. To have it checked before, write IF blocks with constant \
        numbers.";
    FeedHoldStays "W1012" "the feed hold stays enabled"
        "M53 P0: the operator's feed hold keeps acting, whatever the program says. A machine whose operator presses \
        hold comes to rest."
        "Remove M53 P0, and hold the machine only where the work allows it.";
    SpindleWithoutSpeed "W1002" "spindle started without a speed"
        "M3 or M4 is executed while the spindle speed is zero."
        "Give an S word first.";
}

#[cfg(test)]
mod tests {
    use super::ErrorCode;
    use std::collections::BTreeSet;

    #[test]
    fn a_number_stands_for_one_code() {
        let numbers: BTreeSet<_> = ErrorCode::ALL.iter().map(|code| code.number()).collect();
        assert_eq!(numbers.len(), ErrorCode::ALL.len());
    }

    #[test]
    fn the_document_has_a_row_with_the_same_words_for_each() {
        let document = include_str!("../../../docs/errors.md");
        for code in ErrorCode::ALL {
            let row = format!("| {} | {} | {} | {} |", code.number(), code.title(), code.cause(), code.remedy());
            // in Markdown a bare `<name>` is an HTML tag, and vanishes
            let row = row.replace('<', "\\<");
            assert!(document.lines().any(|line| line == row), "docs/errors.md lacks: {row}");
        }
    }
}
