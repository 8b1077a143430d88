"""A run that goes wrong names the causes that were put into it, with their numbers; one that goes well names none."""

import pytest

import torquebench as tb

BASE = {
    "name": "seeded",
    "plant": {"engine": "analytic", "model": "two-link"},
    "model": {},
    "reference": {"kind": "sine", "amplitude": 0.5, "frequency_hz": 1.0},
    "run": {"duration": 1.0, "metrics_from": 0.3},
}
WIDE = {"lam": 10, "k": 0.5, "phi": 1.0, "kv": 20}


FAST = {"reference.amplitude": 3.0, "reference.frequency_hz": 4.0}
BARE = {"equivalent_control": False}


def lines(law, gains, options=BARE, **changes):
    """What is explained of one law on the two-link arm."""
    controller = {"name": "c", "law": law, "gains": gains} | (options if law != "pd" else {})
    found = tb.load_experiment(BASE | {"controllers": [controller]}, changes)
    return tb.run_experiment(found).numbers.explained


def test_a_run_that_goes_well_has_no_line():
    """Nor has one whose law switches and chatters, as such laws do."""
    assert lines("linear-band-smc", WIDE, {}) == ()
    assert lines("smc", {"lam": 10, "k": 0.5}, {}) == ()


@pytest.mark.parametrize(
    ("law", "gains", "changes", "symptom", "cause"),
    [
        ("smc", {"lam": 10, "k": 0.01}, {}, "never reaches its surface", "is below what its motion needs"),
        ("linear-band-smc", WIDE | {"phi": 1000.0, "kv": 0.01}, {}, "errs by", "is wider than its motion: phi = 1000"),
        (
            "linear-band-smc",
            WIDE | {"k": 0.3, "phi": 0.05},
            {"run.control_period": 0.004},
            "limit-cycles",
            "its layer is thinner than a step of travel: K moves s of",
        ),
        ("pd", {"lam": 20, "kv": 40}, FAST, "saturates (", "the reference needs more torque than the arm has"),
        ("pd", {"lam": 20, "kv": 40}, FAST | {"run.control_period": 0.05}, "", "Kd moves s of"),
        (
            "linear-band-smc",
            WIDE | {"lam": 60},
            {"chain": {"measurement_delay": 0.02}},
            "",
            "what is late in the loop, 20 ms, is more than lambda = 60 1/s allows, 1/(3 lambda) = 5.56 ms",
        ),
    ],
    ids=["small K", "wide layer", "thin layer", "too fast", "rate gain", "delay"],
)
def test_a_seeded_cause_is_named(law, gains, changes, symptom, cause):
    """With the symptom, in the line of its controller."""
    (line,) = lines(law, gains, **changes)
    assert line.startswith("controller 'c' ")
    assert symptom in line
    assert cause in line


def test_noise_that_no_velocity_has_is_told_before_the_run():
    """encoder_noise beside an exact velocity is remarked, beside a differentiated one not."""
    noisy = {"encoder_noise": 1e-4}
    base = BASE | {"controllers": [{"name": "c", "law": "smc", "gains": {"lam": 10, "k": 0.5}}]}
    for velocity, told in (("exact", True), ("differentiated", False)):
        result = tb.run_experiment(tb.load_experiment(base | {"chain": noisy | {"velocity": velocity}}))
        assert any("is in the measured position alone" in flag for flag in result.flags) == told
