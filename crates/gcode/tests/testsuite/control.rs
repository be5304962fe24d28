//! O words: the lines that a program executes, and their order.

use crate::common;

use common::canon_text;
use retrace_gcode::{Setup, check};

/// Returns the X coordinates of the moves of a program, in order.
fn moves(program: &str) -> Vec<String> {
    let (text, failed) = canon_text(&format!("{program}\nM2\n"));
    assert!(!failed, "{text}");
    let mark = "STRAIGHT_TRAVERSE(";
    text.lines()
        .filter_map(|line| line.split_once(mark))
        .map(|(_, arguments)| arguments.split('.').next().unwrap_or_default().to_owned())
        .collect()
}

/// Returns the numbers of the errors of a program.
fn errors(program: &str) -> Vec<&'static str> {
    check(program.as_bytes(), Setup::default()).iter().map(|found| found.number()).collect()
}

#[test]
fn a_subprogram_may_stand_before_or_behind_its_call_and_behind_the_end() {
    assert_eq!(moves("O1 sub\nG0 X#1\nO1 endsub\nO1 call [3]\nO1 call [#31]"), ["3", "0"]);
    assert_eq!(moves("O<Late One> call [4]\nG0 X5\nM2\nO<lateone> sub\nG0 X#1\nO<LATEONE> endsub"), ["4", "5"]);
}

#[test]
fn a_call_has_its_own_parameters_and_gives_the_callers_back() {
    let sub = "O1 sub\n#1=[#1+#2]\n#<own>=9\n#31=#1\nO1 return [#1]\nG0 X99\nO1 endsub\n";
    assert_eq!(
        moves(&format!("{sub}#1=2\n#<own>=1\nO1 call [5] [6]\nG0 X#31\nG0 X#1\nG0 X#<own>\nG0 X#<_value>")),
        ["11", "2", "1", "11"]
    );
}

#[test]
fn a_return_leaves_the_subprogram_that_it_stands_in_whatever_its_label() {
    let sub =
        "O<probe> sub\nO2 if [#1]\nG0 X1\nO<found> return [7]\nO2 endif\nG0 X2\nO3 return\nG0 X3\nO<probe> endsub\n";
    assert_eq!(moves(&format!("{sub}O<probe> call [1]\nG0 X#<_value>\nO<probe> call [0]")), ["1", "7", "2"]);
    // Its label may be that of the branch around it, and of the caller, which continues.
    assert_eq!(moves("O1 sub\nO2 if [1]\nO2 return\nO2 endif\nG0 X2\nO1 endsub\nO1 call\nG0 X5"), ["5"]);
    assert_eq!(moves("O1 sub\nO4 return\nO1 endsub\nO4 sub\nO1 call\nG0 X6\nO4 endsub\nO4 call\nG0 X5"), ["6", "5"]);
    assert_eq!(errors("M98 P1\nM2\nO1\nO2 return\nM99"), ["E1803"]);
}

/// As in `rs274 -g`.
#[test]
fn m98_has_a_level_with_names_of_its_own_and_shares_the_numbers() {
    let sub = "M2\nO7\nG0 X#<_call_level>\nG0 X#1\n#1=[#1+1]\n#<own>=[EXISTS[#<own>]+20]\nG0 X#<own>\nM73\nG91\nM99";
    assert_eq!(
        moves(&format!("#1=5\n#<own>=9\nM98 P7 L2\nG0 X#<own>\nG0 X#1\n{sub}")),
        ["1", "5", "20", "1", "6", "20", "9", "7"]
    );
}

#[test]
fn one_branch_of_an_if_is_taken() {
    let branches =
        "O1 if [#1 EQ 1]\nG0 X1\nO1 elseif [#1 EQ 2]\nG0 X2\nO1 elseif [1/[#1-3]]\nG0 X3\nO1 else\nG0 X4\nO1 endif\n";
    for (value, taken) in [(1, "1"), (2, "2"), (5, "3")] {
        assert_eq!(moves(&format!("#1={value}\n{branches}G0 X9")), [taken, "9"]);
    }
    assert_eq!(moves("O1 if [0]\nG0 X1\nO2 if [1]\nO2 else\nO2 endif\nO1 else\nG0 X4\nO1 endif"), ["4"]);
}

#[test]
fn loops_run_as_often_as_they_say() {
    assert_eq!(moves("O1 while [#1 LT 3]\n#1=[#1+1]\nG0 X#1\nO1 endwhile"), ["1", "2", "3"]);
    assert_eq!(moves("O1 do\n#1=[#1+1]\nG0 X#1\nO1 while [#1 LT 3]"), ["1", "2", "3"]);
    assert_eq!(moves("#1=7\nO1 do\nG0 X#1\nO1 while [0]"), ["7"]);
    assert_eq!(
        moves("O1 repeat [2]\nO2 repeat [2]\n#1=[#1+1]\nG0 X#1\nO2 endrepeat\nO1 endrepeat"),
        ["1", "2", "3", "4"]
    );
    assert_eq!(moves("O1 repeat [0]\nG0 X1\nO1 endrepeat\nO2 while [0]\nG0 X2\nO2 endwhile"), [""; 0]);
}

#[test]
fn break_and_continue_leave_a_round() {
    for (begin, end) in
        [("O1 while [#1 LT 5]", "O1 endwhile"), ("O1 do", "O1 while [#1 LT 5]"), ("O1 repeat [5]", "O1 endrepeat")]
    {
        let skip = "O2 if [#1 EQ 2]\nO1 continue\nO2 elseif [#1 EQ 4]\nO1 break\nO2 endif";
        assert_eq!(moves(&format!("{begin}\n#1=[#1+1]\n{skip}\nG0 X#1\n{end}\nG0 X9")), ["1", "3", "9"], "{begin}");
    }
}

