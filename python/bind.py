"""Writes tensormass/_bind.py: the C interface for ctypes, read from the headers, never typed by hand.

    python bind.py OUTPUT CC INCLUDE_FOLDER... -- LIBRARY=HEADER...

Structs, enums, numbers and prototypes come from pycparser. Sizes, offsets and values are printed by a C program that the same compiler makes from the
same headers; the written module is loaded and compared with them before it is kept. Needs pycparser."""
import ctypes
import importlib.util
import pathlib
import re
import subprocess
import sys
import tempfile

from pycparser import c_ast, c_parser

SCALARS = {
    "char": "c_char", "signed char": "c_int8", "_Bool": "c_bool", "bool": "c_bool", "int": "c_int", "float": "c_float", "double": "c_double",
    "int8_t": "c_int8", "uint8_t": "c_uint8", "int16_t": "c_int16", "uint16_t": "c_uint16", "int32_t": "c_int32", "uint32_t": "c_uint32",
    "int64_t": "c_int64", "uint64_t": "c_uint64", "size_t": "c_size_t",
}
# Replacements of the C library's headers, for the parser.
STAND_INS = {
    "stdbool.h": "typedef _Bool bool;\n#define true 1\n#define false 0\n",
    "stddef.h": "typedef unsigned long size_t;\n",
    "stdio.h": "typedef struct FILE FILE;\n",
    "stdint.h": "".join(f"typedef {t} {n};\n" for t, n in (
        ("signed char", "int8_t"), ("unsigned char", "uint8_t"), ("short", "int16_t"), ("unsigned short", "uint16_t"), ("int", "int32_t"),
        ("unsigned int", "uint32_t"), ("long", "int64_t"), ("unsigned long", "uint64_t"))),
}
SYSTEM = {"bool", "size_t", "FILE", *(n for n in SCALARS if n.endswith("_t"))}


