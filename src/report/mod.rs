//! Pictures and pages for people: from results to something to look at. Computes nothing that decides.

mod axis;
mod bars;
mod calibration;
pub mod canvas;
mod checks;
mod closeup;
mod cycle;
mod dwelt;
mod error_map;
mod heat_chart;
mod inspection;
mod overlay;
pub mod page;
mod reasons;
mod removed;
mod ruler;
mod scan_view;
pub mod sheet;
mod surface_map;
mod trend_chart;
mod unrolled;

pub use bars::{Bar, bars};
pub use calibration::{corners_to_touch, residual_field, trend};
pub use checks::{check_row, shown};
pub use closeup::{CornerView, StripPicture, bounds, cut, film_strip, strip_times_s};
pub use cycle::cycle_page;
pub use dwelt::{dwell_map, overlap_map};
pub use error_map::{Left, error_map};
pub use heat_chart::heat_chart;
pub use inspection::inspection_page;
pub use overlay::View;
pub use reasons::{ReasonPicture, reason_pictures};
pub use removed::removal_map;
pub use scan_view::{missing_share, region_in_scan, scan_picture};
pub use surface_map::surface_map;
pub use trend_chart::{ChartWords, trend_chart};
