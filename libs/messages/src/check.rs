//! Checks of messages from another process: finite, in range, codes known. The receiver checks the order of ticks.

use crate::{
    Command, ControllerState, Credit, Detector, Drive, EVENT_TEXT, Event, EventKind, JointSpaceParameters, MAX_CONTACTS,
    MAX_JOINTS, MAX_LIMBS, MAX_OBJECTS, Mode, Operator, Parameters, Phase, Process, Reference, Request, ResetPolicy,
    RotationParameters, RotationRequest, Saturation, Search, Severity, Source, State, Task, Timing,
};

/// Defect of a message.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ValidationError {
    /// Not a number, or infinite.
    #[error("'{field}' is {found}, expected a finite number")]
    NotFinite {
        /// Name of the field.
        field: &'static str,
        /// Value found.
        found: f64,
    },
    /// An unknown code.
    #[error("'{field}' has code {found}, expected a known code")]
    Code {
        /// Name of the field.
        field: &'static str,
        /// Value found.
        found: u32,
    },
    /// A count above the capacity, or another number than agreed.
    #[error("'{field}' is {found}, expected {expected}")]
    Count {
        /// Name of the field.
        field: &'static str,
        /// Value found.
        found: u64,
        /// Value expected.
        expected: u64,
    },
    /// Out of its range.
    #[error("'{field}' is {found}, expected {expected}")]
    Range {
        /// Name of the field.
        field: &'static str,
        /// Value found.
        found: f64,
        /// Value expected.
        expected: &'static str,
    },
    /// Bytes that are not text.
    #[error("'{field}' is not UTF-8 text")]
    Text {
        /// Name of the field.
        field: &'static str,
    },
    /// A torque that does not match the request's own force.
    #[error(
        "'torque[{joint}]' is {found} N m, expected {expected} N m: J^T W of the request's own force and moment, with tau_N and g"
    )]
    Torque {
        /// Index of the joint, from the base.
        joint: usize,
        /// Torque found [N m].
        found: f64,
        /// Torque expected [N m].
        expected: f64,
    },
    /// A torque in joint space that does not match the state.
    #[error("'joint_space_torque[{joint}]' is {found} N m, expected {expected} N m: posture, damping and limits in this state")]
    JointSpaceTorque {
        /// Index of the joint, from the base.
        joint: usize,
        /// Torque found [N m].
        found: f64,
        /// Torque expected [N m].
        expected: f64,
    },
    /// Another tick than the expected one.
    #[error("'{field}' is {found}, expected {expected}")]
    Tick {
        /// Name of the field.
        field: &'static str,
        /// Value found.
        found: i64,
        /// Value expected.
        expected: i64,
    },
}

/// Message with a check that needs no other data.
pub trait Check {
    /// Finds the first defect.
    ///
    /// # Errors
    /// The [`ValidationError`].
    fn check(&self) -> Result<(), ValidationError>;
}

fn finite(field: &'static str, values: &[f64]) -> Result<(), ValidationError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(&found) => Err(ValidationError::NotFinite { field, found }),
        None => Ok(()),
    }
}

fn code<T>(field: &'static str, found: u32, decoded: Option<T>) -> Result<(), ValidationError> {
    decoded.map(drop).ok_or(ValidationError::Code { field, found })
}

fn at_most(field: &'static str, found: u32, most: usize) -> Result<(), ValidationError> {
    if found as usize <= most {
        Ok(())
    } else {
        Err(ValidationError::Count { field, found: found.into(), expected: most as u64 })
    }
}

fn not_negative(field: &'static str, values: &[f64]) -> Result<(), ValidationError> {
    finite(field, values)?;
    match values.iter().find(|v| **v < 0.0) {
        Some(&found) => Err(ValidationError::Range { field, found, expected: "a number of at least zero" }),
        None => Ok(()),
    }
}

fn positive(field: &'static str, values: &[f64]) -> Result<(), ValidationError> {
    finite(field, values)?;
    match values.iter().find(|v| **v <= 0.0) {
        Some(&found) => Err(ValidationError::Range { field, found, expected: "a positive number" }),
        None => Ok(()),
    }
}

/// A unit quaternion, or four zeros where there is no orientation.
fn unit_or_none(field: &'static str, q: &[f64; 4]) -> Result<(), ValidationError> {
    let square: f64 = q.iter().map(|x| x * x).sum();
    if square == 0.0 || (square - 1.0).abs() <= 1e-6 {
        return Ok(());
    }
    Err(ValidationError::Range { field, found: square.sqrt(), expected: "a unit quaternion, or zeros for none" })
}

