"""Experiments as YAML files: strict reading, resolved writing, and the schema of every key."""

from torquebench.experiment.dump import config_hash, dump_experiment
from torquebench.experiment.law_schema import experiment_json_schema
from torquebench.experiment.load import load_experiment, parse_experiment
from torquebench.experiment.schema import Controller, Experiment
from torquebench.experiment.values import as_vector

__all__ = [
    "Controller",
    "Experiment",
    "as_vector",
    "config_hash",
    "dump_experiment",
    "experiment_json_schema",
    "load_experiment",
    "parse_experiment",
]
