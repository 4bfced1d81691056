//! Reads declarations: variables, structures, enumerations, signals, and items that are declared elsewhere.

use super::expression::{NotRead, ReadResult, TokenReader};
use super::lex::{RESERVED, Token};
use super::syntax::{Declaration, DeclarationContent, Expression, Item, ReturnType};

/// Types that need no DECL in front of them.
const SIMPLE_TYPES: [&str; 11] =
    ["INT", "REAL", "BOOL", "CHAR", "FRAME", "POS", "E3POS", "E6POS", "AXIS", "E3AXIS", "E6AXIS"];
/// Keywords for routines that are defined elsewhere; KUKA's own data lists use the two with P.
const EXTERNAL_KEYWORDS: [&str; 4] = ["EXT", "EXTFCT", "EXTP", "EXTFCTP"];

/// Returns whether a line is a declaration.
pub(super) fn is_declaration(tokens: &[Token]) -> bool {
    let word = |at: usize| match tokens.get(at) {
        Some(Token::Name(name)) => name.as_str(),
        _ => "",
    };
    let has_name = !word(1).is_empty();
    match word(0) {
        "DECL" | "STRUC" | "ENUM" => true,
        "GLOBAL" => !matches!(word(1), "INTERRUPT" | "DEF" | "DEFFCT"),
        "CONST" | "SIGNAL" | "IMPORT" => has_name,
        "CHANNEL" => matches!(tokens.get(1), Some(Token::Sign(":"))),
        first if EXTERNAL_KEYWORDS.contains(&first) => has_name,
        first => SIMPLE_TYPES.contains(&first) && has_name,
    }
}

/// Returns whether a line is `NAME NAME`, a declaration that lacks its DECL: a type, then its first variable.
pub(super) fn lacks_decl(tokens: &[Token]) -> bool {
    let is_name =
        |token: &Token| matches!(token, Token::Name(name) if RESERVED.binary_search(&name.as_str()).is_err());
    let goes_on = |token: &Token| matches!(token, Token::Sign("=" | "[" | ","));
    tokens.len() > 1 && tokens[..2].iter().all(is_name) && tokens.get(2).is_none_or(goes_on)
}

pub(super) fn parse_declaration(reader: &mut TokenReader<'_>, line: usize) -> ReadResult<Declaration> {
    let (mut global, mut constant) = (false, false);
    loop {
        if reader.accept_word("GLOBAL") {
            global = true;
        } else if reader.accept_word("CONST") {
            constant = true;
        } else if !reader.accept_word("DECL") {
            break;
        }
    }
    let kind = if reader.accept_word("STRUC") {
        parse_struc(reader)?
    } else if reader.accept_word("ENUM") {
        enumeration(reader)?
    } else if reader.accept_word("SIGNAL") {
        signal(reader)?
    } else if reader.accept_word("IMPORT") {
        import(reader)?
    } else if reader.accept_word("CHANNEL") || EXTERNAL_KEYWORDS.iter().any(|word| reader.accept_word(word)) {
        reader.skip_line();
        DeclarationContent::Foreign
    } else {
        let type_name = reader.name()?;
        let mut items = vec![item(reader)?];
        while reader.accept_sign(",") {
            items.push(item(reader)?);
        }
        DeclarationContent::Variables { constant, type_name, items }
    };
    reader.end()?;
    Ok(Declaration { line, global, kind })
}

/// Reads the type of a DEFFCT: `INT`, or `CHAR[20]` for a text.
pub(super) fn parse_return_type(reader: &mut TokenReader<'_>) -> ReadResult<ReturnType> {
    Ok(ReturnType { type_name: reader.name()?, dimensions: dimensions(reader)? })
}

fn enumeration(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let name = reader.name()?;
    let mut words = vec![reader.name()?];
    while reader.accept_sign(",") {
        words.push(reader.name()?);
    }
    Ok(DeclarationContent::Enumeration { name, words })
}

/// Reads `STRUC NAME INT A,B,REAL C`: a component has the last type in front of it.
fn parse_struc(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let name = reader.name()?;
    let mut type_name = String::new();
    let mut components = Vec::new();
    loop {
        if matches!(reader.peek_ahead(1), Some(Token::Name(_))) {
            type_name = reader.name()?;
        }
        if type_name.is_empty() {
            return Err(format!("expected a type, found {}", reader.describe_next()).into());
        }
        components.push((type_name.clone(), item(reader)?));
        if !reader.accept_sign(",") {
            return Ok(DeclarationContent::Struc { name, components });
        }
    }
}

/// Reads `SIGNAL NAME $OUT[3]`, `SIGNAL NAME $IN[1] TO $IN[8]`, `SIGNAL NAME FALSE`.
fn signal(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let name = reader.name()?;
    if reader.accept_word("FALSE") || reader.accept_word("TRUE") {
        return Ok(DeclarationContent::Signal { name, from: None, to: None });
    }
    let from = reader.parse_variable()?;
    let to = if reader.accept_word("TO") { Some(reader.parse_variable()?) } else { None };
    Ok(DeclarationContent::Signal { name, from: Some(from), to })
}

/// Reads `IMPORT INT NAME IS /R1/OTHER..NAME`.
fn import(reader: &mut TokenReader<'_>) -> ReadResult<DeclarationContent> {
    let type_name = reader.name()?;
    let name = reader.name()?;
    if !reader.skip_past_word("IS") {
        return Err(format!("expected IS, found {}", reader.describe_next()).into());
    }
    reader.skip_line();
    Ok(DeclarationContent::Import { type_name, name })
}

fn item(reader: &mut TokenReader<'_>) -> ReadResult<Item> {
    if matches!(reader.peek_token(), Some(Token::Sign("!"))) {
        return Err(NotRead::NotChecked("a name is not filled in yet ('!')".to_owned()));
    }
    let name = reader.name()?;
    let dimensions = dimensions(reader)?;
    let value = if reader.accept_sign("=") { Some(reader.expression()?) } else { None };
    Ok(Item { name, dimensions, value })
}

/// Reads `[3,4]`, `[]`, or nothing.
fn dimensions(reader: &mut TokenReader<'_>) -> ReadResult<Vec<Option<Expression>>> {
    let dimensions = if reader.accept_sign("[") { reader.parse_list_until("]")? } else { Vec::new() };
    match dimensions.len() {
        0..=3 => Ok(dimensions),
        _ => Err("an array has at most three dimensions".into()),
    }
}
