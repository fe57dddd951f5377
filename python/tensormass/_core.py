"""Access to the libraries of this package: calls, errors, handles with an order of destruction, views of memory."""
from __future__ import annotations

import contextlib
import ctypes
import pathlib
import platform
import signal
import sys
import threading
import warnings
import weakref
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Type

import numpy as np
from numpy.typing import NDArray

from . import _bind as c

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bytes = NDArray[np.uint8]

# --- errors ---


class Error(Exception):
    """An error that a function of the library returned, with its message: what is wrong; what to do.

    `status`: its name in C ("TM_ERR_MESH"). `entity`: index of the invalid vertex, tetrahedron or region, -1 if none.
    """

    def __init__(self, sentence: str, status: int = 0, entity: int = -1) -> None:
        super().__init__(sentence)
        self.status: str = _status_name(status)
        self.entity: int = entity


class ArgumentError(Error, ValueError):
    """A value outside its stated range."""


class ContractError(ArgumentError):
    """A misuse that no correct program makes: a null, an index out of range, a struct without its defaults. Nothing has changed."""


class NoMemoryError(Error, MemoryError):
    """Memory is exhausted."""


class MeshError(Error, ValueError):
    """Topology or geometry that no element can use."""


class MaterialError(Error, ValueError):
    """Constants that are not positive definite, or not finite."""


class SupportError(Error, ValueError):
    """Boundary conditions that leave a rigid motion free or contradict each other."""


class StepError(Error, ValueError):
    """A time step above the guaranteed critical step."""


class ConvergenceError(Error, ArithmeticError):
    """The stated tolerance was not reached in the stated iterations."""


class UnstableError(Error, ArithmeticError):
    """A displacement passed a thousand times the body's size, or is not finite. The state is as before the call."""


class LimitError(Error):
    """A capacity stated at set-up is exhausted."""


class FileError(Error, OSError):
    """An unreadable, foreign, damaged or truncated file."""


class ExcludedError(Error, ValueError):
    """Two effects that exclude each other."""


class SceneWarning(UserWarning):
    """A valid setting that is probably a mistake, with its file and line."""


class DeformationWarning(UserWarning):
    """Tetrahedra are inverted, or linear tissue is far outside its range. The message says what to do."""


ERRORS: Dict[int, Type[Error]] = {
    c.TM_ERR_ARGUMENT: ArgumentError, c.TM_ERR_MEMORY: NoMemoryError, c.TM_ERR_MESH: MeshError, c.TM_ERR_MATERIAL: MaterialError,
    c.TM_ERR_SUPPORT: SupportError, c.TM_ERR_STEP: StepError, c.TM_ERR_CONVERGENCE: ConvergenceError, c.TM_ERR_UNSTABLE: UnstableError,
    c.TM_ERR_LIMIT: LimitError, c.TM_ERR_FILE: FileError, c.TM_ERR_EXCLUDED: ExcludedError,
}


def _status_name(status: int) -> str:
    return str(lib.tm_status_name(status).decode())


# --- the libraries ---

_FOLDER = pathlib.Path(__file__).resolve().parent / "lib"
_broken = threading.local()


class _Library:
    """The library's functions by name; opens each library at its first call. A contract error raises, whatever the function returns."""

    def __init__(self) -> None:
        self._opened: Dict[str, ctypes.CDLL] = {}

    def _open(self, name: str) -> ctypes.CDLL:
        if name not in self._opened:
            if name != "tensormass":
                self._open("tensormass")  # these libraries require it
            found = sorted(_FOLDER.glob(f"lib{name}.*"))  # .so.0.2, .dll, .0.2.dylib
            if not found:
                raise ImportError(f"{_FOLDER}: lib{name} is not there; " + (
                    "this package was not built whole: make wheel" if sys.platform == "linux" and platform.machine() == "x86_64" else
                    "the package for this system has no scenes, no precomputed and no hybrid model (docs/installing.md)"))
            self._opened[name] = ctypes.CDLL(str(found[-1]))
        return self._opened[name]

    def __getattr__(self, name: str) -> Any:
        if name not in c.FUNCTIONS:
            raise AttributeError(name)
        library, result, arguments = c.FUNCTIONS[name]
        function = getattr(self._open(library), name)
        function.restype, function.argtypes = result, arguments
        if library != "tensormass_controller":
            function.errcheck = _raise_broken
        setattr(self, name, function)
        return function


