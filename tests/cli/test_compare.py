"""``torquebench compare``: agreement, disagreement, and bad arguments."""

import json

import numpy as np
import pytest

from tests.arms import THREE
from torquebench import Sine


def test_mujoco_and_the_analytic_arm_agree(command):
    """All terms, link parameters, single steps and six closed loops; status 0. The picture has a mark for each row."""
    status, out, err = command("compare", "mujoco:puma560", "analytic:puma560", "--rollout", "1")
    assert (status, err) == (0, "")
    assert "agree: 18 of 18" in out
    picture = out.partition("● agrees")[0]
    assert picture.count("●") == 18
    assert picture.count("|") == 18


def test_a_generic_arm_agrees_too(command):
    """Another number of joints, read through MuJoCo's compiler."""
    assert command("compare", "mujoco:two-link", "analytic:two-link", "--rollout", "1")[0] == 0


def test_differing_models_say_in_which_term(command):
    """`corrected` differs from `exact` in M and V, not in gravity; status 1."""
    arguments = ("analytic:puma560", "analytic:puma560:corrected", "--frozen-joints", "4,5,6")
    status, out, _ = command("compare", *arguments, "--json")
    rows = {row["term"]: row for row in json.loads(out)["rows"]}
    assert status == 1
    assert not rows["mass matrix"]["agrees"]
    assert rows["mass matrix"]["absolute"] <= 3.2e-3
    assert rows["gravity"]["agrees"]
    assert rows["tool pose"]["agrees"]


def test_a_looser_tolerance_turns_it_green(command):
    """The limit is the user's: 1 % covers the corrected form."""
    arguments = ("analytic:puma560", "analytic:puma560:corrected", "--frozen-joints", "4,5,6")
    assert command("compare", *arguments, "--tolerance", "0.01")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "messages"),
    [
        (("mujco:puma560", "analytic:puma560"), ["A: ", "did you mean 'mujoco'?"]),
        (("mujoco:puma56", "analytic:pumas"), ["A: ", "B: ", "did you mean 'puma560'?"]),
        (("analytic:puma560:exat", "analytic:puma560"), ["did you mean 'exact'?"]),
        (("analytic:puma560:exact:printed", "analytic:puma560"), ["seven exact ties"]),
        (("analytic:puma560:corrected:fited", "analytic:puma560"), ["did you mean 'fitted'?"]),
        (("analytic:two-link:corrected", "analytic:two-link"), ["'exact'"]),
        (("analytic:puma560:a:b:c", "analytic:puma560"), ["too many parts"]),
        (("missing.xml", "analytic:puma560"), ["no such file"]),
        (("mujoco:../../etc/passwd", "analytic:puma560"), ["not a plain name"]),
        (("analytic:puma560", "analytic:two-link"), ["2 joints, wanted 6"]),
        (("analytic:puma560", "analytic:puma560", "--states", "0"), ["--states"]),
        (("analytic:puma560", "analytic:puma560", "--tolerance", "nan"), ["--tolerance"]),
        (("analytic:puma560", "analytic:puma560", "--rollout", "-1"), ["--rollout"]),
        (("analytic:puma560", "analytic:puma560", "--rollout", "1e-10"), ["--rollout"]),
        (("analytic:puma560", "analytic:puma560", "--rollout", "0.0015"), ["--rollout"]),
        (("analytic:puma560", "analytic:puma560", "--seed", "-1"), ["--seed"]),
        (("analytic:puma560", "analytic:puma560", "--frozen-joints", "7"), ["--frozen-joints"]),
    ],
)
def test_bad_arguments(command, arguments, messages):
    """Exit 2, nothing on standard output, each message in one line."""
    status, out, err = command("compare", *arguments)
    assert (status, out) == (2, "")
    assert all(message in err for message in messages), err
    assert "Traceback" not in err


def test_the_command_ends_in_a_line_for_an_issue(command, tmp_path):
    """It has the command, the version and the term; the JSON has the same; status 1."""
    arm, other = tmp_path / "a.xml", tmp_path / "b.xml"
    arm.write_text(THREE)
    other.write_text(THREE.replace('name="j2"', 'name="j2" damping="0.4"'))
    status, out, _ = command("compare", str(arm), str(other), "--states", "20")
    line = out.strip().splitlines()[-1]
    assert status == 1
    assert line.startswith(f"`torquebench compare {arm} {other} --states 20 --seed 0` (torquebench ")
    assert line.endswith("B differs from A by damping of joint 'j2': +0.4 N m s/rad in B")
    told = json.loads(command("compare", str(arm), str(other), "--states", "20", "--json")[1])
    assert told["terms"] == [{"name": "damping", "where": "joint 'j2'", "number": "+0.4 N m s/rad in B"}]
    assert line.endswith(told["sentence"])


def test_a_motion_of_ones_own_gives_the_states(command, tmp_path):
    """Its velocity in degrees is named though both arms are one; columns that are not there are a mistake."""
    t = np.arange(0.0, 1.0, 0.01)
    q, qd, _ = Sine((0.5, 0.4), 1.0)(t)
    path = tmp_path / "motion.csv"
    table = np.column_stack([t, q, np.degrees(qd)])
    np.savetxt(path, table, delimiter=",", header="t,q1,q2,qd1,qd2", comments="")
    sides = "mujoco:two-link", "analytic:two-link"
    status, out, _ = command("compare", *sides, "--motion", str(path))
    assert status == 1
    assert out.count("57.2958 times the derivative of the position: degrees/s beside radians?") == 4
    path.write_text("t,q1,q2\n0,0,0\n")
    status, _, err = command("compare", *sides, "--motion", str(path))
    assert (status, "has no column qd1, qd2" in err) == (2, True)
