"""Running an experiment: every controller once on the same plant, motion and disturbance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

from torquebench.certificates import Certificate
from torquebench.chain import rate_remarks
from torquebench.disturbances import Stream
from torquebench.errors import ResultError
from torquebench.experiment.arm import limit_remarks, range_remarks, speed_remarks
from torquebench.experiment.build import Loop, build, plant_factors
from torquebench.experiment.certify import certificates, flags, planned
from torquebench.experiment.describe import conditions_text
from torquebench.experiment.dump import config_hash
from torquebench.experiment.explain import explained
from torquebench.experiment.schema import Controller as ControllerKeys
from torquebench.experiment.schema import Experiment
from torquebench.experiment.store import machine, model_checksums, versions
from torquebench.keys import as_vector
from torquebench.laws import find_law
from torquebench.metrics import JointRecord, Metrics, from_joints, measured, record_of
from torquebench.references.reference import Motion, depends_on_arm
from torquebench.robot import load_model
from torquebench.robot.flat_model import SLIDE
from torquebench.robot.perturbation import FACTORS, links_in
from torquebench.robot.puma560.symbols import CONSTANTS
from torquebench.sim.session import Controller, PathName, SampledTrial, Session
from torquebench.sim.trajectory import Trajectory
from torquebench.timing import whole_steps

Progress: TypeAlias = Callable[[str, int, int], None]
"""Called with what is being done, how many units of it are done, and of how many; the last is 0 when not known."""


class Joints(NamedTuple):
    """The joints of the arm that was run."""

    names: tuple[str, ...]
    tau_max: tuple[float, ...]
    """Torque limit of each joint [N m]; force limit [N] of a slide."""
    slides: tuple[bool, ...]
    """Whether each joint slides instead of turning."""


@dataclass(frozen=True)
class ExperimentResult:
    """Numbers and trajectories of one experiment, just run or read from its folder.

    What a folder holds takes the place of what is computed otherwise, so that a stored number stays what it was.
    """

    experiment: Experiment
    joints: Joints
    runs: Mapping[str, Trajectory]
    """Controller name -> its run, in the config's order."""
    metrics: Mapping[str, Metrics]
    """Controller name -> its metrics; a run that failed has none."""
    built: Loop | None = field(default=None, repr=False)
    """Objects of the run; None for a run that was read from a folder."""
    stored: Mapping[str, Any] | None = field(default=None, repr=False)
    """Of a run that was read from a folder, the checksums of its `files`, and properties of this class by name."""
    arm_changed: bool = False
    """Whether the files of the arm are no longer those of the run."""

    def __post_init__(self) -> None:
        """Take what is stored for what would be computed."""
        self.__dict__.update(self.stored or {})

    @cached_property
    def loop(self) -> Loop:
        """Objects of the run; made anew for a stored run, from the arm as it is now."""
        return build(self.experiment) if self.built is None else self.built

    @property
    def slides(self) -> tuple[bool, ...]:
        """Whether each joint slides instead of turning."""
        return self.joints.slides

    @property
    def unexpected(self) -> tuple[str, ...]:
        """Controllers whose run ended otherwise than the config expects."""
        return tuple(
            keys.name
            for keys in self.experiment.controllers
            if self.runs[keys.name].completed != (keys.expect == "completed")
        )

    @cached_property
    def conditions(self) -> str:
        """Conditions of the run, in two lines."""
        return conditions_text(self.experiment)

    @cached_property
    def flags(self) -> tuple[str, ...]:
        """Remarks on what controllers or arm cannot do, what the arm's file lost, and what went wrong in the run."""
        return (*foreseen(self.experiment, self.loop), *self.out_of_range, *self.explained)

    @cached_property
    def explained(self) -> tuple[str, ...]:
        """A line for each controller that fails, errs by more than its motion, .., with the causes; see `explained`."""
        certified = {} if self.arm_changed else self.certified
        return tuple(explained(self.experiment, self.loop, self.runs, self.metrics, certified))

    @cached_property
    def out_of_range(self) -> tuple[str, ...]:
        """A line for each controller that leaves the range or speed of the arm's file, and one for idle motors."""
        return (
            *range_remarks(self.experiment, self.runs),
            *speed_remarks(self.experiment, self.runs),
            *limit_remarks(self.runs, self.joints.tau_max),
        )

    @cached_property
    def certificates(self) -> Mapping[str, Certificate]:
        """Controller name -> its stability certificates over time, from its run and the arm.

        Raises:
            ResultError: the files of the arm are no longer those of the run.
        """
        if self.arm_changed:
            raise ResultError(f"the files of the arm '{self.experiment.plant.model}' have changed since the run")
        return certificates(self.experiment, self.loop, self.runs)

    @cached_property
    def certified(self) -> Mapping[str, Mapping[str, Any]]:
        """Controller name -> headline figures of its stability certificates, as in ``certificates.json``."""
        return {name: found.to_json() for name, found in self.certificates.items()}

    @cached_property
    def facts(self) -> Mapping[str, Any]:
        """Identity of the run: hash of the config, seeds, software and machine."""
        run = self.experiment.run
        return {
            "config_sha256": config_hash(self.experiment),
            "seeds": {
                "seed": run.seed,
                "draw": run.draw,
                "streams": {stream.name.lower(): int(stream) for stream in Stream},
                "mismatch_redraws": self.loop.redraws,
            },
            "software": versions(),
            "machine": machine(),
        }

    @cached_property
    def model_files(self) -> Mapping[str, str]:
        """Checksum of each file of the arm, by its name."""
        return model_checksums(self.experiment.plant.model)

    @cached_property
    def scenario(self) -> dict[str, Any]:
        """Values drawn for model and plant, and the steps at which the payload was taken up and a joint locked."""
        experiment, flat, facts = self.experiment, self.loop.model.flat, dict[str, Any]()
        if experiment.model.mismatch is not None:
            if len(flat.constants):
                facts["model_constants"] = dict(zip(CONSTANTS, flat.constants.tolist(), strict=True))
            else:
                facts["model_links"] = {name: value.tolist() for name, value in links_in(flat)._asdict().items()}
        factors = plant_factors(experiment)
        if factors is not None:
            facts["plant_factors"] = {name: factors[:, i].tolist() for i, name in enumerate(FACTORS)}
        if experiment.plant.payload is not None:
            facts["payload_step"] = whole_steps(experiment.plant.payload.at, experiment.run.control_period)
        if experiment.plant.lock is not None:
            facts["lock_step"] = whole_steps(experiment.plant.lock.at, experiment.run.control_period)
        return facts

    def to_json(self) -> dict[str, Any]:
        """Return conditions, joints, and outcome and metrics of each controller, as ``--json`` prints them."""
        controllers = {}
        for keys in self.experiment.controllers:
            metrics = self.metrics.get(keys.name)
            controllers[keys.name] = {
                "law": keys.law,
                **outcome_facts(self.runs[keys.name]),
                "expected": keys.name not in self.unexpected,
                "metrics": None if metrics is None else metrics.to_json(),
            }
        return {
            "name": self.experiment.name,
            "conditions": self.conditions.splitlines(),
            "joints": list(self.joints.names),
            "controllers": controllers,
        }


