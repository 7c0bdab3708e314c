"""Running stacks of this user, and the file that a process of a run gets."""

import fcntl
import json
import os
import pathlib
import tempfile
import tomllib
from dataclasses import dataclass

from .errors import HapficError


@dataclass(frozen=True)
class Run:
    """A running stack."""

    #: Name, as in `hapfic status`.
    name: str
    #: Name of the scenario.
    scenario: str
    #: Path of the log.
    log: str

    @property
    def prefix(self) -> str:
        """Prefix of its shared memory."""
        return f"{self.name}_"

    @property
    def root(self) -> str:
        """Its folder."""
        return f"/dev/shm/{self.name}"


def runs() -> list[Run]:
    """The running stacks of this user."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    own = pathlib.Path(tempfile.gettempdir()) / f"hapfic-{os.getuid()}"
    folder = pathlib.Path(base) / "hapfic" if base and os.path.isdir(base) else own
    found = []
    for file in sorted(folder.glob("*.json")):
        try:
            entry = json.loads(file.read_text())
            run = Run(entry["run"], entry["scenario"], entry["log"])
        except (OSError, ValueError, KeyError):
            continue
        if os.path.isdir(run.root) and _is_held(file):
            found.append(run)
    return found


def _is_held(file: pathlib.Path) -> bool:
    """Whether launcher or supervisor lives: they hold the lock of their registration."""
    try:
        with open(file) as opened:
            fcntl.flock(opened, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    return False


def find_run(name: str | None = None) -> Run:
    """The run of a name; without one, the only run.

    Raises HapficError if there is no such run, or several.
    """
    found = [run for run in runs() if name in (None, run.name)]
    if len(found) == 1:
        return found[0]
    wanted = f"a run named {name}" if name else "one running stack"
    names = ", ".join(run.name for run in runs()) or "none"
    raise HapficError(f"found {names}, expected {wanted}. Hint: `hapfic run` starts one, `hapfic status` lists them")


@dataclass(frozen=True)
class RunFile:
    """What the supervisor tells a process of a run; `$HAPFIC_RUN` names the file."""

    prefix: str
    root: str
    scenario: str
    #: "realtime" or "lockstep".
    clock: str
    launcher_pid: int
    #: The effective settings, as `hapfic check` has them.
    settings: dict
    #: Text of the robot's URDF.
    urdf: str
    #: Role of this process, and the number of its start.
    process: str
    generation: int

    @property
    def lockstep(self) -> bool:
        return self.clock == "lockstep"

    @classmethod
    def from_environment(cls) -> "RunFile":
        """Reads the run that the environment names.

        Raises HapficError outside of a run.
        """
        path = os.environ.get("HAPFIC_RUN")
        if path is None:
            raise HapficError(
                "found no HAPFIC_RUN, expected to be started by hapfic. Hint: [processes] in a scenario names this program"
            )
        try:
            text = json.loads(pathlib.Path(path).read_text())
            return cls(
                prefix=text["prefix"],
                root=text["root"],
                scenario=text["scenario"],
                clock=text["clock"],
                launcher_pid=text["launcher_pid"],
                settings=tomllib.loads(text["settings"]),
                urdf=text["urdf"],
                process=os.environ.get("HAPFIC_PROCESS", "plant"),
                generation=int(os.environ.get("HAPFIC_GENERATION", "0")),
            )
        except (OSError, ValueError, KeyError) as cause:
            raise HapficError(f"{path}: found {cause!r}, expected the run file of hapfic") from cause
