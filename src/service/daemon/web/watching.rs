//! Checks the cell once a minute, for the alarms between cycles (`daemon::alarms`), and counts what was refused in
//! a flood.

use super::state::{Web, run_blocking};
use std::sync::Arc;
use std::time::Duration;

/// Interval at which the cell is checked.
const CHECK_INTERVAL: Duration = Duration::from_secs(60);

/// Repeats the check as long as the page is served.
pub(super) async fn repeat_check(web: Arc<Web>) {
    loop {
        let shared = web.clone();
        run_blocking(move || {
            shared.front.check_alarms();
            shared.count_refusals(shared.now_ms());
        })
        .await;
        tokio::time::sleep(CHECK_INTERVAL).await;
    }
}
