"""The looks of an imported arm: its published shapes and meshes on the plain chain, as ``scene.xml`` and mesh files."""

from __future__ import annotations

import re
import struct
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from torquebench.kernel import Array
from torquebench.robot.importing.chain import Chain
from torquebench.robot.importing.plain import clean, text_of, to_text
from torquebench.robot.importing.source import MESHES, listening, mesh_file, parse
from torquebench.robot.library import LOOKS

VISIBLE_GROUPS = 2
MOST_FACES = 200_000
"""An STL file that MuJoCo reads has no more."""
_KIND = mujoco.mjtGeom
_NAMES = {
    int(_KIND.mjGEOM_SPHERE): ("sphere", 1),
    int(_KIND.mjGEOM_CAPSULE): ("capsule", 2),
    int(_KIND.mjGEOM_ELLIPSOID): ("ellipsoid", 3),
    int(_KIND.mjGEOM_CYLINDER): ("cylinder", 2),
    int(_KIND.mjGEOM_BOX): ("box", 3),
    int(_KIND.mjGEOM_MESH): ("mesh", 0),
}
"""Kind of a shape that can be drawn -> its name, and how many numbers its size has."""
_UNSET = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)


def pictures(path: Path, chain: Chain, mjcf: str) -> dict[str, bytes]:
    """Return the files that show a chain as the published file does: ``scene.xml`` and ``meshes/*.stl``.

    Args:
        path: The published file.
        chain: The chain.
        mjcf: Its own file.

    Raises:
        ValueError: MuJoCo cannot make the looks.
    """
    with listening([]):
        m = _looks(path)
    d = mujoco.MjData(m)
    d.qpos[:] = chain.home
    d.qpos[chain.places] = 0.0
    mujoco.mj_kinematics(m, d)
    shown = _shown(m, chain)
    root = ElementTree.fromstring(mjcf)
    if not shown:
        return {}
    root.set("model", f"{root.get('model')}-scene")
    option = root.find("option")
    assets, world = ElementTree.Element("asset"), root.find("worldbody")
    if option is None or world is None:
        return {}
    root.insert(list(root).index(option) + 1, assets)
    compiler = root.find("compiler")
    if compiler is not None:
        compiler.set("meshdir", "meshes")
    links = list(dict.fromkeys(int(chain.model.jnt_bodyid[j]) for j in chain.joints))
    elements = dict(zip(links, world.iter("body"), strict=True)) | {0: world}
    files: dict[str, bytes] = {}
    meshes: dict[int, str] = {}
    for g in shown:
        link = chain.link(int(m.geom_bodyid[g]))
        R, p = d.xmat[link].reshape(3, 3), d.xpos[link]
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, (R.T @ d.geom_xmat[g].reshape(3, 3)).ravel())
        name, count = _NAMES[int(m.geom_type[g])]
        geom = ElementTree.SubElement(elements[link], "geom", type=name)
        if name == "mesh":
            mesh = int(m.geom_dataid[g])
            if mesh not in meshes:
                meshes[mesh] = _mesh_name(m, mesh, meshes.values())
                files[f"meshes/{meshes[mesh]}.stl"] = stl(m, mesh)
                ElementTree.SubElement(assets, "mesh", name=meshes[mesh], file=f"{meshes[mesh]}.stl", inertia="shell")
            geom.set("mesh", meshes[mesh])
        else:
            geom.set("size", text_of(m.geom_size[g, :count]))
        geom.set("pos", text_of(clean(R.T @ (d.geom_xpos[g] - p))))
        geom.set("quat", text_of(clean(turn)))
        geom.set("rgba", " ".join(f"{x:.4g}" for x in _colour(m, g)))
        for key, value in (("contype", "0"), ("conaffinity", "0"), ("mass", "0"), ("group", "2")):
            geom.set(key, value)
    return {
        "scene.xml": to_text(root, f"{LOOKS.removeprefix('<!-- ')}{path.name}; for pictures only.").encode()
    } | files


