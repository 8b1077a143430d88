"""Many closed loops: grids and draws over any key of an experiment, their table, and statistics of it."""
