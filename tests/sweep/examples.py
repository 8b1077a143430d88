"""A small sweep that the tests of sweeps share: two controllers, two keys of the grid, one random key, noise."""

from __future__ import annotations

from torquebench.sweep.plan import Plan, Source

BASE = """\
name: small
plant: {engine: mujoco, model: puma560, integrator: euler}
model: {structure: corrected, constants: printed, mismatch: {relative: 0.3}}
controllers:
  - {name: band, law: linear-band-smc, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
  - {name: sign, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
reference: {kind: sine, amplitude: 0.8, frequency_hz: 1.0}
chain: {encoder_noise: 0.0001}
disturbances:
  - {kind: band-limited-noise, channel: torque, sigma: [5.06, 16.59, 3.30, 0.54, 0.62, 0.81]}
run: {duration: 0.6, metrics_from: 0.1, seed: 3}
"""
SMALL = BASE + (
    """\
sweep:
  draws: 6
  grid:
    plant.payload.mass: [0, 2]
    controllers.*.gains.phi: {from: 0.1, to: 0.3, count: 3}
  random:
    controllers.*.gains.lam: {uniform: [8, 12]}
"""
)


def plan_of(text: str, *overrides: str) -> Plan:
    """Return the plan of a sweep's text."""
    return Plan(Source(text.encode(), "small.yaml", overrides))


def user_law(name: str) -> str:
    """Return the file of a user's law: tau = g^ + k tau_max e - 10 qd."""
    return f'''
"""A law of a user."""
from typing import Annotated, NamedTuple
from torquebench import Array, Gain, controller, gravity

class Gains(NamedTuple):
    k: Annotated[Array, Gain("share of the torque limit", "1")]

@controller("{name}", gains=Gains)
def {name.replace("-", "_")}(gains, model, t, q, qd, ref, memory, tau):
    """tau = g^ + k tau_max e - 10 qd."""
    gravity(model, q, tau)
    for i in range(len(tau)):
        tau[i] += gains.k[i] * model.tau_max[i] * (ref.q[i] - q[i]) - 10.0 * qd[i]
'''
