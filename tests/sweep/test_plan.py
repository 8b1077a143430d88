"""Rows, draws and shards of a sweep: which experiment each row is, by whatever way it is reached."""

from __future__ import annotations

import hashlib
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.sweep.examples import BASE, SMALL, plan_of
from torquebench.experiment import parse_experiment
from torquebench.experiment.build import build
from torquebench.sweep.checking import check_plan, corners
from torquebench.sweep.estimate import LEAST_SHARDS, MOST_SHARDS, shard_size
from torquebench.sweep.plan import Plan, pairs_of
from torquebench.sweep.table import empty_columns, key_values


def test_rows_count_controllers_in_draws_in_cases() -> None:
    """Index = (case * draws + draw) * controllers + controller, and the last key of the grid goes fastest."""
    plan = plan_of(SMALL)
    assert (plan.cases, plan.draws, plan.controllers, plan.rows) == (6, 6, ("band", "sign"), 72)
    rows = [plan.row(index) for index in range(plan.rows)]
    assert rows == sorted(rows)
    assert len(set(rows)) == 72
    assert all(index == (r.case * 6 + r.draw) * 2 + r.controller for index, r in enumerate(rows))
    values = [tuple(value.raw for value in plan.values(case)) for case in range(6)]
    assert values == list(itertools.product([0, 2], [0.1, 0.2, 0.3]))


def test_a_row_is_the_experiment_with_its_values_set_on_the_command_line() -> None:
    """The experiment of every row equals the one that ``run --set`` makes of the file without its sweep."""
    plan = plan_of(SMALL)
    for index in (0, 1, 13, 40, 71):
        row = plan.row(index)
        mass, phi = (value.raw for value in plan.values(row.case))
        lam = key_values(plan, row.case, row.draw)["controllers.*.gains.lam"][row.controller]
        wanted = parse_experiment(
            BASE,
            "small.yaml",
            [
                f"plant.payload.mass={mass}",
                f"controllers.band.gains.phi={phi}",
                f"controllers.band.gains.lam={lam!r}",
                f"controllers.sign.gains.lam={lam!r}",
                f"run.draw={row.draw}",
            ],
        )
        alone = plan.experiment_of(row)
        assert plan.experiment(row.case, row.draw) == wanted
        assert alone == replace(wanted, controllers=(wanted.controllers[row.controller],))


def test_noise_in_per_cent_of_the_motion_has_its_size_in_every_draw() -> None:
    """Its size is what the file has with the drawn motion set in it, to the last digit: each motion has its own."""
    given = BASE.replace("disturbances:\n", "").replace(BASE.splitlines()[9] + "\n", "disturbances: 30 %\n")
    drawn = "sweep:\n  draws: 3\n  random:\n    reference.amplitude: {uniform: [0.5, 1]}\n"
    drawn += "    controllers.*.gains.lam: {uniform: [8, 12]}\n"
    plan, sizes = plan_of(given + drawn), set()
    for draw in range(3):
        values = {key: value[0] for key, value in key_values(plan, 0, draw).items()}
        set_by_hand = [f"{key}={value!r}" for key, value in values.items() if not key.startswith("controllers")]
        lam = values["controllers.*.gains.lam"]
        set_by_hand += [f"controllers.{name}.gains.lam={lam!r}" for name in ("band", "sign")]
        assert plan.experiment(0, draw) == parse_experiment(given, "small.yaml", [*set_by_hand, f"run.draw={draw}"])
        sizes.add(plan.experiment(0, draw).disturbances[0].sigma)
    assert len(sizes) == 3


def test_a_star_stands_for_the_controllers_whose_law_has_the_gain() -> None:
    """Phi has an effect on the band alone, lam on both: the law that switches by sign keeps out of phi."""
    experiment = plan_of(SMALL).experiment(2, 4)
    band, sign = experiment.controllers
    assert band.gains["phi"] == 0.3
    assert "phi" not in sign.gains
    assert band.gains["lam"] == sign.gains["lam"] != 10.0


