"""A config between reading and checking: the tree of a file, edits to it, and the mistakes found so far."""

from __future__ import annotations

import re
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NoReturn

from torquebench.errors import ConfigError, Fault, Problem, did_you_mean_path, nearest, nearest_path
from torquebench.experiment.extends import EXTENDS, MAX_PARENTS, Text, extended, orphaned, with_names
from torquebench.experiment.presets import GAINS, MOTION, keys_of_name, write_presets
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import (
    BROKEN,
    MAX_DEPTH,
    KeyPath,
    Map,
    Place,
    Seq,
    copied,
    parse_value,
    shortened,
    tree_of,
    value_at,
)
from torquebench.registry import SLUG
from torquebench.robot.library import ArmFile
from torquebench.shipped import YAML, shipped_config, shipped_names

MAX_BYTES = 1 << 20
MAX_PROBLEMS = 100
MAX_OVERRIDE = 65_536
"""Longest ``--set`` [characters]."""
_PLAIN_KEY = re.compile(r"[A-Za-z0-9_-]{1,64}")
_PART = re.compile(r"([A-Za-z0-9_-]{1,64})((?:\[[0-9]{1,6}\])*)")
_FORM = "KEY=VALUE, such as run.duration=2 or controllers[0].gains.k=0.5"


def dotted(path: KeyPath) -> str:
    """Return `path` the way users write it, such as ``controllers[0].gains.k``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if _PLAIN_KEY.fullmatch(part) else shortened(part))
    return text


class Document:
    """A tree of plain values that may still be edited, and the mistakes found in it.

    Args:
        filename: What to call the file in messages; empty when there is none.
    """

    def __init__(self, filename: str) -> None:
        self.files = [_printable(filename)]
        """What to call the file, that which it extends, and so on; see `Place.file`."""
        self.folders: list[Path | None] = [None]
        """Where these files are; None for what is in no file."""
        self.parents: tuple[Text, ...] = ()
        """The files that it extends, nearest first."""
        self.inherited: tuple[Any, ...] = ()
        """Controllers of the nearest of them."""
        self.arms: dict[str, tuple[Path | None, ArmFile]] = {}
        """Arms read from files: path as it was written -> the folder it starts from, None for any, and the arm."""
        self.outside = False
        """Whether an arm's file may be outside the folder of the config."""
        self.root: Any = None
        self.start = Place(0, 1, 1)
        """Where the root was written."""
        self.overrides: list[str] = []
        self.found: list[tuple[Place, Problem]] = []
        """The mistakes found so far, each with its place, in the order they were found."""
        self.full = False
        """Whether so many mistakes were found that looking for more is no help."""
        self.groups: dict[KeyPath, tuple[Any, dict[str, Any]]] = {}
        """Each group of keys that was read: its place -> the `Group`, and its values, BROKEN where they are wrong."""
        self.unchecked = False
        """Whether mistakes keep something from being checked."""

    @property
    def filename(self) -> str:
        """Name of the file in messages."""
        return self.files[0]

    def copy(self) -> Document:
        """Return another document of the same content and places, without mistakes so far."""
        other = Document(self.filename)
        other.files, other.folders = list(self.files), list(self.folders)
        other.parents, other.inherited = self.parents, self.inherited
        other.arms, other.outside = self.arms, self.outside  # one reading serves all copies
        other.root, other.start, other.overrides = copied(self.root), self.start, list(self.overrides)
        return other

    def place(self, path: KeyPath, at: Literal["key", "value"] = "value") -> Place:
        """Return where `path` was written, or the nearest enclosing key when it was not written at all."""
        node, here = self.root, self.start
        for depth, part in enumerate(path, 1):
            last = depth == len(path)
            if isinstance(node, Map) and isinstance(part, str) and part in node.places:
                key, value = node.places[part]
                here = value if last and at == "value" else key
                if part not in node:
                    break
            elif isinstance(node, Seq) and isinstance(part, int) and part < len(node):
                here = node.places[part]
            else:
                break
            node = node[part]
        return here

    def folder(self, path: KeyPath) -> Path | None:
        """Return the folder from which a path that stands at a key starts; None where a person gave it otherwise."""
        place = self.place(path)
        return self.folders[place.file] if place.line and not place.override else None

    def written(self, path: KeyPath) -> bool:
        """Whether a key is given."""
        nothing = object()
        return value_at(self.root, path, nothing) is not nothing

    def overridden(self, path: KeyPath) -> bool:
        """Whether an override names this very key, so that it may replace what the file gives."""
        return self.written(path) and self.place(path, "key").override > 0

    def where(self, place: Place) -> str:
        """Return `place` as text: ``file:line:column``, or the command-line option."""
        return self.problem(place).where

    def problem(self, place: Place, **parts: Any) -> Problem:
        """Return a mistake at a place; `parts` are those of a `Problem`."""
        if place.override:
            return Problem(self.overrides[place.override - 1], **parts)
        file = self.files[place.file]
        if not file or not place.line:
            return Problem(file, **parts)
        return Problem(file, **parts, line=place.line, column=place.column)

    def add(
        self,
        path: KeyPath,
        text: str = "",
        *,
        at: Literal["key", "value"] = "value",
        place: Place | None = None,
        **parts: Any,
    ) -> None:
        """Record a mistake.

        Args:
            path: The offending key.
            text: What is wrong, in words.
            at: Whether the mistake is in the key's name or in its value.
            place: Where it is, when that is not where `path` was written.
            parts: Other parts of a `Problem`.
        """
        if len(self.found) >= MAX_PROBLEMS:
            self.full = True
            return
        place = self.place(path, at) if place is None else place
        self.found.append((place, self.problem(place, key=dotted(path), text=text, **parts)))

    def add_fault(self, fault: Fault, path: KeyPath = ()) -> None:
        """Record a mistake that an object's own rules found; `path` is where the object is."""
        whole = (*path, *fault.path)
        place = self.place(whole, fault.at)
        if fault.unless and not self.written(whole) and self.written(fault.unless):
            place = self.place(fault.unless)
        parts: dict[str, Any] = {"got": fault.got, "wanted": fault.wanted, "nearest": fault.nearest, "note": fault.note}
        self.add(whole, fault.text, place=place, **parts)

    def fail(self, text: str, place: Place, path: KeyPath = (), **parts: Any) -> NoReturn:
        """Record one last mistake and raise them all; arguments as of `add`.

        Raises:
            ConfigError: always.
        """
        self.add(path, text, place=place, **parts)
        raise ConfigError(self.problems())

    def raise_problems(self) -> None:
        """Raise every mistake found so far, in reading order.

        Raises:
            ConfigError: there is at least one.
        """
        if self.found:
            raise ConfigError(self.problems(), self.unchecked)

    def problems(self) -> list[Problem]:
        """Return the mistakes found so far, in reading order."""
        problems = [problem for _, problem in sorted(self.found, key=lambda found: found[0].order)]
        if self.full:
            problems.append(Problem(self.filename, "", f"there are more mistakes than these {MAX_PROBLEMS}"))
        return problems


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)


