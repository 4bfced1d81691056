//! Looks at the cell once a minute, for the alarms between cycles (`standing`).

use super::clock::now_unix_ms;
use super::standing::Found;
use super::state::{Web, blocking};
use std::sync::Arc;
use std::time::Duration;

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
            web.standing.look(&found, now_unix_ms());
        }
        tokio::time::sleep(EVERY).await;
    }
}
