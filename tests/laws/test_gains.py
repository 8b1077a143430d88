"""Declaring laws and packing their gains: what is refused, and what the message says."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

from torquebench.errors import ControllerError
from torquebench.fuzzy import Fis, builtin_system, infer, prepare
from torquebench.kernel import Array
from torquebench.laws import FixedRules, Gain, Option, Rules, controller, find_law, law_names

SMC = {"lam": 10.0, "k": 0.3}


class Plain(NamedTuple):
    """Gains as a user's law may declare them, without units."""

    k: Array


class Named(NamedTuple):
    """Gains with every kind of annotation."""

    k: Annotated[Array, Gain("stiffness", "N m/rad")]
    shape: Annotated[int, Option("shape", ("round", "square", "flat"))]
    fast: Annotated[int, Option("speed", (False, True))]


class Unlisted(NamedTuple):
    """An option that does not list its values."""

    mode: int


class Kept(NamedTuple):
    """Memory of two channels."""

    s: Array
    z: Array


class Tied(NamedTuple):
    """A gain that acts with two of three values of an option, and one that acts with a boolean."""

    k: Annotated[Array, Gain("stiffness", "N m/rad", only_with=("shape", "round", "flat"))]
    z: Annotated[Array, Gain("damping", "N m s/rad", only_with=("damped", True))]
    shape: Annotated[int, Option("shape", ("square", "round", "flat"))]
    damped: Annotated[int, Option("whether it is damped", (False, True))]


class Ruled(NamedTuple):
    """A gain and a fuzzy system."""

    k: Annotated[Array, Gain("gain", "1")]
    fis: Annotated[Fis, Rules("how much of it")]


class TwiceRuled(NamedTuple):
    """Two fuzzy systems, of which a config could choose only one."""

    one: Annotated[Fis, Rules("one")]
    two: Annotated[Fis, Rules("two")]


class Supervised(NamedTuple):
    """A fuzzy system that a config chooses, 25 rules by default, and one of the law's own."""

    fis: Annotated[Fis, Rules("how much of it", default="pd-25")]
    own: Annotated[Fis, FixedRules("how much of that", "pd-9")]


class Misnamed(NamedTuple):
    """A default that is not built in."""

    fis: Annotated[Fis, Rules("how much of it", default="pd-52")]


class MisnamedOwn(NamedTuple):
    """A system of the law's own that is not built in."""

    own: Annotated[Fis, FixedRules("how much of it", "s-8")]


class Unruled(NamedTuple):
    """A fuzzy system that does not say what it is for."""

    fis: Fis


def law(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Any, memory: Any, tau: Array) -> None:
    """Ask for no torque."""


pytestmark = pytest.mark.usefixtures("registries")


def test_laws_that_ship() -> None:
    """The laws of this stage are registered under their names, in order, each with a one-line summary."""
    names = law_names()
    assert {"pd", "pd-gravity", "pid", "computed-torque", "smc", "linear-band-smc"} <= set(names)
    assert list(names) == sorted(names)
    assert all(find_law(name).summary.endswith(".") or ";" in find_law(name).summary for name in names)


def test_scalars_are_repeated_and_vectors_kept() -> None:
    """A scalar gain goes to every joint, a vector to its joints; options become integers; arrays are new."""
    phi = np.array([0.1, 0.2, 0.3])
    packed = find_law("smc").pack_gains(3, {**SMC, "phi": phi}, {"switching": "saturation"})
    assert packed.lam.tolist() == [10.0, 10.0, 10.0]
    assert packed.phi.tolist() == [0.1, 0.2, 0.3]
    assert (packed.equivalent_control, packed.switching) == (1, 1)
    phi[0] = 9.0
    packed.lam[0] = 9.0
    assert packed.phi[0] == 0.1
    assert packed.lam[1] == 10.0


def test_options_are_numbered_by_place_and_booleans_by_value() -> None:
    """A named option is its place in the list, a boolean is 1 or 0; the first of the list is the default."""
    controller("named", gains=Named)(law)
    pack = find_law("named").pack_gains
    assert pack(1, {"k": 1}, {})[1:] == (0, 0)
    assert pack(1, {"k": 1}, {"shape": "flat", "fast": True})[1:] == (2, 1)
    for value, number in ((True, 1), (False, 0), ("measured-acceleration", 2)):
        assert find_law("smc").pack_gains(1, SMC, {"equivalent_control": value})[-3:] == (number, 0, 0)


