//! What the link's thread is told to do.

use crate::eki::{Command, CommandId, Epoch, MoveLin, QueueError};
use tokio::sync::oneshot;

type Reply<T> = oneshot::Sender<Result<T, QueueError>>;

#[derive(Debug)]
pub(super) enum LinkRequest {
    Queue(Command, Reply<CommandId>),
    QueuePath(Vec<MoveLin>, Reply<CommandId>),
    /// A path of which only so many points are sent before more are permitted.
    QueuePathWithin(Vec<MoveLin>, u32, Reply<CommandId>),
    Permit(Option<CommandId>, Reply<()>),
    OpenEpoch(Epoch, Reply<Epoch>),
    Abort(Reply<()>),
    /// Let virtual time pass, where nothing was told since this count of reports.
    Grant {
        told: u64,
    },
}
