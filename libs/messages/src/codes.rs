//! Meaning of the codes in messages.

use crate::wire_enum::wire_enum;

wire_enum! {
    /// Treatment of the searched offset when the force is matched or no force is desired (Algorithm 1, `Reset`).
    ResetPolicy {
        /// dx returns to zero when no force is desired and is kept while the force is matched.
        ContactLoss = 0, "contact_loss";
        /// dx returns to zero whenever the search rests, as Algorithm 1 prints it with `Reset = true`.
        AsPrinted = 1, "as_printed";
        /// dx is always kept (`Reset = false`).
        Never = 2, "never";
    }
}

wire_enum! {
    /// Saturation of the force profile (eq. 4).
    Saturation {
        /// S = 0.05 / (2 pi): saturates in the last 5 % of x_b, as the paper's text states.
        Continuous = 0, "continuous";
        /// S = 0.1353, the printed value: steps at 0.95 x_b.
        AsPrinted = 1, "as_printed";
        /// The last 5 % of min(F_max, K0 x_b) bend over smoothly, and F_c(e) / e never grows.
        Softening = 2, "softening";
    }
}

wire_enum! {
    /// Step of the haptic search (Algorithm 1).
    Search {
        /// min(step, taper |F_d - F| / K0): settles.
        Tapered = 0, "tapered";
        /// A full step every tick, as in the paper: leaves a limit cycle of one step.
        Sign = 1, "sign";
        /// As tapered, with a taper per axis that falls while the force error changes its sign and grows otherwise.
        Adaptive = 2, "adaptive";
    }
}

wire_enum! {
    /// What the task-space law controls at the tip.
    Task {
        /// The position: three axes, and forces alone.
        Position = 0, "position";
        /// Position and orientation: six axes, forces and moments.
        Pose = 1, "pose";
    }
}

wire_enum! {
    /// Mode of a command: the action of the drive.
    Mode {
        /// The drive's brakes hold the joints: no torque has been commanded yet.
        Hold = 0, "hold";
        /// The torque of the command is applied.
        Active = 1, "active";
        /// No torque; the drive damps its joints.
        Brake = 2, "brake";
        /// As brake, latched until the operator re-arms.
        Stopped = 3, "stopped";
    }
}

wire_enum! {
    /// Origin of a command's content.
    Source {
        /// A request of this tick.
        Fresh = 0, "fresh";
        /// The last accepted request, repeated.
        Repeated = 1, "repeated";
        /// No valid request: before the first request, or braking.
        None = 2, "none";
        /// A valid request of this tick that the gate suppresses, since a brake has not cleared yet.
        Suppressed = 3, "suppressed";
    }
}

wire_enum! {
    /// Action of the drive (the plant's joints) on its command.
    Drive {
        /// Brakes on: no command with a torque has arrived yet.
        Held = 0, "held";
        /// Applies the command's torque.
        Torque = 1, "torque";
        /// Damps its joints: by command, or for lack of commands.
        Braking = 2, "braking";
    }
}

wire_enum! {
    /// A process of the stack.
    Process {
        /// Launcher and watchdog.
        Supervisor = 0, "supervisor";
        /// The simulated robot, or the driver of a real robot: the clock.
        Plant = 1, "plant";
        /// The harmonic planner.
        Planner = 2, "planner";
        /// The controller whose request counts.
        Controller = 3, "controller";
        /// The second controller, which computes the same.
        Standby = 4, "standby";
        /// Receives all messages and writes the log. It sends no message of a tick.
        Recorder = 5, "recorder";
        /// Turns requests into commands.
        Gate = 6, "gate";
        /// The second gate, which takes a tick that the first does not gate.
        SpareGate = 7, "spare_gate";
    }
}

wire_enum! {
    /// Phase of a process.
    Phase {
        /// The ports are open; the process waits for the first message.
        Ready = 0, "ready";
        /// The process works tick by tick.
        Running = 1, "running";
        /// The process is alive and waits for overdue input.
        Waiting = 2, "waiting";
        /// The process has run its last tick.
        Finished = 3, "finished";
    }
}

wire_enum! {
    /// Severity of the situation. Ordered: a later variant is worse.
    Severity {
        /// No fault.
        Nominal = 0, "nominal";
        /// The stack works without a process or a request.
        Degraded = 1, "degraded";
        /// The drive brakes.
        Brake = 2, "brake";
        /// Latched stop; only the operator can leave it.
        Stopped = 3, "stopped";
    }
}

