"""What ``torquebench run`` says and draws of stability: one line and one page for the laws that have certificates."""

from __future__ import annotations

import math
from collections.abc import Mapping

from torquebench.certificates import Certificate
from torquebench.experiment.run import ExperimentResult


def certificate_lines(result: ExperimentResult, proofs: Mapping[str, Certificate]) -> list[str]:
    """Return a line for each controller with certificates: worst margin of K, reaching time, where V grew."""
    lines = []
    for name, found in proofs.items():
        facts = found.to_json()
        worst = facts["worst_margin"]
        joint = result.loop.joint_names[worst["joint"] - 1]
        force = "N" if result.slides[worst["joint"] - 1] else "N m"
        reached = "never" if math.isinf(found.reaching_time) else f"{found.reaching_time:.3g} s"
        bound = "none: V grew on the way" if math.isinf(found.reaching_bound) else f"{found.reaching_bound:.3g} s"
        lines.append(
            f"certificate of {name}: least K - (123) {worst['value']:.3g} {force} ({joint}, t = {worst['t']:.4g} s); "
            f"reaching time {reached} (bound {bound}); V grew in {100.0 * facts['share_rising_outside']:.3g} % of the "
            f"{100.0 * facts['share_outside']:.3g} % of instants outside the layer"
        )
    return ["", *lines] if lines else []
