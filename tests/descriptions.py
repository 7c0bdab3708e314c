#!/usr/bin/env python3
"""Compares the robot model with Pinocchio on descriptions from public packages.

    tests/descriptions.py --fetch FOLDER      clones the packages into FOLDER (1 GB)
    tests/descriptions.py FOLDER              compares; prints a table per package and the worst differences
    tests/descriptions.py --hold FOLDER       presses with six of the robots and pushes them, with the gains of `hapfic calibrate` alone

Needs `cargo build --release`, `cargo build --release -p hapfic-robot --example model`, the same with `-p hapfic-simulation
--example hold`, and `pip install pin numpy`. It is not part of the tests, and no description is kept in this repository. A chain is the longest one from the root of a file that the stack can take (1 to 16 movable
joints, no mimic, planar or floating joint in it); the posture is random within the limits, the other joints are locked.
"""
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections import defaultdict

PACKAGES = {
    "example-robot-data": "https://github.com/Gepetto/example-robot-data",
    "bullet3": "https://github.com/bulletphysics/bullet3",
    "unitree_ros": "https://github.com/unitreerobotics/unitree_ros",
    "urdf_files_dataset": "https://github.com/Daniella1/urdf_files_dataset",
    "robot-assets": "https://github.com/ankurhanda/robot-assets",
}
MODEL = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "target", "release", "examples", "model")
HOLD = os.path.join(os.path.dirname(MODEL), "hold")
HAPFIC = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "target", "release", "hapfic")
MOVABLE = ("revolute", "continuous", "prismatic")
FILES_PER_PACKAGE = 2000


def fetch(folder):
    os.makedirs(folder, exist_ok=True)
    for name, url in PACKAGES.items():
        target = os.path.join(folder, name)
        if not os.path.exists(target):
            subprocess.run(["git", "clone", "--depth", "1", url, target], check=True)


def chain(path):
    """Root and tip of the longest chain that the stack can take; None without one."""
    try:
        root = ET.parse(path).getroot()
    except ET.ParseError:
        return None
    if root.tag != "robot":
        return None
    below, parents, names = defaultdict(list), set(), [link.get("name") for link in root.findall("link")]
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            continue
        below[parent.get("link")].append((joint, child.get("link")))
        parents.add(child.get("link"))
    roots = [name for name in names if name not in parents]
    if len(roots) != 1:
        return None
    best, stack = None, [(roots[0], 0)]
    seen = set()
    while stack:
        link, count = stack.pop()
        if link in seen:
            return None
        seen.add(link)
        if 0 < count <= 16 and (best is None or count > best[1]):
            best = (link, count)
        for joint, child in below[link]:
            kind = joint.get("type")
            if kind == "fixed":
                stack.append((child, count))
            elif kind in MOVABLE and joint.find("mimic") is None:
                stack.append((child, count + 1))
    return (roots[0], best[0]) if best else None


