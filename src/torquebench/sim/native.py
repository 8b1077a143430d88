"""The native path: law, loop and plant compiled behind fixed signatures, and called by address without the GIL."""

from __future__ import annotations

import hashlib
import logging
from functools import cached_property, lru_cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import config
from numba.core.ccallback import CFunc
from numba.core.errors import NumbaError
from numba.extending import intrinsic, register_jitable

from torquebench.dialect import compiler_message, complaints
from torquebench.kernel import is_foreign
from torquebench.kernel.cache import KernelCache, interpreted_steps, without_collection
from torquebench.kernel.struct import WORD, Table, is_structure, layout, structure, structure_at, vector
from torquebench.laws.law import Law, Nothing
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.sim.checked_math import with_checked_math
from torquebench.sim.closed_loop import COMPLETED, RAISED, compiled_closed_loop
from torquebench.sim.interpreted import replay
from torquebench.sim.job import Job, Setup
from torquebench.sim.plants import NativeError, NativePlant, Plant

_log = logging.getLogger(__name__)
LAW_SIGNATURE = types.int64(*([types.int64] * 2), types.float64, *([types.int64] * 8))
"""status = law(gains, belief, t, n, q, qd, q_ref, qd_ref, qdd_ref, memory, tau): addresses but for t and n."""
STEP_SIGNATURE = types.int64(*([types.int64] * 4))
"""step(plant, torque, substeps, varying): addresses of the plant's structure and of three rows of torque."""


def caller(signature: Any) -> Any:
    """Return a function for compiled code that calls a native function of `signature` by its address.

    Args:
        signature: Of integers and doubles only; the function returned takes the address first.
    """

    def word(kind: types.Type) -> Any:
        return ir.DoubleType() if isinstance(kind, types.Float) else WORD

    native = ir.FunctionType(word(signature.return_type), [word(kind) for kind in signature.args])

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        arguments = [builder.extract_value(args[1], i) for i in range(len(signature.args))]
        return builder.call(builder.inttoptr(args[0], native.as_pointer()), arguments)

    @intrinsic
    def call(typingctx: Any, address: Any, arguments: Any) -> Any:
        return signature.return_type(types.int64, types.Tuple(signature.args)), build

    return call


class NativeFunction:
    """A function of native form: compiled, or loaded from the cache on disk, when it is first needed.

    Args:
        signature: Of integers and doubles only.
        function: Its closure must hold only what keeps its value from process to process: plain functions, classes.
    """

    def __init__(self, signature: Any, function: Any) -> None:
        self._signature, self._function = signature, function
        self.name = function.__qualname__
        """The function's name, by which it is found in the cache."""

    @cached_property
    def _compiled(self) -> Any:
        options = {"error_model": "numpy", "_nrt": False}
        compiled: Any = CFunc(self._function, (self._signature.args, self._signature.return_type), {}, options)
        compiled._cache = KernelCache(self._function)
        with without_collection():
            compiled.compile()
        return compiled

    @property
    def is_compiled(self) -> bool:
        """Whether the function is compiled already, in this process or in the cache on disk."""
        if config.DISABLE_JIT:
            return False
        return "_compiled" in vars(self) or KernelCache(self._function).holds(self._signature)

    @property
    def address(self) -> int:
        """Its address."""
        return int(self._compiled.address)

    @cached_property
    def call(self) -> Any:
        """It as a function for Python, which does not hold the interpreter's lock."""
        return self._compiled.ctypes


call_law = caller(LAW_SIGNATURE)
call_step = caller(STEP_SIGNATURE)


RUN_SIGNATURE = types.int64(types.int64, types.int64, types.int64)
"""status = run(job, first, last)."""


job_at = structure_at(Job)


@register_jitable(_nrt=False)
def law_of(job: Job, k: int) -> int:
    """Call the job's law at control instant k."""
    c = job.call
    return call_law(
        c[0],
        (
            c[1],
            c[2],
            k * job.control_period,
            c[6],
            job.measured_q.ctypes.data,
            job.measured_qd.ctypes.data,
            job.q_ref[k].ctypes.data,
            job.qd_ref[k].ctypes.data,
            job.qdd_ref[k].ctypes.data,
            c[3],
            job.record_tau_law[k].ctypes.data,
        ),
    )


@register_jitable(_nrt=False)
def step_of(job: Job, substeps: int, varying: int) -> None:
    """Step the job's plant."""
    call_step(job.call[4], (job.call[5], job.torque.ctypes.data, substeps, varying))


def _run(address: int, first: int, last: int) -> int:
    return compiled_closed_loop(job_at(address), first, last, law_of, step_of, 0)


LOOP = NativeFunction(RUN_SIGNATURE, _run)
"""The closed loop, (job, first, last) -> status."""


