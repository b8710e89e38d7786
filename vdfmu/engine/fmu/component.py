"""An FMU of FMI 3.0 whose binary is a component of WebAssembly, in a sandbox: the draft FMI-LS-WASM, of July 2026.

A component has memory of its own and the callbacks of FMI, and no files, environment, arguments or network of this
machine. One that imports WASI, as compilers make them, gets a WASI without any of those; clocks and random numbers
remain. Time and memory are limited as for any FMU, by isolation.
"""

from __future__ import annotations

import atexit
import ctypes as ct
import re
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.base.process import is_limited
from vdfmu.engine.fmu import component_values as cv
from vdfmu.engine.fmu.access import Call, Transfer
from vdfmu.engine.fmu.component_types import drafted, type_of
from vdfmu.engine.fmu.instance3 import Instance3
from vdfmu.engine.fmu.messages import STATUS, boxes, on_message

_PACKAGE = "fmi:fmi3/{}@3.0.0"
_OK = 2
"""Length of the name of the status ``ok``; no other is as short."""
_CALLBACKS = {
    "callbacks": ("log-message", "clock-update", "lock-preemption", "unlock-preemption"),
    "intermediate-update-callbacks": ("intermediate-update",),
}
"""Functions that a component may import. It cannot be called from them: nothing is set in an intermediate update."""


class _StepAnswer(ct.Structure):
    """The fields of the result of a step, each with its name before it; `found` in C."""

    _fields_ = (
        ("_last", ct.c_char * 24), ("last", ct.c_double), ("_event", ct.c_char * 40), ("event", ct.c_bool),
        ("_ends", ct.c_char * 47), ("ends", ct.c_bool), ("_early", ct.c_char * 47), ("early", ct.c_bool),
    )  # fmt: skip


@lru_cache(maxsize=16)
def _compiled(path: str, _: int) -> tuple[Any, Any]:
    """Return an engine, and a component that it has compiled."""
    from wasmtime import Config, Engine
    from wasmtime.component import Component

    config = Config()
    if is_limited("AS"):  # else 4 GiB of addresses for each memory spare checks of bounds
        config.memory_reservation, config.memory_reservation_for_growth = 0, 2**24
    engine = Engine(config)
    return engine, Component.from_file(engine, path)


atexit.register(_compiled.cache_clear)  # while wasmtime can still free what it has made


def sandboxed(engine: Any, component: Any, log: Callable[..., None]) -> tuple[Any, Any]:
    """Return a store and an instance of a component in it, which reaches the callbacks of FMI, and no machine."""
    from wasmtime import Store, WasiConfig
    from wasmtime.component import Linker

    store, linker = Store(engine), Linker(engine)
    if any(name.startswith("wasi:") for name in component.type.imports(engine)):
        linker.add_wasip2()
        store.set_wasi(WasiConfig())
    with linker.root() as root:
        for interface, names in _CALLBACKS.items():
            with root.add_instance(_PACKAGE.format(interface)) as offered:
                for name in names:
                    offered.add_func(name, log if name == "log-message" else _ignore)
    return store, linker.instantiate(store, component)


