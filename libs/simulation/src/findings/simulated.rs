//! Findings of short simulations: gains that oscillate in free air, and walls on which a held force cycles.

use super::{Advisor, Finding, Source, changed, everything, number, vector};
use crate::calibrate::{effective_masses, posture_at};
use crate::stability::{REST_AMPLITUDE_M, StabilityResult, TEST_S, same_loop, settles, settles_within};
use crate::{DeadTime, Simulation, SimulationError, pool};
use hapfic_config::{Diagnostic, Floor, OperatorChange, ParameterSettings, Settings, Surface};
use std::sync::atomic::AtomicBool;

/// Stiffness of the built-in walls [N/m].
pub(crate) const STIFFNESS: [f64; 3] = [1e4, 1e5, 1e6];
/// Damping ratios of the built-in walls.
pub(crate) const DAMPING_RATIO: [f64; 2] = [0.3, 0.1];
/// Least mass with which a wall has its damping ratio [kg]: of the order of a leg seen from its foot.
const MASS_KG: f64 = 0.5;
/// Duration of a press [ticks].
const PRESS_TICKS: usize = 1500;
/// Final part in which the force must be steady [ticks].
const OBSERVED_TICKS: usize = 200;
/// Largest force error in that part, relative to F_d (root mean square).
pub(crate) const STEADY: f64 = 0.03;
/// Earliest tick at which a steady force ends the press.
const EARLIEST_END: usize = 700;
/// Force error that is steady for good: a cycle would have grown from the impact by then.
const QUIET: f64 = 0.003;
/// Most sets of gains that press on the walls; of a longer script the first ones.
const MOST_SETS: usize = 3;

/// A set of a scenario, and the entry that makes it (`None`: the initial set).
struct ScriptSet {
    entry: Option<usize>,
    change: OperatorChange,
    set: ParameterSettings,
}

/// A wall: stiffness [N/m] and damping ratio.
#[derive(Clone, Copy)]
pub(crate) struct Wall {
    pub(crate) stiffness: f64,
    pub(crate) damping_ratio: f64,
}

/// Findings of all sets of a scenario that only a simulation shows, on `jobs` threads.
///
/// Free air: as [`settles`]. Walls: if the world has a floor, each set with F_d.z > 0 within its force profile presses on
/// floors of 1e4 to 1e6 N/m, at damping ratios of 0.3 and 0.1, in the posture of its target. Equal gains press once, with
/// their first F_d, and so do the first three of a longer script. Gains that oscillate in free air, other directions of
/// F_d and objects are not tried.
///
/// # Errors
/// [`SimulationError::Plant`] if the limb cannot be simulated at all.
pub fn simulated(advisor: &Advisor, jobs: usize) -> Result<Vec<Finding>, SimulationError> {
    let sets = script_sets(&advisor.settings);
    let loops = distinct((0..sets.len()).collect(), |a, b| same_loop(&sets[a].set, &sets[b].set));
    let free = in_parallel(loops.len(), jobs, |job| settles(&advisor.settings, &sets[loops[job]].set, DeadTime::default()));
    let mut findings = Vec::new();
    let mut oscillating = Vec::new();
    for (index, result) in loops.into_iter().zip(free) {
        let ScriptSet { entry, change, set } = &sets[index];
        if let Some(finding) = advisor.oscillates(set, change, Source::Script(*entry), &result?, TEST_S) {
            findings.push(finding);
            oscillating.push(*set);
        }
    }
    let calm = |index: &usize| oscillating.iter().all(|set| !same_loop(set, &sets[*index].set));
    let pressing: Vec<usize> = (0..sets.len()).filter(|&index| advisor.presses(&sets[index].set)).filter(calm).collect();
    let mut pressing = distinct(pressing, |a, b| same_press(&sets[a].set, &sets[b].set));
    pressing.truncate(MOST_SETS);
    let walls: Vec<Wall> = STIFFNESS
        .into_iter()
        .flat_map(|stiffness| DAMPING_RATIO.map(|damping_ratio| Wall { stiffness, damping_ratio }))
        .collect();
    let errors = in_parallel(pressing.len() * walls.len(), jobs, |job| {
        advisor.press(&sets[pressing[job / walls.len()]].set, walls[job % walls.len()])
    });
    for (index, errors) in pressing.iter().zip(errors.chunks(walls.len())) {
        let unsteady = walls.iter().zip(errors).filter_map(|(wall, error)| Some((*wall, (*error).filter(|e| *e > STEADY)?)));
        findings.extend(advisor.cycles(&sets[*index], &unsteady.collect::<Vec<_>>()));
    }
    Ok(findings)
}

