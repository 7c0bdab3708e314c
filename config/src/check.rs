//! Conditions between several values, and the conversion of a raw scenario into [`Settings`].

mod fault;
mod foot;
mod task;
mod world;

use crate::error::{ConfigError, Diagnostic};
use crate::fault::Fault;
use crate::parameters::{OperatorChange, ParameterSettings};
use crate::places::Places;
use crate::policy::{Fidelity, ResetPolicy, Saturation, Search};
use crate::raw::{PerJoint, RawController, RawFault, RawOperator, RawProcesses, RawRealtime, RawRecorder, RawRobot, RawScenario};
use crate::settings::{
    ExternalProcesses, MAX_JOINTS, MIN_SPACING_TICKS, PlantSettings, RealtimeSettings, RecorderSettings, RobotSettings, Settings,
    SupervisorSettings, Urdf,
};
use crate::tree::{Node, describe_number};
use task::{ARM_JOINTS, rotation};

/// Rate of the control loop [1/s].
const TICKS_PER_S: f64 = 1000.0;
/// Default of `controller.damping_sqrt_kg`: a damping ratio of 0.35 at an effective mass of 0.5 kg.
const DAMPING_SQRT_KG: f64 = 0.5;
/// Default of `controller.posture_lead_s`: the dead time of one tick and half of the tick in which the torque acts.
const POSTURE_LEAD_S: f64 = 1.5e-3;
/// Longest target vector [m].
const TARGET_MAX_M: f64 = 100.0;
/// Longest desired force [N].
const DESIRED_FORCE_MAX_N: f64 = 1e4;
/// Largest desired moment [N m].
const DESIRED_MOMENT_MAX_N_M: f64 = 1e3;

