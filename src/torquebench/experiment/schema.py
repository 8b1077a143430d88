"""Every key of an experiment: its type, default, meaning and unit, in one place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field

from torquebench.chain import CHAINS, Chain
from torquebench.disturbances import DISTURBANCES, BandLimitedNoise
from torquebench.errors import Fault, nearest
from torquebench.experiment.controllers import Controller as Controller
from torquebench.experiment.controllers import controllers
from torquebench.experiment.fuzzy_schema import MAX_SYSTEMS, SYSTEMS, FuzzyKeys
from torquebench.experiment.groups import AllOr, Many, Named, NameOr, OneOf
from torquebench.experiment.units import without_unit
from torquebench.experiment.values import Here, Slug
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN, shortened
from torquebench.figures import FIGURES
from torquebench.keys import Key, Vector
from torquebench.metrics.chattering import corner_hz
from torquebench.references import REFERENCES
from torquebench.references.reference import depends_on_arm, highest_frequency
from torquebench.registry import SLUG
from torquebench.robot import load_model
from torquebench.robot.flat_model import SLIDE
from torquebench.robot.library import ArmSource, camera_names
from torquebench.robot.puma560.mismatch import Mismatch
from torquebench.sim.plants.kinds import PLANTS, ConstantsName, PlantKeys, StructureName
from torquebench.sim.signals import control_instants
from torquebench.timing import whole_steps

MAX_DISTURBANCES = 64
LEAST_SIDE, LARGEST_SIDE = 160, 3840
"""Sides of a film's frame [px]; its format takes even ones only."""
Side: TypeAlias = Annotated[int, Field(ge=LEAST_SIDE, le=LARGEST_SIDE, multiple_of=2)]
SLOWEST_SOUND = 0.25
"""Least speed of a film with sound [1]: two octaves lower most of what chatters is still heard."""
MAX_SEED = 2**63 - 1


def joint_count(arm: ArmSource) -> int:
    """Return the number of joints of an arm.

    Raises:
        ModelError: there is no such model, or it is malformed.
    """
    return load_model(arm).n


def slide_joints(arm: ArmSource) -> tuple[bool, ...]:
    """Return whether each joint of an arm slides instead of turning.

    Raises:
        ModelError: there is no such model, or it is malformed.
    """
    return tuple(kind == SLIDE for kind in load_model(arm).flat.kind)


class Disturbances(Many):
    """A list of disturbances, or the size of torque noise in per cent."""

    def read(self, raw: Any, here: Here) -> Any:
        """Return the disturbances, a tuple."""
        share = without_unit(raw, "1")
        if isinstance(raw, str) and isinstance(share, float) and 0.0 < share < math.inf:
            return (BandLimitedNoise(relative=share),)
        if isinstance(raw, int | float) and not isinstance(raw, bool) and 0.0 < raw < math.inf:
            here.add(got=shown(raw), wanted=self.wanted, note=f"of {raw:g} times the motion's torque: {100 * raw:g} %")
            return BROKEN
        return super().read(raw, here)


@dataclass(frozen=True)
class Belief:
    """The model of the arm that the laws compute with; the plant may differ from it."""

    structure: Annotated[
        StructureName,
        Key(
            "Equations of motion: exact is the rigid body; corrected and printed are the paper's, puma560 only",
        ),
    ] = "exact"
    constants: Annotated[
        ConstantsName,
        Key(
            "Numbers in the equations: fitted fit a rigid body; printed are the paper's tables, puma560 only and not "
            "with structure exact"
        ),
    ] = "fitted"
    mismatch: Annotated[Mismatch | None, Key("Errors put on purpose into the constants")] = None

    @property
    def form(self) -> tuple[StructureName, ConstantsName]:
        """Structure and constants of the equations."""
        return self.structure, self.constants


@dataclass(frozen=True)
class Run:
    """How long, how often, from where, and with which random numbers."""

    duration: Annotated[float, Key("Length of the run, a whole multiple of run.control_period", "s", above=0)]
    control_period: Annotated[
        float, Key("Time between two calls of a law, a whole multiple of plant.timestep", "s", above=0)
    ] = 0.001
    initial_q: Annotated[
        Vector | Literal["home"],
        Key(
            "Position at the start, at rest",
            "rad",
            ", in m for slide joints; home is every joint at zero. key:NAME is a keyframe of the arm's file, and the "
            "reference starts there too, unless it has an origin of its own; otherwise it starts at zero",
        ),
    ] = "home"
    seed: Annotated[
        int,
        Key(
            "Source of all random numbers: the same seed and draw, the same numbers",
            "1",
            at_least=0,
            at_most=MAX_SEED,
        ),
    ] = 0
    metrics_from: Annotated[
        float,
        Key(
            "Start of the window for metrics, at least 0.5 s before the end of the run; if left out, 2 for a step and "
            "1 for other references",
            "s",
            at_least=0,
        ),
    ] = None  # type: ignore[assignment]  # until the reference's own is filled in
    chattering_from_hz: Annotated[
        float | None,
        Key(
            "Frequency from which the torque counts as chattering, at most 0.3 / run.control_period; if left out, "
            "eight times the highest frequency of the reference, at least 8",
            "Hz",
            above=0,
        ),
    ] = None
    draw: Annotated[
        int,
        Key(
            "Number of the random draw under one seed: each draw has its own mismatch, perturbation and noise",
            "1",
            at_least=0,
            at_most=MAX_SEED,
        ),
    ] = 0


