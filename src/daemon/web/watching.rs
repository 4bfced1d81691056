//! Looks at the cell once a minute, for the alarms between cycles (`standing`).

use super::standing::Found;
use super::state::{Web, blocking};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// It is looked so often.
const EVERY: Duration = Duration::from_secs(60);

/// Looks again and again, as long as the page is served.
pub(super) async fn follow(web: Arc<Web>) {
    loop {
        let shared = web.clone();
        let found = blocking(move || {
            let cameras = shared.gateway.cameras.as_ref().and_then(|cameras| cameras.check());
            Found { cell: shared.setup.standing(), cameras }
        });
        if let Some(found) = found.await {
            let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            web.standing.look(&found, i64::try_from(since.as_millis()).unwrap_or(i64::MAX));
        }
        tokio::time::sleep(EVERY).await;
    }
}