/// Checks the conditions between the values of a scenario whose numbers are in their ranges.
pub(crate) fn settings(mut raw: RawScenario, tree: &Node, urdf: Urdf) -> Result<Settings, ConfigError> {
    let at = ScenarioCheck { tree };
    let policies = at.policies(&mut raw.controller)?;
    let duration_ticks = ticks(raw.duration_s);
    let joints = at.joints(&raw.robot)?;
    let mut operator = at.timeline(&raw.operator)?;
    at.rotation_keys(&raw, &operator)?;
    let gravity_compensation = *raw.controller.gravity_compensation.get_or_insert(joints > ARM_JOINTS);
    let mut initial = ParameterSettings {
        target_position: None,
        desired_force: [0.0; 3],
        stiffness: raw.controller.stiffness_n_per_m,
        max_force: raw.controller.max_force_n,
        position_bound: raw.controller.position_bound_m,
        reset_policy: policies.reset_policy,
        saturation: policies.saturation,
        search: policies.search,
        taper: raw.controller.taper,
        search_scale: raw.controller.search_scale,
        force_resolution: raw.controller.force_resolution_n,
        gravity_compensation,
        offset_anti_windup: policies.offset_anti_windup,
        stall_release: policies.stall_release,
        force_hold: policies.force_hold,
        continuous_reentry: policies.continuous_reentry,
        damping: policies.damping,
        posture_lead: policies.posture_lead,
        mean_speed: raw.planner.mean_speed_m_per_s,
        max_acceleration: raw.planner.max_acceleration_m_per_s2,
        rotation: rotation(&mut raw.controller, &mut raw.planner),
        joint_space: at.joint_space(&mut raw.controller, &raw.robot.start_position_rad)?,
    };
    let starts = operator.first().is_some_and(|change| change.at_tick == 0);
    if starts {
        initial = initial.with(&operator.remove(0));
    }
    let effective = toml::to_string(&raw).map_err(|error| {
        ConfigError::Combination(at.diagnostic("", &error.to_string(), "settings that TOML can hold", "report this"))
    })?;
    Ok(Settings {
        title: raw.title,
        description: raw.description,
        duration_ticks: duration_ticks.unsigned_abs(),
        seed: raw.seed,
        robot: RobotSettings {
            joint_damping: raw.robot.joint_damping_n_m_s_per_rad.map(|value| value.values(joints)),
            effort_limit: raw.robot.effort_limit_n_m.map(|value| value.values(joints)),
            velocity_limit: raw.robot.velocity_limit_rad_per_s.map(|value| value.values(joints)),
            joint_friction: raw.robot.joint_friction_n_m.map(|value| value.values(joints)),
            armature: raw.robot.armature_kg_m2.map(|value| value.values(joints)),
            foot: raw.robot.foot.as_ref().map(|foot| at.foot(foot)).transpose()?,
            urdf,
            base_link: raw.robot.base_link,
            tip_link: raw.robot.tip_link,
            base_position_m: raw.robot.base_position_m,
            base_orientation_rpy_rad: raw.robot.base_orientation_rpy_rad,
            start_position: raw.robot.start_position_rad,
        },
        world: at.world(raw.world)?,
        plant: PlantSettings {
            contact_substep_us: raw.plant.contact_substep_us,
            flight_substep_us: raw.plant.flight_substep_us,
            engine: at.engine(&raw.plant)?,
            command_timeout_ticks: raw.plant.command_timeout_ticks,
            force_noise: raw.plant.force_noise_n,
            brake_damping_n_m_s_per_rad: raw.plant.brake_damping_n_m_s_per_rad,
            on_loss: raw.plant.on_loss,
        },
        fidelity: raw.controller.fidelity,
        initial,
        operator,
        faults: at.faults(&raw.faults, duration_ticks, raw.seed)?,
        supervisor: SupervisorSettings {
            deadline_us: raw.supervisor.deadline_us,
            torque_bandwidth_hz: raw.supervisor.torque_bandwidth_hz,
            torque_peak: at.torque_peak(raw.supervisor.torque_peak_n_m, joints)?,
            torque_saturation: raw.supervisor.torque_saturation,
            torque_rate: raw.supervisor.torque_rate_n_m_per_s,
            ready_timeout_ms: raw.supervisor.ready_timeout_ms,
            heartbeat_timeout_ms: raw.supervisor.heartbeat_timeout_ms,
            grace_ms: raw.supervisor.grace_ms,
            stall_timeout_ms: raw.supervisor.stall_timeout_ms,
            tick_timeout_ms: raw.supervisor.tick_timeout_ms,
            standby: raw.supervisor.standby,
            restart_budget: raw.supervisor.restart_budget,
            restart_window_ms: raw.supervisor.restart_window_ms,
            restart_backoff_ms: raw.supervisor.restart_backoff_ms,
            ramp_rate: raw.supervisor.ramp_rate_n_m_per_s,
            discontinuity: raw.supervisor.discontinuity_n_m,
            credit_ticks: raw.supervisor.credit_ticks,
        },
        realtime: at.realtime(&raw.realtime)?,
        recorder: at.recorder(&raw.recorder)?,
        processes: at.processes(raw.processes)?,
        effective,
        places: Places::new(tree, usize::from(starts)),
    })
}

/// Checks the operator's entries of a tree that holds only them.
pub(crate) fn changes(raw: &[RawOperator], tree: &Node) -> Result<Vec<OperatorChange>, ConfigError> {
    ScenarioCheck { tree }.timeline(raw)
}

/// Checks the fault of a tree that holds only it; the fault gets tick 0.
pub(crate) fn injected(raw: &RawFault, tree: &Node) -> Result<Fault, ConfigError> {
    Ok(ScenarioCheck { tree }.effect("fault[0]", raw)?.fault)
}

/// Nearest tick to a time [s] within its range.
fn ticks(seconds: f64) -> i64 {
    (seconds * TICKS_PER_S).round() as i64
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Policies that `fidelity` selects, or the keys that replace them.
struct SelectedPolicies {
    search: Search,
    reset_policy: ResetPolicy,
    saturation: Saturation,
    offset_anti_windup: bool,
    stall_release: bool,
    force_hold: bool,
    continuous_reentry: bool,
    damping: f64,
    posture_lead: f64,
}

/// The checks, with the tree that knows the place of each value.
struct ScenarioCheck<'a> {
    tree: &'a Node,
}

