"""An arm as its file has it, with what plants of the testbed leave out: springs, gravity compensation, integrator."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.library import ArmFile, file_of_arm
from torquebench.robot.mjcf_links import ON_JOINT
from torquebench.robot.mjcf_text import standing_alone

INTEGRATORS = {
    int(code): code.name.removeprefix("mjINT_").lower() for code in mujoco.mjtIntegrator.__members__.values()
}


class Written:
    """An arm of hinges and slides, computed by MuJoCo as its file has it, without contacts and limits.

    Args:
        text: MJCF or URDF that stands alone.

    Raises:
        ModelError: MuJoCo does not compile it, or it has other joints.
    """

    def __init__(self, text: str) -> None:
        try:
            m = mujoco.MjModel.from_xml_string(text)
        except (ValueError, RuntimeError, MemoryError) as error:
            raise ModelError(str(error)) from error
        if m.nq != m.nv or m.nv == 0:
            raise ModelError("wanted hinges and slides")
        self._text, self.integrator = text, INTEGRATORS[int(m.opt.integrator)]
        rubs = not m.opt.disableflags & (
            mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        )
        self.frictionloss = np.array(m.dof_frictionloss) * rubs
        self.damping, self.stiffness, self.range = map(np.array, (m.dof_damping, m.jnt_stiffness, m.jnt_range))
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
        m.opt.enableflags = 0
        self.gravity = np.array(m.opt.gravity)
        self._m, self._d = m, mujoco.MjData(m)

    def torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the torque that produces the acceleration `qdd`, friction and springs included, (N, n) [N m]."""
        out = np.empty_like(q)
        for i in range(len(q)):
            self._d.qpos[:], self._d.qvel[:], self._d.qacc[:] = q[i], qd[i], qdd[i]
            mujoco.mj_inverse(self._m, self._d)
            out[i] = self._d.qfrc_inverse
        dry: Array = self.frictionloss * np.sign(qd)
        return out + dry

    def pose(self, q: Array) -> Array:
        """Return the pose of the last body, rotation and origin, (N, 12) [1, m]."""
        out = np.empty((len(q), 12))
        for i in range(len(q)):
            self._d.qpos[:] = q[i]
            mujoco.mj_kinematics(self._m, self._d)
            out[i, :9], out[i, 9:] = self._d.xmat[-1], self._d.xpos[-1]
        return out

    def stepped(self, q: Array, qd: Array, integrator: str) -> Array:
        """Return the velocities after one of the file's time steps from each state, (N, n) [rad/s]."""
        m = copy.copy(self._m)
        m.opt.integrator = next(code for code, name in INTEGRATORS.items() if name == integrator)
        d, out = mujoco.MjData(m), np.empty_like(qd)
        for i in range(len(q)):
            mujoco.mj_resetData(m, d)
            d.qpos[:], d.qvel[:] = q[i], qd[i]
            mujoco.mj_step(m, d)
            out[i] = d.qvel
        return out

    @property
    def gears(self) -> Array:
        """Torque of each joint's motors under a control of 1, (n,) [N m]."""
        m, total = self._m, np.zeros(self._m.nv)
        for a in range(m.nu):
            if int(m.actuator_trntype[a]) in ON_JOINT:
                total[m.jnt_dofadr[m.actuator_trnid[a, 0]]] += m.actuator_gear[a, 0] * m.actuator_gainprm[a, 0]
        return total

    def in_other_unit(self) -> Written:
        """Return the arm whose file has its angles in radians instead of degrees, or in degrees instead of radians.

        Raises:
            ModelError: that does not compile, or the file is URDF, whose angles have one unit.
        """
        root = ElementTree.fromstring(self._text)
        if root.tag == "robot":
            raise ModelError("URDF has radians")
        found = root.findall("compiler") or [ElementTree.SubElement(root, "compiler")]
        now = next((each.get("angle") for each in reversed(found) if each.get("angle")), "degree")
        found[-1].set("angle", "radian" if now == "degree" else "degree")
        return Written(ElementTree.tostring(root, encoding="unicode"))


def written(arm: ArmFile, path: Path | None = None) -> Written:
    """Return an arm as its file has it, or as the testbed takes it.

    Args:
        arm: The arm as the testbed takes it.
        path: Its file; None for as it is taken. So is one that cannot be compiled alone, or has more joints.
    """
    taken = Written(arm.text)
    if path is None:
        return taken
    own = standing_alone(file_of_arm(path).text)
    try:
        raw = Written(own.text) if own.compiles else taken
    except ModelError:
        return taken
    return raw if len(raw.damping) == len(taken.damping) else taken
