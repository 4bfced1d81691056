//! Splits one line of KRL into tokens. In KRL each statement has its own line, and upper and lower case are equivalent.

/// A token of a line. Names are in upper case and include their `$`.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token {
    Name(String),
    /// An INT without its sign. 2147483648 is accepted as well, because `-2147483648` is a valid INT.
    Int(i64),
    Real(f32),
    Text(String),
    /// An enumeration constant: the name after `#`, in upper case.
    Word(String),
    Sign(&'static str),
    /// From this point the line cannot be split into tokens; the reason was reported.
    Unreadable,
}

impl std::fmt::Display for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Token::Name(name) => write!(f, "{name}"),
            Token::Int(number) => write!(f, "{number}"),
            Token::Real(number) => write!(f, "{number}"),
            Token::Text(text) => write!(f, "\"{text}\""),
            Token::Word(word) => write!(f, "#{word}"),
            Token::Sign(sign) => write!(f, "{sign}"),
            Token::Unreadable => write!(f, "?"),
        }
    }
}

const SIGNS: [&str; 21] =
    ["==", "<>", "<=", ">=", "<", ">", "=", "+", "-", "*", "/", "(", ")", "[", "]", "{", "}", ",", ":", ".", "!"];

/// Returns the tokens of a line; none for an empty line, a comment or a header line that begins with `&`. If the tokens
/// end with [`Token::Unreadable`], the message states the reason.
pub(super) fn tokens(line: &str) -> (Vec<Token>, Option<String>) {
    let mut rest = line;
    let mut found = Vec::new();
    if rest.starts_with('&') {
        return (found, None);
    }
    loop {
        rest = rest.trim_start_matches(|c: char| c.is_whitespace() || c == '\0');
        if rest.is_empty() || rest.starts_with(';') {
            return (found, None);
        }
        match token(rest) {
            Ok((token, length)) => {
                found.push(token);
                rest = &rest[length..];
            }
            Err(message) => {
                // The rest of the line is ignored, because tokens after an unknown character would cause a second,
                // misleading message.
                found.push(Token::Unreadable);
                return (found, Some(message));
            }
        }
    }
}

/// Returns the token at the start of a text, and its length.
fn token(rest: &str) -> Result<(Token, usize), String> {
    let mut characters = rest.chars();
    match (characters.next().unwrap_or_default(), characters.next()) {
        ('"', _) => text(rest),
        ('\'', _) => lex_based_number(rest),
        ('#', _) => lex_constant(rest),
        ('0'..='9', _) | ('.', Some('0'..='9')) => number(rest),
        ('A'..='Z' | 'a'..='z' | '_' | '$', _) => {
            let length = name_length(rest);
            Ok((Token::Name(rest[..length].to_uppercase()), length))
        }
        (first, _) => match SIGNS.iter().find(|sign| rest.starts_with(**sign)) {
            Some(sign) => Ok((Token::Sign(sign), sign.len())),
            None => Err(format!("the character '{first}' is valid in KRL only in a comment or in a string")),
        },
    }
}

fn name_length(text: &str) -> usize {
    text.bytes().take_while(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'$')).count()
}

/// Parses an enumeration constant, `#RED` or `# RED`.
fn lex_constant(rest: &str) -> Result<(Token, usize), String> {
    let behind = &rest[1..];
    let blanks = behind.len() - behind.trim_start_matches([' ', '\t']).len();
    let length = name_length(&behind[blanks..]);
    if length == 0 {
        return Err("the enumeration constant is missing after '#'".to_owned());
    }
    Ok((Token::Word(behind[blanks..blanks + length].to_uppercase()), 1 + blanks + length))
}

fn text(rest: &str) -> Result<(Token, usize), String> {
    let inside = rest[1..].split_once('"').map(|(inside, _)| inside);
    let inside = inside.ok_or("the closing quotation mark of the string is missing on this line")?;
    Ok((Token::Text(inside.to_owned()), inside.len() + 2))
}

/// Parses a hexadecimal or binary number, `'H1F'` or `'B101'`.
fn lex_based_number(rest: &str) -> Result<(Token, usize), String> {
    let wrong = || "a number in apostrophes must be hexadecimal or binary, such as 'H1F' or 'B101'".to_owned();
    let inside = rest[1..].split_once('\'').map(|(inside, _)| inside).ok_or_else(wrong)?;
    let digits = inside.get(1..).ok_or_else(wrong)?;
    let base = match inside.as_bytes().first() {
        Some(b'H' | b'h') => 16,
        Some(b'B' | b'b') => 2,
        _ => return Err(wrong()),
    };
    // The digits are an unsigned bit pattern: on the controller, 'HFFFFFFFF' is the INT −1.
    let bits = u32::from_str_radix(digits, base).map_err(|_| wrong())?;
    Ok((Token::Int(i64::from(bits.cast_signed())), inside.len() + 2))
}

