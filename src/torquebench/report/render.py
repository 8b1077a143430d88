"""From a template and its content to a page; the same content gives the same bytes."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

PAGE = "report.html"
"""Name of the page in its folder."""


class Picture(NamedTuple):
    """A figure of a page."""

    title: str
    svg: str
    """An SVG document, or the element alone."""
    caption: str = ""

    @property
    def inline(self) -> Picture:
        """The same without what may only stand at the start of a file."""
        return self._replace(svg=self.svg[self.svg.index("<svg") :])


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("torquebench.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )


def render(template: str, *, figures: list[Picture], **content: Any) -> bytes:
    """Return a page; text is escaped, figures are put in as they are.

    Args:
        template: Name of a file in ``templates``, without its endings.
        figures: The figures, in order.
        content: What the template names.
    """
    found = _environment().get_template(f"{template}.html.j2")
    return found.render(figures=[picture.inline for picture in figures], **content).encode()
