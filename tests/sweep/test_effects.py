"""Effects are found where there are some, and nowhere else, at the stated rate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.sweep.effects import Effects, effects_on, ranked, strongest

NAMES = tuple(f"c{i}" for i in range(34))


def drawn(rng: np.random.Generator, draws: int, signs: bool) -> dict[str, Array]:
    """34 independent constants: signs as of a relative mismatch, or even draws as of tolerances."""
    shape = 34, draws
    values = 2.0 * rng.integers(0, 2, shape) - 1.0 if signs else rng.uniform(-1.0, 1.0, shape)
    return dict(zip(NAMES, values, strict=True))


def found(effects: Effects) -> list[str]:
    """Names of the terms that matter, the strongest first."""
    return [effect.name for effect in effects.effects if effect.matters]


@pytest.mark.parametrize(
    ("draws", "signs"),
    [
        (30, True),
        (30, False),
        pytest.param(80, True, marks=pytest.mark.slow),
        pytest.param(150, False, marks=pytest.mark.slow),
    ],
)
def test_nothing_is_found_in_noise(draws: int, signs: bool) -> None:
    """Of 300 outputs of skewed noise 5 % have any effect of 34 inputs and their up to 595 products.

    More than the bound happens once in 1,000 tries.
    """
    rng = np.random.default_rng(11)
    false = sum(bool(found(effects_on(rng.lognormal(size=draws), drawn(rng, draws, signs)))) for _ in range(300))
    assert false <= stats.binom.ppf(0.999, 300, 0.05)


@pytest.mark.parametrize("signs", [True, False])
def test_two_of_34_are_found_and_no_other(signs: bool) -> None:
    """Of ln y = c3 - 0.7 c20 + noise: both, with their signs, in this order; anything else in at most 5 % of 100 tries.

    With 150 draws and noise as large as the weaker effect, its t is about 8 beside a bound of 3.5.
    """
    rng = np.random.default_rng(12)
    more = 0
    for _ in range(100):
        inputs = drawn(rng, 150, signs)
        y = np.exp(inputs["c3"] - 0.7 * inputs["c20"] + 0.4 * rng.normal(size=150))
        effects = effects_on(y, inputs)
        assert effects.method == "joint"
        assert found(effects)[:2] == ["c3", "c20"]
        assert effects.effects[0].low > 0.0 > effects.effects[1].high
        assert ranked(effects.effects)[:2] == ["c3", "c20"]
        more += len(found(effects)) > 2
    assert more <= stats.binom.ppf(0.999, 100, 0.05)


def test_errors_that_make_up_for_one_another_are_found_in_pairs() -> None:
    """An error |c3 + 0.6 c20|, signs drawn, does not depend on either alone, but on whether they have the same sign."""
    rng = np.random.default_rng(21)
    more = 0
    for _ in range(100):
        inputs = drawn(rng, 150, signs=True)
        y = np.abs(inputs["c3"] + 0.6 * inputs["c20"]) + 0.3 * rng.normal(size=150)
        effects = effects_on(y, inputs)
        assert effects.pairs == 34 * 33 / 2  # the squares of signs do not vary
        assert found(effects)[0] == "c3 x c20"
        assert effects.effects[0].low > 0.0
        assert set(ranked(effects.effects)[:2]) == {"c3", "c20"}
        more += len(found(effects)) > 1
    assert more <= stats.binom.ppf(0.999, 100, 0.05)


def test_errors_that_are_bad_either_way_are_found_as_squares() -> None:
    """|c3|, evenly drawn, is the square of c3; of |c3 + c20| both squares and the product, and nothing else."""
    rng = np.random.default_rng(22)
    inputs = drawn(rng, 400, signs=False)
    assert found(effects_on(np.abs(inputs["c3"]), inputs)) == ["c3^2"]
    both = effects_on(np.abs(inputs["c3"] + inputs["c20"]), inputs)
    assert set(found(both)) == {"c3 x c20", "c3^2", "c20^2"}
    assert both.pairs == 34 * 35 / 2


DISTRIBUTIONS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "uniform": lambda rng, n: rng.uniform(9.0, 11.0, n),
    "log-uniform": lambda rng, n: np.exp(rng.uniform(np.log(0.1), np.log(10.0), n)),
    "normal": lambda rng, n: rng.normal(2.0, 0.3, n),
    "one of three": lambda rng, n: rng.choice([1.0, 2.0, 10.0], n),
}
OUTPUTS: dict[str, Callable[[dict[str, Array]], Array]] = {
    "rises with a": lambda x: x["a"],
    "is bad either way": lambda x: np.abs(x["a"] - np.median(x["a"])),
    "of a and b together": lambda x: x["a"] * x["b"] + 0.1 * x["b"] ** 3,
}


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_what_cannot_matter_does_not(distribution: str, output: str, noise: float) -> None:
    """However strongly an output follows a and b, c is found in at most 5 % of 150 tries: in no product with them.

    Skewed inputs, exact outputs and noise in proportion to the output are what lends c an effect of a or b where
    products are judged by themselves. More than the bound happens once in 1,000 tries.
    """
    rng = np.random.default_rng(31)
    false = 0
    for _ in range(150):
        inputs = {name: DISTRIBUTIONS[distribution](rng, 80) for name in "abc"}
        y = OUTPUTS[output](inputs) * np.exp(noise * rng.normal(size=80))
        false += "c" in ranked(effects_on(y, inputs).effects)
    assert false <= stats.binom.ppf(0.999, 150, 0.05)


def test_what_cannot_matter_does_not_where_draws_are_few() -> None:
    """Nor with fewer draws than carry all inputs: of 34 skewed ones only the strongest is in what is found."""
    rng = np.random.default_rng(32)
    false = 0
    for _ in range(150):
        inputs = {name: np.exp(rng.normal(size=60)) for name in NAMES}
        effects = effects_on(inputs["c3"], inputs)
        assert effects.method == "single"
        assert found(effects)[0] == "c3"
        false += ranked(effects.effects) != ["c3"]
    assert false <= stats.binom.ppf(0.999, 150, 0.05)


def test_the_intervals_hold_all_at_once() -> None:
    """Of normal samples the ranks' coefficients converge to those of a large sample; all 34 covered in 95 % of 200."""
    rng = np.random.default_rng(13)
    weights = np.array([0.8, -0.4, 0.2] + 31 * [0.0])

    def sample(draws: int) -> tuple[Array, dict[str, Array]]:
        X = rng.normal(size=(34, draws))
        return weights @ X + 0.6 * rng.normal(size=draws), dict(zip(NAMES, X, strict=True))

    truth = {effect.inputs: effect.strength for effect in effects_on(*sample(4_000)).effects}
    missed = 0
    for _ in range(200):
        alone = [effect for effect in effects_on(*sample(120)).effects if len(effect.inputs) == 1]
        missed += any(not e.low <= truth[e.inputs] <= e.high for e in alone)
    assert missed <= stats.binom.ppf(0.999, 200, 0.05)