impl ScenarioCheck<'_> {
    fn diagnostic(&self, key: &str, found: &str, expected: &str, help: &str) -> Box<Diagnostic> {
        Box::new(Diagnostic {
            place: self.tree.place(key),
            key: key.to_owned(),
            found: found.to_owned(),
            expected: expected.to_owned(),
            help: help.to_owned(),
        })
    }

    fn found(&self, key: &str) -> String {
        self.tree.get(key).map_or_else(|| "nothing".to_owned(), Node::describe)
    }

    /// Returns the active policies, and writes them into the raw section unless `fidelity` selects them.
    fn policies(&self, raw: &mut RawController) -> Result<SelectedPolicies, ConfigError> {
        const FIDELITY: &str = "controller.fidelity";
        if raw.fidelity == Fidelity::Hapfic {
            return Ok(SelectedPolicies {
                search: *raw.search.get_or_insert_default(),
                reset_policy: *raw.reset_policy.get_or_insert_default(),
                saturation: *raw.saturation.get_or_insert_default(),
                offset_anti_windup: *raw.offset_anti_windup.get_or_insert(true),
                stall_release: *raw.stall_release.get_or_insert(true),
                force_hold: *raw.force_hold.get_or_insert(true),
                continuous_reentry: *raw.continuous_reentry.get_or_insert(true),
                damping: *raw.damping_sqrt_kg.get_or_insert(DAMPING_SQRT_KG),
                posture_lead: *raw.posture_lead_s.get_or_insert(POSTURE_LEAD_S),
            });
        }
        let given = [
            ("controller.search", raw.search.is_some()),
            ("controller.reset_policy", raw.reset_policy.is_some()),
            ("controller.saturation", raw.saturation.is_some()),
            ("controller.offset_anti_windup", raw.offset_anti_windup.is_some()),
            ("controller.stall_release", raw.stall_release.is_some()),
            ("controller.force_hold", raw.force_hold.is_some()),
            ("controller.continuous_reentry", raw.continuous_reentry.is_some()),
            ("controller.damping_sqrt_kg", raw.damping_sqrt_kg.is_some()),
            ("controller.posture_lead_s", raw.posture_lead_s.is_some()),
        ];
        if let Some((key, _)) = given.into_iter().find(|(_, given)| *given) {
            let found = format!(
                "{} beside {FIDELITY} = \"paper\" ({}), which already decides it",
                self.found(key),
                self.tree.place(FIDELITY)
            );
            let help = format!("remove {key}, or remove {FIDELITY} and set each policy");
            return Err(ConfigError::Combination(self.diagnostic(key, &found, "one of the two", &help)));
        }
        Ok(SelectedPolicies {
            search: Search::Sign,
            reset_policy: ResetPolicy::AsPrinted,
            saturation: Saturation::AsPrinted,
            offset_anti_windup: false,
            stall_release: false,
            force_hold: false,
            continuous_reentry: false,
            damping: 0.0,
            posture_lead: 0.0,
        })
    }

    fn short_enough(&self, key: &str, v: [f64; 3], longest: f64) -> Result<(), ConfigError> {
        if length(v) <= longest {
            return Ok(());
        }
        let found = format!("{}, of length {}", self.found(key), describe_number(length(v)));
        let expected = format!("a vector no longer than {}", describe_number(longest));
        Err(ConfigError::OutOfRange(self.diagnostic(key, &found, &expected, "the length of the whole vector counts")))
    }

    /// Checks the names of the links, and returns the number of joints.
    fn joints(&self, raw: &RawRobot) -> Result<usize, ConfigError> {
        let names = [("robot.urdf", &raw.urdf), ("robot.base_link", &raw.base_link), ("robot.tip_link", &raw.tip_link)];
        if let Some((key, _)) = names.iter().find(|(_, name)| name.trim().is_empty()) {
            let help = "link names are those of the robot description";
            return Err(ConfigError::WrongType(self.diagnostic(key, "empty text", "a name", help)));
        }
        if raw.base_link == raw.tip_link {
            let expected = "another link than robot.base_link";
            let found = self.found("robot.tip_link");
            let help = "the robot is the chain of joints between the two";
            return Err(ConfigError::Combination(self.diagnostic("robot.tip_link", &found, expected, help)));
        }
        let count = raw.start_position_rad.len();
        if (1..=MAX_JOINTS).contains(&count) {
            return Ok(count);
        }
        let key = "robot.start_position_rad";
        let expected = format!("a list of 1 to {MAX_JOINTS} numbers");
        let help = "one number for each joint between base_link and tip_link";
        Err(ConfigError::WrongLength(self.diagnostic(key, &format!("a list of {count}"), &expected, help)))
    }

    /// Only this list is compared with the start posture here: the robot model, which knows the number of joints, compares
    /// the posture and the lists of `robot` with it.
    fn torque_peak(&self, value: Option<PerJoint>, joints: usize) -> Result<Option<Vec<f64>>, ConfigError> {
        const KEY: &str = "supervisor.torque_peak_n_m";
        const POSTURE: &str = "robot.start_position_rad";
        let Some(value) = value else { return Ok(None) };
        let numbers = value.expand(joints).ok_or_else(|| self.no_table(KEY))?;
        if numbers.len() == joints {
            return Ok(Some(numbers));
        }
        let found = format!("a list of {}", numbers.len());
        let expected = format!("a number for all joints, or a list of {joints}, as {POSTURE} ({}) has", self.tree.place(POSTURE));
        let help = "correct the list that has another length than the robot has joints";
        Err(ConfigError::WrongLength(self.diagnostic(KEY, &found, &expected, help)))
    }

    /// Error of a table by joint name where only a number or a list has a meaning.
    fn no_table(&self, key: &str) -> ConfigError {
        let expected = "a number for all joints, or a list with one for each";
        ConfigError::WrongType(self.diagnostic(key, &self.found(key), expected, "write the numbers in the order of the joints"))
    }

    fn realtime(&self, raw: &RawRealtime) -> Result<RealtimeSettings, ConfigError> {
        let order = [
            ("realtime.priority_plant", raw.priority_plant),
            ("realtime.priority_gate", raw.priority_gate),
            ("realtime.priority_controller", raw.priority_controller),
            ("realtime.priority_planner", raw.priority_planner),
        ];
        for pair in order.windows(2) {
            let ((above, higher), (below, lower)) = (pair[0], pair[1]);
            if lower >= higher {
                // The message names the key that the scenario gives; it may give both.
                let (key, found, expected) = if self.tree.get(below).is_some() {
                    (below, lower, format!("less than {above} = {higher}"))
                } else {
                    (above, higher, format!("more than {below} = {lower}"))
                };
                let help = "priorities must fall in the order plant, gate, controller, planner";
                return Err(ConfigError::Combination(self.diagnostic(key, &found.to_string(), &expected, help)));
            }
        }
        Ok(RealtimeSettings {
            priority_plant: raw.priority_plant,
            priority_gate: raw.priority_gate,
            priority_controller: raw.priority_controller,
            priority_planner: raw.priority_planner,
            placement: raw.placement,
            busy_poll_lead_us: raw.busy_poll_lead_us,
            core_plant: raw.core_plant,
            core_gate: raw.core_gate,
            core_controller: raw.core_controller,
            core_standby: raw.core_standby,
            core_planner: raw.core_planner,
        })
    }

    fn recorder(&self, raw: &RawRecorder) -> Result<RecorderSettings, ConfigError> {
        if let Some(keep) = raw.keep_mb
            && raw.part_mb.is_none_or(|part| u64::from(keep) < 4 * u64::from(part))
        {
            let expected = match raw.part_mb {
                Some(part) => format!("at least {} MB, four times recorder.part_mb", 4 * u64::from(part)),
                None => "recorder.part_mb beside it".to_owned(),
            };
            let help = "whole parts are removed, and the first and the present one stay";
            return Err(ConfigError::Combination(self.diagnostic("recorder.keep_mb", &format!("{keep} MB"), &expected, help)));
        }
        Ok(RecorderSettings {
            flush_ms: raw.flush_ms,
            viewer_rate_hz: raw.viewer_rate_hz,
            chunk_kib: raw.chunk_kib,
            part_mb: raw.part_mb,
            keep_mb: raw.keep_mb,
            min_free_mb: raw.min_free_mb,
            on_failure: raw.on_failure,
        })
    }

    fn processes(&self, raw: RawProcesses) -> Result<ExternalProcesses, ConfigError> {
        let commands =
            [("processes.plant", &raw.plant), ("processes.planner", &raw.planner), ("processes.controller", &raw.controller)];
        for (key, command) in commands {
            let Some(command) = command else { continue };
            if command.first().is_none_or(|program| program.trim().is_empty()) {
                let help = "remove the key to use the built-in process";
                let expected = "a program and its arguments, each a string of its own";
                return Err(ConfigError::WrongLength(self.diagnostic(key, &self.found(key), expected, help)));
            }
        }
        Ok(ExternalProcesses { plant: raw.plant, planner: raw.planner, controller: raw.controller })
    }

    fn timeline(&self, raw: &[RawOperator]) -> Result<Vec<OperatorChange>, ConfigError> {
        let mut changes: Vec<OperatorChange> = Vec::with_capacity(raw.len());
        for (index, entry) in raw.iter().enumerate() {
            let path = format!("operator[{index}]");
            let change = change(entry);
            self.moment(&format!("{path}.at_s"), change.at_tick, changes.last())?;
            if change == (OperatorChange { at_tick: change.at_tick, ..OperatorChange::default() }) {
                let help = "name what changes at that time, or remove the entry";
                let expected = "at least one change beside at_s";
                return Err(ConfigError::Combination(self.diagnostic(&path, "an entry that changes nothing", expected, help)));
            }
            if let Some(target) = change.target_position {
                self.short_enough(&format!("{path}.target_position_m"), target, TARGET_MAX_M)?;
            }
            if let Some(force) = change.desired_force {
                self.short_enough(&format!("{path}.desired_force_n"), force, DESIRED_FORCE_MAX_N)?;
            }
            if let Some(moment) = change.desired_moment {
                self.short_enough(&format!("{path}.desired_moment_n_m"), moment, DESIRED_MOMENT_MAX_N_M)?;
            }
            changes.push(change);
        }
        Ok(changes)
    }

    fn moment(&self, key: &str, at_tick: i64, before: Option<&OperatorChange>) -> Result<(), ConfigError> {
        let seconds = |ticks: i64| describe_number(ticks as f64 / TICKS_PER_S);
        let found = self.found(key);
        let Some(before) = before else { return Ok(()) };
        let earliest = before.at_tick + MIN_SPACING_TICKS;
        if at_tick >= earliest {
            return Ok(());
        }
        let expected = format!("at least {}, 5 ms after the entry before", seconds(earliest));
        let help = "order the entries by time; changes of the same time belong into one entry";
        Err(ConfigError::Combination(self.diagnostic(key, &found, &expected, help)))
    }
}

