"""From recordings to a torque model: parameters, confidence, and what the data cannot tell."""

from dvrk_gravity.identify.evaluation import Evaluation, evaluate
from dvrk_gravity.identify.result import Fit
from dvrk_gravity.identify.run import identify

__all__ = ["Evaluation", "Fit", "evaluate", "identify"]
