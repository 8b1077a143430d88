"""The closed loop: plants, the loop, and what it leaves behind."""
