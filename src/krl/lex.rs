//! One line of KRL as tokens. KRL ends a statement with its line, and reads upper and lower case as the same letter.

/// A token of a line. Names are in upper case and carry their `$`.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token {
    Name(String),
    Int(i32),
    Real(f32),
    Text(String),
    /// The word behind `#`, in upper case.
    Word(String),
    Sign(&'static str),
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
        }
    }
}

const SIGNS: [&str; 20] =
    ["==", "<>", "<=", ">=", "<", ">", "=", "+", "-", "*", "/", "(", ")", "[", "]", "{", "}", ",", ":", "."];

/// The tokens of a line; none for an empty line, a comment or a header line that begins with `&`.
///
/// # Errors
/// Says in words what cannot be read.
pub(super) fn tokens(line: &str) -> Result<Vec<Token>, String> {
    let mut rest = line.trim_end_matches('\r');
    let mut found = Vec::new();
    if rest.starts_with('&') {
        return Ok(found);
    }
    loop {
        rest = rest.trim_start();
        let Some(first) = rest.chars().next() else { return Ok(found) };
        if first == ';' {
            return Ok(found);
        }
        let (token, length) = match first {
            '"' => text(rest)?,
            '\'' => based(rest)?,
            '#' => {
                let length = name_length(&rest[1..]);
                if length == 0 {
                    return Err("'#' stands without the word of an enumeration behind it".to_owned());
                }
                (Token::Word(rest[1..=length].to_uppercase()), length + 1)
            }
            '0'..='9' => number(rest)?,
            'A'..='Z' | 'a'..='z' | '_' | '$' => {
                let length = name_length(rest);
                (Token::Name(rest[..length].to_uppercase()), length)
            }
            _ => match SIGNS.iter().find(|sign| rest.starts_with(**sign)) {
                Some(sign) => (Token::Sign(sign), sign.len()),
                None => return Err(format!("the character '{first}' has no meaning in KRL")),
            },
        };
        found.push(token);
        rest = &rest[length..];
    }
}

fn name_length(text: &str) -> usize {
    text.bytes().take_while(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'$')).count()
}

fn text(rest: &str) -> Result<(Token, usize), String> {
    let inside = rest[1..].split_once('"').map(|(inside, _)| inside);
    let inside = inside.ok_or("a text in quotation marks does not end on its line")?;
    Ok((Token::Text(inside.to_owned()), inside.len() + 2))
}

/// `'H1F'` and `'B101'`.
fn based(rest: &str) -> Result<(Token, usize), String> {
    let wrong = || "a number in apostrophes is written 'H1F' or 'B101'".to_owned();
    let inside = rest[1..].split_once('\'').map(|(inside, _)| inside).ok_or_else(wrong)?;
    let digits = inside.get(1..).ok_or_else(wrong)?;
    let base = match inside.as_bytes().first() {
        Some(b'H' | b'h') => 16,
        Some(b'B' | b'b') => 2,
        _ => return Err(wrong()),
    };
    let bits = u32::from_str_radix(digits, base).map_err(|_| wrong())?;
    Ok((Token::Int(bits.cast_signed()), inside.len() + 2))
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
        written.parse().ok().map(Token::Int)
    };
    token.map(|token| (token, length)).ok_or_else(|| format!("the number {written} does not fit into 32 bits"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> String {
        let all = tokens(line).expect("a line of KRL");
        all.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn a_line_is_read_as_its_tokens() {
        assert_eq!(words("  if a.b[1]<>$Vel.cp then ; no"), "IF A . B [ 1 ] <> $VEL . CP THEN");
        assert_eq!(words("X='H1F'+'b101' : {X 1.5E-1,Y -2}"), "X = 31 + 5 : { X 0.15 , Y - 2 }");
        assert_eq!(words("RET=EKI_Init(\"Cell;x\") ;c"), "RET = EKI_INIT ( \"Cell;x\" )");
        assert_eq!(words("$MODE_OP==#t1"), "$MODE_OP == #T1");
        assert_eq!(words("&ACCESS RVP"), "");
        assert_eq!(words(";FOLD x"), "");
    }

    #[test]
    fn what_cannot_be_read_is_said() {
        for line in ["A=\"x", "A=2147483648", "A='Q1'", "A=1 % 2", "A=#", "A=1.0E99", "A='H'", "A='"] {
            assert!(tokens(line).is_err(), "{line}");
        }
    }
}
