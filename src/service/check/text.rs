//! Determines the encoding of a file and decodes its bytes to text.
//!
//! Files of the controller come in many encodings. Their structure is ASCII, and other characters occur only in
//! comments and texts, so such a file is never refused because of a single byte. Files of this program are UTF-8,
//! because every command reads them as UTF-8.

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};
use panelprep_base::config::Problem;

/// Error: the bytes of a file are not text in a supported encoding.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct EncodingError(String);

/// A file's text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DecodedText {
    /// The text.
    pub text: String,
    /// A warning with the encoding that was assumed, if the file is certainly not in its declared encoding.
    pub warning: Option<Problem>,
}

/// Returns the error that states which line is not UTF-8, and how to correct the file.
pub fn utf_8_error(bytes: &[u8], error: &std::str::Utf8Error) -> EncodingError {
    if matches!(bytes, [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..]) {
        return EncodingError("is UTF-16, as PowerShell's > writes it; save the file as UTF-8".to_owned());
    }
    EncodingError(format!("line {} is not UTF-8; save the file as UTF-8", line_number(bytes, error.valid_up_to())))
}

fn line_number(bytes: &[u8], at: usize) -> usize {
    1 + bytes[..at].iter().filter(|byte| **byte == b'\n').count()
}

/// Decodes the bytes of a file. A file of this program is UTF-8. XML and KRL are UTF-16 if their first bytes show this;
/// otherwise they have the encoding that the XML declaration names, or UTF-8. If this fails, each byte is decoded as
/// one character of Windows-1252, which controllers in Western countries write.
///
/// # Errors
/// If a file of this program is not UTF-8, or the encoding is not supported; the error states what to do.
pub fn decode(name: &str, bytes: &[u8]) -> Result<DecodedText, EncodingError> {
    let is_xml = is_xml(name, bytes);
    if !is_xml && !super::is_krl(name) {
        let text = std::str::from_utf8(bytes).map_err(|error| utf_8_error(bytes, &error))?;
        return Ok(DecodedText { text: text.to_owned(), warning: None });
    }
    if let Some(encoding) = detect_utf_16(bytes) {
        return decode_utf_16(bytes, encoding);
    }
    let stated = is_xml.then(|| declared_encoding(bytes)).flatten();
    let encoding = match &stated {
        None => UTF_8,
        Some(label) => Encoding::for_label(label.as_bytes()).ok_or_else(|| {
            let message = format!(
                "the XML declaration names the encoding {label}, which is not supported; save the file as UTF-8"
            );
            EncodingError(message)
        })?,
    };
    Ok(decode_declared(bytes, encoding, stated.as_deref(), is_xml))
}

/// Returns whether a file of this name with these bytes is XML, by the same rule that `is_eki` applies to text.
fn is_xml(name: &str, bytes: &[u8]) -> bool {
    let mark = [0xFF, 0xFE, 0xEF, 0xBB, 0xBF, 0];
    let mut start = bytes.iter().filter(|byte| !mark.contains(*byte) && !byte.is_ascii_whitespace());
    name.to_lowercase().ends_with(".xml") || start.next() == Some(&b'<')
}

/// Detects UTF-16 by its byte order mark, or by an ASCII character at the beginning.
fn detect_utf_16(bytes: &[u8]) -> Option<&'static Encoding> {
    match bytes {
        [0xFF, 0xFE, ..] => Some(UTF_16LE),
        [0xFE, 0xFF, ..] => Some(UTF_16BE),
        [1..0x80, 0, ..] => Some(UTF_16LE),
        [0, 1..0x80, ..] => Some(UTF_16BE),
        _ => None,
    }
}

fn decode_utf_16(bytes: &[u8], encoding: &'static Encoding) -> Result<DecodedText, EncodingError> {
    let (text, is_broken) = encoding.decode_with_bom_removal(bytes);
    if is_broken {
        return Err(EncodingError("begins like UTF-16 but is not valid UTF-16; save the file as UTF-8".to_owned()));
    }
    Ok(DecodedText { text: text.into_owned(), warning: None })
}

/// Decodes with the declared encoding, or with UTF-8 if none is declared. If the bytes are not valid in this encoding,
/// they are decoded as UTF-8, or else as Windows-1252, in which each byte is a character.
fn decode_declared(bytes: &[u8], encoding: &'static Encoding, stated: Option<&str>, is_xml: bool) -> DecodedText {
    let read = encoding.decode_without_bom_handling_and_without_replacement(bytes);
    // UTF-16 is detected by the first bytes of a file. This file does not begin with such bytes, so its declaration of
    // UTF-16 is wrong.
    let is_wide = [UTF_16LE, UTF_16BE].contains(&encoding);
    if let Some(text) = read.filter(|_| !is_wide) {
        return DecodedText { text: text.into_owned(), warning: None };
    }
    let utf_8 = std::str::from_utf8(bytes);
    let (text, line, taken_as) = match utf_8 {
        Ok(text) => (text.to_owned(), 1, "UTF-8"),
        Err(error) => {
            let (text, _) = WINDOWS_1252.decode_without_bom_handling(bytes);
            (text.into_owned(), line_number(bytes, error.valid_up_to()), "Windows-1252")
        }
    };
    let warning = || {
        let found = match stated {
            Some(label) => {
                format!("the XML declaration names the encoding {label}, but the file has another encoding")
            }
            None => "the file is not UTF-8, the encoding of XML without a declaration".to_owned(),
        };
        let message = format!(
            "{found}: read as {taken_as}; save the file as UTF-8, or name its encoding in the declaration, as \
             <?xml version=\"1.0\" encoding=\"GBK\"?>"
        );
        Problem { line, key: "encoding".to_owned(), message }
    };
    // KRL has no declaration of its encoding, so no warning is possible: its editor writes in the encoding of the
    // controller's language.
    DecodedText { text, warning: is_xml.then(warning) }
}

