"""From a template, its content, data and scripts to a page that stands alone; the same content gives the same bytes."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from jinja2 import Environment

PAGE = "report.html"
"""Name of the page in its folder."""
UPLOT, THREE = "libraries/uplot", "libraries/three"
"""Scripts of others, bundled by ``scripts/web``: charts, and drawing in space."""


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


class Script(NamedTuple):
    """A script of a page, which runs because the page's policy names its digest."""

    text: str
    digest: str


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("torquebench.report")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def web_file(name: str) -> str:
    """Return the text of a file of ``web``."""
    return (files("torquebench.report") / "web" / name).read_text(encoding="utf-8")


@cache
def script(name: str) -> Script:
    """Return a script of ``web`` by its name without its ending."""
    text = web_file(f"{name}.js")
    if "</script" in text.lower() or "<!--" in text:
        raise ValueError(f"{name}.js would end its element")
    return Script(text, base64.b64encode(hashlib.sha256(text.encode()).digest()).decode())


def data_text(data: Mapping[str, Any] | None) -> str:
    """Return data as JSON in which no character means anything to HTML."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def render(
    template: str,
    *,
    figures: Sequence[Picture] = (),
    scripts: Sequence[str] = (),
    data: Mapping[str, Any] | None = None,
    **content: Any,
) -> bytes:
    """Return a page; text is escaped, figures are images, data are never executed, no script but its own runs.

    Args:
        template: Name of a file in ``templates``, without its endings.
        figures: The figures, in order.
        scripts: Scripts of ``web`` in the order in which they run, such as `UPLOT`, ``page``.
        data: JSON that ``page`` reads into its ``DATA``; None for none.
        content: What the template names.
    """
    own = [script(name) for name in scripts]
    style = web_file("libraries/uplot.css") if UPLOT in scripts else ""
    page = _environment().get_template(f"{template}.html.j2")
    return page.render(figures=figures, scripts=own, data=data_text(data), style=style, **content).encode()
