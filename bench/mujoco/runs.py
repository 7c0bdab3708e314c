"""Runs of MuJoCo through a scene: cost of a sub-step, and error against the own converged reference."""

import time

import mujoco
import numpy as np

import scenes

WARM_UP = 200
# Coarsest reference: the compared sub-step over this number.
COARSEST = 32


def _servo(description):
    """Returns the plan's torque as a function of tick, positions and velocities."""
    plan = description["plan"]
    position, velocity, torque = (np.array(plan[key]) for key in ("position", "velocity", "torque"))
    stiffness, damping = plan["stiffness"], plan["damping"]
    return lambda k, q, qd: torque[k] + stiffness * (position[k] - q) + damping * (velocity[k] - qd)


def _steps(description, substep_s):
    return round(description["tick_s"] / substep_s)


def _timed(model, description, ticks):
    """Returns the computing time of each tick [s]. MuJoCo loops over the sub-steps; the servo is not counted."""
    data, servo = scenes.start(model, description), _servo(description)
    steps, durations = _steps(description, model.opt.timestep), np.zeros(ticks)
    for tick in range(ticks):
        data.qfrc_applied[:3] = servo(tick, data.qpos[:3], data.qvel[:3])
        begin = time.perf_counter()
        mujoco.mj_step(model, data, nstep=steps)
        durations[tick] = time.perf_counter() - begin
    return durations


def cost(name, description, integrator):
    """Returns the time per sub-step of one run after a warm-up run [ns]: median over the ticks, and mean."""
    model = scenes.load(name, description, integrator, sensors=False)
    _timed(model, description, WARM_UP)
    ns = _timed(model, description, description["ticks"]) * 1e9 / _steps(description, model.opt.timestep)
    return {"median": float(np.median(ns)), "mean": float(ns.mean())}


def sampled(name, description, integrator, refined=1):
    """Returns foot position [m] and mean force on it [N] of each tick, and the largest vertical force of a sub-step [N]."""
    model = scenes.load(name, description, integrator)
    model.opt.timestep = description["substep_s"] / refined
    data, servo = scenes.start(model, description), _servo(description)
    ticks, steps = description["ticks"], _steps(description, model.opt.timestep)
    foot, force, peak = np.zeros((ticks, 3)), np.zeros((ticks, 3)), 0.0
    sensed = data.sensor("foot_force").data
    site = model.site("foot").id
    for tick in range(ticks):
        data.qfrc_applied[:3] = servo(tick, data.qpos[:3], data.qvel[:3])
        total = np.zeros(3)
        for _ in range(steps):
            mujoco.mj_step(model, data)
            # The sensor holds the force at the beginning of the sub-step, which acts throughout, as the foot exerts it.
            total -= sensed
            peak = max(peak, -sensed[2])
        mujoco.mj_kinematics(model, data)
        foot[tick], force[tick] = data.site_xpos[site], total / steps
    if not (np.isfinite(foot).all() and np.isfinite(force).all()) or data.time < 0.99 * ticks * description["tick_s"]:
        raise RuntimeError(f"{name}: found a state of MuJoCo's {integrator} that is not finite at {model.opt.timestep * 1e6} us")
    return foot, force, peak


def distance(a, b):
    """Returns the largest and root mean square distance between two runs, with the keys of bench/substep."""
    out = {}
    for key, unit, one, other in (("foot", "m", a[0], b[0]), ("force", "n", a[1], b[1])):
        norms = np.linalg.norm(one - other, axis=1)
        out[f"{key}_max_{unit}"], out[f"{key}_rms_{unit}"] = float(norms.max()), float(np.sqrt((norms**2).mean()))
    return out


def accuracy(name, description, finest):
    """Returns the errors of both integrators against the converged reference.

    The reference is Euler at 1/32 of the sub-step or less: its sub-step is halved until halving changes every figure by
    less than 1 % of Euler's error, or 1/finest is reached.
    """
    found = {integrator: sampled(name, description, integrator) for integrator in scenes.INTEGRATORS}
    refined = COARSEST
    coarser = sampled(name, description, "euler", refined // 2)
    while True:
        reference = sampled(name, description, "euler", refined)
        error, change = distance(found["euler"], reference), distance(coarser, reference)
        if all(change[key] < 0.01 * error[key] for key in error) or 2 * refined > finest:
            break
        coarser, refined = reference, 2 * refined
    tail = found["euler"][1][-(description["ticks"] // 10) :, 2]
    return {
        "substep_us": description["substep_s"] * 1e6,
        "reference_us": description["substep_s"] * 1e6 / refined,
        "error": {integrator: distance(run, reference) for integrator, run in found.items()},
        "reference_change": change,
        "peak_n": found["euler"][2],
        "reference_peak_n": reference[2],
        "settled_n": float(tail.mean()),
        "end_m": found["euler"][0][-1].tolist(),
    }
