//! The robot's drive: what it makes of the commands it gets, and of those it does not get.

use crate::world::Action;
use hapfic_messages::{Command, Drive, Mode};

/// The drive's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveState {
    /// The newest command.
    command: Option<Command>,
    /// Whether a torque has ever been commanded: from then on the brakes are off.
    released: bool,
}

impl DriveState {
    /// The memory of a drive whose program was started again: brakes off if they had been.
    #[must_use]
    pub fn resumed(released: bool) -> Self {
        Self { command: None, released }
    }

    /// Takes a command if it is newer than the one in use. Says whether it was.
    pub fn take(&mut self, command: &Command) -> bool {
        let newer = self.command.is_none_or(|c| command.tick > c.tick);
        if newer {
            self.command = Some(*command);
            self.released |= command.mode == Mode::Active.code();
        }
        newer
    }

    /// Tick of the command in use; -1 if there is none.
    #[must_use]
    pub fn command_tick(&self) -> i64 {
        self.command.map_or(-1, |c| c.tick)
    }

    /// What to do from `tick` on, for one period.
    ///
    /// The command of the tick before is due. A late one is replaced by the one in use; when `timeout_ticks` ticks brought
    /// nothing, the drive damps its joints with `damping`, N m s/rad.
    #[must_use]
    pub fn act(&self, tick: i64, timeout_ticks: u32, damping: f64) -> (Drive, Action) {
        let Some(command) = self.command.filter(|_| self.released) else {
            return (Drive::Held, Action::Held);
        };
        let missed = tick.saturating_sub(1).saturating_sub(command.tick);
        if missed < i64::from(timeout_ticks) && Mode::from_code(command.mode) == Some(Mode::Active) {
            (Drive::Torque, Action::Torque(command.torque))
        } else {
            (Drive::Braking, Action::Damped(damping))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(tick: i64, mode: Mode) -> Command {
        Command { tick, mode: mode.code(), torque: [tick as f64; 8], joints: 3, ..Command::default() }
    }

    #[test]
    fn brakes_hold_until_a_torque_is_commanded() {
        let mut drive = DriveState::default();
        assert_eq!(drive.act(0, 3, 2.0).0, Drive::Held);
        drive.take(&command(-1, Mode::Hold));
        assert_eq!(drive.act(0, 3, 2.0).0, Drive::Held);
        drive.take(&command(0, Mode::Active));
        assert_eq!(drive.act(1, 3, 2.0), (Drive::Torque, Action::Torque([0.0; 8])));
    }

    #[test]
    fn two_missing_commands_are_bridged_and_the_third_brakes() {
        let mut drive = DriveState::default();
        drive.take(&command(7, Mode::Active));
        for tick in 8..=10 {
            assert_eq!(drive.act(tick, 3, 2.0).1, Action::Torque([7.0; 8]), "tick {tick}");
        }
        assert_eq!(drive.act(11, 3, 2.0), (Drive::Braking, Action::Damped(2.0)));
        drive.take(&command(11, Mode::Active));
        assert_eq!(drive.act(12, 3, 2.0).0, Drive::Torque);
    }

    #[test]
    fn an_older_command_is_not_taken() {
        let mut drive = DriveState::default();
        assert!(drive.take(&command(5, Mode::Active)));
        assert!(!drive.take(&command(5, Mode::Active)));
        assert!(!drive.take(&command(4, Mode::Active)));
        assert_eq!(drive.command_tick(), 5);
    }

    #[test]
    fn braking_is_obeyed_at_once() {
        let mut drive = DriveState::default();
        drive.take(&command(5, Mode::Active));
        drive.take(&command(6, Mode::Brake));
        assert_eq!(drive.act(7, 3, 2.0).0, Drive::Braking);
    }
}