fn change(raw: &RawOperator) -> OperatorChange {
    OperatorChange {
        at_tick: ticks(raw.at_s),
        target_position: raw.target_position_m,
        desired_force: raw.desired_force_n,
        stiffness: raw.stiffness_n_per_m,
        max_force: raw.max_force_n,
        position_bound: raw.position_bound_m,
        reset_policy: raw.reset_policy,
        saturation: raw.saturation,
        search: raw.search,
        taper: raw.taper,
        search_scale: raw.search_scale,
        force_resolution: raw.force_resolution_n,
        gravity_compensation: raw.gravity_compensation,
        offset_anti_windup: raw.offset_anti_windup,
        stall_release: raw.stall_release,
        force_hold: raw.force_hold,
        continuous_reentry: raw.continuous_reentry,
        damping: raw.damping_sqrt_kg,
        posture_lead: raw.posture_lead_s,
        mean_speed: raw.mean_speed_m_per_s,
        max_acceleration: raw.max_acceleration_m_per_s2,
        target_orientation: raw.target_orientation_rpy_rad,
        desired_moment: raw.desired_moment_n_m,
        rotation_stiffness: raw.rotation_stiffness_n_m_per_rad,
        max_moment: raw.max_moment_n_m,
        rotation_bound: raw.rotation_bound_rad,
        rotation_damping: raw.rotation_damping_sqrt_kg_m,
        moment_resolution: raw.moment_resolution_n_m,
        mean_turn_speed: raw.mean_turn_speed_rad_per_s,
        max_turn_acceleration: raw.max_turn_acceleration_rad_per_s2,
    }
}
