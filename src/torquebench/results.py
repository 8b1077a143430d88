"""Experiments from Python: loaded, run, looked at and saved."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench import comparison
from torquebench.comparison import parse_sides
from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean
from torquebench.experiment import run as runs
from torquebench.experiment.config import check_experiment
from torquebench.experiment.folder import read_result, write_experiment, write_trajectory
from torquebench.experiment.reference import joint_units
from torquebench.experiment.run import ExperimentResult, Joints, Progress
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import document_of, read_bytes, read_document, set_key
from torquebench.experiment.store import RunDirectory, atomic_write, claim_folder
from torquebench.figures import FIGURES
from torquebench.laws.plugin import load_plugin
from torquebench.metrics import applicable
from torquebench.references.reference import depends_on_arm
from torquebench.report.answer import answer
from torquebench.report.run import add_figures, draw_run, stored_page, view_of, write_run
from torquebench.report.run_page import run_page
from torquebench.report.tables import headline_table
from torquebench.shipped import find_config
from torquebench.sim.session import PathName
from torquebench.sim.trajectory import Outcome, Trajectory

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from torquebench.diagnosis import Diagnosis

Source = str | Path | Mapping[str, Any]
"""A config: its file, the name of a shipped one such as ``fig9-chattering``, or its keys as a mapping."""

SIGNAL_UNITS = {
    "q": "rad",
    "qd": "rad/s",
    "q_meas": "rad",
    "qd_meas": "rad/s",
    "q_ref": "rad",
    "qd_ref": "rad/s",
    "qdd_ref": "rad/s^2",
    "s": "rad/s",
    "tau_law": "N m",
    "tau": "N m",
    "tau_applied": "N m",
}
"""Unit of each signal of a trajectory, of a joint that turns."""


def load_experiment(source: Source, changes: Mapping[str, Any] | None = None) -> Experiment:
    """Read and check an experiment.

    Args:
        source: A YAML file, the name of a shipped config, or the keys of one as a mapping.
        changes: Dotted key -> value, set before the check, as of `Experiment.with_`.

    Raises:
        ConfigError: there is no such config, or it has mistakes; all of them at once, with their places.
    """
    if isinstance(source, Mapping):
        document = document_of(source)
    else:
        path = find_config(str(source))
        document = read_document(read_bytes(path), str(path))
    for key, value in (changes or {}).items():
        set_key(document, key, value)
    return check_experiment(document)


def run_experiment(
    experiment: Experiment | Source,
    *,
    folder: str | Path | None = None,
    plugins: Sequence[str | Path] = (),
    path: PathName = "auto",
    progress: Progress | None = None,
) -> Result:
    """Run every controller of an experiment.

    Args:
        experiment: An experiment, or what `load_experiment` takes.
        folder: New or empty folder for the results, the same files as ``torquebench run`` leaves; None to keep them in
            memory, from where `Result.save` can write them.
        plugins: Python files that register laws of your own.
        path: As for `simulate`.
        progress: Called with what is being done, how many units of it are done, and of how many.

    Raises:
        ConfigError: the experiment has mistakes, or the folder is not empty.
        ModelError: a model cannot be used.
    """
    files = [Path(plugin) for plugin in plugins]
    for file in files:
        load_plugin(file)
    checked = experiment if isinstance(experiment, Experiment) else load_experiment(experiment)
    if folder is None:
        return Result(runs.run_experiment(checked, path=path, progress=progress), files)
    directory = RunDirectory(claim_folder(Path(folder), checked.name))
    write_experiment(directory, checked)
    numbers = runs.run_experiment(
        checked, path=path, progress=progress, finished=lambda name, run: write_trajectory(directory, name, run)
    )
    write_run(directory, numbers, files, progress=progress)
    return Result(numbers, files, directory.folder)


def load_result(folder: str | Path, plugins: Sequence[str | Path] = ()) -> Result:
    """Read the folder of a finished run; every number is the one that was stored.

    Args:
        folder: Where ``torquebench run`` or `Result.save` left it.
        plugins: Python files that register laws which the run uses.

    Raises:
        ResultError: it is not a finished run, or a file of it is missing or changed.
        ConfigError: the run uses a law or an arm that does not exist any more.
    """
    files = [Path(plugin) for plugin in plugins]
    for file in files:
        load_plugin(file)
    return Result(read_result(Path(folder)), files, Path(folder))


def compare(
    a: str,
    b: str,
    *,
    states: int = 1000,
    seed: int = 0,
    tolerance: float = 1e-12,
    frozen_joints: Sequence[int] = (),
    rollout: float = 0.0,
) -> pd.DataFrame:
    """Compare two models or plants, as ``torquebench compare`` does.

    Args:
        a, b: What is compared: ``mujoco:MODEL``, ``analytic:MODEL[:STRUCTURE[:CONSTANTS]]`` or a file of MuJoCo's, with
            all that it has: springs, gears and integrator too.
        states: Number of random states.
        seed: Seed of the states.
        tolerance: Relative difference that counts as agreement.
        frozen_joints: Joints, counted from 1, at zero position and speed.
        rollout: Length of closed loops to compare as well [s]; 0 for none.

    Returns:
        A row for each term: ``term, unit, absolute, relative, where, limit, measure, own, growth, agrees, verdict``.
        Its ``attrs`` have the ``terms`` that differ, the share of the difference in torque that these have
        ``left``, and both as a ``sentence``.

    Raises:
        ConfigError: there is no such model, or the two do not have the same joints.
    """
    import pandas as pd

    first, second = parse_sides(a, b, ("a", "b"))
    n, problems = first.dynamics.n, []
    if second.dynamics.n != n:
        problems.append(Problem("b", second.label, f"has {second.dynamics.n} joints, wanted {n} as in {first.label}"))
    if any(not 1 <= joint <= n for joint in frozen_joints):
        problems.append(Problem("frozen_joints", "", f"got {list(frozen_joints)}, wanted joints from 1 to {n}"))
    if states < 1:
        problems.append(Problem("states", "", f"got {states}, wanted at least 1"))
    if problems:
        raise ConfigError(problems)
    found = comparison.compare(
        first,
        second,
        states=states,
        seed=seed,
        tolerance=tolerance,
        frozen=[joint - 1 for joint in frozen_joints],
        rollout=rollout,
    )
    table = pd.DataFrame([row.to_json() for row in found.rows])
    terms = [asdict(term) for term in found.named.terms]
    table.attrs |= {"terms": terms, "left": found.named.left, "sentence": found.sentence}
    return table


class Result:
    """One experiment, run: trajectories, metrics, figures and page.

    Args:
        numbers: What came out.
        plugins: Files that were loaded for it.
        folder: Where it is stored; None if it is not.
    """

    def __init__(self, numbers: ExperimentResult, plugins: Sequence[Path] = (), folder: Path | None = None) -> None:
        self.numbers = numbers
        """Metrics as objects, and everything else that reports are made of."""
        self.plugins = tuple(plugins)
        self.folder = folder
        """Where it is stored; None if it is not."""

    @property
    def experiment(self) -> Experiment:
        """The experiment that was run, every default filled in."""
        return self.numbers.experiment

    @property
    def conditions(self) -> str:
        """Plant, model, motion, sampling, sensors and disturbances, in two lines."""
        return self.numbers.conditions

    @property
    def joints(self) -> Joints:
        """Names, limits and kinds of the joints."""
        return self.numbers.joints

    @property
    def flags(self) -> tuple[str, ...]:
        """Remarks on the run: faults known beforehand, such as switching gains that are too small, and failures."""
        return self.numbers.flags

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """Controller name -> its run: arrays (N, n), in SI units."""
        return self.numbers.runs

    @property
    def outcomes(self) -> dict[str, Outcome]:
        """Controller name -> how its run ended."""
        return {name: run.outcome for name, run in self.numbers.runs.items()}

    @property
    def certificates(self) -> Mapping[str, Mapping[str, Any]]:
        """Controller name -> headline figures of its stability certificates."""
        return self.numbers.certified

    @property
    def metrics(self) -> pd.DataFrame:
        """Headline metrics, one row for each controller, in SI units; NaN where a run failed or has no such metric.

        ``metrics.attrs["units"]`` has the unit of each column.
        """
        import pandas as pd

        names = list(self.numbers.runs)
        rows = [{key: _float(one.value) for key, one in _metrics(self.numbers, name).items()} for name in names]
        table = pd.DataFrame(rows, index=pd.Index(names, name="controller"), columns=list(self._units), dtype=float)
        table.attrs["units"] = self._units
        return table

    @property
    def joint_metrics(self) -> pd.DataFrame:
        """Every metric of every joint: a row for each controller and metric, a column for each joint, in SI units."""
        import pandas as pd

        rows = {
            (name, key): [_float(value) for value in one.per_joint]
            for name in self.numbers.metrics
            for key, one in _metrics(self.numbers, name).items()
            if one.per_joint
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["controller", "metric"]) if rows else None
        table = pd.DataFrame(list(rows.values()), index=index, columns=list(self.joints.names), dtype=float)
        table.attrs["units"] = self._units
        return table

    @property
    def _of_tool(self) -> bool:
        return depends_on_arm(self.experiment.reference)

    @property
    def _units(self) -> dict[str, str]:
        return {info.key: joint_units(info.unit, self.joints.slides) for info in applicable(self._of_tool)}

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each controller: its law, how its run ended, when it failed [s], and its `metrics`."""
        table = self.metrics
        trajectories = self.trajectories
        table.insert(0, "law", [keys.law for keys in self.experiment.controllers])
        table.insert(1, "outcome", [run.outcome.name for run in trajectories.values()])
        failed = [float("nan") if run.completed else float(run.t[-1]) for run in trajectories.values()]
        table.insert(2, "failed_at", failed)
        return table

    def trajectory_frame(self, name: str) -> pd.DataFrame:
        """Return the run of one controller, a row for each control instant.

        Args:
            name: The controller.

        Returns:
            Columns ``t [s]``, ``q:shoulder [rad]`` and so on: signal, joint and unit.

        Raises:
            ResultError: there is no such controller.
        """
        import pandas as pd

        run = self._run(name)
        columns = {"t [s]": run.t}
        for signal, array in run.arrays().items():
            if signal == "t":
                continue
            for i, joint in enumerate(self.joints.names):
                unit = SIGNAL_UNITS.get(signal, "")
                if self.joints.slides[i]:
                    unit = "N" if unit == "N m" else unit.replace("rad", "m")
                columns[f"{signal}:{joint} [{unit}]" if unit else f"{signal}:{joint}"] = array[:, i]
        return pd.DataFrame(columns)

    def _run(self, name: str) -> Trajectory:
        if name not in self.trajectories:
            raise ResultError(f"no controller '{name}' in this run{did_you_mean(name, self.trajectories)}")
        return self.trajectories[name]

    def figure(self, name: str) -> Figure:
        """Draw a figure of the run: ``position``, ``error``, ``torque``, ``sliding``, ``spectrum`` and others.

        Args:
            name: The figure, as its file is called in a run's folder.

        Raises:
            ResultError: this run has no such figure.
        """
        from torquebench.report.figures.run_view import draw_figures

        found = draw_figures(view_of(self.numbers, (name,)), (name,))
        if name not in found:
            raise ResultError(f"no figure '{name}' of this run{did_you_mean(name, found or FIGURES)}")
        return found[name]

    def figures(
        self,
        folder: str | Path | None = None,
        *,
        only: Sequence[str] = (),
        pdf: bool = False,
        paper: bool = False,
        workers: int = 1,
        progress: Progress | None = None,
    ) -> list[Path]:
        """Draw the figures of the run into files, SVG and PNG, and return their paths.

        Args:
            folder: Where to put them; None for the folder that the run is stored in, under ``figures``.
            only: Names of those that are wanted; all if left out.
            pdf: Write each as PDF too.
            paper: Draw each for print: for one column of 85 mm and for two, 180 mm, without headings.
            workers: How many processes draw; a script that asks for more than one needs a main guard.
            progress: Called with each figure when it is drawn.

        Raises:
            ResultError: this run has no such figure, or is not stored and no folder is given.
        """
        from torquebench.report.figures.files import Wish

        if folder is None and self.folder is None:
            raise ResultError("this run is not stored: give a folder for the figures, or save it first")
        files = draw_run(self.numbers, only, Wish(pdf, paper, workers), progress)
        if folder is None:
            add_figures(self.folder or Path(), self._as_stored(), files)
        else:
            Path(folder).mkdir(parents=True, exist_ok=True)
            files = {Path(name).name: content for name, content in files.items()}
            for name, content in files.items():
                atomic_write(Path(folder) / name, content)
        return [Path(folder or self.folder or "") / name for name in files]

    def report(self, path: str | Path | None = None) -> bytes:
        """Return the page of the run, HTML that stands alone.

        Args:
            path: File to write the page to as well; None for none.
        """
        if self.folder is not None:
            page = stored_page(self.folder, self._as_stored())
        else:
            page = run_page(self.numbers)
        if path is not None:
            atomic_write(Path(path), page)
        return page

    def _as_stored(self) -> ExperimentResult:
        return self.numbers if self.numbers.stored is not None else read_result(Path(self.folder or ""))

    def why(self, controller: str | None = None, *, progress: Progress | None = None) -> Diagnosis:
        """Say what makes a controller shake, fail, err or saturate, as ``torquebench why`` does.

        Args:
            controller: Its name; None for the only one, or the one whose run is worst.
            progress: Called with what is run, how many runs are done, and of how many.

        Raises:
            ConfigError: there is no such controller.
        """
        from torquebench.diagnosis import diagnose

        return diagnose(self.experiment, controller, progress)

    def save(self, folder: str | Path | None = None, *, progress: Progress | None = None) -> Path:
        """Write the run into a folder, the same bytes as ``torquebench run`` leaves there, and return the folder.

        Args:
            folder: New or empty folder; None for ``runs/NAME-UTC``.
            progress: Called with each figure when it is drawn.

        Raises:
            ConfigError: the folder is not empty or cannot be made.
            ResultError: the run was read from a folder: copy that folder instead.
        """
        if self.numbers.stored is not None:
            raise ResultError(f"this run is stored already, in {self.folder}: copy that folder")
        directory = RunDirectory(claim_folder(None if folder is None else Path(folder), self.experiment.name))
        write_experiment(directory, self.experiment)
        for name, run in self.trajectories.items():
            write_trajectory(directory, name, run)
        write_run(directory, self.numbers, self.plugins, progress=progress)
        self.folder = directory.folder
        return directory.folder

    def __repr__(self) -> str:
        """Name the experiment and how many controllers completed."""
        completed = sum(run.completed for run in self.trajectories.values())
        return f"<Result {self.experiment.name}: {completed} of {len(self.trajectories)} controllers completed>"

    def _repr_html_(self) -> str:
        """Show the table of headline metrics in a notebook."""
        import pandas as pd

        header, rows = headline_table(self.numbers)
        table = pd.DataFrame(rows, columns=header).to_html(index=False, border=0)
        lines = "<br>".join(html.escape(line) for line in (*self.conditions.splitlines(), *self.flags))
        return f"<p><b>{html.escape(self.experiment.name)}</b><br>{lines}</p><p>{answer(self.numbers)}</p>{table}"


def _metrics(numbers: ExperimentResult, name: str) -> dict[str, Any]:
    """Return the metrics of a controller by key; of one whose run failed none."""
    found = numbers.metrics.get(name)
    return {} if found is None else {info.key: one for info, one in found.items()}


def _float(value: float | None) -> float:
    return float("nan") if value is None else value
