"""Rows that repeat: closed loops that differ in nothing that anything in them reads, of which one is run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from torquebench.beliefs import fields_read
from torquebench.experiment.build import Loop, plant_factors
from torquebench.experiment.certify import sliding_law
from torquebench.experiment.controllers import Controller as Keys
from torquebench.experiment.dump import plain_values
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.sim.session import Controller

if TYPE_CHECKING:
    from torquebench.sweep.worker import Ended


@dataclass(frozen=True)
class Known:
    """Loops that were run, by their key, which the sweeps of one piece of work share, such as those of an audit."""

    steps: int = 0
    """Control steps of all these sweeps together, by which compiling is worth it or not."""
    ended: dict[bytes, Ended] = field(default_factory=dict)
    metrics: dict[bytes, Array] = field(default_factory=dict)


def keys_of(experiment: Experiment, loop: Loop, certified: bool) -> Iterator[bytes | None]:
    """Yield for each controller what decides the numbers of its row; None where that cannot be told.

    It is everything that loop, metrics and certificates are made from. Of the law's belief it is what the law's source
    reads; so a law without a model has one loop under every belief.

    Args:
        experiment: What is to be run.
        loop: Its objects.
        certified: Whether the rows hold certificates.
    """
    run, reference = experiment.run, experiment.reference
    shared = hashlib.blake2b(digest_size=32)
    facts = plain_values(experiment.plant), plain_values(experiment.chain), run.control_period, run.metrics_from
    shared.update(json.dumps([*facts, reference.is_step_like, experiment.chattering_from_hz]).encode())
    drawn = *loop.drawn, loop.disturbance, plant_factors(experiment)
    for signal in (*loop.reference, loop.initial_q, *drawn):
        _add(shared, signal)
    for keys, controller in zip(experiment.controllers, loop.controllers, strict=True):
        with_certificate = certified and sliding_law(keys, loop, experiment.n) is not None
        yield _key(shared.copy(), keys, controller, loop, with_certificate)


def _key(own: Any, keys: Keys, controller: Controller, loop: Loop, certified: bool) -> bytes | None:
    """Return the key of one row.

    Args:
        own: Digest of what all rows of the experiment share; changed.
        keys, controller, loop: The controller and what it runs in.
        certified: Whether the row holds certificates.
    """
    read = fields_read(controller.law, controller.gains)
    if read is None:
        return None
    _add(own, (controller.law.name, certified, keys.options, tuple(sorted(read)), controller.gains))
    for name in sorted(read - {"control_period"}):
        _add(own, getattr(loop.model.flat, name))
    _add(own, loop.model.flat.inertia_scale)  # by which certificates scale gains
    return bytes(own.digest())


def _add(digest: Any, value: Any) -> None:
    """Add an array, or a tuple of arrays, numbers and texts."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, tuple):
        for part in value:
            _add(digest, part)
    else:
        digest.update(repr(value).encode() + b"\0")
