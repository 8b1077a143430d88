#!/usr/bin/env python3
"""Print sigma of the band-limited noise: 0.30 x RMS of the exact inverse-dynamics torque on the reference `sine`.

The mean is over the 4 s of the reference at 1 ms. The vector is stored in the configs and does not change with
the reference that is run.
"""

import sys

import numpy as np

from torquebench import Puma560
from torquebench.references import sine

AMPLITUDE = np.array([1.2, -1.0, 1.0, 1.0, 1.0, 1.0])
FREQUENCY = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0])


def main() -> int:
    """Print the vector [N m], four digits."""
    ref = sine(AMPLITUDE, FREQUENCY)(np.arange(4000) * 0.001)
    tau = Puma560().inverse_dynamics(ref.q, ref.qd, ref.qdd)
    sigma = 0.30 * np.sqrt(np.mean(tau**2, axis=0))
    print("[" + ", ".join(f"{x:.4g}" for x in sigma) + "]")
    return 0


if __name__ == "__main__":
    sys.exit(main())
