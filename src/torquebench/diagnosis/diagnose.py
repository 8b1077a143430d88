"""From a controller of an experiment to what is wrong with its run, and what does it, each with a number and a cure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.diagnosis.margins import (
    ENOUGH,
    Margins,
    Slopes,
    backwards,
    drives_at,
    instants_of,
    margins_of,
    resonances,
    slopes_of,
    torque_noise,
    true_arm,
    weight_along,
)
from torquebench.diagnosis.owners import OWNERS, Owner, robot_of
from torquebench.diagnosis.parts import Part, Variant, as_yaml, layers, parts_of, strengths, three_digits, with_share
from torquebench.diagnosis.seen import KINDS, Kind, Seen, grows, slips, swings
from torquebench.diagnosis.settings import settings_between
from torquebench.errors import ConfigError, Problem, nearest
from torquebench.experiment.build import Loop, build
from torquebench.experiment.certify import Flag, flags
from torquebench.experiment.run import Progress, metrics_of, trial_of
from torquebench.experiment.schema import Controller, Experiment
from torquebench.kernel import Array
from torquebench.keys import Vector, as_vector
from torquebench.laws import find_law
from torquebench.metrics.chattering import CORNER_OVER_MOTION, is_forced
from torquebench.metrics.shaking import shaking
from torquebench.sim.session import Session
from torquebench.sim.trajectory import Trajectory
from torquebench.tuning import rate

SHARE = 0.25
"""Share of a symptom's power from which on what takes it away, or brings it alone, is a cause [1]."""
PERIOD_SHARE = 0.75
"""Likewise for a shorter control period, which changes a little of everything [1]."""
LEAST_MOTION = 0.2
"""Motion that a joint which is to stay is held to [rad]."""
NEAR = 1.2
"""Times what is left of a symptom without its cause that counts as cured of it [1]."""
HALF = 0.5
"""Share of the symptom that a change may leave at most if it is to count as a cure [1]."""
WORSE = 1.1
"""Times what else is wrong with a run that a cure may leave at most [1]."""
QUIET, LARGE = 1.0, 0.2
"""Shaking [% of the torque limit] that is named after an error of that share of the motion, and after a torque that is
at its limit for that share of the time [1]."""
MILD = 0.25
"""Share of the symptom that a change leaves at most if it is named before stronger ones where none cures [1]."""
LOST, MOST = 0.5, 0.5
"""Share of the motion that an error has where the motion is lost, and of the time at the torque limit, that are named
before a shaking of less than half the torque [1]."""
SOFTER = (0.7, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05)
"""Shares of the gains that are tried against shaking [1]."""
STIFFER = (2.0, 4.0, 8.0)
"""Times the gains that are tried against errors [1]."""


class Remedy(NamedTuple):
    """One change that may cure."""

    text: str = ""
    """Keys of the config with the numbers that were tried, and what came of them; or a change in words."""
    settings: tuple[str, ...] = ()
    """What was tried, as ``--set`` takes it; empty for words."""
    cures: bool = True
    """Whether nothing is left of the symptom but what is left without its cause; else at most half."""
    left: float = 0.0
    """Share of the symptom that it leaves, of what was tried and does not cure [1]."""
    phase: float | None = None
    """Least phase margin that it leaves [deg]; None where none was worked out."""
    delay: float | None = None
    """Further delay that the arm then bears [s]; None where it bears none."""


@dataclass(frozen=True)
class Cause:
    """One thing that makes a run do what it should not."""

    key: str
    """Key of the config, or ``law`` or ``gravity``."""
    title: str
    """The cause with its number."""
    symptom: Kind
    effect: float
    """Share of the symptom's power that goes with it, or comes with it alone: the larger, 0 to 1 [1]."""
    without: str
    """The symptom without it; empty for the law itself, which nothing takes away."""
    alone: str
    """The symptom with it and no other imperfection."""
    detail: str = ""
    """Number by which it does it."""
    remedy: Remedy = Remedy()  # noqa: RUF009  a tuple
    owner: Owner = "law"
    """Who can change it."""
    origin: str = ""
    """Where its number is from, if that is known."""

    @property
    def whose(self) -> str:
        """Owner, who can change it, and source of its number, in words."""
        return f"{OWNERS[self.owner]}{f', {self.origin}' * bool(self.origin)}"


