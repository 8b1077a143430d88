"""Rules across the sections of a config: what each by itself cannot show."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from torquebench.errors import Fault, ModelError, nearest
from torquebench.experiment.extends import AUTO, OWN
from torquebench.experiment.groups import is_broken
from torquebench.experiment.schema import Belief, Run, Video, joint_count
from torquebench.experiment.source import Document
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN, KeyPath
from torquebench.fuzzy import BUILTIN
from torquebench.keys import values_of
from torquebench.laws.law import find_law
from torquebench.metrics.chattering import COARSEST
from torquebench.references.reference import depends_on_arm
from torquebench.robot import load_model
from torquebench.robot.inverse_kinematics import PathError
from torquebench.sim.plants.kinds import PlantKeys
from torquebench.timing import FAR_OFF, RELATIVE, Timing, multiple_of

MIN_WINDOW = 0.5
"""The steady-state error is taken over this last part of a run [s]."""
MAX_BYTES = 2 << 30
MAX_SUBSTEPS = 10**8
ARRAYS = 12
"""(N, n) arrays of 8-byte numbers kept for each controller."""
ABSURD = 1e15
"""Amounts above are not printed."""
LARGEST_STEP = 0.1
"""No larger step is proposed [s]."""
COLLECTIONS = ("controllers", "fuzzy", "disturbances")
"""Sections with several things in them."""
TAKEN = frozenset({"figures"})
"""Names that no controller may have: each has a folder of its name beside these."""

Items = Mapping[KeyPath, Any]
"""Path of an item -> the item."""
Rule = Callable[..., Iterator[Fault]]
RULES: list[tuple[Rule, tuple[str, ...]]] = []
"""Each rule with the names of what it needs."""


def rule(function: Rule) -> Rule:
    """Register a rule. Its parameters name what it needs; it is asked only where all of that is valid by itself.

    There are the sections by their names, with `controllers`, `fuzzy` and `disturbances` as `Items`, those that are
    valid; `items`, all objects that have keys or rules of their own; `document`; `n`, the number of joints; `timing`.
    """
    RULES.append((function, tuple(inspect.signature(function).parameters)))
    return function


def check_rules(document: Document, values: Mapping[str, Any]) -> None:
    """Record in a document every contradiction between valid sections.

    Args:
        document: Receives the mistakes.
        values: Section -> its object, BROKEN or with BROKEN inside where it is not valid.
    """
    document.unchecked = is_broken({name: value for name, value in values.items() if name not in OWN})
    known = {name: _known(name, value, document) for name, value in values.items() if value is not None}
    known = {name: value for name, value in known.items() if value is not BROKEN}
    for name in COLLECTIONS:
        known.setdefault(name, {})
    known["document"], known["items"] = document, dict(_items(known))
    plant, run = known.get("plant"), known.get("run")
    try:
        with suppress(NotKnown):
            if plant is not None:
                known["n"] = joint_count(plant.model)
    except ModelError as error:
        for problem in error.problems:
            document.add(("plant", "model"), " ".join(str(problem).split()))
        document.unchecked = True
        del known["plant"]
    step = getattr(plant, "timestep", None)
    with suppress(NotKnown):
        if run is not None:
            whole = step is None or not list(multiple_of((), run.control_period, "", step))
            known["timing"] = Timing(run.duration, run.control_period, whole, known.get("n"), step)
    for check, needs in RULES:
        if known.keys() >= set(needs):
            try:
                for fault in check(**{need: known[need] for need in needs}):
                    document.add_fault(fault)
            except NotKnown:
                continue


class NotKnown(AttributeError):
    """A rule asks for a key that is wrong; what it told before counts."""


class Part:
    """A section with mistakes in it, as far as it is right: a rule that asks for more ends there.

    Args:
        kind: The class of which it was to be; None where that is not known.
        values: Its keys, BROKEN where they are wrong.
    """

    def __init__(self, kind: Any, values: Mapping[str, Any]) -> None:
        self._kind, self.values = kind, values

    def __getattr__(self, name: str) -> Any:
        """Return the value of a key, or a constant of the kind."""
        value = self.values.get(name, getattr(self._kind, name, BROKEN))
        if is_broken(value) or callable(value) or isinstance(value, property):
            raise NotKnown(name)
        return value


def _known(name: str, value: Any, document: Document) -> Any:
    """Return a section, or what is right of it; one with several things in it as those that are valid, by place."""
    if name not in COLLECTIONS:
        if value is not BROKEN or (name,) not in document.groups:
            return value
        group, values = document.groups[name,]
        return Part(group.kind, {group.fields[key].attribute: value for key, value in values.items()})
    if value is BROKEN:
        return {}
    named = value.items() if isinstance(value, dict) else enumerate(value)
    return {(name, key): item for key, item in named if item is not BROKEN}


def _items(parts: Mapping[str, Any]) -> Iterator[tuple[KeyPath, Any]]:
    """Yield every valid object of a config with the place where it is."""
    for name, part in parts.items():
        if name in COLLECTIONS:
            yield from part.items()
        elif dataclasses.is_dataclass(part) or isinstance(part, Part):
            if not isinstance(part, Part):
                yield (name,), part
            own = part.values if isinstance(part, Part) else values_of(part)
            inner = [((name, key), value) for key, value in own.items()]
            yield from (item for item in inner if dataclasses.is_dataclass(item[1]))


@rule
def own_rules(items: Items, timing: Timing) -> Iterator[Fault]:
    """Every item obeys the rules of its own kind."""
    for path, item in items.items():
        found = item.check(timing) if hasattr(item, "check") else iter(())
        for fault in found if isinstance(found, Iterator) else [found]:
            if isinstance(found, Iterator) and isinstance(fault, Fault):
                yield fault.below(path)
            else:
                verb = "yields" if isinstance(found, Iterator) else "returns"
                text = f"{type(item).__name__}.check(timing) {verb} a {type(fault).__name__}"
                yield Fault(path, text, wanted="a method that yields a Fault for each mistake")


@rule
def forms_that_there_are(items: Items, plant: PlantKeys) -> Iterator[Fault]:
    """Model and plant have a structure and constants that the arm has."""
    for path, item in items.items():
        if isinstance(item, Belief | PlantKeys):
            structure, constants = item.form
            for key, value, usual, form in (
                ("structure", structure, "exact", (structure, "fitted")),
                ("constants", constants, "fitted", (structure, constants)),
            ):
                problem = "" if value == usual else _form_problem(plant.model, *form)
                if problem:
                    yield Fault((*path, key), problem, wanted=usual)


@functools.cache
def _form_problem(model: str, structure: str, constants: str) -> str:
    """Return what an arm's model says of a structure and constants that it does not have."""
    try:
        load_model(model, structure, constants)
    except ValueError as error:
        return str(error)
    return ""


