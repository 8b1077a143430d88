"""Pages of HTML that stand alone: one run, several runs side by side, the paper's study."""
