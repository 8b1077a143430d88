"""``python -m torquebench``, and what the installed command starts: Ctrl-C has a clean end from here on."""

import sys

PATIENCE = 2.0
"""Longest time that threads that are left over may take to end [s]."""


def end_with(status: int) -> None:
    """Have the process end with an exit status although a thread, such as a law may have started, does not end.

    Python waits for such threads; one that watches them ends the process after `PATIENCE`, and names them.
    """
    import os
    import threading

    left = [x for x in threading.enumerate() if not x.daemon and x is not threading.main_thread()]

    def watch() -> None:
        import time

        until = time.monotonic() + PATIENCE
        for thread in left:
            thread.join(max(0.0, until - time.monotonic()))
        if names := ", ".join(repr(thread.name) for thread in left if thread.is_alive()):
            for stream in (sys.stdout, sys.stderr):
                if stream is not None:
                    if stream is sys.stderr:
                        stream.write(f"torquebench: the process is ended although threads still run: {names}\n")
                    stream.flush()
            os._exit(status)

    if left:
        threading.Thread(target=watch, daemon=True).start()


def start() -> int:
    """Run the command line and return its exit status."""
    try:
        from torquebench.cli.app import main

        status = main()
        end_with(status)
        return status
    except KeyboardInterrupt:  # before or after what main itself guards
        if sys.stderr is not None:
            sys.stderr.write("torquebench: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(start())
