#!/usr/bin/env python3
"""Write ``models/puma560/scene.xml``: the arm of ``puma560.xml`` with a look, a floor, lights and two cameras.

Bodies, joints, inertias and motors are copied from ``puma560.xml``; what is added is only to be seen: geoms without
mass or contact. Usage: ``puma560_scene.py [--check]``; with ``--check`` nothing is written and the exit status is 1
when the committed file differs.
"""

from __future__ import annotations

import argparse
import math
import sys
import xml.etree.ElementTree as ElementTree

from torquebench.robot.library import data_root

FLOOR = -0.672
"""Height of the floor; the shoulder is the world's origin [m]."""
APART = 0.0008
"""Distance between faces that would else lie in one plane, where shadows flicker [m]."""
UPPER_ARM, FOREARM = 0.4318, 0.43307
"""Shoulder to elbow, elbow to wrist centre [m]: a2 and d4 of Table 2."""
CAMERAS = {"overview": ((-1.60, 2.65, 0.85), (0.05, 0.05, 0.08)), "side": ((0.05, 3.25, 0.20), (0.05, 0.0, 0.10))}
"""Where each camera is and what it looks at [m]."""
FIELD_OF_VIEW = 32
"""Vertical opening of every camera [deg]."""

HEAD = """
<head>
  <statistic center="0 0 -0.1" extent="1"/>
  <visual>
    <headlight ambient="0.42 0.42 0.44" diffuse="0.20 0.20 0.20" specular="0 0 0"/>
    <map znear="0.3" zfar="25" shadowclip="2.2" shadowscale="0.9" fogstart="3.5" fogend="9"/>
    <quality shadowsize="2048"/>
    <rgba haze="0.95 0.96 0.97 1" fog="0.95 0.96 0.97 1"/>
  </visual>
  <default>
    <default class="look"><geom contype="0" conaffinity="0" mass="0" group="2" material="shell"/></default>
  </default>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.86 0.90 0.95" rgb2="0.95 0.96 0.97"
             width="64" height="384"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.90 0.91 0.92" rgb2="0.86 0.87 0.885"
             width="128" height="128"/>
    <material name="floor" texture="tiles" texrepeat="2.5 2.5" texuniform="true" specular="0" shininess="0"/>
    <material name="shell" rgba="0.96 0.94 0.88 1" specular="0.15" shininess="0.3"/>
    <material name="dark" rgba="0.17 0.18 0.20 1" specular="0.3" shininess="0.5"/>
    <material name="steel" rgba="0.62 0.64 0.67 1" specular="0.5" shininess="0.6"/>
    <material name="stripe" rgba="0.05 0.28 0.55 1" specular="0.1" shininess="0.2"/>
  </asset>
</head>"""
LIGHTS = (
    {
        "name": "key",
        "type": "directional",
        "pos": "-1.2 1.6 3",
        "dir": "0.35 -0.45 -1",
        "diffuse": "0.46 0.46 0.44",
        "specular": "0.3 0.3 0.3",
        "castshadow": "true",
    },
    {
        "name": "fill",
        "type": "directional",
        "pos": "2 2 2",
        "dir": "-0.7 -0.6 -0.4",
        "diffuse": "0.18 0.18 0.20",
        "specular": "0 0 0",
        "castshadow": "false",
    },
)


def words(*numbers):
    """Numbers as an attribute, to a tenth of a millimetre."""
    return " ".join(f"{round(float(x), 4) + 0.0:g}" for x in numbers)


def cylinder(radius, start, end, material="shell"):
    """A cylinder between two points."""
    return {"type": "cylinder", "size": words(radius), "fromto": words(*start, *end), "material": material}


def box(half, centre, material="shell", turned=0.0):
    """A box, turned about z."""
    geom = {"type": "box", "size": words(*half), "pos": words(*centre), "material": material}
    return geom | ({"euler": words(0, 0, turned)} if turned else {})


def ball(radius, centre, material="shell"):
    """A sphere."""
    return {"type": "sphere", "size": words(radius), "pos": words(*centre), "material": material}


def slab(start, end, wide, narrow, low, high, material="shell"):
    """A plate with round ends between two heights, tapering from radius `wide` to `narrow`.

    Its outline is the convex hull of two circles: the circles, and a box along each of their common tangents.
    """
    length = math.dist(start, end)
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    slope = math.asin((wide - narrow) / length)
    middle, thick = (low + high) / 2.0, (high - low) / 2.0
    geoms = [
        cylinder(wide, (*start, low), (*start, high), material),
        cylinder(narrow, (*end, low + APART), (*end, high - APART), material),
    ]
    for side in (1.0, -1.0):
        normal = heading + side * (math.pi / 2.0 - slope)
        across = (math.cos(normal), math.sin(normal))
        deep = 0.8 * narrow
        edge = [(a + b + (wide + narrow) * c) / 2.0 for a, b, c in zip(start, end, across, strict=True)]
        centre = [x - deep * c for x, c in zip(edge, across, strict=True)]
        half = (length * math.cos(slope) / 2.0, deep, thick - APART * (2.5 + side / 2.0))
        geoms.append(box(half, (*centre, middle), material, normal - side * math.pi / 2.0))
    return geoms


