"""An imported arm as a folder, like those of ``models/``: its file, its looks, and a page of where it is from."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

import mujoco

from torquebench.errors import ModelError
from torquebench.robot.importing import ImportedArm, UnprovedArmError
from torquebench.robot.importing.pictures import pictures
from torquebench.robot.importing.plain import tool_of
from torquebench.robot.importing.proof import LIMIT, STATES, Proof, prove
from torquebench.robot.importing.source import listening

IMPORTED = "Imported from `"
"""Beginning of the second paragraph of an arm's README, which marks a folder that an import wrote."""


def obstacle(out: Path, replace: bool) -> str:
    """Return why an arm cannot be written to a folder; nothing where it can.

    Args:
        out: The folder.
        replace: Whether an arm that was imported there before may be replaced, if the folder has nothing else.
    """
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return ""
    page = out / "README.md"
    text = page.read_text(encoding="utf-8", errors="replace") if page.is_file() and not out.is_symlink() else ""
    name = text.partition("\n")[0].removeprefix("# ")
    if not text.startswith(f"# {name}\n\n{IMPORTED}"):
        return f"{out} is not empty: give another folder with --out; nothing in it says that an import wrote it"
    if not replace:
        return f"{out} is not empty: --force replaces the arm imported there, --out DIR keeps it"
    own = {"README.md", "scene.xml", f"{name}.xml"} | ({"meshes"} if "| `meshes/` |" in text else set())
    others = sorted(path.name for path in out.iterdir() if path.name not in own)
    return f"{out} has what no import wrote: {', '.join(others)}; move it, or give another folder" if others else ""


def write_folder(arm: ImportedArm, out: Path, command: str, replace: bool = False) -> dict[str, int]:
    """Write an arm's folder, whole or not at all, and return its files with their sizes.

    Args:
        arm: The arm.
        out: The folder; it must not be there, or be empty.
        command: The command that imports the arm again, for its README.
        replace: Whether an arm that was imported there before is replaced.

    Raises:
        ModelError: the folder is not empty, and not to be replaced.
        UnprovedArmError: the arm differs from the published file as MuJoCo reads it.
        OSError: it cannot be written.
    """
    if why := obstacle(out, replace):
        raise ModelError(why)
    whole = proof_of_file(arm)
    looks, why = dict[str, bytes](), ""
    try:
        looks = pictures(arm.source.path, arm.chain, arm.mjcf)
    except (ValueError, mujoco.FatalError) as error:
        why = " ".join(str(error).split())
    files = {f"{arm.name}.xml": arm.mjcf.encode(), **looks}
    files["README.md"] = page(arm, whole, command, sorted(files), why).encode()
    out.parent.mkdir(parents=True, exist_ok=True)
    unfinished = out.with_name(f".{out.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    for name, content in files.items():
        (unfinished / name).parent.mkdir(parents=True, exist_ok=True)
        (unfinished / name).write_bytes(content)
    if out.is_dir() and any(out.iterdir()):
        old = out.with_name(f".{out.name}.replaced")
        shutil.rmtree(old, ignore_errors=True)
        os.replace(out, old)
        try:
            os.replace(unfinished, out)
        except OSError:
            os.replace(old, out)
            raise
        shutil.rmtree(old)
    else:
        os.replace(unfinished, out)
    return {name: len(content) for name, content in files.items()}


def proof_of_file(arm: ImportedArm) -> Proof | None:
    """Return how an arm differs from its published file as MuJoCo reads it, meshes and all.

    None where MuJoCo alone does not read it as it is meant: mesh files are missing, links have no inertia, or a URDF's
    welded links are one body there.

    Raises:
        UnprovedArmError: they are not the same arm.
    """
    read, chain = arm.source.model, arm.chain
    try:
        with listening([]):
            m = mujoco.MjModel.from_xml_path(str(arm.source.path))
    except (ValueError, mujoco.FatalError):
        return None
    same = all(getattr(m, size) == getattr(read, size) for size in ("nbody", "njnt", "nq", "nv"))
    if not same or arm.source.guessed or arm.source.healed:
        return None
    plain = mujoco.MjModel.from_xml_string(arm.mjcf)
    with listening([]):
        proof = prove(
            dataclasses.replace(chain, model=m), plain, plain.opt.gravity, lambda d: tool_of(chain, d, arm.options)[0]
        )
    if not proof.holds:
        raise UnprovedArmError(arm.source.path, proof)
    return proof


def page(arm: ImportedArm, whole: Proof | None, command: str, files: Iterable[str], no_pictures: str) -> str:
    """Return the text of an arm's README.

    Args:
        arm: The arm.
        whole: How it differs from the published file as MuJoCo reads it, if that is known.
        command: The command that imports it again.
        files: The other files of the folder.
        no_pictures: Why there are no looks; empty where there are.
    """
    path, proof = arm.source.path, whole or arm.proof
    against = path.name if whole else f"{path.name}, read without what only looks"
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    told = {f"{arm.name}.xml": "the plain chain: bodies, inertias, joints, motors, keyframe `home`"}
    told["scene.xml"] = "that chain with the published looks, for pictures"
    lines = [
        f"# {arm.name}",
        "",
        f"{IMPORTED}{path.name}` (SHA-256 {digest}); licence and origin are those of that file.",
        "",
        f"    {command}",
        "",
        "| file | what |",
        "|---|---|",
        *(f"| `{name}` | {told[name]} |" for name in files if name in told),
        *(["| `meshes/` | the shapes of `scene.xml` |"] if any(name.startswith("meshes/") for name in files) else []),
        "",
        "## What became of the published file",
        "",
        "| | what | in the file | why |",
        "|---|---|---|---|",
        *(
            f"| {part.verdict} | {_cell(part.what)} | {_cell(', '.join(part.places))} | {_cell(part.reason)} |"
            for part in arm.findings
        ),
        *([f"| dropped | pictures | | {_cell(no_pictures)} |"] if no_pictures else []),
        "",
        "## Proof",
        "",
        f"Against {against}, in plain MuJoCo at {STATES} random states, damping, friction and constraints off in both;",
        f"largest relative difference, limit {LIMIT:g}:",
        "",
        "| mass matrix | bias | inverse dynamics | place of the tool |",
        "|---|---|---|---|",
        "| " + " | ".join(f"{x:.1e}" for x in proof) + " |",
    ]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
