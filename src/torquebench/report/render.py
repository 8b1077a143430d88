"""From a template and its content to a page; the same content gives the same bytes."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

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
def _environment() -> Environment:
    loader = PackageLoader("torquebench.report")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def render(template: str, *, figures: Sequence[Picture], **content: Any) -> bytes:
    """Return a page; text is escaped, figures are images.

    Args:
        template: Name of a file in ``templates``, without its endings.
        figures: The figures, in order.
        content: What the template names.
    """
    return _environment().get_template(f"{template}.html.j2").render(figures=figures, **content).encode()
