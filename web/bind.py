"""Writes bindings.js: layouts, prototypes and constants of the C interface as wasm32 has them, read from the headers.

    python bind.py OUTPUT.js EXPORTS.txt INCLUDE_FOLDER... -- LIBRARY=HEADER...

The headers are parsed by python/bind.py. Sizes and offsets come from a program that emcc compiles and node runs. EXPORTS.txt lists the functions that
the module exports. Needs pycparser.
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "python"))
import bind  # noqa: E402

KINDS = {"c_char": "char", "c_bool": "bool", "c_int": "i32", "c_int8": "i8", "c_uint8": "u8", "c_int16": "i16", "c_uint16": "u16", "c_int32": "i32",
         "c_uint32": "u32", "c_int64": "i64", "c_uint64": "u64", "c_size_t": "u32", "c_float": "f32", "c_double": "f64", "c_char_p": "text",
         "c_void_p": "pointer", "None": "void"}


def kind_of(expression, structs):
    """Returns (kind, number of values) of a ctypes expression; the number is 0 for one value."""
    base, *lengths = expression.split(" * ")
    count = 0
    for length in lengths:
        count = (count or 1) * int(length)
    if base in structs:
        return base, count
    return KINDS.get(base, "pointer"), count  # a callback is an index, as wide as a pointer


def layouts(program, include):
    """Returns what the program prints under node: sizes, offsets and values."""
    with tempfile.TemporaryDirectory() as folder:
        source, made = pathlib.Path(folder) / "layout.c", pathlib.Path(folder) / "layout.js"
        source.write_text(program)
        subprocess.run(["emcc", "-std=gnu11", "-w", "-O0", "-sSINGLE_FILE=1", *(f"-I{i}" for i in include), source, "-o", made], check=True)
        printed = subprocess.run(["node", made], capture_output=True, text=True, check=True).stdout
    read = {"E": {}, "F": {}, "S": {}, "O": {}}
    for line in printed.splitlines():
        kind, name, value = line.split()
        read[kind][name] = float(value) if kind == "F" else int(value)
    return read


def bindings(interface, read):
    structs = {}
    for name, fields in interface.structs.items():
        if fields is not None:
            structs[name] = {"size": read["S"][name], "fields": {
                f: [read["O"][f"{name}.{f}"], *kind_of(expression, interface.structs)] for f, expression, _ in fields}}
    functions = {name: [kind_of(result, interface.structs)[0], [kind_of(a, interface.structs)[0] for a in arguments]]
                 for name, (_, result, arguments) in interface.functions.items()}
    return structs, functions, {**read["E"], **read["F"]}


def written(value):
    """JSON with one struct or function a line."""
    return "{\n" + ",\n".join(f"  {json.dumps(n)}: {json.dumps(v)}" for n, v in value.items()) + "\n}"


def main():
    output, exports, rest = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3:]
    include, headers = rest[:rest.index("--")], [h.split("=") for h in rest[rest.index("--") + 1:]]
    interface, program = bind.read("gcc", include, headers)
    structs, functions, constants = bindings(interface, layouts(program, include))
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text("// Made by web/bind.py from the headers; do not edit.\n"
                      f"export const structs = {written(structs)};\n\n"
                      "// name: [result, [argument]]\n"
                      f"export const functions = {written(functions)};\n\n"
                      f"export const constants = {written(constants)};\n")
    exports.write_text("".join(f"_{name}\n" for name in sorted(["malloc", "free", "mallinfo", *functions])))


if __name__ == "__main__":
    main()
