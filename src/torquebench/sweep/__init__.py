"""Many closed loops: grids and draws over any key of an experiment, kept as one table, and what the table says."""