def digest(plan: Plan, case: int, draw: int) -> str:
    """Digest of everything that is drawn for a case in a draw."""
    loop = build(plan.experiment(case, draw))
    arrays = (loop.position_noise, loop.disturbance, loop.model.flat.constants)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays if array is not None)).hexdigest()


def test_draws_are_paired_across_cases() -> None:
    """The same draw has the same noise, mismatch and random values in every case; another draw has others."""
    plan = plan_of(SMALL)
    assert len({digest(plan, case, 3) for case in range(plan.cases)}) == 1
    assert len({digest(plan, 0, draw) for draw in range(plan.draws)}) == plan.draws
    (random,) = plan.continuous
    assert len({key_values(plan, case, 3)[random.key][0] for case in range(plan.cases)}) == 1
    assert len({plan.drawn(random, draw) for draw in range(100)}) == 100


def test_a_random_key_does_not_depend_on_the_others() -> None:
    """Another random key before it, or a longer grid, moves no value; another seed moves all."""
    (random,) = plan_of(SMALL).continuous
    values = [plan_of(SMALL).drawn(random, draw) for draw in range(5)]
    more = SMALL.replace(
        "  random:\n", "    run.duration: [0.6, 0.7]\n  random:\n    run.metrics_from: {uniform: [0, 0.1]}\n"
    )
    assert [plan_of(more).drawn(plan_of(more).continuous[1], draw) for draw in range(5)] == values
    other = plan_of(SMALL, "run.seed=4")
    assert not set(values) & {other.drawn(random, draw) for draw in range(5)}


@pytest.mark.parametrize(
    ("written", "distribution"),
    [
        ("{uniform: [2, 5]}", stats.uniform(2, 3)),
        ("{log_uniform: [0.5, 50]}", stats.loguniform(0.5, 50)),
        ("{normal: {mean: 9, std: 0.5}}", stats.norm(9, 0.5)),
    ],
)
def test_random_keys_have_their_distributions(written: str, distribution: object) -> None:
    """Kolmogorov and Smirnov's test over 2000 draws, against scipy; p below 1e-4 would be a wrong distribution."""
    plan = plan_of(SMALL.replace("{uniform: [8, 12]}", written))
    drawn = [plan.drawn(plan.continuous[0], draw) for draw in range(2000)]
    assert stats.kstest(drawn, distribution.cdf).pvalue > 1e-4  # type: ignore[attr-defined]


def test_choices_are_equally_likely_and_may_be_words() -> None:
    """Each of three choices comes up in a third of 3000 draws (binomial, 5 sigma), and a table shows it as written."""
    plan = plan_of(
        SMALL.replace("{uniform: [8, 12]}", "{choice: [9, 10, 11]}\n    chain: {choice: [ideal, fast, slow]}")
    )
    shown = [key_values(plan, 0, draw) for draw in range(3000)]
    for key, choices in (("controllers.*.gains.lam", (9.0, 10.0, 11.0)), ("chain", ("ideal", "fast", "slow"))):
        counts = [sum(values[key][0] == choice for values in shown) for choice in choices]
        assert sum(counts) == 3000
        assert all(abs(count - 1000) < 5 * np.sqrt(3000 * 2 / 9) for count in counts)
    assert plan.experiment(0, 7).chain.name == shown[7]["chain"][0]
    assert empty_columns(plan, 1)["chain"].dtype == "<U5"
    assert empty_columns(plan, 1)["controllers.*.gains.lam"].dtype == "<f8"


