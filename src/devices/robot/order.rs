//! Requests to the link's thread.

use panelprep_kuka::eki::{Command, CommandId, Epoch, MoveLin, QueueError};
use tokio::sync::oneshot;

type Reply<T> = oneshot::Sender<Result<T, QueueError>>;

#[derive(Debug)]
pub(super) enum LinkRequest {
    Queue(Command, Reply<CommandId>),
    QueuePath(Vec<MoveLin>, Reply<CommandId>),
    /// A path of which only the first points are sent before more are permitted.
    QueuePathWithin(Vec<MoveLin>, u32, Reply<CommandId>),
    Permit(Option<CommandId>, Reply<()>),
    OpenEpoch(Epoch, Reply<Epoch>),
    Abort(Reply<()>),
    /// Aborts the open epoch; there is no answer.
    Stop,
    /// The outputs to a line; no caller waits for them.
    Line(u32),
    /// Lets virtual time pass, if no report was added since this count of reports.
    Grant {
        told: u64,
    },
}
