"""Prints position and force of the foot of the running stack, ten times a second, for five seconds."""

import hapfic

with hapfic.Client() as client:
    print(f"run {client.run.name}, scenario {client.run.scenario}")
    next_tick = -1
    for state in client.follow("state", seconds=5.0):
        if state.tick >= next_tick:
            next_tick = state.tick + 100
            position = ", ".join(f"{value:7.4f}" for value in state.foot_position)
            print(f"{state.tick * 1e-3:8.3f} s  x [{position}] m  F_z {state.foot_force[2]:7.2f} N")