def read_bytes(path: Path | str) -> bytes:
    """Return the content of a config file.

    Raises:
        ConfigError: it is missing, not a regular file, unreadable, or larger than 1 MiB.
    """
    shown, path = _printable(str(path)), Path(path)
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise ConfigError([Problem(shown, "", "is a directory", wanted="a YAML file")])
        if not stat.S_ISREG(status.st_mode):
            raise ConfigError([Problem(shown, "", "is not a regular file")])
        if status.st_size > MAX_BYTES:
            raise ConfigError([Problem(shown, "", f"is {status.st_size} bytes, at most {MAX_BYTES} are read")])
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1)
    except FileNotFoundError as error:
        raise ConfigError([Problem(shown, "", f"does not exist{did_you_mean_path(path, YAML)}")]) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError([Problem(shown, "", f"cannot be read ({reason})")]) from error


def read_document(source: str | bytes, filename: str, parents: Sequence[Text] | None = None) -> Document:
    """Return the tree of a config, with the keys of what it extends; mistakes in it are recorded, not yet raised.

    Args:
        source: Its text.
        filename: What to call it in messages; files that it extends are looked for beside it.
        parents: The texts of these files, nearest first; read from the disk if left out.

    Raises:
        ConfigError: there is no such tree: not UTF-8, too large, not YAML, empty, not a mapping, or there is not what
            it extends.
    """
    document = Document(filename)
    document.folders = [Path(filename).parent if filename else None]
    root, document.start = _parsed(document, source, 0)
    _inherit(document, root, Path(filename).parent if filename else Path(), parents)
    stem = Path(filename).stem.lower().replace("_", "-")
    if "name" not in document.root and SLUG.fullmatch(stem):
        document.root.put("name", stem, document.start, document.start)
    return document


def _parsed(document: Document, source: str | bytes, file: int) -> tuple[Map, Place]:
    """Return the tree of a file's text, and where it starts.

    Raises:
        ConfigError: there is none.
    """
    size = len(source.encode("utf-8", "surrogatepass")) if isinstance(source, str) else len(source)
    whole = Place(0, file=file)
    if size > MAX_BYTES:
        document.fail(f"is {size} bytes, at most {MAX_BYTES} are read", whole)
    try:
        text = source if isinstance(source, str) else source.decode("utf-8")
    except UnicodeDecodeError as error:
        document.fail(f"is not UTF-8 text (byte offset {error.start})", whole)
    root, start = parse_value(text.removeprefix("\ufeff"), document.add, file=file)
    if root is BROKEN:
        document.raise_problems()
    if root is None:
        document.fail("is empty", whole, wanted="a mapping with name, plant, controllers ...")
    if not isinstance(root, Map):
        document.fail("", start, wanted="a mapping (name: ..., plant: ...) at the top level")
    return root, start