/// Returns the encoding that an XML declaration names.
fn declared_encoding(bytes: &[u8]) -> Option<String> {
    let start = &bytes[..bytes.len().min(200)];
    let start: String = start.iter().map(|&byte| char::from(byte)).collect();
    let declaration =
        start.trim_start_matches("\u{ef}\u{bb}\u{bf}").strip_prefix("<?xml")?.split("?>").next()?.to_owned();
    let behind = declaration.split("encoding").nth(1)?.trim_start().strip_prefix('=')?.trim_start();
    let quote = behind.chars().next().filter(|quote| ['"', '\''].contains(quote))?;
    behind[1..].split(quote).next().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>\n<!-- für -->\n<ETHERNETKRL/>";

    fn text(name: &str, bytes: &[u8]) -> Result<String, String> {
        let decoded = decode(name, bytes).map_err(|error| error.to_string())?;
        assert_eq!(decoded.warning, None, "{name}");
        Ok(decoded.text)
    }

    fn decoded_text(text: &str) -> Result<String, String> {
        Ok(text.to_owned())
    }

    #[test]
    fn common_encodings_are_decoded() {
        let latin: Vec<u8> = TEXT.chars().map(|c| u8::try_from(u32::from(c)).expect("Latin-1")).collect();
        assert_eq!(text("a.xml", &latin), decoded_text(TEXT));
        let little: Vec<u8> = TEXT.encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert_eq!(text("a.xml", &little), decoded_text(TEXT), "without a mark");
        assert_eq!(text("a", &[&[0xFF, 0xFE][..], &little].concat()), decoded_text(TEXT));
        let big: Vec<u8> = TEXT.encode_utf16().flat_map(u16::to_be_bytes).collect();
        assert_eq!(text("a.xml", &[&[0xFE, 0xFF][..], &big].concat()), decoded_text(TEXT));
        assert_eq!(text("a.src", b"; f\xFCr"), decoded_text("; für"));
        let wide: Vec<u8> = "&ACCESS".encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert_eq!(text("a.src", &wide), decoded_text("&ACCESS"));
        assert_eq!(text("a.toml", "x = 'ü'".as_bytes()), decoded_text("x = 'ü'"));
        // In Windows-1252, 0x93 and 0x94 are quotes; in GBK, D6D0 CEC4 is the word for Chinese.
        let declared = |label: &str, bytes: &[u8]| {
            text("a.xml", &[format!("<?xml version='1.0' encoding='{label}'?>").as_bytes(), bytes].concat())
        };
        assert!(declared("windows-1252", b"<!--\x93a\x94-->").is_ok_and(|text| text.ends_with("<!--“a”-->")));
        assert!(declared("GB2312", b"<!--\xD6\xD0\xCE\xC4-->").is_ok_and(|text| text.ends_with("<!--中文-->")));
        assert!(declared("Shift_JIS", b"<A/>").is_ok());
    }

    /// Files in every encoding are read; a warning names the line with the first byte that is not valid.
    #[test]
    fn xml_with_a_wrong_declared_encoding_is_decoded_with_a_warning() {
        let warned = |bytes: &[u8]| {
            let decoded = decode("a.xml", bytes).expect("read");
            let warning = decoded.warning.expect("a warning");
            (warning.line, warning.message, decoded.text)
        };
        let (line, message, text) = warned(b"<A>\n<!-- \xD6\xD0 -->\n</A>");
        assert_eq!((line, text.lines().last()), (2, Some("</A>")));
        assert!(
            message.starts_with(
                "the file is not UTF-8, the encoding of XML without a declaration: read as Windows-1252"
            ),
            "{message}"
        );
        let (_, message, text) = warned("<?xml version=\"1.0\" encoding=\"utf-16\"?><A b='ü'/>".as_bytes());
        assert!(message.starts_with(
            "the XML declaration names the encoding utf-16, but the file has another encoding: read as UTF-8"
        ));
        assert!(text.ends_with("<A b='ü'/>"));
        let (_, message, _) = warned(b"<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<!-- f\xFCr -->");
        assert!(message.contains("names the encoding utf-8, but the file has another encoding"), "{message}");
    }

    #[test]
    fn bytes_that_are_no_text_are_reported_with_their_line() {
        let says = |name: &str, bytes: &[u8]| decode(name, bytes).expect_err("no text").to_string();
        assert_eq!(says("a.toml", b"x = 1\ny = '\xFC'"), "line 2 is not UTF-8; save the file as UTF-8");
        assert!(says("a.toml", b"\xFF\xFEp\0").starts_with("is UTF-16, as PowerShell's"));
        assert!(
            says("a.xml", b"<?xml version='1.0' encoding='EBCDIC'?>").contains("names the encoding EBCDIC, which")
        );
        assert!(says("a.xml", b"\xFF\xFE<").starts_with("begins like UTF-16"));
        assert!(says("a.xml", b"\xFF\xFE\x00\xDC").starts_with("begins like UTF-16"));
    }
}
