"""Figures of runs and sweeps, each drawn by a module of this folder. Importing this loads no matplotlib."""
