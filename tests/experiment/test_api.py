"""Experiments from Python: from plain values, with changed keys, compared and hashed by what they mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.experiment.examples import ALL, GOOD, parse
from torquebench.chain import Chain
from torquebench.disturbances import Bias
from torquebench.errors import ConfigError
from torquebench.experiment import Experiment, config_hash, load_experiment


@pytest.mark.parametrize("name", ALL)
def test_plain_values_are_as_good_as_a_file(name: str) -> None:
    """What an experiment says of itself makes an equal one."""
    x = parse(ALL[name])
    assert Experiment.from_dict(x.to_dict()) == x
    assert config_hash(Experiment.from_dict(x.to_dict())) == config_hash(x)


def test_changed_keys_are_checked_as_a_whole() -> None:
    """Keys by path, by name and by keyword; the experiment itself stays as it is."""
    x = parse(GOOD)
    y = x.with_({"controllers.linear-band.gains.phi": np.full(6, 0.2), "run.seed": 3}, chain="fast")
    assert y == parse(GOOD, "controllers[1].gains.phi=[0.2, 0.2, 0.2, 0.2, 0.2, 0.2]", "run.seed=3", "chain=fast")
    assert x == parse(GOOD)
    assert x.with_(**{"run.duration": 2}) == parse(GOOD, "run.duration=2")


def test_sections_may_be_objects() -> None:
    """What kinds are in Python, a config takes as well."""
    y = parse(GOOD).with_(disturbances=[Bias((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))], chain=Chain(measurement_delay=0.004))
    assert y.disturbances == (Bias((1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),)
    assert y.chain == Chain(measurement_delay=0.004)


def test_mistakes_have_keys_and_no_place() -> None:
    """Every mistake at once, with its key, what was wanted and the nearest name."""
    with pytest.raises(ConfigError) as caught:
        parse(GOOD).with_({"run.duraton": 2, "controllers[0].gains.k": -1, "a..b": 1})
    found = {p.key: (p.where, p.nearest, p.wanted) for p in caught.value.problems}
    assert found["run.duraton"] == ("", "duration", "")
    assert found["controllers[0].gains.k"] == ("", "", "more than 0")
    assert "'a..b'" in found


def test_paths_may_be_text(tmp_path: Path) -> None:
    """A file's name is as good as its path."""
    path = tmp_path / "x.yaml"
    path.write_text(GOOD)
    assert load_experiment(str(path)) == load_experiment(path)
