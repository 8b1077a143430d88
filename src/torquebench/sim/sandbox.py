"""Laws of people one does not know: read before they are loaded, or run in a process that has nothing but their inputs.

A file that only declares laws in the dialect has nothing to reach for: `dialect.read_file` has read it before it is
loaded, and `read_law` and `read_kernel` what its functions do. It runs compiled, as every law does. Any other file is
never loaded here: `torquebench.sim.sandboxed` runs it in a process of its own, one for each closed loop, which has
gains, model, t, q, qd, ref and memory, and answers with a torque.
"""

from __future__ import annotations

import ast
import atexit
import contextlib
import io
import json
import math
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
import weakref
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, NamedTuple, NoReturn

import numpy as np

from torquebench.dialect import Complaint, complaints, is_kernel, plain, read_file, read_kernel
from torquebench.errors import ConfigError, ControllerError, Problem
from torquebench.fuzzy import Fis
from torquebench.kernel import Array
from torquebench.kernel.struct import field_names, is_structure
from torquebench.laws import FixedRules, Gain, Option, Rules, controller, find_law
from torquebench.laws.plugin import load_plugin
from torquebench.registry import REGISTRIES, registering_again
from torquebench.sim.closed_loop import COMPLETED, CONTROLLER_ERROR, RAISED
from torquebench.sim.job import Job, Setup
from torquebench.syntax import parse_python

PATIENCE = 20.0
"""Longest time that a law may take to answer [s]."""
PACE = 10.0
"""Times the motion's length that its answers may take together, beside one `PATIENCE` [1]."""
HEADER = struct.Struct("<qqq")
"""Of an answer: control instant, how the call went, bytes of text behind the numbers."""
LONGEST_TEXT, LONGEST_DECLARATION = 1000, 1_000_000
FORK, WAIT = "fork", "wait"
"""Requests to the process from which the laws' processes are forked."""


def load_sandboxed(path: Path, where: str = "--plugin") -> tuple[str, ...]:
    """Register the laws of a file that may hold anything, and return their names.

    Args:
        path: The file. Of a file outside the dialect only laws are taken, no other kinds.
        where: Argument of the command that names it, for messages.

    Raises:
        ConfigError: the file cannot be read, registers no law, or is outside the dialect where no process can be shut
            off: that takes Linux on x86-64.
    """
    try:
        text = path.read_text(encoding="utf-8")
        outside = read_file(text)
    except (OSError, ValueError, SyntaxError) as error:
        raise ConfigError([Problem(where, str(path), f"{type(error).__name__}: {error}")]) from error
    module = _module_name(path)
    if not outside:
        names = load_plugin(path, where, text)
        if not (outside := _complaints_of(module, names)):
            return names
        for registry in REGISTRIES:
            registry.forget(module)
    with registering_again(module):
        names = tuple(_register(one, text, path.name, module) for one in _declared(text, path, where, outside))
    if not names:
        raise ConfigError([Problem(where, str(path), "registers no law (wanted a function with @controller)")])
    return names


def _module_name(path: Path) -> str:
    return f"torquebench_plugin_{path.stem.replace('-', '_')}"


def _complaints_of(module: str, names: tuple[str, ...]) -> list[Complaint]:
    """Return what keeps the laws and kernels of a loaded file from being compiled."""
    found = [complaint for name in names for complaint in complaints(find_law(name))]
    for value in vars(sys.modules[module]).values():
        function = plain(value)
        if is_kernel(value) and function.__module__ == module:
            found += read_kernel(function)
    return found


class SandboxedLaw:
    """Stand-in, in this process, for a law that runs in a process of its own: its file's text, and its name there.

    Args:
        text: The file.
        file: Its name, for messages.
        law: Name of the law.
        module: Name under which a plug-in of this file is known.
        doc: The law's docstring.
        terms: The terms of the dynamics that it calls there, as of `torquebench.laws.law.terms_called`.
    """

    def __init__(self, text: str, file: str, law: str, module: str, doc: str, terms: Iterable[str]) -> None:
        self.text, self.file, self.law, self.terms = text, file, law, frozenset(terms)
        self.__module__, self.__name__, self.__qualname__, self.__doc__ = module, law, law, doc

    def __call__(
        self, gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Any, memory: Any, tau: Array
    ) -> NoReturn:
        """Refuse: the law runs in its own process only."""
        raise ControllerError(f"law '{self.law}' runs in a process of its own")

    def start(self, setup: Setup) -> SandboxedCall:
        """Start a process for one run."""
        return SandboxedCall(self, setup)