@rule
def mismatches_that_there_are(plant: PlantKeys, model: Belief) -> Iterator[Fault]:
    """A mismatch is one that the arm's model can have."""
    mismatch = model.mismatch
    if mismatch is not None:
        yield from (fault.below(("model", "mismatch")) for fault in mismatch.misfits(plant.model, model.structure))


@rule
def lengths_of_vectors(document: Document, plant: PlantKeys, n: int) -> Iterator[Fault]:
    """A vector has one number, or one for each joint."""
    for path, (group, values) in document.groups.items():
        for key, value in values.items():
            if isinstance(value, tuple) and group.nodes[key].is_vector and len(value) != n:
                wanted = f"one number or {n}, one for each joint of '{plant.model}'"
                yield Fault((*path, key), got=f"{len(value)} numbers", wanted=wanted)


@rule
def paths_that_the_arm_can_follow(reference: Any, plant: PlantKeys, n: int) -> Iterator[Fault]:
    """The arm's tool can follow a path, and its joints do not jump on the way."""
    start = getattr(reference, "start", 0.0)
    if depends_on_arm(reference) and not (isinstance(start, tuple) and len(start) != n):
        try:
            reference.on_arm(load_model(plant.model))
        except PathError as error:
            yield Fault(("reference",), str(error), at="key")


