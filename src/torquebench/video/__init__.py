"""Films of stored runs: the arm, its reference as a ghost, torques, errors; replayed, never simulated again."""
