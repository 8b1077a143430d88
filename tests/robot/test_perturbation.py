"""Links that differ from the file's and are bodies still: against clouds of points, Pinocchio and MuJoCo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.errata.independent import Arm
from tests.sim.arm_files import LEAN
from torquebench.comparison import random_states
from torquebench.disturbances import Stream, generator
from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot import Puma560, load_model
from torquebench.robot.flat_model import Model
from torquebench.robot.links import check_physical, pseudo_inertia
from torquebench.robot.mjcf import compile_arm, flatten
from torquebench.robot.mjcf_links import links_of, with_links
from torquebench.robot.perturbation import FACTORS, Links, draw_factors, links_in, perturbed, scaled
from torquebench.sim.plants.mujoco import MujocoModel, MujocoPlant


def factors_of(n: int, relative: float, draw: int = 0) -> Array:
    """Return the factors of one draw."""
    return draw_factors(n, relative, generator(7, draw, Stream.PERTURBATION))


def cloud(mass: float, com: Array, inertia: Array) -> tuple[Array, Array]:
    """Return six point masses that are together this body: weights (6,) and positions (6, 3)."""
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    sizes, axes = np.linalg.eigh(second)
    arms = axes.T * np.sqrt(3.0 * np.maximum(sizes, 0.0) / mass)[:, None]
    return np.full(6, mass / 6.0), com + np.concatenate([arms, -arms])


def body_of(weights: Array, positions: Array) -> tuple[float, Array, Array]:
    """Return mass, centre of mass and inertia about it of point masses, from their definitions."""
    mass = float(np.sum(weights))
    com = weights @ positions / mass
    inertia = np.zeros((3, 3))
    for m, r in zip(weights, positions - com, strict=True):
        inertia += m * (np.dot(r, r) * np.eye(3) - np.outer(r, r))
    return mass, com, inertia


def by_cloud(links: Links, factors: Array) -> list[tuple[float, Array, Array]]:
    """Return the bodies of links whose clouds are moved, stretched along the link's axes and weighed anew."""
    found = []
    for i in range(len(links.mass)):
        f = dict(zip(FACTORS, factors[i], strict=True))
        weights, positions = cloud(links.mass[i], links.com[i], links.inertia[i])
        stretch = np.sqrt(np.array([f["spread x"], f["spread y"], f["spread z"]]) / f["mass"])
        moved = links.com[i] * np.array([f["com x"], f["com y"], f["com z"]])
        found.append(body_of(weights * f["mass"], moved + (positions - links.com[i]) * stretch))
    return found


@pytest.mark.parametrize("name", ["puma560", "two-link"])
@pytest.mark.parametrize("relative", [0.1, 0.3, 0.9])
def test_scaling_is_what_it_says_of_a_cloud_of_points(name: str, relative: float) -> None:
    """Mass, centre of mass and inertia are those of the moved, stretched and reweighed cloud; 1e-12 of each."""
    links = links_in(load_model(name).flat)
    factors = factors_of(len(links.mass), relative)
    changed = scaled(links, factors)
    for i, (mass, com, inertia) in enumerate(by_cloud(links, factors)):
        assert changed.mass[i] == pytest.approx(mass, rel=1e-12)
        assert changed.com[i] == pytest.approx(com, rel=1e-12, abs=1e-15)
        assert changed.inertia[i] == pytest.approx(inertia, rel=1e-12, abs=1e-12 * np.max(np.abs(inertia)))
    assert changed.armature == pytest.approx(links.armature * factors[:, 7], rel=1e-15)


@pytest.mark.parametrize("name", ["puma560", "two-link"])
def test_every_link_stays_a_possible_body(name: str) -> None:
    """At spreads up to 90 % every pseudo-inertia is positive definite, by construction: nothing is redrawn."""
    arm = load_model(name)
    for draw in range(100):
        flat = perturbed(arm, factors_of(arm.n, 0.9, draw)).flat
        check_physical(flat, "drawn")
        for i in range(arm.n):
            assert np.linalg.eigvalsh(pseudo_inertia(flat.mass[i], flat.com[i], flat.inertia[i]))[0] > 0.0


def test_nothing_leaves_the_stated_spread() -> None:
    """Masses, coordinates of centres, diagonals of inertias and rotors are within 1 +- r, and beyond 1 +- 0.9 r."""
    arm, r, seen = Puma560(), 0.3, []
    for draw in range(50):
        flat = perturbed(arm, factors_of(6, r, draw)).flat
        for new, old in (
            (flat.mass, arm.flat.mass),
            (flat.com, arm.flat.com),
            (flat.armature, arm.flat.armature),
            (np.diagonal(flat.inertia, axis1=1, axis2=2), np.diagonal(arm.flat.inertia, axis1=1, axis2=2)),
        ):
            there = old != 0.0
            assert np.all(np.asarray(new)[~there] == 0.0)
            seen.append((np.asarray(new)[there] / old[there]).ravel())
    ratio = np.concatenate(seen)
    assert np.all(np.abs(ratio - 1.0) <= r * (1.0 + 1e-12))
    assert np.min(ratio) < 1.0 - 0.9 * r
    assert np.max(ratio) > 1.0 + 0.9 * r
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)


