"""Run closed loops one after another, reusing what the last one prepared."""

from __future__ import annotations

import copy
import operator
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np

from torquebench.chain import IDEAL, NOTHING, Chain, Drawn, late_steps
from torquebench.errors import ControllerError, did_you_mean
from torquebench.fuzzy import FuzzySystem
from torquebench.kernel import Array
from torquebench.kernel.struct import rewrite
from torquebench.laws import Law, find_law
from torquebench.references import Reference
from torquebench.robot.flat_model import EXACT, Model, own_copy
from torquebench.robot.robot_model import RobotModel
from torquebench.sim.closed_loop import COMPLETED
from torquebench.sim.interpreted import PythonRun
from torquebench.sim.job import Setup, is_fixed, set_up
from torquebench.sim.native import QUICKER, NativeRun, interpreted_before, obstacle, reason_to_interpret
from torquebench.sim.plants import NativePlant, Plant, instants_of_change
from torquebench.sim.signals import control_instants
from torquebench.sim.trajectory import Trajectory, trajectory_of
from torquebench.timing import substeps_per_period

PathName = Literal["auto", "python", "native"]


@dataclass(frozen=True, slots=True)
class Controller:
    """A law with its gains, under the name it has in results."""

    name: str
    law: Law = field(repr=False)
    gains: Any
    """The tuple the law receives; see `Law.pack_gains`."""

    @classmethod
    def of(
        cls,
        law: str,
        n: int,
        gains: Mapping[str, Any],
        options: Mapping[str, str | bool] | None = None,
        name: str | None = None,
        fuzzy: FuzzySystem | str | None = None,
    ) -> Controller:
        """Return a controller of a registered law.

        Args:
            law: Name of the law.
            n: Number of joints.
            gains: Gain name -> a number, or one for each joint.
            options: Option name -> value; those left out take their defaults.
            name: Name in results; None for the law's.
            fuzzy: Fuzzy system of a law that takes one: its definition, or the name of a built-in one.

        Raises:
            ControllerError: no such law, or gains or options it cannot use.
        """
        found = find_law(law)
        return cls(name or law, found, found.pack_gains(n, gains, options or {}, fuzzy))


@dataclass(frozen=True, slots=True)
class SampledTrial:
    """One closed loop, every signal sampled at its control instants t_k = k control_period, k = 0 .. N - 1."""

    controller: Controller
    model: RobotModel
    """The law's belief about the plant."""
    reference: Reference
    """Desired motion, (N, n), or (N, 1) for the same on every joint."""
    control_period: float = 0.001
    """Time between control instants [s], a whole multiple of the plant's time step."""
    chain: Chain = IDEAL
    """Sensors and actuators; what is random in them is `drawn`, whatever the chain says of it."""
    drawn: Drawn = NOTHING
    """What the chain has drawn for this run."""
    disturbance: Array | None = None
    """Torque added to what the drives give, (N, n) [N m]; None for none."""
    initial_q: Array | None = None
    """Position at rest at t = 0, (n,) [rad]; None for zero."""


def _burden(plant: Plant, substeps: int) -> int:
    """Return how many control steps of a law one of a run takes, interpreted."""
    return 1 + substeps * getattr(plant, "burden", 0)


@dataclass(slots=True)
class Begun:
    """A closed loop on its way."""

    run: PythonRun | NativeRun
    t: Array
    """Control instants, (N,) [s]."""
    changes: list[int]
    """Control instants at which the plant is still to change, rising."""
    at_once: int
    """Control instants to ask for at once."""
    reason: str
    """Why it is interpreted where that was not asked for."""

    def change(self, k: int) -> None:
        """Have the plant change, if it does so at control instant k."""
        if self.changes and self.changes[0] == k:
            del self.changes[0]
            self.run.change()

    def advance(self, first: int, last: int) -> int:
        """Run control instants `first` .. `last` - 1 and return how that ended."""
        done, status = first, COMPLETED
        while done < last and status == COMPLETED:
            self.change(done)
            end = min([last, *self.changes[:1]])
            status, done = self.run(done, end), end
        return status


