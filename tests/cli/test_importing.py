"""``torquebench import``: the table, the folder, the exit statuses, and what is refused before anything is written."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from torquebench.cli.app import main
from torquebench.cli.importing import DROPS
from torquebench.robot import importing
from torquebench.robot.importing import forces
from torquebench.robot.importing.limits import read_limits

LINK = '<inertial mass="1" pos="0.2 0 0" diaginertia="0.01 0.02 0.02"/>'
FINGER = f'<body name="{{0}}" pos="0.4 0 0">{LINK}<joint name="{{0}}_joint" type="slide" axis="0 1 0"/></body>'
ARM = f"""<mujoco><worldbody><body name="one">{LINK}<joint name="a" axis="0 1 0" damping="0.5"/>
<body name="two" pos="0.5 0 0">{LINK}<joint name="b" axis="0 1 0"/>{FINGER.format("left")}{FINGER.format("right")}
</body></body></worldbody></mujoco>"""


@pytest.fixture
def arm(tmp_path: Path, monkeypatch) -> Path:
    """Return a file of an arm with two fingers and no motors, in the working folder."""
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(ARM, encoding="utf-8")
    return Path("arm.xml")


def test_a_refusal_shows_the_table_and_the_line_that_goes_on(arm: Path, capsys) -> None:
    """Nothing is written, the status is 2, and the printed flags take all once each N is a number."""
    assert main(["import", "arm.xml"]) == 2
    out, err = capsys.readouterr()
    assert "refused  branches" in out
    assert "torquebench import arm.xml --fix left,right" in out
    assert [line.partition(";")[0] for line in err.splitlines()] == [
        "arm.xml:2:125: branches of left, right",
        "arm.xml:1:100: torque limits of a, b",
    ]
    assert list(Path().iterdir()) == [arm]
    line = next(line for line in out.splitlines() if line.startswith("  torquebench import"))
    assert "--torque-limits a=N,b=N" in line
    assert main(shlex.split(line.replace("=N", "=9"))[1:]) == 0
    out = capsys.readouterr().out
    assert "given: the file states none" in out
    assert "in place of the file's" not in out


def test_the_offered_line_keeps_limits_that_were_given(arm: Path, capsys) -> None:
    """A number of one joint stays, and the other one's is an N."""
    assert main(["import", "arm.xml", "--tip", "two", "--torque-limits", "b=8"]) == 2
    out = capsys.readouterr().out
    assert "--torque-limits b=8,a=N" in out
    assert "N stands for" in out