def _raise_broken(result: Any, function: Any, arguments: Any) -> Any:
    sentence = getattr(_broken, "sentence", None)
    if sentence is None:
        return result
    _broken.sentence = None
    raise ContractError(sentence, c.TM_ERR_ARGUMENT)


lib = _Library()


def _on_contract(function: bytes, sentence: bytes, user: Any) -> None:
    if getattr(_broken, "sentence", None) is None:
        _broken.sentence = f"{function.decode()}: {sentence.decode()}"


_HANDLER = c.tm_contract_handler(_on_contract)
lib.tm_set_contract_handler(_HANDLER, None)


def call(function: Any, *arguments: Any) -> None:
    """Calls a set-up function, whose last argument is the error, and raises that error."""
    error = c.tm_error()
    check(function(*arguments, ctypes.byref(error)), error)


def check(status: int, error: Optional[c.tm_error] = None, sentence: str = "") -> None:
    """Raises if `status` is not TM_OK."""
    if status == c.TM_OK:
        return
    told = error.message.decode(errors="replace") if error is not None and error.message else sentence
    raise ERRORS.get(status, Error)(told or _status_name(status), status, error.entity if error is not None else -1)


@contextlib.contextmanager
def interrupt_noted() -> Iterator[List[Any]]:
    """Notes Ctrl-C in the list and raises it at the end: an exception inside a function that the library calls would be lost."""
    noted: List[Any] = []
    usual = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(usual):
        yield noted
        return
    signal.signal(signal.SIGINT, lambda *what: noted.append(what))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, usual)
        if noted:
            usual(*noted[0])


class Diagnostics:
    """Diagnostics of the scene library: a list to which a scene's calls append."""

    def __init__(self) -> None:
        self.list = c.tm_diagnostics()

    def take(self) -> List[str]:
        """Returns the faults since the last call, one a line, and issues the warnings among them."""
        lines, text = [], ctypes.create_string_buffer(8192)
        item = ctypes.cast(self.list.item, ctypes.POINTER(c.tm_diagnostic))
        for i in range(self.list.count):
            lib.tm_diagnostic_format(ctypes.byref(item[i]), text, len(text))
            lines.append((item[i].severity, text.value.decode(errors="replace")))
        lib.tm_diagnostics_clear(ctypes.byref(self.list))
        for severity, line in lines:
            if severity == c.TM_WARNING:
                warnings.warn(line, SceneWarning, stacklevel=3)
        return [line for severity, line in lines if severity == c.TM_FAULT]


# --- objects of the library ---


class Handle:
    """Handle of one object of the library. Destroys it after its last use and after the objects made from it, in any order of Python's."""

    __slots__ = ("pointer", "keep", "_destroy", "_parents", "_users", "_lock")

    def __init__(self, pointer: int, destroy: Optional[Callable[[int], Any]], parents: Iterable["Handle"] = (), keep: Any = None) -> None:
        self.pointer = pointer
        self.keep = keep  # objects that the library points to: buffers, callbacks
        self._destroy = destroy
        self._parents = list(parents)
        self._users = 1
        self._lock = threading.Lock()
        for parent in self._parents:
            parent.take()

    def outlived_by(self, parent: "Handle") -> None:
        """Destroys `parent` after this handle too."""
        parent.take()
        self._parents.append(parent)

    def take(self) -> None:
        with self._lock:
            self._users += 1

    def release(self) -> None:
        with self._lock:
            self._users -= 1
            last = self._users == 0
        if not last:
            return
        if self._destroy:
            self._destroy(self.pointer)
        self.pointer = 0
        for parent in self._parents:
            parent.release()