/// First indices of all that are not the same.
fn distinct(indices: Vec<usize>, same: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    indices.into_iter().fold(Vec::new(), |mut kept, index| {
        if kept.iter().all(|&known| !same(known, index)) {
            kept.push(index);
        }
        kept
    })
}

/// Results of `count` jobs in their order; on this thread if no other can be started.
fn in_parallel<T: Send>(count: usize, jobs: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut results = Vec::with_capacity(count);
    let keep = |_, result| {
        results.push(result);
        Ok(())
    };
    match pool::in_order(count, jobs.max(1), &AtomicBool::new(false), |job| Some(work(job)), keep) {
        Ok(_) => results,
        Err(_) => (0..count).map(work).collect(),
    }
}

/// Seconds of free air for a change of a running stack: enough for the gains of a usual robot.
const CHANGE_S: u32 = 1;

/// Result of trying a change of gains in free air.
#[derive(Clone, Debug, PartialEq)]
pub enum FreeAir {
    /// The limb comes to rest, or the change concerns no gain.
    Settles,
    /// It does not.
    Oscillates(Finding),
    /// `proceed` has ended the simulation before its end.
    Unknown,
}

impl Advisor {
    /// Tries a change of gains in free air, for a shorter time than [`simulated`] does, as long as `proceed` returns true.
    ///
    /// # Errors
    /// [`SimulationError::Plant`] if the limb cannot be simulated at all.
    pub fn free_air(
        &self,
        before: &ParameterSettings,
        set: &ParameterSettings,
        change: &OperatorChange,
        source: Source<'_>,
        proceed: &dyn Fn() -> bool,
    ) -> Result<FreeAir, SimulationError> {
        if same_loop(before, set) {
            return Ok(FreeAir::Settles);
        }
        let Some(result) = settles_within(&self.settings, set, DeadTime::default(), CHANGE_S, proceed)? else {
            return Ok(FreeAir::Unknown);
        };
        Ok(self.oscillates(set, change, source, &result, CHANGE_S).map_or(FreeAir::Settles, FreeAir::Oscillates))
    }
}

impl Advisor {
    /// Finding of a set that does not come to rest in free air.
    fn oscillates(
        &self,
        set: &ParameterSettings,
        change: &OperatorChange,
        source: Source<'_>,
        result: &StabilityResult,
        seconds: u32,
    ) -> Option<Finding> {
        if result.settles {
            return None;
        }
        let name = changed(change, &["stiffness", "max_force", "position_bound"]).unwrap_or("stiffness");
        let (place, key) = self.place(source, name);
        let motion = if result.amplitude_m.is_finite() {
            format!("oscillates ({:.2} mm at the end of {seconds} s)", result.amplitude_m * 1e3)
        } else {
            "diverges".to_owned()
        };
        let rotation =
            set.rotation.map_or_else(String::new, |r| format!(", rotation_stiffness {} N m/rad", vector(r.rotation_stiffness)));
        let found = format!(
            "stiffness {} N/m{rotation}, max_force {} N and position_bound {} m, with which the limb, held in free air at the \
             start posture, {motion}",
            vector(set.stiffness),
            vector(set.max_force),
            vector(set.position_bound)
        );
        let help = if result.amplitude_m <= REST_AMPLITUDE_M {
            "the joints move and leave the tip where it is: raise controller.posture_damping"
        } else if result.within_bound {
            "lower the stiffness, raise controller.damping, or see `hapfic calibrate`"
        } else {
            "it sinks out of its bound: max_force does not carry it"
        };
        let expected = "gains with which it comes to rest".to_owned();
        Some(Finding::new(Diagnostic { place, key, found, expected, help: help.to_owned() }, true))
    }

    /// Finding of a set that cycles on walls, each with its force error; `None` without such walls.
    fn cycles(&self, set: &ScriptSet, walls: &[(Wall, f64)]) -> Option<Finding> {
        if walls.is_empty() {
            return None;
        }
        let name = changed(&set.change, &["desired_force", "stiffness", "max_force", "position_bound"]);
        let (place, key) = self.place(Source::Script(set.entry), name.unwrap_or("desired_force"));
        let of_stiffness = |stiffness: f64| {
            let errors = walls.iter().filter(|(wall, _)| wall.stiffness == stiffness).map(|(wall, error)| {
                let percent = (100.0 * error).min(999.0).round();
                format!("{} % at damping ratio {}", number(percent), number(wall.damping_ratio))
            });
            let errors: Vec<String> = errors.collect();
            (!errors.is_empty()).then(|| format!("{stiffness:e} N/m ({})", errors.join(", ")))
        };
        let list: Vec<String> = STIFFNESS.into_iter().filter_map(of_stiffness).collect();
        let desired = number(set.set.desired_force[2]);
        let found = format!("F_d = {desired} N on z, whose error stays large on test walls of {}", list.join(", "));
        let expected = format!("at most {} % of F_d on walls of 1e4 to 1e6 N/m", number(100.0 * STEADY));
        let help = "the search cycles on such a wall, which need not be the scenario's: lower taper, or add joint damping";
        Some(Finding::new(Diagnostic { place, key, found, expected, help: help.to_owned() }, false))
    }