def test_an_arm_is_a_folder_with_its_readme(arm: Path, capsys) -> None:
    """The folder has NAME.xml and a README with the command and the table; a second time it is refused."""
    words = ["import", "arm.xml", "--fix", "left", "--fix", "right", "--torque-limits", "9,b=8"]
    assert main(words) == 2
    words[-1] = "9,8"
    assert main([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["joints"] == ["a", "b"]
    assert document["proof"]["mass_matrix"] <= 1e-12
    assert document["directory"] == "arms/arm"
    assert sorted(path.name for path in Path("arms/arm").iterdir()) == document["files"] == ["README.md", "arm.xml"]
    page = Path("arms/arm/README.md").read_text(encoding="utf-8")
    assert "torquebench import arm.xml --fix left,right --torque-limits 9,8 --out arms/arm" in page
    assert "| mapped | joint damping | a |" in page
    before = Path("arms/arm/arm.xml").read_bytes()
    assert main(words) == 2
    assert "--out: arms/arm is not empty: --force replaces" in capsys.readouterr().err
    assert main([*words, "--out", "arms/other"]) == 0
    assert Path("arms/other/other.xml").read_bytes() == before.replace(b'model="arm"', b'model="other"')


def test_what_holding_takes_is_said(arm: Path, capsys) -> None:
    """By hand 9.81 (0.2 + 0.7) = 8.829 N m at the shoulder and 1.962 at the elbow, and what full torque moves.

    On q = 0 the bodies have M = [[0.04 + 0.49 + 0.04, 0.16], [0.16, 0.06]], so that 400 N m at the elbow change its
    speed by 0.4 M11 / det M = 26.5 rad/s in 1 ms.
    """
    words = ["import", "arm.xml", "--tip", "two", "--force", "--torque-limits"]
    assert main([*words, "9,8"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "holding the arm at key:home takes 8.829 N m of a, its limit is 9 N m" in out
    assert "armature" not in out.partition("written:")[2]
    assert main([*words, "90,1"]) == 0
    capsys.readouterr()
    assert main(["show", "arms/arm/arm.xml"]) == 0
    text = "the arm cannot hold itself at key:home: gravity alone needs 1.962 N m of b, its limit is 1 N m"
    assert text in " ".join(capsys.readouterr().out.split())
    assert main([*words, "90,400"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "no armature, the inertia of the rotor, of b: full torque changes the speed of b by 26.5 rad/s in 1 ms" in out
    )


def test_force_replaces_an_imported_arm_and_nothing_else(arm: Path, capsys) -> None:
    """The folder is the new arm's; one with another file in it, or that no import wrote, stays as it is."""
    words = ["import", "arm.xml", "--tip", "two", "--torque-limits"]
    assert main([*words, "9,8"]) == 0
    folder = Path("arms/arm")
    before = (folder / "arm.xml").read_bytes()
    assert main([*words, "7,8"]) == 2
    assert (folder / "arm.xml").read_bytes() == before
    assert main([*words, "7,8", "--force"]) == 0
    assert (folder / "arm.xml").read_bytes() != before
    assert [path.name for path in Path("arms").iterdir()] == ["arm"]
    kept = {path.name: path.read_bytes() for path in folder.iterdir()}
    (folder / "notes.txt").write_text("mine", encoding="utf-8")
    capsys.readouterr()
    assert main([*words, "6,8", "--force"]) == 2
    assert "no import wrote: notes.txt" in capsys.readouterr().err
    (folder / "notes.txt").rename("notes.txt")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == kept
    Path("mine").mkdir()
    Path("notes.txt").rename("mine/README.md")
    assert main([*words, "6,8", "--force", "--out", "mine"]) == 2
    assert [path.name for path in Path("mine").iterdir()] == ["README.md"]


def test_limits_come_from_a_file(arm: Path, capsys) -> None:
    """A YAML file of names or of a list is as good as the option; anything else is told."""
    Path("limits.yaml").write_text("a: 9\nb: 8.5\n", encoding="utf-8")
    assert read_limits(Path("limits.yaml")) == {"a": 9.0, "b": 8.5}
    assert main(["import", "arm.xml", "--tip", "two", "--torque-limits", "limits.yaml"]) == 0
    assert "9 8.5 N m" in capsys.readouterr().out
    for text in ("a: much", "3", "[1, true]", "a: [", ""):
        Path("limits.yaml").write_text(text, encoding="utf-8")
        assert main(["import", "arm.xml", "--torque-limits", "limits.yaml"]) == 2
        assert "--torque-limits: limits.yaml" in capsys.readouterr().err


def test_bad_arguments_are_told_at_once(arm: Path, capsys) -> None:
    """Unknown forces and limits that are no numbers are two lines; a missing file and one without an arm are one."""
    assert main(["import", "arm.xml", "--drop", "fluid,spring", "--torque-limits", "much"]) == 2
    err = capsys.readouterr().err
    assert "--drop: got 'spring' (did you mean 'springs'?)" in err
    assert "--torque-limits: got 'much'" in err
    assert main(["import", "no.xml"]) == 2
    assert "FILE: got 'no.xml'" in capsys.readouterr().err
    Path("bad.xml").write_text("<mujoco", encoding="utf-8")
    assert main(["import", "bad.xml"]) == 2
    assert "bad.xml:1: MuJoCo does not read it" in capsys.readouterr().err


def test_every_force_that_can_be_left_out_is_offered() -> None:
    """The command names the forces itself, as its help must not load MuJoCo."""
    assert DROPS == forces.DROPS


def test_an_arm_that_is_not_the_published_one_is_not_written(arm: Path, monkeypatch, capsys) -> None:
    """A proof that does not hold ends with status 1 and no folder."""
    monkeypatch.setattr(importing, "LIMIT", 1e-12)
    monkeypatch.setattr(importing, "prove", lambda *_: importing.Proof(1e-9, 0.0, 0.0, 0.0))
    assert main(["import", "arm.xml", "--tip", "two", "--torque-limits", "9,8"]) == 1
    assert "differs by 1.0e-09" in capsys.readouterr().out
    assert not Path("arms").exists()
