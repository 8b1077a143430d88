"""Arms for MuJoCo alone, as MJCF text: those that the lean step must serve, and those that it must refuse."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from torquebench.robot.library import model_folder
from torquebench.sim.plants.mujoco import MujocoPlant

HEAD = """<mujoco><compiler angle="radian" autolimits="false"/>
<option gravity="0.4 -0.3 -9.81"><flag contact="disable"/></option><worldbody>"""


def _link(name: str, inside: str, pos: str = "0.3 0.02 0.1", axis: str = "0 1 0", more: str = "") -> str:
    kind = 'type="slide"' if name.startswith("s") else 'type="hinge"'
    return f"""<body name="{name}" pos="{pos}" euler="0.2 -0.1 0.3">
      <inertial mass="1.3" pos="0.1 0.05 -0.02" fullinertia="0.03 0.05 0.04 0.001 -0.002 0.003"/>
      <joint name="{name}" {kind} axis="{axis}" armature="0.2" {more}/>{inside}</body>"""


def _arm(bodies: str, joints: str, head: str = HEAD, extra: str = "") -> str:
    motors = "".join(f'<motor joint="{j}" ctrllimited="true" ctrlrange="-40 40"/>' for j in joints.split())
    return f"{head}{bodies}</worldbody>{extra}<actuator>{motors}</actuator></mujoco>"


SERIAL = _link("a", _link("b", _link("c", "", axis="1 0 0.2"), axis="0 0.3 1"))
SLIDES = _link("s1", _link("a", _link("s2", _link("b", ""), axis="1 0.1 0"), axis="0 0 1"), axis="0 0.2 1")
TREE = _link("a", _link("b", _link("c", "")) + _link("d", _link("e", "", axis="1 0 0"), pos="-0.2 0.3 0", axis="0 0 1"))
FOREST = _link("a", _link("b", "")) + _link("c", "", pos="2 0 0", axis="1 0 0")
DOUBLE = SERIAL.replace('<joint name="b"', '<joint name="d" axis="1 0 0" armature="0.1"/><joint name="b"')
HAND = '<body pos="0.1 0 0"><inertial mass="0.4" pos="0 0.1 0" diaginertia="0.01 0.02 0.02"/></body>'


def _option(text: str) -> str:
    return HEAD.replace('<option gravity="0.4 -0.3 -9.81">', f"<option {text}>")


def _flag(text: str) -> str:
    return HEAD.replace("<flag ", f"<flag {text} ")


def _joint(text: str) -> str:
    return SERIAL.replace('<joint name="b"', f'<joint name="b" {text}')


def _shipped(name: str) -> str:
    return (model_folder(name) / f"{name}.xml").read_text(encoding="utf-8")


def _payload(name: str, body: str) -> str:
    """Return a shipped arm with a point mass of 2 kg welded to a body, added by MuJoCo's own editor."""
    spec = mujoco.MjSpec.from_string(_shipped(name))
    load = spec.body(body).add_body(name="load", pos=[0.01, 0.02, 0.05])
    load.mass, load.inertia, load.explicitinertial = 2.0, [1e-4, 1e-4, 1e-4], True
    spec.compile()
    return str(spec.to_xml())


