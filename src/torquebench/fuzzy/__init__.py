"""Fuzzy inference: definitions, their check, exact or tabulated evaluation inside kernels."""

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.fuzzy.prepare import Prepared, prepare
from torquebench.fuzzy.system import BUILTIN, DEFAULT, FuzzySystem, Rule, builtin_system
from torquebench.fuzzy.terms import Bell, Functions, Gaussian, Sigmoid, Term, Variable

__all__ = [
    "BUILTIN",
    "DEFAULT",
    "Bell",
    "Fis",
    "Functions",
    "FuzzySystem",
    "Gaussian",
    "Prepared",
    "Rule",
    "Sigmoid",
    "Term",
    "Variable",
    "builtin_system",
    "infer",
    "prepare",
]
