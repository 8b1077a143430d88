"""Tests of the notebooks in the documentation."""
