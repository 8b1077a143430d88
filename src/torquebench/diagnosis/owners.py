"""Owner of each part of a loop: the robot, whose parts only a law can answer, or the user, who can change the part."""

from __future__ import annotations

from typing import Literal, TypeAlias

from torquebench.chain import ABOUT, CHAINS, ROBOT_CHAINS
from torquebench.experiment.schema import Experiment

Owner: TypeAlias = Literal["robot", "arm", "config", "law"]
OWNERS: dict[Owner, str] = {
    "robot": "the robot's",
    "arm": "the arm's, as your config has it",
    "config": "yours",
    "law": "the law's",
}
"""Who can change a part: its maker; nobody, though a config says how large it is; who writes the config, or the law."""
OWNED: dict[str, Owner] = {
    **dict.fromkeys(("friction", "perturb", "transmission", "backlash", "torque_limit"), "arm"),
    **dict.fromkeys(("gravity", "integral"), "law"),
}
"""Key of a part outside the chain -> whose it is, if that is not the config's."""


def robot_of(experiment: Experiment) -> str | None:
    """Return the robot whose chain an experiment has, whole or with other values for some keys; None for no robot's."""
    name, arm = experiment.chain.name, str(experiment.plant.model)
    return next((one for one in (name, arm) if one in ROBOT_CHAINS and name in (one, "custom")), None)


def owner_of(experiment: Experiment, key: str) -> Owner:
    """Return who can change a part, such as one of the chain, or the ``hold`` of the control period.

    A velocity is worked out in a program of one's own, whatever the robot; so is a control period beyond the robot's.
    """
    robot, key = robot_of(experiment), "control_period" if key == "hold" else key
    if key in OWNED:
        return OWNED[key]
    if robot is None or key == "velocity" or key not in ABOUT[robot].origins:
        return "config"
    if key == "control_period":
        same = experiment.run.control_period <= (ABOUT[robot].control_period or 0.0) * (1.0 + 1e-9)
    else:
        same = getattr(experiment.chain, key) == getattr(CHAINS[robot], key)
    return "robot" if same else "config"
