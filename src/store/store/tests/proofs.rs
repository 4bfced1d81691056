//! Pages of proofs and their signatures.

use super::*;
use panelprep_cell::cell::ProofStage;
use panelprep_cell::record::{Answer, RequestAuthor, RequestRecord, RequestSource, RequestedAction};

fn page(stage: ProofStage, programs_sum: i32, is_signed: bool) -> ProofsPage {
    ProofsPage { stage, programs_sum, page_sha256: "ab".repeat(32), by: "Ada".to_owned(), is_signed }
}

/// The newest row counts, whatever was stored before it; a proven page is no signature.
#[test]
fn the_newest_signature_is_read_back() {
    let (folder, store) = new_store();
    drop(store);
    let folder = folder.path().join("store");
    let who = RequestAuthor::from_source(RequestSource::Command);
    let newest_signed = || {
        let store = Store::open(&folder).expect("for reading");
        store.newest_proofs(|page| page.is_signed).expect("read")
    };
    assert_eq!(newest_signed(), None);
    for (row, expected) in [
        (page(ProofStage::A, 7, false), None),
        (page(ProofStage::A, 7, true), Some((ProofStage::A, 7))),
        (page(ProofStage::B, 7, true), Some((ProofStage::B, 7))),
        (page(ProofStage::C, 7, false), Some((ProofStage::B, 7))),
        // The programs were changed: the proofs begin again.
        (page(ProofStage::A, 8, true), Some((ProofStage::A, 8))),
    ] {
        Store::store_proofs_in(&folder, &row, who.clone()).expect("stored");
        assert_eq!(newest_signed().map(|page| (page.stage, page.programs_sum)), expected, "{row:?}");
    }
    let found = Store::open(&folder).expect("for reading").newest_proofs(|page| page.stage == ProofStage::C);
    assert_eq!(found.expect("read"), Some(page(ProofStage::C, 7, false)));
}

/// A row whose stage this version does not know hides no older signature: nothing counts as signed.
#[test]
fn an_unknown_stage_is_no_older_signature() {
    let (folder, store) = new_store();
    drop(store);
    let folder = folder.path().join("store");
    let who = RequestAuthor::from_source(RequestSource::Command);
    Store::store_proofs_in(&folder, &page(ProofStage::C, 7, true), who).expect("stored");
    let (programs_sum, is_signed) = (7, true);
    let wanted = RequestedAction::Proofs {
        stage: "D".to_owned(),
        programs_sum,
        page_sha256: String::new(),
        by: "Ada".to_owned(),
        is_signed,
    };
    let row = RequestRecord {
        unix_ms: 0,
        wanted,
        who: None,
        answer: Some(Answer::Done),
        reasons: vec![],
        findings: None,
    };
    let mut store = Store::open_for_one_row(&folder).expect("for writing");
    store.insert_request(&row, None, None).expect("stored");
    let found = store.newest_proofs(|page| page.is_signed);
    assert!(found.as_ref().is_err_and(|error| error.to_string().contains("\"D\"")), "{found:?}");
}
