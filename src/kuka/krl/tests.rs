//! Tests the parser, the checks and their messages with the shipped files, and with one deliberate error for each rule.

use super::{Analysis, Kss, analyse, parse};
use panelprep_base::config::Problem;

const HIGHEST: Option<Kss> = Some(Kss { major: 8, minor: 7 });
const DATA: &str = "DEFDAT CELL_DATA PUBLIC\nGLOBAL STRUC POINT INT ID,N,REAL R,FRAME P\nGLOBAL ENUM COLOUR RED,GREEN\n\
    DECL GLOBAL CONST INT TEN=10\nDECL GLOBAL INT COUNT=0\nDECL GLOBAL INT LIST[10]\nLIST[10]=3\n\
    DECL GLOBAL POINT PLACES[2]\nDECL GLOBAL COLOUR SHADE=#RED\nDECL GLOBAL CHAR WORDS[8]\n\
    WORDS[]=\"abc\"\nENDDAT\n";

/// Returns all messages about a program and the data list [`DATA`], in the form `line: key: message`.
fn reported_messages(program: &str) -> Vec<String> {
    let [problems, warnings, _] = reported(program);
    [problems, warnings].concat()
}

/// Returns three lists: the problems, the warnings, and the parts that are not executed.
fn reported(program: &str) -> [Vec<String>; 3] {
    let files = [("cell_data.dat", DATA), ("a.src", program)].map(|(name, text)| parse(name, text));
    let analysis = analyse(&files, HIGHEST);
    [analysis.problems, analysis.warnings, analysis.unexecuted].map(|found| {
        let line = |problem: &Problem| format!("{}: {}: {}", problem.line, problem.key, problem.message);
        found.concat().iter().map(line).collect()
    })
}

/// Returns the messages about these statements in a routine in which `I`, `R` and `B` have values.
fn messages_about(statements: &str) -> Vec<String> {
    reported_messages(&format!(
        "DEF A( )\nDECL INT I\nDECL REAL R\nDECL BOOL B\nDECL POINT P\nI=1\nR=1.0\nB=FALSE\nP=PLACES[1]\n{statements}\n\
         END\nDEFFCT INT SUM(X:IN,Y:OUT)\nDECL INT X\nDECL REAL Y\nY=1.0\nRETURN X\nENDFCT\n"
    ))
}

#[test]
fn the_shipped_files_have_no_problems() {
    macro_rules! shipped {
        ($($name:literal),*) => { [$(($name, include_str!(concat!("../../../config/kuka/", $name)))),*] };
    }
    let texts = shipped!(
        "cell_config.dat",
        "cell_data.dat",
        "cell_judge.src",
        "cell_link.src",
        "cell_motion.src",
        "cell_submit.src",
        "cell_tell.src",
        "cell_user.src"
    );
    let mut files = Vec::new();
    for (name, text) in texts {
        files.push(parse(name, text));
    }
    let analysis = analyse(&files, HIGHEST);
    assert_eq!(analysis.problems.concat(), []);
    assert_eq!(analysis.warnings.concat(), []);
    assert_eq!(analysis.unexecuted.concat(), []);
    assert!(analysis.program.statements.len() > 600 && analysis.program.routine("CELL_CYCLE").is_some());
}

#[test]
fn common_statements_are_read() {
    let statements = "FOR I=1 TO TEN STEP 2\nLIST[I]=I*2\nENDFOR\nREPEAT\nI=I-1\nUNTIL I<=0\nLOOP\nEXIT\nENDLOOP\n\
        WAIT FOR $IN[3] AND (NOT B)\nPTP {A1 0,A2 -90}\nPTP $AXIS_ACT_MEAS C_PTP\nLIN {X 1,Y 2} C_DIS\n\
        LIN $POS_ACT:P.P\n$OUT[5]=TRUE ; on\n$VEL.CP=0.2\n$APO.CDIS=5\nSWITCH SHADE\nCASE #RED,#GREEN\nHALT\n\
        DEFAULT\nCONTINUE\nENDSWITCH\nWORDS[]=\"abcdefgh\"\nI='H1F' B_AND 'B11'\nR=I\nI=R/2\nB=(I==1) OR B\n\
        INTERRUPT DECL 30 WHEN $FLAG[9] DO A( )\nINTERRUPT ON 30\nINTERRUPT OFF\nI=SUM(3,R)\nI=SUM(R,P.R)\nBRAKE F\n\
        TRIGGER WHEN DISTANCE=0 DELAY=20 DO $OUT[1]=FALSE\nTRIGGER WHEN DISTANCE=1 DELAY=-5 DO A( ) PRIO=-1";
    assert_eq!(messages_about(statements), Vec::<String>::new());
    let foreign = "&REL 4\nDEF A( )\nEXT BAS (BAS_COMMAND :IN,REAL :IN )\nINT I,K\n;FOLD INI\nBAS (#INITMOV,0)\n\
        ;ENDFOLD\nI=1\nK=I\nEND\n";
    assert_eq!(reported_messages(foreign), Vec::<String>::new());
}

