//! What ended a cycle, in words for the operator.

use crate::cycle::{Answer, Deadline, Event, Report, Request, Robot, Trouble};
use crate::verdict::Reason;

/// Why this event ends a cycle without a result, where it is one that can.
pub(super) fn cause(event: &Event) -> Option<Reason> {
    match event {
        Event::Asked(Request::Stop) => {
            Some(Reason::new("stopped", "somebody asked for a stop before the cycle's end"))
        }
        Event::Asked(Request::Abort) => Some(Reason::new("aborted", "somebody asked for an abort")),
        Event::Told(Report::Boot) => Some(Reason::new("interrupted", "the program ended before the cycle did")),
        Event::Told(Report::Trouble(trouble) | Report::Answered { answer: Answer::Failed(trouble), .. }) => {
            Some(Reason::new("fault", trouble_words(*trouble)))
        }
        Event::Told(Report::Deadline { which: Deadline::Answer, .. }) => {
            Some(Reason::new("fault", trouble_words(Trouble::Late)))
        }
        Event::Told(Report::Deadline { which: Deadline::Stop, .. }) => {
            Some(Reason::new("fault", "the stop took longer than [limits] stop_deadline_s"))
        }
        Event::Told(Report::Robot(robot)) => robot_words(*robot).map(|words| Reason::new("robot", words)),
        _ => None,
    }
}

fn trouble_words(trouble: Trouble) -> &'static str {
    match trouble {
        Trouble::Camera => "a camera gave no picture; look at its cable, power and lens",
        Trouble::Picture => "a camera's picture cannot be used",
        Trouble::Computing => "a computation could not be made",
        Trouble::Feedback => {
            "a feedback of the cell is not what it should be; look at tool, extraction, water, lens, light"
        }
        Trouble::Starved => "the robot ran out of waypoints on its path",
        Trouble::Slow => "the robot is far behind its path",
        Trouble::Gate => "the gate refused a motion; nothing of it was sent",
        Trouble::Refused => "the robot refused a command",
        Trouble::Short => "the robot stood before its path's end",
        Trouble::Sequence => "the robot acknowledged out of order",
        Trouble::Protocol => "what came from the robot is not the protocol",
        Trouble::Deviation => "the arm stands elsewhere than it was sent",
        Trouble::Store => "the store does not write; look at its disk",
        Trouble::Late => "an answer did not come in time",
        Trouble::Unexpected => "an answer came that does not fit",
    }
}

fn robot_words(robot: Robot) -> Option<&'static str> {
    match robot {
        Robot::Unknown | Robot::Ready => None,
        Robot::LinkLost => Some("the robot's link was lost"),
        Robot::Restarted => Some("the robot's controller was started anew, or runs another program"),
        Robot::EmergencyStop => Some("emergency stop"),
        Robot::GuardOpen => Some("the guard was opened"),
        Robot::DrivesOff => Some("the robot's drives are off, or it may not move"),
        Robot::NotAutomatic => Some("the robot is in T1 or T2, not in automatic"),
    }
}
