"""The process in which a law of somebody unknown runs: forked, shut off by the kernel, and only then the law's file.

What is left to it is to read what the law is given and write what it answers, each on one pipe, and to ask for memory:
a seccomp filter refuses every other call of the system, processes, files, sockets and clocks among them (EPERM). The
pages through which clocks are read without a call are unmapped; reading the processor's own counter ends the process
(PR_SET_TSC). Linux on x86-64 only. What can be refused in Python alone is no
border and is not tried.
"""

from __future__ import annotations

import copy
import ctypes
import gc
import importlib
import io
import json
import mmap
import os
import platform
import random
import re
import resource
import socket
import struct
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.ma  # numpy loads it where it is first needed, which a process without files cannot
from numba.core import config
from numba.core.dispatcher import Dispatcher

from torquebench.fuzzy import DEFAULT, Fis, builtin_system, infer, prepare
from torquebench.kernel import clip, sat, sign
from torquebench.kernel.struct import field_names
from torquebench.laws import FixedRules, Gain, Law, Option, Rules, find_law
from torquebench.laws.law import LAWS
from torquebench.laws.plugin import SourceLoader
from torquebench.references import Reference
from torquebench.registry import docstring
from torquebench.robot.dynamics import bias_forces, gravity, inverse_dynamics, mass_matrix
from torquebench.robot.flat_model import Model, rigid_model, scratch_for
from torquebench.sim.closed_loop import CONTROLLER_ERROR
from torquebench.sim.interpreted import Call, told
from torquebench.sim.sandbox import FORK, HEADER, LONGEST_TEXT

READ, WRITE = 0, 3
"""Where the law's inputs come from, and where its answers go."""
MOST_MEMORY = 4 << 30
"""Address space of the process [B]."""

NAME = "torquebench_law"
"""The module that a law's file is."""

PR_SET_SECCOMP_FILTER, SECCOMP_TSYNC = 1, 1
PR_SET_NO_NEW_PRIVS, PR_SET_TSC, PR_TSC_SIGSEGV = 38, 26, 2
SYS_SECCOMP = 317
X86_64 = 0xC000003E
"""The filter's name for this kind of processor; numbers of calls are its own."""
FREE = {
    "munmap": 11,
    "brk": 12,
    "rt_sigprocmask": 14,
    "rt_sigreturn": 15,
    "sched_yield": 24,
    "mremap": 25,
    "madvise": 28,
    "exit": 60,
    "futex": 202,
    "exit_group": 231,
}
"""Calls that reach nothing but the process's own memory, or end it."""
MMAP, MPROTECT, SYS_READ, SYS_WRITE = 9, 10, 0, 1
NUMBER, ARCHITECTURE, FIRST, THIRD = 0, 4, 16, 32
"""Offsets at which the filter finds a call's number, the processor, the first and third argument (low halves)."""
LOAD, EQUAL, SET, RETURN = 0x20, 0x15, 0x45, 0x06
ALLOW, KILL, REFUSE = 0x7FFF0000, 0x80000000, 0x00050001
"""Verdicts of the filter; REFUSE is the error EPERM."""
EXECUTABLE = 4
MAP_FIXED = 0x10
NOTHING, REFUSAL = b"\x90", b"\x48\xc7\xc0\xff\xff\xff\xff\xc3"
"""Code: nop; and mov $-EPERM, %rax, then ret."""