/// Each entry is a statement with one error, and the beginning of the expected message; the first statement is in line
/// 10.
#[test]
fn each_planted_mistake_is_reported_with_its_line() {
    for (statement, expected) in [
        ("I=", "10: I: a value is missing at the end of the line"),
        ("I=1 2", "10: I: expected the end of the line, found '2'"),
        ("GOTO X", "10: X: GOTO needs a label in the same routine"),
        ("X:\nI=2\nX:", "12: X: this label already exists: line 10"),
        ("CIRC P.P", "10: CIRC: expected ',', found the end of the line"),
        ("MOVE ME", "10: MOVE: not checked: this parser supports no statement that begins with MOVE"),
        ("MOVE_ME", "10: MOVE_ME: the line is not a KRL statement; to call a routine, write"),
        ("I:=2", "10: I: KRL assigns with '='"),
        ("IF B\nENDIF", "10: IF: expected THEN, found the end of the line"),
        ("IF B THEN", "11: END: ELSE or ENDIF is missing before this line"),
        ("ENDIF", "10: ENDIF: the line ends or continues a block, but no such block is open"),
        ("DECL INT LATE", "10: DECL: a declaration follows a statement"),
        ("SWITCH I\nI=2\nCASE 1\nENDSWITCH", "11: I: the line after SWITCH must be CASE"),
        ("I=2 OR B", "10: OR: this operator is not valid between INT and BOOL; in KRL, comparisons have a"),
        ("B=I==1 AND B", "10: AND: this operator is not valid between INT and BOOL"),
        ("I=B", "10: I: expected INT, found BOOL"),
        ("B=NOT I", "10: NOT: the operator NOT is not valid for INT"),
        ("IF I THEN\nENDIF", "10: : a condition must be BOOL, found INT"),
        ("I=UNKNOWN", "10: UNKNOWN: this name is declared in none of the given files"),
        ("NOWHERE( )", "10: NOWHERE: this routine is defined in none of the given files"),
        ("I=$NO_SUCH", "10: $NO_SUCH: this program does not know this system variable"),
        ("$IN[3]=TRUE", "10: $IN: a program cannot write this variable"),
        ("TEN=3", "10: TEN: a program cannot write this variable"),
        ("I=LIST[0]", "10: LIST: the index 0 is outside of the array (valid: 1 to 10)"),
        ("I=LIST[TEN+1]", "10: LIST: the index 11 is outside of the array"),
        ("FOR I=1 TO 11\nLIST[I]=0\nENDFOR", "11: LIST: the index 11 is outside of the array"),
        ("I=LIST[1,2]", "10: LIST: found 2 indices, expected 1"),
        ("$FLAG[1025]=TRUE", "10: $FLAG: the index 1025 is outside of the array (valid: 1 to 1024)"),
        ("I=P.Q", "10: P: POINT has no component Q; its components are ID, N, R, P"),
        (
            "SHADE=#BLUE",
            "10: #BLUE: this is not a constant of the enumeration COLOUR; its constants are #RED, #GREEN",
        ),
        ("P={ID 1,M 2}", "10: M: POINT has no component M; its components are ID, N, R, P"),
        ("I=SUM(1,R,2)", "10: SUM: found 3 arguments, expected 2"),
        ("BAS(#INITMOV,0,1)", "10: BAS: found 3 arguments, expected 2"),
        ("I=SUM(1,2.0)", "10: Y: SUM needs a variable for this argument (:OUT)"),
        ("I=SUM(1,I)", "10: I: expected a variable of type REAL, found INT"),
        ("I=SUM(B,R)", "10: X: expected INT, found BOOL"),
        ("I=EKI_Open(\"C\")", "10: EKI_OPEN: this function returns an INT only in EthernetKRL 6"),
        ("R=EKI_Open(\"C\")", "10: R: expected REAL, found EKI_STATUS"),
        ("RETURN 1", "10: RETURN: a DEF routine cannot return a value"),
        ("EXIT", "10: EXIT: EXIT is valid only inside a loop"),
        ("LIN I", "10: : INT is not a valid target for this motion"),
        ("LIN P.P C_PTP", "10: LIN: not checked: approximate a LIN motion with"),
        ("WAIT 3", "10: WAIT: expected SEC or FOR after WAIT"),
        ("TRIGGER WHEN DISTANCE=1 DELAY=0 DO A( )", "10: TRIGGER: a TRIGGER that calls a routine needs PRIO"),
        ("A_NAME_THAT_IS_FAR_TOO_LONG=1", "10: A_NAME_THAT_IS_FAR_TOO_LONG: this name is declared in none"),
    ] {
        let reported = messages_about(statement);
        assert!(
            reported.iter().any(|reported| reported.starts_with(expected)),
            "{statement}: {reported:#?} instead of {expected}"
        );
    }
}