@dataclass(frozen=True)
class Video:
    """A film of the run, made when it has ended; one that fails does not fail the run."""

    quality: Annotated[Literal["fast", "pretty"], Key("pretty has shadows and takes many times as long")] = "fast"
    size: Annotated[
        tuple[Side, Side],
        Key(
            "Width and height, even numbers; one controller wants 170 of height",
            "px",
            wanted="width and height, as [640, 480]",
        ),
    ] = (640, 480)
    speed: Annotated[float, Key("Simulated seconds shown in one second", "1", at_least=1e-3, at_most=1e3)] = 1.0
    camera: Annotated[
        str | None,
        Key("Name of a camera of the arm: of its scene.xml, else overview or side; the first if left out"),
    ] = None
    exaggerate: Annotated[
        float,
        Key("The arm is drawn at q_ref - exaggerate e, at most 1 rad from q_ref", "1", at_least=1, at_most=1e6),
    ] = 1.0
    sound: Annotated[
        bool, Key("Whether the torque above run.chattering_from_hz of two controllers is heard, one in each ear")
    ] = False
    ears: Annotated[
        tuple[Slug, Slug] | None,
        Key(
            "Controllers heard in the left and the right ear, whatever sound is; the first two if left out",
            wanted="two names of controllers, left and right",
        ),
    ] = None

    @property
    def has_sound(self) -> bool:
        """Whether the film has sound."""
        return self.sound or self.ears is not None

    def mistakes(self, model: ArmSource, names: Sequence[str]) -> Iterator[Fault]:
        """Yield what cannot be filmed of a run of the arm `model` with the controllers `names`."""
        cameras = camera_names(model)
        if self.camera is not None and self.camera not in cameras:
            yield _none_such("camera", f"'{model}' has no camera {shortened(self.camera)}", self.camera, cameras)
        for ear in self.ears or ():
            if ear not in names:
                yield _none_such("ears", f"no controller is called '{ear}'", ear, names)
        if self.has_sound and not SLOWEST_SOUND <= self.speed <= 1.0 / SLOWEST_SOUND:
            wanted = f"{SLOWEST_SOUND:g} to {1.0 / SLOWEST_SOUND:g} with sound, which is slowed with the picture"
            yield Fault(("speed",), got=f"{self.speed:g}", wanted=wanted)


