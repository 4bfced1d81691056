//! The signed files of a cycle, so that they can be verified on another computer without a terminal at the cell: the
//! cell's record, the signatures of people, each with its signature, and the public key.

use super::cycle;
use super::guard::{VisitorExtension, not_found_page};
use super::page_texts::Language;
use super::reading::{Answer, reading};
use super::state::Web;
use axum::Extension;
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::IntoResponse;
use maud::{Markup, html};
use panelprep_cell::record::CycleId;
use panelprep_store::signing::{PublicKey, cycle_stem, person_signature_stem};
use panelprep_store::store::{SignatureRow, Store};
use std::sync::Arc;

/// The name of the file with the public key, as in an export.
const PUBLIC_KEY: &str = "public-key.pem";

/// Returns the name of a signed record, without its ending, as in an export.
fn stem(row: &SignatureRow) -> String {
    match row.is_of_person {
        true => person_signature_stem(row.cycle, row.number),
        false => cycle_stem(row.cycle),
    }
}

/// Shows the links to the signed files of a cycle.
pub(super) fn show_links(words: Language<'_>, id: CycleId, rows: &[SignatureRow]) -> Markup {
    let signed = rows.iter().map(stem).flat_map(|stem| [format!("{stem}.json"), format!("{stem}.sig")]);
    let names: Vec<String> = signed.chain([PUBLIC_KEY.to_owned()]).collect();
    html! {
        @if !rows.is_empty() {
            details {
                summary { (words.text("cycle.signed_files")) }
                p { (words.text("cycle.signed_files_help")) }
                ul.links { @for name in &names { li { a href={ "/cycle/" (id) "/signed/" (name) } download { (name) } } } }
            }
        }
    }
}

/// Returns the public keys of these signatures as one file.
fn public_keys(rows: &[SignatureRow]) -> Option<Vec<u8>> {
    let mut keys: Vec<&str> = rows.iter().map(|row| row.public_key.as_str()).collect();
    keys.dedup();
    let pem = |key: &&str| PublicKey::from_hex(key).ok()?.to_pem().ok();
    let pems: Option<Vec<String>> = keys.iter().map(pem).collect();
    pems.filter(|pems| !pems.is_empty()).map(|pems| pems.concat().into_bytes())
}

/// Returns the bytes of the file with this name among the signed files of a cycle; `None` if there is no such file. A
/// signed record that is missing or damaged in the store is an error.
fn bytes_of<E>(
    rows: &[SignatureRow],
    name: &str,
    read: impl Fn(&str) -> Result<Vec<u8>, E>,
) -> Result<Option<Vec<u8>>, E> {
    if name == PUBLIC_KEY {
        return Ok(public_keys(rows));
    }
    let named = name.rsplit_once('.');
    let row_of = |stem_of_name: &str| rows.iter().find(|row| stem(row) == stem_of_name);
    match named.and_then(|(stem, ending)| Some((row_of(stem)?, ending))) {
        Some((row, "json")) => read(&row.record_hash).map(Some),
        Some((row, "sig")) => Ok(Some(row.signature.clone())),
        _ => Ok(None),
    }
}

/// Serves one of the signed files of a cycle, byte by byte as it was signed.
pub(super) async fn file(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path((number, name)): Path<(String, String)>,
) -> Answer {
    let id = cycle::id(&number).await?;
    let asked = name.clone();
    let read = move |store: &Store| {
        let rows = store.cycle_signatures(id)?;
        bytes_of(&rows, &asked, |hash| store.blob(hash))
    };
    let Some(bytes) = reading(&web, &visitor, read).await? else { return Err(not_found_page().await) };
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
    ];
    Ok((headers, bytes).into_response())
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_store::signing::CellKey;

    /// What the page offers verifies with nothing but what the page offers.
    #[test]
    fn the_offered_files_verify_each_other() {
        let key = CellKey::from_random_bytes(&[7; 32]);
        let record = b"{\"cycle\":3}".to_vec();
        let row = |number, is_of_person| SignatureRow {
            number,
            cycle: CycleId(3),
            is_of_person,
            unix_ms: 1,
            record_hash: format!("hash {number}"),
            previous_hash: String::new(),
            signature: key.sign(&record).to_vec(),
            public_key: key.public_key().hex(),
        };
        let rows = [row(5, false), row(9, true)];
        let read = |hash: &str| if hash.starts_with("hash ") { Ok(record.clone()) } else { Err("damaged") };
        let bytes = |name: &str| bytes_of(&rows, name, read).expect("readable");
        let pem = String::from_utf8(bytes("public-key.pem").expect("a key")).expect("text");
        let keys = PublicKey::parse_all(&pem).expect("keys");
        assert_eq!(keys, [key.public_key()], "once");
        for stem in ["cycle-3", "cycle-3-signature-9"] {
            let [json, sig] = ["json", "sig"].map(|ending| bytes(&format!("{stem}.{ending}")).expect("offered"));
            assert!(keys[0].is_valid_signature(&json, &sig), "{stem}");
            assert!(!keys[0].is_valid_signature(b"another record", &sig));
        }
        for name in ["cycle-4.json", "cycle-3.pdf", "cycle-3", "cycle-3-signature-5.json", "../cycle-3.json"] {
            assert_eq!(bytes(name), None, "{name}");
        }
        assert_eq!(bytes_of(&[], "public-key.pem", read), Ok(None));
        // A damaged record is not the same as one that was never signed.
        assert_eq!(bytes_of(&rows, "cycle-3.json", |_| Err("damaged")), Err("damaged"));
    }
}
