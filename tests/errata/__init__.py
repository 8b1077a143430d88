"""What is misprinted in the paper's model of the arm: proofs, and the page `docs/errata.md` made from them."""
