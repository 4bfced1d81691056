//! The record of one cycle: to read, to download, and to sign.
//!
//! Its signed files can be verified on another computer, without access to the cell: the record signed by the cell, the
//! signatures of people, and the public keys.

use super::answers::{Answer, panic_response, read_store, with_store};
use super::guard::{VisitorExtension, not_found_page, refusal};
use super::history::verdict_text;
use super::layout::{Frame, Script, local_time};
use super::page_texts::Language;
use super::run_page;
use super::sessions::{Person, Visitor};
use super::state::{Web, entry, hashing, lock_text};
use crate::daemon::people::{LoginResult, account_stamp};
use crate::setup::{RecordPdf, cycle_html, cycle_pdf, sign_by_person};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use maud::{Markup, html};
use panelprep_cell::accounts::{Account, AuditEntry, Permission};
use panelprep_cell::record::{CycleId, CycleRecord, PartNames};
use panelprep_store::signing::{
    Meaning, PersonSignature, PublicKey, StatedValues, cycle_stem, person_signature_stem,
};
use panelprep_store::store::{PersonSigningRequest, SignatureRow, Store};
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;

/// The content security policy of the record's page: style and pictures are inside the page, and there is no script.
/// Only the operator's page may show it in a frame.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; form-action 'none'; base-uri 'none'; \
                      frame-ancestors 'self'";

/// Parses the number of a cycle; a text that is not a number gives the response "not found".
async fn parse_cycle_id(number: &str) -> Result<CycleId, Response> {
    match number.parse() {
        Ok(number @ 1..) => Ok(CycleId(number)),
        _ => Err(not_found_page().await),
    }
}

/// Shows a cycle with its record, its signatures, and the form to sign it.
pub(super) async fn page(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(number): Path<String>,
) -> Answer {
    let id = parse_cycle_id(&number).await?;
    let read = move |store: &Store| {
        Ok(((store.cycle(id)?, store.cycle_part(id)?), store.person_signatures(id)?, store.cycle_signatures(id)?))
    };
    let ((record, part), signatures, rows) = read_store(&web, &visitor, read).await?;
    let words = visitor.language();
    let word = |key| words.text(key);
    let title = format!("{} {id}", word("run.cycle"));
    let is_over = record.judgement.is_some();
    let body = html! {
        section.card {
            h2 { (title) " · " (record.panel) }
            (show_end(words, &record, part.as_ref()))
            p.links {
                a href={ "/cycle/" (id) "/record" } { (word("cycle.record")) }
                @if is_over { " · " a href={ "/cycle/" (id) "/record.pdf" } { "PDF/A-3" } }
                " · " a href={ "/cycle/" (id) "/record.json" } { "JSON" }
            }
            h3 { (word("cycle.signatures")) }
            @if signatures.is_empty() { p { (word("cycle.unsigned")) } }
            ul { @for (unix_ms, signature) in &signatures { li { (signature_text(signature)) ", " (local_time(*unix_ms)) } } }
            (show_links(words, id, &rows))
            @if visitor.has_permission(Permission::Sign) && is_over { (sign_form(&visitor, &record, part.as_ref())) }
        }
        section.card { (run_page::show_scene(words, Some(id))) }
        iframe.record title=(word("cycle.record")) src={ "/cycle/" (id) "/record" } {}
    };
    Ok(Frame { visitor: &visitor, title: &title, here: "/cycle", scripts: &[Script::Forms, Script::Scene] }
        .page(&body))
}

fn signature_text(signature: &PersonSignature) -> String {
    let PersonSignature { name, user, meaning, remark, values, .. } = signature;
    let remark = remark.as_ref().map_or(String::new(), |remark| format!(": {remark}"));
    let values = values.named().into_iter().filter_map(|(name, value)| Some(format!("; {name}: {}", value?)));
    format!("{name} ({user}): {}{remark}{}", meaning.printed_text(), values.collect::<String>())
}

