"""Why a run shakes, fails, errs or saturates: each imperfection taken away and left alone, and the loop's margins."""

from torquebench.diagnosis.diagnose import Cause, Diagnosis, Remedy, diagnose
from torquebench.diagnosis.margins import Margins

__all__ = ["Cause", "Diagnosis", "Margins", "Remedy", "diagnose"]
