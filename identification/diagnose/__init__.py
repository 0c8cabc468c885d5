"""What a model lacks: where it parts from the data, which effect is missing, and what to measure next."""

from identification.diagnose.diagnosis import Diagnosis
from identification.diagnose.workflow import diagnose

__all__ = ["Diagnosis", "diagnose"]
