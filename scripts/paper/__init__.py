"""The study of the paper's Figs 9 to 11: what is run, a verdict on each of its claims, and the page that shows both."""