wire_enum! {
    /// Kind of an event.
    EventKind {
        /// A run, process or phase began.
        Started = 0, "started";
        /// A run, process or phase ended as planned.
        Ended = 1, "ended";
        /// A process was lost.
        Lost = 2, "lost";
        /// A message was rejected.
        Rejected = 3, "rejected";
        /// No valid request came by the deadline.
        Missed = 4, "missed";
        /// The plant's timer was a period or more late; simulated time slipped.
        TimebaseSlip = 5, "timebase_slip";
        /// The severity changed.
        Transition = 6, "transition";
        /// A parameter set took effect.
        Parameters = 7, "parameters";
        /// A torque was limited.
        Limited = 8, "limited";
        /// Contact of the foot made or lost.
        Contact = 9, "contact";
        /// Any other note.
        Note = 10, "note";
        /// A process was restarted.
        Restarted = 11, "restarted";
        /// The other controller's requests count from now on.
        Promoted = 12, "promoted";
        /// A joint's torque made a large step from one tick to the next.
        Discontinuity = 13, "discontinuity";
        /// A fault was injected.
        Injected = 14, "injected";
        /// A restarted process has run its first tick.
        Joined = 15, "joined";
        /// The operator re-armed after a latched stop.
        Rearmed = 16, "rearmed";
        /// The requests of the two controllers for the same tick differ.
        Differs = 17, "differs";
        /// A body of the simulated world went through another one.
        Passage = 18, "passage";
        /// A condition of the task began or ended; the severity is not concerned.
        Condition = 19, "condition";
    }
}

wire_enum! {
    /// Condition of the task: the stack may be nominal and its task not fine.
    TaskCondition {
        /// The force has missed a constant F_d by more than 5 % for 1 s.
        ForceNotReached = 0, "force_not_reached";
        /// The force oscillates about its mean: rms over 0.2 s above 3 % of a constant F_d.
        ForceOscillates = 1, "force_oscillates";
        /// F_c is at the largest force of the profile, F_max or K0 x_b.
        ForceAtLimit = 2, "force_at_limit";
        /// The foot is further than x_b from its reference, and does not make up for it by force.
        OutsideBound = 3, "outside_bound";
        /// The reference rests at its target, and the foot stays further than x_b from it without contact.
        TargetOutOfReach = 4, "target_out_of_reach";
        /// A joint is at its stop.
        AtJointStop = 5, "at_joint_stop";
        /// At this posture less than 20 % are left to the rule omega tau <= 0.32 + 2.3 zeta.
        StabilityMargin = 6, "stability_margin";
        /// The controller has given the robot more energy than reference and spring explain.
        NotPassive = 7, "not_passive";
        /// A joint moves faster than its speed limit.
        OverSpeed = 8, "over_speed";
        /// The tip is turned further than x_b,R from its reference, and does not make up for it by a moment.
        RotationOutsideBound = 9, "rotation_outside_bound";
        /// The reference rests, and the tip stays turned from it by more than a degree where no moment is wanted.
        OrientationNotReached = 10, "orientation_not_reached";
        /// The moment has missed a constant M_d by more than 5 % for 1 s.
        MomentNotReached = 11, "moment_not_reached";
    }
}

wire_enum! {
    /// Detector that saw an event first.
    Detector {
        /// No detector: the event was intended.
        None = 0, "none";
        /// The operating system: exit of a process.
        Exit = 1, "exit";
        /// The age of the last heartbeat.
        Heartbeat = 2, "heartbeat";
        /// A tick that does not advance.
        Tick = 3, "tick";
        /// The gate's deadline.
        Deadline = 4, "deadline";
        /// The check of a message.
        Check = 5, "check";
        /// The operator.
        Operator = 6, "operator";
        /// The restart budget.
        Budget = 7, "budget";
        /// The start of the run.
        Start = 8, "start";
        /// A signal to the supervisor.
        Signal = 9, "signal";
        /// The recorder.
        Recorder = 10, "recorder";
        /// The conditions of the task.
        Task = 11, "task";
    }
}

wire_enum! {
    /// Fault that a process injects into its messages.
    MessageFault {
        /// Sends late.
        Slow = 0, "slow";
        /// Does not send.
        Drop = 1, "drop";
        /// Repeats its last message.
        Repeat = 2, "repeat";
        /// Sends invalid codes and counts.
        Corrupt = 3, "corrupt";
        /// Sends a NaN.
        Nan = 4, "nan";
        /// Sends an old tick.
        Stale = 5, "stale";
    }
}
