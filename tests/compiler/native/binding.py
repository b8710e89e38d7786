"""FMI 2.0 and 3.0 of a unit as plain C calls: any argument can be given, and every status comes back."""

from __future__ import annotations

import ctypes as ct
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import numpy as np

from tests.compiler.native.fmi_types import LOG_2, LOG_3, UPDATE, Callbacks, signatures

OK, DISCARD, ERROR, FATAL = 0, 2, 3, 4


class Variable(NamedTuple):
    """One variable of the model description; an array of FMI 3 has the names of its elements."""

    name: str
    reference: int
    type: str  # Real, Integer or Boolean
    causality: str
    variability: str
    names: tuple[str, ...]

    @property
    def group(self) -> str:
        """Name without index."""
        return self.name.split("[")[0]


_TYPES = {"Float64": "Real", "Int32": "Integer", "Real": "Real", "Integer": "Integer", "Boolean": "Boolean"}


def read_variables(folder: Path) -> list[Variable]:
    variables: list[Variable] = []
    for v in fmpy.read_model_description(folder, validate=False).modelVariables or ():
        indices = product(*(range(1, length + 1) for length in v.shape or ()))
        names = tuple(f"{v.name}[{','.join(map(str, i))}]" if i else v.name for i in indices)
        variability = v.variability or "continuous"
        variables.append(Variable(v.name, v.valueReference, _TYPES[v.type], v.causality, variability, names))
    return variables


class Model:
    """An unpacked FMU of this machine: its description and its library."""

    def __init__(self, folder: Path, library: Path | None = None) -> None:
        self.folder = folder
        self.root = ET.parse(folder / "modelDescription.xml").getroot()
        self.version = self.root.attrib["fmiVersion"]
        self.major = self.version[0]
        self.name = self.root.attrib["modelName"]
        self.guid = self.root.get("guid") or self.root.attrib["instantiationToken"]
        self.is_python = self.root.find("CoSimulation[@needsExecutionTool='true']") is not None
        self.variables = read_variables(folder)
        self.references = {name: (v, i) for v in self.variables for i, name in enumerate(v.names)}
        if library is None:
            place = fmpy.platform if self.major == "2" else fmpy.platform_tuple
            library = folder / "binaries" / place / f"{self.name}{fmpy.sharedLibraryExtension}"
        self.library = ct.CDLL(str(library))
        for name, (result, arguments) in signatures(self.version).items():
            if self.is_python and not hasattr(self.library, f"fmi{self.major}{name}"):
                continue  # pythonfmu's library has none of model exchange
            function = getattr(self.library, f"fmi{self.major}{name}")
            function.restype, function.argtypes = result, arguments

    def function(self, name: str) -> Callable[..., Any]:
        """C function of a name without prefix."""
        return getattr(self.library, f"fmi{self.major}{name}")

    def of(self, *causalities: str) -> list[Variable]:
        """Real variables of some causalities."""
        return [v for v in self.variables if v.causality in causalities and v.type == "Real"]

    def group(self, name: str) -> list[Variable]:
        """Variables of a name, or of a group that has no array."""
        members = [v for v in self.variables if name in (v.name, v.group)]
        assert members, name
        return members

    @property
    def n_states(self) -> int:
        """Number of continuous states."""
        return sum(len(v.names) for v in self.of("local"))


def doubles(values: Any) -> Any:
    flat = np.ravel(np.asarray(values, dtype=float))
    return (ct.c_double * len(flat))(*flat)


def references(values: Sequence[int]) -> Any:
    return (ct.c_uint32 * len(values))(*values)


class Message(NamedTuple):
    """What a logger received."""

    status: int
    category: str
    text: str