def compare(path, base, tip, found):
    """Largest difference to Pinocchio, relative to 1 plus the largest value; by quantity."""
    import numpy as np
    import pinocchio as pin

    model = pin.buildModelFromUrdf(path)
    keep = set(found["joints"])
    lock = [model.getJointId(name) for name in model.names[1:] if name not in keep]
    model = pin.buildReducedModel(model, lock, pin.neutral(model))
    data = model.createData()
    frame, root = model.getFrameId(tip), model.getFrameId(base)
    worst = defaultdict(float)

    def note(name, a, b):
        a, b = np.asarray(a, float), np.asarray(b, float)
        worst[name] = max(worst[name], float(np.max(np.abs(a - b)) / (1.0 + np.max(np.abs(b)))))

    for at in found["postures"]:
        q = pin.neutral(model)
        v, a, tau = np.zeros(model.nv), np.zeros(model.nv), np.zeros(model.nv)
        order = []
        for i, name in enumerate(found["joints"]):
            joint = model.joints[model.getJointId(name)]
            if joint.nq == 2:
                q[joint.idx_q : joint.idx_q + 2] = [math.cos(at["q"][i]), math.sin(at["q"][i])]
            else:
                q[joint.idx_q] = at["q"][i]
            v[joint.idx_v], a[joint.idx_v], tau[joint.idx_v] = at["qd"][i], at["qdd"][i], at["tau"][i]
            order.append(joint.idx_v)
        # Locked joints and what hangs on them belong to the bodies in Pinocchio; the stack leaves them out. Only files without
        # such branches compare the dynamics.
        branches = model_has_branches(path, found["joints"])
        pin.framesForwardKinematics(model, data, q)
        place = data.oMf[root].actInv(data.oMf[frame])
        note("position", at["position"], place.translation)
        note("rotation", at["rotation"], place.rotation)
        full = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:, order]
        note("jacobian", at["jacobian"], full)
        if branches:
            continue
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        mass = mass[np.ix_(order, order)] - np.diag([model.armature[i] for i in order])
        note("mass matrix", at["mass"], mass)
        note("gravity", at["gravity"], pin.computeGeneralizedGravity(model, data, q)[order])
        armature = np.array([model.armature[i] for i in order]) * a[order]
        note("inverse dynamics", at["inverse_dynamics"], pin.rnea(model, data, q, v, a)[order] - armature)
        jacobian = full[: at["null_rows"]]
        inverse = np.linalg.inv(mass)
        mobility = jacobian @ inverse @ jacobian.T
        for first in range(0, at["null_rows"], 3):
            part = slice(first, first + 3)
            mobility[part, part] += 1e-6 * np.trace(mobility[part, part]) * np.eye(3)
        if len(order) > at["null_rows"] and np.linalg.cond(mass) < 1e8:
            held = np.linalg.solve(mobility, jacobian @ inverse @ tau[order])
            note("null space", at["null_space"], tau[order] - jacobian.T @ held)
    return worst


def model_has_branches(path, joints):
    """Whether a movable joint outside the chain carries mass."""
    root = ET.parse(path).getroot()
    return any(j.get("type") not in ("fixed", None) and j.get("name") not in joints for j in root.findall("joint"))


# Description, base, tip, force [N], radius of the foot [m]. The last one has 2.7 N m, too little for 50 N.
ROBOTS = {
    "KUKA iiwa 7": ("bullet3/data/kuka_iiwa/model.urdf", "lbr_iiwa_link_0", "lbr_iiwa_link_7", 20, 0.02),
    "Franka Panda": ("example-robot-data/robots/panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp", 20, 0.02),
    "UR5": ("example-robot-data/robots/ur_description/urdf/ur5_robot.urdf", "world", "tool0", 20, 0.02),
    "Kinova j2s6s200": (
        "example-robot-data/robots/kinova_description/robots/kinova.urdf", "base", "j2s6s200_end_effector", 20, 0.02,
    ),
    "Unitree Go1, leg": ("example-robot-data/robots/go1_description/urdf/go1.urdf", "base", "FL_foot", 50, 0.02),
    "Solo 12, leg": ("example-robot-data/robots/solo_description/robots/solo12.urdf", "base_link", "FL_FOOT", 20, 0.015),
}


