"""What does a model get wrong about a recording? Named effects, with proof on held-out data."""

from dvrk_gravity.diagnosis.findings import Alternative, Estimate, Finding, Gain
from dvrk_gravity.diagnosis.result import Diagnosis
from dvrk_gravity.diagnosis.run import diagnose

__all__ = ["Alternative", "Diagnosis", "Estimate", "Finding", "Gain", "diagnose"]
