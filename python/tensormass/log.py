"""LCM logs (tm-sim --record, lcm-logger) as arrays, one a channel. Does not need LCM: reads the types from the definitions in this package."""
from __future__ import annotations

import os
import pathlib
import re
import struct
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Tuple, Union

import numpy as np

from . import _bind as c
from ._core import FileError, fields

_FOLDER = pathlib.Path(__file__).resolve().parent / "lcm_types"
_SYNC = 0xEDA1DA01
_KINDS = {"int8_t": "i1", "int16_t": ">i2", "int32_t": ">i4", "int64_t": ">i8", "byte": "u1", "float": ">f4", "double": ">f8", "boolean": "i1"}
_MASK = (1 << 64) - 1


class Field(NamedTuple):
    """One member of a message."""

    name: str
    kind: str
    dims: Tuple[Union[int, str], ...]  #: numbers, or names of the members that store them


class Type:
    """A message type: its members, fingerprint and decoder."""

    def __init__(self, text: str) -> None:
        body = re.sub(r"//.*", "", text)
        found = re.search(r"struct\s+(\w+)\s*\{(.*)\}", body, re.S)
        if not found:
            raise FileError("no message definition", c.TM_ERR_FILE)
        self.name = found[1]
        constants = {k: int(v) for line in re.findall(r"const\s+\w+\s+([^;]*);", found[2]) for k, v in re.findall(r"(\w+)\s*=\s*(-?\d+)", line)}
        self.fields: List[Field] = []
        for kind, names in re.findall(r"(\w+)\s+([^;]+);", re.sub(r"const[^;]*;", "", found[2])):
            for name in names.split(","):
                spelled = re.match(r"\s*(\w+)((?:\[\w+\])*)", name)
                if not spelled:
                    continue
                dims = [d for d in re.findall(r"\[(\w+)\]", spelled[2])]
                self.fields.append(Field(spelled[1], kind, tuple(int(d) if d.isdigit() else constants.get(d, d) for d in dims)))
        self.fingerprint = self._hash()
        #: layout on the wire, for messages of fixed size
        self.dtype: Optional[np.dtype[Any]] = None
        if all(f.kind != "string" and all(isinstance(d, int) for d in f.dims) for f in self.fields):
            self.dtype = np.dtype([(f.name, _KINDS[f.kind], f.dims) for f in self.fields])

    def _hash(self) -> int:
        def signed(v: int) -> int:
            v &= _MASK
            return v - (1 << 64) if v >> 63 else v

        def add(v: int, byte: int) -> int:
            return signed(((v << 8) ^ (signed(v) >> 55)) + byte)

        def word(v: int, text: str) -> int:
            v = add(v, len(text))
            for character in text:
                v = add(v, ord(character))
            return v

        v = 0x12345678
        for f in self.fields:
            v = word(v, f.name)
            v = word(v, f.kind)
            v = add(v, len(f.dims))
            for d in f.dims:
                v = add(v, 0 if isinstance(d, int) else 1)  # LCM_CONST, LCM_VAR
                v = word(v, str(d))
        v &= _MASK
        return ((v << 1) & _MASK) + (v >> 63)

    def decode(self, data: bytes) -> Dict[str, Any]:
        """Decodes a message of any size, without its fingerprint. ValueError: too short or too long."""
        out: Dict[str, Any] = {}
        at = 0
        for f in self.fields:
            if f.kind == "string":
                length, = struct.unpack_from(">i", data, at)
                if length < 1 or at + 4 + length > len(data):
                    raise ValueError(f"{f.name} has length {length}")
                out[f.name] = data[at + 4:at + 3 + length].decode(errors="replace")
                at += 4 + length
                continue
            shape = tuple(d if isinstance(d, int) else int(out[d]) for d in f.dims)
            if any(n < 0 for n in shape):
                raise ValueError(f"{f.name} has a negative length")
            count = int(np.prod(shape, dtype=object)) if shape else 1
            kind = np.dtype(_KINDS[f.kind])
            if count * kind.itemsize > len(data) - at:
                raise ValueError(f"{f.name} is cut short")
            values = np.frombuffer(data, kind, count, at).astype(kind.newbyteorder("="))
            out[f.name] = values.reshape(shape) if shape else values[0].item()
            at += count * kind.itemsize
        if at != len(data):
            raise ValueError(f"{len(data) - at} bytes are left over")
        return out


