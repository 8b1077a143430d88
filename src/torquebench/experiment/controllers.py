"""Checking the list of controllers: each against the keys, options and gains of the law it names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.fuzzy_checks import check_fuzzy_name
from torquebench.experiment.law_schema import OWN_KEYS, gains_model, law_model
from torquebench.experiment.schema import MAX_CONTROLLERS, Controller, ControllerKeys
from torquebench.experiment.sections import Checked, as_mapping, check_tagged, check_value, nearest_key
from torquebench.experiment.values import Vector, shown
from torquebench.laws.law import Law, find_law, law_names

TAKEN = frozenset({"figures"})  # each controller has a folder of its name beside this one


def check_controllers(document: Document, path: KeyPath, raw: Any) -> list[Checked[ControllerKeys]]:
    """Return what could be made of each controller; the gains of each are under ``values['gains']``."""
    if not isinstance(raw, list) or not raw:
        if raw is not BROKEN:
            document.add(path, f"got {shown(raw)}, wanted a list of at least one controller")
        return []
    if len(raw) > MAX_CONTROLLERS:
        document.add(path, f"got {len(raw)} controllers, wanted at most {MAX_CONTROLLERS}")
    found = [_check_controller(document, (*path, i), item) for i, item in enumerate(raw[:MAX_CONTROLLERS])]
    controllers = [controller for controller in found if controller is not None]
    first: dict[str, KeyPath] = {}
    for controller in controllers:
        name = controller.values.get("name")
        if name in first:
            where = document.where(document.place(first[name]))
            document.add((*controller.path, "name"), f"'{name}' is already the name of another controller ({where})")
        elif name in TAKEN:
            message = f"a controller may not be called '{name}': in the run's folder, that is the figures' folder"
            document.add((*controller.path, "name"), message)
        elif name is not None:
            first[name] = (*controller.path, "name")
    return controllers


def build_controller(checked: Checked[ControllerKeys]) -> Controller:
    """Return a controller that was found to have no mistakes."""
    values = checked.values
    common = {key: values[key] for key in ControllerKeys.model_fields}
    options = {key: value for key, value in values.items() if key not in OWN_KEYS}
    fuzzy = values.get("fuzzy") if find_law(values["law"]).fuzzy_problem(options) is None else None
    return Controller(**common, options=options, gains=values["gains"], fuzzy=fuzzy)


def _check_controller(document: Document, path: KeyPath, raw: Any) -> Checked[ControllerKeys] | None:
    raw_gains: list[Any] = []

    def keep(here: KeyPath, value: Any) -> Any:
        raw_gains.append(value)
        return BROKEN

    def elsewhere(key: str) -> str | None:
        name = raw.get("law")
        is_gain = name in law_names() and key in find_law(name).gains
        return f"is a gain of law '{name}': write it under gains" if is_gain else None

    checked = check_tagged(
        document,
        path,
        raw,
        "law",
        ControllerKeys,
        _LawModels(),
        {"gains": keep, "fuzzy": lambda here, value: check_fuzzy_name(document, here, value)},
        noun="key or option",
        elsewhere=elsewhere,
        more="; a law of your own needs --plugin FILE, the file that registers it",
    )
    if checked is None or checked.model is None:
        return checked
    law = find_law(checked.values["law"])
    judged = all(rules.only_with is None or rules.only_with[0] in checked.values for rules in law.rules.values())
    if "fuzzy" in checked.given and judged and (problem := law.fuzzy_problem(checked.values)):
        document.add((*path, "fuzzy"), problem, at="key")
    gains = {}
    if raw_gains or "gains" in checked.values:
        gains = _check_gains(document, (*path, "gains"), raw_gains[0] if raw_gains else {}, law, checked.values)
    return Checked(path, checked.model, {**checked.values, "gains": gains}, checked.given)


class _LawModels(Mapping[str, type[ControllerKeys]]):
    """Registered laws by name, as models that are made when first needed."""

    def __getitem__(self, name: str) -> type[ControllerKeys]:
        return law_model(find_law(name))

    def __contains__(self, name: object) -> bool:
        return name in law_names()

    def __iter__(self) -> Iterator[str]:
        return iter(law_names())

    def __len__(self) -> int:
        return len(law_names())


def _check_gains(
    document: Document, path: KeyPath, raw: Any, law: Law, options: Mapping[str, Any]
) -> dict[str, Vector]:
    """Return the valid gains; `options` holds the valid options, defaults included."""
    mapping = as_mapping(document, path, raw, f"a mapping of gains ({', '.join(law.gains)})")
    if mapping is None:
        return {}
    absent = [name for name in law.gains if name not in mapping]
    meant = set()
    for key in mapping:
        if key not in law.gains and not document.full:
            every = list(law.gains)
            near, hint = nearest_key(key, every if document.overridden((*path, key)) else absent, every)
            meant.add(near)
            is_option = f": '{key}' is an option of the law, write it beside gains" if key in law.options else hint
            document.add((*path, key), f"unknown gain{is_option}", at="key")
    gains = {}
    for name, gain in law.gains.items():
        judged = gain.only_with is None or gain.only_with[0] in options
        problem = law.gain_problem(name, name in mapping, options) if judged else None
        here = (*path, name)
        if problem is not None:
            if name in mapping or name not in meant:
                document.add(here, problem, at="key")
        elif name in mapping and mapping[name] is not BROKEN:
            value = check_value(document, here, mapping[name], gains_model(law), name)
            if value is not BROKEN:
                gains[name] = value
    return gains