def test_one_input_is_spearmans_correlation() -> None:
    """With a single input the coefficient is Spearman's rho, and the interval excludes zero where Student's t does."""
    rng = np.random.default_rng(14)
    for slope in (0.0, 0.3, -1.0):
        x = rng.normal(size=40)
        y = slope * x + rng.normal(size=40)
        effect = next(e for e in effects_on(y, {"x": x}).effects if e.name == "x")
        wanted = stats.spearmanr(x, y)
        assert effect.strength == pytest.approx(wanted.statistic, rel=1e-12)
        assert effect.matters == (wanted.pvalue < 0.025)  # the other half of the risk is the square's


def test_the_regression_is_that_of_least_squares() -> None:
    """As numpy's least squares on ranks with an intercept, and its textbook standard errors: 1e-9."""
    rng = np.random.default_rng(15)
    inputs = {name: rng.uniform(size=100) for name in NAMES[:5]}
    y = inputs["c0"] ** 3 + 0.3 * rng.normal(size=100)
    X = np.array([stats.zscore(stats.rankdata(x)) for x in inputs.values()]).T
    z = stats.zscore(stats.rankdata(y))
    design = np.column_stack([np.ones(100), X])
    b, (left,), _, _ = np.linalg.lstsq(design, z, rcond=None)
    errors = np.sqrt(left / 94.0 * np.diag(np.linalg.inv(design.T @ design)))
    effects = effects_on(y, inputs, confidence=0.9)
    assert effects.explained == pytest.approx(1.0 - left / 94.0 / (100.0 / 99.0), rel=1e-9)
    assert {effect.name for effect in effects.effects} >= set(inputs)
    for effect in effects.effects:
        if len(effect.inputs) > 1:
            continue
        i = 1 + NAMES.index(effect.inputs[0])
        half = stats.t.ppf(1.0 - 0.025 / 5, 94) * errors[i]
        assert effect[1:] == pytest.approx((b[i], b[i] - half, b[i] + half), rel=1e-9, abs=1e-12)


