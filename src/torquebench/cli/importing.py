"""``torquebench import``: a published arm made into a plain chain, with a table of what became of each part."""

from __future__ import annotations

import shlex
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from torquebench.cli.app import command
from torquebench.cli.parameters import File, Words, Wrong, argument, option, out_folder, refuse
from torquebench.cli.terminal import LEAST, bad, good, say, table, tell, width
from torquebench.errors import ModelError, Problem

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torquebench.robot.importing import Part

DROPS = ("springs", "fluid", "tendons", "equalities", "gravcomp", "nonlinear-damping", "impossible-inertia")


class TorqueLimits(click.ParamType[Any]):
    """Numbers in the joints' order, ``87,87,12``; of some joints by name, ``j1=87,j2=12``; or a YAML file of either."""

    name = "limits"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the numbers, or a mapping from names to numbers."""
        if not isinstance(value, str):
            return value
        if value.endswith((".yaml", ".yml")):
            from torquebench.robot.importing.limits import read_limits

            try:
                return read_limits(Path(value))
            except ModelError as error:
                raise Wrong(text=str(error)) from None
        words = value.replace(",", " ").split()
        try:
            if all("=" in word for word in words) and words:
                return {name: float(number) for name, _, number in (word.rpartition("=") for word in words)}
            return tuple(float(word) for word in words)
        except ValueError:
            raise Wrong(
                got=f"'{value}'", wanted="numbers as 87,87,12, NAME=NUMBER as elbow=87,wrist=12, or a YAML file"
            ) from None


@command(name="import", example="torquebench import panda.xml --fix left_finger,right_finger --out arms/panda")
@argument("file", type=File(".xml", ".urdf", ".mjcf"), help="an arm: an MJCF or URDF file")
@out_folder(help="where the arm's folder goes (default: arms/NAME)")
@option(
    "--fix",
    type=Words(),
    multiple=True,
    metavar="NAME,NAME",
    help="joints that are welded at home; of a body, its joints and all beyond it",
)
@option("--base", default="", metavar="BODY", help="the body that the chain starts at (default: the world)")
@option("--tip", default="", metavar="BODY", help="the body that the chain ends with; what hangs from it is left out")
@option("--tool", default="", metavar="NAME", help="the site or body that is the tool")
@option(
    "--torque-limits",
    type=TorqueLimits(),
    default="",
    metavar="LIMITS",
    help="of each joint [N m], 87,87,12; of some, elbow=87; or a YAML file of either (default: the file's own)",
)
@option(
    "--drop",
    type=Words(DROPS),
    multiple=True,
    metavar="FORCE,FORCE",
    help=f"forces that are left out although they move the arm: {', '.join(DROPS)}",
)
@option("--force", is_flag=True, help="replace an arm imported there before; a folder with anything else is refused")
def import_(
    file: Path,
    out: Path | None,
    fix: Sequence[list[str]],
    base: str,
    tip: str,
    tool: str,
    torque_limits: Any,
    drop: Sequence[list[str]],
    force: bool,
) -> int:
    """Make any MJCF or URDF file into an arm.

    Joints, inertias, damping, friction and torque limits of a serial arm are taken over, what changes no motion is
    left out, and one table says what became of each part. The arm is proved in plain MuJoCo to be the published one.
    """
    from torquebench.robot import importing
    from torquebench.robot.importing import folder
    from torquebench.robot.joint_facts import arm_facts
    from torquebench.robot.library import plain_name

    if not file.is_file():
        refuse([Problem("FILE", got=f"'{file}'", wanted="an MJCF or URDF file that exists")])
    name = plain_name(out.name if out else file.stem)
    place = out or Path("arms") / name
    if why := folder.obstacle(place, force):
        refuse([("--out", why)])
    options = importing.Options(
        tuple(chain.from_iterable(fix)), base, tip, tool, torque_limits, tuple(chain.from_iterable(drop)), name
    )
    line = _line(file, place, options)
    try:
        arm = importing.import_arm(file, options)
        files = folder.write_folder(arm, place, line, force)
    except importing.RefusedArmError as error:
        _show(error.findings)
        if error.flags or error.without_limit:
            more = _line(file, place if out else None, importing.with_flags(options, error.flags), error.without_limit)
            say(f"\nnothing written; what flags can take, this does:\n  {more}", fold=False)
        if error.without_limit:
            say("N stands for a torque limit of your data sheet [N m; N for a slide]")
        raise
    except importing.UnprovedArmError as error:
        say(bad_line := str(error))
        tell(unproved=bad_line)
        return 1
    except ModelError as error:
        refuse(error.problems)
        return 2
    _show(arm.findings)
    proof = arm.proof
    say(
        f"\nproved: the same arm as {file.name} at {importing.STATES} random states in plain MuJoCo, largest relative "
        f"difference of mass matrix {proof.mass_matrix:.1e}, bias {proof.bias:.1e}, inverse dynamics "
        f"{proof.inverse_dynamics:.1e}, tool {proof.tool:.1e} (limit {importing.LIMIT:g})"
    )
    looks = "with its looks" if "scene.xml" in files else "without looks: films draw its links as capsules"
    say(f"written: {place}, {looks}")
    remarks = arm_facts(place / f"{arm.name}.xml").remarks
    for text in remarks:
        say(text)
    say(f"to run it: plant: {{model: {place / arm.name}.xml}}")
    tell(
        directory=place,
        files=sorted(files),
        joints=arm.joints,
        findings=[part._asdict() for part in arm.findings],
        proof=proof._asdict(),
        remarks=remarks,
    )
    return 0


def _show(findings: Sequence[Part]) -> None:
    """Print the table of what became of the parts of a file, narrow enough to stay one."""
    tell(findings=[part._asdict() for part in findings])
    colour, limit = {"kept": good, "refused": bad}, width()
    others = len("refused") + max(len(part.what) for part in findings) + LEAST + 4 * 2
    room = 48 if limit is None else max(12, min(48, limit - others))
    rows = [
        [colour.get(part.verdict, str)(part.verdict), part.what, _names(part.places, room), part.reason]
        for part in findings
    ]
    say(table(["", "what", "in the file", "why"], rows, left=4, prose=True), fold=False)


def _names(names: Sequence[str], room: int) -> str:
    """Return the first of some names, and how many more there are, in so much room; at least one, cut if need be."""
    for count in range(len(names), 0, -1):
        more = f" +{len(names) - count}" if count < len(names) else ""
        text = ", ".join(names[:count])
        if len(text + more) <= room:
            return text + more
        if count == 1:
            return text[: room - len(more) - 3] + "..." + more
    return ""


def _line(file: Path, out: Path | None, options: Any, without_limit: Sequence[str] = ()) -> str:
    """Return the command line that imports an arm so, with N for the torque limits that are still to be given."""
    words = ["torquebench", "import", str(file)]
    for flag, value in (("--base", options.base), ("--tip", options.tip), ("--tool", options.tool)):
        words += [flag, value] if value else []
    words += ["--fix", ",".join(dict.fromkeys(options.fix))] if options.fix else []
    words += ["--drop", ",".join(dict.fromkeys(options.drop))] if options.drop else []
    limits = options.torque_limits
    pairs = limits.items() if isinstance(limits, dict) else ()
    numbers = [f"{n}={x:g}" for n, x in pairs] or [f"{x:g}" for x in limits or ()]
    numbers += [f"{name}=N" for name in without_limit]
    words += ["--torque-limits", ",".join(numbers)] if numbers else []
    words += ["--out", str(out)] if out else []
    return shlex.join(words)
