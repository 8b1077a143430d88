"""Interactive replay of runs, stored or in progress: MuJoCo's viewer, or a page in the browser."""
