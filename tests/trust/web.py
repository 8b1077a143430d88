"""Texts of users in pages: none becomes markup, and no script runs that is not the page's own."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any

from trust.rows import Unavailable, row
from trust.workshop import EXPERIMENT, SWEEP, Workshop

from torquebench.report.render import web_file
from torquebench.shipped import data_root

PAYLOADS = (
    "<script>pwned=1</script>",
    "</script><script>pwned=1</script>",
    '"><img pwned src=x onerror=pwned=1>',
    "' pwned onmouseover='pwned=1' autofocus onfocus='pwned=1",
    'x" pwned="',
    "javascript:pwned=1",
    "data:text/html,<script>pwned=1</script>",
    "</title></style></svg></table></pre></code><svg pwned onload=pwned=1>",
    "<!--pwned <script>",
    "-->]]><script>pwned=1</script>",
    "{{ 7 * 7 }}{% include 'base.html.j2' %}{#",
    "&lt;script&gt;pwned=1&lt;/script&gt; &#60;pwned&#62; &amp",
    '<a pwned href="javascript:pwned=1">x</a><a pwned href=" jAvAsCrIpT&colon;pwned=1">y</a>',
    '<meta pwned http-equiv="refresh" content="0;url=javascript:pwned=1"><base pwned href="//other.invalid/">',
    "<iframe pwned srcdoc='<script>parent.pwned=1</script>'></iframe><object pwned data=javascript:pwned=1>",
    "<math><mtext><table><mglyph><style><!--</style><img title='--&gt;&lt;img pwned src=x onerror=pwned=1&gt;'>",
    "<form pwned action=javascript:pwned=1><button formaction=javascript:pwned=1>",
    "red;pwned:1}body{display:none}</style><link pwned rel=stylesheet href=//other.invalid/x.css>",
    "$\\frac{a}{$ $x_{$ \\url{javascript:pwned=1} $$",
    "`${pwned=1}` \\u003cscript\\u003epwned=1\\u003c/script\\u003e",
    "\u2066<svg pwned><animate onbegin=pwned=1 attributeName=x dur=1s>",
)
"""Texts that would leave a mark named pwned: a variable, an element, an attribute, a style, a link or a comment."""
PLUGIN = '''\
"""Of a user: {text}"""
from typing import Annotated, NamedTuple
import numpy as np
from torquebench import Array, Gain, controller, figure
from torquebench.metrics import metric
class Gains(NamedTuple):
    k: Annotated[Array, Gain({text!r}, {text!r})]
def _law(gains, model, t, q, qd, ref, memory, tau):
    tau[:] = 0
    if t > 0.2:
        raise ValueError({text!r})
_law.__doc__ = {text!r}
controller("raises", gains=Gains)(_law)
@metric("own", title={text!r}, unit={text!r}, meaning={text!r}, column={text!r})
def own(run):
    """A metric."""
    return np.ones(run.e.shape[1])
@figure("own", title={text!r})
def draw(x):
    """A figure."""
    from torquebench.report.figures.layout import new_page
    page = new_page(1, 3.0, 3.0)
    page.add_subplot().set_title({text!r}, parse_math=False)
    return x.finish(page, lambda run: {text!r})
'''
RAISES = "  - {name: raises, law: raises, expect: failed, gains: {k: 1}}\nreference"
ENTERS = "  - {name: raises, law: raises, gains: {k: 1}}\nreference"
AUDIT = """
audit:
  paper: {title: {text}, authors: {text}, published: {text}, year: 1999}
  open: [{text}]
  draws: 2
  conditions: {chain: {ideal: {chain: ideal}}}
  claims:
    removes:
      says: {text}
      where: {text}
      quoted: {text}
      pairs: {band: [pd, band]}
      measures: [{figure: rmse, as: ratio, below: 0.5, why: {text}}]
      under: {chain: all}
"""
ARENA = """
arena:
  laws: listed
  chains: {slow: {chain: slow}}
  training: {sine: {}}
  burdens: {nominal: {}}
  levels: [20 %]
  sampler: random
  evaluations: 2
  seeds: 2
  draws: 2
