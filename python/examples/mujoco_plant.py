"""Robot and world of a scenario in MuJoCo, in place of hapfic's plant: floor, boxes and balls.

    hapfic run floor --clock lockstep --set 'processes.plant=["python3", "python/examples/mujoco_plant.py"]'
"""

import mujoco
import numpy as np

import hapfic
from hapfic.messages import Drive, State

#: Sub-steps of a tick.
SUBSTEPS = 10
#: Contacts: time constant [s] and damping ratio.
SOFTNESS = [0.002, 1.0]


class MujocoPlant(hapfic.Plant):
    def begin(self, run):
        settings = run.settings
        robot, world = settings["robot"], settings["world"]
        spec = mujoco.MjSpec.from_string(run.urdf)
        spec.compiler.fusestatic = False
        spec.option.timestep = 1e-3 / SUBSTEPS
        spec.option.gravity = world["gravity_m_per_s2"]
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        base = spec.body(robot["base_link"])
        base.pos = robot["base_position_m"]
        base.quat = _quaternion(robot["base_orientation_rpy_rad"])
        # The robot touches the world, and not itself; nothing of it has friction of its own.
        for geom in spec.geoms:
            geom.contype, geom.conaffinity, geom.friction, geom.solref = 1, 2, [0, 0, 0], SOFTNESS
        joints = [joint for joint in spec.joints if joint.type != mujoco.mjtJoint.mjJNT_FREE]
        for key, attribute in (
            ("joint_damping_n_m_s_per_rad", "damping"),
            ("joint_friction_n_m", "frictionloss"),
            ("armature_kg_m2", "armature"),
        ):
            for number, joint in enumerate(joints):
                if key in robot:
                    setattr(joint, attribute, robot[key][number] if isinstance(robot[key], list) else robot[key])
        if "radius_m" in robot.get("foot", {}):
            foot = robot["foot"]
            tip = spec.body(robot["tip_link"])
            for geom in list(tip.geoms):
                spec.delete(geom)
            tip.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[foot["radius_m"], 0, 0],
                pos=foot.get("offset_m", [0, 0, 0]),
                mass=0,
                contype=1,
                conaffinity=2,
                friction=[0, 0, 0],
                solref=SOFTNESS,
            )
        self.names = []
        if "floor" in world:
            floor = world["floor"]
            spec.worldbody.add_geom(
                name="floor",
                type=mujoco.mjtGeom.mjGEOM_PLANE,
                pos=[0, 0, floor["height_m"]],
                size=[0, 0, 1],
                contype=2,
                conaffinity=3,
                condim=1 if floor.get("friction_dynamic", 0) == 0 else 3,
                friction=[floor.get("friction_dynamic", 0), 0, 0],
                priority=1,
                solref=SOFTNESS,
            )
        for thing in world.get("object", []):
            self.names.append(thing["name"])
            body = spec.worldbody.add_body(name=thing["name"], pos=thing["position_m"])
            body.quat = _quaternion(thing.get("orientation_rpy_rad", [0, 0, 0]))
            body.add_freejoint(name=thing["name"])
            box = thing["shape"] == "box"
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX if box else mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[0.5 * edge for edge in thing["size_m"]] if box else [thing["radius_m"], 0, 0],
                mass=thing["mass_kg"],
                contype=2,
                conaffinity=3,
                friction=[thing.get("friction_dynamic", 0), 0, 0],
                priority=2,
                solref=SOFTNESS,
            )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        chain = [self.model.joint(joint.name) for joint in joints][: len(robot["start_position_rad"])]
        self.q = np.array([joint.qposadr[0] for joint in chain])
        self.v = np.array([joint.dofadr[0] for joint in chain])
        self.data.qpos[self.q] = robot["start_position_rad"]
        self.brake = settings["plant"]["brake_damping_n_m_s_per_rad"]
        self.tip = self.model.body(robot["tip_link"]).id
        self.force, self.moment, self.torque = np.zeros(3), np.zeros(3), np.zeros(len(self.q))
        mujoco.mj_forward(self.model, self.data)

    def advance(self, drive, torque):
        data = self.data
        self.force[:], self.moment[:], self.torque[:] = 0, 0, 0
        held = data.qpos[self.q].copy()
        for _ in range(SUBSTEPS):
            applied = torque if drive == Drive.TORQUE else -self.brake * data.qvel[self.v]
            data.qfrc_applied[self.v] = applied
            mujoco.mj_step(self.model, data)
            if drive == Drive.HELD:
                data.qpos[self.q], data.qvel[self.v] = held, 0
            self.torque += applied / SUBSTEPS
            self._sense()
        mujoco.mj_forward(self.model, data)

    def _sense(self):
        """Adds the force and moment of the world on the tip in this sub-step."""
        wrench = np.zeros(6)
        for number in range(self.data.ncon):
            contact = self.data.contact[number]
            bodies = [self.model.geom_bodyid[geom] for geom in contact.geom]
            if self.tip not in bodies:
                continue
            mujoco.mj_contactForce(self.model, self.data, number, wrench)
            # In the frame of the contact, on the second body.
            force = contact.frame.reshape(3, 3).T @ wrench[:3] * (1 if bodies[1] == self.tip else -1)
            self.force += force / SUBSTEPS
            self.moment += np.cross(contact.pos - self.data.xpos[self.tip], force) / SUBSTEPS

    def sample(self, state: State):
        data, n = self.data, len(self.q)
        state.joints = n
        state.joint_position[:n] = data.qpos[self.q]
        state.joint_velocity[:n] = data.qvel[self.v]
        state.joint_torque[:n] = self.torque
        state.foot_position[:] = data.xpos[self.tip]
        w, x, y, z = data.xquat[self.tip]
        state.foot_orientation[:] = [x, y, z, w]
        linear, angular = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jacBody(self.model, data, linear, angular, self.tip)
        state.foot_velocity[:] = linear @ data.qvel
        state.foot_angular_velocity[:] = angular @ data.qvel
        state.foot_force[:] = self.force
        state.foot_moment[:] = self.moment
        state.object_count = len(self.names)
        for thing, name in zip(state.objects, self.names):
            body = data.body(name)
            w, x, y, z = body.xquat
            thing.position[:], thing.orientation[:] = body.xpos, [x, y, z, w]
            address = self.model.joint(name).dofadr[0]
            thing.linear_velocity[:] = data.qvel[address : address + 3]
            thing.angular_velocity[:] = body.xmat.reshape(3, 3) @ data.qvel[address + 3 : address + 6]


def _quaternion(rpy):
    """Roll, pitch, yaw about fixed axes as a quaternion, w first."""
    result = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in zip(np.eye(3), rpy):
        turn = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
        product = np.zeros(4)
        mujoco.mju_mulQuat(product, turn, result)
        result = product
    return result


if __name__ == "__main__":
    hapfic.run_plant(MujocoPlant())
