"""From recordings to a torque model: parameters, confidence, and what the data cannot tell."""

from dvrk_gravity.identification.evaluation import Evaluation, evaluate
from dvrk_gravity.identification.result import Fit
from dvrk_gravity.identification.run import identify

__all__ = ["Evaluation", "Fit", "evaluate", "identify"]
