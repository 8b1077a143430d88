"""What Python computes without any compiled code, and what the native path computes, are the same bytes."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from tests.sim.interpreted import SMALL, cases, interpreted_digests
from tests.sim.protocol import PLANTS, REFERENCES, plain_form, variants
from torquebench.laws import law_names


def test_interpreted_and_native_runs_give_the_same_bytes(
    large: bool, size: Any, figure: Any, tell: Callable[[str], None]
) -> None:
    """Every law and option on both plants and every reference, with the chains: 0 trajectories differ.

    The interpreted side runs in processes of its own with numba switched off: law, loop and analytic plant are then
    the Python source itself. The large size is 20,000 instants.
    """
    n_steps, chosen = size(40, 20_000), cases(large)
    wrong, seen, completed = [], set(), 0
    for index, digest in interpreted_digests(n_steps, large, min(os.cpu_count() or 1, size(2, 8))):
        run = chosen[index].run(n_steps, "native")
        seen.add(index)
        completed += run.completed
        if run.digest() != digest:
            wrong.append(str(chosen[index]))
        tell(f"{len(seen)} of {len(chosen)}: {chosen[index]}: {'differs' if run.digest() != digest else 'equal'}")
    figure(f"trajectories that differ, interpreted or native, {len(chosen)} of {n_steps} instants", len(wrong), "0")
    assert wrong == []
    assert seen == set(range(len(chosen)))
    assert completed >= 0.9 * len(chosen)


def test_the_cases_are_all_laws_on_both_plants_and_all_references() -> None:
    """The large size has every form of every law on every plant and reference; the small one has fewer plants.

    There every law, as it is by default, meets every reference and every plant, and every form one plant of each kind.
    """
    every = {(p, v, r) for p in PLANTS for v in variants() for r in REFERENCES}
    assert {case[:3] for case in cases(large=True)} == every
    assert {case.variant.law for case in cases(large=False)} == set(law_names())
    small = cases(large=False)
    plain = [case for case in small if case.variant.options == plain_form(case.variant.law)]
    assert {(case.variant.law, case.reference) for case in plain} == {(x, r) for x in law_names() for r in REFERENCES}
    assert {(case.variant.law, case.plant) for case in plain} == {(x, p) for x in law_names() for p in SMALL}
    engines = {(case.variant, case.plant.split()[0]) for case in small}
    assert engines == {(v, engine) for v in variants() for engine in ("mujoco", "analytic")}
    assert {case.plant for case in small} == set(SMALL)
