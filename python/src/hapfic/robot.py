"""Kinematics of a serial chain from a URDF: pose and Jacobian of the tip."""

import xml.etree.ElementTree as ET

import numpy as np

from .errors import HapficError


def _rotation(rpy) -> np.ndarray:
    """Rotation matrix of roll, pitch and yaw about fixed axes, as in URDF."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation about a unit vector (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


class Chain:
    """The joints from a base link to a tip link, and where the base stands."""

    def __init__(self, urdf: str, base_link: str, tip_link: str, position=(0, 0, 0), rpy=(0, 0, 0)):
        root = ET.fromstring(urdf)
        above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
        link, joints = tip_link, []
        while link != base_link:
            if link not in above:
                raise HapficError(f"found no joints from '{base_link}' to '{tip_link}'")
            joints.append(above[link])
            link = above[link].find("parent").get("link")
        self._base = np.array(position, dtype=float), _rotation(np.array(rpy, dtype=float))
        self._steps = []
        for joint in reversed(joints):
            origin, axis = joint.find("origin"), joint.find("axis")
            triple = lambda element, key, default: np.array(  # noqa: E731
                [float(word) for word in (element.get(key) if element is not None and element.get(key) else default).split()]
            )
            direction = triple(axis, "xyz", "1 0 0")
            direction = direction / np.linalg.norm(direction)
            place = triple(origin, "xyz", "0 0 0"), _rotation(triple(origin, "rpy", "0 0 0"))
            self._steps.append((joint.get("type"), *place, direction))
        self.dof = sum(kind != "fixed" for kind, *_ in self._steps)

    @classmethod
    def of_run(cls, run) -> "Chain":
        """The robot of a run."""
        robot = run.settings["robot"]
        place = robot["base_position_m"], robot["base_orientation_rpy_rad"]
        return cls(run.urdf, robot["base_link"], robot["tip_link"], *place)

    def tip(self, q) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position [m] and rotation of the tip, and its Jacobian: rows of velocity and angular velocity, 6 x dof."""
        (position, rotation), joints, number = self._base, [], 0
        for kind, offset, turn, axis in self._steps:
            position, rotation = position + rotation @ offset, rotation @ turn
            if kind == "fixed":
                continue
            direction = rotation @ axis
            joints.append((kind == "prismatic", position, direction))
            if kind == "prismatic":
                position = position + direction * q[number]
            else:
                rotation = rotation @ _about(axis, q[number])
            number += 1
        jacobian = np.zeros((6, self.dof))
        for column, (slides, origin, direction) in enumerate(joints):
            if slides:
                jacobian[:3, column] = direction
            else:
                jacobian[:3, column], jacobian[3:, column] = np.cross(direction, position - origin), direction
        return position, rotation, jacobian