class Session:
    """Runs closed loops, one after another, and keeps what the next one can use again.

    A session is for one thread at a time; its plants too. A trajectory stays as it was returned, unless `overwrite`.

    Args:
        overwrite: Let a run write its trajectory over the one of the run before, where both are of one kind: the same
            controller, plant and motion, and signals of the same shape. For thousands of runs of which none is kept.
        steps: Control steps that will be asked of it and of others like it, as far as known; see `reason_to_interpret`.
    """

    def __init__(self, *, overwrite: bool = False, steps: int = 0) -> None:
        self._overwrite = overwrite
        self._asked = steps
        self._busy = threading.Lock()
        self._checked: tuple[Array | None, ...] = (None, None, None)
        """The last desired motion found finite; None in place of an array that can be written to."""
        self._belief: _Belief | None = None
        self._last: _Last | None = None

    def run(
        self,
        plant: Plant,
        trial: SampledTrial,
        path: PathName = "auto",
        progress: Callable[[int], None] | None = None,
    ) -> Trajectory:
        """Run one closed loop from rest; a failed run is returned, not raised.

        Args:
            plant: The truth; reset here.
            trial: What to run.
            path: See `simulate`.
            progress: See `simulate`.

        Raises:
            ValueError: durations, shapes or joint counts that do not fit, or an unknown path.
            ControllerError: `path` is ``native`` and the run cannot be compiled.
            RuntimeError: the session is in use.
        """
        if not self._busy.acquire(blocking=False):
            raise RuntimeError("the session is in use: wanted one for each thread")
        try:
            return self._run(plant, trial, path, progress)
        finally:
            self._busy.release()

    def _run(
        self,
        plant: Plant,
        trial: SampledTrial,
        path: PathName,
        progress: Callable[[int], None] | None,
    ) -> Trajectory:
        begun = self.begin(plant, trial, path)
        run, n_steps, status, done = begun.run, len(begun.t), COMPLETED, 0
        while done < n_steps and status == COMPLETED:
            last = min(done + begun.at_once, n_steps)
            status = begun.advance(done, last)
            done = last
            if progress is not None and status == COMPLETED:
                progress(last - 1)
        if isinstance(run, PythonRun):
            return trajectory_of(run.setup, begun.t, status, run.detail, "python", begun.reason)
        return self._trajectory(run.setup, begun.t, status, run.detail)

    def begin(self, plant: Plant, trial: SampledTrial, path: PathName) -> Begun:
        """Return a closed loop at rest at its start; arguments and errors as of `run`."""
        check_path(path)
        controller, control_period = trial.controller, trial.control_period
        n, n_steps = plant.n, len(trial.reference.q)
        substeps = substeps_per_period(control_period, plant.timestep)
        t = control_instants(n_steps, control_period)
        desired = _each_joint(trial.reference, n)
        start = np.zeros(n) if trial.initial_q is None else np.array(trial.initial_q, dtype=np.float64)
        self._check(n, n_steps, trial, desired, start)
        changes = instants_of_change(plant, control_period, n_steps)
        reason = self._reason(plant, controller.law, path, n_steps * _burden(plant, substeps))
        if path == "native" and reason:
            raise ControllerError(f"controller '{controller.name}' cannot run on the native path: {reason}")
        native = None if path == "python" or reason else plant.native()  # type: ignore[attr-defined]
        plant.reset(start, np.zeros(n))
        run: PythonRun | NativeRun
        if native is None:
            run = self._interpreted(plant, trial, desired, substeps)
        else:
            run = self._compiled(plant, trial, desired, substeps, native)
        return Begun(run, t, list(changes), max(1, run.longest // substeps), reason)

    def _reason(self, plant: Plant, law: Law, path: PathName, steps: int) -> str:
        """Return why a run that may be compiled is not; arguments as of `reason_to_interpret`."""
        if path == "python":
            return ""
        if path == "native":
            return obstacle(plant, law)
        reason = reason_to_interpret(plant, law, max(self._asked, steps))
        if reason == QUICKER:
            interpreted_before(law, steps)
        return reason

    def _check(self, n: int, n_steps: int, trial: SampledTrial, desired: Reference, start: Array) -> None:
        model, controller = trial.model, trial.controller
        if not isinstance(trial.chain, Chain):
            raise TypeError(f"chain is {trial.chain!r}, wanted a Chain, such as CHAINS['fast']")
        if not isinstance(model, RobotModel):
            raise TypeError(
                f"model is a {type(model).__name__}, wanted a RobotModel: what the law believes, not the plant"
            )
        if model.n != n:
            raise ValueError(f"the model has {model.n} joints, the plant {n}")
        if problem := controller.law.misfit("exact" if model.flat.structure == EXACT else "corrected or printed"):
            raise ValueError(problem)
        for gain in controller.gains:
            if isinstance(gain, np.ndarray) and gain.shape != (n,):
                raise ValueError(f"controller '{controller.name}' has gains for {len(gain)} joints, the plant has {n}")
        for name, array, known in zip(desired._fields, desired, self._checked, strict=True):
            if array.shape != (n_steps, n):
                raise ValueError(f"reference {name} has shape {array.shape}, wanted {(n_steps, n)}")
            if array is not known and not np.all(np.isfinite(array)):
                raise ValueError(f"reference {name} has values that are not finite")
        self._checked = tuple(array if is_fixed(array) else None for array in desired)
        if start.shape != (n,) or not np.all(np.isfinite(start)):
            raise ValueError(f"initial_q is {start}, wanted {n} finite numbers")
        signals = {"disturbance": trial.disturbance, "position": trial.drawn.position, "velocity": trial.drawn.velocity}
        for name, signal in signals.items():
            if signal is not None and (signal.shape != (n_steps, n) or not np.isfinite(signal).all()):
                raise ValueError(f"{name} has shape {signal.shape}, wanted {(n_steps, n)}, all finite")
        late = trial.drawn.late
        if late is not None and (late.shape != (n_steps,) or not np.all(late >= 0.0)):
            raise ValueError(f"late has shape {late.shape}, wanted {(n_steps,)}, none negative")

    def _interpreted(self, plant: Plant, trial: SampledTrial, desired: Reference, substeps: int) -> PythonRun:
        return PythonRun(
            set_up(
                trial.controller.law,
                copy.deepcopy(trial.controller.gains),  # a law that writes to its arguments changes no other run
                own_copy(trial.model.flat, control_period=trial.control_period),
                plant,
                desired,
                trial.chain,
                control_period=trial.control_period,
                substeps=substeps,
                drawn=trial.drawn,
                disturbance=trial.disturbance,
                native=None,
            )
        )

    def _compiled(
        self, plant: Plant, trial: SampledTrial, desired: Reference, substeps: int, native: NativePlant
    ) -> NativeRun:
        """Return a compiled run, ready to start; the last one again if it is of the same kind."""
        belief = self._belief_of(trial.model.flat, trial.control_period)
        kind = _kind_of(plant, trial, desired, substeps, native, belief)
        if self._last is not None and self._last.restart(kind, trial, native):
            return self._last.run
        gains, drawn, disturbance = trial.controller.gains, trial.drawn, trial.disturbance
        if self._overwrite:  # copies, which the next run may write over
            gains, drawn, disturbance = copy.deepcopy((gains, drawn, disturbance))
        setup = set_up(
            trial.controller.law,
            gains,
            belief,
            plant,
            desired,
            trial.chain,
            control_period=trial.control_period,
            substeps=substeps,
            drawn=drawn,
            disturbance=disturbance,
            native=native,
        )
        run = NativeRun(setup, native)
        keep = self._overwrite and all(is_fixed(x) for x in desired)
        self._last = _Last(kind, run) if keep else None
        return run

    def _trajectory(self, setup: Setup, t: Array, status: int, detail: str) -> Trajectory:
        """Return the trajectory of a compiled run that has ended; arguments as for `trajectory_of`."""
        last = self._last
        if last is None:
            return trajectory_of(setup, t, status, detail, "native", "")
        if last.whole is not None and status == COMPLETED:
            return last.whole
        if last.whole is not None:
            for name, array in vars(setup.job).items():
                if name.startswith("record_"):
                    array.setflags(write=True)  # what was not produced at the failing instant is blanked
        trajectory = trajectory_of(setup, t, status, detail, "native", "")
        last.whole = trajectory if status == COMPLETED else None
        return trajectory

    def _belief_of(self, belief: Model, control_period: float) -> Model:
        """Return a copy of a belief for the compiled runs of this session.

        The last copy serves again where the same belief comes again, or one that differs in its constants alone, as
        draws do.
        """
        last = self._belief
        if last is None or last.copy.control_period != control_period or not _alike(last.belief, belief):
            constants = belief.constants.copy()
            shown = constants.view()
            shown.setflags(write=False)
            twin = own_copy(belief, control_period=control_period, constants=shown)
            last = self._belief = _Belief(belief, twin, constants)
        elif last.belief is not belief:
            last.constants[:], last.belief = belief.constants, belief
        for array in last.copy.scratch:
            array.fill(0.0)  # a law may have left something there
        return last.copy


@dataclass(slots=True)
class _Belief:
    """The session's copy of the belief that came last."""

    belief: Model
    copy: Model
    constants: Array
    """The copy's constants, which can be written here alone."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """Identity of a run: two runs of equal kind can use the same memory."""

    same: tuple[Any, ...]
    """Objects that must be the same ones."""
    equal: tuple[Any, ...]
    """Values that must be equal."""

    def fits(self, other: _Kind) -> bool:
        return self.equal == other.equal and all(x is y for x, y in zip(self.same, other.same, strict=True))


def _kind_of(
    plant: Plant, trial: SampledTrial, desired: Reference, substeps: int, native: NativePlant, belief: Model
) -> _Kind:
    missing = *(signal is None for signal in trial.drawn), trial.disturbance is None
    return _Kind(
        (trial.controller.law, plant, native.structure, belief, *desired),
        (trial.chain, trial.control_period, substeps, *missing),
    )


@dataclass(slots=True)
class _Last:
    """The memory of the last compiled run of a session that overwrites."""

    kind: _Kind
    run: NativeRun
    whole: Trajectory | None = None
    """The trajectory of the last run, if it completed."""

    def restart(self, kind: _Kind, trial: SampledTrial, native: NativePlant) -> bool:
        """Reset the run, with gains and signals of another trial; False if that is of another kind."""
        if not self.kind.fits(kind) or not rewrite(self.run.setup.gains, trial.controller.gains):
            return False
        job = self.run.setup.job
        if trial.drawn.position is not None:
            job.sensors.noise[...] = trial.drawn.position
        if trial.drawn.velocity is not None:
            job.sensors.velocity_noise[...] = trial.drawn.velocity
        if trial.drawn.late is not None:
            job.drives.late[...] = late_steps(trial.drawn.late, self.run.setup.plant.timestep, job.control_period)
        if trial.disturbance is not None:
            job.disturbance[...] = trial.disturbance
        seen = (job.fresh_q, job.fresh_qd, job.measured_q, job.measured_qd)
        states = job.late, job.output, job.torque, job.memory, job.at, *job.drives.states, job.sensors.estimate
        for array in (*states, *(x for x in seen if x is not job.q)):
            if array is not job.qd:
                array.fill(0)
        self.run.restart(native)
        return True


_SHARED = operator.attrgetter(
    *(field.name for field in fields(Model) if field.name not in ("constants", "control_period", "scratch"))
)
"""Fields that all draws of one model share."""


def _alike(a: Model, b: Model) -> bool:
    """True if two models differ in their constants at most."""
    same = a is b or all(x is y for x, y in zip(_SHARED(a), _SHARED(b), strict=True))
    return same and len(a.constants) == len(b.constants)


def check_path(path: str) -> None:
    """Refuse a path that does not exist.

    Raises:
        ValueError: `path` is none of `PathName`.
    """
    if path not in get_args(PathName):
        raise ValueError(f"path is {path!r}{did_you_mean(path, get_args(PathName))}")


def _each_joint(desired: Reference, n: int) -> Reference:
    """Repeat a reference of one column, made from plain numbers, for every joint."""
    return Reference(*(np.repeat(x, n, axis=1) if np.ndim(x) == 2 and x.shape[1] == 1 else x for x in desired))
