"""Strict YAML: text to plain values with their places, in a subset of YAML 1.2 without surprises.

Only ``true`` and ``false`` are booleans, a number is what everyone reads as one, and whatever makes a file
mean something else than it seems to (aliases, tags, duplicate keys, several documents) is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias

import yaml

KeyPath: TypeAlias = tuple[str | int, ...]

MAX_DEPTH = 32
MAX_VALUES = 12_000

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DIGITS = r"(?:0|[1-9][0-9]*)"
_INT = re.compile(rf"[-+]?{_DIGITS}")
NUMBER = re.compile(rf"[-+]?(?:{_DIGITS}(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_FIXED = {"true": True, "false": False, "null": None, "~": None, "": None}
_NAN = frozenset((".nan", ".NaN", ".NAN"))
_LONGEST_INT = 100  # digits; longer ones are read as floats, which no whole-number key accepts
# C0 and C1 controls, separators that some editors count as line ends, characters that reorder or hide text.
FORBIDDEN = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ufeff\ud800-\udfff\ufffe\uffff]"
)
_ODD_SPACE = re.compile("[\u00a0\u1680\u2000-\u200b\u202f\u205f\u3000]")
_PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")
"""What YAML's parser would hand over as it is: most values of a command line."""
_LINE_END = re.compile(r"\r\n|\r|\n")


class Broken:
    """Stands for a value that could not be read and is already reported; checks pass over it."""


BROKEN = Broken()


class Place(NamedTuple):
    """Place at which a value was written."""

    override: int
    """0 for the file, else the number of the ``--set`` option, from 1."""
    line: int = 0
    """Line, from 1."""
    column: int = 0
    """Column, from 1."""
    file: int = 0
    """0 for the file itself, 1 for the one that it extends, 2 for the one that this extends."""

    @property
    def order(self) -> tuple[int, int, int, int]:
        """Sorts places in reading order: the file, those that it extends, the command line."""
        return self.override, self.file, self.line, self.column


class Map(dict[str, Any]):
    """A mapping that knows where each key and its value were written."""

    __slots__ = ("is_whole", "places")

    def __init__(self) -> None:
        super().__init__()
        self.is_whole = True
        """Whether no key was refused that stands for others."""
        self.places: dict[str, tuple[Place, Place]] = {}
        """Key -> place of the key, place of its value."""

    def put(self, key: str, value: Any, key_place: Place, value_place: Place) -> None:
        """Set the value of `key`, which was written at `value_place`; the key itself at `key_place`."""
        self[key] = value
        self.places[key] = key_place, value_place


class Seq(list[Any]):
    """A list that knows where each item was written.

    Args:
        items: The items.
        places: Where they were written.
    """

    __slots__ = ("places",)

    def __init__(self, items: Iterable[Any] = (), places: Iterable[Place] = ()) -> None:
        super().__init__(items)
        self.places = list(places)


def copied(node: Any) -> Any:
    """Return a copy of a tree; places are shared, as they never change."""
    if isinstance(node, Map):
        mapping = Map()
        mapping.is_whole = node.is_whole
        for key, value in node.items():
            mapping.put(key, copied(value), *node.places[key])
        return mapping
    return Seq(map(copied, node), node.places) if isinstance(node, Seq) else node


def value_at(node: Any, path: KeyPath, default: Any = BROKEN) -> Any:
    """Return the value at a place below a node of a tree, or a default where there is none."""
    for part in path:
        try:
            node = node[part]
        except (KeyError, IndexError, TypeError):
            return default
    return node


def shortened(text: str, limit: int = 64) -> str:
    """Return `text` quoted, on one line, in at most about `limit` characters."""
    return ascii(text) if len(text) <= limit else ascii(text[:limit]) + "..."


class Report(Protocol):
    """Records a mistake."""

    def __call__(self, path: KeyPath, text: str, *, place: Place) -> None:
        """Take the offending key, what is wrong, and where."""


class _Stop(Exception):
    """Reading ends here; the reason is already recorded."""