    /// Whether a set presses on a floor, with a force that its law reaches.
    fn presses(&self, set: &ParameterSettings) -> bool {
        let desired = set.desired_force[2];
        let linear = 0.95 * set.stiffness[2] * set.position_bound[2];
        self.settings.world.floor.is_some() && desired > 0.0 && desired <= linear.min(set.max_force[2])
    }

    /// Presses on a wall; returns the force error at the end relative to F_d (root mean square).
    ///
    /// The wall is a floor just below the foot, in the posture of the target. `None` if the robot cannot start there.
    pub(crate) fn press(&self, set: &ParameterSettings, wall: Wall) -> Option<f64> {
        let mut pressing = self.settings.clone();
        let q = posture_at(&self.chain, set, &self.start.q);
        let kin = self.chain.kinematics(&q);
        let tip = kin.tip_position();
        let shapes = self.chain.collisions().iter().filter(|shape| shape.body.is_some() && shape.link == self.chain.tip_link());
        let lowest = shapes
            .flat_map(|shape| shape.spheres(&self.chain.collision_pose(&kin, shape)))
            .map(|(center, radius)| center.z - radius)
            .reduce(f64::min)?;
        let mass = effective_masses(&self.chain, &q).map_or(MASS_KG, |masses| masses.axes_kg[2].max(MASS_KG));
        let floor = pressing.world.floor.as_mut()?;
        floor.height_m = lowest;
        floor.tip_only = true;
        floor.surface.stiffness_n_per_m = wall.stiffness;
        floor.surface.damping_n_s_per_m = 2.0 * wall.damping_ratio * (wall.stiffness * mass).sqrt();
        pressing.world.objects.clear();
        pressing.operator.clear();
        pressing.robot.start_position = q[..self.chain.dof()].to_vec();
        let desired = set.desired_force[2];
        // Half of the force without a search: the search does the rest.
        let depth = (0.5 * desired / set.stiffness[2]).min(0.5 * set.position_bound[2]);
        let target_position = Some([tip.x, tip.y, tip.z - depth]);
        let mut rotation = set.rotation;
        if let Some(rotation) = &mut rotation {
            // That of the posture in which it starts.
            rotation.target_orientation = None;
        }
        pressing.initial = ParameterSettings { target_position, desired_force: [0.0, 0.0, desired], rotation, ..*set };
        let mut simulation = Simulation::new(&pressing).ok()?;
        let mut squares = 0.0;
        for tick in 1..=PRESS_TICKS {
            let Ok(snapshot) = simulation.step() else { return Some(f64::INFINITY) };
            squares += (snapshot.state.foot_force[2] - desired).powi(2);
            if (PRESS_TICKS - tick).is_multiple_of(OBSERVED_TICKS) {
                let error = (squares / OBSERVED_TICKS as f64).sqrt() / desired;
                if tick == PRESS_TICKS || (tick >= EARLIEST_END && error < QUIET) {
                    return Some(error);
                }
                squares = 0.0;
            }
        }
        None
    }
}

/// A floor for a press in a world that has none.
pub(crate) fn any_floor() -> Floor {
    let surface = Surface {
        stiffness_n_per_m: STIFFNESS[0],
        damping_n_s_per_m: 0.0,
        transition_width_m: 1e-3,
        friction_static: 0.0,
        friction_dynamic: 0.0,
        critical_speed_m_per_s: 1e-3,
    };
    Floor { height_m: 0.0, tip_only: true, surface }
}

/// All sets of a scenario that come into force.
fn script_sets(settings: &Settings) -> Vec<ScriptSet> {
    let mut set = settings.initial;
    let mut sets = vec![ScriptSet { entry: None, change: everything(&set), set }];
    for (index, change) in settings.operator.iter().enumerate() {
        if change.at_tick < settings.duration_ticks as i64 {
            set = set.with(change);
            sets.push(ScriptSet { entry: Some(index), change: *change, set });
        }
    }
    sets
}

/// Whether two sets press with the same gains. The target and F_d do not count.
fn same_press(a: &ParameterSettings, b: &ParameterSettings) -> bool {
    let gains = |p: &ParameterSettings| ParameterSettings {
        target_position: None,
        desired_force: [0.0; 3],
        mean_speed: 1.0,
        max_acceleration: 1.0,
        ..*p
    };
    gains(a) == gains(b)
}