belief_at = structure_at(Model)
law_function: Any = None
gains_class: Any = Nothing
memory_class: Any = Nothing
"""Placeholders for the names in `adapter`; each law's copy of it binds them to that law."""


def adapter(
    gains: int,
    belief: int,
    t: float,
    n: int,
    q: int,
    qd: int,
    q_ref: int,
    qd_ref: int,
    qdd_ref: int,
    memory: int,
    tau: int,
) -> int:
    """Call a law on the data at the given addresses; arguments as in `LAW_SIGNATURE`."""
    try:
        law_function(
            structure(gains_class, gains),
            belief_at(belief),
            t,
            vector(q, n),
            vector(qd, n),
            Reference(vector(q_ref, n), vector(qd_ref, n), vector(qdd_ref, n)),
            structure(memory_class, memory),
            vector(tau, n),
        )
    except Exception:  # noqa: BLE001  compiled code knows no other kind
        return RAISED
    return COMPLETED


@lru_cache(maxsize=256)
def native_law(law: Law) -> NativeFunction:
    """Return a law's native function.

    The law's function is compiled as it stands. A division by zero in it, an argument outside the domain of a function
    of `math`, and an element beyond the end of an array end the run as they do interpreted.

    Raises:
        TypeError: its gains or memory hold something that compiled code cannot receive.
    """
    for name, cls in (("gains", law.gains_type), ("memory", law.memory_type or Nothing)):
        if not (is_structure(cls) and len(cls._fields) > 0):
            raise TypeError(f"its {name} are a {cls.__name__}, wanted a NamedTuple class with fields")
        layout(cls)
    function: Any = law.function
    jitable = register_jitable(
        error_model="python",
        boundscheck=is_foreign(function),
        _nrt=False,
        forceinline=True,
    )
    means = {
        "law_function": jitable(with_checked_math(function)),
        "gains_class": law.gains_type,
        "memory_class": law.memory_type or Nothing,
    }
    # numba finds an adapter on disk by its name and code; the code is the same for all laws, so the name tells
    own = FunctionType(adapter.__code__, {**globals(), **means})
    own.__name__ = own.__qualname__ = f"{law.name}_{law_digest(law)}"
    return NativeFunction(LAW_SIGNATURE, own)


def law_digest(law: Law) -> str:
    """Return a digest of a law: its code, the numbers and kernels that it names, and what its gains and memory hold.

    A compiled law is found on disk by this, so that an edited law, constant or kernel is compiled again.
    """
    parts: list[str] = []
    _describe(law.function, parts, set())
    for cls in (law.gains_type, law.memory_type or Nothing):
        parts.append(_layout(cls))
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def _layout(cls: type[Any]) -> str:
    fields, size = layout(cls)
    inner = {
        name: _layout(field.kind) if field.kind not in (int, float) and not field.dimensions else field
        for name, field in fields.items()
    }
    return f"{cls.__name__} {size} {inner}"


def _describe(function: Any, parts: list[str], seen: set[Any]) -> None:
    function = getattr(function, "py_func", function)
    if not isinstance(function, FunctionType) or function in seen:
        return
    seen.add(function)
    code = function.__code__
    parts.append(f"{function.__module__}.{function.__qualname__}")
    _code(code, parts)
    named = {name: function.__globals__[name] for name in code.co_names if name in function.__globals__}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        named[name] = cell.cell_contents
    for name, value in named.items():
        parts.append(f"{name} = {value!r}" if isinstance(value, int | float) else f"{name}: {_name(value)}")
        if not str(getattr(value, "__module__", "")).startswith("torquebench."):
            _describe(value, parts, seen)


def _code(code: CodeType, parts: list[str]) -> None:
    constants = [c for c in code.co_consts if not isinstance(c, str | CodeType)]
    parts.append(f"{code.co_code.hex()} {constants} {code.co_names} {code.co_varnames} {code.co_flags}")


def _name(value: Any) -> str:
    if isinstance(value, ModuleType):
        return value.__name__
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value).__qualname__)}"


WORTH = 40_000
"""Steps that take as long interpreted as it takes to compile law, loop and plant: some 8 s."""
OFTEN = 120_000
"""Steps of one short command after the other, after which a law is compiled: whoever repeats them has waited longer."""
QUICKER = "for so few steps interpreting takes less time than compiling"
"""Reason of `reason_to_interpret` that is a choice, and no obstacle."""
COMPILING = (
    "this law was interpreted, as few short runs need no compiling; now that there are more it is compiled, once"
)
"""Message when runs go over to the compiled path."""