def parse_value(
    text: str, report: Report, path: KeyPath = (), place: Place | None = None, file: int = 0
) -> tuple[Any, Place]:
    """Parse one YAML value.

    Args:
        text: The YAML.
        report: Receives mistakes.
        path: Where the value belongs.
        place: Where the text was written, when it is not a file of its own.
        file: Number of the file, for the places in it.

    Returns:
        `Map`, `Seq`, str, int, float, bool and None, nested, with BROKEN for what could not be read; and where it was
        written.
    """
    start = place or Place(0, 1, 1, file)
    if _PLAIN.fullmatch(text):
        return resolve(text), start
    bad = FORBIDDEN.search(text)
    if bad:
        lines = _LINE_END.split(text[: bad.start()])
        here = place or Place(0, len(lines), len(lines[-1]) + 1, file)
        report(path, f"has the control character U+{ord(bad.group()):04X}", place=here)
        return BROKEN, start
    builder = _Builder(report, text, place, file)
    try:
        return builder.whole(path)
    except _Stop:
        return BROKEN, start
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        here = _place(mark, file)
        report(path, _syntax_message(error, text, here), place=place or here)
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # the last two: PyYAML's own parser on \U escapes
        report(path, "not valid YAML: " + " ".join(str(error).split()), place=start)
    return BROKEN, start


def resolve(text: str) -> bool | int | float | str | None:
    """Return the value of an unquoted scalar."""
    if text in _FIXED:
        return _FIXED[text]
    if text[0].isalpha():  # no number begins so
        return text
    if _INT.fullmatch(text) and len(text) <= _LONGEST_INT:
        return int(text)
    if NUMBER.fullmatch(text):
        return float(text)
    if text in _NAN:
        return math.nan
    infinite = _INFINITE.fullmatch(text)
    if infinite:
        return -math.inf if infinite.group(1) == "-" else math.inf
    return text


def _place(mark: Any, file: int) -> Place:
    """Return a mark of the parser, which counts from 0, as a place in a file."""
    return Place(0, mark.line + 1, mark.column + 1, file) if mark else Place(0, 1, 1, file)


def _syntax_message(error: yaml.MarkedYAMLError, text: str, here: Place) -> str:
    problem = error.problem or error.context or "unreadable"
    lines = _LINE_END.split(text)
    line = lines[here.line - 1] if here.line <= len(lines) else ""
    hint = ""
    if "\t" in line[: here.column]:
        hint = "; indent with spaces, not tabs"
    elif odd := _ODD_SPACE.search("\n".join(lines[: here.line])):
        at = f"line {text.count(chr(10), 0, odd.start()) + 1}"
        hint = f"; {at} has the character U+{ord(odd.group()):04X}, which looks like a space: write a space"
    elif "cannot start any token" in problem:
        hint = "; put the text in quotes"
    elif "mapping values" in problem or "did not find expected" in problem:
        hint = "; check indentation, brackets and commas, and put text with ': ' or '#' in quotes"
    return f"not valid YAML: {problem}{hint}"