def look():
    """Geoms of the world and of each link, in the link's own frame."""
    inside, outside = 0.052, 0.142  # the upper arm lies outside the forearm, which is centred on z = 0
    wrist = -FOREARM
    return {
        "world": [
            {"name": "floor", "type": "plane", "size": "0 0 0.1", "pos": words(0, 0, FLOOR), "material": "floor"},
            cylinder(0.155, (0, 0, FLOOR), (0, 0, FLOOR + 0.025), "dark"),
            cylinder(0.125, (0, 0, FLOOR), (0, 0, FLOOR + 0.05), "dark"),
            cylinder(0.092, (0, 0, FLOOR), (0, 0, -0.20)),
            cylinder(0.100, (0, 0, -0.215), (0, 0, -0.195), "dark"),
        ],
        "link1": [
            cylinder(0.096, (0, 0, -0.195), (0, 0, 0.0)),
            cylinder(0.122, (0, -0.125, 0), (0, 0.14909 + inside - 0.012, 0)),
            cylinder(0.112, (0, -0.135, 0), (0, -0.125, 0), "dark"),
            cylinder(0.088, (0, 0.14909 + inside - 0.02, 0), (0, 0.14909 + inside + 0.01, 0), "dark"),
        ],
        "link2": [
            *slab((0, 0), (UPPER_ARM, 0), 0.142, 0.088, inside, outside),
            *slab((0, 0), (-0.13, 0), 0.128, 0.092, inside + 4 * APART, outside - 4 * APART),
            cylinder(0.088, (0, 0, outside), (0, 0, outside + 0.012), "dark"),
            cylinder(0.054, (UPPER_ARM, 0, outside), (UPPER_ARM, 0, outside + 0.010), "dark"),
            box((0.105, 0.014, 0.002), (0.235, 0, outside), "stripe"),
        ],
        "link3": [
            cylinder(0.056, (0, 0, 0.03), (0, 0, inside + 0.01), "dark"),
            *slab((0, 0.035), (-0.0203, wrist + 0.085), 0.082, 0.047, -0.045, 0.045),
            cylinder(0.050, (0, 0, -0.045), (0, 0, -0.053), "dark"),
            cylinder(0.040, (-0.0203, wrist + 0.11, 0), (-0.0203, wrist + 0.040, 0), "dark"),
        ],
        "link4": [
            cylinder(0.037, (0, 0, -0.058), (0, 0, -0.034)),
            box((0.024, 0.0075, 0.034), (0, 0.0335, -0.010)),
            box((0.024, 0.0075, 0.034), (0, -0.0335, -0.010)),
            cylinder(0.016, (0, 0.041, 0), (0, 0.046, 0), "dark"),
            cylinder(0.016, (0, -0.041, 0), (0, -0.046, 0), "dark"),
        ],
        "link5": [cylinder(0.025, (0, 0, -0.0255), (0, 0, 0.0255), "steel")],
        "link6": [
            cylinder(0.019, (0, 0, 0.01), (0, 0, 0.045), "steel"),
            cylinder(0.031, (0, 0, 0.045), (0, 0, 0.05625), "dark"),
        ],
    }


def camera(name, position, target):
    """A camera at a position that looks at a target, upright."""
    back = [p - t for p, t in zip(position, target, strict=True)]
    right = (-back[1], back[0], 0.0)
    up = (-back[0] * back[2], -back[1] * back[2], back[0] ** 2 + back[1] ** 2)
    axes = [x / math.hypot(*axis) for axis in (right, up) for x in axis]
    return {"name": name, "pos": words(*position), "xyaxes": words(*axes), "fovy": str(FIELD_OF_VIEW)}


def scene():
    """Text of ``scene.xml``."""
    root = ElementTree.parse(data_root() / "models" / "puma560" / "puma560.xml").getroot()
    root.set("model", "puma560-scene")
    world = root.find("worldbody")
    geoms = look()
    for body in world.iter("body"):
        place = next(i for i, child in enumerate(body) if child.tag == "joint") + 1
        for i, geom in enumerate(geoms.pop(body.get("name"))):
            body.insert(place + i, ElementTree.Element("geom", {"class": "look"} | geom))
    front = [ElementTree.Element("light", light) for light in LIGHTS]
    front += [ElementTree.Element("camera", camera(name, *place)) for name, place in CAMERAS.items()]
    front += [ElementTree.Element("geom", {"class": "look"} | geom) for geom in geoms.pop("world")]
    for i, element in enumerate(front):
        world.insert(i, element)
    for i, element in enumerate(ElementTree.fromstring(HEAD), start=2):
        root.insert(i, element)
    if geoms:
        raise SystemExit(f"no such bodies: {', '.join(geoms)}")
    ElementTree.indent(root)
    note = "<!-- Generated by scripts/puma560_scene.py from puma560.xml; do not edit. -->\n"
    return note + ElementTree.tostring(root, encoding="unicode").replace(" />", "/>") + "\n"


def main():
    """Write the scene, or compare it with the committed one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with the committed file; write nothing")
    path = data_root() / "models" / "puma560" / "scene.xml"
    if parser.parse_args().check:
        if not path.is_file() or path.read_text(encoding="utf-8") != scene():
            print(f"{path} is stale: run scripts/puma560_scene.py", file=sys.stderr)
            return 1
        return 0
    path.write_text(scene(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
