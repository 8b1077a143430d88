"""The text of an arm's file before anything is compiled: what only looks is left out, what a file may not ask is told.

Looks that need files are left out, as neither mass nor contact comes from them; a mesh from which they come, another
file, code and a wish for memory are reasons to refuse the file. All reasons are found at once.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple, TypeAlias
from xml.parsers import expat

from torquebench.errors import Problem
from torquebench.robot.library import MAX_BYTES

Element: TypeAlias = ElementTree.Element
_Found: TypeAlias = tuple[Element, str]
ROOTS = ("mujoco", "robot")
"""Names of the outermost element of MJCF and of URDF."""
MAX_MEMORY, MAX_COUNT, MAX_INCLUDES = 1 << 28, 100_000, 64
"""Bytes and counts that a file may ask for, and files that it may include."""
MAX_DEPTH = 200
"""Elements may be nested so deeply."""
LARGEST = {
    "width": 4096, "height": 4096, "nrow": 2048, "ncol": 2048, "size": 65536, "params": 1000, "nsample": 4096
}  # fmt: skip
"""Attribute -> the largest number that is read, where MuJoCo makes memory of it; of ``size`` in <numeric> alone."""
MOST_CLASSES = 1000
"""Default classes of a file; MuJoCo compares each with all others."""
CODE = {
    "plugin": "runs code of its own",
    "extension": "asks for code of its own",
    "flexcomp": "makes as many bodies as it likes",
    "composite": "makes as many bodies as it likes",
    "replicate": "makes as many bodies as it likes",
}
"""Elements that no file may have."""
FILES = ("include", "model", "attach")
"""Elements that stand for another file."""
LOOKS = ("mesh", "texture", "hfield")
"""Assets that only look where no geom with mass or contact uses them."""
_TEXT = ("name", "class", "childclass", "model", "joint", "body", "site", "file", "mesh", "texture", "material")
_NOT_NEGATIVE = ("mass", "density", "armature", "diaginertia", "damping", "frictionloss")
_UNREAD = ("custom", "size", "visual", "statistic")
"""Elements whose numbers move nothing."""


class ArmText(NamedTuple):
    """The text of an arm's file, fit to be compiled where there are no reasons against it."""

    text: str
    remarks: tuple[str, ...] = ()
    """What was left out."""
    reasons: tuple[Problem, ...] = ()
    """Why it is refused: place, element, and what to do."""
    compiles: bool = False
    """Whether it can be compiled without harm, be it only to find more reasons."""


def standing_alone(text: str) -> ArmText:
    """Return the text of an MJCF or URDF file without what only looks and needs files, and all reasons to refuse it."""
    if re.search(r"<!(DOCTYPE|ENTITY)", text):
        return _refused(text, "document types and entities are refused: write out what they stand for")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, LookupError) as error:  # LookupError: an encoding that there is not
        return _refused(text, f"not a readable MJCF file ({error})")
    if root.tag not in ROOTS:
        return _refused(text, f"<{root.tag}> is no arm: wanted MJCF, <mujoco>, or URDF, <robot>")
    if _depth(root) > MAX_DEPTH:
        return _refused(text, f"elements are nested more than {MAX_DEPTH} deep")
    reasons = _placed([*_greedy(root), *_numbers(root)], starts(root, text))
    needed: list[str] = []
    left_out = _without_visuals(root) if root.tag == "robot" else _without_looks(root, needed)
    remarks = [f"left out, as they only look: {listed(left_out)}"] if left_out else []
    if left_out or needed:
        text = ElementTree.tostring(root, encoding="unicode")
    problems = [*reasons, *(Problem(text=reason) for reason in needed)]
    return ArmText(text, tuple(remarks), tuple(dict.fromkeys(problems)), not reasons)


def _refused(text: str, reason: str) -> ArmText:
    return ArmText(text, reasons=(Problem(text=reason),))


def starts(root: Element, text: str) -> dict[Element, tuple[int, int]]:
    """Return line and column, from 1, of each element of a text that can be read.

    Args:
        root: The outermost element.
        text: What it was read from.
    """
    found, parser = list[tuple[int, int]](), expat.ParserCreate("utf-8")
    parser.StartElementHandler = lambda *_: found.append((parser.CurrentLineNumber, parser.CurrentColumnNumber + 1))
    parser.Parse(text.encode(), True)
    return dict(zip(root.iter(), found, strict=True))


