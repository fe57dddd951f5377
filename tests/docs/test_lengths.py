"""No product function is longer than 60 lines; a file longer than 400 says why in its head."""
import re

FOLDERS = ("contact_law", "libtensormass", "haptic_rt", "lcm_types", "apps")
FUNCTION, FILE, HEAD = 60, 400, 16


def sources(root):
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            name = str(path.relative_to(root))
            if path.suffix in (".c", ".h", ".cpp"):
                yield name, path.read_text().split("\n")


def functions(lines):
    """Yields (name, lines from its first to its brace): clang-format puts both braces of a function at the start or the end of a line."""
    first = None
    for i, line in enumerate(lines):
        if line and not line[0].isspace() and not line.startswith(("}", "#", "/", "{")):
            if first is None or not lines[i - 1] or lines[i - 1].endswith((";", "}", "*/")):
                first = i
        if line == "}" and first is not None:
            head = " ".join(lines[first:i])
            found = re.match(r"[^;={]*?(\w+)\([^{]*\) *\{", head)
            if found:
                yield found.group(1), i - first + 1
            first = None


def test_functions_are_short(root):
    seen, long = 0, []
    for name, lines in sources(root):
        for function, length in functions(lines):
            seen += 1
            if length > FUNCTION:
                long.append(f"{name}: {function} has {length} lines")
    assert seen > 2500, f"only {seen} functions were seen"
    assert not long, "\n".join(long)


def test_files_are_short_or_say_why(root):
    long = [f"{name}: {len(lines) - 1} lines" for name, lines in sources(root)
            if len(lines) - 1 > FILE and not re.search(r"Over 400 lines: \w", " ".join(lines[:HEAD]).replace(" * ", " "))]
    assert not long, "\n".join(long)


def test_long_function_is_detected():
    text = "static int\nfine(void) {\n    return 0;\n}\n\nint much(int a,\n         int b) {\n" + "    a += b;\n" * FUNCTION + "    return a;\n}\n"
    assert dict(functions(text.split("\n"))) == {"fine": 4, "much": FUNCTION + 4}
