//! Pictures and pages that show results to people. No decision depends on values that this module computes.

mod calibration;
pub mod canvas;
mod charts;
mod closeup;
mod cycle;
mod inspection;
mod overlay;
pub mod page;
mod reasons;
pub mod record_pdf;
mod scan_view;
mod unrolled_maps;

pub use calibration::{RemainingError, depth_error_map, draw_corners_to_touch, error_map, residual_field, trend};
pub use charts::{BarClass, ChartTexts, draw_bars, heat_chart, trend_chart};
pub use closeup::{CornerView, FailedGrid, StripPicture, bounds, crop_with_mask, film_strip, strip_times_s};
pub use cycle::cycle_page;
pub use inspection::inspection_page;
pub use overlay::PanelOverlay;
pub use page::{check_row, format_value};
pub use reasons::{ReasonPicture, reason_pictures};
pub use scan_view::{draw_region, missing_fraction, scan_picture, surface_map, today_map};
pub use unrolled_maps::{dwell_map, overlap_map, removal_map};
