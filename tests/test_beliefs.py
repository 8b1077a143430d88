"""What a law reads of its model, as its source tells it, against what its torque depends on."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.user_files import load
from torquebench import Puma560, find_law, law_names
from torquebench.beliefs import fields_read
from torquebench.check_cases import combinations, gains_of, motions
from torquebench.laws import Law
from torquebench.references import Reference
from torquebench.robot.flat_model import Model, own_copy
from torquebench.sim.interpreted import Call

DYNAMICS = {"structure", "rotation", "offset", "mass", "com", "inertia", "armature", "gravity", "constants"}
CLOSED_FORMS = {"structure", "constants"}
"""Of these, what a law that computes with links does not read."""


def torques(law: Law, gains: Any, model: Model) -> bytes:
    """Return torque and memory over some stretches of motion, in bytes."""
    found = b""
    for motion in motions(6)[2:]:
        memory = law.new_memory(6)
        call = Call(law, gains, own_copy(model), memory)
        for k, t in enumerate(motion.t.tolist()):
            tau, _, _ = call(
                t, motion.q[k], motion.qd[k], Reference(motion.q_ref[k], motion.qd_ref[k], motion.qdd_ref[k])
            )
            found += tau.tobytes() + b"".join(x.tobytes() for x in memory)
    return found


def spoiled(model: Model, kept: frozenset[str]) -> Model:
    """Return a model in which every number is another one, but for some fields."""
    own = {f.name: getattr(model, f.name) for f in fields(model) if f.init and f.name not in {*kept, "scratch"}}
    changed = {name: x + 7.0 for name, x in own.items() if isinstance(x, np.ndarray) and x.dtype == np.float64}
    return replace(model, **changed, **({} if "control_period" in kept else {"control_period": 0.5}))


@pytest.mark.parametrize("name", [*law_names()])
def test_what_a_law_does_not_read_changes_nothing(name: str) -> None:
    """Under every choice of options: with all that it does not read spoiled, torque and memory have the same bytes.

    And where it is said to read the dynamics, other dynamics change its torque: nothing is claimed too much there.
    """
    law = find_law(name)
    model = (Puma560() if law.rigid_only else Puma560("corrected", "printed")).flat
    for options in combinations(law):
        gains = law.pack_gains(6, gains_of(law, 6, options, 1), options)
        read = fields_read(law, gains)
        assert read is not None
        before = torques(law, gains, model)
        assert torques(law, gains, spoiled(model, read)) == before
        if read & DYNAMICS:
            assert read >= DYNAMICS - (CLOSED_FORMS if law.rigid_only else set())
            assert torques(law, gains, replace(model, constants=1.1 * model.constants, mass=1.1 * model.mass)) != before


LAW = '''"""A user's law."""
from typing import Annotated, NamedTuple
from torquebench import Array, Gain, Option, controller, gravity
from torquebench.kernel import kernel

NONE = 0

class Gains(NamedTuple):
    k: Annotated[Array, Gain("stiffness", "N m/rad")]
    use: Annotated[int, Option("use the model", (False, True))]

@kernel
def maybe(use: int, model: object, q: Array, tau: Array) -> None:
    if use == NONE:
        return
    gravity(model, q, tau)

@controller("a-law", gains=Gains)
def a_law(gains, model, t, q, qd, ref, memory, tau):
    for i in range(len(tau)):
        tau[i] = 0.0
    {body}
    for i in range(len(tau)):
        tau[i] += gains.k[i] * (ref.q[i] - q[i])
'''


@pytest.mark.parametrize(
    ("body", "without", "with_model"),
    [
        ("maybe(gains.use, model, q, tau)", set(), DYNAMICS),
        ("if gains.use:\n        gravity(model, q, tau)", set(), DYNAMICS),
        ("if not gains.use:\n        return\n    gravity(model, q, tau)", set(), DYNAMICS),
        ("x = model.tau_max[0] if gains.use else 1.0", set(), {"tau_max"}),
        ("x = gains.use and model.tau_max[0] > 1.0", set(), {"tau_max"}),
        ("if t > 1e9:\n        gravity(model, q, tau)", DYNAMICS, DYNAMICS),
        ("while gains.use > 5:\n        gravity(model, q, tau)", DYNAMICS, DYNAMICS),
        ("use = gains.use\n    maybe(use, model, q, tau)", DYNAMICS, DYNAMICS),
        ("other = model\n    gravity(other, q, tau)", None, None),
        ("print(model)", None, None),
    ],
)
def test_a_users_law_is_followed_as_its_options_decide(
    body: str, without: set[str] | None, with_model: set[str] | None, tmp_path: Path, registries: None
) -> None:
    """A branch that an option decides is left out; any other counts; what cannot be followed may read everything."""
    load(tmp_path, LAW.replace("{body}", body))
    law = find_law("a-law")
    for use, wanted in ((False, without), (True, with_model)):
        read = fields_read(law, law.pack_gains(2, {"k": 1.0}, {"use": use}))
        assert (read is None) == (wanted is None)
        assert read is None or (read >= wanted if wanted else not read)  # type: ignore[operator]
