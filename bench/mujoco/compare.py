#!/usr/bin/env python3
"""Compares cost and error of the plant's sub-step with MuJoCo's on three scenes, each error against the own reference."""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys

import mujoco
import runs
import scenes

SCENES = ("floor", "box", "ball")
BENCH = pathlib.Path(__file__).resolve().parent.parent


def run_substep(program, *arguments):
    """Runs hapfic-substep, and returns its JSON output."""
    process = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    if process.returncode != 0:
        raise RuntimeError(f"{program} {' '.join(arguments)}: exit code {process.returncode}: {process.stderr.strip()}")
    return json.loads(process.stdout)


def measure_costs(program, names, described, rounds):
    """Returns the costs of each scene. Each round runs the plant, Euler, the plant, implicitfast."""
    costs = {name: {"plant": [], **{integrator: [] for integrator in scenes.INTEGRATORS}, "ratio": {}} for name in names}
    ratios = {name: {integrator: [] for integrator in scenes.INTEGRATORS} for name in names}
    for _ in range(rounds):
        for name in names:
            for integrator in scenes.INTEGRATORS:
                plant = run_substep(program, "time", name)["ns_per_substep"]
                mujoco_cost = runs.cost(name, described[name], integrator)
                costs[name]["plant"].append(plant)
                costs[name][integrator].append(mujoco_cost)
                ratios[name][integrator].append(mujoco_cost["median"] / plant["median"])
    for name, cost in costs.items():
        for simulator in ("plant", *scenes.INTEGRATORS):
            cost[simulator] = {key: statistics.median(run[key] for run in cost[simulator]) for key in ("median", "mean")}
        for integrator, found in ratios[name].items():
            cost["ratio"][integrator] = {"median": statistics.median(found), "least": min(found), "most": max(found)}
    return costs


def table(results):
    """Returns costs and errors as text."""
    lines = [
        f"{'ns per sub-step':<16}{'plant':>8}{'Euler':>9}{'implicitfast':>14}{'Euler/plant':>24}{'implicitfast/plant':>24}",
    ]
    for name, result in results.items():
        cost = result["cost"]
        ratio = [f"{r['median']:.2f} ({r['least']:.2f} to {r['most']:.2f})" for r in cost["ratio"].values()]
        lines.append(
            f"{name:<16}{cost['plant']['median']:>8.0f}{cost['euler']['median']:>9.0f}{cost['implicitfast']['median']:>14.0f}"
            f"{ratio[0]:>24}{ratio[1]:>24}"
        )
    if all("error" in result for result in results.values()):
        lines += [
            "",
            f"{'error':<8}{'':<14}{'foot, um: max':>14}{'rms':>9}{'force, N: max':>15}{'rms':>10}"
            f"{'reference, us':>15}{'its last change, % of error':>29}",
        ]
        for name, result in results.items():
            plant, mujoco_errors = result["error"]["plant"], result["error"]["mujoco"]
            rows = [("plant", plant["error"], plant)]
            rows += [(simulator, error, mujoco_errors) for simulator, error in mujoco_errors["error"].items()]
            for simulator, error, own in rows:
                # The reference is refined until Euler's error converges; implicitfast has the same limit.
                change = max(own["reference_change"][key] / error[key] for key in error)
                lines.append(
                    f"{name:<8}{simulator:<14}{error['foot_max_m'] * 1e6:>14.3f}{error['foot_rms_m'] * 1e6:>9.3f}"
                    f"{error['force_max_n']:>15.4f}{error['force_rms_n']:>10.5f}{own['reference_us']:>15.4g}{100 * change:>29.2f}"
                )
    return "\n".join(lines)


def arguments():
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ours", default=str(BENCH / "target/release/hapfic-substep"), help="program hapfic-substep, built")
    parser.add_argument("--rounds", type=int, default=10, help="rounds of timing (default %(default)s)")
    parser.add_argument("--scene", action="append", choices=SCENES, help="only this scene; repeatable")
    parser.add_argument("--cpu", type=int, help="core of all measurements")
    parser.add_argument("--finest", type=int, default=128, help="shortest sub-step of the reference, 1/N of the compared one")
    parser.add_argument("--no-error", action="store_true", help="measure costs only")
    parser.add_argument("--json", metavar="FILE", help="write all figures to this file")
    given = parser.parse_args()
    if given.rounds < 1:
        parser.error(f"--rounds: found {given.rounds}, expected 1 or more")
    if given.finest < runs.COARSEST:
        parser.error(f"--finest: found {given.finest}, expected {runs.COARSEST} or more")
    if given.cpu is not None and given.cpu not in os.sched_getaffinity(0):
        parser.error(f"--cpu: found {given.cpu}, expected one of {sorted(os.sched_getaffinity(0))}")
    if not os.access(given.ours, os.X_OK):
        parser.error(f"--ours: found no program at {given.ours}; in bench/ run: cargo build --release -p hapfic-bench-substep")
    return given


def main():
    """Measures all scenes, and prints the tables."""
    given = arguments()
    if given.cpu is not None:
        os.sched_setaffinity(0, {given.cpu})
    names = given.scene or list(SCENES)
    described = {name: run_substep(given.ours, "model", name) for name in names}
    costs = measure_costs(given.ours, names, described, given.rounds)
    results = {name: {"cost": costs[name]} for name in names}
    if not given.no_error:
        for name in names:
            plant_errors = run_substep(given.ours, "error", name)
            results[name]["error"] = {"plant": plant_errors, "mujoco": runs.accuracy(name, described[name], given.finest)}
    print(table(results))
    if given.json:
        everything = {"mujoco": mujoco.__version__, "rounds": given.rounds, "scenes": results}
        pathlib.Path(given.json).write_text(json.dumps(everything, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except (RuntimeError, scenes.Mismatch, OSError, ValueError) as error:
        sys.exit(f"compare.py: {error}")