class SandboxedCall:
    """A law in a process of its own, ready to be called; see `torquebench.sim.interpreted.Call`.

    Args:
        law: The law.
        setup: The run.
    """

    def __init__(self, law: SandboxedLaw, setup: Setup) -> None:
        arrays = flatten({"gains": setup.gains, "model": setup.belief})
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **arrays)
        ask = {"law": law.law, "file": law.file, "n": setup.plant.n}
        self._cell = Cell(law.text, ask, content.getvalue())
        self._memory, self._n = setup.job.memory, setup.plant.n
        self._own = ""
        """Why the process could not be shut off."""
        if (started := self._cell.read_text()) != "ready":
            self._own = started or self._cell.why()
        self._cell.left = PATIENCE + PACE * setup.job.control_period * len(setup.job.q_ref)

    def at(self, job: Job, k: int) -> tuple[int, str]:
        """Call the law at control instant k of a loop, write down its torque, and return how that went."""
        if self._own:
            return CONTROLLER_ERROR, self._own
        own, cell = self._memory, self._cell
        given = (job.measured_q, job.measured_qd, job.q_ref[k], job.qd_ref[k], job.qdd_ref[k])
        cell.write(np.concatenate([[k, k * job.control_period], *given]).tobytes())
        answer = cell.read(HEADER.size + 8 * (self._n + own.size))
        if answer is None:
            return CONTROLLER_ERROR, cell.why()
        at, status, length = HEADER.unpack(answer[: HEADER.size])
        if at != k or status not in (COMPLETED, RAISED, CONTROLLER_ERROR) or not 0 <= length <= LONGEST_TEXT:
            return CONTROLLER_ERROR, "the law's process gave an answer that is none"
        numbers = np.frombuffer(answer, np.float64, offset=HEADER.size)
        job.record_tau_law[k] = numbers[: self._n]
        own[...] = numbers[self._n :].reshape(own.shape)
        detail = (cell.read(length) or b"").decode("utf-8", "replace") if length else ""
        return status, "".join(c if c.isprintable() else " " for c in detail)


def flatten(value: Any, prefix: str = "") -> dict[str, Any]:
    """Return the arrays and numbers of structures, and of mappings to them, by dotted name."""
    if not (isinstance(value, dict) or is_structure(type(value))):
        return {prefix: value}
    names = value if isinstance(value, dict) else field_names(type(value))
    parts = {name: value[name] if isinstance(value, dict) else getattr(value, name) for name in names}
    return {key: x for name, part in parts.items() for key, x in flatten(part, f"{prefix}.{name}".strip(".")).items()}


class Cell:
    """A process that is shut off, as seen from outside.

    Args:
        text: The file that it runs.
        ask: What it is asked for, plain data.
        more: Arrays that go with it, as of ``np.savez``.
    """

    def __init__(self, text: str, ask: dict[str, Any], more: bytes = b"") -> None:
        (theirs, self._out), (self._in, their_out) = os.pipe(), os.pipe()
        self._zygote = Zygote.of_this_process()
        self._pid = self._zygote.fork(text, (theirs, their_out))
        for fd in (theirs, their_out):
            os.close(fd)
        self.left = math.inf
        """Time that its answers may take together from now on [s]."""
        self._late = ""
        self._state: dict[str, int] = {}
        self._finalize = weakref.finalize(self, _end, self._zygote, self._pid, self._in, self._out, self._state)
        parts = [json.dumps(ask).encode(), text.encode(), more]
        self.write(b"".join(struct.pack("<q", len(part)) + part for part in parts))

    def write(self, data: bytes) -> None:
        """Send bytes; a process that has ended is found out when it is read from."""
        with contextlib.suppress(BrokenPipeError):
            while data:
                data = data[os.write(self._out, data) :]

    def read(self, size: int) -> bytes | None:
        """Return as many bytes, or None if the process ends before or takes too long."""
        found, begun = b"", time.monotonic()
        patience = min(PATIENCE, self.left)
        poll = select.poll()
        poll.register(self._in, select.POLLIN)
        while len(found) < size:
            if not poll.poll(max(0.0, 1000.0 * (begun + patience - time.monotonic()))):
                of_all = f"took more than {PACE:g} times as long as the motion, and {PATIENCE:g} s, for its answers"
                self._late = of_all if self.left <= PATIENCE else f"gave no answer within {PATIENCE:g} s"
                return None
            part = os.read(self._in, size - len(found))
            if not part:
                return None
            found += part
        self.left -= time.monotonic() - begun
        return found

    def read_text(self) -> str:
        """Return a text that comes with its length; empty if none came."""
        head = self.read(8)
        size = struct.unpack("<q", head)[0] if head else 0
        body = self.read(size) if 0 < size <= LONGEST_DECLARATION else None
        return (body or b"").decode("utf-8", "replace")

    def why(self) -> str:
        """Return why the process does not answer; ends it."""
        self._finalize()
        code = self._state.get("code", 0)
        if self._late:
            return f"the law {self._late}"
        if code < 0:
            name = signal.Signals(-code).name
            reason = {"SIGSEGV": ", as one is that reads the processor's counter, or memory that is not its own"}.get(
                name, ""
            )
            return f"the law's process was ended by {name}{reason}"
        return f"the law ended its process, with status {code}"


def _end(zygote: Zygote, pid: int, read: int, write: int, state: dict[str, int]) -> None:
    """End a law's process and learn how it ended."""
    os.close(write)
    with contextlib.suppress(ControllerError):  # it is gone, and with it those that it forked
        state["code"] = zygote.wait(pid, read)
    os.close(read)