def test_a_gain_may_be_tied_to_several_values() -> None:
    """It is required with each of them and refused without; a boolean counts as what a config calls it."""
    controller("tied", gains=Tied)(law)
    pack = find_law("tied").pack_gains
    assert pack(1, {}, {}).shape == 0
    for shape in ("round", "flat"):
        assert pack(1, {"k": 2.0}, {"shape": shape}).k.tolist() == [2.0]
        with pytest.raises(ControllerError, match="gain 'k' is missing"):
            pack(1, {}, {"shape": shape})
    with pytest.raises(ControllerError, match="gain 'k' has no effect unless shape: round or flat"):
        pack(1, {"k": 2.0}, {})
    assert pack(1, {"z": 3.0}, {"damped": True}).z.tolist() == [3.0]
    with pytest.raises(ControllerError, match="gain 'z' has no effect unless damped: true"):
        pack(1, {"z": 3.0}, {})


@pytest.mark.parametrize(
    ("only_with", "message"),
    [
        (("shap", "round"), r"gain 'k' depends on option 'shap' \(did you mean 'shape'\?\)"),
        (("shape", "rond"), r"gain 'k' depends on shape: 'rond' \(did you mean 'round'\?\)"),
        (("shape", "flat", "rond"), r"gain 'k' depends on shape: 'rond' \(did you mean 'round'\?\)"),
        (("fast", 1), r"gain 'k' depends on fast: 1 \(one of: False, True\)"),
        (("shape",), "gain 'k' depends on option 'shape', but on no value of it"),
    ],
)
def test_a_gain_that_could_never_be_given_is_refused(only_with: Any, message: str) -> None:
    """A condition that no choice of the law fulfils is a mistake in its declaration, and nothing is registered."""

    class Misspelt(NamedTuple):
        k: Array
        shape: int
        fast: int

    Misspelt.__annotations__ = {
        "k": Annotated[Array, Gain("stiffness", "N m/rad", only_with=only_with)],
        "shape": Named.__annotations__["shape"],
        "fast": Named.__annotations__["fast"],
    }
    with pytest.raises(ControllerError, match=message):
        controller("misspelt", gains=Misspelt)(law)
    assert "misspelt" not in law_names()


PROPOSED = {"lam": 10, "k": 0.3, "phi": 0.3, "kv": 20, "kf": 0.3, "gd": 1, "ki": 2000}


@pytest.mark.parametrize(
    ("name", "options", "silent"),
    [
        ("smc", {}, "phi"),
        ("linear-band-smc", {"switching": "sign"}, "phi"),
        ("fuzzy-linear-band-smc", {"compensation": "off"}, "kf gd"),
        ("fuzzy-linear-band-smc", {"compensation": "clipped-sum"}, ""),
        ("fuzzy-linear-band-smc", {"integral": False}, "ki"),
        ("fuzzy-linear-band-smc", {"band": "sign"}, "phi"),
        ("fuzzy-linear-band-smc", {"band": "off"}, "k phi"),
        ("fuzzy-linear-band-smc", {"linear": False}, "kv"),
        (
            "fuzzy-linear-band-smc",
            {"compensation": "off", "integral": False, "band": "off", "linear": False},
            "kf gd ki k phi kv",
        ),
    ],
)
def test_gains_that_a_choice_silences_are_refused(name: str, options: dict[str, Any], silent: str) -> None:
    """Each gain of a part that is out is refused when it is given, and all others are required."""
    gains = {gain: PROPOSED[gain] for gain in find_law(name).gains}
    kept = {gain: value for gain, value in gains.items() if gain not in silent.split()}
    find_law(name).pack_gains(2, kept, options)
    for gain in gains:
        if gain in kept:
            given = {other: value for other, value in kept.items() if other != gain}
            message = f"gain '{gain}' is missing"
        else:
            given, message = kept | {gain: gains[gain]}, f"gain '{gain}' has no effect unless "
        with pytest.raises(ControllerError, match=message):
            find_law(name).pack_gains(2, given, options)


