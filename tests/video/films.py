"""Reading films back, and where a point must be in a picture: formulas that share nothing with the package."""

from __future__ import annotations

import re
import subprocess
import xml.etree.ElementTree as ElementTree

import numpy as np

from torquebench.robot.library import data_root
from torquebench.video.encode import ffmpeg_program


def frames_of(path, width, height):
    """Decode a film: its frames (N, height, width, 3) and the duration that its file states [s]."""
    command = [ffmpeg_program(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    hours, minutes, seconds = re.search(rb"Duration: (\d+):(\d+):([\d.]+)", done.stderr).groups()
    pixels = np.frombuffer(done.stdout, np.uint8)
    assert len(pixels) % (width * height * 3) == 0
    return pixels.reshape(-1, height, width, 3), 3600 * int(hours) + 60 * int(minutes) + float(seconds)


def camera_of_scene(name):
    """Position (3,), axes (right, up) and vertical opening [rad] of a camera, from the text of the PUMA's scene.xml."""
    root = ElementTree.parse(data_root() / "models" / "puma560" / "scene.xml").getroot()
    camera = next(c for c in root.iter("camera") if c.get("name") == name)
    position = np.array([float(x) for x in camera.get("pos").split()])
    axes = np.array([float(x) for x in camera.get("xyaxes").split()]).reshape(2, 3)
    return position, axes, np.deg2rad(float(camera.get("fovy")))


def pixel(point, camera, width, height):
    """Where a pinhole camera shows a point, right and down from the upper left corner of a frame wider than high.

    A plane at distance z is seen h = 2 z tan(opening/2) high, over `height` pixels.
    """
    position, (right, up), opening = camera
    away = np.asarray(point) - position
    z = away @ -np.cross(right, up)
    size = height / (2.0 * z * np.tan(opening / 2.0))
    return np.array([width / 2.0 + size * (away @ right), height / 2.0 - size * (away @ up)])


def tool_mark(picture):
    """Centre of what is coloured like the mark of the tool, in pixels; None when nothing is."""
    r, g, b = (picture[:, :, i].astype(int) for i in range(3))
    rows, columns = np.nonzero((r - g > 70) & (b - g > 25))
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5]) if len(rows) else None
