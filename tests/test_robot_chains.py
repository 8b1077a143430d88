"""Chains of robots: every number has an origin, any arm can have them, and another control period is remarked."""

from dataclasses import fields

import numpy as np
import pytest

from torquebench.chain import ABOUT, CHAINS, NOTHING, ROBOT_CHAINS, Chain, rate_remarks
from torquebench.timing import Timing

PERIODS = {name: about.control_period for name, about in ABOUT.items() if about.control_period is not None}


@pytest.mark.parametrize("name", ROBOT_CHAINS)
def test_every_number_has_an_origin(name: str) -> None:
    """What differs from the ideal chain, and the control period, has a source with a link, or is assumed; no other."""
    chain, origins = CHAINS[name], ABOUT[name].origins
    given = {
        f.name for f in fields(Chain) if f.name != "name" and getattr(chain, f.name) != getattr(CHAINS["ideal"], f.name)
    }
    assert set(origins) == given | {"control_period"}
    for key, origin in origins.items():
        assert origin.source.startswith("assumed: ") != origin.link.startswith("https://"), key


@pytest.mark.parametrize("name", ROBOT_CHAINS)
@pytest.mark.parametrize("n", [2, 7])
def test_any_arm_can_have_a_robots_chain(name: str, n: int) -> None:
    """Numbers are those of all joints, and times fit the robot's own control period and steps of 1 ms."""
    chain, period = CHAINS[name], PERIODS[name]
    assert not list(chain.check(Timing(1.0, period, True, n, 0.001)))
    drives = chain.drives(n, 10, 0.001, period, NOTHING)
    assert np.all(np.isfinite(chain.sensors(n, period, NOTHING).offset))
    assert drives.commands.shape[1] == n


def test_the_published_numbers() -> None:
    """As the documents have them: libfranka's limits, ROBOTIS's tables, UR's cycle, the elbow's gear."""
    franka, servo = CHAINS["fr3"], CHAINS["dynamixel"]
    assert (franka.torque_rate, PERIODS["fr3"], PERIODS["ur5e"]) == (1000.0, 1e-3, 1 / 500)
    # libfranka's lowpassFilter takes dt/(dt + 1/(2 pi f)) of a new command
    assert franka.command_gain(1e-3) == pytest.approx(1e-3 / (1e-3 + 1.0 / (2.0 * np.pi * 100.0)), rel=1e-15)
    assert servo.quantisation == pytest.approx(2.0 * np.pi / 4096, rel=1e-15)
    assert servo.torque_quantum == pytest.approx(2.69e-3 * 10.6 / 4.4, rel=1e-4)  # stall: 10.6 N m at 4.4 A
    assert servo.torque_speed is not None
    assert servo.torque_speed.no_load == pytest.approx(30 * 2 * np.pi / 60)
    small = CHAINS["so101"].torque_speed
    assert small is not None
    assert small.no_load == pytest.approx(45 * 2 * np.pi / 60)
    assert CHAINS["puma560-unimate"].quantisation * 53.7063 * 1000 == pytest.approx(2.0 * np.pi, rel=1e-15)


def test_slow_delay_is_slow_but_for_its_delay() -> None:
    """The chain under which referees found verdicts to turn, by a name."""
    slow, late = CHAINS["slow"], CHAINS["slow-delay"]
    differing = [f.name for f in fields(Chain) if getattr(slow, f.name) != getattr(late, f.name)]
    assert (differing, late.measurement_delay) == (["measurement_delay", "name"], 0.002)


def test_another_control_period_is_remarked() -> None:
    """A robot has one; other chains have none."""
    assert rate_remarks(CHAINS["ur5e"], 0.002) == rate_remarks(CHAINS["slow"], 0.02) == rate_remarks(Chain(), 1.0) == []
    assert rate_remarks(CHAINS["ur5e"], 0.001) == [
        "chain ur5e: the robot's control period is 2 ms, this run's 1 ms (run.control_period)"
    ]
