"""``python -m torquebench``, and what the installed command starts: Ctrl-C has a clean end from here on."""

import sys


def start() -> int:
    """Run the command line and return its exit status."""
    try:
        from torquebench.cli.app import main

        return main()
    except KeyboardInterrupt:  # before or after what main itself guards
        if sys.stderr is not None:
            sys.stderr.write("torquebench: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(start())