def foreseen(experiment: Experiment, loop: Loop) -> tuple[str, ...]:
    """Return what controllers or arm cannot do, and what the arm's file lost, as it is known before the run.

    Args:
        experiment: What is to be run.
        loop: Its objects.
    """
    lacking = [*map(str, flags(experiment, loop)), *planned(experiment, loop), *experiment.plant.remarks()]
    return (*lacking, *rate_remarks(experiment.chain, experiment.run.control_period))


def outcome_facts(trajectory: Trajectory) -> dict[str, Any]:
    """Return how a run ended, for the manifest and for ``--json``."""
    return {
        "path": trajectory.path,
        "path_reason": trajectory.path_reason,
        "outcome": trajectory.outcome.name,
        "failed_at": trajectory.failed_at,
        "detail": trajectory.detail,
        "digest": trajectory.digest(),
    }


def joints_in(loop: Loop) -> Joints:
    """Return names, limits and kinds of the joints of the arm that is run."""
    slides = tuple(kind == SLIDE for kind in loop.model.flat.kind.tolist())
    return Joints(tuple(loop.joint_names), tuple(loop.plant.tau_max.tolist()), slides)


def run_experiment(
    experiment: Experiment,
    loop: Loop | None = None,
    *,
    path: PathName = "auto",
    progress: Progress | None = None,
    finished: Callable[[str, Trajectory], None] | None = None,
) -> ExperimentResult:
    """Run every controller of an experiment.

    Args:
        experiment: A validated experiment.
        loop: Its objects; None to build them.
        path: As for `simulate`.
        progress: Told the controller's name, and how many control instants of how many are done.
        finished: Called with each controller's name and run as soon as it has ended.

    Raises:
        ModelError: a model cannot be used.
    """
    loop = build(experiment) if loop is None else loop
    whole = experiment.n_steps * len(experiment.controllers)
    session, runs = Session(steps=whole), dict[str, Trajectory]()
    metrics: dict[str, Metrics] = {}
    for before, (keys, controller) in enumerate(zip(experiment.controllers, loop.controllers, strict=True)):
        name = controller.name
        step = None if progress is None else _counted(progress, name, before * experiment.n_steps, whole)
        runs[name] = session.run(loop.plant, trial_of(experiment, loop, controller), path, progress=step)
        if finished is not None:
            finished(name, runs[name])
        if runs[name].completed:
            metrics[name] = metrics_of(experiment, loop, keys, runs[name])
    return ExperimentResult(experiment, joints_in(loop), runs, metrics, loop)