/// Shows the part and the result of the cycle, which a person signs.
fn show_end(words: Language<'_>, record: &CycleRecord, part: Option<&PartNames>) -> Markup {
    let part = part.cloned().unwrap_or_default();
    let names: Vec<String> = [part.serial, part.order, part.operator].into_iter().flatten().collect();
    let end = record.judgement.as_ref();
    html! {
        p {
            @if !names.is_empty() { (names.join(" · ")) " · " }
            @match end {
                Some(_) if record.has_no_part() => strong { (words.text("js.verdict.no_part")) },
                Some(end) => strong { (verdict_text(words, end.verdict.keyword())) },
                None => strong { (words.text("cycle.running")) },
            }
        }
    }
}

/// Shows the form for a signature, with the part, the result, and the values that the cell does not measure.
fn sign_form(visitor: &Visitor, record: &CycleRecord, part: Option<&PartNames>) -> Markup {
    let words = visitor.language();
    let word = |key| words.text(key);
    let id = record.id;
    html! {
        details #sign {
            summary { (word("cycle.sign")) }
            (show_end(words, record, part))
            @if !record.is_released_by_one() { p.told.bad { (word("cycle.not_passed")) } }
            form.narrow data-post={ "/cycle/" (id) "/sign" } data-then={ "/cycle/" (id) } {
                label { (word("cycle.meaning")) select name="meaning" required {
                    option value="" {}
                    @for meaning in Meaning::ALL { option value=(meaning_key(meaning)) { (meaning.printed_text()) } }
                } }
                label { (word("cycle.remark")) input name="remark" maxlength="200" autocomplete="off"; }
                @for (name, key) in [("water", "cycle.water"), ("lamp", "cycle.lamp"), ("ambient", "cycle.ambient"), ("abrasive", "cycle.abrasive")] {
                    label { (word(key)) input name=(name) maxlength="200" autocomplete="off"; }
                }
                label { (word("login.password")) input name="password" type="password" autocomplete="current-password" required maxlength="200"; }
                p.told role="status" {}
                button.primary type="submit" { (word("cycle.sign")) }
            }
        }
    }
}

/// Returns the word for the meaning of a signature (for example "reviewed") as in requests and in the store.
fn meaning_key(meaning: Meaning) -> String {
    serde_json::to_value(meaning).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Serves the page of the record alone, for reading and printing.
pub(super) async fn record(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(number): Path<String>,
) -> Answer {
    let id = existing_cycle(&web, &visitor, &number).await?;
    let html =
        with_store(&visitor, move || cycle_html(&web.front.setup, id).map_err(|fault| fault.to_string())).await?;
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_FRAME_OPTIONS, "SAMEORIGIN"),
    ];
    Ok((headers, html).into_response())
}

/// Serves the record as PDF/A-3 with the signed JSON inside.
pub(super) async fn pdf(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(number): Path<String>,
) -> Answer {
    let id = existing_cycle(&web, &visitor, &number).await?;
    let unsigned = visitor.language().text("cycle.unsigned");
    let Some(RecordPdf { pdf, .. }) =
        with_store(&visitor, move || cycle_pdf(&web.front.setup, id).map_err(|fault| fault.to_string())).await?
    else {
        return Err(refusal(StatusCode::NOT_FOUND, "not_signed", unsigned));
    };
    let name = format!("attachment; filename=\"cycle-{id}.pdf\"");
    let headers = [(header::CONTENT_TYPE, "application/pdf".to_owned()), (header::CONTENT_DISPOSITION, name)];
    Ok((headers, pdf).into_response())
}

/// Returns the number of a cycle, if the cycle exists.
async fn existing_cycle(web: &Arc<Web>, visitor: &Visitor, number: &str) -> Result<CycleId, Response> {
    let id = parse_cycle_id(number).await?;
    match read_store(web, visitor, move |store| store.has_cycle(id)).await? {
        true => Ok(id),
        false => Err(not_found_page().await),
    }
}

