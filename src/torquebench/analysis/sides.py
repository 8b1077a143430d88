"""What can be compared: the two sides of a comparison, named as on the command line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy.typing as npt

from torquebench.errors import ConfigError, ModelError, Problem, did_you_mean
from torquebench.kernel import Array
from torquebench.robot import RobotModel, load_model
from torquebench.robot.flat_model import STRUCTURES
from torquebench.sim.plants import Plant

ENGINES = ("mujoco", "analytic")


class Dynamics(Protocol):
    """Terms of the dynamics, each for a batch of states (N, n)."""

    n: int
    joint_names: tuple[str, ...]

    def mass_matrix(self, q: npt.ArrayLike) -> Array:
        """M(q), (N, n, n) [kg m^2]."""
        ...

    def bias_forces(self, q: npt.ArrayLike, qd: npt.ArrayLike) -> Array:
        """N(q, qd), (N, n) [N m]."""
        ...

    def gravity(self, q: npt.ArrayLike) -> Array:
        """g(q), (N, n) [N m]."""
        ...

    def inverse_dynamics(self, q: npt.ArrayLike, qd: npt.ArrayLike, qdd: npt.ArrayLike) -> Array:
        """Torque for the acceleration `qdd`, (N, n) [N m]."""
        ...

    def forward_kinematics(self, q: npt.ArrayLike) -> Array:
        """Pose of the tool, (N, 4, 4) [-, m]."""
        ...


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a comparison."""

    label: str
    """As the user wrote it."""
    engine: str
    """``mujoco`` or ``analytic``."""
    source: str
    """Model name or path of an MJCF file."""
    dynamics: Any
    """Terms of the dynamics; see `Dynamics`."""
    links: RobotModel | None
    """Link parameters behind it; None for closed forms, which have none."""

    def plant(self, timestep: float) -> Plant:
        """Return this side as a plant, RK4."""
        if self.engine == "mujoco":
            from torquebench.sim.plants.mujoco import MujocoPlant

            return MujocoPlant(self.source, timestep)
        from torquebench.sim.plants.analytic import AnalyticPlant

        return AnalyticPlant(self.dynamics, timestep)


def parse_side(text: str, argument: str) -> Side:
    """Read ``mujoco:MODEL``, ``analytic:MODEL[:STRUCTURE[:CONSTANTS]]`` or ``FILE.xml``.

    Args:
        text: What the user wrote.
        argument: Name of the argument, for messages.

    Raises:
        ConfigError: it is none of these, or the model cannot be used.
    """
    engine, _, rest = text.partition(":")
    if text.endswith(".xml"):
        engine, rest = ("mujoco", text) if engine not in ENGINES else (engine, rest)
    try:
        if engine == "mujoco":
            return _mujoco_side(text, rest)
        if engine == "analytic":
            source, *more = rest.split(":")
            if len(more) > 2:
                raise ModelError("too many parts, wanted analytic:MODEL[:STRUCTURE[:CONSTANTS]]")
            if more and more[0] not in STRUCTURES:
                raise ModelError(f"unknown structure '{more[0]}'{did_you_mean(more[0], STRUCTURES)}")
            model = load_model(source, *more)
            exact = not more or more[0] == "exact"
            return Side(text, engine, source, model, model if exact else None)
        raise ModelError(
            f"unknown engine '{engine}', wanted mujoco:MODEL, analytic:MODEL[:STRUCTURE[:CONSTANTS]] or FILE.xml"
            + did_you_mean(engine, ENGINES)
        )
    except (ModelError, ValueError) as error:
        message = str(error).removeprefix(f"{source_of(text)}: ")
        raise ConfigError([Problem(argument, text, message)]) from error


def source_of(text: str) -> str:
    """Return the model's name or file in a side's text."""
    engine, _, rest = text.partition(":")
    return rest.split(":")[0] if engine in ENGINES else text


def _mujoco_side(text: str, source: str) -> Side:
    from torquebench.robot import mjcf
    from torquebench.robot.library import mjcf_path
    from torquebench.sim.plants.mujoco import MujocoModel

    compiled = mjcf.compile_mjcf(mjcf_path(source))
    links = RobotModel(source, tuple(mjcf.joint_names(compiled)), mjcf.flatten(compiled, source))
    return Side(text, "mujoco", source, MujocoModel(source), links)