def _none_such(key: str, text: str, name: str, valid: Sequence[str]) -> Fault:
    near = nearest(name, valid) or ""
    return Fault((key,), text, nearest=near, wanted="" if near else f"one of {', '.join(valid)}")


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One experiment: a plant, the belief about it, a motion to follow, and the controllers to compare."""

    name: Annotated[
        Slug, Key("Name of the experiment, and the start of its folder's name; that of its file if left out")
    ]
    description: Annotated[str | None, Key("What the experiment is for, in words"), Field(max_length=4000)] = None
    plant: Annotated[PlantKeys, Key("The arm as it is"), OneOf(PLANTS, "What simulates the arm.", usual="mujoco")]
    model: Annotated[Belief, Key("The arm as the laws believe it to be")] = Belief()
    controllers: Annotated[tuple[Controller, ...], Key("What is compared"), controllers()]
    fuzzy: Annotated[
        Mapping[str, FuzzyKeys],
        Key("Fuzzy systems for laws that take one, by name; pd-49, pd-25, pd-9 and s-7 are built in"),
        Named(
            "a mapping of names to fuzzy systems",
            OneOf(SYSTEMS, "Method: consequents are terms (mamdani) or functions of the inputs.", closed=True),
            names=SLUG,
            most=MAX_SYSTEMS,
        ),
    ] = field(default_factory=dict)
    reference: Annotated[
        Any,
        Key(
            "Desired motion, such as {kind: sine, amplitude: 0.3, frequency_hz: 0.5}; starts at zero unless "
            "run.initial_q is a keyframe, or it has an origin"
        ),
        OneOf(REFERENCES, "Form of the desired motion."),
    ]
    chain: Annotated[
        Chain,
        Key(
            "Sensors and actuators. ideal: exact and instantaneous; fast: position with noise of 0.1 mrad, velocity "
            "differentiated from it and filtered at 500 rad/s, actuators lagging by 2 ms; slow: the same noise, 200 "
            "rad/s, 8 ms; slow-delay: slow, and measurements 2 ms late; the others: those of robots, of which "
            "docs/chains.md says where each number comes from; or each imperfection by itself, "
            "or {from: ur5e, command_delay: 4 ms}"
        ),
        NameOr(CHAINS, Chain),
    ] = CHAINS["ideal"]
    disturbances: Annotated[
        tuple[Any, ...],
        Key(
            "What acts on the joints besides the law; 30 % stands for torque noise held 10 ms with a standard "
            "deviation of 0.3 times the RMS torque of the motion"
        ),
        Disturbances(
            "disturbances",
            0,
            MAX_DISTURBANCES,
            OneOf(DISTURBANCES, "Form of the disturbance."),
            "a list of disturbances, [] for none, or torque noise such as 30 %",
        ),
    ] = ()
    run: Annotated[Run, Key("Length, sampling, start and randomness of the run")]
    figures: Annotated[
        Any,
        Key(
            "Figures to draw of the run: all, or a list of names; none if left out, and torquebench figures draws them "
            "when they are wanted"
        ),
        AllOr(FIGURES),
    ] = None
    video: Annotated[Video | None, Key("Film to make of the run; none if left out, {} for one as usual")] = None
    chosen: Mapping[str, tuple[str, ...]] = field(default_factory=dict, compare=False)
    """Controller -> its gains that were chosen when the config was read; of a stored experiment none."""

    @cached_property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.plant.model)

    @property
    def motion(self) -> Any:
        """The desired motion: of a kind that depends on the arm, what it makes of this one.

        Raises:
            PathError: this arm cannot follow it.
        """
        return self.reference.on_arm(load_model(self.plant.model)) if depends_on_arm(self.reference) else self.reference

    @property
    def laws(self) -> dict[str, str]:
        """Controller -> name of its law."""
        return {keys.name: keys.law for keys in self.controllers}

    @property
    def n_steps(self) -> int:
        """Number of control instants."""
        return whole_steps(self.run.duration, self.run.control_period)

    @property
    def substeps(self) -> int:
        """Physics steps in one control period."""
        return whole_steps(self.run.control_period, self.plant.timestep)

    @cached_property
    def chattering_from_hz(self) -> float:
        """Frequency from which the torque counts as chattering [Hz]: that of the config, or one above the motion's."""
        run = self.run
        if run.chattering_from_hz is not None:
            return run.chattering_from_hz
        motion = self.motion
        if hasattr(motion, "highest_hz"):
            return corner_hz(motion.highest_hz())
        samples = motion.sample(control_instants(self.n_steps, run.control_period), self.n)
        return corner_hz(highest_frequency(samples.qd, run.control_period))

    @property
    def is_drawn(self) -> bool:
        """Whether anything in it is random."""
        noisy = self.chain.is_random or any(disturbance.is_random for disturbance in self.disturbances)
        mismatch = self.model.mismatch
        return noisy or self.plant.perturb is not None or (mismatch is not None and mismatch.is_random)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], overrides: Sequence[str] = ()) -> Experiment:
        """Return the experiment of plain values, keys as in a file; lists may be tuples or arrays.

        Args:
            values: The sections.
            overrides: Edits ``key=value`` made before the check.

        Raises:
            ConfigError: something in it is wrong; all mistakes at once.
        """
        from torquebench.experiment.config import check_experiment
        from torquebench.experiment.source import apply_overrides, document_of

        document = document_of(values)
        apply_overrides(document, overrides)
        return check_experiment(document)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, keys as in a file, every default filled in; `from_dict` gives an equal experiment.

        An arm that was read from a file is there as a whole.
        """
        from torquebench.experiment.dump import plain

        values = plain(self)
        values["plant"]["model"] = self.plant.model
        return values

    def with_(self, changes: Mapping[str, Any] | None = None, **more: Any) -> Experiment:
        """Return an experiment with other values for some keys, checked as a whole.

        Args:
            changes: Dotted key, as of ``--set``, -> its value: ``{"controllers.band.gains.phi": 0.1, "run.seed": 3}``.
            more: Whole sections, or keys by keyword: ``with_(chain="fast", **{"run.duration": 2})``.

        Raises:
            ConfigError: something in it is wrong; all mistakes at once, each with its key.
        """
        from torquebench.experiment.config import check_experiment
        from torquebench.experiment.dump import plain_values
        from torquebench.experiment.source import document_of, set_key

        document = document_of(self.to_dict())
        for key, value in {**(changes or {}), **more}.items():
            set_key(document, key, plain_values(value))
        return check_experiment(document)