def _placed(found: Iterable[_Found], places: Mapping[Element, tuple[int, int]], file: str = "") -> list[Problem]:
    """Return what is wrong with elements as mistakes at their places.

    Args:
        found: The elements, and what is wrong with them.
        places: Where elements are.
        file: The file; empty where it is that of the arm.
    """
    return [
        Problem(file, text=text, line=line, column=column)
        for element, text in found
        for line, column in [places[element]]
    ]


_TOLD = re.compile(r"<!-- torquebench: (.*?) -->\n")


def with_remarks(text: str, remarks: Sequence[str]) -> str:
    """Return the text of an arm's file that begins with what was left out of it, so that a copy of it says so too.

    Args:
        text: The text; what it begins with already is not written again.
        remarks: What was left out.
    """
    told = "" if remarks_in(text) else "".join(f"<!-- torquebench: {one} -->\n" for one in map(_uncommented, remarks))
    return told + text


def remarks_in(text: str) -> tuple[str, ...]:
    """Return what the text of an arm's file begins with that `with_remarks` wrote."""
    found, at = [], 0
    while match := _TOLD.match(text, at):
        found.append(match[1].replace("- -", "--"))
        at = match.end()
    return tuple(found)


def _uncommented(remark: str) -> str:
    return " ".join(remark.replace("--", "- -").split())


def named(element: Element) -> str:
    """Return an element as it is called in messages: its tag, with its name or file where it has one."""
    for key in ("name", "file", "joint", "class"):
        if key in element.attrib:
            return f'<{element.tag} {key}="{element.attrib[key][:60]}">'
    return f"<{element.tag}>"


def _depth(root: Element) -> int:
    depth, level = 0, [root]
    while level:
        depth, level = depth + 1, [child for element in level for child in element]
    return depth


def listed(names: Sequence[str], most: int = 4) -> str:
    """Return the first of some names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _greedy(root: Element) -> Iterator[_Found]:
    """Yield what asks for other files, code or memory; of a URDF MuJoCo reads such things in its own element alone."""
    parts = root.findall("mujoco") if root.tag == "robot" else [root]
    for extra in [inner for part in parts for inner in part.iter("default")][MOST_CLASSES:][:1]:
        yield extra, f"{named(extra)} is refused: at most {MOST_CLASSES} default classes are read"
    for element in (inner for part in parts for inner in part.iter()):
        if element.tag in CODE:
            yield element, f"{named(element)} is refused: it {CODE[element.tag]}"
        elif element.tag in FILES:
            yield element, f"{named(element)} is refused: a model must stand alone; put in what it stands for"
        elif "file" in element.attrib and element.tag not in (*LOOKS, "skin"):
            yield element, f"{named(element)} is refused: a model must stand alone"
        for key, value in element.attrib.items() if element.tag == "size" else ():
            if not _bytes(value) <= (MAX_MEMORY if key == "memory" else MAX_COUNT):
                text = f'<size {key}="{value}"> is refused: it asks for more memory than any arm needs; leave it out'
                yield element, text
        for key, most in LARGEST.items():
            if key in element.attrib and (key != "size" or element.tag == "numeric"):
                too_large = [x for x in _floats(element.attrib[key]) if not x <= most]
                if too_large and element.tag != "geom":
                    yield element, f'{named(element)} is refused: {key}="{element.attrib[key]}", at most {most} is read'


def _numbers(root: Element) -> Iterator[_Found]:
    """Yield numbers that MuJoCo's compiler lets pass although no simulation can use them."""
    skipped = {inner for element in root if element.tag in _UNREAD for inner in element.iter()}
    for element in root.iter():
        for key, value in element.attrib.items() if element not in skipped else ():
            numbers = [] if key in _TEXT else _floats(value)
            if not all(map(math.isfinite, numbers)) or (key in _NOT_NEGATIVE and any(x < 0 for x in numbers)):
                # it turns a negative mass into zero without a word
                yield element, f'<{element.tag} {key}="{value}"> is negative or not finite'