class Zygote:
    """The process from which the laws' processes are forked: it has loaded the package, and runs nothing of theirs."""

    _own: Zygote | None = None

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._pid, self._lock = os.getpid(), threading.Lock()
        # the package, numpy and what is installed beside it; not the folder that the user works in
        paths = [str(Path(__file__).parents[2]), *map(sysconfig.get_path, ("purelib", "platlib"))]
        paths.append(str(Path(np.__file__).parents[1]))
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self._folder = tempfile.TemporaryDirectory()
        """Its working directory, empty."""
        self._process = subprocess.Popen(
            [sys.executable, "-s", "-P", "-S", "-B", "-c", "from torquebench.sim.sandboxed import main; main()"],
            stdin=theirs.fileno(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self._folder.name,
            env={"PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)), "PYTHONHASHSEED": "0", **one},
        )
        theirs.close()
        atexit.register(self.close)

    @classmethod
    def of_this_process(cls) -> Zygote:
        """Return the one of this process, started when it is first needed."""
        if cls._own is None or cls._own._pid != os.getpid():
            cls._own = cls()
        return cls._own

    def close(self) -> None:
        """End it; the processes that it has forked end when nobody writes to them."""
        if self._pid == os.getpid():
            self._socket.close()
            self._process.wait()
            self._folder.cleanup()

    def fork(self, text: str, fds: tuple[int, int]) -> int:
        """Return the process that reads from, and writes to, two ends of pipes.

        Args:
            text: The file that it will run; installed packages that it imports are imported beforehand.
            fds: The end to read from and the end to write to.
        """
        return self._asked({"do": FORK, "imports": imports_of(text)}, fds)

    def wait(self, pid: int, read: int) -> int:
        """Return a process's exit status, negative for a signal; one that does not end by itself is ended.

        Args:
            pid: The process.
            read: What it writes to.
        """
        poll = select.poll()
        poll.register(read, 0)
        if not poll.poll(200.0):
            os.kill(pid, signal.SIGKILL)
        return self._asked({"do": WAIT, "pid": pid})

    def _asked(self, what: dict[str, Any], fds: tuple[int, ...] = ()) -> int:
        with self._lock:
            try:
                socket.send_fds(self._socket, [json.dumps(what).encode()], fds)
                return int(self._socket.recv(100))
            except (OSError, ValueError) as error:
                raise ControllerError(f"the process for sandboxed laws is gone ({error})") from error


def imports_of(text: str) -> list[list[str]]:
    """Return the modules that a file imports, each with the names that it takes from it, and `NAME` of ``x.NAME``."""
    found = []
    for node in ast.walk(parse_python(text)):
        if isinstance(node, ast.Import):
            found += [[name.name] for name in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.append([node.module, *(name.name for name in node.names)])
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.append(["torquebench", node.attr])
    return [list(x) for x in dict.fromkeys(map(tuple, found))]


class Declared(NamedTuple):
    """A law as its own process declares it: plain data, of which nothing is believed."""

    name: str
    doc: str
    gains: list[tuple[str, dict[str, Any]]]
    memory: list[str] | None
    rigid_only: bool
    has_model: bool | list[str | bool] | None
    terms: list[str]


def _declared(text: str, path: Path, where: str, outside: list[Complaint]) -> list[Declared]:
    """Have a file run in a process that is shut off, and return the laws that it declares."""
    if sys.platform != "linux" or os.uname().machine != "x86_64":
        reason = "a law outside the dialect can be shut off on Linux on x86-64 only"
        raise ConfigError([Problem(where, str(path), f"{reason} ({outside[0]})")])
    cell = Cell(text, {"law": None, "file": path.name, "n": 1})
    ready = cell.read_text()
    if ready != "ready":
        raise ConfigError([Problem(where, str(path), ready or cell.why())])
    answer = cell.read_text()
    try:
        found: dict[str, Any] = json.loads(answer) if answer else {"error": cell.why()}
        if "error" in found:
            raise ConfigError([Problem(where, str(path), str(found["error"])[:LONGEST_TEXT])])
        return [Declared(**law) for law in found["laws"]]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ConfigError([Problem(where, str(path), f"declares no laws ({error})")]) from error


def _register(one: Declared, text: str, file: str, module: str) -> str:
    """Register a law that runs in a process of its own, and return its name."""
    kinds = {"gain": Gain, "option": Option, "rules": Rules, "fixed": FixedRules}
    types: dict[str, Any] = {"gain": Array, "option": int, "rules": Fis, "fixed": Fis}
    fields = []
    for name, note in one.gains:
        kind = note.pop("kind")
        values = {key: tuple(x) if isinstance(x, list) else x for key, x in note.items()}
        fields.append((name, Annotated[types[kind], kinds[kind](**values)]))
    made: Any = NamedTuple  # a function to make classes with, of which mypy knows literal calls only
    memory = None if one.memory is None else made("Memory", [(x, Array) for x in one.memory])
    has_model = tuple(one.has_model) if isinstance(one.has_model, list) else one.has_model
    gains, rigid_only = made("Gains", fields), one.rigid_only is True
    controller(one.name, gains=gains, memory=memory, rigid_only=rigid_only, has_model=has_model)(
        SandboxedLaw(text, file, one.name, module, one.doc, one.terms)
    )
    return one.name
