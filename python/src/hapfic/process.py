"""What every process of a run does: it joins, shows that it lives, and ends in order."""

import ctypes
import gc
import os
import signal
import sys
import time
from typing import Callable

from .errors import HapficError
from .messages import Phase, Process, Timing
from .pages import Heartbeat, Owner
from .runs import RunFile
from .transport import Bus

#: Length of a tick [s].
PERIOD_S = 1e-3
#: Longest wait without a heartbeat [s].
WAIT_S = 0.05


class ProcessLoop:
    """A process of a run."""

    def __init__(self, roles: dict[str, Process]):
        self.run = RunFile.from_environment()
        if self.run.process not in roles:
            raise HapficError(f"found the role '{self.run.process}', expected {' or '.join(roles)}. Hint: [processes]")
        self.role, self.stop, self.beat_ns = roles[self.run.process], False, 0
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)
        self.bus = Bus(self.run.prefix, self.run.root, self.run.process, 200 if self.run.lockstep else 5)
        self.owner = Owner(self.run.root, self.run.settings["supervisor"]["grace_ms"])
        self.heartbeat = Heartbeat(self.run.root, self.role, self.run.generation)
        self.timing = self.bus.output("timing", self.run.process, self.run.lockstep)
        self.ticks = round(self.run.settings["duration_s"] / PERIOD_S)
        self.rejected = 0
        self.realtime = self._rights()

    def _end(self, *_) -> None:
        self.stop = True

    def _rights(self) -> int:
        """Locks memory; returns the rights in force as bits."""
        locked = ctypes.CDLL(None).mlockall(3) == 0
        fifo = os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_FIFO | getattr(os, "SCHED_RESET_ON_FORK", 0))
        pinned = len(os.sched_getaffinity(0)) == 1
        return 0 if self.run.lockstep else fifo | locked << 1 | pinned << 2

    def beat(self, phase: Phase, tick: int) -> None:
        """Heartbeat of a process that waits, at most every 20 ms."""
        now = time.monotonic_ns()
        if now - self.beat_ns >= 20_000_000:
            self.stop |= self.owner.has_gone()
            self.report(phase, tick, now, now, 0)

    def report(self, phase: Phase, tick: int, due_ns: int, wake_ns: int, publish_ns: int) -> None:
        """Heartbeat with the times of a tick."""
        self.beat_ns = time.monotonic_ns()
        self.heartbeat.write(phase, tick, self.realtime, self.rejected)
        self.timing.send(
            Timing(
                process=self.role,
                phase=phase,
                tick=tick,
                due_ns=due_ns,
                wake_ns=wake_ns,
                publish_ns=publish_ns,
                rejected=self.rejected,
                realtime=self.realtime,
                generation=self.run.generation,
            )
        )

    def finish(self) -> None:
        """Reports the end, and waits for the supervisor: the last messages live as long as their sender."""
        while not self.stop:
            self.report(Phase.FINISHED, self.ticks - 1, 0, 0, 0)
            self.stop |= self.owner.has_gone()
            time.sleep(WAIT_S)


def without_collector() -> None:
    """Ends the automatic collection of garbage: the loop makes none in cycles."""
    gc.collect()
    gc.freeze()
    gc.disable()


def run_process(name: str, main: Callable[[], None]) -> None:
    """Runs a process to its end, and ends this program: 0, or 2 with one line on standard error."""
    try:
        main()
        code = 0
    except HapficError as error:
        print(f"{name}: {error}", file=sys.stderr)
        code = 2
    # Destructors of shared memory at the end of the interpreter come in no order.
    sys.stderr.flush()
    os._exit(code)