@rule
def controllers_have_names_of_their_own(controllers: Items, document: Document) -> Iterator[Fault]:
    """No two share a name, and none has that of another folder of the run."""
    first: dict[str, KeyPath] = {}
    for path, controller in controllers.items():
        here, name = (*path, "name"), controller.name
        if name in first:
            where = document.where(document.place(first[name]))
            text = f"'{name}' is already the name of another controller ({where})"
            yield Fault(here, text, wanted="a name of its own")
        elif name in TAKEN:
            text = f"'{name}' is the figures' folder, beside the controllers' own"
            yield Fault(here, text, wanted="another name")
        else:
            first[name] = here


@rule
def gains_that_act(controllers: Items, document: Document) -> Iterator[Fault]:
    """Each gain that has an effect under the chosen options is given, and no other."""
    for path, controller in controllers.items():
        law = find_law(controller.law)
        for name, gain in law.gains.items():
            given, acts = name in controller.gains, gain.acts(controller.options)
            if given and not acts:
                text = f"gain '{name}' has no effect"
                yield Fault((*path, "gains", name), text, wanted=gain.condition, at="key")
            elif acts and not given:
                text, wanted = f"gain '{name}' is missing", f"a value ({gain.meaning} [{gain.unit}])"
                yield Fault((*path, "gains", name), text, wanted=wanted, at="key")
            elif acts and controller.gains[name] == AUTO and (text := law.no_rule(name)):
                yield Fault((*path, "gains"), text, wanted=f"{{from: {AUTO}, {name}: ...}}", at="key")
        problem = law.fuzzy_problem(controller.options)
        if problem is not None and document.written((*path, "fuzzy")):
            yield Fault((*path, "fuzzy"), problem, at="key")


@rule
def laws_that_fit_the_model(controllers: Items, model: Belief) -> Iterator[Fault]:
    """A law that computes with links has a model with links."""
    for path, controller in controllers.items():
        if problem := find_law(controller.law).misfit(model.structure):
            yield Fault((*path, "law"), problem, wanted="model.structure exact, or another law")


@rule
def fuzzy_systems_that_there_are(controllers: Items, document: Document) -> Iterator[Fault]:
    """A controller names a fuzzy system that is built in, or one of the file."""
    own = document.root.get("fuzzy")
    names = [*BUILTIN, *(own if isinstance(own, dict) else ())]
    for path, controller in controllers.items():
        name = controller.fuzzy
        if name is not None and name not in names:
            near = nearest(name, names) or ""
            wanted = f"a fuzzy system, one of {', '.join(names)}"
            yield Fault((*path, "fuzzy"), got=shown(name), wanted=wanted, nearest=near)


@rule
def names_of_fuzzy_systems(document: Document) -> Iterator[Fault]:
    """No system of the file is called like a built-in one."""
    own = document.root.get("fuzzy")
    for name in own if isinstance(own, dict) else ():
        if name in BUILTIN:
            yield Fault(("fuzzy", name), f"'{name}' is built in", wanted="another name", at="key")


@rule
def whole_periods(plant: PlantKeys, run: Run, document: Document) -> Iterator[Fault]:
    """A control period is whole physics steps."""
    step, period = ("plant", "timestep"), ("run", "control_period")
    yield from multiple_of(period, run.control_period, "plant.timestep", plant.timestep, step)


@rule
def whole_run(run: Run, timing: Timing) -> Iterator[Fault]:
    """A run is whole control periods."""
    if timing.whole:
        yield from multiple_of(("run", "duration"), run.duration, "run.control_period", run.control_period)