class _Builder:
    """Turns the parser's events into values; never deeper than MAX_DEPTH, never more than MAX_VALUES."""

    def __init__(self, report: Report, text: str, place: Place | None, file: int) -> None:
        self._report = report
        self._place = place
        self._file = file
        self._next: Callable[[], Any] = _LOADER(text).get_event
        self._count = 0

    def whole(self, path: KeyPath) -> tuple[Any, Place]:
        self._next()
        if not isinstance(self._next(), yaml.DocumentStartEvent):
            return None, self._place or Place(0, 1, 1, self._file)
        event = self._next()
        start = self._here(event)
        value = self._value(event, path, 1)
        self._next()
        more = self._next()
        if not isinstance(more, yaml.StreamEndEvent):
            self._add(path, "a second YAML document starts here; one file holds one experiment", more)
        return value, start

    def _here(self, event: Any) -> Place:
        mark = event.start_mark
        return self._place or Place(0, mark.line + 1, mark.column + 1, self._file)

    def _add(self, path: KeyPath, message: str, event: yaml.Event) -> None:
        self._report(path, message, place=self._here(event))

    def _enter(self, event: yaml.Event, path: KeyPath, depth: int) -> None:
        self._count += 1
        if self._count > MAX_VALUES:
            self._add((), f"has more than {MAX_VALUES} values", event)
            raise _Stop
        if depth > MAX_DEPTH and isinstance(event, yaml.CollectionStartEvent):
            self._add(path[:3], f"is nested more than {MAX_DEPTH} levels deep", event)
            raise _Stop

    def _odd(self, event: Any, path: KeyPath) -> bool:
        """Report what is refused on any value; return whether the value is unusable."""
        anchor, tag = event.anchor, getattr(event, "tag", None)
        if anchor is None and tag is None:
            return False
        if isinstance(event, yaml.AliasEvent):  # its anchor is the name
            self._add(path, "aliases (*name) are not accepted; write the value out", event)
        elif anchor is not None:
            self._add(path, f"anchors are not accepted; remove &{shortened(str(anchor))[1:-1]}", event)
        if tag is not None:
            self._add(
                path,
                f"tags are not accepted; remove {shortened(str(tag)).replace('tag:yaml.org,2002:', '!!')}",
                event,
            )
        return isinstance(event, yaml.AliasEvent) or tag is not None

    def _value(self, event: Any, path: KeyPath, depth: int) -> Any:
        self._enter(event, path, depth)
        odd = self._odd(event, path)
        value: Any = BROKEN
        if isinstance(event, yaml.ScalarEvent):
            value = self._scalar(event, path)
        elif isinstance(event, yaml.SequenceStartEvent):
            value = Seq()
            while not isinstance(item := self._next(), yaml.SequenceEndEvent):
                value.places.append(self._here(item))
                value.append(self._value(item, (*path, len(value)), depth + 1))
        elif isinstance(event, yaml.MappingStartEvent):
            value = self._mapping(path, depth)
        return BROKEN if odd else value

    def _scalar(self, event: yaml.ScalarEvent, path: KeyPath) -> Any:
        if not event.style:
            return resolve(event.value)
        bad = FORBIDDEN.search(event.value)  # of an escape: the text itself has none
        if bad:
            self._add(path, f"has the control character U+{ord(bad.group()):04X}", event)
            return BROKEN
        return event.value

    def _mapping(self, path: KeyPath, depth: int) -> Map:
        values = Map()
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            key = self._key(event, path, depth)
            if key is None:
                # what a merge key would have given is not known
                values.is_whole = values.is_whole and getattr(event, "value", "") != "<<"
                self._skip(self._next(), path, depth + 1)
            elif key in values:
                first = "" if self._place else f" on line {values.places[key][0].line}"
                self._add((*path, key), f"duplicate key, first given{first}", event)
                self._skip(self._next(), path, depth + 1)
            else:
                value = self._next()
                values.places[key] = self._here(event), self._here(value)
                values[key] = self._value(value, (*path, key), depth + 1)
        return values

    def _key(self, event: Any, path: KeyPath, depth: int) -> str | None:
        if not isinstance(event, yaml.ScalarEvent):
            self._odd(event, path)
            if not isinstance(event, yaml.AliasEvent):
                self._add(path, "a key must be a word, not a list or a mapping", event)
            self._skip(event, path, depth + 1)
            return None
        self._enter(event, path, depth)
        odd = self._odd(event, path)
        key = self._scalar(event, path)
        if odd or key is BROKEN:
            return None
        if key == "<<" and not event.style:
            self._add(path, "merge keys (<<) are not accepted; write the keys out", event)
            return None
        if not isinstance(key, str):
            comma = "; a comma separates keys, and the decimal sign is a point"
            hint = comma if isinstance(key, int | float) and not isinstance(key, bool) else ""
            self._add(path, f"a key must be a word, got {shortened(event.value)}{hint}", event)
            return None
        return key

    def _skip(self, event: yaml.Event, path: KeyPath, depth: int) -> None:
        """Read past one value."""
        level = 0
        while True:
            if isinstance(event, yaml.CollectionStartEvent):
                level += 1
            if isinstance(event, yaml.CollectionEndEvent):
                level -= 1
            else:
                self._enter(event, path, depth + level)
            if level == 0:
                return
            event = self._next()


def tree_of(value: Any, place: Place | None = None) -> Any:
    """Return plain values as a document holds them.

    Args:
        value: Mappings, lists, arrays, words and numbers.
        place: Where all of it counts as written; nowhere if left out.
    """
    place = place or Place(0)
    if hasattr(value, "tolist"):  # numpy's arrays and numbers
        value = value.tolist()
    if isinstance(value, Mapping):
        mapping = Map()
        for key, item in value.items():
            mapping.put(str(key), tree_of(item, place), place, place)
        return mapping
    if isinstance(value, list | tuple):
        return Seq([tree_of(item, place) for item in value], [place] * len(value))
    return value
