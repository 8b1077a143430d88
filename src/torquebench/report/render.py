"""From a template and its content to a page; the same content gives the same bytes."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PackageLoader, StrictUndefined

PAGE = "report.html"
"""Name of the page in its folder."""


class Picture(NamedTuple):
    """A figure of a page."""

    title: str
    svg: bytes
    """An SVG document; a browser shows it as an image, in which no script runs and nothing is fetched."""
    caption: str = ""

    @property
    def data(self) -> str:
        """The document as base64, for a data URL."""
        return base64.b64encode(self.svg).decode()


@cache
def _environment(folder: Path | None) -> Environment:
    own = PackageLoader("torquebench.report")
    loader = own if folder is None else ChoiceLoader([FileSystemLoader(folder), own])
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def render(template: str, *, figures: Sequence[Picture], folder: Path | None = None, **content: Any) -> bytes:
    """Return a page; text is escaped, figures are images.

    Args:
        template: Name of a file in ``templates``, without its endings.
        figures: The figures, in order.
        folder: Where else to look for templates.
        content: What the template names.
    """
    return _environment(folder).get_template(f"{template}.html.j2").render(figures=figures, **content).encode()
