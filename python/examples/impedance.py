"""A task-space impedance with force feed-forward, as a controller in Python (Hogan 1985).

    hapfic run floor --clock lockstep --set 'processes.controller=["python3", "python/examples/impedance.py"]'

F_c = K (x_d - x) + D (x_d' - x'), and in contact -F_d more, so that the environment answers with F_d: without a search the
force is off by K times the error of the position.
"""

import numpy as np

import hapfic

#: Damping over the square root of the stiffness [kg^1/2].
DAMPING = 1.0


class Impedance(hapfic.Controller):
    def step(self, tick):
        stiffness = np.array(tick.parameters.stiffness)
        spring = stiffness * (tick.target - tick.position)
        damper = DAMPING * np.sqrt(stiffness) * (tick.target_velocity - tick.velocity)
        touched = np.abs(tick.force) > tick.parameters.force_resolution
        return spring + damper - np.where(touched, tick.desired_force, 0.0)


if __name__ == "__main__":
    hapfic.run_controller(Impedance())