#[test]
fn incomplete_routines_are_reported() {
    for (program, expected) in [
        ("DEF A( )\nDECL INT I\nI=I+1\nEND", "3: I: this local variable may be read here before"),
        (
            "DEF A( )\nDECL INT I\nIF COUNT>0 THEN\nI=1\nENDIF\nCOUNT=I\nEND",
            "6: I: this local variable may be read",
        ),
        ("DEF A( )\nDECL INT I\nI=EKI_GetInt(\"C\",\"T\",I)\nEND", "3: I: this local variable may be read"),
        (
            "DEF A( )\nEND\nDEFFCT INT F( )\nIF COUNT>0 THEN\nRETURN 1\nENDIF\nENDFCT",
            "7: F: a path through this function may end",
        ),
        ("DEF A(X:IN)\nEND", "1: X: the parameter's type is not declared"),
        (
            "DEF A( )\nDECL INT THIS_NAME_IS_25_LETTERS_L\nEND",
            "2: THIS_NAME_IS_25_LETTERS_L: the name has 25 characters",
        ),
        ("DEF A( )\nDECL INT WHILE\nEND", "2: WHILE: the name is a reserved word of KRL"),
        ("DEF A( )\nDECL INT I\nDECL REAL I\nEND", "3: I: this name is declared twice"),
        ("DEF A( )\nEND\nDEF A( )\nEND", "3: A: a routine of this name is already defined"),
        ("DEF A( )\nDECL INT I[2,2,2,2]\nEND", "2: DECL: an array has at most three dimensions"),
        ("DEF A( )\nI=1", "2: : the file ends, but END"),
        ("DEF A\nEND", "1: DEF: expected '(', found the end of the line"),
    ] {
        let reported = reported_messages(program);
        assert!(
            reported.iter().any(|reported| reported.starts_with(expected)),
            "{program}: {reported:#?} instead of {expected}"
        );
    }
    // In this program every path assigns the value before it is read.
    let right = "DEF A( )\nDECL INT I\nIF COUNT>0 THEN\nI=1\nELSE\nRETURN\nENDIF\nCOUNT=I\nLOOP\nI=2\nENDLOOP\nEND\n\
        DEFFCT INT F( )\nDECL EKI_STATUS RET\nDECL INT I\nI=0\nRET=EKI_GetInt(\"C\",\"T\",I)\nSWITCH I\nCASE 1\nRETURN 1\n\
        DEFAULT\nRETURN RET.Buff\nENDSWITCH\nENDFCT";
    assert_eq!(reported_messages(right), Vec::<String>::new());
}

#[test]
fn the_kss_version_determines_the_system_variables() {
    let file = parse("a.src", "DEF A( )\nIF $COULD_START_MOTION THEN\nENDIF\nEND");
    let told =
        |kss: &str| analyse(std::slice::from_ref(&file), Some(kss.parse().expect("a version"))).problems.concat();
    assert_eq!(told("8.5"), []);
    assert_eq!(told("8.4")[0].message, "KSS 8.4 does not have this system variable (available from 8.5 on)");
    let Analysis { problems, warnings, .. } = analyse(std::slice::from_ref(&file), None);
    assert_eq!((problems.concat(), warnings.concat().len()), (vec![], 1), "which version it is for is not known");
    assert!("9.1".parse::<Kss>().is_err() && "8.1".parse::<Kss>().is_err() && "8".parse::<Kss>().is_err());
}

