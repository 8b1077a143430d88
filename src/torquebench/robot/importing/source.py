"""Reading a published arm with MuJoCo's own parser: MJCF or URDF, meshes that only look left out."""

from __future__ import annotations

import contextlib
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from torquebench.errors import ModelError, Problem
from torquebench.kernel import Array
from torquebench.robot.mjcf_text import urdf_speeds

MESHES = (".obj", ".stl", ".msh", ".ply")
"""Endings of the mesh files that MuJoCo reads."""
_LEAST = 1e-14
"""Smallest mass and inertia that MuJoCo takes for a moving body."""
_ROOT = re.compile(r"<\s*(mujoco|robot|mujocoinclude)\b[^>]*?(/?)>")


@dataclass(frozen=True)
class Source:
    """A published arm as MuJoCo reads it."""

    path: Path
    urdf: bool
    model: Any
    """Compiled without what only looks: ``MjModel``."""
    missing: tuple[str, ...]
    """Mesh files that are not there, or of a kind MuJoCo does not read; they only look."""
    guessed: tuple[str, ...]
    """Links of a URDF that state no inertia: they have none here, where MuJoCo takes it from their collision shapes."""
    warnings: tuple[str, ...]
    """What MuJoCo said when it read the file."""
    touching: int
    """How many shapes could touch others."""
    healed: bool
    """Whether some links have no inertia, or one that no body has alone."""
    balanced: tuple[str, ...]
    """Bodies whose moments no body has, which are given their mean."""
    speeds: Mapping[str, float]
    """Greatest speed of each joint of a URDF that states one above zero, which MuJoCo does not read [rad/s]."""


def read(path: Path, balance: bool = False) -> Source:
    """Read a published arm.

    Args:
        path: An MJCF or URDF file, with what it includes beside it.
        balance: Whether a body whose moments no body has gets their mean, as of MuJoCo's ``balanceinertia``.

    Raises:
        ModelError: it cannot be read, names a plugin, has a mass that comes from a mesh that is not there, or MuJoCo
            does not compile it.
    """
    said = list[str]()
    with listening(said):
        spec, urdf = parse(path)
        try:
            guessed = _massless(spec) if urdf else ()
            touching = sum(bool(geom.contype or geom.conaffinity) for geom in spec.geoms)
            missing = _strip(spec, path)
            spec.compiler.balanceinertia = bool(spec.compiler.balanceinertia or balance)
            healed, balanced = _heal(spec)
            model = spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise _unread(path, "MuJoCo does not compile it", error) from error
    for body, mass, inertia in healed:
        model.body_mass[body.id], model.body_inertia[body.id] = mass, inertia
    speeds = urdf_speeds(path.read_text(encoding="utf-8-sig")) if urdf else {}
    told = tuple(dict.fromkeys(said))
    return Source(path, urdf, model, missing, guessed, told, touching, bool(healed), balanced, speeds)


@contextlib.contextmanager
def listening(said: list[str]) -> Iterator[None]:
    """Gather MuJoCo's warnings in a list, where it would write them to the terminal and to a file.

    Args:
        said: They are added to it.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: said.append(" ".join(str(text).split())))
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
        said += [" ".join(str(warning.message).split()) for warning in caught]
    finally:
        mujoco.set_mju_user_warning(before)


def parse(path: Path) -> tuple[Any, bool]:
    """Return the ``MjSpec`` of a file, its meshes not yet read, and whether the file is a URDF.

    Bodies that a URDF welds together are kept apart, so that they can be named, and its visual shapes are read.

    Raises:
        ModelError: it cannot be read or parsed, or names a plugin.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: cannot be read ({error})") from error
    root = _ROOT.search(text)
    urdf = root is not None and root[1] == "robot"
    try:
        if urdf and root is not None and not root[2]:
            spec = mujoco.MjSpec.from_string(text[: root.end()] + _with_looks(text[root.end() :]))
        else:
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise _unread(path, "MuJoCo does not read it", error) from error
    if list(spec.plugins) or spec.hasImplicitPluginElem:
        raise ModelError(f"{path}: names a plugin: no code is run for a model")
    if list(spec.flexes):
        raise ModelError(f"{path}: has flexible bodies, wanted an arm of rigid links")
    spec.compiler.discardvisual, spec.compiler.fusestatic = False, False
    return spec, urdf


def _unread(path: Path, what: str, error: Exception) -> ModelError:
    """Return MuJoCo's mistake in a file, at the line that it names; in a file that includes others it may be theirs."""
    text = " ".join(str(error).split())
    line = re.search(r",? *line (?:number=)?(\d+)", text, re.IGNORECASE)
    if line is None or "<include" in path.read_text(encoding="utf-8-sig"):
        return ModelError.of_file(str(path), [f"{what}: {text}"])
    told = text.replace(line[0], "")
    return ModelError.of_file(str(path), [Problem(text=f"{what}: {told}", line=int(line[1]))])


def _with_looks(urdf: str) -> str:
    """Return what follows a URDF's first tag, with MuJoCo's settings changed so that links and looks stay apart."""
    block = re.search(r"<mujoco\b.*?</mujoco\s*>", urdf, flags=re.DOTALL)
    compiler = re.search(r"<compiler\b([^>]*?)/?>", block[0]) if block else None
    own = re.sub(r"\b(discardvisual|fusestatic|strippath)\s*=\s*([\"']).*?\2", "", compiler[1] if compiler else "")
    rest = urdf.replace(block[0], "") if block else urdf
    looks = f'<compiler {own} discardvisual="false" fusestatic="false" strippath="false"/>'
    return f"<mujoco>{looks}</mujoco>{rest}"