def main() -> NoReturn:
    """Fork a process for each law that is asked for, and tell how it ended, until nobody asks any more."""
    ear = socket.socket(fileno=os.dup(READ))
    known: list[list[list[str]]] = []
    kernels: list[Any] = []
    sys.argv.clear()
    sys.orig_argv.clear()
    while True:
        message, fds, _, _ = socket.recv_fds(ear, 1 << 18, 2)
        if not message:
            os._exit(0)
        asked = json.loads(message)
        if asked["do"] == FORK:
            if asked["imports"] not in known:
                prepare_for(asked["imports"])
                known.append(asked["imports"])
                kernels = [x for x in gc.get_objects() if isinstance(x, Dispatcher)]
                gc.freeze()
            pid = os.fork()
            if pid == 0:
                serve(kernels, *fds)
            for fd in fds:
                os.close(fd)
            ear.send(str(pid).encode())
        else:
            _, status = os.waitpid(asked["pid"], 0)
            ear.send(str(os.waitstatus_to_exitcode(status)).encode())


def prepare_for(imports: list[list[str]]) -> None:
    """Import what a law's file will import, as far as it is installed, and load the kernels that it will call.

    Args:
        imports: Modules, each with names that are taken from it.
    """
    for module, *names in imports:
        try:
            found = importlib.import_module(module)
            for name in names:
                if name != "*" and not hasattr(found, name):
                    importlib.import_module(f"{module}.{name}")
        except Exception:  # noqa: BLE001  the law's own import says so, with its line
            continue
    used = {name for _, *names in imports for name in names}
    n = 2
    zeros, eye = np.zeros, np.array([np.eye(3)] * n)
    model = rigid_model(
        kind=[0] * n,
        rotation=eye,
        offset=zeros((n, 3)),
        mass=np.ones(n),
        com=zeros((n, 3)),
        inertia=eye,
        armature=np.ones(n),
        gravity=zeros(3),
        tool_rotation=np.eye(3),
        tool_offset=zeros(3),
        tau_max=np.ones(n),
        inertia_scale=np.ones(n),
    )
    calls: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "mass_matrix": (mass_matrix, (model, zeros(n), zeros((n, n)))),
        "gravity": (gravity, (model, zeros(n), zeros(n))),
        "bias_forces": (bias_forces, (model, zeros(n), zeros(n), zeros(n))),
        "inverse_dynamics": (inverse_dynamics, (model, zeros(n), zeros(n), zeros(n), zeros(n))),
        "sat": (sat, (0.0,)),
        "sign": (sign, (0.0,)),
        "clip": (clip, (0.0, 1.0)),
    }
    if "infer" in used:
        fis = prepare(builtin_system(DEFAULT)).fis
        calls["infer"] = (infer, (copy.deepcopy(fis), 0.0, 0.0))
    for name, (kernel, arguments) in calls.items():
        if name in used:
            kernel(*arguments)


def serve(kernels: list[Any], read: int, write: int) -> NoReturn:
    """Run a law's file in this process, shut off, and answer until nobody asks any more.

    Args:
        kernels: As of `shut_off`.
        read: Where to read from.
        write: Where to write to.
    """
    high = os.sysconf("SC_OPEN_MAX")
    read, write = os.dup(read), os.dup(write)  # neither is one of those below
    os.dup2(read, READ)
    os.dup2(write, WRITE)
    os.closerange(1, WRITE)
    os.closerange(WRITE + 1, high)
    asked, text, more = json.loads(_part()), _part().decode(), _part()
    arrays = dict(np.load(io.BytesIO(more), allow_pickle=False)) if more else {}
    del more
    random.seed(0)
    np.random.seed(0)  # noqa: NPY002  a law that draws anyway draws the same in every run
    try:
        shut_off(kernels)
    except Exception as error:  # noqa: BLE001  nothing of the law's may run then
        _send(f"a process cannot be shut off on this machine ({type(error).__name__}: {error})")
        os._exit(1)
    _send("ready")
    if asked["law"] is None:
        declare(asked["file"], text)
    else:
        answer(asked["law"], asked["file"], text, asked["n"], arrays)
    os._exit(0)


