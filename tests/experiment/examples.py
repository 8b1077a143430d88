"""Good configs that the tests load, edit and break; one key per line, so that lines can be checked."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from torquebench.experiment import Experiment, parse_experiment

GOOD = """\
name: good
description: every section, one key per line
plant:
  engine: mujoco
  model: puma560
  timestep: 0.001
  integrator: rk4
model:
  structure: corrected
  constants: printed
  mismatch:
    relative: 0.3
controllers:
  - name: conventional
    law: smc
    equivalent_control: true
    switching: saturation
    gains:
      lam: 10
      k: 0.3
      phi: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
  - name: linear-band
    law: linear-band-smc
    equivalent_control: false
    gains:
      lam: 10.5
      k: 0.25
      phi: 0.35
      kv: 20
    expect: completed
reference:
  kind: sine
  amplitude: [1.2, -1.0, 1.0, 1.1, 1.0, 1.0]
  frequency_hz: 0.75
chain: ideal
disturbances:
  - kind: band-limited-noise
    channel: torque
    sigma: 0.5
    hold: 0.02
    clip_sigma: 2.5
run:
  duration: 4
  control_period: 0.002
  initial_q: home
  seed: 7
  metrics_from: 1.25
  draw: 3
video:
  quality: pretty
  size: [320, 240]
  speed: 0.5
  camera: side
  exaggerate: 20
  sound: true
  ears: [conventional, conventional]
"""

_SINE = """\
  kind: sine
  amplitude: [1.2, -1.0, 1.0, 1.1, 1.0, 1.0]
  frequency_hz: 0.75
"""

STEP = GOOD.replace(_SINE, "  kind: step\n  target: 0.6\n  at: 0.2\n")
RAMP = GOOD.replace(_SINE, "  kind: ramp\n  origin: 0\n  target: [1, 2, 3, 4, 5, 6]\n  rise_time: 2\n")
RAMP = RAMP.replace("  draw: 3\n", "  draw: 3\n  chattering_from_hz: 2.5\n")
QUINTIC = GOOD.replace(_SINE, "  kind: quintic\n  target: 0.6\n  rise_time: 2\n")
ANALYTIC = GOOD.replace("  engine: mujoco\n", "  engine: analytic\n  structure: printed\n  constants: fitted\n")
ANALYTIC = ANALYTIC.replace("switching: saturation\n", "switching: saturation\n    surface: pid\n")
SCENARIO = (
    GOOD.replace(
        "model:\n  str",
        """\
  payload:
    mass: 2
    at: 0.5
    offset: [0.1, 0, -0.05]
  lock:
    joint: 3
    at: 1
  friction:
    viscous: [5.8, 9.3, 4.0, 0.36, 0.36, 0.22]
    coulomb: 0.9
    speed: 0.02
    breakaway: 1.2
    stribeck_speed: 0.2
    load: 0.1
    load_backdriving: 0.2
    bristle_stiffness: 300
    bristle_damping: 0.01
  transmission:
    stiffness: 2.0e+4
    damping: 20
    inertia: 2
    backlash: 1.0e-3
    sensor: link
  limits: stop
  perturb:
    relative: 0.1
model:
  str""",
    )
    .replace(
        "chain: ideal\n",
        """\
chain:
  encoder_noise: 0.0001
  quantisation: 0.0002
  velocity: differentiated
  velocity_filter: 300
  measurement_delay: 0.004
  actuator_lag: 0.003
""",
    )
    .replace(
        "run:\n",
        """\
  - kind: bias
    channel: torque
    value: [1, -2, 3, 0, 0.5, -0.5]
  - kind: sinusoid
    channel: torque
    amplitude: 2
  - kind: sinusoid
    channel: torque
    rms: [3, 2, 1, 0, 0, 0]
    frequency_hz: 2.5
