//! Reads declarations: variables, structures, enumerations, signals, and items that are declared elsewhere.

use super::expression::{Read, Reader, Unread};
use super::lex::{RESERVED, Token};
use super::syntax::{Declaration, Declared, Expression, Item, Returned};

/// Types that need no DECL in front of them.
const SIMPLE_TYPES: [&str; 11] =
    ["INT", "REAL", "BOOL", "CHAR", "FRAME", "POS", "E3POS", "E6POS", "AXIS", "E3AXIS", "E6AXIS"];
/// Keywords for routines that are defined elsewhere; KUKA's own data lists use the two with P.
const FOREIGN: [&str; 4] = ["EXT", "EXTFCT", "EXTP", "EXTFCTP"];

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
        first if FOREIGN.contains(&first) => has_name,
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

pub(super) fn declaration(reader: &mut Reader<'_>, line: usize) -> Read<Declaration> {
    let (mut global, mut constant) = (false, false);
    loop {
        if reader.takes_word("GLOBAL") {
            global = true;
        } else if reader.takes_word("CONST") {
            constant = true;
        } else if !reader.takes_word("DECL") {
            break;
        }
    }
    let kind = if reader.takes_word("STRUC") {
        struc(reader)?
    } else if reader.takes_word("ENUM") {
        enumeration(reader)?
    } else if reader.takes_word("SIGNAL") {
        signal(reader)?
    } else if reader.takes_word("IMPORT") {
        import(reader)?
    } else if reader.takes_word("CHANNEL") || FOREIGN.iter().any(|word| reader.takes_word(word)) {
        reader.skip_line();
        Declared::Foreign
    } else {
        let type_name = reader.name()?;
        let mut items = vec![item(reader)?];
        while reader.takes_sign(",") {
            items.push(item(reader)?);
        }
        Declared::Variables { constant, type_name, items }
    };
    reader.end()?;
    Ok(Declaration { line, global, kind })
}

/// Reads the type of a DEFFCT: `INT`, or `CHAR[20]` for a text.
pub(super) fn returned(reader: &mut Reader<'_>) -> Read<Returned> {
    Ok(Returned { type_name: reader.name()?, dimensions: dimensions(reader)? })
}

fn enumeration(reader: &mut Reader<'_>) -> Read<Declared> {
    let name = reader.name()?;
    let mut words = vec![reader.name()?];
    while reader.takes_sign(",") {
        words.push(reader.name()?);
    }
    Ok(Declared::Enumeration { name, words })
}

/// Reads `STRUC NAME INT A,B,REAL C`: a component has the last type in front of it.
fn struc(reader: &mut Reader<'_>) -> Read<Declared> {
    let name = reader.name()?;
    let mut type_name = String::new();
    let mut components = Vec::new();
    loop {
        if matches!(reader.peek_behind(1), Some(Token::Name(_))) {
            type_name = reader.name()?;
        }
        if type_name.is_empty() {
            return Err(format!("expected a type, found {}", reader.found()).into());
        }
        components.push((type_name.clone(), item(reader)?));
        if !reader.takes_sign(",") {
            return Ok(Declared::Struc { name, components });
        }
    }
}

/// Reads `SIGNAL NAME $OUT[3]`, `SIGNAL NAME $IN[1] TO $IN[8]`, `SIGNAL NAME FALSE`.
fn signal(reader: &mut Reader<'_>) -> Read<Declared> {
    let name = reader.name()?;
    if reader.takes_word("FALSE") || reader.takes_word("TRUE") {
        return Ok(Declared::Signal { name, from: None, to: None });
    }
    let from = reader.place()?;
    let to = if reader.takes_word("TO") { Some(reader.place()?) } else { None };
    Ok(Declared::Signal { name, from: Some(from), to })
}

/// Reads `IMPORT INT NAME IS /R1/OTHER..NAME`.
fn import(reader: &mut Reader<'_>) -> Read<Declared> {
    let type_name = reader.name()?;
    let name = reader.name()?;
    if !reader.skip_to_word("IS") {
        return Err(format!("expected IS, found {}", reader.found()).into());
    }
    reader.skip_line();
    Ok(Declared::Import { type_name, name })
}

fn item(reader: &mut Reader<'_>) -> Read<Item> {
    if matches!(reader.peek(), Some(Token::Sign("!"))) {
        return Err(Unread::NotChecked("a name is not filled in yet ('!')".to_owned()));
    }
    let name = reader.name()?;
    let dimensions = dimensions(reader)?;
    let value = if reader.takes_sign("=") { Some(reader.expression()?) } else { None };
    Ok(Item { name, dimensions, value })
}

/// Reads `[3,4]`, `[]`, or nothing.
fn dimensions(reader: &mut Reader<'_>) -> Read<Vec<Option<Expression>>> {
    let dimensions = if reader.takes_sign("[") { reader.list_until("]")? } else { Vec::new() };
    match dimensions.len() {
        0..=3 => Ok(dimensions),
        _ => Err("an array has at most three dimensions".into()),
    }
}
