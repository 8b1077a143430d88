"""Running an experiment: every controller once on the same plant, motion and disturbance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from torquebench.experiment.build import Loop, build, build_chain
from torquebench.experiment.schema import Controller as ControllerKeys
from torquebench.experiment.schema import Experiment
from torquebench.laws import find_law
from torquebench.metrics import Metrics, PerJoint, from_joints, per_joint
from torquebench.registry import as_vector
from torquebench.robot.model import SLIDE
from torquebench.sim.batch import Trial, run_trial
from torquebench.sim.loop import Controller, PathName
from torquebench.sim.result import Motion
from torquebench.sim.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class ExperimentResult:
    """What came out of one experiment."""

    experiment: Experiment
    loop: Loop
    runs: Mapping[str, Trajectory]
    """Controller name -> its run, in the config's order."""
    metrics: Mapping[str, Metrics]
    """Controller name -> its metrics; a run that failed has none."""

    @property
    def slides(self) -> tuple[bool, ...]:
        """Whether each joint slides instead of turning."""
        return tuple(kind == SLIDE for kind in self.loop.model.flat.kind)

    @property
    def unexpected(self) -> tuple[str, ...]:
        """Controllers whose run ended otherwise than the config expects."""
        return tuple(
            keys.name
            for keys in self.experiment.controllers
            if self.runs[keys.name].completed != (keys.expect == "completed")
        )


def run_experiment(
    experiment: Experiment,
    loop: Loop | None = None,
    *,
    path: PathName = "auto",
    progress: Callable[[str, int], None] | None = None,
    finished: Callable[[str, Trajectory], None] | None = None,
    watch: Callable[[str, int, Motion], None] | None = None,
) -> ExperimentResult:
    """Run every controller of an experiment.

    Args:
        experiment: A validated experiment.
        loop: Its objects; None to build them.
        path: As for `simulate`.
        progress: Called with the controller's name and the index of the control instant just finished.
        finished: Called with each controller's name and run as soon as it has ended.
        watch: Called as of `simulate`, with the controller's name before.

    Raises:
        ModelError: a model cannot be used.
    """
    loop = build(experiment) if loop is None else loop
    runs: dict[str, Trajectory] = {}
    metrics: dict[str, Metrics] = {}
    for keys, controller in zip(experiment.controllers, loop.controllers, strict=True):
        name = controller.name
        runs[name] = run_trial(
            loop.plant,
            trial_of(experiment, loop, controller),
            path,
            progress=None if progress is None else partial(progress, name),
            watch=None if watch is None else partial(watch, name),
        )
        if finished is not None:
            finished(name, runs[name])
        if runs[name].completed:
            metrics[name] = metrics_of(experiment, loop, keys, runs[name])
    return ExperimentResult(experiment, loop, runs, metrics)


def metrics_of(experiment: Experiment, loop: Loop, keys: ControllerKeys, run: Trajectory) -> Metrics:
    """Return the metrics of one controller's completed run; arguments as of `joints_of`."""
    return from_joints(joints_of(experiment, loop, keys, run))


def joints_of(experiment: Experiment, loop: Loop, keys: ControllerKeys, run: Trajectory) -> PerJoint:
    """Return the metrics of one controller's completed run, joint by joint.

    Args:
        experiment: What was run.
        loop: Its objects.
        keys: The controller.
        run: Its run.
    """
    band = band_of(keys.law, keys.gains)
    return per_joint(
        run,
        tau_max=loop.plant.tau_max,
        metrics_from=experiment.run.metrics_from,
        control_period=experiment.run.control_period,
        reference_kind=experiment.reference.kind,
        phi=None if band is None else as_vector(band, experiment.n),
    )


def trial_of(experiment: Experiment, loop: Loop, controller: Controller) -> Trial:
    """Return what one controller of an experiment is run with."""
    return Trial(
        controller,
        loop.model,
        loop.reference,
        experiment.run.duration,
        experiment.run.control_period,
        build_chain(experiment.chain),
        loop.position_noise,
        loop.disturbance,
        loop.initial_q,
    )


def band_of(law: str, gains: Mapping[str, float | tuple[float, ...]]) -> float | tuple[float, ...] | None:
    """Return the half-width of a law's boundary layer [rad/s], or None when it has none."""
    return gains.get("phi") if "phi" in find_law(law).gains else None
