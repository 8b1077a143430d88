"""Sweeps: grids and random draws over any key of an experiment."""