class Instance:
    """One instance; `kind` is CoSimulation or ModelExchange. `call(name, ..)` is any call of FMI.

    `update` is called in an intermediate update of FMI 3 with (unit, time, set_requested, can_return_early) and
    returns the time to return at, or None.
    """

    def __init__(
        self,
        model: Model,
        kind: str = "CoSimulation",
        name: str = "unit",
        *,
        guid: str | None = None,
        logging: bool = False,
        update: Callable[..., float | None] | None = None,
        early: bool = False,
    ) -> None:
        self.model, self.kind, self.time = model, kind, 0.0
        self.messages: list[Message] = []
        self.update = update
        token = (model.guid if guid is None else guid).encode()
        logging = logging or model.is_python  # whose library passes errors on with logging on alone
        resources = (model.folder / "resources").as_uri().encode()
        if model.major == "2":
            self._log: Any = LOG_2(lambda _, __, status, category, text: self._receive(status, category, text))
            self._callbacks = Callbacks(self._log)
            self.pointer = model.function("Instantiate")(
                name.encode(), int(kind == "CoSimulation"), token, resources, ct.byref(self._callbacks), 0, logging
            )
        else:
            self._log = LOG_3(lambda _, status, category, text: self._receive(status, category, text))
            logger = ct.cast(self._log, ct.c_void_p)
            if kind == "CoSimulation":
                self._update = UPDATE(self._updated) if update else None
                callback = ct.cast(self._update, ct.c_void_p) if self._update else None
                self.pointer = model.function("InstantiateCoSimulation")(
                    name.encode(), token, resources, False, logging, False, early, None, 0, None, logger, callback
                )  # fmt: skip
            else:
                self.pointer = model.function("InstantiateModelExchange")(
                    name.encode(), token, resources, False, logging, None, logger
                )

    def _receive(self, status: int, category: bytes, text: bytes) -> None:
        # what is no UTF-8 shows as U+FFFD, which no message has: an exception would not leave the callback
        self.messages.append(Message(status, (category or b"").decode(), text.decode(errors="replace")))

    def _updated(
        self, _: Any, time: float, requested: bool, readable: bool, done: bool, early: bool, ask: Any, when: Any
    ) -> None:
        assert readable and done and self.update is not None
        wanted = self.update(self, time, requested, early)
        ask[0] = wanted is not None
        when[0] = 0.0 if wanted is None else wanted

    def call(self, name: str, *arguments: Any) -> int:
        """Call a function of FMI with this instance and return its status."""
        return self.model.function(name)(self.pointer, *arguments)

    def do(self, name: str, *arguments: Any) -> Instance:
        """Call a function that must succeed."""
        status = self.call(name, *arguments)
        assert status == OK, (name, status, self.messages[-1:])
        return self

    def free(self) -> None:
        """Free the instance."""
        if self.pointer:
            self.model.function("FreeInstance")(self.pointer)
            self.pointer = None

    @contextmanager
    def refuses(self, words: str = "", status: int = ERROR) -> Iterator[Callable[..., None]]:
        """Give a function that makes a call, which must fail with a status and one message that matches `words`.

        Of a Python unit any failure is fatal, and the message has a head of pythonfmu's.
        """

        def refused(name: str, *arguments: Any) -> None:
            count = len(self.messages)
            expected = FATAL if self.model.is_python else status
            assert self.call(name, *arguments) == expected, (name, arguments, self.messages[count:])
            assert len(self.messages) == count + 1, (name, arguments, self.messages[count:])
            said = self.messages[-1]
            assert said.status == expected
            if self.model.is_python:
                assert re.search(words, said.text.partition("\n")[2]), said.text
                return
            assert said.category == ("logStatusDiscard" if status == DISCARD else "logStatusError")
            assert re.search(words, said.text), said.text

        yield refused

    def setup(self, time: float = 0.0, tolerance: float | None = None) -> Instance:
        """Take the start time; in FMI 3 it is told when the initialization starts."""
        self.time, self._tolerance = time, tolerance
        if self.model.major == "2":
            self.do("SetupExperiment", tolerance is not None, tolerance or 0.0, time, 0, 0.0)
        return self

    def enter(self) -> Instance:
        """Enter initialization mode."""
        if self.model.major == "2":
            return self.do("EnterInitializationMode")
        tolerance = self._tolerance
        return self.do("EnterInitializationMode", tolerance is not None, tolerance or 0.0, self.time, False, 0.0)

    def start(self, time: float = 0.0, tolerance: float | None = None, **values: Any) -> Instance:
        """Set values and take the unit through initialization."""
        return self.setup(time, tolerance).set(**values).enter().do("ExitInitializationMode")

    def continuous(self) -> Instance:
        """Enter continuous-time mode from event mode."""
        return self.do("EnterContinuousTimeMode")

    def step_arguments(self, point: float, size: float) -> tuple[Any, ...]:
        """Return arguments of doStep after the instance."""
        if self.model.major == "2":
            return point, size, 1
        self._flags, self._last = (ct.c_bool * 3)(), ct.c_double()
        base = ct.addressof(self._flags)
        return point, size, True, base, base + 1, base + 2, ct.byref(self._last)

    def step(self, size: float = 1e-3, **inputs: Any) -> Instance:
        """Set inputs and make a step from where the last one ended."""
        self.set(**inputs).do("DoStep", *self.step_arguments(self.time, size))
        self.time += size
        if self.model.major == "3":
            assert not self._flags[0] and not self._flags[1]
            if self._flags[2]:
                self.time = self._last.value
        return self

    @property
    def early(self) -> bool:
        """Whether the last step of FMI 3 ended early."""
        return self._flags[2]

    def read(self, variables: Sequence[Variable]) -> np.ndarray:
        """Values of variables of one type, one after the other."""
        n = sum(len(v.names) for v in variables)
        kind = variables[0].type if variables else "Real"
        room = self._room(kind, n)
        self.do(f"Get{self._type(kind)}", *self._values(variables, room))
        return np.array(room[:])

    def write(self, variables: Sequence[Variable], values: Any) -> Instance:
        """Set variables of one type."""
        return self.do(f"Set{self._type(variables[0].type)}", *self.write_arguments(variables, values))

    def write_arguments(self, variables: Sequence[Variable], values: Any) -> tuple[Any, ...]:
        """Return arguments of a set function after the instance."""
        n = sum(len(v.names) for v in variables)
        kind = variables[0].type
        cast = {"Real": float, "Integer": int, "Boolean": bool}[kind]
        room = self._room(kind, n)
        room[:] = [cast(value) for value in np.broadcast_to(values, n)]
        return self._values(variables, room)

    def _values(self, variables: Sequence[Variable], room: Any) -> tuple[Any, ...]:
        refs = references([v.reference for v in variables])
        return (refs, len(refs), room) + ((len(room),) if self.model.major == "3" else ())

    def _type(self, kind: str) -> str:
        return kind if self.model.major == "2" else {"Real": "Float64", "Integer": "Int32"}.get(kind, kind)

    def _room(self, kind: str, n: int) -> Any:
        boolean = ct.c_int if self.model.major == "2" else ct.c_bool
        return ({"Real": ct.c_double, "Integer": ct.c_int, "Boolean": boolean}[kind] * n)()

    def get(self, name: str) -> np.ndarray:
        """Values of a group, ``q``, or of one element, ``q[1]``."""
        if name in self.model.references:
            variable, i = self.model.references[name]
            return self.read([variable])[i]
        return self.read(self.model.group(name))

    def set(self, **values: Any) -> Instance:
        """Set groups: ``set(q_0=[0.1, 0.2], equilibrium=False)``."""
        for name, value in values.items():
            self.write(self.model.group(name), value)
        return self

    def set_one(self, name: str, value: Any) -> Instance:
        """Set one element."""
        variable, i = self.model.references[name]
        if len(variable.names) > 1:
            whole = self.read([variable])
            whole[i] = value
            value = whole
        return self.write([variable], value)

    def outputs(self) -> np.ndarray:
        """All outputs in order."""
        return self.read(self.model.of("output"))

    def inputs(self, values: Any) -> Instance:
        """Set all inputs in order."""
        return self.write(self.model.of("input"), values)

    def states(self, x: Any) -> Instance:
        """Set the continuous states."""
        return self.do("SetContinuousStates", doubles(x), len(x))

    def get_states(self) -> np.ndarray:
        """Continuous states."""
        return self._vector("GetContinuousStates")

    def derivatives(self) -> np.ndarray:
        """Return the derivatives of the states."""
        return self._vector("GetDerivatives" if self.model.major == "2" else "GetContinuousStateDerivatives")

    def _vector(self, name: str) -> np.ndarray:
        room = (ct.c_double * self.model.n_states)()
        self.do(name, room, len(room))
        return np.array(room[:])

    def directional(self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Any) -> np.ndarray:
        """Directional derivative of unknowns in direction `seed` of knowns."""
        return self._product("GetDirectionalDerivative", unknowns, knowns, seed, unknowns)

    def adjoint(self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Any) -> np.ndarray:
        """Adjoint derivative: `seed` of the unknowns times the Jacobian (FMI 3)."""
        return self._product("GetAdjointDerivative", unknowns, knowns, seed, knowns)

    def _product(self, name: str, unknowns: Any, knowns: Any, seed: Any, results: Any) -> np.ndarray:
        room = (ct.c_double * sum(len(v.names) for v in results))()
        lists = [references([v.reference for v in listed]) for listed in (unknowns, knowns)]
        seed = doubles(seed)
        if self.model.major == "2":
            tail: tuple[Any, ...] = (seed, room)
        else:
            tail = (seed, len(seed), room, len(room))
        self.do(name, lists[0], len(lists[0]), lists[1], len(lists[1]), *tail)
        return np.array(room[:])

    @property
    def _state(self) -> str:
        return "FMUstate" if self.model.major == "2" else "FMUState"

    def save(self) -> ct.c_void_p:
        """Save the state."""
        pointer = ct.c_void_p()
        self.do(f"Get{self._state}", ct.byref(pointer))
        return pointer

    def restore(self, pointer: ct.c_void_p) -> Instance:
        """Set a saved state."""
        return self.do(f"Set{self._state}", pointer)

    def forget(self, pointer: ct.c_void_p) -> Instance:
        """Free a saved state."""
        return self.do(f"Free{self._state}", ct.byref(pointer))

    def serialize(self, pointer: ct.c_void_p) -> bytes:
        """Bytes of a saved state."""
        size = ct.c_size_t()
        self.do(f"Serialized{self._state}Size", pointer, ct.byref(size))
        room = (ct.c_ubyte * size.value)()
        self.do(f"Serialize{self._state}", pointer, room, len(room))
        return bytes(room)

    def deserialize(self, data: bytes) -> ct.c_void_p:
        """Make a saved state of bytes."""
        pointer = ct.c_void_p()
        self.do(self.deserialize_name, data, len(data), ct.byref(pointer))
        return pointer

    @property
    def deserialize_name(self) -> str:
        """FMI 2.0 and 3.0 spell it differently."""
        return f"DeSerialize{self._state}" if self.model.major == "2" else f"Deserialize{self._state}"

    def complete(self) -> bytes:
        """Return all that decides the future, as bytes; the instance stays as it is."""
        pointer = self.save()
        data = self.serialize(pointer)
        self.forget(pointer)
        return data


def same_bits(a: Any, b: Any) -> bool:
    return np.asarray(a, dtype=float).tobytes() == np.asarray(b, dtype=float).tobytes()
