"""The smallest plant: joints without dynamics that follow their torque, in empty space. For tests, and as a start.

    hapfic run floor --clock lockstep --set 'processes.plant=["python3", "python/examples/point_plant.py"]'
"""

import hapfic
from hapfic.messages import Drive

#: Inertia [kg m^2] and damping [N m s/rad] of every joint.
INERTIA, DAMPING = 0.05, 5.0


class PointPlant(hapfic.Plant):
    def begin(self, run):
        self.q = list(run.settings["robot"]["start_position_rad"])
        self.v = [0.0] * len(self.q)
        self.applied = [0.0] * len(self.q)

    def advance(self, drive, torque):
        self.applied = list(torque)
        for joint, tau in enumerate(torque):
            if drive == Drive.HELD:
                self.v[joint] = 0.0
            else:
                self.v[joint] += 1e-3 * (tau - DAMPING * self.v[joint]) / INERTIA
            self.q[joint] += 1e-3 * self.v[joint]

    def sample(self, state):
        n = state.joints = len(self.q)
        state.joint_position[:n], state.joint_velocity[:n], state.joint_torque[:n] = self.q, self.v, self.applied

    def resume(self, state):
        n = len(self.q)
        self.q, self.v = list(state.joint_position[:n]), list(state.joint_velocity[:n])
        return True


if __name__ == "__main__":
    hapfic.run_plant(PointPlant())
