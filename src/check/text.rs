//! Decodes the bytes of a file to text: finds out which of the usual encodings it has.

/// A file that is no text in an encoding that is read here.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct NotText(String);

/// Which line is not UTF-8, and what to do: only XML can name another encoding.
pub fn not_utf_8(bytes: &[u8], error: &std::str::Utf8Error) -> NotText {
    let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
    let is_xml = bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'<');
    let remedy = match is_xml {
        true => ", or name its encoding in the XML declaration, as <?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>",
        false => "",
    };
    NotText(format!("line {line} is not UTF-8; save the file as UTF-8{remedy}"))
}

/// The text of these bytes: UTF-8 or UTF-16 by the byte order mark, else what an XML declaration says, else UTF-8. A KRL
/// file that is not UTF-8 is taken for ISO-8859-1, in which controllers of the western world write comments.
///
/// # Errors
/// Says which encoding is wrong or not known, and what to do.
pub fn decode(name: &str, bytes: &[u8]) -> Result<String, NotText> {
    match bytes {
        [0xFF, 0xFE, rest @ ..] => return utf_16(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => return utf_16(rest, u16::from_be_bytes),
        // UTF-16 without its mark: the first character of an XML file is '<'.
        [b'<', 0, ..] => return utf_16(bytes, u16::from_le_bytes),
        [0, b'<', ..] => return utf_16(bytes, u16::from_be_bytes),
        _ => {}
    }
    let stated = declared(bytes).map(|stated| stated.to_lowercase());
    match stated.as_deref() {
        Some("iso-8859-1" | "iso8859-1" | "latin1" | "latin-1" | "us-ascii" | "ascii") => Ok(latin_1(bytes)),
        Some("windows-1252" | "cp1252") if !bytes.iter().any(|byte| (0x80..0xA0).contains(byte)) => {
            Ok(latin_1(bytes))
        }
        None | Some("utf-8" | "utf8") => match std::str::from_utf8(bytes) {
            Ok(text) => Ok(text.to_owned()),
            Err(_) if super::krl::is_krl(name) => Ok(latin_1(bytes)),
            Err(error) => Err(not_utf_8(bytes, &error)),
        },
        Some(other) => Err(NotText(format!(
            "the XML declaration names the encoding {other}; UTF-8, UTF-16 and ISO-8859-1 are read here"
        ))),
    }
}

/// The encoding that an XML declaration names.
fn declared(bytes: &[u8]) -> Option<String> {
    let start = &bytes[..bytes.len().min(200)];
    let start: String = start.iter().map(|&byte| char::from(byte)).collect();
    let declaration =
        start.trim_start_matches("\u{ef}\u{bb}\u{bf}").strip_prefix("<?xml")?.split("?>").next()?.to_owned();
    let behind = declaration.split("encoding").nth(1)?.trim_start().strip_prefix('=')?.trim_start();
    let quote = behind.chars().next().filter(|quote| ['"', '\''].contains(quote))?;
    behind[1..].split(quote).next().map(str::to_owned)
}

/// Each byte is the character of its number.
fn latin_1(bytes: &[u8]) -> String {
    bytes.iter().map(|&byte| char::from(byte)).collect()
}

fn utf_16(bytes: &[u8], unit: impl Fn([u8; 2]) -> u16) -> Result<String, NotText> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let wrong = || NotText("begins as UTF-16 and is not; save the file as UTF-8".to_owned());
    if !rest.is_empty() {
        return Err(wrong());
    }
    char::decode_utf16(pairs.iter().map(|&pair| unit(pair))).collect::<Result<_, _>>().map_err(|_| wrong())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>\n<!-- für -->\n<ETHERNETKRL/>";

    #[test]
    fn the_usual_encodings_are_read() {
        let latin: Vec<u8> = TEXT.chars().map(|c| u8::try_from(u32::from(c)).expect("Latin-1")).collect();
        assert_eq!(decode("a.xml", &latin).as_deref(), Ok(TEXT));
        let little: Vec<u8> = TEXT.encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert_eq!(decode("a.xml", &little).as_deref(), Ok(TEXT), "without a mark");
        assert_eq!(decode("a.xml", &[&[0xFF, 0xFE][..], &little].concat()).as_deref(), Ok(TEXT));
        let big: Vec<u8> = TEXT.encode_utf16().flat_map(u16::to_be_bytes).collect();
        assert_eq!(decode("a.xml", &[&[0xFE, 0xFF][..], &big].concat()).as_deref(), Ok(TEXT));
        assert_eq!(decode("a.src", b"; f\xFCr").as_deref(), Ok("; für"));
        assert_eq!(decode("a.toml", "x = 'ü'".as_bytes()).as_deref(), Ok("x = 'ü'"));
    }

    #[test]
    fn what_is_no_text_is_said_with_its_line() {
        let says = |bytes: &[u8]| decode("a.xml", bytes).expect_err("no text").to_string();
        assert!(says(b"<A>\n<!-- f\xFCr -->").starts_with("line 2 is not UTF-8; "));
        assert!(says(b"<?xml version='1.0' encoding='EBCDIC'?>").contains("names the encoding ebcdic; "));
        assert!(says(b"\xFF\xFE<").starts_with("begins as UTF-16"));
        assert!(says(b"\xFF\xFE\x00\xDC").starts_with("begins as UTF-16"));
    }
}
