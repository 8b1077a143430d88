"""The YAML subset means what it seems to mean, and whatever cannot be read is refused in one clear line."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.experiment.examples import GOOD, edited
from torquebench.errors import ConfigError
from torquebench.experiment import load_experiment, parse_experiment, yaml_tree
from torquebench.experiment.source import MAX_BYTES, Document, read_document
from torquebench.experiment.yaml_tree import BROKEN, MAX_DEPTH, MAX_VALUES, parse_value, resolve

SCALARS: list[tuple[str, object]] = [
    ("true", True),
    ("false", False),
    ("null", None),
    ("~", None),
    ("", None),
    ("0", 0),
    ("7", 7),
    ("-7", -7),
    ("+7", 7),
    ("1e-3", 0.001),
    ("1E3", 1000.0),
    ("1.", 1.0),
    (".5", 0.5),
    ("-0.25", -0.25),
    ("6.02e+23", 6.02e23),
    (".inf", math.inf),
    ("-.INF", -math.inf),
    ("1e999", math.inf),
]
TEXTS = [
    "yes",
    "no",
    "on",
    "off",
    "y",
    "n",
    "True",
    "FALSE",
    "Null",
    "NULL",
    "010",
    "-01",
    "00",
    "1:30",
    "1_000",
    "0x1f",
    "0o17",
    "0b1",
    "1e",
    "e3",
    "1.2.3",
    "--1",
    "+",
    "-",
    ".",
    "nan",
    "inf",
    "2024-01-01",
    "1,5",
    "=",
    "١",
]


def refusal(text: str | bytes) -> list[str]:
    """Return the messages with which a config is refused."""
    with pytest.raises(ConfigError) as caught:
        parse_experiment(text, "bad.yaml")
    return [str(problem) for problem in caught.value.problems]


def read(text: str) -> Any:
    """Return the value of a YAML text that must have no mistakes."""
    document = Document("some.yaml")
    value, _ = parse_value(text, document.add)
    document.raise_problems()
    return value


@pytest.mark.parametrize("text", [text for text in [*dict(SCALARS), *TEXTS] if yaml_tree._PLAIN.fullmatch(text)])
def test_a_value_that_needs_no_parser_is_what_the_parser_makes_of_it(text):
    """With a blank before it the parser reads it; the value and its type are the same."""
    direct, parsed = (parse_value(before + text, Document("f.yaml").add)[0] for before in ("", " "))
    assert (direct, type(direct)) == (parsed, type(parsed))


@pytest.mark.parametrize(("text", "value"), SCALARS)
def test_unquoted_scalars_that_are_not_text(text: str, value: object) -> None:
    """Numbers, true, false and null are recognised, of exactly the expected type."""
    assert resolve(text) == value
    assert type(resolve(text)) is type(value)
    if text:
        assert read(f"[{text}]") == [value]


@pytest.mark.parametrize("text", TEXTS)
def test_everything_else_is_text(text: str) -> None:
    """What YAML 1.1 or a human might take for a boolean, an octal, a time or a date stays text."""
    assert resolve(text) == text


@pytest.mark.parametrize("quote", ["'", '"'])
@pytest.mark.parametrize("text", ["true", "7", "0.5", "null", ".nan", "<<"])
def test_quoted_scalars_are_text(text: str, quote: str) -> None:
    """Quotes make text of anything."""
    assert read(f"{quote}{text}{quote}") == text


def test_nan_is_a_number_that_later_checks_refuse() -> None:
    """``.nan`` is read as the float, so that the message can say it is not finite."""
    assert math.isnan(read(".nan"))


def test_integers_keep_every_digit_and_huge_ones_are_no_integers() -> None:
    """A seed is read exactly; a number of thousands of digits does not reach Python's integer limit."""
    assert read("9223372036854775807") == 2**63 - 1
    assert isinstance(read("9" * 10_000), float)


def test_nested_values_and_places() -> None:
    """Flow and block style give the same tree, and each key and value knows its line and column."""
    document = read_document("a:\n  - {b: 1,  c: x}\n  - [2]\n", "f.yaml")
    assert document.root["a"] == [{"b": 1, "c": "x"}, [2]]
    assert document.where(document.place(("a", 0, "c"), "key")) == "f.yaml:2:13"
    assert document.where(document.place(("a", 0, "c"))) == "f.yaml:2:16"
    assert document.where(document.place(("a", 1, 0))) == "f.yaml:3:6"
    assert document.where(document.place(("a", 1, 5, "missing"))) == "f.yaml:3:5"


