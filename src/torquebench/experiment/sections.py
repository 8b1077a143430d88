"""Checking raw values against the schema, key by key, so that one mistake does not hide another."""

from __future__ import annotations

import functools
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Generic, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from torquebench.errors import did_you_mean, nearest
from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.values import explain, shown

M = TypeVar("M", bound=BaseModel)
Handler = Callable[[KeyPath, Any], Any]


@dataclass(frozen=True, slots=True)
class Checked(Generic[M]):
    """What could be made of one section: its valid keys, defaults included."""

    path: KeyPath
    model: type[M] | None
    """What the section describes; None when that could not be told."""
    values: Mapping[str, Any]
    given: frozenset[str]
    """Keys that the config states itself."""

    def build(self) -> M:
        """Return the section as a model; only for sections without mistakes."""
        if self.model is None:
            raise TypeError("the section has mistakes")
        return self.model(**self.values)


def as_mapping(document: Document, path: KeyPath, raw: Any, what: str) -> dict[str, Any] | None:
    """Return `raw` when it is a mapping, else record that `what` was wanted."""
    if isinstance(raw, dict):
        return raw
    if raw is not BROKEN:
        document.add(path, f"got {shown(raw)}, wanted {what}")
    return None


def check_fields(
    document: Document,
    path: KeyPath,
    raw: Mapping[str, Any],
    model: type[BaseModel],
    handlers: Mapping[str, Handler] | None = None,
    *,
    noun: str = "key",
    elsewhere: Callable[[str], str | None] = lambda key: None,
    also: Iterable[str] = (),
    defaults: Mapping[str, Any] = types.MappingProxyType({}),
) -> dict[str, Any]:
    """Check one mapping against one model.

    Args:
        document: Receives mistakes.
        path: Where the mapping is.
        raw: The mapping.
        model: Says which keys there are.
        handlers: Key -> function that checks its value instead of pydantic.
        noun: What an unknown key is called.
        elsewhere: Explains a key that is valid, but not here.
        also: Valid keys whose values are not checked.
        defaults: Defaults that depend on other sections.

    Returns:
        The valid keys' values, and the defaults of keys left out; none for a key that was only misspelt.
    """
    fields = model.model_fields
    every = [*fields, *sorted(set(also) - set(fields))]
    absent = [name for name in every if name not in raw]
    meant = set()
    for key in raw:
        if document.full:
            break
        if key not in every:
            message = elsewhere(key)
            if message is None:
                near, hint = nearest_key(key, every if document.overridden((*path, key)) else absent, every)
                meant.add(near)
                message = f"unknown {noun}{hint}"
            document.add((*path, key), message, at="key")
    values: dict[str, Any] = {}
    for name, info in fields.items():
        here = (*path, name)
        if name in absent:
            if name in meant:
                continue
            if name in defaults or not info.is_required():
                values[name] = defaults.get(name, info.get_default(call_default_factory=True))
            else:
                document.add(here, f"missing ({info.description})", at="key")
        elif raw[name] is None:
            document.add(here, f"nothing is given, wanted a value ({info.description})")
        elif raw[name] is not BROKEN:
            handler = (handlers or {}).get(name) or _nested(document, info)
            value = handler(here, raw[name]) if handler else check_value(document, here, raw[name], model, name)
            if value is not BROKEN:
                values[name] = value
    return values


def check_value(document: Document, path: KeyPath, value: Any, model: type[BaseModel], name: str) -> Any:
    """Return the value of one key as `model` wants it, or BROKEN after recording why not."""
    try:
        return _adapter(model, name).validate_python(value)
    except ValidationError as error:
        info = model.model_fields[name]
        details = error.errors(include_url=False)
        # A list whose items were all refused counts as empty for pydantic; the items' own errors say it all.
        causes = [d for d in details if d["type"] != "too_short" or not d["input"]]
        for detail in causes:
            if detail["input"] is not BROKEN and not document.full:
                index = tuple(part for part in detail["loc"] if isinstance(part, int))
                document.add((*path, *index), explain(detail, info))
        return BROKEN


