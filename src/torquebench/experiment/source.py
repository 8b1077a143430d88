"""A config between reading and checking: the tree of a file, edits to it, and the mistakes found so far."""

from __future__ import annotations

import re
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NoReturn

from torquebench.errors import ConfigError, Fault, Problem, did_you_mean_path, nearest
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
    value_at,
)

MAX_BYTES = 1 << 20
MAX_PROBLEMS = 100
MAX_OVERRIDE = 65_536
"""Longest ``--set`` [characters]."""
YAML = r"\.ya?ml"
"""What a config's name ends in, a regular expression; any other is read too."""
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
        self.filename = filename if filename.isprintable() else ascii(filename)
        self.root: Any = None
        self.start = Place(0, 1, 1)
        """Where the root was written."""
        self.overrides: list[str] = []
        self.found: list[tuple[Place, Problem]] = []
        """The mistakes found so far, each with its place, in the order they were found."""
        self.full = False
        """Whether so many mistakes were found that looking for more is no help."""

    def copy(self) -> Document:
        """Return another document of the same content and places, without mistakes so far."""
        other = Document(self.filename)
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
            elif isinstance(node, Seq) and isinstance(part, int) and part < len(node):
                here = node.places[part]
            else:
                break
            node = node[part]
        return here

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
            return Problem(f"--set {self.overrides[place.override - 1]}", **parts)
        if not self.filename or not place.line:
            return Problem(self.filename, **parts)
        return Problem(self.filename, **parts, line=place.line, column=place.column)

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

    def fail(self, text: str, place: Place, wanted: str = "") -> NoReturn:
        """Record one last mistake and raise them all.

        Raises:
            ConfigError: always.
        """
        self.add((), text, place=place, wanted=wanted)
        raise ConfigError(self._sorted())

    def raise_problems(self) -> None:
        """Raise every mistake found so far, in reading order.

        Raises:
            ConfigError: there is at least one.
        """
        if self.found:
            raise ConfigError(self._sorted())

    def _sorted(self) -> list[Problem]:
        problems = [problem for _, problem in sorted(self.found, key=lambda found: found[0])]
        if self.full:
            problems.append(Problem(self.filename, "", f"there are more mistakes than these {MAX_PROBLEMS}"))
        return problems


def read_bytes(path: Path | str) -> bytes:
    """Return the content of a config file.

    Raises:
        ConfigError: it is missing, not a regular file, unreadable, or larger than 1 MiB.
    """
    shown = str(path) if str(path).isprintable() else ascii(str(path))
    path = Path(path)
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


def read_document(source: str | bytes, filename: str) -> Document:
    """Return the tree of a config whose top level is a mapping; mistakes in it are recorded, not yet raised.

    Raises:
        ConfigError: there is no such tree: not UTF-8, too large, not YAML, empty, or not a mapping.
    """
    document = Document(filename)
    size = len(source.encode("utf-8", "surrogatepass")) if isinstance(source, str) else len(source)
    if size > MAX_BYTES:
        document.fail(f"is {size} bytes, at most {MAX_BYTES} are read", Place(0))
    try:
        text = source if isinstance(source, str) else source.decode("utf-8")
    except UnicodeDecodeError as error:
        document.fail(f"is not UTF-8 text (byte offset {error.start})", Place(0))
    document.root, document.start = parse_value(text.removeprefix("\ufeff"), document.add)
    if document.root is BROKEN:
        document.raise_problems()
    if document.root is None:
        document.fail("is empty", Place(0), "a mapping with name, plant, controllers ...")
    if not isinstance(document.root, dict):
        document.fail("", document.start, "a mapping (name: ..., plant: ...) at the top level")
    return document


def document_of(values: Mapping[str, Any], filename: str = "") -> Document:
    """Return a document of plain values, as from Python; lists may be tuples, and numbers numpy's.

    Args:
        values: What its root is to be.
        filename: What to call it in messages, if anything.
    """
    document = Document(filename)
    document.start = Place(0)
    document.root = _tree(values)
    return document


def _tree(value: Any) -> Any:
    if hasattr(value, "tolist"):  # numpy's arrays and numbers
        value = value.tolist()
    if isinstance(value, Mapping):
        mapping = Map()
        for key, item in value.items():
            mapping.put(str(key), _tree(item), Place(0), Place(0))
        return mapping
    if isinstance(value, list | tuple):
        return Seq(map(_tree, value), [Place(0)] * len(value))
    return value


def apply_overrides(document: Document, overrides: Sequence[str]) -> None:
    """Apply each override in order, the last one winning; mistakes are recorded in the document.

    A list of named things also takes names: ``controllers.conventional.gains.k=0.5``.

    Args:
        document: What is edited; its root is a mapping.
        overrides: Texts ``key=value``; values follow the same rules as in the file.
    """
    for text in overrides:
        shown = text if text.isprintable() else ascii(text)
        document.overrides.append(shown if len(shown) <= 120 else shown[:120] + "...")
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
        index = index_of(node, part)
        if index is None:
            text, near = _refusal(node, path, part)
            document.add((*path, part), f"cannot be set: {text}", place=key_place, nearest=near)
            return
        path = (*path, index)
        last = depth == len(parts) - 1
        if isinstance(node, Map) and (last or node.get(part) is None):  # type: ignore[arg-type]
            node.put(str(index), value if last else Map(), key_place, value_place)
        elif last:
            node[index], node.places[index] = value, value_place
        node = node[index]


def set_key(document: Document, key: str, value: Any) -> None:
    """Set a dotted key to a plain value, as from Python; mistakes are recorded in the document."""
    parts = split_key(key)
    if parts is None:
        document.add((key,), "is not a key", wanted="one such as run.duration or controllers[0].gains.k")
    else:
        assign(document, parts, _tree(value), Place(0), Place(0))


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
        return f"{parent} is not a {'mapping' if isinstance(part, str) else 'list'}", ""
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