def message_types() -> Dict[int, Type]:
    """Returns the message types by their fingerprints."""
    types = [Type(p.read_text()) for p in sorted(_FOLDER.glob("*.lcm"))]
    return {t.fingerprint: t for t in types}


class Channel:
    """The messages of one channel. `channel["force_N"]` is an array (n, ...), or a list if messages differ in size."""

    def __init__(self, name: str, type_: Type, log_us: List[int], messages: List[bytes]) -> None:
        self.name, self.type = name, type_.name
        #: (n,) time of reception by the logger, us
        self.log_us = np.array(log_us, np.int64)
        self._type, self._messages = type_, messages
        if type_.dtype is not None:
            #: (n,) structured array, one field a member; None if messages differ in size
            self.array: Any = np.frombuffer(b"".join(messages), type_.dtype).astype(type_.dtype.newbyteorder("="))
        else:
            self.array = None
            self._decoded = [type_.decode(m) for m in messages]

    def __len__(self) -> int:
        return len(self._messages)

    @property
    def fields(self) -> List[str]:
        """Returns the names of the members."""
        return [f.name for f in self._type.fields]

    def __getitem__(self, field: str) -> Any:
        if field not in self.fields:
            raise KeyError(f"{self.name} ({self.type}) has no {field!r}; it has {', '.join(self.fields)}")
        if self.array is not None:
            return self.array[field]
        values = [m[field] for m in self._decoded]
        first = values[0] if values else 0
        if isinstance(first, str) or (isinstance(first, np.ndarray) and any(v.shape != first.shape for v in values)):
            return values
        return np.array(values)

    def __repr__(self) -> str:
        return f"Channel({self.name!r}, {self.type}, {len(self)} messages)"


def _events(whole: bytes) -> Iterator[Tuple[int, str, bytes]]:
    """Yields (us, channel, message) of every complete event; skips damaged ones."""
    at, sync = 0, struct.pack(">I", _SYNC)
    while True:
        at = whole.find(sync, at)
        if at < 0 or at + 28 > len(whole):
            return
        _, _, log_us, name_length, length = struct.unpack_from(">Iqqii", whole, at)
        end = at + 28 + name_length + length
        if not 0 < name_length < 256 or length < 0 or end > len(whole):
            at += 1
            continue
        yield log_us, whole[at + 28:at + 28 + name_length].decode(errors="replace"), whole[at + 28 + name_length:end]
        at = end


def _bytes(path: Union[str, "os.PathLike[str]"]) -> bytes:
    try:
        return pathlib.Path(path).read_bytes()
    except OSError as error:
        raise FileError(f"{os.fspath(path)}: cannot be read: {error.strerror}; give a log of tm-sim --record or lcm-logger", c.TM_ERR_FILE) from None


def read_events(path: Union[str, "os.PathLike[str]"]) -> Iterator[Tuple[int, str, bytes]]:
    """Yields (us, channel, message with its fingerprint) of an LCM log. FileError: unreadable."""
    return _events(_bytes(path))


def read_log(path: Union[str, "os.PathLike[str]"]) -> Dict[str, Channel]:
    """Returns {channel: Channel} of an LCM log. Skips messages of unknown types and damaged ones. FileError: not a log, or unreadable."""
    data = _bytes(path)
    types = message_types()
    found: Dict[str, Tuple[Type, List[int], List[bytes]]] = {}
    events = 0
    for log_us, name, message in _events(data):
        events += 1
        type_ = types.get(int.from_bytes(message[:8], "big"))
        body = message[8:]
        if type_ is None or (name in found and found[name][0] is not type_):
            continue
        if type_.dtype is not None:
            if len(body) != type_.dtype.itemsize:
                continue
        else:
            try:
                type_.decode(body)
            except (ValueError, struct.error):
                continue
        entry = found.setdefault(name, (type_, [], []))
        entry[1].append(log_us)
        entry[2].append(body)
    if not events:
        raise FileError(f"{os.fspath(path)}: holds no event of LCM; give a log of tm-sim --record or lcm-logger", c.TM_ERR_FILE)
    return {name: Channel(name, *entry) for name, entry in sorted(found.items())}
