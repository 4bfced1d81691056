//! `panelprep calibrate intrinsics --from-scan`: determines the lens of a 3D camera from one of its scans. Each
//! point of the scan lies on the ray of its pixel.

use super::super::disk;
use super::super::fault::Fault;
use super::super::outcome::Outcome;
use super::args::Intrinsics as Args;
use super::date;
use super::output::{provenance, write_calibration};
use panelprep_base::geometry::{fit_lens, sample_points};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::Intrinsics;
use panelprep_cell::files;
use serde_json::json;
use std::path::Path;

/// Limits of the median distance between the points and the rays of the written lens, px. Above the first limit a
/// person must look; above the second one the cloud is not from a camera.
const MEDIAN_PX: (f64, f64) = (0.1, 1.0);

/// Minimum difference of the depths, as a share of the distance. A flat scan lies on the rays of some lens for
/// every position of its frame.
const MIN_RELIEF: f64 = 0.05;

/// Computes the lens from the scan and writes the file.
///
/// # Errors
/// If the file is not an organised cloud in a camera's frame.
pub fn run(args: &Args, scan: &Path) -> Result<Outcome, Fault> {
    let bytes = disk::read(scan)?;
    let cloud = files::read_any_cloud(&bytes, None).map_err(|error| Fault::file_fault(scan, error))?;
    files::check_frame(&cloud).map_err(|error| Fault::file_fault(scan, error))?;
    let found = fit_lens(&sample_points(&cloud), (cloud.width(), cloud.height()));
    let Some(found) = found else {
        let message = format!(
            "{} has too few points, or points on one line, to determine a lens; scan the whole cell",
            scan.display()
        );
        return Ok(Outcome::from_judgement(&Judgement::new(vec![Reason::new("not_a_lens", message)], vec![])));
    };
    let (mut reject, mut review) = (Vec::new(), Vec::new());
    let beyond = |limit_px: f64| found.median_px.is_nan() || found.median_px > limit_px;
    if beyond(MEDIAN_PX.0) {
        let beyond = beyond(MEDIAN_PX.1);
        let [off, allowed] =
            distinguishable_texts(found.median_px, if beyond { MEDIAN_PX.1 } else { MEDIAN_PX.0 }, 3);
        let message = format!(
            "half of the points are {off} px or more from the rays of the best-fitting lens (limit {allowed} px): \
             was the scan smoothed or moved after it was taken?"
        );
        let reason = Reason::new("off_rays", message);
        if beyond { reject.push(reason) } else { review.push(reason) }
    }
    let mut depths_mm: Vec<f64> = sample_points(&cloud).iter().map(|(_, point)| point.mm.z).collect();
    depths_mm.sort_by(f64::total_cmp);
    let depth = |share: f64| depths_mm[((depths_mm.len() - 1) as f64 * share) as usize];
    let relief = (depth(0.95) - depth(0.05)) / depth(0.5);
    if relief.is_nan() || relief < MIN_RELIEF {
        let [found, wanted] = distinguishable_texts(100.0 * relief, 100.0 * MIN_RELIEF, 1);
        review.push(Reason::new(
            "flat",
            format!(
                "the depths of the scan differ by {found} % of the distance, at least {wanted} % are needed: a flat scan in another frame \
                 would give a wrong lens; scan a cell with objects at several distances"
            ),
        ));
    }
    let intrinsics = Intrinsics {
        serial: args.serial.clone(),
        date: date::today_utc(),
        // The result is a median, which hides half of the points; it is not a root mean square.
        rms_px: None,
        provenance: provenance(vec![files::content_hash(&bytes)], vec![]),
        ..Intrinsics::from_camera(found.camera)
    };
    let text = intrinsics.to_toml();
    if let Err(problems) = Intrinsics::check(&args.out.display().to_string(), &text) {
        reject.push(Reason::new("not_a_lens", format!("these values are not a valid lens: {problems}")));
    }
    let judgement = Judgement::new(reject, review);
    let mut outcome = Outcome::from_judgement(&judgement);
    let lens = &found.camera;
    let numbers = [
        ("fx_px", lens.fx_px),
        ("fy_px", lens.fy_px),
        ("cx_px", lens.cx_px),
        ("cy_px", lens.cy_px),
        ("k1", lens.k1),
        ("k2", lens.k2),
        ("p1", lens.p1),
        ("p2", lens.p2),
        ("k3", lens.k3),
        ("median_px", found.median_px),
    ];
    for (key, number) in numbers {
        outcome.add_value(key, json!(number));
    }
    outcome.add_value("width_px", json!(lens.width_px));
    outcome.add_value("height_px", json!(lens.height_px));
    outcome.add_line(format!(
        "fx {:.2}, fy {:.2}, cx {:.2}, cy {:.2} px: half of the points are within {:.4} px of the rays of this lens",
        lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, found.median_px
    ));
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}
