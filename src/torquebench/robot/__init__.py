"""The arm: analytic dynamics and kinematics, model files, and the PUMA 560's closed forms."""

from torquebench.robot.arm import RobotModel
from torquebench.robot.loading import load_model
from torquebench.robot.puma560.puma import Puma560

__all__ = ["Puma560", "RobotModel", "load_model"]
