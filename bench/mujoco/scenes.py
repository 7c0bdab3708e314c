"""Scenes of MuJoCo, with contact parameters as close to the plant's law as MuJoCo allows.

MuJoCo's normal force at a contact, in its direct mode (solref = (-S, -D), constant impedance I), is

    f = (S depth + D rate) / ((1 - I) A) - I / ((1 - I) A) * acceleration

with A the inverse inertia it assumes for the pair (body_invweight0). S = k (1 - I) A and D = b (1 - I) A therefore give
the plant's k and b; the last term has no counterpart in the plant. The impedance fades in over the transition width, as
the plant's force does. MuJoCo has one coefficient of friction; here the plant uses its dynamic one alone, too. Near rest
the slope of MuJoCo's friction over slip is impratio * b; impratio sets it to the plant's, 2 mu F / v_c, at the desired
force.
"""

import pathlib

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
# Impedance I of a contact deeper than the transition width. The acceleration term is then a quarter of the pair's inertia.
# At 0.9, MuJoCo's default, it would be nine times that inertia, and an impact a third of the plant's.
IMPEDANCE = 0.2
# MuJoCo's lower limit.
LEAST_IMPEDANCE = 1e-4
# Desired forces [N], as in bench/substep/src/plan.rs; only impratio depends on them.
PRESSED = {"floor": 50.0, "box": 50.0, "ball": 30.0}
INTEGRATORS = {"euler": mujoco.mjtIntegrator.mjINT_EULER, "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST}


class Mismatch(Exception):
    """A model that differs from the plant's."""


def _law(a, b):
    """Combines two surfaces: stiffness of the softer, friction of the more slippery, as the plant; the robot has None."""
    if a is None or b is None:
        return a or b
    soft = a if a["stiffness"] <= b["stiffness"] else b
    slippery = a if a["friction_static"] <= b["friction_static"] else b
    return {**soft, **{key: slippery[key] for key in ("friction_static", "friction_dynamic", "critical_speed")}}


def load(name, description, integrator="euler", sensors=True):
    """Loads a scene as an MjModel. `description` is the output of `hapfic-substep model`."""
    model = mujoco.MjModel.from_xml_path(str(HERE / "scenes" / f"{name}.xml"))
    model.opt.timestep = description["substep_s"]
    model.opt.gravity[:] = description["gravity"]
    model.opt.integrator = INTEGRATORS[integrator]
    if not sensors:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    surfaces = {"floor": description["floor"]} | {item["name"]: item["surface"] for item in description["objects"]}
    ratio = 1.0
    for pair in range(model.npair):
        geoms = (model.pair_geom1[pair], model.pair_geom2[pair])
        names = [model.geom(geom).name for geom in geoms]
        law = _law(*(surfaces.get(other) for other in names))
        inverse_inertia = sum(model.body_invweight0[model.geom_bodyid[geom], 0] for geom in geoms)
        scale = (1.0 - IMPEDANCE) * inverse_inertia
        model.pair_solref[pair] = [-law["stiffness"] * scale, -law["damping"] * scale]
        model.pair_solimp[pair] = [LEAST_IMPEDANCE, IMPEDANCE, law["transition_width"], 0.5, 1.0]
        model.pair_friction[pair, :2] = law["friction_dynamic"]
        if "foot" in names and names != ["foot", "floor"] and law["friction_dynamic"] > 0.0:
            slope = 2.0 * law["friction_dynamic"] * PRESSED[name] / law["critical_speed"]
            ratio = slope / law["damping"]
    model.opt.impratio = ratio
    check(name, model, description)
    return model


def start(model, description):
    """Returns the state at the start: the plan's posture, all bodies at rest."""
    data = mujoco.MjData(model)
    data.qpos[:3] = description["plan"]["start"]
    return data


def check(name, model, description):
    """Raises Mismatch if leg or objects differ from the plant's."""
    expected = description["check"]
    data = start(model, description)
    data.qvel[:3] = expected["velocity"]
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    found = {
        "foot, m": (data.site("foot").xpos, expected["foot"]),
        "mass matrix": (mass[:3, :3], expected["mass_matrix"]),
        "bias, N m": (data.qfrc_bias[:3], expected["bias"]),
    }
    for item in description["objects"]:
        body = model.body(item["name"])
        found[f"{item['name']}: mass, kg"] = (body.mass[0], item["mass"])
        found[f"{item['name']}: inertia, kg m^2"] = (body.inertia, item["inertia"])
        found[f"{item['name']}: position, m"] = (body.pos, item["position"])
    for quantity, (value, plant) in found.items():
        if not np.allclose(value, plant, rtol=1e-9, atol=1e-9):
            raise Mismatch(f"scenes/{name}.xml: {quantity}: found {np.asarray(value).tolist()}, expected {plant} of the plant")
