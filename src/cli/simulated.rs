//! What surrounds the ports of a cell with simulated cameras: the world that follows a controller in another process, and
//! a person who dries the panel before a request confirms that it is dry.

use panelprep_cell::cycle::{self, At};
use panelprep_devices::world::{Follower, SimulatedWorld};
use panelprep_kuka::eki::{Channel, LinkLoss, Report};
use panelprep_service::daemon::{
    LinkedRobot, LoopEvent, Port, Request, RequestAnswer, RequestCommand, RequestKind, RobotAnswer, RobotCommand,
};

/// The robot's port with the simulated world that follows the controller's reports, if there is one. If the controller
/// is not a mock, it is then reported as lost: a simulation must not affect the motion of a real arm.
pub struct FollowedRobot<'r> {
    /// The robot.
    pub robot: &'r mut LinkedRobot,
    /// The world around it.
    pub follower: Option<Follower>,
}

impl Port<RobotCommand> for FollowedRobot<'_> {
    fn perform(&mut self, command: RobotCommand) -> RobotAnswer {
        let answer = self.robot.perform(command);
        if let Some(follower) = &self.follower
            && let RobotAnswer::Report(Ok(Some(Report::State(state) | Report::Connected { state }))) = &answer
        {
            if !Follower::is_simulated_controller(state) {
                let problem = "the cameras are simulated, but the controller is not a mock controller; no command is \
                               sent to it";
                let why = LinkLoss::System { channel: Channel::State, problem: problem.to_owned() };
                return RobotAnswer::Report(Ok(Some(Report::LinkLost { why })));
            }
            follower.process_state(state);
        }
        answer
    }
}

/// The port of the requests with a person who dries the panel before a request confirms that it is dry.
pub struct SimulatedPerson<R> {
    /// The source of the requests.
    pub requester: R,
    /// The simulated world.
    pub world: SimulatedWorld,
}

impl<R: Port<RequestCommand>> Port<RequestCommand> for SimulatedPerson<R> {
    fn perform(&mut self, command: RequestCommand) -> RequestAnswer {
        let is_held = matches!(command, RequestCommand::Next(state) if matches!(state.at, At::Held(_)));
        let begins = matches!(command, RequestCommand::Publish(LoopEvent::Begun(..)));
        let answer = self.requester.perform(command);
        let unholds =
            |request: &Request| matches!(request.what, RequestKind::Table(cycle::Request::Unhold { dried: true }));
        let dries = match &answer {
            RequestAnswer::Next(Ok(Some(request))) => is_held && unholds(request),
            _ => begins,
        };
        if dries {
            self.world.dry_panel();
        }
        answer
    }
}
