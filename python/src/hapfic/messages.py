"""Messages of hapfic 0.2.0: layouts, codes, topics. Printed by `hapfic schema --messages python`; do not edit.

Units are SI: m, rad, N, N m, s, unless a name states another."""

import ctypes
import enum

VERSION = "0.2.0"
#: Version of iceoryx2 whose shared memory these messages lie in.
TRANSPORT_VERSION = "0.10.0"


class Process(enum.IntEnum):
    SUPERVISOR = 0
    PLANT = 1
    PLANNER = 2
    CONTROLLER = 3
    STANDBY = 4
    RECORDER = 5
    GATE = 6
    SPARE_GATE = 7


class Phase(enum.IntEnum):
    READY = 0
    RUNNING = 1
    WAITING = 2
    FINISHED = 3


class Mode(enum.IntEnum):
    HOLD = 0
    ACTIVE = 1
    BRAKE = 2
    STOPPED = 3


class Source(enum.IntEnum):
    FRESH = 0
    REPEATED = 1
    NO = 2
    SUPPRESSED = 3


class Severity(enum.IntEnum):
    NOMINAL = 0
    DEGRADED = 1
    BRAKE = 2
    STOPPED = 3


class Drive(enum.IntEnum):
    HELD = 0
    TORQUE = 1
    BRAKING = 2


class Task(enum.IntEnum):
    POSITION = 0
    POSE = 1


class Search(enum.IntEnum):
    TAPERED = 0
    SIGN = 1
    ADAPTIVE = 2


class Saturation(enum.IntEnum):
    CONTINUOUS = 0
    AS_PRINTED = 1
    SOFTENING = 2


class ResetPolicy(enum.IntEnum):
    CONTACT_LOSS = 0
    AS_PRINTED = 1
    NEVER = 2


class EventKind(enum.IntEnum):
    STARTED = 0
    ENDED = 1
    LOST = 2
    REJECTED = 3
    MISSED = 4
    TIMEBASE_SLIP = 5
    TRANSITION = 6
    PARAMETERS = 7
    LIMITED = 8
    CONTACT = 9
    NOTE = 10
    RESTARTED = 11
    PROMOTED = 12
    DISCONTINUITY = 13
    INJECTED = 14
    JOINED = 15
    REARMED = 16
    DIFFERS = 17
    PASSAGE = 18
    CONDITION = 19


class Detector(enum.IntEnum):
    NO = 0
    EXIT = 1
    HEARTBEAT = 2
    TICK = 3
    DEADLINE = 4
    CHECK = 5
    OPERATOR = 6
    BUDGET = 7
    START = 8
    SIGNAL = 9
    RECORDER = 10
    TASK = 11


class TaskCondition(enum.IntEnum):
    FORCE_NOT_REACHED = 0
    FORCE_OSCILLATES = 1
    FORCE_AT_LIMIT = 2
    OUTSIDE_BOUND = 3
    TARGET_OUT_OF_REACH = 4
    AT_JOINT_STOP = 5
    STABILITY_MARGIN = 6
    NOT_PASSIVE = 7
    OVER_SPEED = 8
    ROTATION_OUTSIDE_BOUND = 9
    ORIENTATION_NOT_REACHED = 10
    MOMENT_NOT_REACHED = 11


class MessageFault(enum.IntEnum):
    SLOW = 0
    DROP = 1
    REPEAT = 2
    CORRUPT = 3
    NAN = 4
    STALE = 5


class OperatorKind(enum.IntEnum):
    SET = 1
    STATUS = 2
    STOP = 3
    EMERGENCY_STOP = 4
    REARM = 5
    INJECT = 6
    SET_FORCED = 7
    SET_DRY_RUN = 8
    GET = 9


class ReplyCode(enum.IntEnum):
    DONE = 1
    REJECTED = 2


class ObjectState(ctypes.Structure):
    """Pose and velocity of a free body."""

    _fields_ = [
        # Centre of mass [m].
        ("position", ctypes.c_double * 3),
        # Unit quaternion, x y z w.
        ("orientation", ctypes.c_double * 4),
        # Velocity of the centre of mass [m/s].
        ("linear_velocity", ctypes.c_double * 3),
        # Angular velocity [rad/s].
        ("angular_velocity", ctypes.c_double * 3),
    ]


