"""A controller in Python, in place of hapfic's own: one overrides `step`."""

import time
from dataclasses import dataclass

import numpy as np

from .errors import HapficError
from .messages import Command, ControllerState, Operator, Parameters, Phase, Process, Reference, Request, State
from .process import ProcessLoop, WAIT_S, run_process, without_collector
from .robot import Chain
from .runs import RunFile


@dataclass
class Tick:
    """What a controller knows at a tick; vectors are in the world frame."""

    state: State
    reference: Reference
    #: Gains and limits in force.
    parameters: Parameters
    #: The law's state after the tick before: it travels in the command, so that either controller can go on from it.
    previous: ControllerState
    #: Position [m] and velocity [m/s] of the tip, and those of the reference.
    position: np.ndarray
    velocity: np.ndarray
    target: np.ndarray
    target_velocity: np.ndarray
    #: Measured force of the environment on the foot, and the desired one [N].
    force: np.ndarray
    desired_force: np.ndarray
    #: The law's state after this tick; fill what the next tick needs.
    after: ControllerState


class Controller:
    """The law: override `step`. Two processes run it, and either may answer a tick."""

    def begin(self, run: RunFile) -> None:
        """Called once, before the first tick."""

    def step(self, tick: Tick) -> np.ndarray:
        """Force F_c of the tip on the environment [N]; the torque follows from it. A function of `tick` alone."""
        raise NotImplementedError


class _Loop(ProcessLoop):
    def __init__(self, controller: Controller):
        super().__init__({"controller": Process.CONTROLLER, "standby": Process.STANDBY})
        self.controller, self.chain = controller, Chain.of_run(self.run)
        bus = self.bus
        self.state, self.reference = bus.input("state"), bus.input("reference")
        self.command, self.operator = bus.input("command"), bus.input("operator")
        self.request = bus.output("request", self.run.process, self.run.lockstep)
        self.doorbells = {topic: bus.doorbell_of(topic) for topic in ("state", "reference", "command")}
        self.states: dict[int, State] = {}
        self.references: dict[int, Reference] = {}
        self.commands: dict[int, Command] = {}
        self.sets: Operator | None = None

    def main(self) -> None:
        self.controller.begin(self.run)
        without_collector()
        seen = -1
        while not self.stop and seen < self.ticks - 1:
            state = self.next_state(seen)
            if state is None:
                continue
            wake, seen = time.monotonic_ns(), state.tick
            published = self.answer(state)
            self.report(Phase.RUNNING, seen, state.stamp_ns, wake, published)
            self.request.connect()
        self.finish()

    def read(self) -> None:
        """Takes what has come, and forgets what is old."""
        for messages, kept in ((self.state, self.states), (self.reference, self.references), (self.command, self.commands)):
            for message in messages.all():
                kept[message.tick] = message
            for tick in sorted(kept)[:-8]:
                del kept[tick]
        for sets in self.operator.all():
            if self.sets is None or sets.next.version >= self.sets.next.version:
                self.sets = sets

    def next_state(self, seen: int) -> State | None:
        """The next state in lockstep, the newest in realtime; None after a wait without one."""
        self.read()
        newer = [tick for tick in self.states if tick > seen]
        if newer:
            return self.states[min(newer) if self.run.lockstep else max(newer)]
        self.request.connect()
        self.doorbells["state"].wait(WAIT_S)
        self.beat(Phase.READY if seen < 0 else Phase.WAITING, seen)
        return None

    def answer(self, state: State) -> int:
        """Sends the request of a tick; returns when, or 0 if another has answered it or a message is missing."""
        tick = state.tick
        while not self.stop:
            self.read()
            command, reference = self.commands.get(tick - 1), self.references.get(tick)
            if any(later >= tick for later in self.commands):
                return 0
            if not self.run.lockstep:
                command = command or self.commands.get(max(self.commands, default=None))
                reference = reference or self.held_reference(state)
            if command and reference and self.sets and self.sets.next.version >= command.gate.announced:
                request = self.compute(state, reference, command)
                self.request.send(request)
                return time.monotonic_ns()
            if not self.run.lockstep:
                self.rejected += 1
                return 0
            self.request.connect()
            self.doorbells["command"].wait(0.002)
            self.beat(Phase.WAITING, tick)
        return 0

    def held_reference(self, state: State) -> Reference:
        """The newest reference before a tick, at rest; without one, the place of the tip."""
        before = [tick for tick in self.references if tick < state.tick]
        held = Reference.from_buffer_copy(self.references[max(before)]) if before else Reference(tick=state.tick)
        if not before:
            held.position[:], held.orientation[:] = state.foot_position, state.foot_orientation
        held.velocity[:], held.angular_velocity[:] = [0.0] * 3, [0.0] * 3
        return held

    def compute(self, state: State, reference: Reference, command: Command) -> Request:
        sets = self.sets
        p = sets.next if state.tick >= sets.next.effective_tick else sets.current
        n = self.chain.dof
        gains = p.joint_space
        if p.task != 0 or p.gravity_compensation or any((gains.stiffness, gains.damping, gains.joint_damping, gains.limit_stiffness)):
            raise HapficError(
                "found a pose task, gravity compensation or a law in joint space, expected controller.task = \"position\" "
                "without them: this package has no dynamics"
            )
        after = ControllerState.from_buffer_copy(command.request.state)
        tick = Tick(
            state=state,
            reference=reference,
            parameters=p,
            previous=command.request.state,
            position=np.array(state.foot_position),
            velocity=np.array(state.foot_velocity),
            target=np.array(reference.position),
            target_velocity=np.array(reference.velocity),
            force=np.array(state.foot_force),
            desired_force=np.array(p.desired_force),
            after=after,
        )
        force = np.asarray(self.controller.step(tick), dtype=float)
        limit = np.array(p.max_force)
        force = np.clip(force, -limit, limit)
        q, qd = np.array(state.joint_position[:n]), np.array(state.joint_velocity[:n])
        _, _, jacobian = self.chain.tip(q + p.posture_lead * qd)
        request = Request(
            stamp_ns=0 if self.run.lockstep else time.monotonic_ns(),
            tick=state.tick,
            state_tick=state.tick,
            parameters_version=p.version,
            controller=self.role,
            joints=n,
            limbs=1,
            state=after,
        )
        request.error[:], request.error_rate[:] = tick.target - tick.position, tick.target_velocity - tick.velocity
        request.force[:] = force
        request.torque[:n] = jacobian[:3].T @ force
        return request


def run_controller(controller: Controller) -> None:
    """Runs a controller as the process that hapfic has started; ends this program."""
    run_process("controller", lambda: _Loop(controller).main())
