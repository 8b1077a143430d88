"""Second half of the page: what the slips amount to, the entries dropped, the constants, the contradictions."""

from __future__ import annotations

from torquebench.robot.puma560.symbols import MISPRINTED

from . import findings, torques
from .closed_loop import effect
from .elements import DROPPED, ELEMENTS, element, exact_on_grid
from .layout import num, table
from .paper_equations import EQUATIONS
from .prose import FLAGS, NOTES


def controller() -> str:
    """Section on the closed loop."""
    cases: list[tuple[str, tuple[str, ...], str, str]] = [("none: `corrected`", (), "fitted", "corrected")]
    cases += [(f"({n}) {FLAGS[n]}", (n,), "fitted", "corrected") for n in MISPRINTED]
    cases += [
        ("all of these: `printed`", MISPRINTED, "fitted", "corrected"),
        ("all, and the printed constants", MISPRINTED, "printed", "corrected"),
        ("none, but the printed constants", (), "printed", "corrected"),
        ("none: `exact`", (), "fitted", "exact"),
    ]
    rows = []
    for name, literal, constants, structure in cases:
        e = effect(literal, constants, structure)
        small = [num(x) if x > 1e-9 else "0" for x in (e.mass, e.bias)]
        rows.append(
            [name, *small, str(e.joint or "-"), num(1e3 * e.rms), num(1e3 * e.shift) if e.shift > 1e-12 else "0"]
        )
    return f"""## What each slip does to a controller

Computed torque, tau = A (qdd_ref + 20 de + 200 e) + N, on the exact arm with its moving wrist, `sine` reference of
4 s, 1 kHz. The
controller's model is `corrected` with one equation as printed. Change of the torque along the reference: the
largest over
time and joints of the change of A qdd_ref and of N, and the joint whose sum changes most. Rms error: all joints, t
>= 1 s.
Shift: the largest distance of a joint from where it is with the corrected model.

{table("as printed | A qdd, N m | N, N m | joint | rms error, mrad | shift, mrad", rows)}

(66) changes nothing: its label is a slot that (62) leaves empty. (61)'s and (71)'s dots are read as speeds
everywhere. A slip
can lower the error by luck: at a moving wrist the frozen-wrist forms are themselves wrong, by the last line."""


def together() -> str:
    """Section on the velocity torques as a whole."""
    rows = []
    for name, numbers in (("(61)", (61,)), ("(71)", (71,)), ("(61) + (71)", (61, 71))):
        error = torques.torque_peak(torques.printed_quadratic(numbers) - torques.exact_quadratic(numbers))
        true = torques.torque_peak(torques.exact_quadratic(numbers))
        rows.append([name + ", error", *(num(x) if x > 1e-12 else "0" for x in error)])
        rows.append([name + ", true", *(num(x) if x > 1e-12 else "0" for x in true)])
    D = exact_on_grid()["D"]
    still, moving = (torques.power(torques.printed_quadratic(), D, n) for n in (3, 6))
    own = torques.power(torques.printed_quadratic(), torques.printed_mass_derivatives(), 6)
    pattern = torques.power(torques.corrected_quadratic(), D, 6)
    wrong, true_rms = torques.power_rms()
    return f"""## All slips together

Largest velocity torque of each joint with every speed at most 2 rad/s, N m. Here and in what follows the largest is
sought over speeds of -2, 0 and 2 rad/s and a grid of 10 degrees, so the true one may be a little larger:

{table("torque | joint 1 | 2 | 3 | 4 | 5 | 6", rows)}

As printed, joint 3's velocity torque can be wrong by more than its largest true value.

The velocity torques V of a rigid body do no work of their own: qd.V = 0.5 qd.(dA/dt) qd. The paper's stability
proof, from (108) on, stands on this property (it says that dA/dt - 2V is skew-symmetric). As printed they do work:
{num(still)} W or more at 2 rad/s with the wrist at rest and {num(moving)} W with it moving (with dA/dt of the printed
A: {num(own)} W); rms {num(wrong)} W over random speeds, where qd.V itself has {num(true_rms)} W rms. The corrected
pattern keeps the property to round-off with the wrist at rest and to {num(pattern)} W with it moving."""