def hold(folder):
    """Each robot presses for 30 s on a floor of 1e5 N/m in the posture that calibration chooses, and is pushed at 15 s."""
    print("| robot | F_d, N | settled rms, % | orientation, degrees | drift of 10 s, rad | pushed by, rad | off at the end, rad | at a stop |")
    print("|---|---|---|---|---|---|---|---|")
    for name, (path, base, tip, force, radius) in ROBOTS.items():
        urdf = os.path.abspath(os.path.join(folder, path))
        words = ["--base", base, "--tip", tip, "--force", str(force), "--set", f"robot.foot.radius_m={radius}"]
        text = subprocess.run([HAPFIC, "calibrate", urdf, *words], capture_output=True, text=True, check=True).stdout
        posture = re.search(r"start posture: (\[.*\])", text).group(1)
        scenario = (
            f'duration_s = 30.0\n[robot]\nurdf = "{urdf}"\nbase_link = "{base}"\ntip_link = "{tip}"\n'
            f"start_position_rad = {posture}\n[robot.foot]\nradius_m = {radius}\n{text[text.index('[controller]'):]}"
        )
        with tempfile.TemporaryDirectory() as work:
            file = os.path.join(work, "hold.toml")
            open(file, "w").write(scenario)
            checked = subprocess.run([HAPFIC, "check", file], capture_output=True, text=True, check=True).stdout
            x, y, z = map(float, re.search(r"foot starts at \(([-\d.]+), ([-\d.]+), ([-\d.]+)\)", checked).groups())
            stiffness = float(re.search(r"stiffness_n_per_m = \[([\d.]+)", scenario).group(1))
            depth = 2e-4 + 0.3 * force / stiffness
            scenario += (
                f"[world.floor]\nheight_m = {z - radius - 2e-4}\nstiffness_n_per_m = 1e5\ndamping_n_s_per_m = 200.0\n"
                f"[[operator]]\nat_s = 0.1\ntarget_position_m = [{x}, {y}, {z - depth}]\n"
                f"[[operator]]\nat_s = 0.5\ndesired_force_n = [0, 0, {force}]\n"
            )
            open(file, "w").write(scenario)
            found = json.loads(subprocess.run([HOLD, file], capture_output=True, text=True, check=True).stdout)
        turned = f"{found['turned_degrees']:.4f}" if found["joints"] >= 6 else "-"
        print(
            f"| {name} | {force} | {found['settled_percent']:.3f} | {turned} | {found['drift_rad']:.0e} | {found['pushed_rad']:.2f} "
            f"| {found['returned_rad']:.0e} | {'yes' if found['at_stop'] else 'no'} |", flush=True
        )


def main():
    if len(sys.argv) == 3 and sys.argv[1] == "--hold":
        return hold(sys.argv[2])
    if len(sys.argv) == 3 and sys.argv[1] == "--fetch":
        return fetch(sys.argv[2])
    folder = sys.argv[1]
    worst, refused, unreadable = defaultdict(lambda: (0.0, "")), [], []
    print("| package | files with a chain | loaded as shipped | with effort limits | refused | compared | with dynamics |")
    print("|---|---|---|---|---|---|---|")
    total = defaultdict(int)
    for package in sorted(os.listdir(folder)):
        top = os.path.join(folder, package)
        if not os.path.isdir(top):
            continue
        files = sorted(os.path.join(d, f) for d, _, names in os.walk(top) for f in names if f.endswith(".urdf"))
        count = defaultdict(int)
        for path in files[:FILES_PER_PACKAGE]:
            ends = chain(path)
            if ends is None:
                continue
            count["files"] += 1
            run = subprocess.run([MODEL, path, *ends], capture_output=True, text=True)
            if run.returncode != 0:
                count["refused"] += 1
                refused.append(run.stderr.strip().replace(folder, ""))
                continue
            found = json.loads(run.stdout)
            count["completed" if found["completed"] else "loaded"] += 1
            try:
                differences = compare(path, *ends, found)
            except Exception as error:  # Pinocchio refuses the file
                unreadable.append(f"{path.replace(folder, '')}: {str(error).strip().splitlines()[0] if str(error) else error!r}")
                continue
            count["compared"] += 1
            count["dynamics"] += "mass matrix" in differences
            for name, value in differences.items():
                if value > worst[name][0] or math.isnan(value):
                    worst[name] = (value, path.replace(folder, ""))
        row = [count[key] for key in ("files", "loaded", "completed", "refused", "compared", "dynamics")]
        for key, value in count.items():
            total[key] += value
        print(f"| {package} | " + " | ".join(map(str, row)) + " |")
    row = [total[key] for key in ("files", "loaded", "completed", "refused", "compared", "dynamics")]
    print("| all | " + " | ".join(map(str, row)) + " |")
    print("\n| quantity | largest difference to Pinocchio | in |\n|---|---|---|")
    for name, (value, path) in worst.items():
        print(f"| {name} | {value:.1e} | {path} |")
    print(f"\nrefused ({len(refused)}):")
    for line in refused:
        print(" ", line[:300])
    print(f"\nnot read by Pinocchio ({len(unreadable)}):")
    for line in unreadable:
        print(" ", line[:200])


if __name__ == "__main__":
    main()