/// Serves a cycle's record as JSON.
pub(super) async fn json(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(number): Path<String>,
) -> Answer {
    let id = parse_cycle_id(&number).await?;
    let record = read_store(&web, &visitor, move |store| store.cycle(id)).await?;
    Ok(Json(record).into_response())
}

/// Serves a picture that a finding of the cycle names.
pub(super) async fn picture(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path((number, finding, picture)): Path<(String, String, String)>,
) -> Answer {
    let id = parse_cycle_id(&number).await?;
    let (Ok(finding), Ok(picture)) = (finding.parse::<usize>(), picture.parse::<usize>()) else {
        return Err(not_found_page().await);
    };
    let read = move |store: &Store| {
        let record: CycleRecord = store.cycle(id)?;
        let named = record.findings.get(finding).and_then(|finding| finding.pictures.get(picture));
        named.map(|picture| store.blob(&picture.hash)).transpose()
    };
    match read_store(&web, &visitor, read).await? {
        Some(jpeg) => Ok(([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response()),
        None => Err(not_found_page().await),
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SignForm {
    meaning: Meaning,
    #[serde(default)]
    remark: String,
    #[serde(default)]
    water: String,
    #[serde(default)]
    lamp: String,
    #[serde(default)]
    ambient: String,
    #[serde(default)]
    abrasive: String,
    password: String,
}

/// Signs the record as the person who is logged in; the person must enter the password again.
pub(super) async fn sign(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path(number): Path<String>,
    Json(form): Json<SignForm>,
) -> Answer {
    let id = parse_cycle_id(&number).await?;
    let Some(person) = visitor.person.clone() else { return Err(not_found_page().await) };
    let SignForm { meaning, remark, water, lamp, ambient, abrasive, password } = form;
    let stated = |text: String| Some(text.trim().to_owned()).filter(|text| !text.is_empty());
    let values = StatedValues {
        water: stated(water),
        lamp: stated(lamp),
        ambient: stated(ambient),
        abrasive: stated(abrasive),
    };
    let (name, user, remark) = (person.printed_name.clone(), person.name.clone(), stated(remark));
    let signs = PersonSigningRequest { cycle: id, name, user, meaning, remark, values };
    let line = AuditEntry {
        subject: Some(format!("cycle {id}")),
        after: Some(meaning.printed_text().to_owned()),
        ..entry(&visitor, "sign record")
    };
    let shared = web.clone();
    let signed = hashing(&web, move || {
        let signed = sign_record(&shared, signs, &person, &password);
        let refused = match &signed {
            Ok(_) => None,
            Err(NotSigned::Pauses(_)) => return signed,
            Err(NotSigned::Problem(problem)) => Some(problem.clone()),
        };
        shared.audit(&AuditEntry { refused, ..line });
        signed
    });
    let problem_at = |code, problem: &str| refusal(StatusCode::UNPROCESSABLE_ENTITY, code, problem);
    match signed.await {
        Some(Ok(number)) => {
            Ok(Json(json!({ "message": visitor.language().text("saved"), "number": number })).into_response())
        }
        Some(Err(NotSigned::Pauses(left_s))) => Err(problem_at("password", &lock_text(left_s, visitor.language()))),
        Some(Err(NotSigned::Problem(problem))) => Err(problem_at("sign", &problem)),
        None => Err(panic_response()),
    }
}

/// The reason why a record was not signed.
enum NotSigned {
    /// Log-ins to the account are blocked for this number of seconds.
    Pauses(f64),
    /// A message for the person.
    Problem(String),
}

/// Signs the record and returns the number of the signature. The present account data are used, and only if the account
/// has not changed since the person logged in.
fn sign_record(web: &Web, signs: PersonSigningRequest, person: &Person, password: &str) -> Result<u64, NotSigned> {
    let refused = |problem: &str| Err(NotSigned::Problem(problem.to_owned()));
    match web.front.people.check_password(&signs.user, password) {
        LoginResult::Right(account)
            if account_stamp(&account) != person.stamp || !account.role.has_permission(Permission::Sign) =>
        {
            refused("the account was changed since the log-in; log in again; the record is not signed")
        }
        LoginResult::Right(Account { name: user, printed_name: name, .. }) => {
            let signed = sign_by_person(&web.front.setup, &PersonSigningRequest { user, name, ..signs });
            signed.map(|row| row.number).map_err(|fault| NotSigned::Problem(fault.to_string()))
        }
        LoginResult::Pauses(left_s) => Err(NotSigned::Pauses(left_s)),
        LoginResult::Wrong(_) | LoginResult::Unknown => refused("the password is wrong; the record is not signed"),
    }
}

/// Name of the file with the public keys, as in an export.
const PUBLIC_KEY_FILE_NAME: &str = "public-key.pem";

/// Returns the file name of a signed record without its extension, as in an export.
fn record_file_stem(row: &SignatureRow) -> String {
    match row.is_of_person {
        true => person_signature_stem(row.cycle, row.number),
        false => cycle_stem(row.cycle),
    }
}

/// Shows the links to the signed files of a cycle.
fn show_links(words: Language<'_>, id: CycleId, rows: &[SignatureRow]) -> Markup {
    let signed = rows.iter().map(record_file_stem).flat_map(|stem| [format!("{stem}.json"), format!("{stem}.sig")]);
    let names: Vec<String> = signed.chain([PUBLIC_KEY_FILE_NAME.to_owned()]).collect();
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

/// Returns the public keys of these signatures as one file; `None` if there is no signature.
fn public_keys(rows: &[SignatureRow]) -> Option<Vec<u8>> {
    let mut keys: Vec<&str> = rows.iter().map(|row| row.public_key.as_str()).collect();
    keys.dedup();
    let pem = |key: &&str| PublicKey::from_hex(key).ok()?.to_pem().ok();
    let pems: Option<Vec<String>> = keys.iter().map(pem).collect();
    pems.filter(|pems| !pems.is_empty()).map(|pems| pems.concat().into_bytes())
}

/// Returns the content of the file with this name among the signed files of a cycle; `None` if no file has this name. A
/// signed record that is missing or damaged in the store is an error.
fn signed_file_content<E>(
    rows: &[SignatureRow],
    name: &str,
    read: impl Fn(&str) -> Result<Vec<u8>, E>,
) -> Result<Option<Vec<u8>>, E> {
    if name == PUBLIC_KEY_FILE_NAME {
        return Ok(public_keys(rows));
    }
    let named = name.rsplit_once('.');
    let row_of = |stem_of_name: &str| rows.iter().find(|row| record_file_stem(row) == stem_of_name);
    match named.and_then(|(stem, ending)| Some((row_of(stem)?, ending))) {
        Some((row, "json")) => read(&row.record_hash).map(Some),
        Some((row, "sig")) => Ok(Some(row.signature.clone())),
        _ => Ok(None),
    }
}

/// Serves one of the signed files of a cycle, byte for byte as it was signed.
pub(super) async fn signed_file(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Path((number, name)): Path<(String, String)>,
) -> Answer {
    let id = parse_cycle_id(&number).await?;
    let asked = name.clone();
    let read = move |store: &Store| {
        let rows = store.cycle_signatures(id)?;
        signed_file_content(&rows, &asked, |hash| store.blob(hash))
    };
    let Some(bytes) = read_store(&web, &visitor, read).await? else { return Err(not_found_page().await) };
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

    /// The files that the page offers can be verified without any further file.
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
        let bytes = |name: &str| signed_file_content(&rows, name, read).expect("readable");
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
        assert_eq!(signed_file_content(&[], "public-key.pem", read), Ok(None));
        // A damaged record is reported differently from a record that was never signed.
        assert_eq!(signed_file_content(&rows, "cycle-3.json", |_| Err("damaged")), Err("damaged"));
    }
}