class Object:
    """Base of the classes that represent one object of the library."""

    _handle: Handle

    def _own(self, pointer: Any, destroy: Optional[Callable[[int], Any]], parents: Iterable["Object"] = (), keep: Any = None) -> None:
        value = pointer.value if isinstance(pointer, ctypes.c_void_p) else pointer
        self._handle = Handle(value or 0, destroy, [p._handle for p in parents], keep)
        weakref.finalize(self, self._handle.release)

    @property
    def _pointer(self) -> int:
        return self._handle.pointer

    @property
    def _as_parameter_(self) -> ctypes.c_void_p:
        return ctypes.c_void_p(self._handle.pointer)


# --- arrays ---

_KINDS: Dict[str, Any] = {"float64": ctypes.c_double, "float32": ctypes.c_float, "int32": ctypes.c_int32, "int8": ctypes.c_int8, "uint8": ctypes.c_uint8}


def view(owner: object, address: Any, shape: Iterable[int], kind: str = "float64", writable: bool = False) -> Any:
    """Returns memory of the library as an array, without a copy. The array keeps `owner` alive."""
    sizes = tuple(int(n) for n in shape)
    count = int(np.prod(sizes, dtype=np.int64))
    if not address or count == 0:
        return np.zeros(sizes, kind)
    buffer = (_KINDS[kind] * count).from_address(address)
    buffer._owner = owner
    array = np.frombuffer(buffer, dtype=kind).reshape(sizes)
    array.flags.writeable = writable
    return array


def inside(struct: Any, field: str, shape: Iterable[int], owner: object = None) -> Any:
    """Returns an array field of a struct as a view that keeps the struct alive."""
    array = np.ctypeslib.as_array(getattr(struct, field))
    return array.reshape(tuple(shape))


def fields(struct: Any) -> List[str]:
    """Returns the names of a struct's members."""
    return [f[0] for f in struct._fields_]


def field_type(struct: Any, name: str) -> Any:
    """Returns the type of one member, which makes a callback of a Python function."""
    return {f[0]: f[1] for f in struct._fields_}[name]


def floats(values: Any, shape: Iterable[int], name: str) -> Floats:
    """Returns a contiguous array of doubles of exactly this shape (-1: any length)."""
    return _array(values, np.float64, shape, name)


def ints(values: Any, shape: Iterable[int], name: str) -> Ints:
    """Returns a contiguous array of int32 of exactly this shape. Rejects fractions and numbers that do not fit."""
    given = np.asarray(values)
    if given.size and not np.issubdtype(given.dtype, np.integer) and not np.all(given == np.floor(given)):
        raise ArgumentError(f"{name}: has numbers that are not whole; give integers", c.TM_ERR_ARGUMENT)
    if given.size and (given.max() > 2**31 - 1 or given.min() < -2**31):
        raise ArgumentError(f"{name}: has numbers beyond 32 bits; give indices", c.TM_ERR_ARGUMENT)
    return _array(given, np.int32, shape, name)


def _array(values: Any, kind: Any, shape: Iterable[int], name: str) -> Any:
    array = np.ascontiguousarray(values, dtype=kind)
    wanted = tuple(shape)
    if array.ndim != len(wanted) or any(w not in (-1, n) for w, n in zip(wanted, array.shape)):
        spelled = ", ".join("any" if w == -1 else str(w) for w in wanted)
        raise ArgumentError(f"{name}: has shape {array.shape}; give ({spelled})", c.TM_ERR_ARGUMENT)
    return array


def address(array: Optional[NDArray[Any]]) -> Any:
    """Returns the address of an array's memory for a call; None gives null."""
    return None if array is None else ctypes.c_void_p(array.ctypes.data)


def vector(values: Any, name: str) -> Any:
    """Returns three doubles for a call or a struct."""
    return (ctypes.c_double * 3)(*floats(values, (3,), name))


def choice(value: str, names: Dict[str, int], what: str) -> int:
    """Returns the number of a word."""
    if value not in names:
        raise ArgumentError(f"{what} {value!r} is not known; use one of {', '.join(names)}", c.TM_ERR_ARGUMENT)
    return names[value]