def test_any_rising_function_of_the_output_is_the_same() -> None:
    """Ranks do not see exp; reversing an input changes the sign of what it is in once, and of nothing else."""
    rng = np.random.default_rng(16)
    inputs = drawn(rng, 150, signs=False)
    y = inputs["c1"] + inputs["c2"] + 4.0 * inputs["c1"] * inputs["c2"] + 0.5 * rng.normal(size=150)
    plain = effects_on(y, inputs)
    assert "c1 x c2" in found(plain)
    assert effects_on(np.exp(3.0 * y), inputs) == plain
    turned = {e.inputs: e.strength for e in effects_on(y, inputs | {"c1": -inputs["c1"]}).effects}
    for effect in plain.effects:
        sign = -1.0 if effect.inputs.count("c1") == 1 else 1.0
        assert turned[effect.inputs] == pytest.approx(sign * effect.strength, abs=1e-12)


def test_tied_inputs_are_one() -> None:
    """A constant that follows another exactly, upwards or downwards, is named with it; one that rests is left out."""
    rng = np.random.default_rng(17)
    inputs = drawn(rng, 100, signs=False)
    y = inputs["c4"] + 0.3 * rng.normal(size=100)
    inputs |= {"c7": 0.5 * inputs["c4"], "c9": -inputs["c4"], "c11": np.full(100, 0.3)}
    effects = effects_on(y, inputs)
    assert found(effects) == ["c4 = c7 = c9"]
    assert len(effects.effects) == 31


def test_few_draws_are_looked_at_one_by_one() -> None:
    """67 draws do not carry 34 inputs together, 68 do; the bound is the stricter the more is tested."""
    rng = np.random.default_rng(18)
    inputs = drawn(rng, 68, signs=False)
    y = inputs["c5"] + 0.3 * rng.normal(size=68)
    assert effects_on(y, inputs).method == "joint"
    few = effects_on(y[:67], {name: x[:67] for name, x in inputs.items()})
    assert (few.method, few.explained) == ("single", None)
    assert "c5" in found(few)
    widths = [e.high - e.low for outputs in (1, 10) for e in effects_on(y, inputs, outputs=outputs).effects[:1]]
    assert widths[0] < widths[1]


def test_the_strongest_are_those_found_and_some_more() -> None:
    """All that matter, however many, and others only up to the number asked for."""
    rng = np.random.default_rng(19)
    inputs = drawn(rng, 300, signs=False)
    y = sum(inputs[name] for name in NAMES[:6]) + 0.1 * rng.normal(size=300)
    effects = effects_on(y, inputs).effects
    assert {e.name for e in strongest(effects, 3)} == set(NAMES[:6])
    assert len(strongest(effects, 10)) == 10


@pytest.mark.parametrize(
    ("output", "inputs", "text"),
    [
        (np.arange(7.0), {"a": np.arange(7.0)}, "7 draws are too few"),
        (np.ones(9), {"a": np.arange(9.0)}, "the same"),
        (np.arange(9.0), {"a": np.ones(9)}, "nothing that is drawn"),
        (np.arange(9.0), {}, "nothing that is drawn"),
    ],
)
def test_what_cannot_be_told_is_refused(output: Array, inputs: dict[str, Array], text: str) -> None:
    """Too few draws, an output or inputs that do not vary."""
    with pytest.raises(ResultError, match=text):
        effects_on(output, inputs)
