"""HapFIC from Python: look at a running stack and change it, take the place of its plant or controllers, read its logs.

>>> import hapfic
>>> with hapfic.Client() as client:              # the only run of this user
...     client.set(desired_force=[0.0, 0.0, 60.0])
...     for state in client.follow("state", seconds=2.0):
...         print(state.tick, list(state.foot_force))

Units are SI. `docs/external-processes.md` of the repository is the contract that this package keeps.
"""

from .client import Client, Refused
from .controller import Controller, Tick, run_controller
from .errors import HapficError
from .log import read_log
from .messages import VERSION
from .plant import Plant, run_plant
from .robot import Chain
from .runs import Run, find_run, runs

__all__ = [
    "Chain",
    "Client",
    "Controller",
    "HapficError",
    "Plant",
    "Refused",
    "Run",
    "VERSION",
    "find_run",
    "read_log",
    "Tick",
    "run_controller",
    "run_plant",
    "runs",
]
