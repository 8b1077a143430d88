"""Finds why a run shakes, fails, errs or saturates: runs it without each imperfection, with it alone; loop margins."""

from torquebench.diagnosis.diagnose import Cause, Diagnosis, Remedy, diagnose
from torquebench.diagnosis.margins import Margins

__all__ = ["Cause", "Diagnosis", "Margins", "Remedy", "diagnose"]
