//! Drive of the robot: maps commands, and the lack of commands, to torques, damping or brakes.

use crate::world::DriveAction;
use hapfic_messages::{Command, Drive, Mode};

/// State of the drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveState {
    /// The newest command.
    command: Option<Command>,
    /// Whether any command has had a torque; the brakes are off from then on.
    released: bool,
}

impl DriveState {
    /// State of a drive after a restart of the plant: the brakes are off if they had been off.
    #[must_use]
    pub fn resumed(released: bool) -> Self {
        Self { command: None, released }
    }

    /// Accepts a command if it is newer than the present one; returns whether it was.
    pub fn take(&mut self, command: &Command) -> bool {
        let newer = self.command.is_none_or(|c| command.tick > c.tick);
        if newer {
            self.command = Some(*command);
            self.released |= command.mode == Mode::Active.code();
        }
        newer
    }

    /// Tick of the present command; -1 without a command.
    #[must_use]
    pub fn command_tick(&self) -> i64 {
        self.command.map_or(-1, |c| c.tick)
    }

    /// Action from `tick` on, for one period.
    ///
    /// The command of the tick before is due. If it is late, the drive repeats the present one. After `timeout_ticks`
    /// ticks without a command, the drive damps its joints with `damping` [N m s/rad].
    #[must_use]
    pub fn act(&self, tick: i64, timeout_ticks: u32, damping: f64) -> (Drive, DriveAction) {
        let Some(command) = self.command.filter(|_| self.released) else {
            return (Drive::Held, DriveAction::Held);
        };
        let missed = tick.saturating_sub(1).saturating_sub(command.tick);
        if missed < i64::from(timeout_ticks) && Mode::from_code(command.mode) == Some(Mode::Active) {
            (Drive::Torque, DriveAction::Torque(command.torque))
        } else {
            (Drive::Braking, DriveAction::Damped(damping))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hapfic_messages::MAX_JOINTS;

    fn command(tick: i64, mode: Mode) -> Command {
        Command { tick, mode: mode.code(), torque: [tick as f64; MAX_JOINTS], joints: 3, ..Command::default() }
    }

    #[test]
    fn drive_before_first_torque_holds() {
        let mut drive = DriveState::default();
        assert_eq!(drive.act(0, 3, 2.0).0, Drive::Held);
        drive.take(&command(-1, Mode::Hold));
        assert_eq!(drive.act(0, 3, 2.0).0, Drive::Held);
        drive.take(&command(0, Mode::Active));
        assert_eq!(drive.act(1, 3, 2.0), (Drive::Torque, DriveAction::Torque([0.0; MAX_JOINTS])));
    }

    #[test]
    fn drive_third_missing_command_brakes() {
        let mut drive = DriveState::default();
        drive.take(&command(7, Mode::Active));
        for tick in 8..=10 {
            assert_eq!(drive.act(tick, 3, 2.0).1, DriveAction::Torque([7.0; MAX_JOINTS]), "tick {tick}");
        }
        assert_eq!(drive.act(11, 3, 2.0), (Drive::Braking, DriveAction::Damped(2.0)));
        drive.take(&command(11, Mode::Active));
        assert_eq!(drive.act(12, 3, 2.0).0, Drive::Torque);
    }

    #[test]
    fn drive_older_command_is_ignored() {
        let mut drive = DriveState::default();
        assert!(drive.take(&command(5, Mode::Active)));
        assert!(!drive.take(&command(5, Mode::Active)));
        assert!(!drive.take(&command(4, Mode::Active)));
        assert_eq!(drive.command_tick(), 5);
    }

    #[test]
    fn drive_brake_command_acts_immediately() {
        let mut drive = DriveState::default();
        drive.take(&command(5, Mode::Active));
        drive.take(&command(6, Mode::Brake));
        assert_eq!(drive.act(7, 3, 2.0).0, Drive::Braking);
    }
}