"""
FRAME = """(() => {
  const page = new DOMParser().parseFromString(%s, "text/html"), all = [...page.querySelectorAll("*")];
  const rule = "meta[http-equiv=Content-Security-Policy]", policy = page.querySelector(rule);
  const links = ["href", "src", "action", "formaction", "data", "srcdoc"];
  const had = (x, name) => x.getAttribute(name) ?? "", odd = (name) => /pwned|^on/.test(name);
  const marked = all.filter((x) => x.tagName === "PWNED" || had(x, "style").includes("pwned")
    || (x.tagName === "STYLE" && x.textContent.includes("pwned")) || x.getAttributeNames().some(odd));
  return { marked: marked.map((x) => x.outerHTML.slice(0, 200)), policy: policy?.content ?? "",
    before: all.slice(0, all.indexOf(policy)).map((x) => x.tagName),
    comments: page.evaluate("count(//comment())", page).numberValue, said: page.body.textContent.includes(%s),
    links: all.flatMap((x) => links.filter((name) => x.hasAttribute(name)).map((name) => had(x, name))),
    scripts: all.filter((x) => x.tagName === "SCRIPT" && x.type !== "application/json").map((x) => x.textContent) };
})()"""
POLICY = {
    "default-src": "'none'",
    "style-src": "'unsafe-inline'",
    "img-src": "data:",
    "media-src": "data:",
    "base-uri": "'none'",
    "form-action": "'none'",
}
"""What a page may: its own styles, and pictures that it carries; scripts by their digests are apart."""
LINK = re.compile(r"data:(,|image/svg\+xml;base64,.*|video/mp4;base64,.*)|#[\w-]*|[\w.%/-]+", re.DOTALL)
"""Where a page may lead: into itself, to what it carries, and to files of its folder."""
LIVE = ("script", "foreignobject", "a", "iframe", "animate", "set")
"""Elements of a picture that could run, lead elsewhere, or hold a page."""
CELL = "cell of a notebook.html"
"""Name of a file with what a notebook shows; its page has no policy of ours."""
SHOWN = {
    "run": ("torquebench.results", "load_result"),
    "sweep": ("torquebench.sweeps", "load_sweep"),
    "audit": ("torquebench.audits", "read_audit"),
}
"""What a command leaves that a notebook can show -> who reads it."""
OWN = {web_file(f"{name}.js") for name in ("libraries/uplot", "libraries/three", "page", "run", "sweep")}


@row("web", "No text of a config, arm, plug-in or file becomes markup in a page; only its own scripts run.", 6, 500)
def attack_pages(shop: Workshop, tries: int) -> Iterator[str]:
    """Markup, quotes, links as texts and names of files and joints; what Chromium makes of pages and notebook cells."""
    sys.path.append(str(data_root()))
    from tests.browser import chromium

    if chromium.program() is None:
        raise Unavailable("Chromium is not installed")
    kinds = ["run", "report", "sweep", "why", "audit", "arena"]
    with chromium.Chromium(shop.folder / "chromium", "--disable-3d-apis") as browser:
        for number in range(tries):
            kind, text = kinds[number % len(kinds)], " ".join(shop.random.sample(PAYLOADS, shop.random.randrange(1, 6)))
            pages = _pages(shop, kind, f"{text} <pwned>")
            found = pages if isinstance(pages, str) else ""
            for page in () if found else pages:
                found = found or looked_at(browser, Path(page), f"{text} <pwned>" if kind == "run" else "")
            yield f"{kind} with {text}: {found}" if found else ""


def _pages(shop: Workshop, kind: str, text: str) -> list[Path] | str:
    """Return the pages that a command leaves where all texts are this one, or what was wrong with the command."""
    name = re.sub(r"[/\0]", "", text)[:60]
    folder = shop.absent("web") / f"in {name}"
    folder.mkdir(parents=True)
    plugin, arm, config, out = folder / f"law {name}.py", folder / f"{name}.xml", folder / f"{name}.yaml", folder / name
    plugin.write_text(PLUGIN.format(text=text).replace(f'user: {text}"""', 'user."""'), encoding="utf-8")
    body = (data_root() / "models/two-link/two-link.xml").read_text(encoding="utf-8")
    for joint in ("shoulder", "elbow"):
        body = body.replace(f'"{joint}"', escape(joint + " " + text).join('""'))
    arm.write_text(body, encoding="utf-8")
    said = json.dumps(text)
    short = EXPERIMENT.replace("two-link", json.dumps(str(arm))).replace("1.2", "0.7")
    more_laws = {"run": RAISES, "report": RAISES, "arena": ENTERS}
    short = f"description: {said}\n" + short.replace("reference", more_laws.get(kind, "reference"))
    more = {"run": "figures: [own, error]\n", "sweep": SWEEP.replace("draws: 6", "draws: 2"), "audit": AUDIT} | {
        "arena": ARENA
    }
    config.write_text(short + more.get(kind, "").replace("{text}", said), encoding="utf-8")
    line: dict[str, list[str | Path]] = {
        "run": ["run", config, "--plugin", plugin, "--out", out],
        "report": ["run", config, "--plugin", plugin, "--out", out, "--no-figures"],
        "sweep": ["sweep", config, "--plugin", plugin, "--out", out, "--executor", "threads"],
        "why": ["why", config, "--out", folder / f"{name}.html"],
        "audit": ["audit", config, "--out", out],
        "arena": ["arena", config, "--plugin", plugin, "--out", out],
    }
    done = shop.command(*line[kind], limit=300.0)
    if "\u2066" in text:  # what turns the direction of text round is refused
        return done.fault(2) or []
    if fault := done.fault(0, 1):
        return fault
    if kind == "report":
        page = folder / f"{name}.html"
        other = shutil.copytree(out, folder / f"other {name}")
        done = shop.command("report", out, other, "--plugin", plugin, "--out", page)
        return done.fault(0) or [page]
    pages = [folder / f"{name}.html"] if kind == "why" else [out / "report.html"]
    if kind in SHOWN:
        pages.append(folder / CELL)
        process = shop.context.Process(target=_show, args=(kind, out, plugin, pages[-1]))
        process.start()
        process.join()
        if process.exitcode:
            return f"no notebook cell: exit status {process.exitcode}"
    return pages + sorted(out.glob("figures/*.svg"))


def _show(kind: str, out: Path, plugin: Path, cell: Path) -> None:
    """Write what a notebook shows of a stored result, in a process of its own, which the plug-in may change."""
    module, name = SHOWN[kind]
    shown = getattr(import_module(module), name)(out, () if kind == "audit" else (plugin,))
    cell.write_text(shown._repr_html_(), encoding="utf-8")


def looked_at(browser: Any, page: Path, said: str) -> str:
    """Return what is wrong with a page or a picture, as the browser parses it and, a page, runs it."""
    from tests.browser.chromium import Page

    text = page.read_text(encoding="utf-8")
    if page.suffix == ".svg":
        return _drawn(text)
    tab = Page(browser)
    frame = tab.value(FRAME % (json.dumps(text), json.dumps(said)))
    tab.go(page.as_uri())
    ran, complaints = tab.value("typeof pwned"), list(tab.complaints)
    asked = [request for request in tab.requests if not request.startswith("data:") and request != page.as_uri()]
    tab.close()
    found = _fragment(frame) if page.name == CELL else _policed(frame)
    if not found and (ran != "undefined" or complaints or asked):
        found = f"ran {ran}, complained {str(complaints)[:200]}, asked for {asked}"
    return f"{page.name}: {found}" if found else ""


def _fragment(frame: Mapping[str, Any]) -> str:
    """Return what is wrong with a cell: markup of the user's, a script, or a link."""
    live = frame["marked"] or frame["scripts"] or frame["links"] or frame["comments"]
    return f"markup: {frame['marked'][:2]}, scripts {frame['scripts'][:1]}, links {frame['links'][:2]}" if live else ""