impl Check for State {
    fn check(&self) -> Result<(), ValidationError> {
        at_most("joints", self.joints, MAX_JOINTS)?;
        at_most("object_count", self.object_count, MAX_OBJECTS)?;
        at_most("contact_count", self.contact_count, MAX_CONTACTS)?;
        at_most("limbs", self.limbs, MAX_LIMBS)?;
        code("drive", self.drive, Drive::from_code(self.drive))?;
        finite("joint_position", &self.joint_position)?;
        finite("joint_velocity", &self.joint_velocity)?;
        finite("joint_torque", &self.joint_torque)?;
        finite("foot_position", &self.foot_position)?;
        finite("foot_velocity", &self.foot_velocity)?;
        finite("foot_force", &self.foot_force)?;
        finite("foot_orientation", &self.foot_orientation)?;
        unit_or_none("foot_orientation", &self.foot_orientation)?;
        finite("foot_angular_velocity", &self.foot_angular_velocity)?;
        finite("foot_moment", &self.foot_moment)?;
        for o in &self.objects[..self.object_count as usize] {
            finite("objects.position", &o.position)?;
            finite("objects.orientation", &o.orientation)?;
            finite("objects.linear_velocity", &o.linear_velocity)?;
            finite("objects.angular_velocity", &o.angular_velocity)?;
        }
        Ok(())
    }
}

impl Check for Reference {
    fn check(&self) -> Result<(), ValidationError> {
        finite("position", &self.position)?;
        finite("velocity", &self.velocity)?;
        finite("orientation", &self.orientation)?;
        finite("angular_velocity", &self.angular_velocity)?;
        at_most("limbs", self.limbs, MAX_LIMBS)?;
        finite("planner.rotation.target_rpy", &self.planner.rotation.target_rpy)?;
        unit_or_none("orientation", &self.orientation)?;
        for a in self.planner.axes.iter().chain(&self.planner.rotation.axes) {
            finite(
                "planner",
                &[a.target, a.start, a.start_velocity, a.brake_acceleration, a.brake_time, a.amplitude, a.rate, a.phase],
            )?;
        }
        Ok(())
    }
}

impl Check for ControllerState {
    fn check(&self) -> Result<(), ValidationError> {
        finite("offset", &self.offset)?;
        finite("x_max", &self.x_max)?;
        finite("stiffness", &self.stiffness)?;
        finite("max_force", &self.max_force)?;
        finite("position_bound", &self.position_bound)?;
        finite("force", &self.force)?;
        not_negative("taper", &self.taper)?;
        finite("force_error", &self.force_error)?;
        finite("slow_error", &self.slow_error)?;
        not_negative("free_time", &self.free_time)?;
        finite("x_max_force", &self.x_max_force)?;
        match self.converging.iter().find(|c| **c > 1) {
            Some(&found) => Err(ValidationError::Code { field: "converging", found }),
            None => Ok(()),
        }
    }
}

impl Check for Request {
    fn check(&self) -> Result<(), ValidationError> {
        at_most("joints", self.joints, MAX_JOINTS)?;
        code("controller", self.controller, Process::from_code(self.controller))?;
        finite("error", &self.error)?;
        finite("error_rate", &self.error_rate)?;
        finite("force", &self.force)?;
        finite("torque", &self.torque)?;
        finite("joint_space_torque", &self.joint_space_torque)?;
        at_most("limbs", self.limbs, MAX_LIMBS)?;
        self.state.check()?;
        self.rotation.check()
    }
}

impl Check for RotationRequest {
    fn check(&self) -> Result<(), ValidationError> {
        finite("rotation.error", &self.error)?;
        finite("rotation.error_rate", &self.error_rate)?;
        finite("rotation.moment", &self.moment)?;
        self.state.check()
    }
}

impl Check for Command {
    fn check(&self) -> Result<(), ValidationError> {
        code("mode", self.mode, Mode::from_code(self.mode))?;
        code("source", self.source, Source::from_code(self.source))?;
        code("severity", self.severity, Severity::from_code(self.severity))?;
        at_most("joints", self.joints, MAX_JOINTS)?;
        finite("torque", &self.torque)?;
        at_most("limbs", self.limbs, MAX_LIMBS)?;
        finite("gate.filtered", &self.gate.filtered)?;
        at_most("gate.ramping", self.gate.ramping, 1)?;
        at_most("gate.primary", self.gate.primary, 1)?;
        at_most("gate.opened", self.gate.opened, 1)?;
        self.request.check()
    }
}

