"""Schema of a controller for each registered law, made from the law itself; JSON schema for editors."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Iterable
from typing import Annotated, Any, Literal, Union

from pydantic import BaseModel, BeforeValidator, Field, create_model
from pydantic_core import PydanticCustomError

from torquebench.experiment.keys import Keys
from torquebench.experiment.schema import MAX_CONTROLLERS, ControllerKeys, Experiment
from torquebench.experiment.sweep_schema import Sweep
from torquebench.experiment.values import EachJoint, Vector
from torquebench.fuzzy import BUILTIN
from torquebench.laws.declare import RESERVED, Gain, Option
from torquebench.laws.law import Law, find_law, law_names

OWN_KEYS = frozenset(RESERVED)


def law_model(law: Law) -> type[ControllerKeys]:
    """Return the keys of a controller that uses `law`: the common ones, the law's options, and its gains."""
    return _law_model(law.name, law.gains_type)  # type: ignore[arg-type]  # classes are hashable


def gains_model(law: Law) -> type[Keys]:
    """Return the keys below ``gains`` of a controller that uses `law`."""
    return _gains_model(law.name, law.gains_type)  # type: ignore[arg-type]  # classes are hashable


@functools.cache
def _law_model(name: str, gains_type: type[Any]) -> type[ControllerKeys]:
    law = find_law(name)
    gains = gains_model(law)
    needed = any(info.is_required() for info in gains.model_fields.values())
    names = ", ".join(f"{key} [{gain.unit}]" for key, gain in law.gains.items())
    text = f"Gains of the law: {names or 'none'}."
    fields: dict[str, Any] = {
        "law": (Literal[law.name], Field(description=f"Name of the torque law. {law.summary}")),
        "gains": (gains, Field(... if needed else {}, description=text)),
    }
    options = {option: _option(declared) for option, declared in law.options.items()}
    for rules in law.rules.values():
        only = "" if rules.only_with is None else f"; only with {rules.condition}"
        text = f"{rules.meaning}: a name under the top level's fuzzy, or {', '.join(BUILTIN)}{only}."
        options["fuzzy"] = str, Field(rules.default, description=text)
    return _create(law.name, ControllerKeys, fields | options, law.summary)


@functools.cache
def _gains_model(name: str, gains_type: type[Any]) -> type[Keys]:
    law = find_law(name)
    gains = {gain: _gain(declared) for gain, declared in law.gains.items()}
    return _create(f"{law.name} gains", Keys, gains, f"Gains of the law {law.name}.")


def experiment_json_schema(laws: Iterable[str] | None = None) -> dict[str, Any]:
    """Return the JSON schema of a config, for editors; it knows all but the checks across keys.

    Args:
        laws: Names of the laws to describe; all that are registered if left out.
    """
    models = [law_model(find_law(name)) for name in (law_names() if laws is None else sorted(laws))]
    controller: Any = Union[tuple(models)]  # noqa: UP007  (a union of a computed list)
    if len(models) > 1:
        controller = Annotated[controller, Field(discriminator="law")]
    text = Experiment.model_fields["controllers"].description
    info = Field(min_length=1, max_length=MAX_CONTROLLERS, description=text)
    fields: dict[str, Any] = {"controllers": (list[controller], info)}
    fields["sweep"] = Sweep | None, Field(None, description="What `torquebench sweep` varies; not for other commands.")
    schema = _create("Experiment", Experiment, fields).model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_without_null(schema)}


def _without_null(node: Any) -> Any:
    """Return a JSON schema in which no key may be null: in a config, absent keys are left out."""
    if isinstance(node, list):
        return [_without_null(item) for item in node]
    if not isinstance(node, dict):
        return node
    kept = {key: _without_null(value) for key, value in node.items() if (key, value) != ("default", None)}
    others = [item for item in kept.get("anyOf", []) if item != {"type": "null"}]
    if len(others) == 1:
        del kept["anyOf"]
        kept |= others[0]
    return kept


def _gain(gain: Gain) -> tuple[Any, Any]:
    limits = EachJoint(gt=0) if gain.positive else EachJoint(ge=0)
    text = f"{gain.meaning} [{gain.unit}]"
    if gain.only_with is None:
        return Annotated[Vector, limits], Field(description=text)
    return Annotated[Vector, limits], Field(None, description=f"{text}; only with {gain.condition}")


def _option(option: Option) -> tuple[Any, Any]:
    info = Field(option.values[0], description=option.meaning)
    if set(option.values) == {True, False}:
        return bool, info
    # a validator of its own: typing takes two lists of the same values for one, and would keep the first one's order
    return Annotated[Literal[option.values], BeforeValidator(functools.partial(_not_a_number))], info


def _not_a_number(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise PydanticCustomError("literal_error", "a number")  # 1 == True would pass for it
    return value


def _create(name: str, base: type[Any], fields: dict[str, Any], doc: str | None = None) -> type[Any]:
    with warnings.catch_warnings():
        # A user's gain may be called like one of BaseModel's methods, which no one calls here.
        warnings.simplefilter("ignore", UserWarning)
        model: type[BaseModel] = create_model(name, __base__=base, __doc__=doc or base.__doc__, **fields)
    return model