def mesh_file(spec: Any, mesh: Any, path: Path) -> Path | None:
    """Return the file of a mesh, None where it is not there; of ``package://name/rest`` the file above `path`.

    Args:
        spec: The ``MjSpec``.
        mesh: One of its meshes, which names a file.
        path: The file that the spec was read from.
    """
    name = str(mesh.file)
    folder = path.resolve().parent
    if "://" in name or name.startswith("package:/"):
        rest = Path(name.partition(":")[2].lstrip("/"))
        tails = (rest, Path(*rest.parts[1:]))
        found = [base / tail for tail in tails for base in (folder, *folder.parents)]
    else:
        found = [folder / str(spec.meshdir or "") / name, folder / name]
    return next((file for file in found if file.is_file()), None)


def _massless(spec: Any) -> tuple[str, ...]:
    """Take the mass that MuJoCo would guess from a URDF's links without inertia, and return their names."""
    found = []
    for body in spec.bodies[1:]:
        if not body.explicitinertial:
            geoms = list(body.geoms)
            if any(geom.density != 0 for geom in geoms):
                found.append(body.name)
            for geom in geoms:
                geom.density, geom.mass = 0.0, 0.0
    return tuple(found)


def weighs(spec: Any, body: Any, geom: Any) -> bool:
    """Return whether a body's inertia comes from a geom.

    Args:
        spec: The ``MjSpec``.
        body: The geom's body.
        geom: The geom.
    """
    stated = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE or (
        spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO and body.explicitinertial
    )
    low, high = spec.compiler.inertiagrouprange
    massless = geom.mass == 0 or (geom.density == 0 and not geom.mass > 0)
    return not (stated or massless or not low <= geom.group <= high)


def _heal(spec: Any) -> tuple[list[tuple[Any, float, Array]], tuple[str, ...]]:
    """Give bodies that MuJoCo would refuse an inertia that it takes.

    A link may have none, or one that no body has alone, where what is welded to it makes up for that.

    Returns:
        Such bodies, with the mass [kg] and the principal moments (3,) [kg m^2] that they have in truth; and the names
        of those that MuJoCo balances, as it is asked to.
    """
    compiler, healed, balanced = spec.compiler, list[tuple[Any, float, Array]](), list[str]()
    if compiler.boundmass > 0 or compiler.boundinertia > 0 or compiler.settotalmass > 0:
        return healed, ()  # MuJoCo changes them itself, as the file asks
    for body in spec.bodies[1:]:
        if any(weighs(spec, body, geom) for geom in body.geoms):
            continue
        mass, moments = (float(body.mass), np.array(body.inertia)) if body.explicitinertial else (0.0, np.zeros(3))
        full = np.array(body.fullinertia)
        directions = np.eye(3)
        if body.explicitinertial and not np.isnan(full[0]):
            xx, yy, zz, xy, xz, yz = full
            moments, directions = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
            directions[:, 2] *= np.sign(np.linalg.det(directions))
        low, middle, high = np.sort(moments)
        if mass > _LEAST and low > _LEAST and low + middle > high * (1.0 + 1e-9):
            continue
        if mass > _LEAST and low > _LEAST and compiler.balanceinertia:
            balanced.append(body.name or "a body without a name")
            continue
        if not np.isnan(full[0]):
            own, turn = np.zeros(4), np.zeros(4)
            mujoco.mju_mat2Quat(own, directions.ravel())
            mujoco.mju_mulQuat(turn, np.array(body.iquat), own)
            body.fullinertia = [np.nan, 0, 0, 0, 0, 0]
            body.iquat = turn
        if not body.explicitinertial:
            body.explicitinertial, body.ipos = True, np.zeros(3)
        body.mass, body.inertia = 1.0, np.ones(3)
        healed.append((body, mass, moments))
    return healed, tuple(balanced)


def _strip(spec: Any, path: Path) -> tuple[str, ...]:
    """Delete what only looks and needs files, and return the mesh files that are not there."""
    for element in (*spec.sensors, *spec.pairs, *spec.skins):
        spec.delete(element)
    needed, missing = set[str](), list[str]()
    for body in spec.bodies:
        for geom in list(body.geoms):
            geom.material = ""
            if geom.type == mujoco.mjtGeom.mjGEOM_HFIELD:
                spec.delete(geom)
            elif geom.meshname:
                if weighs(spec, body, geom):
                    needed.add(geom.meshname)
                else:
                    spec.delete(geom)
    for hfield in list(spec.hfields):
        spec.delete(hfield)
    for site in spec.sites:
        site.material = ""
    for tendon in spec.tendons:
        tendon.material = ""
    lost = []
    for mesh in list(spec.meshes):
        file = mesh_file(spec, mesh, path) if mesh.file else None
        readable = not mesh.file or (file is not None and file.suffix.lower() in MESHES)
        name = mesh.name or Path(str(mesh.file)).stem
        if not readable:
            missing.append(str(mesh.file))
        if name not in needed:
            spec.delete(mesh)
        elif readable and file is not None:
            mesh.file = str(file)
        else:
            lost.append(str(mesh.file))
    if lost:
        raise ModelError(
            f"{path}: the mass of some bodies comes from mesh files that are not there, or that MuJoCo does not read: "
            f"{', '.join(lost)}; give these bodies an <inertial>"
        )
    spec.meshdir = ""
    for material in list(spec.materials):
        spec.delete(material)
    for texture in list(spec.textures):
        spec.delete(texture)
    return tuple(missing)