def _inherit(document: Document, root: Map, folder: Path, given: Sequence[Text] | None) -> None:
    """Give a document the keys of a tree and of those that it extends, one after another.

    Args:
        document: The document, whose own file has been read.
        root: Its tree.
        folder: Where its file is.
        given: Texts of the files that it extends; None to read them.

    Raises:
        ConfigError: one of them is not there, or is no config.
    """
    trees, texts = [root], list[Text]()
    while EXTENDS in trees[-1]:
        name, place = trees[-1][EXTENDS], trees[-1].places[EXTENDS][1]
        text = given[len(texts)] if given is not None else _parent(document, name, place, folder, len(texts))
        if text is None:
            trees = [orphaned(tree) for tree in trees]
            break
        texts.append(text)
        document.files.append(_printable(text.filename))
        folder = Path(text.filename).parent
        document.folders.append(folder)
        tree, _ = _parsed(document, text.content, len(texts))
        trees.append(tree)
    document.parents = tuple(texts)
    found = trees.pop()
    if isinstance(items := found.get("controllers"), Seq):
        found["controllers"] = with_names(items, (), document.add)
    while trees:
        document.inherited = tuple(known) if isinstance(known := found.get("controllers"), Seq) else ()
        found = extended(trees.pop(), found, document.add)
    write_presets(found, document.add)
    document.root = found


def _parent(document: Document, name: Any, place: Place, folder: Path, depth: int) -> Text | None:
    """Return the file that a config extends; None, with the mistake recorded, where there is none.

    Raises:
        ConfigError: too many extend one another.
    """
    wanted = "the name of a shipped config, or of a .yaml file beside this one"
    if not isinstance(name, str) or not name:
        document.add((EXTENDS,), place=place, got="no name", wanted=wanted)
        return None
    is_file = re.search(rf"{YAML}$", name) is not None and not name.startswith("configs/")
    path = folder / name if is_file else shipped_config(name)
    if path is None or (is_file and (Path(name).is_absolute() or not path.is_file())):
        near = nearest_path(folder / name, YAML) if is_file else nearest(name, shipped_names())
        document.add((EXTENDS,), f"there is no {shortened(name)}", place=place, nearest=near or "", wanted=wanted)
        return None
    if depth == MAX_PARENTS or str(path.resolve()) in [str(Path(file).resolve()) for file in document.files if file]:
        document.fail(f"{shortened(name)} extends itself, or more than {MAX_PARENTS} files", place, (EXTENDS,))
    return Text(str(path), read_bytes(path))


def document_of(values: Mapping[str, Any], filename: str = "") -> Document:
    """Return a document of plain values, as from Python; lists may be tuples, and numbers numpy's.

    Args:
        values: What its root is to be.
        filename: What to call it in messages, if anything.
    """
    document = Document(filename)
    document.start = Place(0)
    _inherit(document, tree_of(values), Path(), None)
    return document


class OptionChange(str):
    """A change ``key=value`` that an option of its own stands for, by which messages call it."""

    option: str
    given: str

    def __new__(cls, text: str, option: str, given: str) -> OptionChange:
        """Return the change.

        Args:
            text: As for ``--set``.
            option: The option.
            given: Its value.
        """
        made = super().__new__(cls, text)
        made.option, made.given = option, given
        return made

    def __getnewargs__(self) -> tuple[str, str, str]:  # type: ignore[override]  # a copy is made as this was
        """Return what `__new__` takes."""
        return str(self), self.option, self.given


def apply_overrides(document: Document, overrides: Sequence[str]) -> None:
    """Apply each override in order, the last one winning; mistakes are recorded in the document.

    A list of named things also takes names: ``controllers.conventional.gains.k=0.5``.

    Args:
        document: What is edited; its root is a mapping.
        overrides: Texts ``key=value``; values follow the same rules as in the file.
    """
    for text in overrides:
        option, given = (text.option, text.given) if isinstance(text, OptionChange) else ("--set", text)
        plain = given if given.isprintable() else ascii(given)
        document.overrides.append(f"{option} {plain if len(plain) <= 120 else plain[:120] + '...'}")
        place = Place(len(document.overrides))
        key, equals, value_text = text.partition("=")
        if len(text) > MAX_OVERRIDE:
            document.add((), f"is {len(text)} characters long, at most {MAX_OVERRIDE} are read", place=place)
            continue
        parts = split_key(key.strip())
        if not equals or not parts:
            deep = f"has more than {MAX_DEPTH} parts" if key.count(".") >= MAX_DEPTH else ""
            document.add((), deep, place=place, wanted="" if deep else _FORM)
            continue
        value, _ = parse_value(value_text, document.add, tuple(parts), place)
        if value is not BROKEN:
            assign(document, parts, value, place, place)


