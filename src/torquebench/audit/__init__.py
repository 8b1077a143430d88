"""Claims of a study: conditions, verdicts, and what is written about them."""

STUDY = "study.yaml"
"""The study's file in an audit's folder, as it was given."""
DIGEST = "study.json"
"""The file there with the digest of the audit's runs, by which it is known again and goes on."""
