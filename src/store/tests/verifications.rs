//! Verifications come back in order, each with its subject.

use super::*;
use crate::calib::health::Verification;

fn verified(subject: &str, error_mm: f64) -> Verification {
    let hash = calibration_hash(&["lens", "mount"]);
    Verification { subject: subject.to_owned(), error_mm, limit_mm: 0.5, calibration_hash: hash, at_unix_s: 7 }
}

#[test]
fn verifications_are_kept_by_subject_and_the_last_one_counts() {
    let (folder, mut store) = new_store();
    assert_eq!(store.last_verification("scanner").expect("read"), None);
    let all = [verified("scanner", 0.1), verified("tool", 0.3), verified("scanner", 0.2)];
    for verification in &all {
        store.keep_verification(verification).expect("kept");
    }
    assert!(store.keep_verification(&verified("scanner", f64::NAN)).expect_err("NaN").to_string().contains("NaN"));
    drop(store);
    let mut store = Store::open(&folder.path().join("store")).expect("the same store");
    assert_eq!(store.verifications("scanner").expect("read"), [all[0].clone(), all[2].clone()]);
    assert_eq!(store.last_verification("tool").expect("read"), Some(all[1].clone()));
    assert!(matches!(store.keep_verification(&all[0]), Err(StoreError::ReadOnly { .. })));
}

#[test]
fn the_hash_tells_files_and_their_order() {
    let hash = calibration_hash(&["lens", "mount"]);
    assert_ne!(hash, calibration_hash(&["mount", "lens"]));
    assert_ne!(hash, calibration_hash(&["lensmount"]));
    assert_eq!(hash, calibration_hash(&["lens", "mount"]));
}