class ComponentInstance(Instance3):
    """An instance of an FMU of FMI 3.0 in a sandbox.

    `_Methods` takes the place of fmpy's instance; functions take Python's values.
    """

    _unit: cv.Handle | None = None

    def loaded(self, path: Path) -> Any:
        """See `Library.loaded`."""
        try:
            from wasmtime import WasmtimeError
        except ImportError:
            reason = "it is a component of WebAssembly, for which the package wasmtime is not installed: pip install "
            reason += "'vdfmu[wasm]', or run a library that it has (--no-sandbox)"
            raise CosimError(self.name, "load", self.box.time, reason) from None
        try:
            self._watch(self.name, "load", self._start)(path)
        except (OSError, WasmtimeError) as error:
            text = " ".join(line.strip() for line in str(error).splitlines())
            raise CosimError(self.name, "load", self.box.time, text) from None
        return _Methods(self)

    def _start(self, path: Path) -> None:
        from wasmtime import _ffi

        assert ct.sizeof(_ffi.wasmtime_component_val_t) == cv.ROW
        engine, self._component = _compiled(str(path), path.stat().st_mtime_ns)
        self._store, self._instance = sandboxed(engine, self._component, partial(_log, self.token))
        kind = "model-exchange" if self.description.exchange else "co-simulation"
        self._kind_name = kind
        self._interface = self._component.get_export_index(_PACKAGE.format(kind))
        self._context = ct.cast(self._store._context(), ct.c_void_p).value
        self._kept: list[Any] = []
        self._named: dict[str, Any] = {}

    # ------------------------------------------------------------------ calls

    def _method(self, call: str) -> str:
        return f"[method]{self._kind_name}-instance.{_dashed(call)}"

    def _bind(self, name: str, words: cv.Words, call: str) -> tuple[Callable[[], int], Any]:
        """Return a call of a function of the interface with its arguments, and the words of its result."""
        if name not in self._functions:
            index = self._interface and self._component.get_export_index(name, self._interface)
            function = index and self._instance.get_func(self._store, index)
            if not function:
                raise CosimError(self.name, call, self.box.time, f"the component has no function {name}")
            expected, found = drafted(self._kind_name).get(name), type_of(function.type(self._store))
            if found != expected:
                reason = f"the component's function {name} has another type than in FMI-LS-WASM: "
                raise CosimError(self.name, call, self.box.time, f"{reason}expected {expected}, got {found}")
            self._kept.append(function)
            head = _address(ct.addressof(function._func)), _address(self._context)
            self._functions[name] = self._watch(
                self.name, call, partial(_function("wasmtime_component_func_call"), *head)
            )
        answer = (ct.c_uint64 * (cv.ROW // 8))()
        count, one = (ct.c_size_t.from_param(n) for n in (len(words), 1))
        places = _address(words.ctypes.data), count, _address(ct.addressof(answer)), one
        return partial(self._functions[name], *places), answer

    def _trapped(self, call: str, error: int) -> None:
        """End an instance whose code trapped."""
        from wasmtime import WasmtimeError, _ffi

        pointer = ct.cast(error, ct.POINTER(_ffi.wasmtime_error_t))
        failure = WasmtimeError._from_ptr(pointer)  # pyright: ignore[reportPrivateUsage]
        lines = [line.strip() for line in str(failure).splitlines() if line.strip()]
        text = f"its code trapped: {lines[-1]}"
        on_message(self.token, STATUS.index("fatal"), b"logStatusFatal", text.encode())
        self.judge(STATUS.index("fatal"), call)

    def ask(self, call: str, *values: Any) -> Any:
        """Call a method with values; return its result, CosimError for a status above warning."""
        kept: list[Any] = []
        words = cv.encode([self._unit, *values], kept)
        run, answer = self._bind(self._method(call), words, call)
        if error := run():
            self._trapped(call, error)
        found = cv.decode(ct.addressof(answer))
        failed = found.value if isinstance(found, cv.Failed) else found if isinstance(found, str) else "ok"
        if failed != "ok":
            self.judge(STATUS.index(failed), call)
        return found

    def function(self, name: str) -> Any:
        """Return a function of FMI that takes ctypes arguments, of those that are called by name."""
        if name not in self._named:
            known = {"DoStep": self._stepping, "SetTime": self._timing}
            self._named[name] = known[name]() if name in known else self._passing(name)
        return self._named[name]

    def _passing(self, name: str) -> Callable[..., int]:
        """Return a function that gets or sets floats at an address, as many as the component has of them."""
        sizes: dict[int, Any] = {}

        def passed(_: Any, first: Any, size: Any) -> int:
            n = size.value
            if n not in sizes:
                memory = cv.Places(lambda address: np.ctypeslib.as_array((ct.c_double * n).from_address(address)))
                sizes[n] = self._moving(name[0].lower() + name[1:], [], np.float64, n), memory
            move, memory = sizes[n]
            return move(memory[first.value])

        return passed

    def _floats(self, call: str, *values: Any) -> tuple[list[Any], Callable[[], int], Any]:
        """Return a call of a method that begins with floats: their places, and what `_bind` returns."""
        words = cv.encode([self._unit, *values], self._kept)
        places = [ct.c_double.from_address(words.ctypes.data + cv.ROW * (k + 1) + 8) for k in range(len(values))]
        return places, *self._bind(self._method(call), words, call)

    def _timing(self) -> Callable[..., int]:
        (place,), run, answer = self._floats("setTime", 0.0)

        def set_time(_: Any, time: Any) -> int:
            place.value = time.value
            if error := run():
                self._trapped("setTime", error)
            return 0 if answer[1] == _OK else STATUS.index(cv.decode(ct.addressof(answer)))

        return set_time

    def _moving(self, call: str, references: Any, dtype: Any, n: int) -> Callable[[Any], int]:
        """Return a function that gets or sets `n` numbers in a memory that it takes; it prepares the rest once."""
        values, numbers = cv.rows(dtype, n)
        lists = [values] if call.startswith("set") else []
        kept: list[Any] = []
        if references:
            first, places = cv.rows(np.uint32, len(references))
            places[:] = references
            lists.insert(0, first)
            kept.append(first)
        words = cv.encode([self._unit, *[np.zeros(0, np.uint32)] * len(lists)], kept)
        for row, each in zip(words[1:], lists, strict=True):
            row[1:3] = len(each), each.ctypes.data
        run, answer = self._bind(self._method(call), words, call)
        head, found = cv.heads(), cv.views(dtype, n)

        def put(memory: Any, kept: Any = kept) -> int:
            numbers[:] = memory
            if error := run():
                self._trapped(call, error)
            return 0 if answer[1] == _OK else STATUS.index(cv.decode(ct.addressof(answer)))

        def get(memory: Any, kept: Any = kept) -> int:
            if error := run():
                self._trapped(call, error)
            if not answer[1] & 0xFF:
                return STATUS.index(cv.decode(answer[2]))
            size, place = head[answer[2]]
            if size != n:
                self._filled(call, memory, cv.decode(answer[2]))
            memory[:] = found[place]
            return 0

        return put if call.startswith("set") else get

    def _filled(self, call: str, memory: Any, found: Any) -> None:
        if len(found) != memory.size:
            reason = f"expected {memory.size} values, got {len(found)}"
            raise CosimError(self.name, call, self.box.time, reason)
        memory[:] = found

    def _stepping(self) -> Callable[..., int]:
        """Return the function that steps, with an address for each answer; its arguments are prepared once."""
        (begin, length, _), run, answer = self._floats("doStep", 0.0, 0.0, True)
        head, answers = cv.heads(), cv.Places(_StepAnswer.from_address)

        def step(_: Any, clock: Any, size: Any, keep: Any, event: Any, ends: Any, early: Any, last: Any) -> int:
            begin.value, length.value = clock.value, size.value
            if error := run():
                self._trapped("doStep", error)
            if not answer[1] & 0xFF:
                return STATUS.index(cv.decode(answer[2]))
            found = answers[head[answer[2]][1]]
            event._obj[:3] = found.event, found.ends, found.early
            last._obj.value = found.last
            return 0

        return step

    # ------------------------------------------------------------------ as other instances

    def make(self) -> None:
        """See `Instance.make`."""
        d, kind = self.description, self._kind_name
        flags = [False, True] if d.exchange else [False, True, self.event_mode, self.event_mode, np.zeros(0, np.uint32)]
        kept: list[Any] = []
        words = cv.encode([self.name, d.guid, "resources/", *flags], kept)
        run, self._answer = self._bind(f"[static]{kind}-instance.instantiate-{kind}", words, "instantiate")
        if error := run():
            self._trapped("instantiate", error)
        self._unit = cv.decode(ct.addressof(self._answer))
        if self._unit is None:
            self.stage = "failed"
            raise CosimError(self.name, "instantiate", self.box.time, self.box.reason(self.name))
        self.fmu.component = 1

    def value_call(self, moved: Transfer) -> Call:
        """See `Instance.value_call`."""
        if moved.native in ("String", "Binary"):
            raise CosimError(self.name, moved.name, self.box.time, "texts of components are not supported")
        move = self._moving(moved.name, moved.references, moved.memory.dtype, moved.memory.size)
        return moved.around(partial(move, moved.memory)), (), moved.name

    def differentiate(self, unknowns: Sequence[int], size: int, knowns: Sequence[int], seeds: Floats) -> Floats:
        """See `Instance.differentiate`."""
        ends = [np.array(each, np.uint32) for each in (unknowns, knowns)]
        found = np.zeros((len(seeds), size))
        for row, seed in zip(found, np.asarray(seeds, np.float64), strict=True):
            self._filled("getDirectionalDerivative", row, self.ask("getDirectionalDerivative", *ends, seed))
        return found

    def release(self) -> None:
        """Drop the handle, which frees the instance."""
        drop = _function("wasmtime_component_resource_any_drop")
        assert self._unit is not None
        places = _address(self._context), _address(self._unit.address)
        if error := self._watch(self.name, "freeInstance", drop)(*places):
            self._trapped("freeInstance", error)
        self._store.close()


class _Methods:
    """The calls of fmpy's instance that occur once or at events."""

    component: Any = None

    def __init__(self, instance: ComponentInstance) -> None:
        self._instance = instance
        self.freeInstance = instance.release

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return partial(self._instance.ask, name)

    def enterInitializationMode(
        self, tolerance: float | None = None, startTime: float = 0.0, stopTime: float | None = None
    ) -> None:
        self._instance.ask("enterInitializationMode", cv.Optional(tolerance), float(startTime), cv.Optional(stopTime))

    def completedIntegratorStep(self) -> Any:
        return self._instance.ask("completedIntegratorStep", True)

    def getFMUState(self) -> Any:
        """Return the bytes of a state; an empty list does not say what it is a list of."""
        return np.asarray(self._instance.ask("getFMUState"), np.uint8)

    def freeFMUState(self, state: Any) -> None:
        """Do nothing: a state is bytes."""

    def serializeFMUState(self, state: Any) -> bytes:
        return state.tobytes()

    def deserializeFMUState(self, content: bytes) -> Any:
        return np.frombuffer(content, np.uint8)


_address = ct.c_void_p.from_param


def _function(name: str) -> Any:
    """Return a function of wasmtime's library, which returns the address of an error, or 0; its package has others."""
    from wasmtime import _ffi

    library: Any = _ffi.dll
    function = library[name]
    function.restype = ct.c_size_t
    return function


def _dashed(name: str) -> str:
    """Return the name of a function in the draft, ``get-fmu-state`` for ``getFMUState``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name.replace("UInt", "Uint").replace("FMUS", "FmuS")).lower()


def _ignore(_: Any, *update: Any) -> Any:
    return (False, 0.0) if update else None


def _log(token: int, _: Any, name: str, status: str, category: str, text: str) -> None:
    if token in boxes:
        on_message(token, STATUS.index(status), category.encode(), text.encode())
