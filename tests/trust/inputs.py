"""Hostile input: configs, misspelt keys, files made to be slow, and arms."""

from __future__ import annotations

import copy
import functools
import gc
import json
import math
import multiprocessing
import random
import re
import string
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from trust.rows import row
from trust.workshop import Workshop

from torquebench.errors import ConfigError, TorquebenchError
from torquebench.experiment.config import parse_experiment
from torquebench.experiment.yaml_tree import MAX_VALUES
from torquebench.shipped import configs, data_root
from torquebench.sweep.plan import Plan, Source

LIMIT = 1.5
"""CPU time within which a config is accepted or refused, over `yardstick`'s: 0.1 s where that takes 65 ms.

A ratio, because other work and the processor's clock change the seconds of one machine by a factor of two.
"""
LARGEST = "".join(f"k{k}: 1\n" for k in range(MAX_VALUES // 2))
"""As many keys with a value as a config may have."""
HANG = 20.0
"""Time after which a child that reads an arm counts as hanging [s]; its first arm compiles."""
SCALARS = (
    "1e308 -1e308 1.7976931348623157e308 -0.0 0 -1 .nan .inf -.inf nan inf 5e-324 1e-300 1e400 2147483648 "
    "9223372036854775808 true false yes no on null ~ '' 1:30 0x10 0o17 017 0b11 1_000 +1 1. .5 2024-01-01 'text' "
    '"\\u0000" "\\x07" "\\U0010FFFF" "\\ud800" é ١٢ １２ ../../etc/passwd /etc/passwd puma560/../puma560 *a [] {} [[]] '
    "[1,2,3] {a:1} {__class__:x} @x `x` %x ${HOME} 0.5 2 10 1e-3 1e-9 3 100 1e5 1e6 1e9 1e12 sign band rk4 mujoco "
    "analytic exact corrected sine step quintic smc pd-gravity two-link puma560 fast slow 30\\ % 1\\ ms"
).split(" ")
SCALARS += [
    "9" * 30,
    "-" + "9" * 120,
    "a" * 3000,
    "'" + "b" * 70000 + "'",
    "{<<: {a: 1}}",
    "!!set {a}",
    "!!binary aGk=",
]
SCALARS += [
    "!!python/object/apply:os.system ['touch pwned']",
    "!<tag:yaml.org,2002:python/object:os.system> x",
    "|\n x",
]
BYTES = (b"\n---\n", b"\n...\n", b"\t", b"\r", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"%YAML 1.1\n", b": ", b"# ", b"'")
BYTES += (b'"', b"{", b"]", b"\xe2\x80\xa8", b"!", b"&a ", b"*a ", b"<<: ")
Node = list[Any]
"""A node of a YAML tree that is written again: its kind and its content."""


@row(
    "configs",
    "A config is accepted, or refused in words and soon (see slow-files); nothing else happens.",
    ci=150,
    release=10_000,
)
def attack_configs(shop: Workshop, tries: int) -> Iterator[str]:
    """Shipped configs with nodes and bytes exchanged, removed, multiplied, nested, retyped, scaled.

    Some ask for `touch pwned`. One try in forty is run for 50 ms of its time, if it is accepted. How long it takes to
    refuse a tool's path is not judged: it is turned into joint motions first.
    """
    bases = [(file.name, file.read_text(encoding="utf-8"), file) for file in configs().values()]
    trees = [_tree(yaml.compose(text)) for _, text, _ in bases]
    pool = [node for tree in trees for node in _nodes(tree)]
    for _, text, file in bases:  # imports and tables that are made once
        _read(text.encode(), file)
    for number in range(tries):
        chosen = shop.random.randrange(len(bases))
        name, text, file = bases[chosen]
        mutant = _mutant(shop.random, text, copy.deepcopy(trees[chosen]), pool)
        found, experiment = _read(mutant, file)
        hurried = not found and experiment is None and b"tool-" not in mutant
        if hurried:
            found = _slow(lambda m=mutant, f=file: _read(m, f))
        if not found and experiment is not None and number % 40 == 0:
            found = _run(mutant, str(file))
        if Path("pwned").exists():
            found = "code was run"
        yield f"{name}, try {number}: {found}" if found else ""


def _read(text: bytes, file: Path) -> tuple[str, Any]:
    """Return what was wrong with how a config was met, and the experiment where it was accepted."""
    try:
        if b"sweep" in text:
            return "", Plan(Source(text, str(file))).first
        return "", parse_experiment(text, str(file))
    except ConfigError as error:
        return (f"a message of {len(str(error)):,} characters" if len(str(error)) > 25_000 else ""), None
    except Exception as error:  # noqa: BLE001  any other exception is what is looked for
        return f"{type(error).__name__}: {error}"[:300], None


def _slow(read: Callable[[], object]) -> str:
    """Return in words that a reading takes too long in each of three tries, beside a yardstick of that instant."""
    ratio = _seconds(read) / _usual_yardstick()
    for _ in range(2):
        if ratio > LIMIT:
            ratio = min(ratio, _seconds(read) / _seconds(yardstick))
    return f"{ratio:.1f} times as long as PyYAML takes to load {MAX_VALUES:,} values" if ratio > LIMIT else ""


def yardstick() -> None:
    """Load the largest mapping with PyYAML alone."""
    yaml.load(LARGEST, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


@functools.cache
def _usual_yardstick() -> float:
    return min(_seconds(yardstick) for _ in range(5))


def _seconds(work: Callable[[], object]) -> float:
    """Return the CPU time of some work [s]."""
    before = time.process_time()
    work()
    return time.process_time() - before


def _run(text: bytes, file: str) -> str:
    """Return what was wrong with a run of an accepted config."""
    from torquebench.experiment.run import run_experiment

    try:
        short = parse_experiment(text, file, ["run.duration=0.05", "run.metrics_from=0"])
        if short.run.duration / short.plant.timestep > 1000:
            return ""
        result = run_experiment(short)
        json.dumps([metrics.to_json() for metrics in result.metrics.values()], allow_nan=False)
    except (ConfigError, TorquebenchError):
        return ""
    except Exception as error:  # noqa: BLE001  any other exception is what is looked for
        return f"when run: {type(error).__name__}: {error}"[:300]
    return ""


def _tree(node: Any) -> Node:
    if isinstance(node, yaml.MappingNode):
        return ["map", [[key.value, _tree(value)] for key, value in node.value]]
    if isinstance(node, yaml.SequenceNode):
        return ["seq", [_tree(value) for value in node.value]]
    plain = not node.style and not set(node.value) & set(",:[]{}#'\"")
    return ["raw", node.value if plain else json.dumps(node.value)]


def _text(node: Node) -> str:
    if node[0] == "map":
        return "{" + ", ".join(f"{key}: {_text(value)}" for key, value in node[1]) + "}"
    return "[" + ", ".join(map(_text, node[1])) + "]" if node[0] == "seq" else str(node[1])


def _nodes(node: Node) -> list[Node]:
    children = [value for _, value in node[1]] if node[0] == "map" else node[1] if node[0] == "seq" else []
    return [node, *(deeper for child in children for deeper in _nodes(child))]


def _mutant(draw: random.Random, text: str, tree: Node, pool: list[Node]) -> bytes:
    """Return a config's text with something exchanged."""
    if draw.random() < 0.15:
        return _bytes(draw, text.encode())
    if draw.random() < 0.35:  # numbers alone: most are accepted
        numbers = [node for node in _nodes(tree) if node[0] == "raw" and _is_number(node[1])]
        for node in draw.sample(numbers, min(len(numbers), draw.choice([1, 1, 2, 6]))):
            node[1] = repr(float(node[1]) * 10.0 ** draw.choice([-300, -12, -3, -1, 0.3, 1, 3, 20, 150]))
        return _text(tree).encode()
    for _ in range(draw.choice([1, 1, 1, 2, 3])):
        _mutate(draw, tree, pool)
    return _text(tree).encode("utf-8", "surrogatepass")


def _mutate(draw: random.Random, tree: Node, pool: list[Node]) -> None:
    nodes = _nodes(tree)
    node, kind = draw.choice(nodes), draw.randrange(10)
    pairs = node[1] if node[0] == "map" and node[1] else None
    if kind < 4:
        leaves = [leaf for leaf in nodes if leaf[0] == "raw"]
        draw.choice(leaves or [node])[:] = ["raw", draw.choice(SCALARS)]
    elif kind == 4 and pairs:
        pairs.pop(draw.randrange(len(pairs)))
    elif kind == 5 and pairs:
        pair = draw.choice(pairs)
        pair[0] = draw.choice(
            [misspelt(draw, pair[0]), "<<", "[a]", "&k " + pair[0], "1", "null", "a" * 5000, "\u202e"]
        )
    elif kind == 6 and pairs:
        pairs += [copy.deepcopy(draw.choice(pairs)), [f"k{draw.random()}", ["raw", "1"]]] * draw.choice([1, 1, 1000])
    elif kind == 7 and node[0] == "seq" and node[1]:
        node[1] += [copy.deepcopy(draw.choice(node[1])) for _ in range(draw.choice([1, 5, 60, 1000]))]
    elif kind == 8:
        depth = draw.choice([2, 31, 40, 500, 5000])
        node[:] = [
            "raw",
            "[" * depth + "1" + "]" * depth if draw.random() < 0.5 else "{a: " * depth + "1" + "}" * depth,
        ]
    else:
        node[:] = copy.deepcopy(draw.choice(pool))


def _bytes(draw: random.Random, text: bytes) -> bytes:
    changed = bytearray(text)
    for _ in range(draw.choice([1, 1, 2, 8])):
        place = draw.randrange(len(changed) + 1)
        new = bytes([draw.randrange(256)]) if draw.random() < 0.3 else draw.choice(BYTES)
        changed[place : place + draw.choice([0, 0, 1, 5, 200])] = new
    return bytes(changed)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def misspelt(draw: random.Random, word: str) -> str:
    """Return a word with a letter left out, added, exchanged, or two of them swapped."""
    i, letter = draw.randrange(len(word)), draw.choice(string.ascii_lowercase)
    swapped = word[:i] + word[i : i + 2][::-1] + word[i + 2 :]
    return draw.choice(
        [word[:i] + word[i + 1 :], word[:i] + letter + word[i + 1 :], word[:i] + letter + word[i:], swapped]
    )


@row("typos", "A key with one wrong letter is refused, and the right key is offered.", ci=60, release=2500)
def attack_spelling(shop: Workshop, tries: int) -> Iterator[str]:
    """One letter of one key of a shipped config left out, added, exchanged or swapped."""
    texts = [(name, re.sub(r"#.*", "", file.read_text(encoding="utf-8"))) for name, file in configs().items()]
    texts = [
        (name, text)
        for name, text in texts
        if not re.search(r"^\w*(sweep|audit|tune|arena|falsify|extends)", text, re.M)
    ]
    done = 0
    while done < tries:
        name, text = shop.random.choice(texts)
        key = shop.random.choice(list(re.finditer(r"[{,\s]([a-z_]{4,})\s*:\s", text)))
        word, wrong = key[1], misspelt(shop.random, key[1])
        if wrong == word:
            continue
        done += 1
        try:
            parse_experiment(text[: key.start(1)] + wrong + text[key.end(1) :], name)
            yield f"{name}: {word} -> {wrong} accepted"
        except ConfigError as error:
            yield "" if f"did you mean '{word}'" in str(error) else f"{name}: {word} -> {wrong}: no word of {word}"


@row(
    "slow-files",
    f"A file of mistakes is refused within {LIMIT} times the CPU time in which PyYAML loads {MAX_VALUES:,} values.",
    ci=20,
    release=40,
)
def attack_patience(shop: Workshop, tries: int) -> Iterator[str]:
    """Thousands of keys, list items, controllers; deep nesting; digits and scalars of a megabyte; deep dotted keys."""
    text, sweep = shop.config.read_text(encoding="utf-8"), shop.sweep_config.read_text(encoding="utf-8")
    law = "  - {name: c%d, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}\n"
    many = "".join(law % k for k in range(5000))
    misspelt_law = "  - {nme: c%d, law: smcc, swtching: sign, gans: {lam: 10, k: 0.3}}\n"
    wrong = "".join(misspelt_law % k for k in range(60))
    files = {
        "20,000 keys": text + "".join(f"k{k}: 1\n" for k in range(20_000)),
        "5,500 keys": text + "".join(f"k{k}: 1\n" for k in range(5500)),
        "20,000 keys near one": text + "".join(f"disturbance{k}: 1\n" for k in range(20_000)),
        "a key of 900 kB": text + "d" * 900_000 + ": 1\n",
        "100 keys of 9 kB": text + "".join(f"{'d' * 9000}{k}: 1\n" for k in range(100)),
        "a law's name of 900 kB": text.replace("pd-gravity", "'" + "s" * 900_000 + "'"),
        "5,000 controllers": text.replace("controllers:\n", "controllers:\n" + many),
        "60 controllers with four mistakes each": text.replace("controllers:\n", "controllers:\n" + wrong),
        "the same key 12,000 times": text + "x: 1\n" * 12_000,
        "a list of 300,000": text + "disturbances: [" + "1," * 300_000 + "]\n",
        "a megabyte of [": text + "z: " + "[" * 1_000_000,
        "a megabyte of -": text + "z:\n " + "- " * 400_000,
        "a megabyte of {": text + "z: " + "{a: " * 200_000,
        "a megabyte of anchors": text + "z: " + "&a " * 300_000,
        "a megabyte of comment": text + "#" * 1_000_000,
        "a megabyte of escapes": text + 'z: "' + "\\x41" * 250_000 + '"',
        "a folded megabyte": text + "z: >\n" + " x\n" * 340_000,
        "900,000 digits": text.replace("seed: 3", "seed: " + "9" * 900_000),
        "an exponent of 900,000 digits": text.replace("seed: 3", "seed: 1e" + "9" * 900_000),
        "64 disturbances": text
        + "disturbances: ["
        + "{kind: band-limited-noise, sigma: 1, cutoff_hz: 20}," * 64
        + "]\n",
        "a run of 11 days": text.replace("1.2", "1e6"),
        "a delay of 11 days": text + "chain: {delay: 1000000}\n",
        "a million draws": sweep.replace("draws: 6", "draws: 1000000"),
        "a grid of 20,000": sweep.replace("[0, 0.2, 0.4]", "[" + ",".join(map(str, range(20_000))) + "]"),
        "1,000 swept keys": sweep + "".join(f"    controllers[{k}].gains.k: [1]\n" for k in range(1000)),
        "a swept key of 2,000 parts": sweep.replace("plant.payload.mass", ".".join(["a"] * 2000)),
    }
    cases: dict[str, Callable[[], object]] = {
        name: lambda t=t: _read(t.encode(), Path("f")) for name, t in files.items()
    }  # type: ignore[misc]
    sets = {
        "2,000 edits": [f"run.duration={k + 5}" for k in range(2000)],
        "1,000 edits of unknown keys": [f"k{k}=1" for k in range(1000)],
        "1,000 edits of unknown controllers": [f"controllers.c{k}.gains.k=1" for k in range(1000)],
        "a far index": ["controllers[999999].name=1"],
    }
    sets |= {"an edit 30,000 deep": [".".join(["a"] * 30_000) + "=1"], "an edit of 60 kB": ["run.seed=" + "[" * 60_000]}
    cases |= {name: lambda s=s: _edited(text, s) for name, s in sets.items()}  # type: ignore[misc]
    _read(text.encode(), Path("f"))
    # a user's process has little to collect; this one has what other rows and tests left
    gc.collect()
    gc.freeze()
    try:
        for name, read in (
            list(cases.items())[:tries] if tries >= len(cases) else shop.random.sample(list(cases.items()), tries)
        ):
            found = _slow(read)
            yield f"{name}: {found}" if found else ""
    finally:
        gc.unfreeze()


def _edited(text: str, edits: list[str]) -> None:
    try:
        parse_experiment(text, "f", edits)
    except ConfigError:
        return


NUMBERS = "nan inf -inf 1e308 -1 0 -0.0 1e-320 1e-30 1e30 1e15 1e-12 x 1e400 0x10 1,5 99999999999999999999".split()
NUMBERS += ["", "1 2", "nan nan nan", "0 0 0", "-1 -1 -1", "true", "free", "ball", "slide", "mesh"]
ATTRIBUTES = (
    "mass density armature range limited type axis diaginertia fullinertia pos quat size gear damping stiffness "
    "frictionloss ref springref file class euler timestep gravity actuatorfrcrange user nkey count"
).split()
TAGS = "include plugin freejoint frame inertial site flexcomp composite size tendon equality".split()


@row(
    "arms",
    "An MJCF file is refused in words, or both plants are finite on it, with one mass matrix.",
    ci=60,
    release=2000,
)
def attack_arms(shop: Workshop, tries: int) -> Iterator[str]:
    """Shipped arms with elements and attributes exchanged, removed, multiplied, and bytes altered, each in a child."""
    bases = [ElementTree.parse(path).getroot() for path in sorted((data_root() / "models").glob("*/*.xml"))]
    context = multiprocessing.get_context("forkserver")
    done = 0
    while done < tries:
        batch = []
        for _ in range(min(30, tries - done)):
            path = shop.folder / f"arm-{done}.xml"
            path.write_bytes(_arm(shop.random, copy.deepcopy(shop.random.choice(bases))))
            batch.append(path)
            done += 1
        while batch:
            ours, theirs = context.Pipe()
            child = context.Process(target=_read_arms, args=([str(path) for path in batch], theirs))
            child.start()
            theirs.close()
            while batch:
                try:
                    found = ours.recv() if ours.poll(HANG) else "no answer"
                except EOFError:
                    child.join()
                    found = f"the process died: {child.exitcode}"
                path = batch.pop(0)
                yield f"{path.name}: {found}" if found else ""
                if found.startswith(("no answer", "the process died")):
                    break
                path.unlink()
            child.kill()
            child.join()


def _arm(draw: random.Random, root: ElementTree.Element) -> bytes:
    for _ in range(draw.choice([1, 1, 2, 3])):
        elements = list(root.iter())
        element, kind = draw.choice(elements), draw.randrange(7)
        if kind < 3 and element.attrib:
            element.set(draw.choice(list(element.attrib)), draw.choice(NUMBERS))
        elif kind == 3 and len(element):
            element.remove(draw.choice(list(element)))
        elif kind == 4:
            element.append(copy.deepcopy(draw.choice([x for x in elements if len(list(x.iter())) < 60])))
        elif kind == 5:
            element.set(draw.choice(ATTRIBUTES), draw.choice(NUMBERS))
        else:
            element.tag = draw.choice([x.tag for x in elements] + TAGS)
    text = bytearray(ElementTree.tostring(root))
    for _ in range(draw.choice([0, 0, 0, 0, 1, 5])):
        text[draw.randrange(len(text))] = draw.randrange(256)
    return bytes(text)


def _read_arms(paths: list[str], answers: Any) -> None:
    """Send for each arm what was wrong with how it was met; in a child."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for path in paths:
        answers.send(_met(Path(path)))


def _met(path: Path) -> str:
    from torquebench.robot import load_model
    from torquebench.sim.plants.mujoco import MujocoModel, MujocoPlant

    def plant() -> tuple[np.ndarray, np.ndarray]:
        arm = MujocoPlant(path, timestep=0.001, integrator="rk4")
        rest = np.zeros(arm.n)
        arm.reset(rest, rest)
        for k in range(20):
            arm.step(arm.tau_max * 0.1 * np.sin(k + np.arange(arm.n)), 1)
        return arm.state()[0], MujocoModel(path).mass_matrix(rest[None])[0]

    def model() -> tuple[np.ndarray, np.ndarray]:
        arm = load_model(path)
        rest = np.zeros(arm.n)
        return arm.forward_dynamics(rest, rest, rest), arm.mass_matrix(rest[None])[0]

    found: list[tuple[np.ndarray, np.ndarray] | None] = []
    for read in (plant, model):
        try:
            found.append(read())
        except TorquebenchError:
            found.append(None)
        except Exception as error:  # noqa: BLE001  any other exception is what is looked for
            return f"{read.__name__}: {type(error).__name__}: {error}"[:300]
    if found[0] is None or found[1] is None:
        return ""  # one side may know less than the other
    if not all(np.all(np.isfinite(x)) for pair in found if pair for x in pair):
        return "numbers that are not finite"
    (_, theirs), (_, ours) = found[0], found[1]
    apart = float(np.max(np.abs(theirs - ours)) / np.max(np.abs(theirs)))
    return f"mass matrices differ by {apart:.1g}" if apart > 1e-9 else ""