def _counted(progress: Progress, name: str, before: int, whole: int) -> Callable[[int], None]:
    return lambda k: progress(name, before + k + 1, whole)


def metrics_of(experiment: Experiment, loop: Loop, keys: ControllerKeys, run: Trajectory) -> Metrics:
    """Return the metrics of one controller's completed run; arguments as of `recorded`."""
    return from_joints(measured(recorded(experiment, loop, keys, run)))


def recorded(experiment: Experiment, loop: Loop, keys: ControllerKeys, run: Trajectory) -> JointRecord:
    """Return one controller's completed run as metrics see it.

    Args:
        experiment: What was run.
        loop: Its objects.
        keys: The controller.
        run: Its run.
    """
    band = band_of(keys.law, keys.gains)
    return record_of(
        run,
        tau_max=loop.plant.tau_max,
        metrics_from=experiment.run.metrics_from,
        control_period=experiment.run.control_period,
        step_like=experiment.reference.is_step_like,
        phi=None if band is None else as_vector(band, experiment.n),
        chattering_from_hz=experiment.chattering_from_hz,
        arm=load_model(experiment.plant.model) if depends_on_arm(experiment.reference) else None,
        disturbance=loop.disturbance,
        motion_hz=experiment.reference.swings_hz if isinstance(experiment.reference, Motion) else (),
    )


def trial_of(experiment: Experiment, loop: Loop, controller: Controller) -> SampledTrial:
    """Return what one controller of an experiment is run with."""
    return SampledTrial(
        controller,
        loop.model,
        loop.reference,
        experiment.run.control_period,
        experiment.chain,
        loop.drawn,
        loop.disturbance,
        loop.initial_q,
    )


def band_of(law: str, gains: Mapping[str, float | tuple[float, ...]]) -> float | tuple[float, ...] | None:
    """Return the half-width of a law's boundary layer [rad/s], or None when it has none."""
    return gains.get("phi") if "phi" in find_law(law).gains else None