/// An error that may occur only at run time is a warning, and so is a name that no file declares; each name is reported
/// once.
#[test]
fn uncertain_errors_are_warnings() {
    let program = "DEF A( )\nDECL INT I\nDECL NEW_T N\nIF COUNT>0 THEN\nI=1\nENDIF\nCOUNT=I\nN=#ON\nIF N==#OFF THEN\nUNKNOWN=1\n\
        UNKNOWN=2\nENDIF\nFOR I=1 TO 11\nIF I<=10 THEN\nLIST[I]=0\nENDIF\nENDFOR\nEND\nDEFFCT INT F( )\nIF COUNT>0 THEN\n\
        RETURN 1\nENDIF\nENDFCT";
    let [problems, warnings, _] = reported(program);
    assert_eq!(problems, Vec::<String>::new());
    let begins: Vec<&str> = warnings.iter().map(|warning| &warning[..warning.len().min(34)]).collect();
    assert_eq!(
        begins,
        [
            "3: NEW_T: this type is declared in",
            "7: I: this local variable may be r",
            "10: UNKNOWN: this name is declared",
            "15: LIST: the index 11 is outside ",
            "23: F: a path through this functio"
        ]
    );
}

/// A statement that is only checked is listed with its line, and the execution stops only at this statement.
#[test]
fn statements_that_are_only_checked_are_listed_with_their_line() {
    let [problems, warnings, unexecuted] = reported(
        "DEF A( )\nDECL INT I\nDECL FRAME F\nI=1\nF=$POS_ACT\nSWITCH I\nCASE 1\nCIRC F,F\nCASE COUNT\nI=2\nENDSWITCH\nI=STRLEN(\"a\")\n\
         I=3\nEND",
    );
    assert_eq!([problems, warnings], [Vec::<String>::new(), Vec::new()]);
    assert_eq!(unexecuted, ["8: CIRC: is not executed", "12: STRLEN: is not executed"]);
}

/// Types with the same name in two modules are different types. A variable of another data list is visible if it is
/// GLOBAL.
#[test]
fn a_name_is_visible_only_in_its_scope() {
    let list = |name: &str, words: &str, more: &str| {
        format!(
            "DEFDAT {name} PUBLIC\nENUM SIDE_T {words}\nDECL SIDE_T {name}_SIDE=#{}\n{more}ENDDAT\n",
            &words[..4]
        )
    };
    let one =
        (parse("one.dat", &list("ONE", "LEFT,SAME", "")), parse("one.src", "DEF ONE( )\nONE_SIDE=#SAME\nEND"));
    let two = list("TWO", "BACK,SAME", "DECL GLOBAL INT TWO_N=1\n");
    let two = (parse("two.dat", &two), parse("two.src", "DEF TWO( )\nTWO_SIDE=#BACK\nONE_SIDE=#LEFT\nEND"));
    let files = [one.0, one.1, two.0, two.1];
    let analysis = analyse(&files, HIGHEST);
    assert_eq!(analysis.problems.concat(), []);
    let reported: Vec<String> = analysis.warnings.concat().into_iter().map(|warning| warning.message).collect();
    assert_eq!(
        reported,
        ["this name is visible only in the program of one.dat; to make it visible to all programs, declare it \
             GLOBAL in a PUBLIC data list"]
    );
    let hidden = parse("four.src", "DEF FOUR( )\nDECL SIDE_T S\nS=#LEFT\nEND");
    let reported = analyse(&[files[0].clone(), hidden], HIGHEST).warnings.concat();
    assert!(reported[0].message.starts_with("this type is visible only in another module"), "{reported:?}");
    // The variable is declared twice; the message contains the location of the other declaration.
    let again = parse("three.dat", "DEFDAT THREE PUBLIC\nDECL GLOBAL INT TWO_N=2\nENDDAT\n");
    let [_, _, two, _] = files;
    let reported = analyse(&[two, again], HIGHEST).problems.concat();
    assert_eq!(reported[0].message, "this name is declared twice: two.dat, line 4");
}

/// Any content of a file is either parsed or reported, and never causes a panic.
#[test]
fn damaged_files_are_reported_without_a_panic() {
    let whole = include_str!("../../../config/kuka/cell_motion.src");
    let words: Vec<&str> = whole.split_inclusive([' ', '\n', '(', ',']).collect();
    for step in [3, 7, 11, 40] {
        for skip in 0..step {
            let torn: String =
                words.iter().enumerate().filter(|(at, _)| at % step != skip).map(|(_, word)| *word).collect();
            let analysis = analyse(&[parse("a.src", &torn)], HIGHEST);
            assert!(!analysis.problems[0].is_empty());
        }
    }
    for cut in (0..whole.len()).step_by(97) {
        analyse(&[parse("a.src", &whole[..cut])], HIGHEST);
    }
}
