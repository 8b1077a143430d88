"""Interactive replay of stored runs: MuJoCo's viewer, or a page in the browser."""
