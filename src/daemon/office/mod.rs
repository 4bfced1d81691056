//! The cell's records on their way to the office: a thread of its own that reads what the store has for the office, sends it to the
//! broker, and asks what the office has. Nothing in the cell waits for it, and nothing that the office says changes what the cell
//! does: it is sent again, or it is an alarm.
//!
//! `sending` is one round of it, `progress_file` what is remembered between two processes, `status` what people are told.

mod progress_file;
mod sending;
mod state;
mod status;

pub use status::OfficeStatus;

use super::background::run_apart;
use super::front_parts::FrontParts;
use crate::cell;
use sending::Sender;
use state::Teller;
use std::path::PathBuf;
use std::thread::{self, JoinHandle};
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::sync::oneshot;

/// It is looked for something new so often.
const EVERY: Duration = Duration::from_secs(1);
/// After a failure it is tried again after one second, then two, four, and so on up to this.
const LONGEST_PAUSE: Duration = Duration::from_secs(60);

/// What the sender is made of.
pub struct OfficeParts {
    /// `[office]` of the cell's file.
    pub office: cell::Office,
    /// The store's folder.
    pub folder: PathBuf,
    /// Whose state is told; `None` where no service runs.
    pub front: Option<FrontParts>,
    /// What people are told of it.
    pub status: OfficeStatus,
}

/// The sender while it works; it ends when this is dropped.
#[derive(Debug)]
pub struct OfficeSender {
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl OfficeSender {
    /// Starts it.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(parts: OfficeParts) -> std::io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_io().enable_time().max_blocking_threads(2).build()?;
        let (end, ended) = oneshot::channel();
        let work = move || {
            run_apart(&runtime, "the way to the office", ended, async |ended| {
                tokio::select! {
                    () = run(&parts) => {}
                    _ = ended => {}
                }
            });
        };
        let thread = thread::Builder::new().name("office".to_owned()).spawn(work)?;
        Ok(OfficeSender { end: Some(end), thread: Some(thread) })
    }
}

impl Drop for OfficeSender {
    fn drop(&mut self) {
        drop(self.end.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

async fn run(OfficeParts { office, folder, front, status }: &OfficeParts) {
    let mut pause = EVERY;
    let mut sender = Sender::new(office.clone(), folder.clone(), status.clone());
    let mut teller = front.clone().map(Teller::new);
    loop {
        match sender.round(teller.as_mut()).await {
            Ok(is_more) => {
                pause = EVERY;
                status.works();
                if is_more {
                    continue;
                }
                tokio::time::sleep(EVERY).await;
            }
            Err(problem) => {
                if status.fails(&problem) {
                    tracing::warn!("records do not reach the office: {problem}");
                }
                sender.forget_link();
                tokio::time::sleep(pause).await;
                pause = LONGEST_PAUSE.min(pause * 2);
            }
        }
    }
}