@pytest.mark.parametrize(
    ("name", "values", "options", "message"),
    [
        ("smc", {**SMC, "lamb": 1}, {}, r"unknown gain 'lamb' \(did you mean 'lam'\?\)"),
        ("smc", {"lam": 1}, {}, r"gain 'k' is missing \(switching gain .*\[1\]\)"),
        ("smc", SMC, {"switching": "saturation"}, r"gain 'phi' is missing \(half-width .*\[rad/s\]\)"),
        ("smc", {**SMC, "phi": 0.3}, {}, "gain 'phi' has no effect unless switching: saturation"),
        ("smc", {**SMC, "k": -0.1}, {}, r"gain 'k' is -0.1, wanted finite and positive \[1\]"),
        ("smc", {**SMC, "k": 0}, {}, r"gain 'k' is 0, wanted finite and positive"),
        ("smc", {**SMC, "k": [0.3, -0.3, 0.3]}, {}, "gain 'k' is .*wanted finite and positive"),
        ("smc", {**SMC, "k": math.nan}, {}, "gain 'k' is nan, wanted finite"),
        ("smc", {**SMC, "k": math.inf}, {}, "gain 'k' is inf, wanted finite"),
        ("pid", {"lam": 1, "kv": 1, "ki": -1}, {}, r"gain 'ki' is -1, wanted finite and zero or positive \[1/s\^3\]"),
        ("smc", {**SMC, "k": [0.3, 0.3]}, {}, r"gain 'k' has shape \(2,\), wanted a number or 3 numbers"),
        ("smc", {**SMC, "k": [[0.3, 0.3, 0.3]]}, {}, r"gain 'k' has shape \(1, 3\)"),
        ("smc", {**SMC, "k": "strong"}, {}, "gain 'k' is 'strong', wanted a number or 3 numbers"),
        ("smc", {**SMC, "k": [[1], [2, 3]]}, {}, r"gain 'k' is \[\[1\], \[2, 3\]\], wanted a number"),
        ("smc", SMC, {"switching": "saturate"}, "option 'switching' is 'saturate', wanted one of .*'saturation'"),
        ("smc", SMC, {"swithing": "sign"}, r"unknown option 'swithing' \(did you mean 'switching'\?\)"),
        ("smc", SMC, {"equivalent_control": "yes"}, r"option 'equivalent_control' is 'yes', wanted one of \(True, F"),
        ("smc", SMC, {"equivalent_control": 1}, r"option 'equivalent_control' is 1, wanted one of \(True, F"),
        ("smc", SMC, {"equivalent_control": 0}, r"option 'equivalent_control' is 0, wanted one of \(True, F"),
    ],
)
def test_gains_that_are_refused(name: str, values: dict[str, Any], options: dict[str, Any], message: str) -> None:
    """Each mistake is refused by an error that names the law, the gain, what was given and what was wanted."""
    with pytest.raises(ControllerError, match=f"^law '{name}': .*{message}"):
        find_law(name).pack_gains(3, values, options)


def test_all_mistakes_are_reported_at_once() -> None:
    """One error carries every mistake."""
    with pytest.raises(ControllerError) as caught:
        find_law("smc").pack_gains(3, {"lam": -1, "kk": 1, "phi": 1}, {"mode": 1})
    text = str(caught.value)
    for part in ("unknown option 'mode'", "unknown gain 'kk'", "gain 'lam' is -1", "'k' is missing", "'phi' has no"):
        assert part in text


def test_zero_is_accepted_where_it_means_off() -> None:
    """The integral gain may be zero, and integers are numbers."""
    assert find_law("pid").pack_gains(2, {"lam": 1, "kv": 1, "ki": 0}, {}).ki.tolist() == [0.0, 0.0]


def test_unknown_law() -> None:
    """The message names the nearest law."""
    with pytest.raises(ControllerError, match=r"unknown law 'smcc' \(did you mean 'smc'\?\)"):
        find_law("smcc")


@pytest.mark.parametrize("name", ["", "PD", "my law", "-pd", "pd-", "pd_gravity", "../pd", "a" * 65, "pd\n", "é"])
def test_names_that_are_not_slugs(name: str) -> None:
    """A law's name becomes a folder name and a YAML word; anything but a slug is refused, and nothing registered."""
    before = law_names()
    with pytest.raises(ControllerError, match="wanted lower-case letters, digits and '-'"):
        controller(name, gains=Plain)(law)
    assert law_names() == before


def test_a_name_cannot_be_taken_twice() -> None:
    """A second law of the same name is refused and the first one stays."""
    first = find_law("pd")
    with pytest.raises(ControllerError, match="a law named 'pd' is already registered"):
        controller("pd", gains=Plain)(law)
    assert find_law("pd") is first


def test_option_without_values_is_refused() -> None:
    """An integer field must list its values."""
    with pytest.raises(ControllerError, match="option 'mode' needs Annotated"):
        controller("unlisted", gains=Unlisted)(law)
    assert "unlisted" not in law_names()


def test_registering_returns_the_function_itself_and_its_memory_is_zero() -> None:
    """The decorator gives the function back unchanged; unannotated gains may be zero but not negative."""
    assert controller("my-law-2", gains=Plain, memory=Kept)(law) is law
    found = find_law("my-law-2")
    assert found.summary == "Ask for no torque."
    memory = found.new_memory(3)
    assert isinstance(memory, Kept)
    assert [x.tolist() for x in memory] == [[0.0] * 3] * 2
    assert memory.s is not memory.z
    assert found.pack_gains(2, {"k": 0}, {}).k.tolist() == [0.0, 0.0]
    with pytest.raises(ControllerError, match="wanted finite and zero or positive"):
        found.pack_gains(2, {"k": -1}, {})


