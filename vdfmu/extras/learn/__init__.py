"""Systems as environments for reinforcement learning with gymnasium's interface; one arm, or many at once."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.learn.environments import ArmEnv, ArmVectorEnv, Environment
    from vdfmu.extras.learn.tasks import TrackingTask

__all__ = ["ArmEnv", "ArmVectorEnv", "Environment", "TrackingTask"]
__getattr__ = lazy(__name__, {"environments": ("ArmEnv", "ArmVectorEnv", "Environment"), "tasks": ("TrackingTask",)})