def assign(document: Document, parts: Sequence[str | int], value: Any, key_place: Place, value_place: Place) -> None:
    """Set the value that a key addresses, making the mappings on the way that are not there; mistakes are recorded.

    Args:
        document: What is edited; its root is a mapping.
        parts: The key; see `split_key`.
        value: What to set.
        key_place, value_place: Where key and value were written.
    """
    node: Any = document.root
    path: KeyPath = ()
    for depth, part in enumerate(parts):
        if node is BROKEN:
            return
        if isinstance(node, str) and (keys := keys_of_name(path, node, key_place)) is not None:
            owner = value_at(document.root, path[:-1], None)
            owner.put(str(path[-1]), keys, *owner.places[path[-1]])
            node = keys
        index = index_of(node, part)
        if index is None:
            text, near = _refusal(node, path, part)
            document.add((*path, part), f"cannot be set: {text}", place=key_place, nearest=near)
            return
        path = (*path, index)
        last = depth == len(parts) - 1
        if last and path == ("controllers",):
            known = (*document.inherited, *(node.get("controllers") or ()))
            if isinstance(value, Seq):
                value = with_names(value, known, document.add)
            elif names := [str(item["name"]) for item in known if isinstance(item, Map) and "name" in item]:
                wanted = f"a list of those to run, such as [{', '.join(dict.fromkeys(names))}], or of whole ones"
                document.add(path, got=shown(value), wanted=wanted, place=value_place)
                return
        if isinstance(node, Map) and (last or node.get(part) is None):  # type: ignore[arg-type]
            node.put(str(index), value if last else Map(), key_place, value_place)
        elif last:
            node[index], node.places[index] = value, value_place
        node = node[index]
    if path == ("controllers",) or (isinstance(value, str) and parts[-1] in (MOTION, GAINS)):
        write_presets(document.root, document.add)


def set_key(document: Document, key: str, value: Any) -> None:
    """Set a dotted key to a plain value, as from Python; mistakes are recorded in the document."""
    parts = split_key(key)
    if parts is None:
        document.add((key,), "is not a key", wanted="one such as run.duration or controllers[0].gains.k")
    else:
        assign(document, parts, tree_of(value), Place(0), Place(0))


def split_key(key: str) -> list[str | int] | None:
    """Return the names and indices of a dotted key, or None when it is none, or has more than `MAX_DEPTH` parts."""
    parts: list[str | int] = []
    if key.count(".") + key.count("[") >= MAX_DEPTH:
        return None
    for text in key.split("."):
        match = _PART.fullmatch(text)
        if not match:
            return None
        parts.append(match.group(1))
        parts += [int(number) for number in re.findall(r"[0-9]+", match.group(2))]
    return parts


def index_of(node: Any, part: str | int) -> str | int | None:
    """Return the key or index of the child of `node` that `part` addresses, or None."""
    if isinstance(node, dict):
        return part if isinstance(part, str) else None
    if not isinstance(node, list):
        return None
    if isinstance(part, int):
        return part if part < len(node) else None
    named = (i for i, item in enumerate(node) if isinstance(item, dict) and item.get("name") == part)
    return next(named, None)


def _refusal(node: Any, path: KeyPath, part: str | int) -> tuple[str, str]:
    """Return why a key cannot be set, and the nearest name that could."""
    parent = dotted(path)
    if not isinstance(node, list):
        if isinstance(part, str):
            return f"{parent} is not a mapping", ""
        hint = "" if isinstance(node, dict) else ", give it as one to change one of its numbers"
        return f"{parent} is not a list{hint}", ""
    has = f"{parent} has {len(node)} item{'s' * (len(node) != 1)}, counted from 0"
    if isinstance(part, int):
        return has, ""
    names = [str(item["name"]) for item in node if isinstance(item, dict) and "name" in item]
    if node and (part.isdecimal() or not names):
        index = int(part) if part.isdecimal() and int(part) < len(node) else 0
        return f"{has}: write {parent}[{index}]{' for the first' * (index == 0)}", ""
    near = nearest(part, names)
    others = f" (there are {', '.join(names)})" if near is None else ""
    return f"nothing in {parent} is named {shortened(part)}{others}", near or ""