def test_byte_order_mark_and_windows_line_ends_are_tolerated() -> None:
    """A file saved by a Windows editor reads the same, and its lines are counted the same."""
    windows = b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode()
    assert parse_experiment(windows, "w.yaml") == parse_experiment(GOOD, "g.yaml")
    bad = edited("seed: 7", "seed: x")
    assert refusal(bad.replace("\n", "\r\n")) == refusal(bad)


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "---\n", "null", "~"])
def test_empty_files_are_refused(text: str) -> None:
    """A file without content is called empty."""
    assert refusal(text) == ["bad.yaml: is empty, wanted a mapping with name, plant, controllers ..."]


@pytest.mark.parametrize("text", ["- a\n- b\n", "just text", "5", "[]", "true"])
def test_top_level_must_be_a_mapping(text: str) -> None:
    """Anything but a mapping at the top is refused at its place."""
    assert refusal(text) == ["bad.yaml:1:1: wanted a mapping (name: ..., plant: ...) at the top level"]


def test_several_documents_are_refused() -> None:
    """The second document is pointed at; its content is not looked into."""
    found = refusal(GOOD + "---\nname: other\n")
    assert len(found) == 1
    assert found[0].startswith(f"bad.yaml:{GOOD.count(chr(10)) + 1}:1: a second YAML document")


@pytest.mark.parametrize(
    ("data", "offset"),
    [(b"name: \xff", 6), (b"\x80", 0), ("name: é".encode("latin-1"), 6), (b"\xff\xfen\x00", 0)],
)
def test_bytes_that_are_not_utf8_are_refused_with_their_offset(data: bytes, offset: int) -> None:
    """Other encodings are refused, naming the first byte that is not UTF-8."""
    assert refusal(data) == [f"bad.yaml: is not UTF-8 text (byte offset {offset})"]


@pytest.mark.parametrize("code", [0x00, 0x08, 0x1B, 0x7F, 0x85, 0x9F, 0x2028, 0x202E, 0xD800, 0xFEFF, 0xFFFE])
def test_control_characters_are_refused_at_their_place(code: int) -> None:
    """Characters that editors hide, or take for line ends, are refused raw and as an escape."""
    assert refusal(f"name: good\nab: x{chr(code)}") == [f"bad.yaml:2:6: has the control character U+{code:04X}"]
    if code != 0xD800:  # which the YAML parser refuses itself
        escaped = refusal(edited("every section, one key per line", f'"\\u{code:04x}"'))
        assert escaped == [f"bad.yaml:2:14: description: has the control character U+{code:04X}"]


def test_alias_bomb_is_refused_without_being_expanded() -> None:
    """Nested aliases worth 10^9 values, which would take hours and all memory: each is a mistake by itself."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    found = refusal("\n".join(lines))
    assert "bad.yaml:1:5: a0: anchors are not accepted; remove &a0" in found
    assert "bad.yaml:2:10: a1[0]: aliases (*name) are not accepted; write the value out" in found


def test_merge_keys_do_not_merge() -> None:
    """``<<`` is refused, and an anchor it would copy from too."""
    found = refusal(edited("  seed: 7", "  <<: {seed: 8}\n  seed: 7"))
    assert found == ["bad.yaml:46:3: run: merge keys (<<) are not accepted; write the keys out"]


@pytest.mark.parametrize("tag", ["!!python/object/apply:os.system", "!!python/name:os.system", "!custom", "!!str"])
def test_tags_are_refused_and_nothing_is_called(tag: str) -> None:
    """No tag is looked at, least of all one that would run a program; the message names it."""
    found = refusal(edited("seed: 7", f"seed: {tag} ['touch x']"))
    assert found == [f"bad.yaml:46:9: run.seed: tags are not accepted; remove '{tag}'"]


@pytest.mark.parametrize(("start", "end"), [("[", "]"), ("{a: ", "}"), ("- ", "")])
def test_depth_is_limited(start: str, end: str) -> None:
    """Values nested a little too deep, or by the hundred thousand, are refused alike."""
    for depth in (MAX_DEPTH + 1, 100_000):
        found = refusal(start * depth + end * depth)
        assert len(found) == 1
        assert f"nested more than {MAX_DEPTH} levels deep" in found[0]
    assert read("[" * MAX_DEPTH + "]" * MAX_DEPTH) is not BROKEN


FLOODS = {
    "keys": "".join(f"k{i}: 1\n" for i in range(90_000)),
    "numbers": "a: [" + "1," * 500_000 + "]",
    "few long": "a: " + "x" * 1_000_000,
    "long key": "? " + "k" * 1_000_000 + "\n: 1\n",
    "vector": GOOD.replace("frequency_hz: 0.75", "frequency_hz: [" + "x," * 49_000 + "]"),
    "gains": GOOD.replace("      kv: 20", "".join(f"      g{i}: 1\n" for i in range(24_000))),
    "colons": ":" * 1_000_000,
    "comments": "# x\n" * 250_000,
    "anchors": "&a " * 300_000,
    "duplicates": "a: 1\n" * 24_000,
}


@pytest.mark.parametrize("name", FLOODS)
def test_large_files_are_refused_in_few_lines(name: str) -> None:
    """Files just under the size limit, of any shape, are refused in few short lines."""
    found = refusal(FLOODS[name])
    assert len(found) <= 101
    assert max(map(len, found)) < 600


def test_number_of_values_is_limited() -> None:
    """One value more than the limit is refused, the limit itself is not."""
    assert len(read("[" + "1," * (MAX_VALUES - 1) + "]")) == MAX_VALUES - 1
    assert refusal("[" + "1," * MAX_VALUES + "]")[0].endswith(f"has more than {MAX_VALUES} values")


def test_size_is_checked_before_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A 2 MiB file is refused by its size alone; it is never opened."""
    path = tmp_path / "big.yaml"
    path.write_bytes(b"#" * (2 << 20))
    monkeypatch.setattr(Path, "open", lambda *args, **kwargs: pytest.fail("opened"))
    with pytest.raises(ConfigError, match=f"is {2 << 20} bytes, at most {MAX_BYTES} are read"):
        load_experiment(path)


