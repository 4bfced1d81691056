//! Verifications are returned in order, each with its subject.

use super::*;
use panelprep_vision::calib::health::{Strike, Verification};

pub fn verified(subject: &str, error: f64) -> Verification {
    let hash = calibration_hash(&["lens", "mount"]);
    let subject = subject.to_owned();
    Verification { subject, error, limit: 0.5, calibration_hash: hash, at_unix_s: 7, struck: None }
}

#[test]
fn verifications_are_kept_by_subject_and_the_last_one_counts() {
    let (folder, mut store) = new_store();
    assert_eq!(store.newest_verification("scanner").expect("read"), None);
    let all = [verified("scanner", 0.1), verified("tool", 0.3), verified("scanner", 0.2)];
    for verification in &all {
        store.store_verification(verification).expect("kept");
    }
    assert!(store.store_verification(&verified("scanner", f64::NAN)).expect_err("NaN").to_string().contains("NaN"));
    drop(store);
    let mut store = Store::open(&folder.path().join("store")).expect("the same store");
    assert_eq!(store.verifications("scanner").expect("read"), [all[0].clone(), all[2].clone()]);
    assert_eq!(store.newest_verification("tool").expect("read"), Some(all[1].clone()));
    assert!(matches!(store.store_verification(&all[0]), Err(StoreError::ReadOnly { .. })));
}

#[test]
fn a_verification_that_is_struck_out_stays_with_who_and_why() {
    let (folder, mut store) = new_store();
    let all = [verified("scanner", 0.1), verified("scanner", 203.5)];
    all.iter().for_each(|verification| store.store_verification(verification).expect("kept"));
    drop(store);
    let folder = folder.path().join("store");
    let strike = Strike { by: "A. Smith".to_owned(), why: "mistyped board".to_owned(), at_unix_s: 9 };
    let (store, struck) = Store::strike_out_in(&folder, 2, &strike).expect("struck out");
    let expected = Verification { struck: Some(strike.clone()), ..all[1].clone() };
    assert_eq!(struck, expected);
    assert_eq!(store.verification_history().expect("read"), [(1, all[0].clone()), (2, expected.clone())]);
    assert_eq!(store.newest_verification("scanner").expect("read"), Some(expected), "no older one takes its place");
    drop(store);
    let refused = |number: i64| Store::strike_out_in(&folder, number, &strike).expect_err("refused").to_string();
    assert!(refused(2).contains("already struck out, by A. Smith"), "{}", refused(2));
    assert!(refused(3).contains("no verification 3"), "{}", refused(3));
    let elsewhere = folder.join("sotre");
    assert!(Store::strike_out_in(&elsewhere, 1, &strike).is_err() && !elsewhere.exists(), "no store is made");
}

#[test]
fn the_hash_depends_on_files_and_their_order() {
    let hash = calibration_hash(&["lens", "mount"]);
    assert_ne!(hash, calibration_hash(&["mount", "lens"]));
    assert_ne!(hash, calibration_hash(&["lensmount"]));
    assert_eq!(hash, calibration_hash(&["lens", "mount"]));
}
