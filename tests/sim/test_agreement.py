"""MuJoCo and the analytic plant run the same closed loop, and the comparison notices the smallest change."""

import re
import subprocess
import sys

import numpy as np
import pytest

from torquebench import AnalyticPlant, Controller, MujocoPlant, Puma560, find_law, simulate
from torquebench.comparison import (
    ROLLOUT_TOLERANCE,
    compare_links,
    compare_rollouts,
    compare_terms,
    parse_side,
    random_states,
)
from torquebench.references import Ramp, Sine, Step
from torquebench.robot.library import model_folder

SINE = Sine(np.array([1.2, -1.0, 1.0, 1.0, 1.0, 1.0]), np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0]))
STEP = Step(np.array([1.0, -0.8, 0.8, 0.6, 0.6, 0.6]), 0.2)
RAMP = Ramp(np.array([2.5, -1.5, 1.5, 1.5, 1.5, 1.5]), 3.0)
REFERENCES = {"sine": SINE, "step": STEP, "ramp": RAMP}
LAWS = {
    "sign": ("smc", {"lam": 10, "k": 0.3}, {"switching": "sign"}),
    "linear band": ("linear-band-smc", {"lam": 10, "k": 0.3, "phi": 0.3, "kv": 20}, {}),
}


def controller(name):
    """One of the two laws, at the literature gains."""
    law_name, gains, options = LAWS[name]
    law = find_law(law_name)
    return Controller(name, law, law.pack_gains(6, gains, options))


@pytest.mark.parametrize("integrator", ["rk4", "euler"])
@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("law", LAWS)
def test_closed_loops_agree(law, reference, integrator, figure):
    """5 s of closed loop, 1 ms: joint angles within 1e-12 rad, switching law included.

    Round-off of 5,000 steps is a few 1e-15 rad; 1e-12 leaves room for other processors. The belief is the paper's
    (corrected, printed constants), as in Fig 9.
    """
    belief = Puma560("corrected", "printed")
    runs = [
        simulate(plant, controller(law), belief, REFERENCES[reference], duration=5.0)
        for plant in (MujocoPlant("puma560", 0.001, integrator), AnalyticPlant(Puma560(), 0.001, integrator))
    ]
    gap = np.max(np.abs(runs[0].q - runs[1].q))
    figure(f"MuJoCo against analytic, 5 s, {integrator}, {law}, {reference} [rad]", gap, "<= 1e-12")
    assert gap <= ROLLOUT_TOLERANCE
    assert np.max(np.abs(runs[0].q)) > 0.5  # the arm did move


def numbers_of_the_xml():
    """Every mass, first inertia number, and armature in the XML: (what, position in the file, text of the number)."""
    text = (model_folder("puma560") / "puma560.xml").read_text()
    found = []
    for attribute in ("mass", "fullinertia", "armature"):
        for link, match in enumerate(re.finditer(rf'\b{attribute}="([^"]+)"', text), start=1):
            for index, number in enumerate(re.finditer(r"[-+.\de]+", match[1])):
                if float(number[0]) != 0.0:
                    place = match.start(1) + number.start()
                    found.append((f"{attribute}[{index}] of link {link}", place, number[0]))
    return text, found


def test_every_inertia_changed_alone_turns_the_comparison_red(tmp_path):
    """Each nonzero mass, inertia and armature of the XML, one at a time, by 1e-6 relative: never 'agree'.

    Link parameters are compared too, because some of them (link 1's mass and Ixx, say) no joint torque can show.
    """
    text, numbers = numbers_of_the_xml()
    analytic = parse_side("analytic:puma560", "B")
    states = random_states(6, 20, seed=2)
    path = tmp_path / "changed.xml"
    assert len(numbers) == 6 + (3 * 6 + 2 * 3) + 6
    for what, place, number in numbers:
        moved = f"{float(number) * (1 + 1e-6):.17g}"
        path.write_text(text[:place] + moved + text[place + len(number) :])
        side = parse_side(str(path), "A")
        rows = compare_terms(side.dynamics, analytic.dynamics, states, 1e-12)
        rows += compare_links(side.links, analytic.links, 1e-12)
        assert not all(row.agrees for row in rows), what


def test_unchanged_xml_is_green(tmp_path):
    """The same comparison on the unchanged text agrees, so that red means the change."""
    path = tmp_path / "same.xml"
    path.write_text(numbers_of_the_xml()[0])
    side, analytic = parse_side(str(path), "A"), parse_side("analytic:puma560", "B")
    rows = compare_terms(side.dynamics, analytic.dynamics, random_states(6, 20, seed=2), 1e-12)
    rows += compare_links(side.links, analytic.links, 1e-12)
    assert all(row.agrees for row in rows), [row.term for row in rows if not row.agrees]


@pytest.mark.parametrize("number", ["0.0856236390", "1.14", "0.00179919531"])
def test_the_rollouts_alone_turn_red_too(tmp_path, number):
    """An elbow inertia, a motor inertia and a wrist inertia, 1e-6 relative, move the closed loops beyond 1e-12 rad."""
    text, numbers = numbers_of_the_xml()
    what, place, written = next(x for x in numbers if x[2].startswith(number))
    path = tmp_path / "changed.xml"
    path.write_text(text[:place] + f"{float(written) * (1 + 1e-6):.17g}" + text[place + len(written) :])
    sides = parse_side(str(path), "A"), parse_side("analytic:puma560", "B")
    rows = compare_rollouts(*sides, Puma560("corrected", "printed"), duration=2.0)
    assert not all(row.agrees for row in rows), what


def test_the_analytic_side_runs_without_mujoco():
    """With `import mujoco` blocked the analytic plant gives the same bytes as with it."""
    code = """
import sys
{block}
import numpy as np
from torquebench import AnalyticPlant, Controller, Puma560, find_law, simulate
from torquebench import Sine
law = find_law("linear-band-smc")
gains = law.pack_gains(6, {{"lam": 10, "k": 0.3, "phi": 0.3, "kv": 20}}, {{}})
run = simulate(AnalyticPlant(Puma560()), Controller("x", law, gains), Puma560("corrected", "printed"),
               Sine(1.0, 1.0), duration=0.2)
print(run.digest(), "mujoco" in sys.modules and sys.modules["mujoco"] is not None)
"""
    outputs = []
    for block in ("sys.modules['mujoco'] = None", "import mujoco"):
        done = subprocess.run(
            [sys.executable, "-c", code.format(block=block)], capture_output=True, text=True, check=True
        )
        outputs.append(done.stdout.split())
    assert outputs[0][1] == "False"
    assert outputs[1][1] == "True"
    assert outputs[0][0] == outputs[1][0]


def test_the_sign_of_round_off_is_the_one_thing_the_plants_do_not_share():
    """With a perfect belief and a step, s is round-off until 0.2 s and its sign is each plant's own.

    Stated so that nobody reads the gap as a fault of either plant: the linear band on the same run agrees.
    """
    gaps = {}
    for law in LAWS:
        runs = [
            simulate(plant, controller(law), Puma560(), STEP, duration=1.0)
            for plant in (MujocoPlant("puma560"), AnalyticPlant(Puma560()))
        ]
        gaps[law] = np.max(np.abs(runs[0].q - runs[1].q))
        before = runs[0].t < 0.2
        if law == "linear band":
            assert np.max(np.abs(runs[0].s[before])) < 1e-12
    assert gaps["linear band"] <= ROLLOUT_TOLERANCE
