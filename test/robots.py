"""URDFs of other robots, which `example-robot-data` brings."""

from pathlib import Path

import pinocchio as pin

ROBOTS = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
UR5 = ROBOTS / "ur_description" / "urdf" / "ur5_robot.urdf"
PANDA = ROBOTS / "panda_description" / "urdf" / "panda.urdf"