def dropped() -> str:
    """Section on the zeros of (36), (48), (62)."""
    found = findings.dropped()
    rows = [[name, f"`{DROPPED[name]}`", num(found[name])] for name in DROPPED]
    A = findings.peak(exact_on_grid()["A"] - findings.corrected_matrices()["A"])
    V = torques.torque_peak(torques.corrected_quadratic() - torques.exact_quadratic())
    listed = ", ".join(num(x) if x > 1e-12 else "0" for x in V)
    return f"""## Entries that the paper drops

(36), (48) and (62) set these to zero. It is an abbreviation, not a slip, and the `corrected` model keeps it.
Together they are worth
at most {num(A)} kg m^2 in A and, at 2 rad/s, {listed} N m in the velocity torque of joints 1 to 6. A dropped
entry of A has a symmetric partner. No entry of G is dropped.

{table("entry | value at the frozen wrist | largest", rows)}"""


def constants() -> str:
    """Section on Tables 3 and 4."""
    rows = []
    for name, (left, right) in findings.ties(findings.printed_constants()).items():
        rows.append([f"`{name}`", num(left), num(right), num(100 * abs(left / right - 1)) + " %"])
    gaps = torques.constant_gaps()
    worst, misfit = findings.largest_misfit()
    vague = ", ".join(findings.unsigned_constants())
    return f"""## Constants, Tables 3 and 4

Values and units are consistent: one rigid arm has all 34 constants within {num(misfit)} of their tolerances
({worst} is the
farthest). A rigid arm obeys seven ties among them, which the printed values break a little, so that none has
exactly these
(g = 9.81 m/s^2, a3 = -0.0203 m):

{table("tie | left | right | gap", rows)}

The fitted constants obey them. Printed in place of fitted, they change the corrected form by at most
{num(gaps["A"])} kg m^2
in A, {num(gaps["V"])} N m in the velocity torques at 2 rad/s and {num(gaps["G"])} N m in gravity. The tolerances of
{vague} exceed their
values: not even their signs are known."""


def itself() -> str:
    """Section on the paper's internal contradictions."""
    names = {52: "(52) = d(38)/dtheta3 + d(39)/dtheta2", None: "0 = d(40)/dtheta2"}
    rows = []
    for identity in findings.IDENTITIES:
        number, factor, parts = identity
        by = "theta2" if parts[0][1] == findings.BY_2 else "theta3"
        name = names.get(number, f"({number}) = {'-0.5 ' if factor < 0 else ''}d({parts[0][0]})/d{by}")
        errors = [findings.identity_error(identity, mended) for mended in ((), (37, 40), ELEMENTS)]
        rows.append([name, *(num(x) if x > findings.ROUND_OFF else "holds" for x in errors)])
    chain = []
    for (n, claim), gaps in findings.claims().items():
        said = claim.replace("_", "").replace("{", "").replace("}", "")
        shown = ["undefined" if x is None else num(x) if x > findings.ROUND_OFF else "holds" for x in gaps]
        chain.append([f"({n}) `{element(n).label} = {said}`", *shown])
    return f"""## The paper against itself

No arm and no other source is needed to find most of the slips. Coriolis and centrifugal terms are derivatives of
the mass matrix; among
joints 1 to 3, with (66), (67), (68) as c23, c31, c32 (largest violation, kg m^2):

{table("relation | as printed | with (37), (40) corrected | all corrected", rows)}

Chains `label = expression = formula`: how far the expression is from the formula:

{table("equation | as printed | corrected and relabelled", chain)}

Dimensions: (37), (51) and (69) are the only formulas that do not scale with the constants."""


def notation() -> str:
    """Section on slips that change no number."""
    listed = "\n".join(f"* {note}" for note in NOTES)
    bare = sum(EQUATIONS[n].count("q_") for n in (61, 71))  # \\dot{q}_1 does not contain q_
    return f"""## Notation and references

Read, not computed, except (8), (35), (53) and the undefined names, which have tests.

* (61) and (71) have {bare} speeds without a dot between them.
{listed}"""