def test_size_limit_is_exact(tmp_path: Path) -> None:
    """A file of exactly the limit is read, one byte more is not, from disk or from memory."""
    path = tmp_path / "edge.yaml"
    data = GOOD.encode() + b"#" * (MAX_BYTES - len(GOOD.encode()))
    path.write_bytes(data)
    assert load_experiment(path).name == "good"
    assert "at most" in refusal(data + b"#")[0]


def test_missing_directory_and_special_files_are_refused(tmp_path: Path) -> None:
    """What is not a readable file is refused by name, without waiting for a pipe to be filled."""
    os.mkfifo(tmp_path / "pipe.yaml")
    for path, word in [
        (tmp_path / "none.yaml", "does not exist"),
        (tmp_path, "is a directory"),
        (tmp_path / "pipe.yaml", "not a regular file"),
        (Path("a\0b"), "cannot be read"),
        (tmp_path / ("n" * 300), "cannot be read"),
        (tmp_path / "pipe.yaml" / "below", "cannot be read"),
    ]:
        with pytest.raises(ConfigError, match=word) as caught:
            load_experiment(path)
        assert str(caught.value).isprintable()


def test_unreadable_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system's reason for not opening a file is passed on."""
    path = tmp_path / "secret.yaml"
    path.write_text(GOOD)

    def refuse(*args: object, **kwargs: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(ConfigError, match=r"cannot be read \(Permission denied\)"):
        load_experiment(path)


def test_pythons_own_parser_says_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without PyYAML's C extension the same files are accepted and refused, at the same places."""
    texts = [
        GOOD,
        edited("seed: 7", "seed: x"),
        edited("seed: 7", "seed: &a 7"),
        edited("seed: 7", "seed: !!int 7"),
        edited("  seed: 7", "  seed: 7\n  seed: 8"),
        "[" * 100,
        edited("description: every", r'description: "\Uffffffff"'),
    ]

    def outcomes() -> list[list[str]]:
        found = []
        for text in texts:
            document = Document("f.yaml")
            value, _ = parse_value(text, document.add)
            try:
                document.raise_problems()
                found.append([repr(value)])
            except ConfigError as error:
                found.append([problem.where for problem in error.problems])
        return found

    native = outcomes()
    monkeypatch.setattr(yaml_tree, "_LOADER", yaml.SafeLoader)
    assert outcomes()[:-1] == native[:-1]
    assert outcomes()[-1]


def test_a_merge_key_alone_is_told() -> None:
    """The keys that it would have given are not called missing; another mistake beside it is told."""
    with pytest.raises(ConfigError) as refused:
        parse_experiment(edited("      lam: 10\n", "      <<: {lam: 1}\n      kk: 2\n"))
    assert [problem.text.partition(" (")[0] for problem in refused.value.problems] == ["merge keys", "unknown gain"]


@pytest.mark.parametrize("code", ["00A0", "2009", "202F", "3000"])
def test_a_character_that_looks_like_a_space_is_named(code: str) -> None:
    """Where it leaves the file without meaning, it is told with its code and its line."""
    with pytest.raises(ConfigError, match=rf"line 2 has the character U\+{code}"):
        parse_experiment("# a comment\nname:" + chr(int(code, 16)) + "x\nplant: {model: two-link}\n")
