"""The contract test of a law: what the loop relies on, tried out on two arms and on both paths."""
