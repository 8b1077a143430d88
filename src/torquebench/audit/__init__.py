"""Claims of a study: conditions, verdicts, and what is written about them."""
