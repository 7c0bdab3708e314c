//! Figures of a study beyond the metrics of a log.

use hapfic_messages::{Command, MAX_JOINTS, State};

/// Largest forces and torques, and the work of the joints, over the ticks so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Extremes {
    /// Largest force on the foot, as mean of a tick [N].
    pub foot_force_n: f64,
    /// Largest force of one contact between any two bodies, as mean of a tick [N].
    pub contact_force_n: f64,
    /// Largest commanded torque of each joint [N m], [N] for a prismatic joint.
    pub torque: [f64; MAX_JOINTS],
    /// Ticks in which the peak limited the torque of a joint.
    pub limited_ticks: u64,
    /// Work of the joints' torques, as sum of absolute values [J].
    pub work_j: f64,
    /// q of the previous tick [rad or m].
    position: Option<[f64; MAX_JOINTS]>,
}

impl Extremes {
    /// Adds the next tick.
    #[must_use]
    pub fn step(self, state: &State, command: &Command) -> Self {
        let joints = (state.joints as usize).min(MAX_JOINTS);
        let contacts = state.contacts.iter().take(state.contact_count as usize);
        let mut torque = self.torque;
        for (most, now) in torque.iter_mut().zip(command.torque).take(joints) {
            *most = most.max(now.abs());
        }
        // The torque in a state is that of the previous tick, over which the joints moved.
        let work = |before: [f64; MAX_JOINTS]| -> f64 {
            (0..joints).map(|i| (state.joint_torque[i] * (state.joint_position[i] - before[i])).abs()).sum()
        };
        Self {
            foot_force_n: self.foot_force_n.max(norm(&state.foot_force)),
            contact_force_n: contacts.map(|contact| norm(&contact.force)).fold(self.contact_force_n, f64::max),
            torque,
            limited_ticks: self.limited_ticks + u64::from(command.limited != 0),
            work_j: self.work_j + self.position.map_or(0.0, work),
            position: Some(state.joint_position),
        }
    }

    /// Largest commanded torque of any joint [N m], [N] for a prismatic joint.
    #[must_use]
    pub fn largest_torque(&self) -> f64 {
        self.torque.iter().copied().fold(0.0, f64::max)
    }
}

fn norm(vector: &[f64; 3]) -> f64 {
    vector.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(position: f64, torque: f64) -> State {
        let mut state = State { joints: 2, ..State::default() };
        state.joint_position[1] = position;
        state.joint_torque[1] = torque;
        // Beyond the valid joints.
        state.joint_position[2] = 100.0 * position;
        state.joint_torque[2] = 100.0;
        state
    }

    fn command(torque: f64, limited: u32) -> Command {
        let mut command = Command { limited, ..Command::default() };
        command.torque[0] = torque;
        command.torque[2] = 1e3;
        command
    }

    #[test]
    fn extremes_work_counts_both_signs_from_second_tick() {
        let rest = Command::default();
        let started = Extremes::default().step(&state(0.5, 7.0), &rest);
        assert_eq!(started.work_j, 0.0);
        let done = started.step(&state(0.75, 2.0), &rest);
        assert_eq!(done.work_j, 0.5);
        assert_eq!(done.step(&state(0.25, 2.0), &rest).work_j, 1.5);
    }

    #[test]
    fn extremes_smaller_values_keep_largest() {
        let mut pressed = state(0.0, 0.0);
        pressed.foot_force = [3.0, 0.0, -4.0];
        pressed.contact_count = 1;
        pressed.contacts[0].force = [0.0, 6.0, 8.0];
        // Beyond the valid contacts.
        pressed.contacts[1].force = [1e3; 3];
        let all = Extremes::default().step(&pressed, &command(-5.0, 0b10)).step(&state(0.0, 0.0), &command(4.0, 0));
        assert_eq!((all.foot_force_n, all.contact_force_n), (5.0, 10.0));
        assert_eq!((all.largest_torque(), all.limited_ticks), (5.0, 1));
    }
}
