"""A plant in Python, in place of hapfic's own: one overrides three methods."""

import ctypes
import gc
import os
import signal
import sys
import time

import numpy as np

from .errors import HapficError
from .messages import Command, Drive, Mode, Phase, Process, State, Timing
from .pages import Heartbeat, Owner
from .runs import RunFile
from .transport import Bus

#: Length of a tick [s].
PERIOD_S = 1e-3
_WAIT_S = 0.05


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
        self._timeout, self._released = timeout_ticks, False

    @property
    def command_tick(self) -> int:
        return -1 if self._command is None else self._command.tick

    def take(self, command: Command) -> None:
        if command.tick > self.command_tick or self._command is None:
            self._command = command
            self._released |= command.mode == Mode.ACTIVE

    def act(self, tick: int, joints: int) -> tuple[Drive, np.ndarray]:
        command = self._command
        if command is None or not self._released:
            return Drive.HELD, np.zeros(joints)
        if tick - 1 - command.tick < self._timeout and command.mode == Mode.ACTIVE:
            return Drive.TORQUE, np.array(command.torque[:joints])
        return Drive.BRAKING, np.zeros(joints)


class _Loop:
    def __init__(self, plant: Plant):
        self.run = RunFile.from_environment()
        if self.run.process != "plant":
            raise HapficError(f"found the role '{self.run.process}', expected 'plant'. Hint: [processes] plant = [...]")
        self.plant, self.stop, self.beat_ns = plant, False, 0
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)
        bus = Bus(self.run.prefix, self.run.root, "plant")
        settings = self.run.settings
        self.owner = Owner(self.run.root, settings["supervisor"]["grace_ms"])
        self.heartbeat = Heartbeat(self.run.root, Process.PLANT, self.run.generation)
        self.state = bus.output("state", "plant", self.run.lockstep)
        self.timing = bus.output("timing", "plant", self.run.lockstep)
        self.command, self.credit = bus.input("command"), bus.input("credit")
        # Before the first message, so that no notification is missed.
        self.command_doorbell, self.credit_doorbell = bus.doorbells[3], bus.doorbells[4]
        self.commands: dict[int, Command] = {}
        self.drive = _Drive(settings["plant"]["command_timeout_ticks"])
        self.last_drive = Drive.HELD
        self.ticks = round(settings["duration_s"] / PERIOD_S)
        self.rejected = 0
        self.realtime = 0

    def _end(self, *_) -> None:
        self.stop = True

    def beat(self, phase: Phase, tick: int) -> None:
        """Heartbeat, at most every 20 ms while waiting."""
        now = time.monotonic_ns()
        if now - self.beat_ns < 20_000_000:
            return
        self.beat_ns = now
        self.stop |= self.owner.has_gone()
        self.report(phase, tick, now, now, 0)

    def report(self, phase: Phase, tick: int, due_ns: int, wake_ns: int, publish_ns: int) -> None:
        self.heartbeat.write(phase, tick, self.realtime, self.rejected)
        self.timing.send(
            Timing(
                process=Process.PLANT,
                phase=phase,
                tick=tick,
                due_ns=due_ns,
                wake_ns=wake_ns,
                publish_ns=publish_ns,
                realtime=self.realtime,
                generation=self.run.generation,
            )
        )

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
            kept = [state for state in self.state.ring.read()] if self.state.ring else []
            if not kept or not self.plant.resume(kept[-1]):
                raise HapficError("this plant cannot go on from the last state. Hint: plant.on_loss = \"fail\"")
            for state in kept[-4:]:
                self.state.send_again(state)
            first = kept[-1].tick + 1
            self.drive._released = kept[-1].drive != Drive.HELD
            self.last_drive = Drive(kept[-1].drive)
        gc.collect()
        gc.freeze()
        gc.disable()
        self.beat_ns = 0
        while not self.stop:
            self.beat(Phase.READY, -1)
            self.read_commands()
            if self.commands:
                break
            self.command_doorbell.wait(_WAIT_S)
            self.state.connect()
        return first

    def lockstep(self, first: int) -> None:
        credit = -1
        for tick in range(first, self.ticks):
            while credit < tick and not self.stop:
                found = self.credit.all()
                credit = max([credit, *(message.tick for message in found)])
                if credit < tick:
                    self.credit_doorbell.wait(_WAIT_S)
                    self.beat(Phase.WAITING, tick)
                    self.state.connect()
            if self.stop:
                return
            due = time.monotonic_ns()
            self.state.send(self.sample(tick, 0, 0))
            while not self.stop:
                self.read_commands()
                if tick - 1 in self.commands:
                    break
                self.state.connect()
                self.command_doorbell.wait(_WAIT_S)
                self.beat(Phase.WAITING, tick)
            if self.stop:
                return
            self.step(tick)
            self.report(Phase.RUNNING, tick, due, due, time.monotonic_ns())

    def realtime_loop(self, first: int) -> None:
        period = 10**6
        start, slipped = time.monotonic_ns() + 2 * period - first * period, 0
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

    def finish(self) -> None:
        """Reports the end, and waits for the supervisor: the last messages live as long as their sender."""
        while not self.stop:
            self.beat_ns = 0
            self.beat(Phase.FINISHED, self.ticks - 1)
            time.sleep(_WAIT_S)


def run_plant(plant: Plant) -> None:
    """Runs a plant as the process that hapfic has started; ends this program."""
    try:
        loop = _Loop(plant)
        ctypes.CDLL(None).mlockall(3)
        first = loop.start()
        (loop.lockstep if loop.run.lockstep else loop.realtime_loop)(first)
        loop.finish()
    except HapficError as error:
        print(f"plant: {error}", file=sys.stderr)
        os._exit(2)
    # Destructors of shared memory at the end of the interpreter come in no order.
    sys.stderr.flush()
    os._exit(0)