fn number(rest: &str) -> Result<(Token, usize), String> {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let mut length = digits(rest);
    let mut is_real = false;
    if rest[length..].starts_with('.') {
        is_real = true;
        length += 1 + digits(&rest[length + 1..]);
    }
    if rest[length..].starts_with(['e', 'E']) {
        let sign = usize::from(rest[length + 1..].starts_with(['+', '-']));
        let exponent = digits(&rest[length + 1 + sign..]);
        if exponent > 0 {
            is_real = true;
            length += 1 + sign + exponent;
        }
    }
    let written = &rest[..length];
    let token = if is_real {
        written.parse().ok().filter(|number: &f32| number.is_finite()).map(Token::Real)
    } else {
        written.parse().ok().filter(|number: &i64| *number <= 1 << 31).map(Token::Int)
    };
    token.map(|token| (token, length)).ok_or_else(|| format!("the number {written} does not fit into 32 bits"))
}

/// Keywords that are not valid as names of variables or routines.
pub const RESERVED_WORDS: [&str; 58] = [
    "AND",
    "BRAKE",
    "B_AND",
    "B_EXOR",
    "B_NOT",
    "B_OR",
    "CASE",
    "CHAR",
    "CIRC",
    "CONST",
    "CONTINUE",
    "DECL",
    "DEF",
    "DEFAULT",
    "DEFDAT",
    "DEFFCT",
    "DELAY",
    "DISTANCE",
    "DO",
    "ELSE",
    "END",
    "ENDDAT",
    "ENDFCT",
    "ENDFOR",
    "ENDIF",
    "ENDLOOP",
    "ENDSWITCH",
    "ENDWHILE",
    "ENUM",
    "EXIT",
    "EXOR",
    "EXT",
    "EXTFCT",
    "FALSE",
    "FOR",
    "GLOBAL",
    "GOTO",
    "HALT",
    "IF",
    "INTERRUPT",
    "LIN",
    "LOOP",
    "NOT",
    "OR",
    "PTP",
    "REPEAT",
    "RESUME",
    "RETURN",
    "SIGNAL",
    "STRUC",
    "SWITCH",
    "THEN",
    "TRIGGER",
    "TRUE",
    "UNTIL",
    "WAIT",
    "WHEN",
    "WHILE",
];

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> String {
        let (all, problem) = tokens(line);
        assert_eq!(problem, None, "{line}");
        all.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn a_line_is_read_as_its_tokens() {
        assert_eq!(words("  if a.b[1]<>$Vel.cp then ; no"), "IF A . B [ 1 ] <> $VEL . CP THEN");
        assert_eq!(words("X='H1F'+'b101' : {X 1.5E-1,Y -2}"), "X = 31 + 5 : { X 0.15 , Y - 2 }");
        assert_eq!(words("RET=EKI_Init(\"Cell;x\") ;c"), "RET = EKI_INIT ( \"Cell;x\" )");
        assert_eq!(words("$MODE_OP==#t1"), "$MODE_OP == #T1");
        assert_eq!(words("H=SHOW(# state)"), "H = SHOW ( #STATE )");
        assert_eq!(words("{Z -.6,A .5E1,B 5.}"), "{ Z - 0.6 , A 5 , B 5 }");
        assert_eq!(words("I=-2147483648"), "I = - 2147483648");
        assert_eq!(words("PTP !"), "PTP !");
        assert_eq!(words("&ACCESS RVP"), "");
        assert_eq!(words(";FOLD x"), "");
        assert_eq!(words("END\u{a0}\0\0"), "END");
    }

    /// The tokens before the error are kept, so that the keyword that begins or ends a block is not lost.
    #[test]
    fn unreadable_characters_are_reported() {
        for line in ["A=\"x", "A=2147483649", "A='Q1'", "A=1 % 2", "A=#", "A=1.0E99", "A='H'", "A='"] {
            let (found, problem) = tokens(line);
            assert!(problem.is_some(), "{line}");
            assert_eq!(
                (&found[0], found.last()),
                (&Token::Name("A".to_owned()), Some(&Token::Unreadable)),
                "{line}"
            );
        }
    }
}