class ContactState(ctypes.Structure):
    """A contact, averaged over the tick."""

    _fields_ = [
        # Index of the first body in the scene's list of bodies.
        ("body", ctypes.c_uint32),
        # Index of the second body, on which the opposite force acts.
        ("against", ctypes.c_uint32),
        # Contact point [m]: the mean over the tick, weighted by the force.
        ("point", ctypes.c_double * 3),
        # Mean force on the first body over the tick [N].
        ("force", ctypes.c_double * 3),
        # Deepest penetration at the start of the last sub-step with contact [m].
        ("depth", ctypes.c_double),
    ]


class Physics(ctypes.Structure):
    """Account of the plant's integrator over a tick."""

    _fields_ = [
        # Sub-steps in this tick.
        ("substeps", ctypes.c_uint32),
        # Newton iterations in this tick, over all contact sub-steps.
        ("newton_iterations", ctypes.c_uint32),
        # Contact sub-steps of this tick that ended above the tolerance.
        ("unconverged", ctypes.c_uint32),
        # Sub-steps of this tick that were solved implicitly, within reach of a contact or a joint's stop.
        ("contact_substeps", ctypes.c_uint32),
        # Kinetic and potential energy of robot and objects [J].
        ("energy_j", ctypes.c_double),
        # Work done by the contacts (without joint stops) on the bodies since the start [J]: falls, except for the energy that a compressed contact returns.
        ("contact_work_j", ctypes.c_double),
        # Elastic energy in the contacts now [J]: its sum with contact_work_j may only fall; any rise comes from the integration.
        ("contact_stored_j", ctypes.c_double),
        # Work of drive, brakes and joint stops on the joints since the start [J].
        ("joint_work_j", ctypes.c_double),
        # Energy lost to joint damping since the start [J].
        ("joint_loss_j", ctypes.c_double),
        # Error of the energy balance since the start [J]: the change of energy_j less the works of contacts and joints, plus the loss to joint damping.
        ("energy_error_j", ctypes.c_double),
        # Sub-steps of this tick that were rolled back and cut, since they did not converge or would have added energy.
        ("cut_substeps", ctypes.c_uint32),
        # Passages in this tick: the centre of a body came out on the other side of another body's.
        ("passages", ctypes.c_uint32),
        # Index of the body of the last passage in the scene's list of bodies.
        ("passed_body", ctypes.c_uint32),
        # Index of the body that it passed through.
        ("passed_against", ctypes.c_uint32),
    ]


