"""Reading a published arm with MuJoCo's own parser: MJCF or URDF, meshes that only look left out."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from torquebench.errors import ModelError

MESHES = (".obj", ".stl", ".msh", ".ply")
"""Endings of the mesh files that MuJoCo reads."""
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


def read(path: Path) -> Source:
    """Read a published arm.

    Args:
        path: An MJCF or URDF file, with what it includes beside it.

    Raises:
        ModelError: it cannot be read, names a plugin, has a mass that comes from a mesh that is not there, or MuJoCo
            does not compile it.
    """
    spec, urdf = parse(path)
    try:
        guessed = _massless(spec) if urdf else ()
        missing = _strip(spec, path)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error
    return Source(path, urdf, model, missing, guessed)


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
            # of several <mujoco> elements MuJoCo reads the first
            look = '<mujoco><compiler discardvisual="false" fusestatic="false" strippath="false"/></mujoco>'
            bare = re.sub(r"<mujoco\b.*?</mujoco\s*>", "", text[root.end() :], flags=re.DOTALL)
            spec = mujoco.MjSpec.from_string(text[: root.end()] + look + bare)
        else:
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"{path}: MuJoCo does not read it: {' '.join(str(error).split())}") from error
    if list(spec.plugins) or spec.hasImplicitPluginElem:
        raise ModelError(f"{path}: names a plugin: no code is run for a model")
    if list(spec.flexes):
        raise ModelError(f"{path}: has flexible bodies, wanted an arm of rigid links")
    spec.compiler.discardvisual, spec.compiler.fusestatic = False, False
    return spec, urdf


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