#[test]
fn a_return_out_of_a_loop_closes_it() {
    let program = "O1 sub\nO2 while [1]\nO3 if [1]\nO1 return\nO3 endif\nO2 endwhile\nO1 endsub\n";
    assert_eq!(moves(&format!("{program}O5 repeat [2]\nO1 call\nG0 X3\nO5 endrepeat")), ["3", "3"]);
}

#[test]
fn what_does_not_fit_is_refused_by_number_and_the_program_goes_on() {
    for (line, number) in [
        ("O1 endwhile", "E1803"),
        ("O1 break", "E1803"),
        ("O1 return", "E1803"),
        ("O1 endsub", "E1803"),
        ("O1 call", "E1804"),
        ("O1 while [0]", "E1802"),
        ("O1 if [0]", "E1802"),
        ("O1 if", "E1801"),
        ("O1 if 1", "E1801"),
        ("O1 jump", "E1801"),
        ("O1 call X1", "E1801"),
        ("O#1 call", "E1804"),
        ("O#1 sub", "E1801"),
        ("M98", "E1505"),
        ("M98 P3", "E1804"),
        ("M98 P3 X1", "E1801"),
        ("O<open call", "E1801"),
        ("G0 X1 O1 call", "E1801"),
        ("O1 if [1/0]\nO1 endif", "E1204"),
        // errors that result from an unreadable line are not reported separately
        ("O1 if [foo]\nG0 X1\nO1 else\nO1 endif", "E1201"),
        ("N5 O1 sub]\nO1 return\nO1 endsub", "E1801"),
        ("O1 repeat [2]\nG0 X1\nO1 endrepeat [", "E1101"),
    ] {
        assert_eq!(errors(&format!("{line}\nG0 X1 X2\nM2\n")), [number, "E1407"], "{line}");
    }
}

#[test]
fn recursion_and_loops_without_end_are_found() {
    let recursion = "O1 sub\nO1 call\nO1 endsub\nO1 call\nM2\n";
    assert!(errors(recursion).contains(&"E1805"));
    assert_eq!(errors("O1 while [1]\nO1 endwhile\nM2\n"), ["E1806"]);
}

#[test]
fn comments_show_the_values_of_parameters() {
    let program = "#1=-0.0000009 #2=12.5 #<Some Name>=-3\n(debug,a#1 b#2 #<somename>#<none> # \
        c)\n(PRINT,#2)\n#5599=0\n(debug,x)\nM2\n";
    let (text, failed) = canon_text(program);
    assert!(!failed);
    assert!(text.contains("MESSAGE(\"a0.000000 b12.500000 -3.000000###### # c\")\n12.500000\n"), "{text}");
    assert!(!text.contains("\"x\""), "{text}");
}

#[test]
fn fanuc_subprograms_are_refused_where_the_machine_disables_them() {
    let setup = || Setup { disable_fanuc_subs: true, ..Setup::default() };
    let errors = |program: &str| -> Vec<&'static str> {
        check(program.as_bytes(), setup()).iter().map(|found| found.number()).collect()
    };
    assert_eq!(errors("M98 P1\nM2\n"), ["E1732"]);
    assert_eq!(errors("G0 X1\nM99\n"), ["E1732", "E1006"]);
    assert_eq!(errors("O33\nG0 X1\nM2\n"), ["E1732"]);
    assert!(errors("O1 sub\nO1 endsub\nO1 call\nM2\n").is_empty());
}

/// As in `rs274 -g`.
#[test]
fn exists_of_a_number_that_is_none_is_0_and_its_inside_is_evaluated() {
    for (text, wanted) in [
        ("#5", "1"),
        ("#5601", "1"),
        ("#5602", "0"),
        ("#99999", "0"),
        ("#0", "0"),
        ("#-3", "0"),
        ("##2", "0"),
        ("##3", "1"),
    ] {
        assert_eq!(moves(&format!("#3=7\nG0 X[EXISTS[{text}]]")), [wanted], "{text}");
    }
    for (text, number) in [("#[1/0]", "E1204"), ("##<none>", "E1302"), ("#5.5", "E1104"), ("##99999", "E1301")] {
        assert_eq!(errors(&format!("G0 X[EXISTS[{text}]]\nM2\n")), [number], "{text}");
    }
}

#[test]
fn loops_of_fanuc_macros_are_carried_out() {
    let nested = "#1=0\nWHILE [#1 LT 2] DO1\n#1=[#1+1]\n#2=0\nN20 WHILE[#2LT2]DO2 (inner)\n#2=[#2+1]\nG0 \
        X[10*#1+#2]\nEND2\nEND1\n";
    assert_eq!(moves(nested), ["11", "12", "21", "22"]);
    // The next loop may have the same number.
    let twice = "#1=0\nwhile [#1 lt 1] do1\n#1=1\nG0 X5\nend1\nWHILE [#1 LT 3] DO1\n#1=[#1+1]\nG0 X#1\nEND1";
    assert_eq!(moves(twice), ["5", "2", "3"]);
    assert_eq!(errors("WHILE [1] DO1\nG0 X1\nM2\n"), ["E1802"]);
    assert_eq!(errors("END1\nM2\n"), ["E1803"]);
    assert_eq!(errors("WHILE [#31 LT 1] DO1\nWHILE [0] DO2\n#31=1\nEND1\nEND2\nM2\n").first(), Some(&"E1802"));
}