def _policed(frame: Mapping[str, Any]) -> str:
    """Return what is wrong with a page's elements, policy, scripts and links."""
    rules = dict(rule.strip().split(" ", 1) for rule in frame["policy"].split(";") if rule.strip())
    allowed = rules.pop("script-src", "").split()
    digests = [base64.b64encode(hashlib.sha256(own.encode()).digest()).decode() for own in frame["scripts"]]
    if frame["marked"] or frame["comments"] or not frame["said"]:
        return f"markup: {frame['marked'][:2]}, {frame['comments']} comments, the text itself {frame['said']}"
    if rules != POLICY or not {"HTML", "HEAD", "META"}.issuperset(frame["before"]):
        return f"another policy: {frame['policy'][:300]}, behind {frame['before']}"
    if allowed != [f"'sha256-{digest}'" for digest in digests] or not OWN.issuperset(frame["scripts"]):
        return "a script that is not the package's, or is not named in the policy"
    odd = [link for link in frame["links"] if not LINK.fullmatch(link)]
    return f"links {odd[:2]}" if odd else ""


def _drawn(text: str) -> str:
    """Return what is wrong with a figure's file: anything that could run or fetch."""
    for element in ElementTree.fromstring(text).iter():
        tag = str(element.tag).rpartition("}")[2].lower()
        names = {name.rpartition("}")[2].lower(): value for name, value in element.attrib.items()}
        if tag in LIVE or any(x.startswith("on") for x in names):
            return f"an element {tag} with {sorted(names)}"
        if not names.get("href", "#").startswith(("#", "data:image/png")):
            return f"a reference to {names['href'][:50]}"
    return ""
