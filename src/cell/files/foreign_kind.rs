//! Detects, by their first bytes, files of other kinds that are given as a scan, and states what they are and what to
//! do.

use super::cloud_error::CloudFileError;

const ORDERED: &str =
    "export it as PCD, ordered (organised): one point for each pixel, in mm, in the camera's frame";

/// Checks whether the text consists of rows of at least three numbers: a list of points without a picture.
fn is_number_table(head: &str) -> bool {
    let mut lines = head.lines().map(str::trim).filter(|line| !line.is_empty());
    // A line of column names may come first.
    let is_row = |line: &str| {
        let numbers: Vec<&str> = line.split([',', ';', ' ', '\t']).filter(|word| !word.is_empty()).collect();
        numbers.len() >= 3 && numbers.iter().all(|word| word.parse::<f64>().is_ok())
    };
    lines.next().is_some() && lines.next().is_some_and(is_row) && lines.next().is_some_and(is_row)
}

/// Refuses a file that is known to be of another kind.
pub(super) fn check_kind(bytes: &[u8]) -> Result<(), CloudFileError> {
    let other = |kind, remedy| Err(CloudFileError::OtherKind { kind, remedy });
    let head = &bytes[..bytes.len().min(1_024)];
    if head.starts_with(b"\x89HDF") {
        let remedy = "open it in Zivid Studio, or with its SDK, and export it as PCD, ordered (organised): one point for each pixel, \
                      in mm, in the camera's frame";
        return other("an HDF5 file, as Zivid's .zdf files are", remedy);
    }
    // A binary STL has a header of 80 bytes and then the count of its triangles of 50 bytes.
    let triangles = bytes.get(80..84).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    if triangles.is_some_and(|count| count > 0 && bytes.len() as u64 == 84 + 50 * u64::from(count)) {
        return other(
            "an STL file: a surface without the camera's pixels",
            "take a scan of the part instead; a scan has one point for each pixel",
        );
    }
    let Ok(text) =
        std::str::from_utf8(&head[..head.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1)])
    else {
        return Ok(());
    };
    if text.trim_start().starts_with("solid ") {
        return other(
            "an STL file: a surface without the camera's pixels",
            "take a scan of the part instead; a scan has one point for each pixel",
        );
    }
    if is_number_table(text) {
        return other("a list of points (.xyz, .csv) without the pixel of each point", ORDERED);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_kinds_are_named_with_what_to_do() {
        let words = |bytes: &[u8]| check_kind(bytes).expect_err("refused").to_string();
        assert!(words(b"\x89HDF\r\n\x1a\n    ").contains("Zivid"));
        let mut stl = vec![0; 80];
        stl.extend(1_u32.to_le_bytes());
        stl.extend([0; 50]);
        assert!(words(&stl).contains("STL"));
        assert!(words(b"solid part\n facet normal 0 0 1\n").contains("STL"));
        for text in ["1 2 3\n4 5 6\n7 8 9\n", "x,y,z,r\n1,2,3,4\n1.5,2,3,4\n"] {
            assert!(words(text.as_bytes()).contains("ordered"), "{text}");
        }
        for right in
            [&b"ply\nformat ascii 1.0\nelement vertex 3\n"[..], b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\n", b""]
        {
            assert_eq!(check_kind(right), Ok(()));
        }
    }
}
