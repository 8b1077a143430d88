"""Claims of a study: conditions, verdicts, and what is written about them."""

STUDY = "study.yaml"
"""The study's file in an audit's folder, as it was given."""
DIGEST = "study.json"
"""What identifies the audit there, so that it can go on."""
