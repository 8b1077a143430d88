"""From a config's file, or its bytes, to a tree of plain values."""

from __future__ import annotations

import stat
from pathlib import Path

from torquebench.errors import ConfigError, Problem, did_you_mean_path
from torquebench.experiment.document import BROKEN, Document, Place
from torquebench.experiment.yaml_tree import parse_value

MAX_BYTES = 1 << 20
YAML = r"\.ya?ml"
"""What a config's name ends in, a regular expression; any other is read too."""


def read_bytes(path: Path) -> bytes:
    """Return the content of a config file.

    Raises:
        ConfigError: it is missing, not a regular file, unreadable, or larger than 1 MiB.
    """
    shown = str(path) if str(path).isprintable() else ascii(str(path))
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise ConfigError([Problem(shown, "", "is a directory, wanted a YAML file")])
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
    document.root = parse_value(document, text.removeprefix("\ufeff"))
    if document.root is BROKEN:
        document.raise_problems()
    if document.root is None:
        document.fail("is empty, wanted a mapping with name, plant, controllers ...", Place(0))
    if not isinstance(document.root, dict):
        document.fail("wanted a mapping (name: ..., plant: ...) at the top level", document.place(()))
    return document
