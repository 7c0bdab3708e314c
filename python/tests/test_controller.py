"""A controller in Python, judged by the gate like ours."""

import json
import pathlib
import sys

import numpy as np

import hapfic

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"


def run(stack, tmp_path, name, *more):
    controller = json.dumps([sys.executable, str(EXAMPLES / "impedance.py")])
    base = ["run", "floor", "--clock", "lockstep", "--duration", "4", "--log", f"{name}.mcap"]
    process = stack(*base, "--set", f"processes.controller={controller}", *more)
    output, errors = process.communicate(timeout=120)
    assert process.returncode == 0, output + errors
    return hapfic.read_log(str(tmp_path / f"{name}.mcap"))


def test_impedance_presses_and_gate_accepts_it(stack, tmp_path):
    data = run(stack, tmp_path, "run")
    command = data["/command"]
    assert len(command["time_s"]) == 4000
    # All but the first ticks were answered, and no torque was refused.
    assert set(command["source"][100:]) == {command["source"][200]}
    force = data["/state"]["foot_force"][-200:, 2]
    # It presses with F_d and the spring: without a search the target below the floor costs K times its depth.
    commanded = command["force"][-200:, 2]
    # The leg's weight, which nobody compensates, rests on the foot too.
    weight = force.mean() + commanded.mean()
    assert -commanded.mean() > 60.0 and 5.0 < weight < 20.0, (force.mean(), commanded.mean())


def test_either_controller_goes_on(stack, tmp_path):
    plain = run(stack, tmp_path, "plain")
    fault = '{kind="kill",process=["controller","standby"],random={count=6,from_s=0.3,to_s=3.5}}'
    killed = run(stack, tmp_path, "killed", "--set", f"fault=[{fault}]", "--set", "supervisor.restart_budget=100")
    for field in ("joint_position", "joint_torque"):
        assert np.array_equal(plain["/state"][field], killed["/state"][field]), field


def test_jacobian_is_the_derivative_of_the_position():
    text = (pathlib.Path(__file__).parents[2] / "config/robots/leg.urdf").read_text()
    chain = hapfic.Chain(text, "base", "foot")
    assert chain.dof == 3
    rng = np.random.default_rng(1)
    for q in rng.uniform(-1, 1, (20, 3)):
        position, rotation, jacobian = chain.tip(q)
        assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        for joint in range(3):
            step = np.zeros(3)
            step[joint] = 1e-6
            difference = (chain.tip(q + step)[0] - chain.tip(q - step)[0]) / 2e-6
            assert np.allclose(difference, jacobian[:3, joint], atol=1e-8)