run:
""",
    )
)
TOLERANCE = GOOD.replace("    relative: 0.3\n", "    tolerance: 0.5\n")
SINGLE = GOOD.replace("    relative: 0.3\n", "    constants: {g1: 1.3, I5: 0.8}\n")
MINIMAL = """\
name: minimal
plant: {engine: analytic, model: puma560}
controllers: [{name: only, law: pd, gains: {lam: 5, kv: 10}}]
reference: {kind: step, target: 0.5, at: 0.1}
run: {duration: 2.5}
"""
FLEXIBLE = MINIMAL.replace(
    "plant: {engine: analytic, model: puma560}\n",
    """\
plant:
  engine: analytic
  model: puma560
  integrator: rk4
  transmission:
    stiffness: 20000
    damping: 10
    inertia: 1
    backlash: 0.001
    sensor: link
""",
)
TOOL = tuple(
    MINIMAL.replace("{kind: step, target: 0.5, at: 0.1}", block)
    for block in (
        """
  kind: tool-circle
  start: [0, -1, 3.3, 0, 0.84, 0]
  at: [0.55, 0.15, 0.05]
  orientation: kept
  approach: 0.8
  period: 2
  radius: 0.05
  plane: xy""",
        """
  kind: tool-line
  start: [0, -1, 3.3, 0, 0.84, 0]
  period: 2
  to: [0, 0.1, 0]""",
        """
  kind: tool-lemniscate
  start: [0, -1, 3.3, 0, 0.84, 0]
  period: 2
  width: 0.1""",
        """
  kind: tool-waypoints
  start: [0, -1, 3.3, 0, 0.84, 0]
  points: [[0, 0.1, 0]]
  speed: 0.2""",
    )
)
"""A path of the tool of every kind."""
FUZZY = GOOD.replace(
    """\
  - name: linear-band
    law: linear-band-smc
    equivalent_control: false
    gains:
      lam: 10.5
      k: 0.25
      phi: 0.35
      kv: 20
""",
    """\
  - name: fuzzy-band
    law: fuzzy-linear-band-smc
    equivalent_control: false
    compensation: fuzzy
    integral: true
    band: saturation
    linear: true
    fuzzy: three
    gains:
      lam: 10.5
      k: 0.25
      phi: 0.35
      kv: 20
      kf: 0.3
      gd: 1.0
      ki: 0
""",
).replace(
    "reference:\n",
    """\
fuzzy:
  three:
    kind: mamdani
    inputs:
      - range: [-2, 2]
        terms: {N: -2, Z: 0, P: 2}
      - terms: {N: [-1, -1, 0], Z: [-0.5, -0.1, 0.1, 0.5], P: [0, 1, 1]}
    output:
      range: [-3, 3]
      terms: {N: -2, Z: 0, P: 2}
    rules:
      - [N, N, Z]
      - [N, Z, none]
      - [Z, P, P]
    conjunction: product
    aggregation: max-bounded-product
    defuzzification: cog
  list:
    kind: sugeno
    inputs:
      - terms: {low: -1, high: 1}
    output:
      functions: {down: [0, -0.5], up: 1}
    rules:
      - if: low
        then: down
      - if: [high]
        then: up
reference:
""",
)
SWEEP = """\
sweep:
  draws: 30
  grid:
    chain: [ideal, fast]
    controllers.*.gains.lam:
      from: 5
      to: 20
      count: 3
      spacing: log
  random:
    run.metrics_from:
      uniform: [1, 2]
    controllers.linear-band.gains.kv:
      log_uniform: [10, 30]
    controllers[1].gains.phi:
      normal:
        mean: 0.35
        std: 0.01
    disturbances[0].sigma:
      choice: [0.5, 1]
  certificates: true
  border:
    key: controllers.*.gains.k
    from: 0.01
    to: 1
    within: 0.1
  keep:
    worst: 3
    by: hf