def shut_off(kernels: list[Any]) -> None:
    """Give up everything but reading from READ, writing to WRITE, and memory; for good.

    Args:
        kernels: Every kernel that there is.

    Raises:
        OSError: the kernel does not allow it.
    """
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise OSError(0, "that takes Linux on x86-64")
    for x in kernels:
        x._can_compile = False  # it would need pages that can be executed
    config.DISABLE_JIT = True  # kernels of the law's own file run as the Python that they are
    os.environ.clear()
    sys.stdin = sys.stdout = sys.stderr = None
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    libc = ctypes.CDLL(None, use_errno=True)
    without_clock(libc)
    _must(libc.prctl(PR_SET_TSC, PR_TSC_SIGSEGV, 0, 0, 0), "the processor's counter stays readable")
    _must(libc.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "rights stay to be gained")
    program = filter_program()
    code = ctypes.create_string_buffer(program, len(program))
    pointer = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(code))
    arguments = PR_SET_SECCOMP_FILTER, SECCOMP_TSYNC, ctypes.c_char_p(pointer)
    _must(libc.syscall(SYS_SECCOMP, *arguments), "the kernel takes no seccomp filter")


def without_clock(libc: Any) -> None:
    """Have every reading of a clock refused.

    The C library reads clocks by code that the kernel maps into each process, without a call that could be filtered.
    In its place code is mapped that answers EPERM, wherever it is entered; the pages that it read are unmapped.

    Args:
        libc: The C library.

    Raises:
        OSError: the kernel does not let go of its pages.
    """
    libc.mmap.restype = ctypes.c_void_p
    pages = re.findall(r"^(\w+)-(\w+) .*\[v(dso|var\w*)\]$", Path("/proc/self/maps").read_text(), re.MULTILINE)
    for first, last, kind in pages:
        start, size = int(first, 16), int(last, 16) - int(first, 16)
        place = ctypes.c_void_p(start), ctypes.c_size_t(size)
        if kind != "dso":
            _must(libc.munmap(*place), "the clock's pages stay mapped")
            continue
        found = libc.mmap(*place, mmap.PROT_READ | mmap.PROT_WRITE, MAP_FIXED | mmap.MAP_PRIVATE | mmap.MAP_ANON, -1, 0)
        _must(int(found != start), "the clock's code stays mapped")
        ctypes.memmove(start, REFUSAL.rjust(size, NOTHING), size)
        _must(libc.mprotect(*place, mmap.PROT_READ | mmap.PROT_EXEC), "the clock's code cannot be replaced")


def _must(result: int, what: str) -> None:
    if result != 0:
        raise OSError(ctypes.get_errno(), f"{what} ({os.strerror(ctypes.get_errno())})")


def filter_program() -> bytes:
    """Return the seccomp filter, instructions of classic BPF of 8 bytes: code, jump if true, if false, operand."""

    def one(code: int, operand: int, then: int = 0, otherwise: int = 0) -> bytes:
        return struct.pack("HBBI", code, then, otherwise, operand)

    allow, refuse = one(RETURN, ALLOW), one(RETURN, REFUSE)
    parts = [one(LOAD, ARCHITECTURE), one(EQUAL, X86_64, 1), one(RETURN, KILL), one(LOAD, NUMBER)]
    for number in FREE.values():
        parts += [one(EQUAL, number, 0, 1), allow]
    for number, fd in ((SYS_READ, READ), (SYS_WRITE, WRITE)):
        parts += [one(EQUAL, number, 0, 4), one(LOAD, FIRST), one(EQUAL, fd, 0, 1), allow, refuse]
    for number in (MMAP, MPROTECT):
        parts += [one(EQUAL, number, 0, 4), one(LOAD, THIRD), one(SET, EXECUTABLE, 1), allow, refuse]
    return b"".join([*parts, refuse])


def run_file(file: str, text: str) -> None:
    """Run the law's file."""
    loader = SourceLoader(NAME, file, text)
    module = module_from_spec(spec_from_file_location(NAME, file, loader=loader))  # type: ignore[arg-type]
    sys.modules[NAME] = module
    loader.exec_module(module)