def test_the_perturbed_arm_is_pinocchios(figure: Any) -> None:
    """M and inverse dynamics of a draw at 30 %, at 500 states, against Pinocchio given the clouds' inertias."""
    arm, factors, theirs = Puma560(), factors_of(6, 0.3), Arm()
    for i, (mass, com, inertia) in enumerate(by_cloud(links_in(arm.flat), factors)):
        theirs.model.inertias[i + 1] = pin.Inertia(mass, com, inertia)
    theirs.model.armature = arm.flat.armature * factors[:, 7]
    theirs.data = theirs.model.createData()
    drawn, (q, qd, qdd) = perturbed(arm, factors), random_states(6, 500, seed=6)
    torque = np.array([pin.rnea(theirs.model, theirs.data, *s) for s in zip(q, qd, qdd, strict=True)])
    gap = np.max(np.linalg.norm(drawn.inverse_dynamics(q, qd, qdd) - torque, axis=1) / np.linalg.norm(torque, axis=1))
    figure("inverse dynamics of a perturbed arm, Pinocchio against exact, relative", gap, "<= 1e-12")
    assert gap <= 1e-12
    assert np.max(np.abs(drawn.mass_matrix(q) - [theirs.mass_matrix(x) for x in q])) < 1e-12
    assert np.max(np.abs(drawn.mass_matrix(q) - arm.mass_matrix(q))) > 0.3


@pytest.mark.parametrize("name", ["puma560", "two-link"])
def test_both_plants_are_perturbed_alike(name: str, figure: Any) -> None:
    """MuJoCo's M and bias of its own links scaled are the analytic model's; 1e-12 of each, at random states."""
    arm = load_model(name)
    factors, engine = factors_of(arm.n, 0.3), MujocoModel(name)
    engine._m = with_links(engine._m, scaled(links_of(engine._m), factors))
    drawn, (q, qd, _) = perturbed(arm, factors), random_states(arm.n, 200, seed=7)
    gaps = [
        float(np.max(np.abs(a - b)) / np.max(np.abs(b)))
        for a, b in (
            (drawn.mass_matrix(q), engine.mass_matrix(q)),
            (drawn.bias_forces(q, qd), engine.bias_forces(q, qd)),
        )
    ]
    figure(f"M and bias of a perturbed {name}, MuJoCo against exact, relative", max(gaps), "<= 1e-12")
    assert max(gaps) <= 1e-12


@pytest.mark.parametrize("name", ["hinges", "hinges and slides", "two joints on a body", "a body welded on"])
def test_arms_of_other_kinds(name: str, tmp_path: Path) -> None:
    """The links read back from MuJoCo's changed model are those that were meant, joints turned and bodies welded on."""
    file = tmp_path / "arm.xml"
    file.write_text(LEAN[name]())
    m = compile_arm(file).model
    wanted = scaled(links_of(m), factors_of(m.nv, 0.3))
    plant = MujocoPlant(file, factors=factors_of(m.nv, 0.3))
    for x, y in zip(links_of(plant._m), wanted, strict=True):
        assert x == pytest.approx(y, rel=1e-12, abs=1e-13)
    model: Model = flatten(plant._m, "changed")
    assert model.mass == pytest.approx(wanted.mass)


def test_draws_are_keyed() -> None:
    """The same seed and draw give the same factors; another of either gives others; no factor follows another."""
    assert factors_of(6, 0.3, 1).tobytes() == factors_of(6, 0.3, 1).tobytes() != factors_of(6, 0.3, 2).tobytes()
    many = np.array([factors_of(6, 0.3, k).ravel() for k in range(400)])
    assert many.std(axis=0) == pytest.approx(0.3 / np.sqrt(3.0) * np.ones(48), rel=0.15)
    assert np.max(np.abs(np.corrcoef(many, rowvar=False) - np.eye(48))) < 4.5 / np.sqrt(400)


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_closed_forms_have_no_links_to_perturb(structure: Any) -> None:
    """A ModelError that says so."""
    with pytest.raises(ModelError, match="in structure 'exact' only"):
        perturbed(Puma560(structure, "fitted"), factors_of(6, 0.1))
