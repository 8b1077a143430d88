"""Audits from Python: the claims of a study, run and judged."""

from __future__ import annotations

import hashlib
import html
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.audit import DIGEST, STUDY
from torquebench.audit.judge import Judged, judge_study
from torquebench.audit.pages import figures_of, write_files
from torquebench.audit.run import CONDITIONS, Part, Runs, parts_of, read_parts, run_parts
from torquebench.audit.study import Study, take_audit
from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean
from torquebench.experiment.dump import flat_text
from torquebench.experiment.run import Progress
from torquebench.experiment.source import apply_overrides, read_bytes, read_document
from torquebench.experiment.store import MANIFEST, RunDirectory, add_to_run, check_run, claim_folder, json_bytes
from torquebench.laws.plugin import load_plugin
from torquebench.robot.library import ArmFile, arm_name
from torquebench.shipped import find_config
from torquebench.sweep.folder import kept_at
from torquebench.sweeps import edits_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from torquebench.report.figures.files import Wish


def run_audit(
    study: str | Path,
    *,
    folder: str | Path | None = None,
    draws: int | None = None,
    changes: Mapping[str, Any] | Sequence[str] = (),
    workers: int | None = None,
    figures: bool = True,
    plugins: Sequence[str | Path] = (),
    progress: Progress | None = None,
) -> Audit:
    """Run a study under each of its conditions, and judge its claims.

    Args:
        study: A config with a section ``audit``: its file, or the name of a shipped one.
        folder: Where to store it: new, empty, or one in which this audit was begun, which then goes on; None for
            ``runs/NAME-UTC``.
        draws: Draws in place of those of the study.
        changes: Dotted key -> value, set before the check.
        workers: How many conditions run at once; None for one per core.
        figures: Whether to draw.
        plugins: Python files that register kinds of your own.
        progress: Called with what is being done, how many runs are done, and of how many.

    Raises:
        ConfigError: the study has mistakes, or the folder holds something else.
        ResultError: a stored file was altered.
    """
    for file in plugins:
        load_plugin(Path(file))
    edits = edits_of(changes) if isinstance(changes, Mapping) else list(changes)
    asked, text = _asked(study, edits)
    parts = parts_of(asked, draws)
    directory = _claim(None if folder is None else Path(folder), asked, parts)
    arms = {path: arm for path, (_, arm) in sorted(asked.document.arms.items())}
    kept = {path: kept_at(path, arm) for path, arm in arms.items()}
    for path, arm in arms.items():
        directory.write(kept[path], arm.text.encode())
    directory.write(STUDY, text)
    made = {"digest": _digest(parts), "draws": draws, "set": edits}
    directory.write(DIGEST, json_bytes(made | ({"arms": kept} if kept else {})))
    total = sum(part.plan.rows for part in parts)
    done = 0

    def report(what: str, runs: int) -> None:
        nonlocal done
        done += runs
        if progress is not None:
            progress(what, done, total)

    runs = run_parts(parts, directory.folder / CONDITIONS, workers or os.cpu_count() or 1, report)
    judged = judge_study(asked, runs, draws is not None)
    for name, content in write_files(asked, judged, parts, directory.folder, figures, lambda what: report(what, 0)):
        directory.write(name, content)
    directory.finish({"name": asked.document.root["name"], "runs": total})
    return Audit(asked, runs, judged, directory.folder, reduced=draws is not None)


def _asked(study: str | Path, edits: Sequence[str]) -> tuple[Study, bytes]:
    """Return a study with changes, and its text without them and without `extends`."""
    path = find_config(str(study))
    text = read_bytes(path)
    document = read_document(text, str(path))
    text = flat_text(document, text)
    apply_overrides(document, edits)
    return take_audit(document), text


def audit_config(study: str | Path, changes: Sequence[str] = ()) -> dict[str, Any]:
    """Return a checked study's whole config, changes and what it extends included.

    Args:
        study: A config with a section ``audit``: its file, or the name of a shipped one.
        changes: Texts ``key=value``.

    Raises:
        ConfigError: the study has mistakes.
    """
    asked, _ = _asked(study, changes)
    parts_of(asked)
    root: dict[str, Any] = asked.file.root
    return root


def read_audit(folder: str | Path, plugins: Sequence[str | Path] = ()) -> Audit:
    """Read a finished audit from its folder; its claims are judged again, nothing is run.

    Args:
        folder: The folder.
        plugins: Python files that register kinds of your own.

    Raises:
        ConfigError: a condition's folder holds another sweep.
        ResultError: it is no finished audit's folder, a stored file was altered, or this version asks for other runs.
    """
    folder, files = Path(folder), tuple(Path(file).absolute() for file in plugins)
    for file in files:
        load_plugin(file)
    check_run(folder)
    if not (folder / DIGEST).is_file():
        raise ResultError(f"{folder}: is no audit's folder: {DIGEST} is missing")
    made = json.loads((folder / DIGEST).read_bytes())
    document = read_document(read_bytes(folder / STUDY), str(folder / STUDY))
    for path, file in made.get("arms", {}).items():
        document.arms[path] = None, ArmFile(arm_name(path), read_bytes(folder / file).decode())
    apply_overrides(document, made.get("set", ()))
    study = take_audit(document)
    parts = parts_of(study, made.get("draws"))
    if _digest(parts) != made.get("digest"):
        raise ResultError(
            f"{folder}: another version made it; the same torquebench audit with --out {folder} renews it"
        )
    runs = read_parts(parts, folder / CONDITIONS, files)
    reduced = made.get("draws") is not None
    return Audit(study, runs, judge_study(study, runs, reduced), folder, reduced=reduced)