def reason_to_interpret(plant: Plant, law: Law, steps: float) -> str:
    """Return why a run is interpreted where its path is left open; an empty text where it is compiled.

    Both paths leave the same bytes, so that only time is at stake. What cannot be compiled is interpreted. What is
    compiled already, in this process or in the cache on disk, is used. Otherwise a run is interpreted while fewer
    steps than `WORTH` are asked for, and fewer than `OFTEN` with those interpreted of this law so far by whatever
    process. So a first short experiment compiles nothing; a sweep compiles before its first run; and whoever
    runs one loop after the other, in one program or by many commands, goes over to compiled ones after a while.

    Args:
        plant: The truth.
        law: The law.
        steps: Control steps asked for; a step of an interpreted plant that is slow counts as several.
    """
    if found := _plain_obstacle(plant, law):
        return found
    if steps < WORTH and not _is_compiled(plant, law):
        before = interpreted_before(law)
        if before + steps < OFTEN:
            return QUICKER
        _say_compiling()
        interpreted_before(law, -before)  # what cannot be compiled after all is not tried again by each process
    return obstacle(plant, law)


def interpreted_before(law: Law, more: int = 0) -> int:
    """Return how many steps of a law all processes have interpreted because that was quicker, after adding some."""
    return interpreted_steps(native_law(law).name, more)


@lru_cache(maxsize=1)
def _say_compiling() -> None:
    _log.info(COMPILING)


def _is_compiled(plant: Any, law: Law) -> bool:
    try:
        return bool(plant.native_step.is_compiled and LOOP.is_compiled and native_law(law).is_compiled)
    except TypeError:  # of gains or memory: `obstacle` says so
        return True


def _plain_obstacle(plant: Plant, law: Law) -> str:
    """Return why a run cannot be compiled, as far as that shows before it is."""
    if not config.DISABLE_JIT and not hasattr(plant, "native"):
        return f"the plant, a {type(plant).__name__}, has no native form"
    return _outside(law)


def _outside(law: Law) -> str:
    """Return why a law cannot be compiled, as far as that shows before it is."""
    if config.DISABLE_JIT:
        return "numba is switched off (NUMBA_DISABLE_JIT)"
    if found := complaints(law):
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return f"law '{law.name}' keeps to Python: {found[0]}{more}"
    return ""


def obstacle(plant: Plant, law: Law) -> str:
    """Return why a run of `law` on `plant` cannot be compiled; an empty text when it can. Compiles what it needs."""
    if found := _plain_obstacle(plant, law):
        return found
    try:
        plant.native()  # type: ignore[attr-defined]  # seen to be there
    except NativeError as error:
        return str(error)
    return law_obstacle(law)


def law_obstacle(law: Law) -> str:
    """Return why a law cannot be compiled; an empty text when it can. Compiles it."""
    return _outside(law) or _refused(law)


@lru_cache(maxsize=256)
def _refused(law: Law) -> str:
    """Return what the compiler has against a law in the dialect."""
    try:
        _ = native_law(law).address
    except (NumbaError, TypeError) as error:
        return f"law '{law.name}' cannot be compiled: {compiler_message(error, law.function)}"
    return ""


def bind_law(setup: Setup) -> tuple[Table, Table]:
    """Have a job call its law, compiled; what is returned must be kept as long as the job is used."""
    tables, call = (Table(setup.gains), Table(setup.memory)), setup.job.call
    call[:4] = native_law(setup.law).address, tables[0].address, setup.belief.address, tables[1].address
    call[6] = len(setup.job.q)
    return tables


class NativeRun:
    """A run on the native path: call it with a range of control instants to get how they ended.

    Args:
        setup: The run; its law must have no `obstacle`.
        plant: The plant's native form.
    """

    longest = 20_000
    """Control instants to ask for at once, so that progress and interruption get their turn."""

    def __init__(self, setup: Setup, plant: NativePlant) -> None:
        job = setup.job
        self.setup, self._plant, self._later = setup, plant, iter(plant.later)
        self._tables = bind_law(setup)
        self.detail = ""
        """Reason of a failure; empty if there was none."""
        job.call[4:6] = plant.step.address, plant.structure.address
        self._loop = LOOP.call

    def restart(self, plant: NativePlant) -> None:
        """Prepare to run again on the same arrays, from the first of the plant's arms on."""
        self.detail, self._plant, self._later = "", plant, iter(plant.later)
        self.setup.job.call[5] = plant.structure.address

    def change(self) -> None:
        """Have the plant go on as the next of its arms."""
        self.setup.plant.change()  # type: ignore[attr-defined]  # only of a plant that changes
        self.setup.job.call[5] = next(self._later).address

    def __call__(self, first: int, last: int) -> int:
        """Run control instants `first` .. `last` - 1, without holding the interpreter's lock."""
        status = int(self._loop(self.setup.job.address, first, last))
        if status == RAISED:  # interpreted, the failing call tells what it was and where
            status, self.detail = replay(self.setup)
        return status
