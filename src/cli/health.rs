//! May a cycle start on these calibrations? Held against the last verifications in the store.

use super::calibrate::now_unix_s;
use super::fault::Fault;
use super::load::CellFiles;
use crate::calib::health::{Demands, beyond, health};
use crate::store::calibration_hash;
use crate::verdict::Judgement;

/// Rejects where a camera was not verified, too long ago, with other files, or was beyond the limit, and where the last
/// touch with today's tool was beyond it. A tool need not be touched: without a touch the robot's part of the error is
/// not measured, and the budget says so.
///
/// # Errors
/// Where a calibration cannot be read, or there is no store.
pub fn judge(files: &CellFiles) -> Result<Judgement, Fault> {
    let (store, now) = (files.store()?, now_unix_s());
    let demands = Demands::of(files.cell.limits());
    let scanner = calibration_hash(&[&files.scanner()?.text, &files.base_from_camera()?.text]);
    let flange = files.hash_with_arm(&[&files.flange_camera()?.text, &files.flange_from_camera()?.text]);
    let mut reject = Vec::new();
    for (subject, hash) in [("scanner", scanner), ("flange_camera", flange)] {
        let last = store.last_verification(subject).map_err(Fault::stage)?;
        reject.extend(health(subject, last.as_ref(), &hash, now, demands).reasons);
    }
    let touch = files.last_touch(&files.flange_from_tool()?.text);
    reject.extend(touch.and_then(|touch| beyond(&touch, demands)));
    Ok(Judgement::of(reject, vec![]))
}