def draw_audit(
    audit: Audit, only: Sequence[str], wish: Wish, progress: Progress | None = None, place: str = "only"
) -> dict[str, bytes]:
    """Draw figures of an audit into its folder; return each file's name and content.

    Args:
        audit: The audit.
        only: Names of the figures that are wanted; all if there are none.
        wish: How they are written.
        progress: Told each figure when it is drawn.
        place: What messages call `only`.

    Raises:
        ConfigError: the audit has no figure of one of the names.
    """
    from torquebench.report.figures.files import chosen_files

    jobs = {name: draw for name, (_, draw) in figures_of(audit.study, audit.claims).items()}
    files = chosen_files(jobs, only, wish, progress, place)
    add_to_run(audit.folder, files)
    return files


def _digest(parts: Sequence[Part]) -> str:
    """Return the digest of an audit's runs, by which they are known again."""
    arms = sorted(f"{path} {arm.digest}" for path, (_, arm) in parts[0].arms.items()) if parts else []
    texts = [part.folder + "\n" + part.text for part in parts]
    return hashlib.sha256("\n".join([*texts, *arms]).encode()).hexdigest()


def _claim(folder: Path | None, study: Study, parts: Sequence[Part]) -> RunDirectory:
    """Return the folder to write to: a new or empty one, or one in which the same audit was begun."""
    if folder is not None and (folder / DIGEST).is_file():
        if json.loads((folder / DIGEST).read_bytes()).get("digest") != _digest(parts):
            message = f"{folder} holds an audit of other runs, wanted a new or empty folder, or this study's own"
            raise ConfigError([Problem("--out", "", message)])
        (folder / MANIFEST).unlink(missing_ok=True)
        return RunDirectory(folder)
    return RunDirectory(claim_folder(folder, str(study.document.root["name"])))


class Audit:
    """A study that was run, and its claims with their verdicts.

    Args:
        study: The study.
        runs: What came out.
        claims: Its claims, judged, in order.
        folder: Where everything is stored.
        reduced: Whether it has other draws than the study asks for.
    """

    def __init__(self, study: Study, runs: Runs, claims: Sequence[Judged], folder: Path, reduced: bool = False) -> None:
        self.study, self.runs, self.claims, self.folder = study, runs, tuple(claims), folder
        self._reduced = reduced

    def claim(self, key: str) -> Judged:
        """Return one claim.

        Raises:
            ResultError: there is none of this name.
        """
        found = {claim.key: claim for claim in self.claims}
        if key not in found:
            raise ResultError(f"no claim '{key}'{did_you_mean(key, found)}")
        return found[key]

    @property
    def moved(self) -> tuple[Judged, ...]:
        """Claims whose verdict is another one than the study expects; with other draws not those left undecided."""
        return tuple(
            claim for claim in self.claims if claim.moved and not (self._reduced and claim.verdict == "undecided")
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each figure of each case: claim, pair, levels of the axes, value, interval, verdict."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"claim": claim.key, "pair": case.pair.label, "like": case.pair.like}
                | dict(zip(self.study.axes, case.condition, strict=True))
                | {"figure": one.measure.figure, "as": one.measure.relation, "of": one.of, "beside": one.beside}
                | one.interval._asdict()
                | {"verdict": str(one.verdict), "case": str(case.verdict)}
                for claim in self.claims
                for case in (*claim.cases, *claim.shown)
                for one in case.figures
            ]
        )

    def figure(self, key: str | None = None, measure: int = 0) -> Figure | None:
        """Draw the overview, or the forest plot of one claim; None of a claim without a case.

        Args:
            key: Name of the claim; None for the overview.
            measure: Which of its measures.

        Raises:
            ResultError: there is no such claim.
        """
        from torquebench.audit.figures import forest, overview

        return overview(self.study, self.claims) if key is None else forest(self.claim(key), self.study.laws, measure)

    def __repr__(self) -> str:
        """Name the study and how many claims have which verdict."""
        verdicts = [str(claim.verdict) for claim in self.claims]
        counts = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in dict.fromkeys(verdicts))
        return f"<Audit {self.study.document.root['name']}: {counts}>"

    def _repr_html_(self) -> str:
        """Show the claims in a notebook."""
        rows = "".join(
            f"<tr><td>{html.escape(claim.claim.says)}</td><td><b>{claim.verdict}</b></td>"
            f"<td>{html.escape(claim.sentence)}</td></tr>"
            for claim in self.claims
        )
        return f"<table><tr><th>claim</th><th>verdict</th><th>what came out</th></tr>{rows}</table>"
