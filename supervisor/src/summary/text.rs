//! The summary as text for a terminal.

use super::{SUPERVISOR_DELAY_MS, Summary};
use hapfic_log::metrics::{PairSummary, Quantiles};
use std::fmt::Write;

impl Summary {
    /// Formats the summary for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        let end = if self.completed { "completed" } else { "NOT COMPLETED" };
        if self.ticks.last.is_none() {
            let ticks = if self.launch_s > 0.0 { "no tick was recorded" } else { "no tick was done" };
            writeln!(out, "{} ({}): {end}, {ticks}; log: {}", self.scenario, self.clock, self.log.display())?;
            return self.write_faults(out);
        }
        writeln!(
            out,
            "{} ({}): {end}, {:.3} s simulated in {:.2} s ({:.1} x), first tick {:.0} ms after the start",
            self.scenario,
            self.clock,
            self.duration_s,
            self.wall_s,
            self.speed,
            self.launch_s * 1e3
        )?;
        writeln!(out, "                        x          y          z")?;
        let row = |out: &mut String, name: &str, values: [String; 3]| {
            writeln!(out, "  {name:<13}{:>11}{:>11}{:>11}", values[0], values[1], values[2])
        };
        let t = &self.tracking;
        row(out, "|x - x_d| max", t.max_m.map(|v| format!("{:.3} mm", v * 1e3)))?;
        row(out, "          rms", t.rms_m.map(|v| format!("{:.3} mm", v * 1e3)))?;
        row(out, "bound x_b", t.bound_m.map(|v| format!("{:.1} mm", v * 1e3)))?;
        if let Some(orientation) = &t.orientation {
            let [most, rms, last] = [orientation.max_rad, orientation.rms_rad, orientation.last_rad].map(f64::to_degrees);
            writeln!(out, "  |e_R|         at most {most:.3}, rms {rms:.3}, at the end {last:.4} degrees")?;
        }
        let c = &self.force_command;
        row(out, "|F_c| max", c.max_n.map(|v| format!("{v:.1} N")))?;
        row(out, "limit F_max", c.limit_n.map(|v| format!("{v:.0} N")))?;
        let f = &self.force;
        let some = |v: Option<f64>, unit: &str| v.map_or("-".to_owned(), |v| format!("{v:.3} {unit}"));
        row(out, "F_d (last)", f.desired_n.map(|v| v.map_or("-".to_owned(), |v| format!("{v:.0} N"))))?;
        let settled = std::array::from_fn(|axis| match f.settled_rms_n[axis] {
            None if f.not_reached[axis] > 0 => "not reached".to_owned(),
            rms => some(rms, "N"),
        });
        row(out, "settled rms", settled)?;
        row(out, "  of F_d", f.settled_rms_percent.map(|v| some(v, "%")))?;
        row(out, "sliding rms", f.sliding_rms_percent.map(|v| some(v, "%")))?;
        if f.not_reached.iter().any(|segments| *segments > 0) {
            row(out, "F_d missed by", f.not_reached_error_n.map(|v| some(v, "N")))?;
        }
        self.write_scene(out)?;
        let timing = &self.timing;
        let quantiles = |q: &Option<Quantiles>| {
            q.map_or("none in lockstep".to_owned(), |q| {
                format!("p50 {:.0}  p99 {:.0}  p99.9 {:.0}  max {:.0} us", q.p50, q.p99, q.p999, q.max)
            })
        };
        writeln!(out, "  state -> command   {}", quantiles(&timing.latency_us))?;
        writeln!(out, "  timer lateness     {}  (reference timer)", quantiles(&timing.wake_lateness_us))?;
        writeln!(
            out,
            "  ticks              {} late, {} missed, {} braked; {} ms steal time; {} allocations in real-time code",
            timing.late_ticks, timing.missed_ticks, timing.brake_ticks, timing.steal_ms, timing.allocations
        )?;
        if timing.spare_gate_ticks > 0 {
            writeln!(out, "  gate               {} ticks by the spare gate", timing.spare_gate_ticks)?;
        }
        writeln!(
            out,
            "  log                {} messages, {:.1} MB{}, {} ticks lost: {}",
            self.recorder.messages,
            self.recorder.file_bytes as f64 / 1e6,
            match (self.recorder.parts, self.recorder.removed_parts) {
                (1, _) => String::new(),
                (parts, 0) => format!(" in {parts} parts"),
                (parts, removed) => format!(" in {parts} parts, {removed} of them removed"),
            },
            self.recorder.lost,
            self.log.display()
        )?;
        self.write_faults(out)
    }

    /// Writes the events of the scene, if there are any.
    fn write_scene(&self, out: &mut String) -> std::fmt::Result {
        let outside = &self.tracking.outside;
        for (axis, name) in ["x", "y", "z"].iter().enumerate().filter(|&(axis, _)| outside.ticks[axis] > 0) {
            let seconds = |ticks: [u64; 3]| ticks[axis] as f64 * hapfic_config::PERIOD_S;
            let causes = [
                (outside.force_limited_ticks, "with F_c at F_max"),
                (outside.torque_limited_ticks, "with the torque cut"),
                (outside.force_held_ticks, "holding a force"),
                (outside.converging_ticks, "converging"),
                (outside.inactive_ticks, "without command"),
                (outside.unexplained_ticks, "unexplained"),
            ];
            let named = causes.into_iter().filter(|(ticks, _)| ticks[axis] > 0);
            let named: Vec<_> = named.map(|(ticks, what)| format!("{:.3} s {what}", seconds(ticks))).collect();
            writeln!(out, "  outside x_b        {name} {:.3} s: {}", seconds(outside.ticks), named.join(", "))?;
        }
        for object in self.moments.objects.iter() {
            write!(out, "  {:<18} rotated {:.1} deg", object.name, object.max_turn_deg)?;
            write!(out, "{}", if object.tipped_at_rest { ", at rest on another face" } else { "" })?;
            write!(out, ", moved {:.0} mm", object.max_displacement_m * 1e3)?;
            // A foot in contact counts as free only below the force threshold.
            let struck = |pair: &&PairSummary| pair.against == object.name && 2 * pair.foot_free_ticks > pair.ticks;
            for pair in self.moments.contacts.iter().filter(struck) {
                write!(out, "; {} on it {} ticks with the foot free", pair.body, pair.foot_free_ticks)?;
            }
            writeln!(out)?;
        }
        for task in &self.tasks {
            let (place, times) =
                (if task.place.is_empty() { "" } else { " on " }, if task.times == 1 { "once" } else { "times" });
            let times = if task.times == 1 { times.to_owned() } else { format!("{} {times}", task.times) };
            let held = if task.since_tick.is_some() { ", and at the end" } else { "" };
            writeln!(
                out,
                "  task               {}{place}{} {times}, {:.3} s{held}: {}",
                task.condition, task.place, task.total_s, task.found
            )?;
        }
        let i = &self.integration;
        if let (true, Some(newton)) = (i.contact_ticks > 0, i.newton_per_contact_substep) {
            writeln!(
                out,
                "  physics            {newton:.2} Newton iterations a sub-step, {} unconverged, {:.3} mJ created by contacts",
                i.unconverged,
                i.contact_energy_created_j * 1e3
            )?;
            writeln!(
                out,
                "  energy             balance off by {:.3} mJ of {:.3} J, {} sub-steps cut",
                i.energy_error_j * 1e3,
                i.energy_range_j,
                i.cut
            )?;
        }
        if i.passages > 0 {
            writeln!(out, "  PASSAGES           {}: a body went through another one", i.passages)?;
        }
        Ok(())
    }

    fn write_faults(&self, out: &mut String) -> std::fmt::Result {
        let losses = &self.losses;
        if losses.injected > 0 {
            writeln!(out, "  injected faults    {}", losses.injected)?;
        }
        if self.timing.discontinuities > 0 {
            let (count, above) = (self.timing.discontinuities, self.timing.discontinuity_n_m);
            let steps = if count == 1 { "step" } else { "steps" };
            writeln!(out, "  torque             {count} {steps} above {above} N m, in the events of the log")?;
        }
        if self.timing.supervisor_delay_ms > SUPERVISOR_DELAY_MS {
            writeln!(out, "  supervisor         was itself delayed by up to {:.0} ms", self.timing.supervisor_delay_ms)?;
        }
        if let Some(problem) = &self.recorder.problem {
            writeln!(out, "  log                {problem}")?;
        }
        for loss in &losses.processes {
            let times = if loss.times == 1 { "once".to_owned() } else { format!("{} times", loss.times) };
            let outcome =
                if loss.recovered { format!("recovered within {:.1} ms", loss.longest_ms) } else { "NOT RECOVERED".to_owned() };
            writeln!(out, "  lost               {} {times}, {outcome}", loss.process)?;
        }
        if let Some(incidents) = &self.incidents {
            writeln!(out, "  brakes and stops   {}, described in {}", incidents.count, incidents.file.display())?;
            if let Some(error) = &incidents.error {
                writeln!(out, "  brakes and stops   the description is incomplete: {error}")?;
            }
        }
        for fault in &self.faults {
            if fault.is_request() {
                writeln!(out, "  ended              {} {} (tick {})", fault.process, fault.what, fault.tick)?;
                continue;
            }
            writeln!(
                out,
                "  FAULT              {} {} (tick {}, detected by: {})",
                fault.process,
                fault.what,
                fault.tick,
                fault.detector.name()
            )?;
        }
        Ok(())
    }
}
