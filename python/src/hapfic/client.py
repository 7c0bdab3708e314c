"""An operator's view of a running stack."""

import json
import time
from typing import Any, Iterator

from .errors import HapficError
from .messages import DOORBELLS, OperatorKind, OperatorReply, OperatorRequest, ReplyCode
from .runs import Run, find_run, runs
from .transport import Bus


class Refused(HapficError):
    """The stack refused a request; nothing has changed."""


class Client:
    """Looks at a run, and changes it as `hapfic set` and its like do.

    It joins the observers' topics alone, which the recorder republishes every 10 ms, so the control loop never notices it.
    """

    def __init__(self, run: str | Run | None = None):
        self.run = run if isinstance(run, Run) else find_run(run)
        self._bus = Bus(self.run.prefix, self.run.root, "client")
        self._inputs: dict = {}
        self._caller = None

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Leaves the run."""
        self._inputs.clear()
        self._caller = self._bus = None

    def receive(self, topic: str) -> list:
        """Messages of a topic since the last call, the oldest first: "state", "reference", "request", "command",
        "operator", "event" or "timing". The first call gets those from then on."""
        if topic not in self._inputs:
            self._inputs[topic] = _patiently(lambda: self._bus.input(f"view/{topic}", 64))
        return self._inputs[topic].all()

    def follow(self, topic: str, seconds: float = float("inf")) -> Iterator:
        """Messages of a topic as they come, until a time [s] is over or the run has ended."""
        quiet = time.monotonic()
        until = quiet + seconds
        while time.monotonic() < until:
            found = self.receive(topic)
            yield from found
            if found:
                quiet = time.monotonic()
            elif time.monotonic() - quiet > 0.2:
                if not _lives(self.run):
                    return
                quiet = time.monotonic()
            else:
                time.sleep(0.002)

    def newest(self, topic: str, timeout: float = 2.0) -> Any:
        """The newest message of a topic.

        Raises HapficError if none comes within the time [s].
        """
        until = time.monotonic() + timeout
        while time.monotonic() < until:
            if found := self.receive(topic):
                return found[-1]
            time.sleep(0.002)
        raise HapficError(f"found no message on '{topic}' within {timeout} s, expected a running stack")

    def set(self, *, force: bool = False, dry_run: bool = False, **changes: Any) -> str:
        """Changes parameters, all at one tick; returns what the stack says of it, with its warnings.

        Keys are those of an operator entry: `desired_force=[0, 0, 60]`; single axes as `**{"stiffness.z": 9000}`.
        Raises Refused if the change is invalid, or dangerous without `force`.
        """
        kind = OperatorKind.SET_DRY_RUN if dry_run else OperatorKind.SET_FORCED if force else OperatorKind.SET
        return self._ask(kind, "\0".join(f"{key}={_toml(value)}" for key, value in changes.items()))

    def get(self, *keys: str) -> dict:
        """The parameters in force, all or some, by their names with units: `desired_force_n`."""
        import tomllib

        return tomllib.loads(self._ask(OperatorKind.GET, "\0".join(keys)))

    def status(self) -> dict:
        """State of run and processes, as `hapfic status --json`."""
        return json.loads(self._ask(OperatorKind.STATUS))

    def estop(self) -> str:
        """Latched stop: the drive brakes until `rearm`."""
        return self._ask(OperatorKind.EMERGENCY_STOP)

    def rearm(self) -> str:
        """Leaves a latched stop."""
        return self._ask(OperatorKind.REARM)

    def stop(self) -> str:
        """Ends the run in order."""
        return self._ask(OperatorKind.STOP)

    def inject(self, **fault: Any) -> str:
        """Injects a fault: `kind="kill", process="planner"`."""
        return self._ask(OperatorKind.INJECT, "\0".join(f"{key}={_toml(value)}" for key, value in fault.items()))

    def _ask(self, kind: OperatorKind, text: str = "", timeout: float = 5.0) -> str:
        if self._caller is None:
            self._caller = _patiently(lambda: self._bus.client(OperatorRequest, OperatorReply))
        data = text.encode()
        most = OperatorRequest.text.size
        if len(data) > most:
            raise HapficError(f"found a request of {len(data)} bytes, expected at most {most}")
        request = OperatorRequest(kind=kind, text_len=len(data))
        request.text[: len(data)] = data
        until = time.monotonic() + timeout
        # The supervisor of a run that starts, or that has a new one, answers a moment later.
        while (pending := self._caller.send_copy(request)).number_of_server_connections == 0 and time.monotonic() < until:
            time.sleep(0.01)
        self._bus.doorbells[DOORBELLS["OPERATOR_REQUEST"]].notify()
        while time.monotonic() < until:
            response = pending.receive()
            if response is not None:
                reply = OperatorReply.from_buffer_copy(response.payload().contents)
                answer = bytes(reply.text[: reply.text_len]).decode()
                if reply.code != ReplyCode.DONE:
                    raise Refused(answer)
                return answer
            time.sleep(0.0005)
        raise HapficError(f"the run has not answered within {timeout} s: its supervisor hangs, or it has ended")


def _patiently(open_port, timeout: float = 2.0):
    """Opens a port of a run that may still be starting."""
    until = time.monotonic() + timeout
    while True:
        try:
            return open_port()
        except HapficError:
            if time.monotonic() > until:
                raise
            time.sleep(0.02)


def _lives(run: Run) -> bool:
    return any(other.name == run.name for other in runs())


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    return repr(list(value)) if isinstance(value, (list, tuple)) else repr(value)