@rule
def window_of_metrics(run: Run, reference: Any, document: Document) -> Iterator[Fault]:
    """The window for metrics is long enough."""
    given = run.metrics_from is not None
    start = run.metrics_from if given else getattr(reference, "metrics_from", None)
    if start is None:  # of a kind that is not known: too short for every one
        if run.duration < MIN_WINDOW * (1.0 - RELATIVE):
            wanted = f"at least {MIN_WINDOW:g} s, and as much more as metrics start later than the run"
            yield Fault(("run", "duration"), got=f"{run.duration:.12g} s", wanted=wanted)
        return
    if run.duration >= (start + MIN_WINDOW) * (1.0 - RELATIVE):
        return
    wanted = f"the run to last at least {MIN_WINDOW:g} s longer, {start + MIN_WINDOW:.12g} s"
    if start > FAR_OFF * max(run.duration, 1.0):  # surely the start is wrong, not the run's length
        wanted = f"it at least {MIN_WINDOW:g} s before the run ends"
    if given:
        got = f"{start:.12g} s with run.duration {run.duration:.12g} s"
        yield Fault(("run", "metrics_from"), got=got, wanted=wanted)
    else:
        got = f"{run.duration:.12g} s, but metrics start at {start:g} s (run.metrics_from)"
        yield Fault(("run", "duration"), got=got, wanted=wanted)


@rule
def corner_of_chattering(run: Run, reference: Any) -> Iterator[Fault]:
    """Chattering is defined from the frequency on that is given for it."""
    if run.chattering_from_hz is None:
        return
    most = COARSEST / run.control_period
    start = reference.metrics_from if run.metrics_from is None else run.metrics_from
    least = 2.0 / max(run.duration - start, MIN_WINDOW)
    got = f"{run.chattering_from_hz:.12g} Hz"
    if run.chattering_from_hz > most * (1.0 + RELATIVE):
        yield Fault(("run", "chattering_from_hz"), got=got, wanted=f"at most {most:.6g} Hz, 0.3 / run.control_period")
    elif run.chattering_from_hz < least * (1.0 - RELATIVE):
        wanted = f"at least {least:.6g} Hz, two periods in the window for metrics"
        yield Fault(("run", "chattering_from_hz"), got=got, wanted=wanted)


class _Need(NamedTuple):
    """A resource of which a run takes some at each step, and of which there is a limit."""

    step_key: str
    step: float
    """Length of a step [s]."""
    most: float
    """Number of steps within the limit."""
    size: float
    """Need of one step of one controller, in `unit`."""
    unit: str
    limit: str


@rule
def work(plant: PlantKeys, run: Run, n: int, controllers: Items) -> Iterator[Fault]:
    """A `run` of the `controllers` on a `plant` of `n` joints takes neither all memory nor all day."""
    laws, timestep, period = max(len(controllers), 1), plant.timestep, run.control_period
    each = n * ARRAYS * 8  # bytes a control instant takes for one controller
    steps, memory = f"at most {MAX_SUBSTEPS:.0e} are run", f"at most {MAX_BYTES >> 30} GiB are used"
    needs = [
        _Need("plant.timestep", min(timestep, period), MAX_SUBSTEPS / laws, 1.0, "physics steps in all", steps),
        _Need("run.control_period", period, MAX_BYTES / (each * laws), each / 2**30, "GiB of memory", memory),
    ]
    longest = min(need.step * need.most for need in needs)
    for need in needs:
        if run.duration / need.step <= need.most:
            continue
        amount = run.duration / need.step * need.size * laws
        text = f"{amount:.3g}" if amount < ABSURD else "far too many"
        # Each proposal must help by itself, and be one to make.
        cures = [f"lower run.duration to at most {longest:.5g} s"] * (longest >= MIN_WINDOW * (1.0 - RELATIVE))
        cures += [f"raise {need.step_key}"] * (run.duration / need.most <= LARGEST_STEP)
        cures += ["fewer controllers"] * (laws > 1 and run.duration / need.step <= need.most * laws)
        *others, last = cures or [f"run.duration is too long for such a {need.step_key}"]
        cure = f"{', '.join(others)}, or {last}" if others else last
        yield Fault(("run", "duration"), f"needs {text} {need.unit}, {need.limit}: {cure}")


@rule
def films(plant: PlantKeys, video: Video, controllers: Items, document: Document) -> Iterator[Fault]:
    """A film is taken by a camera of the `plant`, and in a `video` with sound `controllers` of the `document` play."""
    names = [controller.name for controller in controllers.values()]
    listed = document.root.get("controllers")
    if not (isinstance(listed, list) and 0 < len(listed) == len(names)):  # those not valid may have these names
        names += video.ears or ()
    yield from (fault.below(("video",)) for fault in video.mistakes(plant.model, names))
