//! Time limit for the body of a request: a client that sends only a head must not occupy a connection slot.

use axum::body::{Body, HttpBody};
use axum::extract::Request;
use futures_util::stream::{self, StreamExt};
use std::io::{Error, ErrorKind};
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// Time after the head of a request within which its whole body must arrive.
pub(super) const BODY_TIMEOUT: Duration = Duration::from_secs(5);

/// Returns a request with a body that ends with an error if it does not come in time.
pub(super) async fn with_body_timeout(request: Request) -> Request {
    let until = Instant::now() + BODY_TIMEOUT;
    request.map(|body| match body.is_end_stream() {
        true => body,
        false => limit_body(body, until),
    })
}

fn limit_body(body: Body, until: Instant) -> Body {
    let parts = stream::unfold(Some(body.into_data_stream()), move |body| async move {
        let mut body = body?;
        match timeout_at(until, body.next()).await {
            Ok(part) => part.map(|part| (part, Some(body))),
            Err(_) => {
                let late = Error::new(ErrorKind::TimedOut, "the request body was not received in time");
                Some((Err(axum::Error::new(late)), None))
            }
        }
    });
    Body::from_stream(parts)
}
