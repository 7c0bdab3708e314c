"""A plant in Python, in place of hapfic's own: one overrides three methods."""

import time

import numpy as np

from .errors import HapficError
from .messages import Command, Drive, Mode, Phase, Process, State
from .process import ProcessLoop, WAIT_S, run_process, without_collector
from .runs import RunFile


class Plant:
    """The robot: override `begin`, `sample` and `advance`."""

    def begin(self, run: RunFile) -> None:
        """Builds robot and world from the settings of the run, in the start posture."""
        raise NotImplementedError

    def sample(self, state: State) -> None:
        """Measures: fills joints, foot, objects and contacts of a state. Tick, times and drive are filled already."""
        raise NotImplementedError

    def advance(self, drive: Drive, torque: np.ndarray) -> None:
        """Advances by a tick of 1 ms: with the brakes on (HELD), under a torque (TORQUE, [N m]), or damped (BRAKING)."""
        raise NotImplementedError

    def resume(self, state: State) -> bool:
        """Goes on from the last state of a predecessor; returns whether it can. The default cannot."""
        return False


class _Drive:
    """The drive: which command acts, and what happens without one."""

    def __init__(self, timeout_ticks: int):
        self._command: Command | None = None
        self._timeout, self.released = timeout_ticks, False

    @property
    def command_tick(self) -> int:
        return -1 if self._command is None else self._command.tick

    def take(self, command: Command) -> None:
        if command.tick > self.command_tick or self._command is None:
            self._command = command
            self.released |= command.mode == Mode.ACTIVE

    def act(self, tick: int, joints: int) -> tuple[Drive, np.ndarray]:
        command = self._command
        if command is None or not self.released:
            return Drive.HELD, np.zeros(joints)
        if tick - 1 - command.tick < self._timeout and command.mode == Mode.ACTIVE:
            return Drive.TORQUE, np.array(command.torque[:joints])
        return Drive.BRAKING, np.zeros(joints)


class _Loop(ProcessLoop):
    def __init__(self, plant: Plant):
        super().__init__({"plant": Process.PLANT})
        self.plant = plant
        self.state = self.bus.output("state", "plant", self.run.lockstep)
        self.command, self.credit = self.bus.input("command"), self.bus.input("credit")
        # Before the first message, so that no notification is missed.
        self.command_doorbell, self.credit_doorbell = (self.bus.doorbell_of(topic) for topic in ("command", "credit"))
        self.commands: dict[int, Command] = {}
        self.drive = _Drive(self.run.settings["plant"]["command_timeout_ticks"])
        self.last_drive = Drive.HELD
        #: Last state of a predecessor, until its tick is done.
        self.last: State | None = None

    def main(self) -> None:
        first = self.start()
        (self.lockstep if self.run.lockstep else self.realtime_loop)(first)
        self.finish()

    def read_commands(self) -> None:
        for command in self.command.all():
            # Of two gates the first counts.
            self.commands.setdefault(command.tick, command)
            for old in [tick for tick in self.commands if tick < command.tick - 8]:
                del self.commands[old]

    def sample(self, tick: int, lateness_ns: int, slipped: int) -> State:
        state = State(
            tick=tick,
            time_ns=tick * 10**6,
            command_tick=self.drive.command_tick,
            wake_lateness_ns=lateness_ns,
            slipped=slipped,
            drive=self.last_drive,
            limbs=1,
        )
        state.foot_orientation[3] = 1.0
        self.plant.sample(state)
        if not self.run.lockstep:
            state.stamp_ns = time.monotonic_ns()
        return state

    def start(self) -> int:
        """Gets ready, waits for the gate, and returns the first tick."""
        self.plant.begin(self.run)
        first = 0
        if self.run.generation > 0:
            kept = self.state.ring.read() if self.state.ring else []
            if kept and not self.plant.resume(kept[-1]):
                raise HapficError("this plant cannot go on from the last state. Hint: plant.on_loss = \"fail\"")
            for state in kept[-4:]:
                self.state.send_again(state)
            if kept:
                # It was measured before its tick was advanced.
                self.last, first = kept[-1], kept[-1].tick
                self.drive.released = self.last.drive != Drive.HELD
                self.last_drive = Drive(self.last.drive)
        without_collector()
        self.beat_ns = 0
        while not self.stop:
            self.beat(Phase.READY, -1)
            self.read_commands()
            if self.commands:
                break
            self.command_doorbell.wait(WAIT_S)
            self.state.connect()
        return first

    def lockstep(self, first: int) -> None:
        credit = -1
        for tick in range(first, self.ticks):
            while credit < tick and not self.stop:
                found = self.credit.all()
                credit = max([credit, *(message.tick for message in found)])
                if credit < tick:
                    self.credit_doorbell.wait(WAIT_S)
                    self.beat(Phase.WAITING, tick)
                    self.state.connect()
            if self.stop:
                return
            due = time.monotonic_ns()
            if self.last is None:
                self.state.send(self.sample(tick, 0, 0))
            self.last = None
            while not self.stop:
                self.read_commands()
                if tick - 1 in self.commands:
                    break
                self.state.connect()
                self.command_doorbell.wait(WAIT_S)
                self.beat(Phase.WAITING, tick)
            if self.stop:
                return
            self.step(tick)
            self.report(Phase.RUNNING, tick, due, due, time.monotonic_ns())

    def realtime_loop(self, first: int) -> None:
        period = 10**6
        begin, slipped = time.monotonic_ns() + 2 * period, 0
        if self.last is not None:
            # The periods without a plant count as slipped.
            slipped = self.last.slipped + max(0, begin - self.last.stamp_ns) // period
        start = begin - (first + slipped) * period
        for tick in range(first, self.ticks):
            due = start + (tick + slipped) * period
            while (now := time.monotonic_ns()) < due:
                time.sleep(max(0.0, (due - now) * 1e-9 - 5e-5))
            slipped += (now - due) // period
            self.state.send(self.sample(tick, now - due, slipped))
            published = time.monotonic_ns()
            self.read_commands()
            self.step(tick)
            self.report(Phase.RUNNING, tick, due, now, published)
            self.stop |= self.owner.has_gone()
            if self.stop:
                return

    def step(self, tick: int) -> None:
        """Takes the command that is due at a tick, the newest before it, and advances."""
        due = [command for command in self.commands if command < tick]
        if due:
            self.drive.take(self.commands[max(due)])
        self.last_drive, torque = self.drive.act(tick, self.joints)
        self.plant.advance(self.last_drive, torque)

    @property
    def joints(self) -> int:
        return len(self.run.settings["robot"]["start_position_rad"])


def run_plant(plant: Plant) -> None:
    """Runs a plant as the process that hapfic has started; ends this program."""
    run_process("plant", lambda: _Loop(plant).main())