impl Check for Parameters {
    fn check(&self) -> Result<(), ValidationError> {
        code("reset_policy", self.reset_policy, ResetPolicy::from_code(self.reset_policy))?;
        code("saturation", self.saturation, Saturation::from_code(self.saturation))?;
        code("search", self.search, Search::from_code(self.search))?;
        at_most("gravity_compensation", self.gravity_compensation, 1)?;
        at_most("offset_anti_windup", self.offset_anti_windup, 1)?;
        at_most("stall_release", self.stall_release, 1)?;
        at_most("force_hold", self.force_hold, 1)?;
        at_most("continuous_reentry", self.continuous_reentry, 1)?;
        finite("target_position", &self.target_position)?;
        finite("desired_force", &self.desired_force)?;
        positive("stiffness", &self.stiffness)?;
        positive("max_force", &self.max_force)?;
        positive("position_bound", &self.position_bound)?;
        positive("taper", &[self.taper])?;
        not_negative("damping", &[self.damping])?;
        not_negative("posture_lead", &[self.posture_lead])?;
        positive("search_scale", &[self.search_scale])?;
        positive("force_resolution", &[self.force_resolution])?;
        positive("mean_speed", &[self.mean_speed])?;
        positive("max_acceleration", &[self.max_acceleration])?;
        code("task", self.task, Task::from_code(self.task))?;
        if self.is_pose() {
            self.rotation.check()?;
        }
        at_most("joints", self.joints, MAX_JOINTS)?;
        self.joint_space.check()
    }
}

impl Check for RotationParameters {
    fn check(&self) -> Result<(), ValidationError> {
        finite("rotation.target_rpy", &self.target_rpy)?;
        finite("rotation.desired_moment", &self.desired_moment)?;
        positive("rotation.stiffness", &self.stiffness)?;
        positive("rotation.max_moment", &self.max_moment)?;
        positive("rotation.bound", &self.bound)?;
        not_negative("rotation.damping", &[self.damping])?;
        positive("rotation.moment_resolution", &[self.moment_resolution])?;
        positive("rotation.mean_speed", &[self.mean_speed])?;
        positive("rotation.max_acceleration", &[self.max_acceleration])
    }
}

impl Check for JointSpaceParameters {
    fn check(&self) -> Result<(), ValidationError> {
        finite("joint_space.posture", &self.posture)?;
        let gains = [self.stiffness, self.damping, self.joint_damping, self.limit_margin, self.limit_stiffness];
        not_negative("joint_space", &gains)
    }
}

impl Check for Operator {
    fn check(&self) -> Result<(), ValidationError> {
        self.current.check()?;
        self.next.check()
    }
}

impl Check for Event {
    fn check(&self) -> Result<(), ValidationError> {
        code("process", self.process, Process::from_code(self.process))?;
        code("kind", self.kind, EventKind::from_code(self.kind))?;
        code("severity", self.severity, Severity::from_code(self.severity))?;
        code("detector", self.detector, Detector::from_code(self.detector))?;
        at_most("text_len", self.text_len, EVENT_TEXT)
    }
}

impl Check for Timing {
    fn check(&self) -> Result<(), ValidationError> {
        code("process", self.process, Process::from_code(self.process))?;
        code("phase", self.phase, Phase::from_code(self.phase))
    }
}

impl Check for Credit {
    fn check(&self) -> Result<(), ValidationError> {
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn check_nan_or_unknown_code_rejected() {
        let valid = State { joints: 3, ..State::default() };
        assert_eq!(valid.check(), Ok(()));
        let mut invalid = valid;
        invalid.foot_force[2] = f64::NAN;
        assert!(matches!(invalid.check(), Err(ValidationError::NotFinite { field: "foot_force", .. })));
        let mut turned = valid;
        turned.foot_orientation = [0.0, 0.0, 0.6, 0.8];
        assert_eq!(turned.check(), Ok(()));
        turned.foot_orientation[3] = 0.9;
        assert!(matches!(turned.check(), Err(ValidationError::Range { field: "foot_orientation", .. })));
        let mut request = Request { controller: Process::Controller.code(), joints: 3, ..Request::default() };
        assert_eq!(request.check(), Ok(()));
        request.state.converging[1] = 7;
        assert_eq!(request.check(), Err(ValidationError::Code { field: "converging", found: 7 }));
    }

    #[test]
    fn check_count_above_capacity_rejected() {
        let state = State { joints: 17, ..State::default() };
        assert_eq!(state.check(), Err(ValidationError::Count { field: "joints", found: 17, expected: 16 }));
        let event =
            Event { text_len: 5000, ..Event::new(0, Process::Plant, EventKind::Note, Severity::Nominal, Detector::None, "") };
        assert!(event.check().is_err());
        assert_eq!(event.text().len(), EVENT_TEXT);
    }

    #[test]
    fn event_long_text_cut_between_characters() {
        let text = "é".repeat(EVENT_TEXT);
        let event = Event::new(3, Process::Planner, EventKind::Note, Severity::Nominal, Detector::None, &text);
        assert_eq!(event.check(), Ok(()));
        assert!(text.starts_with(event.text().as_ref()));
        assert!(event.text().len() >= EVENT_TEXT - 1);
    }

    #[test]
    fn wire_enum_code_and_name_round_trip() {
        for &mode in Mode::ALL {
            assert_eq!(Mode::from_code(mode.code()), Some(mode));
            assert_eq!(Mode::from_name(mode.name()), Some(mode));
        }
        assert_eq!(Mode::from_code(77), None);
    }
}
