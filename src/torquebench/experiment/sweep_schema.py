"""Every key of a sweep: what is varied, how often it is drawn, and which trajectories are kept."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Field, create_model

from torquebench.experiment.keys import Keys
from torquebench.experiment.values import Positive
from torquebench.metrics import METRICS

MAX_DRAWS = 10_000_000
MAX_VALUES = 10_000
MAX_KEYS = 64
MetricName: TypeAlias = Literal[METRICS.names()]  # type: ignore[valid-type]  # a computed tuple
Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Values: TypeAlias = Annotated[tuple[Any, ...], Field(strict=False, min_length=1, max_length=MAX_VALUES)]
Named: TypeAlias = Annotated[dict[str, Any], Field(min_length=1, max_length=MAX_VALUES)]
Pair: TypeAlias = Annotated[tuple[Number, Number], Field(strict=False)]

_RANGE: dict[str, Any] = {
    "from": (Number, Field(description="First value; its unit is the key's [1].")),
    "to": (Number, Field(description="Last value, likewise [1].")),
    "count": (int, Field(ge=2, le=MAX_VALUES, description="Number of values, both ends among them [1].")),
    "spacing": (Literal["linear", "log"], Field("linear", description="Equal steps, or equal ratios.")),
}
Range = create_model("Range", __base__=Keys, __doc__="Evenly spaced values.", **_RANGE)


class Normal(Keys):
    """A normal distribution."""

    mean: Number = Field(description="Mean; its unit is the key's [1].")
    std: Positive = Field(description="Standard deviation, likewise [1].")


class Distribution(Keys):
    """What a key is drawn from, anew in each draw: one of these keys."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    uniform: Pair | None = Field(None, description="Evenly between two numbers.")
    log_uniform: Pair | None = Field(None, description="With an even logarithm between two positive numbers.")
    normal: Normal | None = Field(None, description="Normally distributed.")
    choice: Values | None = Field(None, description="One of a list of values, all equally likely.")


class Worst(Keys):
    """Trajectories of the worst runs only; a run that failed is worse than any that did not."""

    worst: int = Field(ge=1, le=10_000, description="Number of runs of each controller [1].")
    by: MetricName = Field("rmse", description="Metric that is compared.")


def worst_model() -> type[Worst]:
    """Return `Worst` with the names of every metric there is now, those of plug-in files among them."""
    by: Any = (Literal[METRICS.names()], Worst.model_fields["by"])  # a computed tuple
    return create_model("Worst", __base__=Worst, by=by)


class Sweep(Keys):
    """Many runs of one experiment: every combination of the grid, each in every draw, for every controller."""

    draws: int = Field(
        1,
        ge=1,
        le=MAX_DRAWS,
        description="Draws of each combination, with run.draw 0, 1, ..: mismatch, perturbation, noise and random keys "
        "are drawn anew in each, the same for every combination and controller [1].",
    )
    grid: dict[str, Values | Range | Named] = Field(
        default_factory=dict,
        max_length=MAX_KEYS,
        description="Key -> its values: a list, a range, or a mapping of names to values, by which tables then call "
        "them. Keys as for --set; controllers.* stands for every controller whose law has the gain or option.",
    )
    random: dict[str, Distribution] = Field(
        default_factory=dict, max_length=MAX_KEYS, description="Key -> its distribution; keys as in grid."
    )
    keep: Literal["none", "all"] | Worst = Field("none", description="Trajectories to store, besides the metrics.")