@dataclass(frozen=True)
class Diagnosis:
    """Faults of a controller's run, their causes, and the cures that were tried."""

    experiment: str
    controller: str
    law: str
    joints: tuple[str, ...]
    """Names of the joints, as they are said."""
    seen: Seen = field(repr=False)
    symptoms: tuple[Kind, ...]
    """Everything it does that it should not, the worst first."""
    causes: tuple[Cause, ...]
    """Causes by symptom, the larger effect first."""
    margins: Margins | None = field(repr=False)
    cures: tuple[Remedy, ...]
    """Changes of the law's own gains that were tried, and what came of them."""
    runs: int
    """Closed loops that were run."""
    unstable: bool
    """Whether the loop's phase margin is negative and the law's torque does not jump."""
    cured: Seen | None = field(repr=False)
    """The run without the first cause; of a law that is the cause itself, with the change that cures it."""

    @property
    def sentence(self) -> str:
        """Sentence that names the fault, its cause, and the part of the fault that is left without the cause."""
        margins, unstable = self.margins, ""
        if self.unstable and margins is not None:
            unstable = f"its loop is unstable at {self.joints[margins.joint]}: phase margin {margins.phase:.0f} deg"
        if not self.symptoms:
            if unstable:
                return f"'{self.controller}' shows nothing yet, but {unstable}."
            return f"'{self.controller}' does not shake, follows, and stays within its torque limits."
        kind = self.symptoms[0]
        first = next((cause for cause in self.causes if cause.symptom == kind), None)
        begin = self._symptom(kind)
        if first is None:
            sum_of = f"; {unstable}, {margins.costs}" if margins is not None and unstable else ""
            return f"{begin}; nothing that can be taken away by itself does it{sum_of}."
        if not first.without:
            return f"{begin}; {first.title} does it: with no other imperfection {first.alone}."
        return f"{begin}; {first.title} does it: without it {first.without}."

    @property
    def remedy(self) -> Remedy:
        """The change to make first, which was tried or follows from the cause; empty where there is none.

        It is one for the first symptom, if there is one. What cures comes before what leaves some of it, and what
        leaves less before what leaves more; then what leaves more of a phase margin, up to `ENOUGH`, or of which none
        is known. Against shaking, what was tried and cures comes before words. Of equals, a law that shakes has its
        gains changed first, else the cause is cured.
        """
        remedies = [cause.remedy for cause in self.causes if cause.symptom == self.symptoms[0]]
        shakes = self.symptoms[:1] in (("shakes",), ("fails",))
        filters = any("velocity_filter" in text for one in remedies[:1] for text in one.settings)
        found = [*self.cures, *remedies] if shakes and not filters else [*remedies, *self.cures]
        told = [one for one in found if one.text] or [cause.remedy for cause in self.causes if cause.remedy.text]
        tried = [one for one in told if one.cures and one.settings] if shakes else []
        return max(tried or told, key=_worth, default=Remedy())

    @property
    def advice(self) -> str:
        """The text of `remedy`."""
        return self.remedy.text

    def cure_of(self, cause: Cause) -> str:
        """Return a cause's remedy, of the law the first change of its gains; "as above" if that is the advice."""
        text = cause.remedy.text or (self.cures[0].text if cause.key == "law" and self.cures else "")
        return "as above" if text and text == self.advice else text

    def _symptom(self, kind: Kind) -> str:
        seen, joint = self.seen, self.seen.joint(kind)
        who = f"{self.joints[joint]} of '{self.controller}'"
        if kind == "fails":
            return f"'{self.controller}' fails, {seen.ending}"
        if kind == "shakes" and seen.shaking is not None:
            at = "" if math.isnan(seen.shaking.frequency) else f" at {seen.shaking.frequency:.3g} Hz"
            return f"{who} {seen.shaking.verb}{at}, {seen.text(kind, joint)}"
        if kind == "errs":
            swing = f", swinging at {seen.swings[joint]:.2g} Hz" if seen.swings[joint] > seen.motion_hz else ""
            return f"{who} errs by {seen.text(kind, joint)} RMS, {100 * seen.error[joint]:.3g} % of its motion{swing}"
        return f"{who} is at its torque limit {seen.text(kind, joint)}"

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain values; infinite and undefined numbers are None."""
        shake = self.seen.shaking
        return {
            "experiment": self.experiment,
            "controller": self.controller,
            "law": self.law,
            "sentence": self.sentence,
            "symptoms": list(self.symptoms),
            "shaking": None
            if shake is None
            else {
                "joint": shake.joint + 1,
                "frequency_hz": None if math.isnan(shake.frequency) else shake.frequency,
                "amplitude": shake.amplitude,
                "chattering": shake.chattering,
                "is_limit_cycle": shake.is_cycle,
            },
            "causes": [{**vars(cause), "remedy": cause.remedy._asdict()} for cause in self.causes],
            "margins": None if self.margins is None else self.margins.to_json(),
            "cures": [one._asdict() for one in self.cures],
            "advice": self.advice,
            "settings": list(self.remedy.settings),
            "runs": self.runs,
        }


def diagnose(experiment: Experiment, controller: str | None = None, progress: Progress | None = None) -> Diagnosis:
    """Run a controller again and again, without each imperfection and with each alone, and say what does what.

    Args:
        experiment: The experiment.
        controller: Name of the controller; None for the only one, or the one whose run is worst.
        progress: Told what is run, how many runs are done, and of how many.

    Raises:
        ConfigError: there is no such controller.
        ModelError: a model cannot be used.
    """
    names = [keys.name for keys in experiment.controllers]
    if controller is not None and controller not in names:
        near = nearest(controller, names) or ""
        wanted = "" if near else f"one of {', '.join(names)}"
        raise ConfigError([Problem("--controller", got=f"'{controller}'", wanted=wanted, nearest=near)])
    chosen = [keys for keys in experiment.controllers if controller in (None, keys.name)]
    found = [_Search(experiment, keys, progress) for keys in chosen]
    worst = max(found, key=lambda one: [one.whole.has(kind) * one.whole.size(kind) for kind in KINDS])
    return worst.diagnosis()


class _Search:
    """One controller's runs.

    Args:
        experiment: The experiment.
        keys: The controller.
        progress: As of `diagnose`.
    """

    def __init__(self, experiment: Experiment, keys: Controller, progress: Progress | None) -> None:
        run = replace(experiment.run, chattering_from_hz=experiment.chattering_from_hz)
        self.experiment = replace(experiment, controllers=(keys,), run=run)
        self.keys, self._progress, self._session, self.runs = keys, progress, Session(), 0
        self.loop = build(self.experiment)
        self.names = tuple(map(_called, self.loop.joint_names))
        self.tau_max = np.array(self.loop.plant.tau_max, dtype=np.float64)
        span = np.max(np.abs(self.loop.reference.q - self.loop.initial_q), axis=0)
        self.span = np.maximum(span, LEAST_MOTION)
        self.slopes = slopes_of(self.experiment, self.loop)
        self.weight = weight_along(self.experiment, self.loop)
        self.parts = parts_of(self.experiment, self.slopes, self.weight)
        self._expected = 2 * len(self.parts) + 2
        self.run: Trajectory
        self.whole = self.look("as it is", self.experiment, keep=True)
        self.parts = [replace(part, title=self._title(part)) for part in self.parts]
        self.cured: Seen | None = None

    def _title(self, part: Part) -> str:
        """Return a part's title, which for joints that ring or stick is what the run shows of them."""
        if self.whole.ending:
            return part.title
        joint = self.whole.joint(self.symptoms[0] if self.symptoms else "errs")
        if part.key == "transmission" and self.whole.has("shakes"):
            found, at = resonances(self.experiment, self.loop), self.whole.shaking
            if at is not None and not math.isnan(at.frequency):  # one joint's resonance shakes those beside it
                joint = int(np.argmin(np.abs(np.log(found / at.frequency))))
            return f"the resonance of {self.names[joint]} at {found[joint]:.3g} Hz"
        if part.key == "friction" and self.whole.slips[joint] > 0.0:
            return (
                f"stick-slip of {self.names[joint]} at {self.whole.slips[joint]:.2g} Hz, by {part.title.rstrip(',')},"
            )
        if part.key == "disturbances" and self.whole.forced:
            return "the disturbance, which has that frequency,"
        return part.title

    def look(
        self, what: str, experiment: Experiment, change: Callable[[Loop], Loop] | None = None, keep: bool = False
    ) -> Seen:
        """Run one variant and return what it shows.

        Args:
            what: Its name for who waits.
            experiment: The variant.
            change: What is changed in its objects.
            keep: Whether its trajectory is kept.
        """
        if self._progress is not None:
            self._progress(what, self.runs, max(self._expected, self.runs + 1))
        self.runs += 1
        loop = build(experiment)
        loop = loop if change is None else change(loop)
        with np.errstate(all="ignore"):
            run = self._session.run(loop.plant, trial_of(experiment, loop, loop.controllers[0]))
        if keep:
            self.run = run
        n = experiment.n
        late = run.t >= experiment.run.metrics_from
        shown = run.t[late], run.tau[late], (run.q_ref - run.q)[late]
        nothing = np.zeros(n)
        if not run.completed:
            return Seen(run.ending, None, nothing, 0.0, nothing, nothing, nothing, nothing, True, True, nothing, *shown)
        loop.plant.tau_max = self.tau_max.copy()
        metrics = metrics_of(experiment, loop, self.keys, run)
        shares = np.array([x or 0.0 for x in metrics.chattering.per_joint])
        rmse = np.array([x or 0.0 for x in metrics.rmse.per_joint])
        limit = self.tau_max * (1.0 - 1e-9)
        saturated = np.mean(np.abs(run.tau_law[late]) >= limit, axis=0)
        power = float(np.sqrt(np.mean(shares**2)))
        shake = shaking(metrics, self.tau_max.tolist())
        forced = shake is not None and is_forced(loop.disturbance, experiment.run.control_period, shake.frequency)
        since, corner = experiment.run.metrics_from, self.experiment.chattering_from_hz
        return Seen(
            "",
            shake,
            shares / 100.0 * self.tau_max,
            power,
            rmse,
            rmse / self.span,
            saturated,
            swings(run, since),
            *grows(run, since, corner),
            np.array([slips(run, since, i) for i in range(n)]),
            *shown,
            forced,
            2.0 * corner / CORNER_OVER_MOTION,
        )

    def without(self, parts: Iterable[Part], what: str) -> Seen:
        """Run it without some parts."""
        gone = list(parts)
        experiment = self.experiment
        for part in gone:
            experiment = part.without(experiment)

        def change(loop: Loop) -> Loop:
            for part in gone:
                loop = part.loop(loop)
            return loop

        return self.look(what, experiment, change)

    @cached_property
    def ideal(self) -> Seen:
        """The run without any imperfection."""
        return self.without(self.gone, "without any imperfection")

    @property
    def gone(self) -> list[Part]:
        """Parts to take away: all but the torque limit, without which an unstable loop only grows."""
        return [part for part in self.parts if part.key != "torque_limit"]

    @property
    def symptoms(self) -> tuple[Kind, ...]:
        """Symptoms of the run, the worst first."""
        return tuple(sorted((kind for kind in KINDS if self.whole.has(kind)), key=self._rank))

    def diagnosis(self) -> Diagnosis:
        """Return what is wrong and why."""
        symptoms = self.symptoms
        causes, left = self._causes(symptoms) if symptoms else ((), ())
        cures = self._cures(symptoms[0], causes) if symptoms else ()
        causes = tuple(replace(c, remedy=self._remedy(c, x)) for c, x in zip(causes, left, strict=True))
        causes = tuple(replace(cause, detail=self._detail(cause, self.margins)) for cause in causes)
        name = self.experiment.name
        return Diagnosis(
            name,
            self.keys.name,
            self.keys.law,
            self.names,
            self.whole,
            symptoms,
            causes,
            self.margins,
            cures,
            self.runs,
            self.unstable,
            self.cured,
        )

    @cached_property
    def slopes_at_work(self) -> Slopes:
        """The law's slopes over the amplitude with which it shakes."""
        if not self.slopes.jumps or self.whole.shaking is None:
            return self.slopes
        first = int(np.searchsorted(self.run.t, self.experiment.run.metrics_from))
        rate = math.sqrt(2.0) * np.std(self.run.qd_meas[first:] - self.run.qd_ref[first:], axis=0)
        place = math.sqrt(2.0) * np.std(self.run.q_meas[first:] - self.run.q_ref[first:], axis=0)
        return slopes_of(self.experiment, self.loop, (place, rate))

    @cached_property
    def margins(self) -> Margins | None:
        """The loop's margins."""
        return margins_of(self.experiment, self.loop, self.slopes_at_work)

    @property
    def _held_by(self) -> Array:
        """Stiffness with which law and drives hold each joint at the instants of the slopes, (m, n) [N m/rad]."""
        drives = [drives_at(self.experiment, k) for k in instants_of(self.experiment)]
        return np.diagonal(drives @ self.slopes.stiffness, axis1=1, axis2=2)

    @property
    def unstable(self) -> bool:
        """Whether the loop's phase margin is negative and the law's torque does not jump."""
        return not self.slopes.jumps and self.margins is not None and (self.margins.phase or 0.0) < 0.0

    @property
    def by_integral(self) -> bool:
        """Whether the loop is unstable, and would be stable without the law's integral."""
        if not self.unstable or self.margins is None or all(part.key != "integral" for part in self.parts):
            return False
        return (self.margins.phase or 0.0) + self.margins.lost.get("integral", 0.0) > 0.0

    def _rank(self, kind: Kind) -> tuple[bool, int]:
        """Return where a symptom stands: a lost motion and large errors come before a torque that hardly shakes."""
        whole = self.whole
        if kind != "shakes":
            return False, KINDS.index(kind)
        joint, error, saturated = whole.joint(kind), whole.size("errs"), whole.size("saturates")
        lost = error >= LOST or saturated >= MOST
        little = bool(whole.torque[joint] < HALF * np.sqrt(np.mean(whole.tau[:, joint] ** 2)))
        return (whole.share < QUIET and max(error, saturated) > LARGE) or (lost and little), KINDS.index(kind)

    def _causes(self, symptoms: Sequence[Kind]) -> tuple[tuple[Cause, ...], tuple[float, ...]]:
        """Return the causes, and how much of the symptom there is without each."""
        without, alone = dict[str, Seen](), dict[str, Seen]()
        known = {part.key: part for part in self.parts}
        bases = dict[tuple[str, ...], Seen]()
        for part in self.parts:
            beside = tuple(key for key in part.beside if key in known)
            if beside not in bases:
                bases[beside] = self.whole
                if beside:
                    bases[beside] = self.without([known[key] for key in beside], f"without {', '.join(beside)}")
            gone = [*(known[key] for key in beside), part]
            without[part.key] = self.without(gone, f"without {part.key}")
            others = [other for other in self.gone if other is not part]
            alone[part.key] = self.without(others, f"{part.key} alone")
        if self.by_integral and "gravity" in known:  # which keeps from sagging, too
            held = self.without([known["gravity"], known["integral"]], "without integral, gravity held")
            without["integral"] = held
        found, lefts = list[Cause](), list[float]()
        for kind in symptoms:
            first = found[0].key if found else ""
            if first in without and not without[first].has(kind):
                continue  # it comes of the first symptom
            joint = self.whole.joint(kind)
            whole, ideal = self.whole.size(kind, joint), self.ideal.size(kind, joint)
            rated = list[Cause]()
            for part in self.parts:
                base = bases[tuple(key for key in part.beside if key in known)]
                both = base.unstable(kind) and without[part.key].unstable(kind)
                left = self._size(kind, joint, without[part.key])
                lost = 0.0 if both else _share(base.size(kind, joint), left, whole)
                brought = _share(self._size(kind, joint, alone[part.key]), ideal, whole)
                texts = without[part.key].text(kind, joint), alone[part.key].text(kind, joint)
                title = part.title
                if "integral" in without and part.key == "friction" and self.whole.slips[joint] > 0.0:
                    only = without["integral"].slips[joint] == 0.0
                    title = f"{title.rstrip(',')}, and the law's integral," if only else title
                effect = max(lost, brought)
                rated.append(Cause(part.key, title, kind, effect, *texts, owner=part.owner, origin=part.origin))
            own = [c for c in rated if c.effect >= (PERIOD_SHARE if c.key == "control_period" else SHARE)]
            rest = _share(ideal, 0.0, whole)
            by_law = Cause("law", self._blame(kind), kind, rest, "", self.ideal.text(kind, joint))
            if rest >= SHARE and not any(cause.key == "torque_limit" for cause in own):
                own.append(by_law)
            elif own and not self._explained(kind, [known[cause.key] for cause in own], without):
                smaller = (c for c in rated if c not in own and c.key not in ("control_period", "torque_limit"))
                own += [c for c in smaller if alone[c.key].has(kind) and not self.ideal.has(kind)]
            if self.by_integral and not found:  # what excites an unstable loop is not what makes it so
                (integral,) = (cause for cause in rated if cause.key == "integral")
                hint = " with gravity held" if "gravity" in known else ""
                rest_of = [c for c in own if c.key not in ("integral", "gravity", "law")]
                own = [replace(integral, effect=1.0, without=f"{integral.without}{hint}"), *rest_of]
            if self.backwards is not None:  # whatever else there is, that is the first thing to mend
                own = [replace(by_law, effect=1.0)]
            own.sort(key=lambda cause: -cause.effect)
            named = {cause.key for cause in found}
            for cause in own:
                if not found:
                    self.cured = without.get(cause.key)
                if cause.key not in named:
                    found.append(cause)
                    lefts.append(without[cause.key].size(kind, joint) if cause.key in without else 0.0)
        return tuple(found), tuple(lefts)

    def _size(self, kind: Kind, joint: int, seen: Seen) -> float:
        """Return a symptom of another run: all of it where both are unstable, as it is chance how far one has grown.

        Args:
            kind: The symptom.
            joint: The joint that has most of it in the run as it is.
            seen: The other run.
        """
        size, whole = seen.size(kind, joint), self.whole.size(kind, joint)
        return max(size, whole) if self.whole.unstable(kind) and seen.unstable(kind) else size

    def _explained(self, kind: Kind, parts: Sequence[Part], without: Mapping[str, Seen]) -> bool:
        """Whether a symptom is gone once the given parts are; `without` has the run without each of them."""
        if len(parts) == 1:
            return not without[parts[0].key].has(kind)
        return not self.without(parts, "without all of these").has(kind)

    @cached_property
    def backwards(self) -> int | None:
        """Number of a joint that the law pushes away from its target all along; None where there is none."""
        return backwards(self.slopes)

    def _blame(self, kind: Kind) -> str:
        """Return what is wrong with the law itself."""
        if self.backwards is not None:
            return f"the law, whose torque pushes {self.names[self.backwards]} away from its target (wrong sign),"
        if kind == "shakes" and self.slopes.jumps:
            return "the law, which switches without a layer,"
        if kind == "saturates" and (asked := self._asked()):
            return asked
        return "the law with these gains"

    def _asked(self) -> str:
        """Return that the motion itself takes more than the torque limits, if it does."""
        arm, reference = true_arm(self.experiment), self.loop.reference
        needed = np.abs(arm.inverse_dynamics(reference.q, reference.qd, reference.qdd)) / self.tau_max
        joint = int(np.argmax(np.max(needed, axis=0)))
        most = float(np.max(needed[:, joint]))
        if most <= 1.0:
            return ""
        share = 100 * float(np.mean(needed[:, joint] > 1.0))
        return (
            f"the motion, which takes {most:.2g} times the limit of {self.names[joint]} in {share:.3g} % of the time,"
        )

    def _cured(self, kind: Kind, seen: Seen, left: float = 0.0) -> bool:
        """Whether a run has lost a symptom, or all but what is left without its cause, and nothing else is worse."""
        if not self._spares(kind, seen):
            return False
        size, whole = (one.size(kind, self.whole.joint(kind)) for one in (seen, self.whole))
        return kind == "fails" or not seen.has(kind) or size <= min(NEAR * left, HALF * whole)

    def _spares(self, kind: Kind, seen: Seen) -> bool:
        """Whether a run completes, and has no other symptom that is new, or worse than in the run as it is."""
        whole = self.whole
        return not seen.ending and not any(
            seen.has(other) and not (whole.has(other) and seen.size(other) <= WORSE * whole.size(other))
            for other in KINDS
            if other != kind
        )

    def _tried(self, kind: Kind, variant: Variant, seen: Seen, cures: bool, margins: Margins | None) -> Remedy:
        """Return a change that was tried, with what it leaves."""
        joint = self.whole.joint(kind)
        phase, delay = (None, None) if margins is None else (margins.phase, margins.delay)
        of = "" if cures else f" of {self.whole.text(kind, joint)}"
        left = "completes" if kind == "fails" else f"leaves {seen.text(kind, joint)}{of}"
        share = 0.0 if cures else seen.size(kind, joint) / self.whole.size(kind, joint)
        if phase is not None:
            left += f" and {phase:.0f} deg of phase" + (f", {1e3 * delay:.2g} ms of delay" if delay else "")
        changes = settings_between(self.experiment, variant.experiment)
        return Remedy(f"{variant.text} (tried: {left})", changes, cures, share, phase, delay)

    def _first(
        self, kind: Kind, what: str, variants: Iterable[Variant], left: float = 0.0
    ) -> tuple[Remedy, Seen | None]:
        """Return the first change that cures, else the first that leaves `MILD` of it, else what leaves least of it.

        One that leaves less than `ENOUGH` of a phase margin gives way to the next that cures and leaves more. One that
        leaves none would shake later, and does not cure.

        Args:
            kind: The symptom.
            what: What is changed, for who waits.
            variants: The changes.
            left: How much of the symptom there is without its cause.
        """
        best: Remedy = Remedy()
        best_seen: Seen | None = None
        most = -math.inf
        joint = self.whole.joint(kind)
        for variant in variants:
            found = bool(best.text) and best.cures
            margins = self._margins(variant.experiment)
            phase = math.inf if margins is None or margins.phase is None else margins.phase
            if (self.by_integral and phase <= 0.0) or (found and phase <= most):
                continue
            seen = self.look(what, variant.experiment)
            cures, size = phase > 0.0 and self._cured(kind, seen, left), seen.size(kind, joint)
            whole, least = self.whole.size(kind, joint), best_seen.size(kind, joint) if best_seen else math.inf
            helps = kind != "fails" and self._spares(kind, seen) and size <= HALF * whole
            if cures or (not found and helps and MILD * whole < least and size < least):
                best, best_seen, most = self._tried(kind, variant, seen, cures, margins), seen, phase
            if cures and phase >= ENOUGH:
                break
        return best, best_seen

    def _remedy(self, cause: Cause, left: float) -> Remedy:
        """Return the least change that was tried and cures, or the cure in words.

        `left` is how much of the symptom there is without the cause.
        """
        part = next((part for part in self.parts if part.key == cause.key), None)
        if part is None:
            return Remedy()
        if part.owner == "robot":
            return Remedy(f"the {robot_of(self.experiment)} has it: change the law", cures=False, left=1.0)
        found, _ = self._first(cause.symptom, f"less of {part.key}", part.cures(self.experiment), left)
        if found.text:
            return found
        if part.key == "torque_limit" and self._asked():
            return Remedy("a slower motion")
        return Remedy(part.calms if part.calms and cause.symptom == "shakes" else part.remedy)

    def _margins(self, experiment: Experiment) -> Margins | None:
        """Return the margins of a variant; None for a law whose torque jumps."""
        loop = build(experiment)
        slopes = slopes_of(experiment, loop)
        return None if slopes.jumps else margins_of(experiment, loop, slopes)

    def _cures(self, kind: Kind, causes: Sequence[Cause]) -> tuple[Remedy, ...]:
        """Return changes of the law's gains that cure a symptom."""
        found = list[Remedy]()
        if kind in ("shakes", "fails"):
            layer = self._layer(kind)
            found += [layer] if layer.text else []
        if kind == "saturates" or any(cause.key == "gravity" for cause in causes):
            return tuple(found)
        if self.slopes.jumps and found:
            return tuple(found)
        best, seen = self._first(kind, "other gains", self._other_gains(kind))
        if seen is not None:
            self.cured = self.cured or seen
            found.append(best)
        return tuple(found)

    def _other_gains(self, kind: Kind) -> Iterator[Variant]:
        """Yield smaller gains, or larger ones against errors, and then smaller ones where the motion is lost.

        A damper on the velocity, which lags a motion, is put on the velocity's error before.
        """
        damping = find_law(self.keys.law).options.get("damping")
        if kind == "errs" and damping and "velocity-error" in damping.values:
            made = replace(self.keys, options={**self.keys.options, "damping": "velocity-error"})
            if made != self.keys:
                yield Variant(self._with(made), f"controllers.{self.keys.name}.damping: velocity-error")
        lost = SOFTER if self.whole.size("errs") >= LOST else ()
        for factor in (*STIFFER, *lost) if kind == "errs" else SOFTER:
            made = with_share(self.keys, strengths(self.keys), factor)
            changed = [name for name, value in made.gains.items() if value != self.keys.gains[name]]
            if not changed:
                return
            sign = ">=" if factor > 1.0 else "<="
            words = ", ".join(f"{self._key(name)} {sign} {as_yaml(made.gains[name])}" for name in changed)
            yield Variant(self._with(made), f"{words}{self._in_units(made.gains)}")

    def _key(self, gain: str) -> str:
        """Return the key of a gain, as ``--set`` takes it."""
        return f"controllers.{self.keys.name}.gains.{gain}"

    def _in_units(self, gains: Mapping[str, Vector]) -> str:
        """Return PD gains as an arm's own interface takes them, ``, that is Kp = .. N m/rad, Kd = .. N m s/rad``."""
        law = find_law(self.keys.law)
        if not {"lam", "kv"} <= set(gains) or law.gains["kv"].rule is not rate:
            return ""
        Kd = as_vector(gains["kv"], self.experiment.n) * self.loop.model.flat.inertia_scale
        Kp = as_vector(gains["lam"], self.experiment.n) * Kd
        both = (as_yaml(_rounded(each)) for each in (Kp, Kd))
        return ", that is Kp = {} N m/rad, Kd = {} N m s/rad".format(*both)

    def _layer(self, kind: Kind) -> Remedy:
        """Return the width of a layer that cures, for a law that has one or can have one; empty where none does."""
        words = "" if "phi" in self.keys.gains else f"controllers.{self.keys.name}.switching: saturation, "
        wider = (
            Variant(self._with(keys), f"{words}{self._key('phi')} >= {as_yaml(keys.gains['phi'])}")
            for keys in layers(self.experiment, self.loop)
        )
        best, seen = self._first(kind, "a wider layer", wider)
        self.cured = self.cured or seen
        return best

    def _with(self, keys: Controller) -> Experiment:
        return replace(self.experiment, controllers=(keys,))

    def _detail(self, cause: Cause, margins: Margins | None) -> str:
        """Return the number by which a cause does what it does."""
        key, joint, run = cause.key, self.whole.joint(cause.symptom), self.run
        if key == "noise":
            predicted = torque_noise(self.experiment, self.slopes)[joint]
            return f"through the gains {predicted:.2g} N m RMS, of {self.whole.torque[joint]:.2g} N m"
        if key == "gravity":
            with np.errstate(all="ignore"):
                sag = float(np.nanmax(np.abs(self.weight[:, joint] / self._held_by[:, joint])))
            return f"gravity / Kp = {sag:.2g} rad"
        if key == "friction":
            friction = self.experiment.plant.acting
            least = float(np.max(self._held_by[:, joint]))
            n, held = self.experiment.n, () if friction is None else (friction.coulomb, friction.breakaway)
            dry = max((float(as_vector(torque, n)[joint]) for torque in held), default=0.0)
            return f"friction / Kp = {dry / least:.2g} rad" if least > 0.0 and dry > 0.0 else ""
        if key == "torque_rate" and self.experiment.chain.torque_rate is not None:
            most = as_vector(self.experiment.chain.torque_rate, self.experiment.n) * self.experiment.run.control_period
            steps = np.diff(run.tau[run.t >= self.experiment.run.metrics_from], axis=0)
            hit = np.mean(np.abs(steps) >= most * (1.0 - 1e-6), axis=0)
            return f"the limit is hit {100 * hit[joint]:.3g} % of the time"
        if key == "torque_limit":
            share = 100 * float(self.whole.saturated[joint])
            return self._asked().rstrip(",") or f"the limit is hit {share:.3g} % of the time"
        if key == "control_period":
            said = [str(flag) for flag in flags(self.experiment, self.loop) if not isinstance(flag, Flag)]
            if said:
                return said[-1].removeprefix(f"controller '{self.keys.name}' ")
        if margins is None or margins.crossover is None:
            return ""
        lost = margins.lost.get("hold" if key == "control_period" else key)
        if lost is None:
            return ""
        at = f"at the crossover of {margins.crossover:.3g} Hz"
        return f"costs {lost:.0f} deg of phase {at}, where {margins.phase or 0.0:.0f} deg are left"


def _worth(one: Remedy) -> tuple[bool, float, float]:
    """Return what remedies are ordered by: whether one cures, what it leaves, and its phase margin."""
    return one.cures, -one.left, ENOUGH if one.phase is None else min(one.phase, ENOUGH)


def _called(joint: str) -> str:
    """Return a joint's name as one says it."""
    return joint if joint.startswith("joint") else f"joint {joint}"


def _share(more: float, less: float, whole: float) -> float:
    """Return the share of a symptom's power that goes from one run to another; 0 where it does not fall.

    Args:
        more, less: The symptom in both.
        whole: The symptom in the run as it is.
    """
    if not more > less or whole == 0.0:
        return 0.0
    if math.isinf(more):
        return 1.0
    return min(1.0, (more * more - less * less) / (whole * whole))


def _rounded(value: npt.ArrayLike) -> Vector:
    """Return numbers with three significant digits, one where all are the same."""
    numbers = three_digits(tuple(np.ravel(value).tolist()))
    return float(numbers[0]) if len(set(numbers)) == 1 else tuple(numbers)