class Interface:
    """Declarations of the headers of all libraries, in their order."""

    def __init__(self):
        self.structs = {}  # name -> [(field, ctypes expression, annotation)]; None: opaque
        self.enums = set()
        self.constants = []
        self.callbacks = {}  # typedef of a pointer to function -> expression
        self.functions = {}  # name -> (library, result, [argument])
        self.values = {}  # of enumerators

    # --- types ---

    def number(self, node):
        """Evaluates a constant expression of the headers, such as an array's length."""
        if isinstance(node, c_ast.Constant):
            return int(node.value.rstrip("uUlL"), 0)
        if isinstance(node, c_ast.ID):
            return self.values[node.name]
        if isinstance(node, c_ast.UnaryOp) and node.op == "-":
            return -self.number(node.expr)
        if isinstance(node, c_ast.BinaryOp):
            a, b = self.number(node.left), self.number(node.right)
            return {"+": a + b, "-": a - b, "*": a * b, "/": a // b if b else 0, "<<": a << b if node.op == "<<" else 0, "|": a | b}[node.op]
        raise SystemExit(f"bind.py: {node} is no constant that it can read; extend number()")

    def type_of(self, node, argument=False):
        """Returns (ctypes expression, annotation) of a declaration's type."""
        if isinstance(node, c_ast.TypeDecl):
            return self.type_of(node.type)
        if isinstance(node, c_ast.IdentifierType):
            name = " ".join(node.names)
            if name == "void":
                return "None", "None"
            if name in SCALARS:
                kind = SCALARS[name]
                return kind, {"c_bool": "bool", "c_float": "float", "c_double": "float", "c_char": "bytes"}.get(kind, "int")
            if name in self.enums:
                return "c_int", "int"
            if name in self.callbacks:
                return name, "Any"
            if name in self.structs:
                return name, name
            raise SystemExit(f"bind.py: unknown type {name}")
        if isinstance(node, c_ast.Enum):
            return "c_int", "int"
        if isinstance(node, c_ast.Struct):
            return (node.name, node.name)
        if isinstance(node, c_ast.PtrDecl):
            if isinstance(node.type, c_ast.FuncDecl):
                return self.callback(node.type), "Any"
            inner = node.type
            if isinstance(inner, c_ast.TypeDecl) and isinstance(inner.type, c_ast.IdentifierType) and inner.type.names == ["char"]:
                return "c_char_p", "Any"
            return "c_void_p", "Any"
        if isinstance(node, c_ast.ArrayDecl):
            if argument or node.dim is None:
                return "c_void_p", "Any"
            inner, _ = self.type_of(node.type)
            return f"{inner} * {self.number(node.dim)}", "Any"
        raise SystemExit(f"bind.py: cannot read {node}")

    def arguments(self, node):
        listed = [a for a in (node.args.params if node.args else []) if not isinstance(a, c_ast.EllipsisParam)]
        kinds = [self.type_of(a.type, argument=True)[0] for a in listed]
        return [] if kinds == ["None"] else kinds

    def callback(self, node):
        result, _ = self.type_of(node.type)
        return f"CFUNCTYPE({', '.join([result, *self.arguments(node)])})"

    # --- declarations ---

    def enum(self, node):
        value = -1
        for e in node.values.enumerators if node.values else []:
            value = self.number(e.value) if e.value else value + 1
            self.values[e.name] = value
            self.constants.append(e.name)

    def struct(self, name, node):
        self.structs.pop(name, None)  # the complete definition replaces the forward declaration
        self.structs[name] = None
        if node.decls:
            self.structs[name] = [(d.name, *self.type_of(d.type)) for d in node.decls]

    def take(self, library, node):
        if isinstance(node, c_ast.FuncDef):
            return  # an inline function cannot be called
        kind = node.type
        if isinstance(node, c_ast.Typedef):
            if node.name in SYSTEM:
                return
            if isinstance(kind, c_ast.PtrDecl) and isinstance(kind.type, c_ast.FuncDecl):
                self.callbacks[node.name] = self.callback(kind.type)
            elif isinstance(kind, c_ast.TypeDecl) and isinstance(kind.type, c_ast.Enum):
                self.enums.add(node.name)
                self.enum(kind.type)
            elif isinstance(kind, c_ast.TypeDecl) and isinstance(kind.type, c_ast.Struct):
                if kind.type.decls or node.name not in self.structs:
                    self.struct(node.name, kind.type)
        elif isinstance(kind, c_ast.Enum):
            self.enum(kind)
        elif isinstance(kind, c_ast.Struct) and kind.name in self.structs and kind.decls:
            self.struct(kind.name, kind)
        elif isinstance(kind, c_ast.FuncDecl):
            self.functions.setdefault(node.name, (library, self.type_of(kind.type)[0], self.arguments(kind)))


def preprocessed(header, cc, include, stand_ins):
    flags = [f"-I{i}" for i in (stand_ins, *include)]
    # Removes extensions of the compiler that are not C.
    flags += ["-nostdinc", "-D__attribute__(x)=", "-D__extension__=", "-D_Static_assert(...)=", "-Drestrict="]
    return subprocess.run([cc, "-E", "-P", "-std=c11", *flags, header], capture_output=True, text=True, check=True).stdout


def macros(include):
    """Returns the names of the numbers that headers #define."""
    names = []
    for folder in include:
        for header in sorted(pathlib.Path(folder).rglob("*.h")):
            names += re.findall(r"^#define ((?:TM|HRT)_\w+) [(-]?[0-9A-Z.][^\"\n\\]*$", header.read_text(), re.M)
    return sorted(set(names))


def layout_program(interface, headers, names):
    """Returns a C program that prints sizes, offsets and values as its compiler has them."""
    lines = [f'    printf("E {n} %lld\\n", (long long){n});' for n in interface.constants]
    lines += [f"#ifdef {n}\n    SHOW({n});\n#endif" for n in names]
    for name, fields in interface.structs.items():
        if fields is None:
            continue
        lines.append(f'    printf("S {name} %zu\\n", sizeof({name}));')
        lines += [f'    printf("O {name}.{f} %zu\\n", offsetof({name}, {f}));' for f, _, _ in fields]
    includes = "".join(f'#include "{h}"\n' for h in headers)
    show = ('#define SHOW(n) _Generic((n), double: printf("F " #n " %.17g\\n", _Generic((n), double: (n), default: 0.0)), char *: 0, \\\n'
            '    default: printf("E " #n " %lld\\n", (long long)_Generic((n), char *: 0, default: (n))))\n')
    return "#include <stddef.h>\n#include <stdio.h>\n" + includes + show + "int main(void) {\n" + "\n".join(lines) + "\n    return 0;\n}\n"


def measured(program, cc, include):
    """Returns that program's output on this machine."""
    with tempfile.TemporaryDirectory() as folder:
        at = pathlib.Path(folder) / "layout.c"
        at.write_text(program)
        subprocess.run([cc, "-std=gnu11", "-w", *(f"-I{i}" for i in include), at, "-o", at.with_suffix("")], check=True)
        printed = subprocess.run([at.with_suffix("")], capture_output=True, text=True, check=True).stdout
    told = {"E": {}, "F": {}, "S": {}, "O": {}}
    for line in printed.splitlines():
        kind, name, value = line.split()
        told[kind][name] = float(value) if kind == "F" else int(value)
    return told


def text(interface, told):
    out = ['"""The C interface of the libraries in this package. Made by bind.py from their headers; do not edit."""', "from ctypes import (",
           "    CFUNCTYPE, Structure, c_bool, c_char, c_char_p, c_double, c_float, c_int, c_int8, c_int16, c_int32, c_int64, c_size_t, c_uint8, c_uint16,",
           "    c_uint32, c_uint64, c_void_p,", ")", "from typing import Any, Dict, List, Tuple", ""]
    out += [f"{n} = {v}" for n, v in sorted({**told["E"], **told["F"]}.items())] + [""]
    out += [f"{n}: Any = {e}" for n, e in interface.callbacks.items() if "CFUNCTYPE(tm_" not in e] + [""]
    for name, fields in interface.structs.items():
        if fields is None:
            continue
        out += ["", f"class {name}(Structure):"]
        out += ["    __slots__ = ()  # a member that C does not have is an error, not a new attribute"]
        out += [f"    {f}: {a}" for f, _, a in fields]
        out += ["    _fields_ = ["] + [f'        ("{f}", {t}),' for f, t, _ in fields] + ["    ]", ""]
    out += ["", "# name: (library, result, arguments)", "FUNCTIONS: Dict[str, Tuple[str, Any, List[Any]]] = {"]
    out += [f'    "{n}": ("{library}", {result}, [{", ".join(arguments)}]),' for n, (library, result, arguments) in interface.functions.items()]
    out += ["}", "", "# As the compiler lays them out: tests/python and tests/cross compare.", "SIZES: Dict[str, int] = {"]
    out += [f'    "{n}": {v},' for n, v in told["S"].items()] + ["}", "OFFSETS: Dict[str, int] = {"]
    out += [f'    "{n}": {v},' for n, v in told["O"].items()] + ["}", ""]
    return "\n".join(out)


def compare(path):
    spec = importlib.util.spec_from_file_location("_bind", path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    for name, size in made.SIZES.items():
        if ctypes.sizeof(getattr(made, name)) != size:
            raise SystemExit(f"bind.py: {name} has {ctypes.sizeof(getattr(made, name))} bytes here and {size} in C")
    for name, offset in made.OFFSETS.items():
        struct, field = name.split(".")
        if getattr(getattr(made, struct), field).offset != offset:
            raise SystemExit(f"bind.py: {name} is elsewhere in C")


def read(cc, include, headers):
    """Reads the interface of [(library, header)]; returns it with the program that measures it."""
    interface = Interface()
    with tempfile.TemporaryDirectory() as stand_ins:
        for name, content in STAND_INS.items():
            (pathlib.Path(stand_ins) / name).write_text(f"#pragma once\n{content}")
        for library, header in headers:
            for node in c_parser.CParser().parse(preprocessed(header, cc, include, stand_ins), header).ext:
                interface.take(library, node)
    return interface, layout_program(interface, [pathlib.Path(h).resolve() for _, h in headers], macros(include))


def main():
    output, cc, rest = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
    include, headers = rest[:rest.index("--")], [h.split("=") for h in rest[rest.index("--") + 1:]]
    interface, program = read(cc, include, headers)
    told = measured(program, cc, include)
    made = output.with_suffix(".tmp.py")
    output.parent.mkdir(parents=True, exist_ok=True)
    made.write_text(text(interface, told))
    compare(made)
    made.replace(output)


if __name__ == "__main__":
    main()
