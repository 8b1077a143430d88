"""No two laws, and no two forms of a law, are the same: eight names for one saturated PD would not be eight laws."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.arms import two_link
from tests.laws.forms import Options, default_form, forms, shipped
from torquebench.fuzzy import DEFAULT
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.references import Reference

Q, QD = np.array([0.4, -0.9]), np.array([0.7, -0.2])
E, DE = np.array([-0.05, 0.06]), np.array([0.9, -0.3])
REF = Reference(Q + E, QD + DE, np.array([-1.1, 2.3]))
"""At lambda 10 and 11 the errors have s = de + lambda e of 0.4 and 0.36."""
INTEGRAL = 0.012
"""Each part of a law's memory is a multiple of this on joint 1, and minus as much on joint 2.

With it s is -0.2 and 0.297 on the pi surface of (85), and 0.7 and -0.003 on the pid surface of (86): of any two
surfaces some joint has another sign.
"""
SIZE = {
    "1/s": 10.0,
    "1": 0.3,
    "rad/s": 1.0,
    "1/s^3": 100.0,
    "1/s^2": 30.0,
    "rad/s^2": 60.0,
    "rad": 0.15,
    "rad s": 0.05,
    "rad^0.5/s^1.5": 4.0,
    "rad/s^3": 30.0,
    "N m/rad": 200.0,
    "N m s/rad": 20.0,
    "N m/(rad s)": 100.0,
    "N m": 4.0,
    "rad^0.5/s^2.5": 50.0,
    "1/rad": 20.0,
}
"""Size of a gain by its unit; bands are wider than s, so that sgn and sat are told apart."""


def memory_of(law: str) -> Any:
    """Return a law's memory with numbers everywhere, another in each field."""
    memory = find_law(law).new_memory(2)
    for k, field in enumerate(memory):
        # s is written before it is read by the laws that have it; the rest counts up from 1
        field[:] = np.array([INTEGRAL, -INTEGRAL])[: len(field)] * max(k, 1)
    return memory


def torque(law: str, options: Options) -> Array:
    """Return the torque of a law at the state above, with gains of their units' sizes.

    No two gains of a law are equal: with gd = phi, clip(e/ge + de/gd) is sat(s/phi).
    """
    found = find_law(law)
    gains = {
        name: (1.0 + 0.07 * k) * SIZE[gain.unit] * np.array([1.0, 1.1])
        for k, (name, gain) in enumerate(found.gains.items())
        if gain.acts(options)
    }
    packed = found.pack_gains(
        2, gains, options, DEFAULT if found.rules and found.fuzzy_problem(options) is None else None
    )
    tau = np.zeros(2)
    flat = replace(two_link().flat, control_period=0.002)
    found.function(packed, flat, 0.7, Q.copy(), QD.copy(), REF, memory_of(law), tau)
    return tau


def closest(torques: Mapping[str, Array]) -> tuple[float, str, str]:
    """Return how far apart the two are that are closest [N m], and which they are."""
    return min((float(np.max(np.abs(torques[a] - torques[b]))), a, b) for a, b in itertools.combinations(torques, 2))


def test_no_two_laws_are_the_same() -> None:
    """Any two laws that ship, as they are by default, differ at this state; the smallest torque limit is 25 N m."""
    gap, a, b = closest({law: torque(law, default_form(law)) for law in shipped()})
    assert gap > 1e-3, (a, b)


@pytest.mark.parametrize("law", [law for law in shipped() if len(find_law(law).options) > 1])
def test_no_two_forms_of_a_law_are_the_same(law: str) -> None:
    """Any two choices of a law's options differ at this state."""
    torques = {str(options): torque(law, options) for options in forms(law)}
    gap, a, b = closest(torques)
    assert gap > 1e-3, (a, b)
    assert len(torques) >= 4
