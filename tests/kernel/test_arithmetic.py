"""The digest of last bits: one for both paths, another where a library rounds otherwise."""

import math

import pytest

from torquebench.kernel import arithmetic
from torquebench.kernel.twin import rebound


def test_both_paths_have_one_digest():
    """Compiled code takes functions from the library that Python takes them from, and fuses nothing."""
    assert arithmetic.compiled() == arithmetic.interpreted()


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "tanh", "log", "pow", "sqrt", "atan2"])
def test_one_last_bit_is_another_digest(name):
    """One value of one function that is one unit in the last place away is noticed."""
    plain, calls = getattr(arithmetic.fill, "py_func", arithmetic.fill), []

    def nudged(*arguments):
        calls.append(arguments)
        value = getattr(math, name)(*arguments)
        return math.nextafter(value, 9.0) if len(calls) == 1234 else value

    own = type("math", (), {**vars(math), name: staticmethod(nudged)})
    assert arithmetic.digest(rebound(plain, lambda value: own if value is math else value)) != arithmetic.interpreted()
