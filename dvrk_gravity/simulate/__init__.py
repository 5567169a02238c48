"""The simulated arm: forward dynamics, friction that sticks, sensors, and the dVRK's manners."""

from dvrk_gravity.simulate.plant import Plant
from dvrk_gravity.simulate.plant_file import PlantFile
from dvrk_gravity.simulate.run import simulate
from dvrk_gravity.simulate.sensors import Sensors
from dvrk_gravity.simulate.simulated_arm import Measurement, Mode, SimulatedArm

__all__ = [
    "Measurement",
    "Mode",
    "Plant",
    "PlantFile",
    "Sensors",
    "SimulatedArm",
    "simulate",
]
