"""The command ``torquebench``."""
