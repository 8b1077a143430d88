"""The digest of last bits: one for both paths, another where a library rounds otherwise."""

import math
import os
import platform
import subprocess
import sys

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


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the routines are named by processors of this kind")
def test_other_routines_of_linear_algebra_are_another_digest():
    """OpenBLAS as for a processor of 2004 sums in another order: numpy's digest tells, that of Python does not."""
    code = "from torquebench.kernel import arithmetic as a; print(a.arrays(), a.interpreted())"
    told = [
        subprocess.run([sys.executable, "-c", code], env=os.environ | more, capture_output=True, text=True, check=True)
        for more in ({}, {"OPENBLAS_CORETYPE": "Prescott"})
    ]
    (here, numbers), (other, same) = (one.stdout.split() for one in told)
    assert here == arithmetic.arrays()
    assert other != here
    assert same == numbers