def test_a_fuzzy_system_is_a_third_kind_of_field() -> None:
    """The law gets the system that is named or handed over, 49 rules by default, in arrays of its own."""
    controller("ruled", gains=Ruled)(law)
    found = find_law("ruled")
    assert (list(found.gains), list(found.options), list(found.rules)) == (["k"], [], ["fis"])
    packed = found.pack_gains(2, {"k": 1}, {})
    assert infer(packed.fis, 0.33, 0.33) == pytest.approx(0.6536, abs=5e-5)
    small = builtin_system("pd-9")
    for choice in ("pd-9", small):
        chosen = found.pack_gains(2, {"k": 1}, {}, choice)
        assert infer(chosen.fis, 0.33, 0.33) == infer(prepare(small).fis, 0.33, 0.33) != infer(packed.fis, 0.33, 0.33)
    packed.fis.table[:] = 0.0
    assert infer(found.pack_gains(2, {"k": 1}, {}).fis, 1.0, 1.0) == 1.0


def test_a_law_says_which_rules_it_has_by_default_and_which_are_its_own() -> None:
    """A config's choice replaces the default, and leaves the law's own system as it is."""
    controller("supervised", gains=Supervised)(law)
    found = find_law("supervised")
    assert (list(found.rules), list(found.fixed)) == (["fis"], ["own"])

    def is_system(fis: Fis, name: str) -> bool:
        return fis.table.tolist() == prepare(builtin_system(name)).fis.table.tolist()

    for choice, name in ((None, "pd-25"), ("pd-49", "pd-49")):
        packed = found.pack_gains(1, {}, {}, choice)
        assert (is_system(packed.fis, name), is_system(packed.own, "pd-9")) == (True, True)
    packed.own.table[:] = 0.0
    assert is_system(found.pack_gains(1, {}, {}).own, "pd-9")


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        (Misnamed, r"'fis' names 'pd-52', which is not built in \(did you mean 'pd-25'\?\)"),
        (MisnamedOwn, r"'own' names 's-8', which is not built in \(did you mean 's-7'\?\)"),
        (TwiceRuled, "has two fuzzy systems, 'one' and 'two'"),
        (Unruled, r"fuzzy system 'fis' needs Annotated\[Fis, Rules\(...\)\]"),
    ],
)
def test_fuzzy_fields_that_are_refused(gains: Any, message: str) -> None:
    """At most one system, and it says what it is for."""
    with pytest.raises(ControllerError, match=message):
        controller("ruled-wrongly", gains=gains)(law)
    assert "ruled-wrongly" not in law_names()


def test_a_fuzzy_system_that_cannot_be_had() -> None:
    """An unknown name is answered with the nearest one; a law without rules takes none."""
    controller("ruled", gains=Ruled)(law)
    with pytest.raises(ControllerError, match=r"unknown fuzzy system 'pd-94' \(did you mean 'pd-9'\?\)"):
        find_law("ruled").pack_gains(1, {"k": 1}, {}, "pd-94")
    with pytest.raises(ControllerError, match="law 'smc': it has no fuzzy system to choose"):
        find_law("smc").pack_gains(1, SMC, {}, "pd-9")


class Idle(NamedTuple):
    """A gain that acts with two of an option's three values, and a system that acts with the third."""

    k: Annotated[Array, Gain("stiffness", "1", only_with=("shape", "round", "flat"))]
    shape: Annotated[int, Option("shape", ("round", "square", "flat"))]
    fis: Annotated[Fis, Rules("how much of it", only_with=("shape", "square"))]


class Adrift(NamedTuple):
    """A system that acts with a value that there is not."""

    shape: Annotated[int, Option("shape", ("round", "flat"))]
    fis: Annotated[Fis, Rules("how much of it", only_with=("shape", "flatt"))]


def test_a_fuzzy_system_that_a_choice_leaves_out() -> None:
    """It cannot be chosen then, and the law gets its default one, which it does not ask."""
    controller("idle", gains=Idle)(law)
    pack = find_law("idle").pack_gains
    assert pack(1, {}, {"shape": "square"}, "pd-9").shape == 1
    for shape in ("round", "flat"):
        assert pack(1, {"k": 2}, {"shape": shape}).k.tolist() == [2.0]
        with pytest.raises(ControllerError, match="law 'idle': its fuzzy system has no effect unless shape: square"):
            pack(1, {"k": 2}, {"shape": shape}, "pd-9")
    with pytest.raises(ControllerError, match=r"fuzzy system 'fis' depends on shape: 'flatt' \(did you mean 'flat'"):
        controller("adrift", gains=Adrift)(law)
    assert "adrift" not in law_names()