class State(ctypes.Structure):
    """Measurements of the plant at tick, and its actions in the tick before."""

    _fields_ = [
        # Publication time [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Number of the sample; the first is 0.
        ("tick", ctypes.c_int64),
        # Simulated time [ns], tick times the period.
        ("time_ns", ctypes.c_uint64),
        # Tick of the command that was applied until this sample; -1 before the first.
        ("command_tick", ctypes.c_int64),
        # Lateness of the plant's timer [ns]; zero in lockstep.
        ("wake_lateness_ns", ctypes.c_uint64),
        # Periods by which simulated time has slipped since the start, because the timer was late.
        ("slipped", ctypes.c_uint64),
        # Joints that count.
        ("joints", ctypes.c_uint32),
        # Code of [Drive]: action of the drive until this sample.
        ("drive", ctypes.c_uint32),
        # Objects that count.
        ("object_count", ctypes.c_uint32),
        # Contacts that count.
        ("contact_count", ctypes.c_uint32),
        # Limbs in this message: 1.
        ("limbs", ctypes.c_uint32),
        # Not used; zero.
        ("reserved", ctypes.c_uint32),
        # q [rad].
        ("joint_position", ctypes.c_double * 16),
        # q' [rad/s].
        ("joint_velocity", ctypes.c_double * 16),
        # Mean torque of the drive in the tick before [N m].
        ("joint_torque", ctypes.c_double * 16),
        # Tip of the chain [m].
        ("foot_position", ctypes.c_double * 3),
        # Its velocity [m/s].
        ("foot_velocity", ctypes.c_double * 3),
        # Mean force of the environment on the foot over the tick before [N]: the sensor.
        ("foot_force", ctypes.c_double * 3),
        # Orientation of the tip frame in the world: unit quaternion, x y z w.
        ("foot_orientation", ctypes.c_double * 4),
        # Its angular velocity [rad/s].
        ("foot_angular_velocity", ctypes.c_double * 3),
        # Mean moment of the environment on the foot about the tip over the tick before [N m]: the sensor's other half.
        ("foot_moment", ctypes.c_double * 3),
        # Free bodies, in the order of the scenario.
        ("objects", ObjectState * 4),
        # Contacts.
        ("contacts", ContactState * 8),
        # The integrator's account.
        ("physics", Physics),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.State"


class AxisPlan(ctypes.Structure):
    """Planned motion of an axis: a closed form of the time since its target was accepted. For brake_time the axis brakes with brake_acceleration from start at start_velocity; then x = target - amplitude (1 + cos(phase + rate t)) until the cosine's argument reaches pi, where it rests on the target."""

    _fields_ = [
        # End position [m].
        ("target", ctypes.c_double),
        # Position at acceptance [m].
        ("start", ctypes.c_double),
        # Velocity at acceptance [m/s].
        ("start_velocity", ctypes.c_double),
        # Signed acceleration while braking [m/s^2]; zero if it need not brake.
        ("brake_acceleration", ctypes.c_double),
        # Duration of braking [s].
        ("brake_time", ctypes.c_double),
        # R, signed like the error at the start of the arc [m].
        ("amplitude", ctypes.c_double),
        # omega [rad/s].
        ("rate", ctypes.c_double),
        # theta_0 [rad].
        ("phase", ctypes.c_double),
    ]


class RotationPlan(ctypes.Structure):
    """Planned turn of the tip: the rotation vector r from the target to the reference, axis by axis as a position. The reference is R_d = exp(r) R_t, world frame. From rest r keeps its direction, and the turn is that of a slerp."""

    _fields_ = [
        # Ticks since the target was accepted.
        ("ticks", ctypes.c_uint64),
        # 1: there is a plan; 0 in a position task, and where the plant does not measure the orientation.
        ("exists", ctypes.c_uint64),
        # Target: roll, pitch, yaw about the fixed axes [rad].
        ("target_rpy", ctypes.c_double * 3),
        # The three components of r; each ends at 0 [rad].
        ("axes", AxisPlan * 3),
    ]


class PlannerState(ctypes.Structure):
    """Whole state of the planner, from which it continues after a restart."""

    _fields_ = [
        # Ticks since the target was accepted.
        ("ticks", ctypes.c_uint64),
        # The three axes.
        ("axes", AxisPlan * 3),
        # The orientation; zero in a position task.
        ("rotation", RotationPlan),
    ]


class Reference(ctypes.Structure):
    """Planned position of the foot at tick."""

    _fields_ = [
        # Publication time [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Tick of the reference.
        ("tick", ctypes.c_int64),
        # Version of its parameters.
        ("parameters_version", ctypes.c_uint64),
        # Limbs in this message: 1.
        ("limbs", ctypes.c_uint32),
        # Not used; zero.
        ("reserved", ctypes.c_uint32),
        # x_d [m].
        ("position", ctypes.c_double * 3),
        # x_d' [m/s].
        ("velocity", ctypes.c_double * 3),
        # R_d: unit quaternion x y z w; all zero in a position task.
        ("orientation", ctypes.c_double * 4),
        # Its angular velocity [rad/s].
        ("angular_velocity", ctypes.c_double * 3),
        # The planner's state at tick.
        ("planner", PlannerState),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Reference"


class ControllerState(ctypes.Structure):
    """State of the law on three axes. It travels in requests and commands; controllers keep none. The units are those of the translation. The same fields hold the state of the three axes of rotation, in rad for m and N m for N."""

    _fields_ = [
        # dx of the haptic search [m].
        ("offset", ctypes.c_double * 3),
        # Error latched at the start of the last convergence [m] (eq. 1).
        ("x_max", ctypes.c_double * 3),
        # K0 of this tick [N/m]; 0 before the first.
        ("stiffness", ctypes.c_double * 3),
        # F_max of this tick [N].
        ("max_force", ctypes.c_double * 3),
        # x_b of this tick [m].
        ("position_bound", ctypes.c_double * 3),
        # Force of the attractor in this tick [N], without damping.
        ("force", ctypes.c_double * 3),
        # Taper of the adaptive search, 0 before the first contact.
        ("taper", ctypes.c_double * 3),
        # F_d - F of this tick [N]; 0 without contact.
        ("force_error", ctypes.c_double * 3),
        # |F_d - F| smoothed over 20 ms [N]; 0 before the first contact.
        ("slow_error", ctypes.c_double * 3),
        # Time since the last contact [s], at most 1.
        ("free_time", ctypes.c_double * 3),
        # Force of the attractor at x_max [N], with continuous re-entry.
        ("x_max_force", ctypes.c_double * 3),
        # 1 in convergence, 0 in divergence.
        ("converging", ctypes.c_uint32 * 3),
        # Ticks in a row in which the axis was at rest in convergence, without contact.
        ("at_rest_ticks", ctypes.c_uint32 * 3),
    ]


class RotationRequest(ctypes.Structure):
    """The orientation's part of a request: zero in a position task."""

    _fields_ = [
        # e_R: rotation vector from the tip to the reference, plus the searched offset [rad].
        ("error", ctypes.c_double * 3),
        # e_R' = omega_d - omega [rad/s].
        ("error_rate", ctypes.c_double * 3),
        # Moment [N m].
        ("moment", ctypes.c_double * 3),
        # The law's state after this tick.
        ("state", ControllerState),
    ]


class Request(ctypes.Structure):
    """Request of a controller at tick."""

    _fields_ = [
        # Publication time [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Tick of the request.
        ("tick", ctypes.c_int64),
        # Tick of its state.
        ("state_tick", ctypes.c_int64),
        # Version of its parameters.
        ("parameters_version", ctypes.c_uint64),
        # Code of the [Process] that sends it.
        ("controller", ctypes.c_uint32),
        # Joints that count.
        ("joints", ctypes.c_uint32),
        # Limbs in this message: 1.
        ("limbs", ctypes.c_uint32),
        # Not used; zero.
        ("reserved", ctypes.c_uint32),
        # e = x_d + dx - x [m].
        ("error", ctypes.c_double * 3),
        # e' = x_d' - J q' [m/s].
        ("error_rate", ctypes.c_double * 3),
        # F_c [N].
        ("force", ctypes.c_double * 3),
        # J^T W + tau_N, plus gravity compensation if enabled [N m]; W: force and moment.
        ("torque", ctypes.c_double * 16),
        # tau_N, the part of torque that acts on the posture: null space, joint damping, limit springs [N m].
        ("joint_space_torque", ctypes.c_double * 16),
        # The law's state after this tick.
        ("state", ControllerState),
        # The orientation.
        ("rotation", RotationRequest),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Request"


class GateState(ctypes.Structure):
    """State of the gate after a command. Of each gate the next command follows from it and from the next request alone."""

    _fields_ = [
        # Output of the torque filter [N m; N for a prismatic joint].
        ("filtered", ctypes.c_double * 16),
        # Latched stops that the gate has taken in.
        ("stops", ctypes.c_uint64),
        # Re-armings that the gate has taken in.
        ("rearms", ctypes.c_uint64),
        # Version of the newest parameter set that was announced before the command went out.
        ("announced", ctypes.c_uint64),
        # Whether the torque ramps in after a brake.
        ("ramping", ctypes.c_uint32),
        # Slot of the primary controller.
        ("primary", ctypes.c_uint32),
        # Ticks in a row that only the other slot answered.
        ("misses", ctypes.c_uint32),
        # Ticks in a row without a valid request, up to those that brake.
        ("missed", ctypes.c_uint32),
        # Ticks in a row with a valid request, up to those that clear a brake.
        ("good", ctypes.c_uint32),
        # Whether any request has been used.
        ("opened", ctypes.c_uint32),
    ]


class Command(ctypes.Structure):
    """Command of the gate to the drive at tick."""

    _fields_ = [
        # Publication time [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Tick of the state that it answers.
        ("tick", ctypes.c_int64),
        # Code of [Mode].
        ("mode", ctypes.c_uint32),
        # Code of [Source].
        ("source", ctypes.c_uint32),
        # Code of [Severity].
        ("severity", ctypes.c_uint32),
        # Joints that count.
        ("joints", ctypes.c_uint32),
        # Bit i: the torque of joint i was beyond its peak. If the gate scales, all joints are scaled.
        ("limited", ctypes.c_uint32),
        # Bit i: the rate of joint i's torque was limited, ramping in after a brake.
        ("ramped", ctypes.c_uint32),
        # Bit i: the rate of joint i's torque was beyond the limit of normal operation.
        ("rate_limited", ctypes.c_uint32),
        # Limbs in this message: 1.
        ("limbs", ctypes.c_uint32),
        # Conditioned torque [N m]: filtered, limited in its rate and in its size.
        ("torque", ctypes.c_double * 16),
        # State of the gate after this command, from which any gate continues.
        ("gate", GateState),
        # The accepted request: raw torque, force, error, controller state. The next tick's controller starts from it.
        ("request", Request),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Command"


class RotationParameters(ctypes.Structure):
    """Parameters of the axes of rotation; read in a pose task alone."""

    _fields_ = [
        # Desired orientation of the tip: roll, pitch, yaw about the fixed axes, as in URDF [rad].
        ("target_rpy", ctypes.c_double * 3),
        # Desired moment of the environment on the foot about the tip [N m]; 0 on an axis: no search there.
        ("desired_moment", ctypes.c_double * 3),
        # K_R [N m/rad].
        ("stiffness", ctypes.c_double * 3),
        # T_max [N m].
        ("max_moment", ctypes.c_double * 3),
        # x_b,R [rad].
        ("bound", ctypes.c_double * 3),
        # Damping of each axis over the square root of its stiffness [kg^1/2 m].
        ("damping", ctypes.c_double),
        # sigma as the moment threshold of the search [N m].
        ("moment_resolution", ctypes.c_double),
        # Desired mean speed of a turn [rad/s].
        ("mean_speed", ctypes.c_double),
        # Largest angular acceleration of the reference [rad/s^2].
        ("max_acceleration", ctypes.c_double),
    ]


class JointSpaceParameters(ctypes.Structure):
    """Parameters of the law in joint space, fixed over a run. All gains zero: there is none."""

    _fields_ = [
        # q_n, desired posture [rad; m for a prismatic joint].
        ("posture", ctypes.c_double * 16),
        # K_n, stiffness of the posture in the null space [N m/rad].
        ("stiffness", ctypes.c_double),
        # D_n, damping in the null space [N m s/rad].
        ("damping", ctypes.c_double),
        # Damping of every joint, in the task too [N m s/rad].
        ("joint_damping", ctypes.c_double),
        # Distance from a joint's limit at which its spring begins [rad].
        ("limit_margin", ctypes.c_double),
        # Stiffness of the limit springs [N m/rad].
        ("limit_stiffness", ctypes.c_double),
    ]


class Parameters(ctypes.Structure):
    """Parameter set: everything that the operator may change while the stack runs."""

    _fields_ = [
        # Version, counted from 1.
        ("version", ctypes.c_uint64),
        # First tick of the set.
        ("effective_tick", ctypes.c_int64),
        # x_t [m].
        ("target_position", ctypes.c_double * 3),
        # F_d, desired reaction on the foot [N].
        ("desired_force", ctypes.c_double * 3),
        # K0 [N/m].
        ("stiffness", ctypes.c_double * 3),
        # F_max [N].
        ("max_force", ctypes.c_double * 3),
        # x_b [m].
        ("position_bound", ctypes.c_double * 3),
        # Code of [ResetPolicy].
        ("reset_policy", ctypes.c_uint32),
        # Code of [Saturation].
        ("saturation", ctypes.c_uint32),
        # Code of [Search].
        ("search", ctypes.c_uint32),
        # 1: add g(q) to the torque.
        ("gravity_compensation", ctypes.c_uint32),
        # 1: dx does not wind up at F_max, and keeps its force when K0 changes.
        ("offset_anti_windup", ctypes.c_uint32),
        # 1: a stalled convergence restarts from its position.
        ("stall_release", ctypes.c_uint32),
        # 1: in contact dx follows the reference and a change of gains keeps the force; after a loss of contact dx returns slowly.
        ("force_hold", ctypes.c_uint32),
        # 1: the force is continuous where the attractor enters divergence again.
        ("continuous_reentry", ctypes.c_uint32),
        # Code of [Task]; the same over a run.
        ("task", ctypes.c_uint32),
        # Joints that count in the posture.
        ("joints", ctypes.c_uint32),
        # Share of the force error that the tapered search removes in 1 ms, as if against K0.
        ("taper", ctypes.c_double),
        # Damping of each axis over the square root of its stiffness [kg^1/2].
        ("damping", ctypes.c_double),
        # Time by which the posture of J^T is predicted [s].
        ("posture_lead", ctypes.c_double),
        # sigma as the scale of the search step, Algorithm 1.
        ("search_scale", ctypes.c_double),
        # sigma as the force threshold, Algorithm 1 [N].
        ("force_resolution", ctypes.c_double),
        # Desired mean speed of the planner [m/s].
        ("mean_speed", ctypes.c_double),
        # a_max of the planner [m/s^2].
        ("max_acceleration", ctypes.c_double),
        # The axes of rotation.
        ("rotation", RotationParameters),
        # The law in joint space.
        ("joint_space", JointSpaceParameters),
    ]


class Operator(ctypes.Structure):
    """Parameter sets in force and announced."""

    _fields_ = [
        # Set in force at publication.
        ("current", Parameters),
        # Set in force from its effective_tick on; equal to current if nothing is announced.
        ("next", Parameters),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Operator"


class Event(ctypes.Structure):
    """Event of the stack."""

    _fields_ = [
        # Publication time [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Tick of the event.
        ("tick", ctypes.c_int64),
        # Code of the [Process] concerned.
        ("process", ctypes.c_uint32),
        # Code of [EventKind].
        ("kind", ctypes.c_uint32),
        # Code of [Severity].
        ("severity", ctypes.c_uint32),
        # Code of [Detector].
        ("detector", ctypes.c_uint32),
        # Bytes of text that count.
        ("text_len", ctypes.c_uint32),
        # Not used; zero.
        ("reserved", ctypes.c_uint32),
        # Text in UTF-8.
        ("text", ctypes.c_uint8 * 192),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Event"


class Timing(ctypes.Structure):
    """Times of a process in a tick, by the monotonic clock; also its heartbeat."""

    _fields_ = [
        # Code of [Process].
        ("process", ctypes.c_uint32),
        # Code of [Phase].
        ("phase", ctypes.c_uint32),
        # Tick of the report; -1 before the first.
        ("tick", ctypes.c_int64),
        # Publication time of the input that started the tick; for the plant the due time of its timer [ns].
        ("due_ns", ctypes.c_uint64),
        # Wake-up time [ns].
        ("wake_ns", ctypes.c_uint64),
        # Publication time of the output [ns]; zero if there is none.
        ("publish_ns", ctypes.c_uint64),
        # Time from the state to its command, published (gate) or received (plant) [ns]; zero if the command was late.
        ("latency_ns", ctypes.c_uint64),
        # Heap allocations of the thread between receiving and sending, in this tick.
        ("allocations", ctypes.c_uint32),
        # Messages rejected since the start.
        ("rejected", ctypes.c_uint32),
        # Page faults of the thread since it started to run, minor and major.
        ("page_faults", ctypes.c_uint32),
        # Real-time privileges in use, bits: 1 SCHED_FIFO, 2 memory locked, 4 pinned to its core.
        ("realtime", ctypes.c_uint32),
        # Number of this start of the process: 0 for the first.
        ("generation", ctypes.c_uint32),
        # Failed connections since the start.
        ("failed_connections", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Timing"


class Credit(ctypes.Structure):
    """Credit of the recorder to the plant: in lockstep the plant may run ahead of it by a bounded number of ticks."""

    _fields_ = [
        # Last tick the plant may publish.
        ("tick", ctypes.c_int64),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Credit"


class Injection(ctypes.Structure):
    """Order to a process to inject a fault into its messages."""

    _fields_ = [
        # Counts up from 1, so that a process takes each injection once.
        ("number", ctypes.c_uint64),
        # First tick of the fault; the next tick if that has passed.
        ("tick", ctypes.c_int64),
        # Duration of the fault [ticks].
        ("ticks", ctypes.c_uint32),
        # Code of the [Process] that injects it.
        ("process", ctypes.c_uint32),
        # Code of [MessageFault].
        ("message_fault", ctypes.c_uint32),
        # Delay of a slow process [us].
        ("by_us", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.Injection"


class OperatorRequest(ctypes.Structure):
    """Request of an operator to a running stack."""

    _fields_ = [
        # Code of [OperatorKind].
        ("kind", ctypes.c_uint32),
        # Bytes of text that count.
        ("text_len", ctypes.c_uint32),
        # Text in UTF-8.
        ("text", ctypes.c_uint8 * 2048),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.OperatorRequest"


class OperatorReply(ctypes.Structure):
    """Reply to an operator's request."""

    _fields_ = [
        # Version of the new parameters; zero if there are none.
        ("version", ctypes.c_uint64),
        # First tick at which they are in force; -1 if there are none.
        ("tick", ctypes.c_int64),
        # Tick that was due when the request arrived at the supervisor.
        ("arrived_tick", ctypes.c_int64),
        # Tick that was due when the gate took the request; -1 if it did not.
        ("taken_tick", ctypes.c_int64),
        # Code of [ReplyCode].
        ("code", ctypes.c_uint32),
        # Bytes of text that count.
        ("text_len", ctypes.c_uint32),
        # Text in UTF-8.
        ("text", ctypes.c_uint8 * 4096),
    ]

    @staticmethod
    def type_name() -> str:
        return "hapfic.OperatorReply"


#: Size in bytes of each structure, and offset of each of its fields.
LAYOUTS = {
    ObjectState: (104, [0, 24, 56, 80]),
    ContactState: (64, [0, 4, 8, 32, 56]),
    Physics: (80, [0, 4, 8, 12, 16, 24, 32, 40, 48, 56, 64, 68, 72, 76]),
    State: (1616, [0, 8, 16, 24, 32, 40, 48, 52, 56, 60, 64, 68, 72, 200, 328, 456, 480, 504, 528, 560, 584, 608, 1024, 1536]),
    AxisPlan: (64, [0, 8, 16, 24, 32, 40, 48, 56]),
    RotationPlan: (232, [0, 8, 16, 40]),
    PlannerState: (432, [0, 8, 200]),
    Reference: (568, [0, 8, 16, 24, 28, 32, 56, 80, 112, 136]),
    ControllerState: (288, [0, 24, 48, 72, 96, 120, 144, 168, 192, 216, 240, 264, 276]),
    RotationRequest: (360, [0, 24, 48, 72]),
    Request: (1024, [0, 8, 16, 24, 32, 36, 40, 44, 48, 72, 96, 120, 248, 376, 664]),
    GateState: (176, [0, 128, 136, 144, 152, 156, 160, 164, 168, 172]),
    Command: (1376, [0, 8, 16, 20, 24, 28, 32, 36, 40, 44, 48, 176, 352]),
    RotationParameters: (152, [0, 24, 48, 72, 96, 120, 128, 136, 144]),
    JointSpaceParameters: (168, [0, 128, 136, 144, 152, 160]),
    Parameters: (552, [0, 8, 16, 40, 64, 88, 112, 136, 140, 144, 148, 152, 156, 160, 164, 168, 172, 176, 184, 192, 200, 208, 216, 224, 232, 384]),
    Operator: (1104, [0, 552]),
    Event: (232, [0, 8, 16, 20, 24, 28, 32, 36, 40]),
    Timing: (72, [0, 4, 8, 16, 24, 32, 40, 48, 52, 56, 60, 64, 68]),
    Credit: (8, [0]),
    Injection: (32, [0, 8, 16, 20, 24, 28]),
    OperatorRequest: (2056, [0, 4, 8]),
    OperatorReply: (4136, [0, 8, 16, 24, 32, 36, 40]),
}


#: Topics: message, number of the doorbell, history, messages of each sender that outlive it (realtime, lockstep).
TOPICS = {
    "state": (State, 0, 4, (8, 1024)),
    "reference": (Reference, 1, 4, (8, 1024)),
    "request": (Request, 2, 1, (0, 1024)),
    "command": (Command, 3, 4, (0, 1024)),
    "operator": (Operator, None, 1, (8, 64)),
    "event": (Event, None, 0, (0, 256)),
    "timing": (Timing, None, 0, (0, 1024)),
    "credit": (Credit, 4, 1, (0, 0)),
    "injection": (Injection, None, 0, (0, 0)),
    "view/state": (State, None, 1, (0, 0)),
    "view/reference": (Reference, None, 1, (0, 0)),
    "view/request": (Request, None, 1, (0, 0)),
    "view/command": (Command, None, 1, (0, 0)),
    "view/operator": (Operator, None, 1, (0, 0)),
    "view/event": (Event, None, 16, (0, 0)),
    "view/timing": (Timing, None, 0, (0, 0)),
}

#: Doorbells without a topic.
DOORBELLS = {
    "COMMAND_SENT": 5,
    "OPERATOR_REQUEST": 6,
    "SPARE_GATE": 7,
}