LEAN: dict[str, Callable[[], str]] = {
    "puma560": lambda: _shipped("puma560"),
    "two-link": lambda: _shipped("two-link"),
    "puma560 with a payload": lambda: _payload("puma560", "link4"),
    "hinges": lambda: _arm(SERIAL, "a b c"),
    "hinges and slides": lambda: _arm(SLIDES, "s1 a s2 b"),
    "branches": lambda: _arm(TREE, "a b c d e"),
    "two arms": lambda: _arm(FOREST, "a b c"),
    "two joints on a body": lambda: _arm(DOUBLE, "a d b c"),
    "a body welded on": lambda: _arm(_link("a", HAND + _link("b", HAND)), "a b"),
    "no gravity": lambda: _arm(SERIAL, "a b c", _flag('gravity="disable"')),
    "damping switched off": lambda: _arm(_joint('damping="0.7"'), "a b c", _flag('damper="disable"')),
    "enforced limits": lambda: _arm(_joint('limited="true" range="-0.1 0.1"'), "a b c"),
    "constraints switched off": lambda: _arm(SERIAL, "a b c", _flag('constraint="disable"')),
    "actuation switched off": lambda: _arm(SERIAL, "a b c", _flag('actuation="disable"')),
    "limits that are not enforced": lambda: _arm(_joint('limited="false" range="-0.1 0.1"'), "a b c"),
    "a spring reference without a spring": lambda: _arm(_joint('springref="0.4"'), "a b c"),
    "a reference angle": lambda: _arm(_joint('ref="0.4"'), "a b c"),
}
"""Arms of hinges, slides and motors."""
RUBBING: dict[str, Callable[[], str]] = {
    "damping": lambda: _arm(_joint('damping="0.7"'), "a b c"),
    "damping in a tree": lambda: _arm(TREE.replace('armature="0.2"', 'armature="0.2" damping="0.4"'), "a b c d e"),
    "explicit damping": lambda: _arm(_joint('damping="0.7"'), "a b c", _flag('eulerdamp="disable"')),
    "joint friction": lambda: _arm(_joint('frictionloss="0.6"'), "a b c"),
}
"""Arms with friction of their own, which acts as a torque beside the step."""

BALL = '<geom type="sphere" size="0.05" mass="0.1" pos="0.1 0 0"/>'
FLOOR = '<geom type="plane" size="5 5 1" pos="0 0 0.29"/>'
CONTACT = HEAD.replace('<flag contact="disable"/>', "")
TENDON = '<tendon><fixed {}><joint joint="a" coef="1"/><joint joint="b" coef="-0.5"/></fixed></tendon>'
REFUSED: dict[str, Callable[[], str]] = {
    "contacts": lambda: _arm(SERIAL.replace("</body>", BALL + "</body>", 1) + FLOOR, "a b c", CONTACT),
    "a spring": lambda: _arm(_joint('stiffness="20" springref="0.3"'), "a b c"),
    "a spring polynomial": lambda: _arm(_joint('stiffness="0 20"'), "a b c"),
    "a damping polynomial alone": lambda: _arm(_joint('damping="0 0.3"'), "a b c"),
    "gravity compensation": lambda: _arm(SERIAL.replace('<body name="b"', '<body name="b" gravcomp="0.7"'), "a b c"),
    "a stiff tendon": lambda: _arm(SERIAL, "a b c", extra=TENDON.format('stiffness="9" damping="0.3"')),
    "a tendon's armature": lambda: _arm(SERIAL, "a b c", extra=TENDON.format('armature="0.3"')),
    "an equality": lambda: _arm(SERIAL, "a b c", extra='<equality><joint joint1="a" joint2="c"/></equality>'),
    "a fluid": lambda: _arm(SERIAL, "a b c", _option('density="30" viscosity="0.4" gravity="0 0 -9.81"')),
    "a motor's armature": lambda: _arm(SERIAL, "a b c").replace('<motor joint="b"', '<motor armature="0.3" joint="b"'),
    "a motor's damping": lambda: _arm(SERIAL, "a b c").replace('<motor joint="b"', '<motor damping="0.3" joint="b"'),
    "a mocap body": lambda: _arm(SERIAL + '<body mocap="true"/>', "a b c"),
}
"""Arms whose step has something that the lean step leaves out."""


def plant_from(text: str, folder: Path, integrator: str = "rk4", timestep: float = 0.001) -> MujocoPlant:
    """Return the plant of an arm given as text."""
    file = folder / "arm.xml"
    file.write_text(text, encoding="utf-8")
    return MujocoPlant(file, timestep, integrator)


def start_of(n: int) -> tuple[Any, Any]:
    """Return a position and a velocity without zeros, (n,) each."""
    return 0.4 * np.cos(1.0 + 2.0 * np.arange(n)), 0.5 * np.sin(2.0 + np.arange(n))