def _looks(path: Path) -> Any:
    """Return the published file compiled with the shapes and meshes that are there; its masses mean nothing."""
    spec, _ = parse(path)
    for element in (*spec.sensors, *spec.pairs, *spec.skins, *spec.keys, *spec.hfields):
        spec.delete(element)
    readable = {}
    for mesh in spec.meshes:
        name = mesh.name or Path(str(mesh.file)).stem
        file = mesh_file(spec, mesh, path) if mesh.file else None
        readable[name] = not mesh.file or (file is not None and file.suffix.lower() in MESHES)
        if file is not None:
            mesh.file = str(file)
    if readable and not any(readable.values()):  # what else it has are odd pieces of an arm
        raise ValueError("none of its mesh files is there and of a kind that MuJoCo reads")
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.compiler.settotalmass = -1
    for body in spec.bodies[1:]:
        body.explicitinertial, body.mass, body.inertia, body.ipos = True, 1.0, np.ones(3), np.zeros(3)
        body.fullinertia = [np.nan, 0, 0, 0, 0, 0]
    used = set[str]()
    for body in spec.bodies:
        for geom in list(body.geoms):
            unseen = geom.group > VISIBLE_GROUPS or geom.type == _KIND.mjGEOM_HFIELD
            if unseen or (geom.meshname and not readable.get(geom.meshname, False)):
                spec.delete(geom)
            elif geom.meshname:
                used.add(geom.meshname)
    for mesh in list(spec.meshes):
        if (mesh.name or Path(str(mesh.file)).stem) not in used:
            spec.delete(mesh)
        else:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    lost = set[str]()
    for texture in list(spec.textures):
        files = [texture.file, *(texture.cubefiles or ())]
        folder = path.resolve().parent / str(spec.texturedir or "")
        if any(file and not (folder / str(file)).is_file() for file in files):
            lost.add(texture.name or Path(str(texture.file)).stem)
            spec.delete(texture)
        elif texture.file:
            texture.file = str(folder / str(texture.file))
    for material in spec.materials:
        material.textures = ["" if name in lost else name for name in material.textures]
    spec.meshdir = spec.texturedir = ""
    return spec.compile()


def _shown(m: Any, chain: Chain) -> list[int]:
    """Return the shapes that are looks: of each link those that touch nothing, where it has some, else all."""
    visible = [
        g
        for g in range(m.ngeom)
        if int(m.geom_type[g]) in _NAMES
        and m.geom_group[g] <= VISIBLE_GROUPS
        and int(m.geom_bodyid[g]) not in chain.removed
        and int(m.geom_bodyid[g]) != 0
        and _colour(m, g)[3] > 0
        and (m.geom_type[g] != _KIND.mjGEOM_MESH or m.mesh_facenum[m.geom_dataid[g]] <= MOST_FACES)
    ]
    links = {g: chain.link(int(m.geom_bodyid[g])) for g in visible}
    looks = {g for g in visible if not m.geom_contype[g] and not m.geom_conaffinity[g]}
    has_looks = {links[g] for g in looks}
    return [g for g in visible if g in looks or links[g] not in has_looks]


def _colour(m: Any, geom: int) -> Array:
    """Return a shape's colour (4,), a texture's being its mean."""
    own, material = m.geom_rgba[geom], int(m.geom_matid[geom])
    if material < 0 or not np.array_equal(own, _UNSET):
        return np.array(own)
    rgba: Array = np.array(m.mat_rgba[material], dtype=np.float64)
    texture = int(m.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
    if texture >= 0:
        size = int(m.tex_width[texture] * m.tex_height[texture] * m.tex_nchannel[texture])
        pixels = m.tex_data[m.tex_adr[texture] : m.tex_adr[texture] + size].reshape(-1, m.tex_nchannel[texture])
        if pixels.shape[1] >= 3:
            rgba[:3] *= pixels[:, :3].mean(axis=0) / 255.0
    return rgba


def _mesh_name(m: Any, mesh: int, taken: Any) -> str:
    name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_MESH, mesh) or f"mesh{mesh}"
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-") or f"mesh{mesh}"
    while name in taken:
        name += "_"
    return name


def stl(m: Any, mesh: int) -> bytes:
    """Return a compiled mesh as a binary STL file.

    Args:
        m: The compiled model.
        mesh: The mesh's number.
    """
    faces = m.mesh_face[m.mesh_faceadr[mesh] :][: m.mesh_facenum[mesh]]
    corners = m.mesh_vert[m.mesh_vertadr[mesh] :][faces].astype("<f4")
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("flags", "<u2")])
    records["normal"], records["corners"] = normal, corners
    return b"torquebench".ljust(80, b"\0") + struct.pack("<I", len(faces)) + records.tobytes()