def declare(file: str, text: str) -> None:
    """Answer with the laws that the file registers."""
    try:
        run_file(file, text)
        laws = [described(LAWS[name]) for name in LAWS.registered_by(NAME)]
        _send(json.dumps({"laws": laws}))
    except (Exception, SystemExit) as error:  # noqa: BLE001  a user's file may raise anything
        _send(json.dumps({"error": told(error)}))


def described(law: Law) -> dict[str, Any]:
    """Return what a law declares, as plain data; a rule of its own for ``gains: auto`` stays behind."""
    gains = []
    for name in law.gains_type._fields:
        kinds: dict[str, Any] = {"gain": law.gains, "option": law.options, "rules": law.rules, "fixed": law.fixed}
        kind = next(kind for kind, known in kinds.items() if name in known)
        note: Gain | Option | Rules | FixedRules = kinds[kind][name]
        gains.append((name, {"kind": kind} | {k: v for k, v in note._asdict().items() if k not in ("auto", "inputs")}))
    memory = None if law.memory_type is None else list(law.memory_type._fields)
    return {
        "name": law.name,
        "doc": docstring(law.function),
        "gains": gains,
        "memory": memory,
        "rigid_only": law.rigid_only,
        "has_model": law.declared_model,
        "terms": sorted(law.terms),
    }


def answer(name: str, file: str, text: str, n: int, arrays: dict[str, Any]) -> None:
    """Answer with a torque for what the law is given at each control instant.

    Args:
        name: The law.
        file, text: The file that registers it.
        n: Number of joints.
        arrays: Gains and model, by dotted name.
    """
    try:
        run_file(file, text)
        law = find_law(name)
        gains = law.gains_type(*(_gain(law, field, arrays) for field in law.gains_type._fields))
        memory = law.new_memory(n)
        call = Call(law, gains, _model(arrays, n), memory)
        problem = ""
    except (Exception, SystemExit) as error:  # noqa: BLE001
        problem = told(error)
    kept = [] if problem or law.memory_type is None else [x for x in memory if len(x) == n]
    while data := _read(8 * (2 + 5 * n)):
        k, t, *_ = numbers = np.frombuffer(data, np.float64)
        q, qd, *ref = (x.copy() for x in numbers[2:].reshape(5, n))
        tau, status, detail = np.full(n, np.nan), CONTROLLER_ERROR, problem
        if not problem:
            tau, status, detail = call(float(t), q, qd, Reference(*ref))
        words = detail.encode("utf-8", "replace")[:LONGEST_TEXT]
        rows = [np.resize(np.asarray(x, np.float64), n) for x in kept]
        _write(HEADER.pack(int(k), status, len(words)) + np.concatenate([tau, *rows]).tobytes() + words)


def _gain(law: Law, field: str, arrays: dict[str, Any]) -> Any:
    if field in law.rules or field in law.fixed:
        return Fis(*(_value(arrays[f"gains.{field}.{part}"]) for part in Fis._fields))
    return _value(arrays[f"gains.{field}"])


def _model(arrays: dict[str, Any], n: int) -> Model:
    names = [name for name in field_names(Model) if name not in ("scratch", "about_origin")]
    return Model(**{name: _value(arrays[f"model.{name}"]) for name in names}, scratch=scratch_for(n))


def _value(array: Any) -> Any:
    return array.item() if array.ndim == 0 else array


def _read(size: int) -> bytes:
    """Return as many bytes; none where there are no more."""
    found = b""
    while len(found) < size:
        part = os.read(READ, size - len(found))
        if not part:
            return b""
        found += part
    return found


def _write(data: bytes) -> None:
    while data:
        data = data[os.write(WRITE, data) :]


def _part() -> bytes:
    (size,) = struct.unpack("<q", _read(8))
    return _read(size)


def _send(text: str) -> None:
    data = text.encode()
    _write(struct.pack("<q", len(data)) + data)