def test_a_table_shows_no_value_of_a_key_that_a_law_lacks() -> None:
    """Phi of the law that switches by sign is NaN, lam is the same for both; a word of another law's is empty."""
    plan = plan_of(SMALL)
    values = key_values(plan, 0, 0)
    phi, lam = values["controllers.*.gains.phi"], values["controllers.*.gains.lam"]
    assert (phi[0], math.isnan(float(phi[1])), len(set(lam))) == (0.1, True, 1)
    grid = "controllers.band.switching: [saturation, sign]"
    words = key_values(plan_of(BASE + f"sweep: {{grid: {{{grid}}}}}\n"), 0, 0)
    assert words == {"controllers.band.switching": ["saturation", ""]}


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("{from: 0, to: 0.3, count: 4}", [0, 0.1, 0.2, 0.3]),
        ("{from: 0.001, to: 1, count: 4, spacing: log}", [0.001, 0.01, 0.1, 1]),
        ("{from: 1, to: 5, count: 3}", [1, 3, 5]),
        ("{from: 3, to: 1, count: 2}", [3, 1]),
    ],
)
def test_ranges_are_the_numbers_one_would_write(written: str, wanted: list[float]) -> None:
    """Ends included, and free of the round-off that would make 0.1 + 0.2 another number than 0.3."""
    plan = plan_of(BASE + f"sweep: {{grid: {{plant.payload.mass: {written}}}}}\n")
    assert [value.raw for value in plan.keys.axes[0].values] == wanted


def test_whole_ranges_may_stand_at_whole_number_keys() -> None:
    """A range of seeds is one of whole numbers."""
    plan = plan_of(BASE + "sweep: {grid: {run.seed: {from: 0, to: 8, count: 5}}}\n")
    assert [plan.fixed(case).run.seed for case in range(5)] == [0, 2, 4, 6, 8]


def test_values_with_names_are_called_by_them() -> None:
    """A mapping gives values names: any value, also a group of keys or a list, is a word in tables."""
    named = (
        "sweep: {grid: {chain: {clean: ideal, noisy: {encoder_noise: 0.001}}, disturbances: {none: [], noise: []}}}\n"
    )
    plan = plan_of(BASE + named)
    assert [tuple(own[0] for own in key_values(plan, case, 0).values()) for case in range(4)] == [
        ("clean", "none"),
        ("clean", "noise"),
        ("noisy", "none"),
        ("noisy", "noise"),
    ]
    assert plan.fixed(2).chain.encoder_noise == 0.001
    assert plan.fixed(2).disturbances == ()


@pytest.mark.parametrize(
    ("pairs", "steps", "controllers"), [(36, 600, 2), (100_000, 1000, 1), (7, 10, 1), (10**7, 100, 3)]
)
def test_shards_cover_every_pair_once(pairs: int, steps: int, controllers: int) -> None:
    """Whatever the sweep: whole pairs, in order, each once, and neither too few shards to go round nor too many."""

    class Fake:
        """Only what the size depends on: not the number of workers."""

    fake = Fake()
    fake.pairs, fake.controllers = pairs, ("x",) * controllers  # type: ignore[attr-defined]
    size = shard_size(fake, [steps])  # type: ignore[arg-type]
    count = -(-pairs // size)
    assert min(LEAST_SHARDS, pairs) <= count <= MOST_SHARDS
    ends = [pairs_of(size, pairs, shard) for shard in range(count)]
    assert ends[0].start == 0
    assert ends[-1].stop == pairs
    assert all(a.stop == b.start for a, b in itertools.pairwise(ends))
    assert all(len(shard) > 0 for shard in ends)


def test_checking_surveys_every_case() -> None:
    """The number of control instants of each case, which may be swept."""
    plan = plan_of(BASE + "sweep: {grid: {run.duration: [0.6, 0.7, 1.2], run.control_period: [0.001, 0.002]}}\n")
    assert check_plan(plan).steps == [600, 300, 700, 350, 1200, 600]


def test_corners_are_all_or_the_extreme_ones_and_their_neighbours() -> None:
    """A box of few sides has all its corners tried; of many, both extreme ones and each side's other end."""
    assert list(corners([])) == []
    assert list(corners([(0.0, 1.0), (2.0, 3.0)])) == [(0.0, 2.0), (0.0, 3.0), (1.0, 2.0), (1.0, 3.0)]
    many = set(corners([(0.0, 1.0)] * 34))
    assert {(0.0,) * 34, (1.0,) * 34, (1.0, *(0.0,) * 33), (0.0, *(1.0,) * 33)} <= many
    assert len(many) == 70
