"""Importing a published arm: any MJCF or URDF file made into the plain chain of hinges and slides that a law drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.importing.chain import Chain, Options, body_name, find_chain, home_of
from torquebench.robot.importing.findings import VERDICTS, Part, RefusedArmError
from torquebench.robot.importing.forces import forces_of
from torquebench.robot.importing.plain import tool_of, write
from torquebench.robot.importing.proof import LIMIT, STATES, Proof, prove
from torquebench.robot.importing.source import MESHES, Source, listening, read
from torquebench.robot.library import plain_name
from torquebench.robot.mjcf_links import joint_name
from torquebench.robot.mjcf_text import wrong_numbers

__all__ = [
    "LIMIT",
    "STATES",
    "ImportedArm",
    "Options",
    "Part",
    "Proof",
    "RefusedArmError",
    "UnprovedArmError",
    "import_arm",
    "with_flags",
]


class UnprovedArmError(ModelError):
    """A flattened arm is not the published one."""

    def __init__(self, path: Path, proof: Proof) -> None:
        super().__init__(f"{path}: the flattened arm differs by {proof.worst:.1e} of its size, limit {LIMIT:g}")


@dataclass(frozen=True)
class ImportedArm:
    """A published arm as a plain chain, proved to be the same arm."""

    name: str
    mjcf: str
    """An MJCF file that stands alone, with the keyframe ``home``; damping, frictionloss and range are its joints'."""
    joints: tuple[str, ...]
    home: Array
    """Position of the keyframe, (n,) [rad or m]."""
    findings: tuple[Part, ...]
    proof: Proof
    source: Source
    chain: Chain
    options: Options


def import_arm(path: Path, options: Options = Options()) -> ImportedArm:  # noqa: B008  frozen
    """Make a published arm into a plain chain, and prove in plain MuJoCo that it is the same arm.

    Mass matrix, bias, inverse dynamics and tool are compared with the published file at 100 random states, damping,
    friction and constraints being off in both; they must agree to 1e-12 of their size.

    Args:
        path: An MJCF or URDF file.
        options: What is welded or left out, and what the file does not say.

    Raises:
        RefusedArmError: the arm is no chain of hinges and slides, or has forces or torque limits that need an option;
            says all of it at once, and carries what else was found.
        ModelError: the file cannot be read or compiled.
        UnprovedArmError: the chain is not the same arm.
    """
    if wrong := wrong_numbers(path):
        raise ModelError.of_file(str(path), wrong)
    source = read(path, "impossible-inertia" in options.drop)
    m = source.model
    home, said = home_of(m)
    chain, refused = find_chain(m, options, home), list[Part]()
    while found := [part for part in chain.findings if part.verdict == "refused" and part not in refused]:
        # what else is in the way is told of the chain that the flags of these would leave
        refused += found
        chain = find_chain(m, with_flags(options, [word for part in refused for word in part.flags]), home)
        if not chain.joints:  # such flags are no cure
            raise RefusedArmError(path, [part._replace(flags=()) for part in refused])
    if any(part.verdict == "refused" for part in chain.findings):
        raise RefusedArmError(path, refused)
    chain.findings.extend(refused)
    forces = forces_of(chain, options, source.speeds)
    name = plain_name(options.name or path.stem)
    _tell(chain, source, home, said, not refused)
    text = write(chain, forces, options, name, path.name)
    if any(part.verdict == "refused" for part in chain.findings):
        raise RefusedArmError(path, _sorted(chain.findings))
    try:
        with listening([]):
            plain = mujoco.MjModel.from_xml_string(text)
            proof = prove(chain, plain, forces.gravity, lambda d: tool_of(chain, d, options)[0])
    except ValueError as error:
        raise ModelError(f"{path}: what is left does not compile: {' '.join(str(error).split())}") from error
    if not proof.holds:
        raise UnprovedArmError(path, proof)
    joints = tuple(joint_name(m, j) for j in chain.joints)
    return ImportedArm(
        name, text, joints, home[chain.places].copy(), _sorted(chain.findings), proof, source, chain, options
    )


def with_flags(options: Options, flags: Sequence[str]) -> Options:
    """Return options with flags of ``torquebench import`` added.

    Args:
        options: The options.
        flags: As `RefusedArmError.flags`.
    """
    for flag, value in zip(flags[::2], flags[1::2], strict=True):
        if flag == "--tip":
            options = replace(options, tip=value)
        elif flag == "--fix":
            options = replace(options, fix=(*options.fix, *value.split(",")))
        else:
            options = replace(options, drop=(*options.drop, value))
    return options


def _sorted(findings: list[Part]) -> tuple[Part, ...]:
    return tuple(sorted(findings, key=lambda part: VERDICTS.index(part.verdict)))


def _tell(chain: Chain, source: Source, home: Array, said: str, asked: bool) -> None:
    """Add to a chain's findings what becomes of joints, bodies, looks and contacts.

    Args:
        chain: The chain.
        source: The published file.
        home: The ``qpos`` at which joints are welded, (nq,).
        said: Its name.
        asked: Whether what is welded or left out was asked for, instead of being what refusals propose.
    """
    m, first = chain.model, list[Part]()
    names = tuple(joint_name(m, j) for j in chain.joints)
    slides = sum(bool(m.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE) for j in chain.joints)
    counts = (len(names) - slides, "hinge"), (slides, "slide")
    kinds = [f"{count} {kind}{'s' * (count > 1)}" for count, kind in counts if count]
    first.append(Part("kept", " and ".join(kinds), names, "the law drives them"))
    first.append(Part("kept", "home", (said,), "keyframe home, where a run can begin"))
    low, high = m.jnt_range[list(chain.joints)].T
    inside = (low < home[chain.places]) & (home[chain.places] < high) | (m.jnt_limited[list(chain.joints)] == 0)
    if not inside.all():
        edge = tuple(name for name, is_inside in zip(names, inside, strict=True) if not is_inside)
        first.append(
            Part("kept", "home", edge, "at an end of its range, or beyond: a run that begins there may leave it")
        )
    if chain.fixed:
        first.append(
            Part(
                "mapped",
                "joints",
                tuple(joint_name(m, j) for j in chain.fixed),
                f"{'welded' if asked else 'would be welded'} at home",
            )
        )
    if chain.removed:
        heaviest = sorted(chain.removed, key=lambda b: (-m.body_mass[b], b))
        mass = f"{sum(m.body_mass[b] for b in heaviest):.3g} kg"
        bodies = tuple(body_name(m, b) for b in heaviest)
        text = f"left out with their mass, {mass}" if asked else f"would be left out, {mass}"
        first.append(Part("dropped", "bodies", bodies, text))
    if source.guessed:
        text = "no mass: their inertia is not stated, and a URDF's collision shapes weigh nothing"
        first.append(Part("mapped", "links without inertia", source.guessed, text))
    if source.missing:
        names = tuple(dict.fromkeys(name.rpartition("/")[2] for name in source.missing))
        text = f"not there, or not of a kind that MuJoCo reads: {', '.join(MESHES)}; they only look"
        first.append(Part("dropped", "mesh files", names, text))
    if source.balanced:
        text = "no body has their moments: each is their mean, so that the arm moves a little differently"
        first.append(Part("mapped", "impossible inertia", source.balanced, text))
    if source.warnings:
        first.append(Part("dropped", "what MuJoCo warns of", source.warnings, "said when it read the file"))
    if source.touching:
        count = f"{source.touching} shape{'s' * (source.touching > 1)}"
        first.append(Part("dropped", "contacts", (count,), "links touch nothing here"))
    chain.findings[:0] = first