def check_tagged(
    document: Document,
    path: KeyPath,
    raw: Any,
    tag: str,
    base: type[BaseModel],
    variants: Mapping[str, type[M]],
    handlers: Mapping[str, Handler] | None = None,
    *,
    noun: str = "key",
    elsewhere: Callable[[str], str | None] = lambda key: None,
    more: str = "",
) -> Checked[M] | None:
    """Check a mapping whose key `tag` decides which other keys there are.

    Args:
        document: Receives mistakes.
        path: Where the mapping is.
        raw: The mapping, or what was written in its place.
        tag: The deciding key.
        base: The keys that all variants have, checked even when the variant is unknown.
        variants: Value of `tag` -> model with that variant's keys.
        handlers: Key -> function that checks its value instead of pydantic.
        noun: What an unknown key is called.
        elsewhere: Explains a key that is valid, but not here.
        more: Where further values of `tag` may come from; ends the message about an unknown one.
    """
    mapping = as_mapping(document, path, raw, f"a mapping with the key '{tag}'")
    if mapping is None:
        return None

    def check_tag(here: KeyPath, value: Any) -> Any:
        if isinstance(value, str) and value in variants:
            return value
        near = did_you_mean(value, variants) if isinstance(value, str) else ""
        hint = (near if "did you mean" in near else "") + (more if isinstance(value, str) else "")
        document.add(here, f"got {shown(value)}, wanted one of {', '.join(variants)}{hint}")
        return BROKEN

    def other(key: str) -> str | None:
        owners = [x for x, model in variants.items() if key in model.model_fields]
        belongs = f"has no effect with {tag}: {name} (it belongs to {tag}: {', '.join(owners)})"
        return belongs if owners else elsewhere(key)

    checks, name = {**(handlers or {}), tag: check_tag}, mapping.get(tag)
    given = frozenset(mapping)
    if isinstance(name, str) and name in variants:
        model = variants[name]
        values = check_fields(document, path, mapping, model, checks, noun=noun, elsewhere=other)
        return Checked(path, model, values, given)
    every = {key for variant in variants.values() for key in variant.model_fields}
    return Checked(path, None, check_fields(document, path, mapping, base, checks, noun=noun, also=every), given)


def nearest_key(key: str, first: Sequence[str], every: Sequence[str]) -> tuple[str | None, str]:
    """Return the name that `key` was most likely meant to be, and the hint that says so.

    In a file, names not given yet come `first`: ``kx`` beside ``k`` was meant to be ``kv``. An override may as
    well replace a name already given: for it all names come first.
    """
    for names in (first, every):
        near = nearest(key, names)
        if near is not None:
            return near, did_you_mean(key, names)
    return None, did_you_mean(key, every)


def _nested(document: Document, info: FieldInfo) -> Handler | None:
    """Return the handler of a key that holds a group of keys of one fixed kind, else None."""
    inner = next((t for t in get_args(info.annotation) if isinstance(t, type) and issubclass(t, BaseModel)), None)
    if inner is None or len(get_args(info.annotation)) != 2 or type(None) not in get_args(info.annotation):
        return None

    def check(path: KeyPath, raw: Any) -> Any:
        mapping = as_mapping(document, path, raw, f"a mapping ({info.description})")
        if mapping is None:
            return BROKEN
        values = check_fields(document, path, mapping, inner)
        complete = all(name in values for name in inner.model_fields)
        return inner(**values) if complete else BROKEN

    return check


@functools.cache
def _adapter(model: type[BaseModel], name: str) -> TypeAdapter[Any]:
    info = model.model_fields[name]
    annotated: Any = Annotated[info.annotation, info]
    config = ConfigDict(strict=True, allow_inf_nan=False)
    return TypeAdapter(annotated, config=config)
