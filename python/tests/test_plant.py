"""A foreign plant in lockstep."""

import json
import pathlib
import sys

import numpy as np
import pytest

import hapfic

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"


def run(stack, tmp_path, scenario, example, *more, seconds="3", code=0):
    plant = json.dumps([sys.executable, str(EXAMPLES / example)])
    base = ["run", scenario, "--clock", "lockstep", "--duration", seconds, "--log", "run.mcap"]
    process = stack(*base, "--set", f"processes.plant={plant}", *more)
    output, errors = process.communicate(timeout=120)
    assert process.returncode == code, output + errors
    return tmp_path / "run.mcap", output + errors


def test_point_plant_moves_and_log_is_complete(stack, tmp_path):
    log, _ = run(stack, tmp_path, "floor", "point_plant.py")
    data = hapfic.read_log(str(log), ["/state", "/command"])
    state = data["/state"]
    assert len(state["time_s"]) == 3000 and np.allclose(np.diff(state["time_s"]), 1e-3)
    assert len(data["/command"]["time_s"]) == 3000


def test_kills_of_the_others_change_no_byte(stack, tmp_path):
    fault = '{kind="kill",process=["controller","planner","gate","recorder","supervisor"],random={count=12,from_s=0.1,to_s=2.8}}'
    logs = []
    for more in ([], ["--set", f"fault=[{fault}]", "--set", "supervisor.restart_budget=1000"]):
        log, _ = run(stack, tmp_path, "floor", "point_plant.py", *more)
        logs.append(hapfic.read_log(str(log), ["/state", "/command"]))
    for field in ("joint_position", "joint_velocity"):
        assert np.array_equal(logs[0]["/state"][field], logs[1]["/state"][field])
    assert np.array_equal(logs[0]["/command"]["torque"], logs[1]["/command"]["torque"])


def test_restart_goes_on(stack, tmp_path):
    fault = 'fault=[{kind="kill",process="plant",at_s=1.5}]'
    log, _ = run(stack, tmp_path, "floor", "point_plant.py", "--set", fault, "--set", 'plant.on_loss="restart"')
    assert len(hapfic.read_log(str(log), ["/state"])["/state"]["time_s"]) == 3000


@pytest.mark.parametrize(
    "line, words",
    [
        ("raise SystemExit('no robot')", "plant"),
        ("import time; time.sleep(60)", "did not get ready in time"),
    ],
)
def test_plant_that_never_works_is_named(stack, tmp_path, line, words):
    plant = json.dumps([sys.executable, "-c", line])
    process = stack(
        "run", "floor", "--clock", "lockstep", "--duration", "1", "--log", "run.mcap",
        "--set", f"processes.plant={plant}", "--set", "supervisor.ready_timeout_ms=1500",
    )  # fmt: skip
    output, errors = process.communicate(timeout=60)
    assert process.returncode != 0 and words in output + errors, output + errors


def test_plant_with_nan_is_rejected(stack, tmp_path):
    code = (
        f"import sys; sys.path.insert(0, {str(EXAMPLES)!r})\n"
        "import hapfic, point_plant\n"
        "class Bad(point_plant.PointPlant):\n"
        "    def sample(self, state):\n"
        "        super().sample(state)\n"
        "        if state.tick == 500: state.joint_velocity[0] = float('nan')\n"
        "hapfic.run_plant(Bad())\n"
    )
    plant = json.dumps([sys.executable, "-c", code])
    process = stack(
        "run", "floor", "--clock", "lockstep", "--duration", "1", "--log", "run.mcap",
        "--set", f"processes.plant={plant}", "--set", "supervisor.stall_timeout_ms=1000", "--set", "supervisor.restart_budget=1",
    )  # fmt: skip
    output, errors = process.communicate(timeout=60)
    assert process.returncode != 0 and "rejected" in output + errors, output + errors


def test_mujoco_holds_the_force(stack, tmp_path):
    pytest.importorskip("mujoco")
    log, _ = run(stack, tmp_path, "floor", "mujoco_plant.py", seconds="4")
    state = hapfic.read_log(str(log), ["/state"])["/state"]
    force = state["foot_force"][-200:, 2]
    assert abs(force.mean() - 50.0) < 0.1, force.mean()
