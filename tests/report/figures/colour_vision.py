"""Colour vision, independent of the package: dichromacy after Machado et al., and the CIEDE2000 difference."""

from __future__ import annotations

import math

import numpy as np

from torquebench.kernel import Array

SIGHT: dict[str, Array] = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""Machado, Oliveira and Fernandes, IEEE TVCG 15(6), 2009, severity 1.0; they act on linear RGB."""
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
"""From linear sRGB, D65 (IEC 61966-2-1)."""


def linear(colour: str) -> Array:
    """Return a colour #RRGGBB as linear RGB."""
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(colour: str, sight: str = "normal") -> Array:
    """Return a colour as CIELAB sees it through one kind of sight."""
    xyz = XYZ @ np.clip(SIGHT[sight] @ linear(colour), 0.0, 1.0) / np.array([0.95047, 1.0, 1.08883])
    x, y, z = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def difference(one: Array, two: Array) -> float:
    """Return the CIEDE2000 difference of two CIELAB colours (Sharma, Wu and Dalal, Color Res. Appl. 30(1), 2005)."""
    (l1, a1, b1), (l2, a2, b2) = one, two
    mean = (math.hypot(a1, b1) + math.hypot(a2, b2)) / 2.0
    stretch = 1.5 - 0.5 * math.sqrt(mean**7 / (mean**7 + 25.0**7))
    c1, c2 = math.hypot(stretch * a1, b1), math.hypot(stretch * a2, b2)
    h1, h2 = (math.degrees(math.atan2(b, stretch * a)) % 360.0 for a, b in ((a1, b1), (a2, b2)))
    turn = (h2 - h1 + 180.0) % 360.0 - 180.0 if c1 * c2 else 0.0
    hue = 2.0 * math.sqrt(c1 * c2) * math.sin(math.radians(turn / 2.0))
    light, c = (l1 + l2) / 2.0, (c1 + c2) / 2.0
    h = (h1 + turn / 2.0) % 360.0 if c1 * c2 else h1 + h2
    waves = ((-0.17, 1.0, -30.0), (0.24, 2.0, 0.0), (0.32, 3.0, 6.0), (-0.20, 4.0, -63.0))
    t = 1.0 + sum(size * math.cos(math.radians(k * h + phase)) for size, k, phase in waves)
    by_l = (l2 - l1) / (1.0 + 0.015 * (light - 50.0) ** 2 / math.sqrt(20.0 + (light - 50.0) ** 2))
    by_c, by_h = (c2 - c1) / (1.0 + 0.045 * c), hue / (1.0 + 0.015 * c * t)
    blue = 60.0 * math.exp(-(((h - 275.0) / 25.0) ** 2))
    turned = -2.0 * math.sqrt(c**7 / (c**7 + 25.0**7)) * math.sin(math.radians(blue))
    return math.sqrt(by_l**2 + by_c**2 + by_h**2 + turned * by_c * by_h)
