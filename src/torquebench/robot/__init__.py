"""The arm: analytic dynamics and kinematics, model files, and the PUMA 560's closed forms."""

from torquebench.robot.loading import load_model
from torquebench.robot.puma560.puma import Puma560
from torquebench.robot.robot_model import RobotModel

__all__ = ["Puma560", "RobotModel", "load_model"]
