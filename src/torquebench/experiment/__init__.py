"""Experiments as YAML files: strict reading, resolved writing, and the schema of every key."""

from torquebench.experiment.config import load_experiment, load_systems, parse_experiment
from torquebench.experiment.dump import config_hash, dump_experiment
from torquebench.experiment.reference import experiment_json_schema
from torquebench.experiment.schema import Controller, Experiment
from torquebench.keys import as_vector

__all__ = [
    "Controller",
    "Experiment",
    "as_vector",
    "config_hash",
    "dump_experiment",
    "experiment_json_schema",
    "load_experiment",
    "load_systems",
    "parse_experiment",
]