"""
"""A section of `GOOD` that is no experiment's."""
FALSIFY = """\
falsify:
  variables:
    disturbances[0].sigma:
      low: 0.1
      high: 2
      spacing: log
      step: 0.1
  metric: rmse
  claim: rmse <= 5 mrad
  evaluations: 100
  seeds: 2
  seed: 1
"""
"""Another one."""
TUNE = """\
tune:
  objective: [rmse, chattering]
  constraints: [max_error <= 50 mrad, saturation_fraction <= 20 %]
  evaluations: 40
  sampler: nsga-ii
  seeds: 4
  seed: 1
  draws: 3
  conditions:
    list: {}
  test:
    draws: 10
    conditions:
      three: {}
"""
"""And another one."""
ARENA = """\
arena:
  laws: listed
  chains:
    list: {}
  training:
    three: {}
  burdens:
    list: {}
  held_out: {}
  metric: rmse
  metrics: [max_error]
  levels: [1 %, 5 %]
  evaluations: 40
  seeds: 4
  seed: 1
  sampler: nsga-ii
  training_draws: 1
  draws: 10
  looks: 2
"""
"""The last one."""
DRIVEN = SCENARIO.replace(
    """\
  velocity: differentiated
  velocity_filter: 300
  measurement_delay: 0.004
  actuator_lag: 0.003
""",
    """\
  encoder_offset: 0.001
  encoder_ripple:
    amplitude: 0.0001
    cycles: 12
    phase: 0.5
  velocity: tachometer
  velocity_noise: 0.01
  command_filter: 500
  torque_rate: 1000
  missed_deadlines: 0.01
  jitter: 0.002
  command_delay: 0.004
  torque_quantum: 0.01
  torque_gain: [0.9, 1, 1, 1, 1, 1.1]
  torque_offset: [0.1, 0, 0, 0, 0, 0]
  current_loop:
    frequency: 900
    damping: 0.6
  torque_speed:
    corner: 2
    no_load: [4, 4, 4, 5, 5, 5]
  thermal_limit:
    torque: 10
    time: 5
  derating:
    at: 1
    limit: 0.8
    gain: [1, 1, 0.7, 1, 1, 1]
    over: 0.5
  cross_talk:
    following: 0.1
    preceding: -0.07
  torque_delay: 0.001
""",
)
FILTERED = SCENARIO.replace(
    "  velocity: differentiated\n  velocity_filter: 300\n", "  velocity: kalman\n  kalman_acceleration: 20\n"
).replace("  - kind: bias\n", "  - kind: pulses\n    size: 1\n    levels: [1, -0.5]\n    hold: 0.02\n  - kind: bias\n")
VARIED = {
    "controllers.*.gains.lam",
    "run.metrics_from",
    "controllers.linear-band.gains.kv",
    "controllers[1].gains.phi",
    "disturbances[0].sigma",
}
ALL = {
    "good": GOOD,
    "step": STEP,
    "ramp": RAMP,
    "quintic": QUINTIC,
    "analytic": ANALYTIC,
    "fuzzy": FUZZY,
    "scenario": SCENARIO,
    "driven": DRIVEN,
    "filtered": FILTERED,
    "tolerance": TOLERANCE,
    "single": SINGLE,
    "minimal": MINIMAL,
    "flexible": FLEXIBLE,
}


def edited(old: str, new: str, text: str = GOOD) -> str:
    """Return `text` with its only occurrence of `old` replaced."""
    if text.count(old) != 1:
        raise ValueError(f"{old!r} occurs {text.count(old)} times")
    return text.replace(old, new)


def line_of(fragment: str, text: str) -> int:
    """Return the number of the only line of `text` that holds `fragment`."""
    lines = [number for number, line in enumerate(text.splitlines(), start=1) if fragment in line]
    if len(lines) != 1:
        raise ValueError(f"{fragment!r} is on lines {lines}")
    return lines[0]


AMPLITUDE, DESCRIPTION = "[1.2, -1.0, 1.0, 1.1, 1.0, 1.0]", "description: every section, one key per line"


def parse(text: str, *overrides: str) -> Experiment:
    """Return the experiment of a text that must be accepted."""
    return parse_experiment(text, "good.yaml", overrides)


def properties(node: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every key that a JSON schema describes."""
    if isinstance(node, list):
        for item in node:
            yield from properties(item)
    elif isinstance(node, dict):
        yield from node.get("properties", {}).items()
        for value in node.values():
            yield from properties(value)
