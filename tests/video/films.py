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
    """Position (3,) and axes (right, up) of a camera, from the text of the PUMA's scene.xml."""
    root = ElementTree.parse(data_root() / "models" / "puma560" / "scene.xml").getroot()
    camera = next(c for c in root.iter("camera") if c.get("name") == name)
    position = np.array([float(x) for x in camera.get("pos").split()])
    axes = np.array([float(x) for x in camera.get("xyaxes").split()]).reshape(2, 3)
    return position, axes


def slopes(point, camera):
    """Tangents of the angles, to the right and up, at which a pinhole camera sees a point."""
    position, (right, up) = camera
    away = np.asarray(point) - position
    return np.array([away @ right, away @ up]) / (away @ -np.cross(right, up))


def pixel(point, camera, part, width, height):
    """Where a picture of a part of what a camera sees has a point, right and down from its upper left corner.

    The part is given by its left, right, lower and upper edge, as tangents.
    """
    left, right, bottom, top = part
    x, y = slopes(point, camera)
    return np.array([width * (x - left) / (right - left), height * (top - y) / (top - bottom)])


def tool_mark(picture):
    """Centre of what is coloured like the mark of the tool, in pixels; None when nothing is."""
    r, g, b = (picture[:, :, i].astype(int) for i in range(3))
    rows, columns = np.nonzero((r - g > 70) & (b - g > 25))
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5]) if len(rows) else None