def _floats(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []


def _bytes(text: str) -> float:
    """Return a number, with a unit such as M for 2^20 if it has one; infinity for what is none."""
    found = re.fullmatch(r"\s*([0-9.]+)\s*([KMGTPE]?)\s*", text)
    return float(found[1]) * 1024.0 ** " KMGTPE".index(found[2] or " ") if found else math.inf


def refused_inside(path: Path) -> list[Problem]:
    """Return what must not even be parsed by MuJoCo, in a file and in those that it includes: code, memory, far files.

    Args:
        path: The file; what it includes is at or below its folder.
    """
    folder, reasons = path.resolve().parent, list[Problem]()
    for file, source in _with_included(path, folder):
        if not file.is_relative_to(folder) or not file.is_file() or file.stat().st_size > MAX_BYTES:
            text = f"it includes {file}: wanted a file of at most {MAX_BYTES >> 20} MiB at or below {folder}"
            reasons.append(Problem(text=text))
            continue
        try:
            root = ElementTree.fromstring(text := file.read_text(encoding="utf-8-sig"))
        except (OSError, ValueError, LookupError, ElementTree.ParseError) as error:
            reasons.append(Problem(source, text=f"is not readable ({error})"))
            continue
        whole = ["document types and entities are refused"] * ("<!DOCTYPE" in text or "<!ENTITY" in text)
        whole += ["elements are nested too deeply"] * (_depth(root) > MAX_DEPTH)
        reasons += [Problem(source, text=reason) for reason in whole]
        found = [(element, why) for element, why in (*_greedy(root), *_numbers(root)) if element.tag != "include"]
        reasons += _placed(found, starts(root, text), source)
    return reasons


def wrong_numbers(path: Path) -> list[Problem]:
    """Return numbers that MuJoCo's compiler lets pass although no simulation can use them, as far as they can be read.

    Args:
        path: The file; what it includes may be anywhere.
    """
    return [problem for root, places, source in _readable(path) for problem in _placed(_numbers(root), places, source)]


def named_places(path: Path) -> dict[str, list[Problem]]:
    """Return the elements of a file, and of those that it includes, by their names: text is the tag, with a place.

    Args:
        path: The file; one that cannot be read has none.
    """
    found = dict[str, list[Problem]]()
    for root, places, source in _readable(path):
        for element in root.iter():
            if name := element.get("name"):
                found.setdefault(name, []).extend(_placed([(element, element.tag)], places, source))
    return found


def _readable(path: Path) -> Iterator[tuple[Element, dict[Element, tuple[int, int]], str]]:
    """Yield root, places of the elements, and name of a file and of those that it includes, as far as XML goes."""
    for file, source in _with_included(path):
        try:
            root = ElementTree.fromstring(text := file.read_text(encoding="utf-8-sig"))
        except (OSError, ValueError, LookupError, ElementTree.ParseError):
            continue
        yield root, starts(root, text), source


def _with_included(path: Path, folder: Path | None = None) -> Iterator[tuple[Path, str]]:
    """Yield a file and those that it includes, and they, as far as they can be read; each with its name in messages.

    Args:
        path: The file.
        folder: What is not at or below it is not opened; None for no bound.
    """
    todo, seen = [path.resolve()], set[Path]()
    while todo and len(seen) < MAX_INCLUDES:
        file = todo.pop(0)
        if file in seen:
            continue
        seen.add(file)
        yield file, str(path if file == path.resolve() else file)
        try:
            far = folder is not None and not file.is_relative_to(folder)
            if far or not file.is_file() or file.stat().st_size > MAX_BYTES:
                continue
            root = ElementTree.parse(file).getroot()
        except (OSError, ValueError, LookupError, ElementTree.ParseError):
            continue
        todo += [(path.resolve().parent / element.get("file", "")).resolve() for element in root.iter("include")]


def urdf_speeds(text: str) -> dict[str, float]:
    """Return the greatest speed of each joint of a URDF that states one above zero, which MuJoCo leaves out [rad/s]."""
    try:
        joints = list(ElementTree.fromstring(text).iter("joint"))
    except ElementTree.ParseError:
        return {}
    speeds = {
        joint.get("name", ""): _floats(limit.get("velocity", "")) for joint in joints for limit in joint.iter("limit")
    }
    return {name: speed for name, found in speeds.items() for speed in found[:1] if speed > 0.0}


def _without_visuals(root: Element) -> list[str]:
    """Remove what a URDF only shows, and return the names of its files."""
    found = []
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            found += [PurePosixPath(mesh.get("filename", "")).name for mesh in visual.iter("mesh")]
            link.remove(visual)
    return found


class _Defaults:
    """Default attributes from the file's classes, for elements that do not state their own."""

    def __init__(self, root: Element) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for top in root.findall("default"):
            self._read(top, self._classes["main"])

    def _read(self, default: Element, inherited: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(attributes) for tag, attributes in inherited.items()}
        self._classes[default.get("class", "main")] = own
        for child in default:
            if child.tag != "default":
                own[child.tag] = own.get(child.tag, {}) | child.attrib
        for child in default.findall("default"):
            self._read(child, own)

    def of(self, element: Element, childclass: str) -> dict[str, str]:
        """Return an element's attributes, its class's included."""
        known = self._classes.get(element.get("class", childclass), {})
        return known.get(element.tag, {}) | element.attrib


class _Geom(NamedTuple):
    element: Element
    parent: Element
    attributes: dict[str, str]
    body: Element | None
    """None for the world, and for what never moves."""


def _geoms(parent: Element, childclass: str, body: Element | None, defaults: _Defaults) -> Iterator[_Geom]:
    """Yield the geoms at and below an element.

    Args:
        parent: The element.
        childclass: Class of what names none itself.
        body: The body that it is, or is part of; None where nothing moves.
        defaults: What classes mean.
    """
    for child in parent:
        if child.tag == "geom":
            yield _Geom(child, parent, defaults.of(child, childclass), body)
        elif child.tag in ("body", "frame"):
            moves = child.tag == "body" and (body is not None or _has_joint(child))
            inside = child if moves else body
            yield from _geoms(child, child.get("childclass", childclass), inside, defaults)


def _has_joint(body: Element) -> bool:
    joints = ("joint", "freejoint")
    return any(inner.tag in joints or (inner.tag == "frame" and _has_joint(inner)) for inner in body)


def _without_looks(root: Element, reasons: list[str]) -> list[str]:
    """Remove looks that need files, and return their names; a reason is added where one is more than a look."""
    assets = [(asset, child) for asset in root.findall("asset") for child in asset]
    from_file = [(asset, child) for asset, child in assets if child.tag in LOOKS and _has_file(child)]
    skins = [(parent, child) for parent in root.iter() for child in parent if child.tag == "skin"]
    names = {(child.tag, _name(child)) for _, child in from_file}
    settings = {key: value for element in root.findall("compiler") for key, value in element.attrib.items()}
    flags = {key: value for element in root.findall("option/flag") for key, value in element.attrib.items()}
    collides = "disable" not in (flags.get("contact"), flags.get("constraint"))
    needed, used, defaults = dict[str, list[str]](), set[tuple[str, str]](), _Defaults(root)
    for world in root.findall("worldbody"):
        for geom in list(_geoms(world, world.get("childclass", "main"), None, defaults)):
            uses = {(tag, geom.attributes.get(tag, "")) for tag in ("mesh", "hfield")} & names
            why = [_collides(geom)] * collides + [_gives_mass(geom, settings)]
            if uses:
                geom.parent.remove(geom.element)
                used |= uses if any(why) else set()
                for cure in filter(None, why):
                    needed.setdefault(cure, []).append(geom.element.get("name", f"of {next(iter(uses))[1]}"))
    for cure, geoms in needed.items():
        what = "a geom needs its mesh file" if len(geoms) == 1 else f"{len(geoms)} geoms need their mesh files"
        reasons.append(f"{what} ({listed(geoms)}), as {cure}")
    textures = {name for tag, name in names if tag == "texture"}
    for _, material in assets:
        if material.get("texture") in textures:
            del material.attrib["texture"]
        for layer in material.findall("layer"):
            if layer.get("texture") in textures:
                material.remove(layer)
    for parent, child in [*from_file, *skins]:
        parent.remove(child)
    skinned = {("skin", _name(child)) for _, child in skins}
    return sorted(f"{tag} {name}".strip() for tag, name in (names - used) | skinned)


def _has_file(asset: Element) -> bool:
    return any(key.startswith("file") for key in asset.attrib)


def _name(asset: Element) -> str:
    return asset.get("name") or PurePosixPath(asset.get("file", "")).stem


def _collides(geom: _Geom) -> str:
    """Return why a geom may touch another, and how not; an empty text where it cannot."""
    touches = any(geom.attributes.get(key, "1").strip() != "0" for key in ("contype", "conaffinity"))
    return 'they collide: contype="0" conaffinity="0" for one that only looks' if touches else ""


def _gives_mass(geom: _Geom, compiler: dict[str, str]) -> str:
    """Return why a geom gives mass, and how not; an empty text where it gives none."""
    if geom.body is None:
        return ""
    mass = geom.attributes.get("mass", geom.attributes.get("density", "1000"))
    group, (low, high) = geom.attributes.get("group", "0"), _range(compiler.get("inertiagrouprange", "0 5"))
    from_geoms = compiler.get("inertiafromgeom", "auto")
    asked = from_geoms == "true" or (from_geoms == "auto" and geom.body.find("inertial") is None)
    counts = asked and any(x != 0.0 for x in _floats(mass)) and any(low <= x <= high for x in _floats(group))
    return "the mass of their bodies comes from them: wanted an <inertial>" if counts else ""


def _range(text: str) -> tuple[float, float]:
    low, high = (_floats(text) + [0.0, 5.0])[:2]
    return low, high
