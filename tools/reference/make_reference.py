"""make_reference.py BIN OUT VERSION PROGRAM...: man pages (OUT/man1/PROGRAM.1) and completion for bash (OUT/completions/PROGRAM) from the programs' own help."""
import pathlib
import re
import subprocess
import sys

import help_text

EXITS = "0: done. 2: bad input, reported as file:line: what; what to do. 1: anything else."
FILES = ("FILE", "FOLDER", "DIR", "SCENE", "MESH", "OUT", "IN", "PREFIX", "SURFACE", "LOG")
PURPOSE = {
    "tm-sim": "soft tissue in real time or in lockstep",
    "tm-mesh": "inspect, make and repair tetrahedral meshes",
    "tm-precompute": "compute the responses of a surface for the precomputed model",
    "tm-view": "draw pictures and videos of tissue and instruments",
    "tm-play": "open a window in which mouse and keys move the instruments",
    "tm-scene": "write a first scene for a mesh, and check a scene",
    "tm-organ": "turn an image into an organ with haptic feedback, by one command",
    "tm-study": "run tm-sim many times, with results in one table",
    "tm-fit": "fit constants of materials to what was measured",
    "tm-session": "start a live session of a scene by one command",
    "tm-evaluate": "measure the errors of the extrapolators",
    "tm-accuracy": "measure what accuracy costs in time",
    "tm-stability": "run hard cases and report their verdicts",
    "haptic-rt": "control a haptic device",
    "tm-device": "simulate a haptic device on a CAN bus",
}
# Values that a program lists itself.
LISTED = {"--case": "--list", "--knob": "--list"}


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in ".'" else text


def help_of(program, *words):
    out = subprocess.run([program, *words, "--help"], capture_output=True, text=True, timeout=20, check=True)
    return help_text.read(out.stdout)


def section(told, skip=None):
    lines = []
    for part in told.body:
        if isinstance(part, help_text.Option):
            lines += [".TP", ".B " + roff(part.label), roff(part.text) or "\\&"]
        elif part.startswith("# "):
            lines.append(f'.SS "{roff(part[2:])}"')
        elif part != skip:
            lines += [".PP", roff(part)]
    return lines


def man_page(name, told, parts, version):
    """Makes a man page. `parts`: help of each of the program's commands, by name."""
    first = next((p for p in told.body if isinstance(p, str) and not p.startswith("#")), name)
    purpose = PURPOSE.get(name, first.split(". ")[0])
    lines = [f'.TH {name.upper()} 1 "" "tensormass {version}" "User Commands"', ".SH NAME", f"{roff(name)} \\- {roff(purpose)}", ".SH SYNOPSIS"]
    for usage in told.usage:
        lines += [".PP", roff(usage)]
    lines += [".SH DESCRIPTION", *section(told)]
    for command, part in parts.items():
        lines += [f'.SH "{roff(name + " " + command)}"', *[line for usage in part.usage for line in (".PP", roff(usage))], *section(part)]
    lines += [".SH EXIT STATUS", roff(EXITS), ".SH SEE ALSO", roff("The pages beside this program: share/doc/tensormass of its prefix.")]
    return "\n".join(lines) + "\n"


def quoted(words):
    return " ".join(dict.fromkeys(words))


def choices_of(option):
    """Returns the values that may follow the option, if its description is only a list of them."""
    words = re.sub(r" or |,", " ", option.text.split("(may be repeated):")[-1].split(" (")[0]).split()
    return words if option.argument == "NAME" and len(words) > 1 and {"a", "only"}.isdisjoint(words) and all(w.replace("_", "").isalnum() and w.islower() for w in words) else []


def completion(name, told, parts):
    options = {o.label: o for t in (told, *parts.values()) for o in t.options}.values()
    function = "_" + name.replace("-", "_")
    lines = [f"# bash completion of {name}, made from its --help", f"{function}()", "{",
             "    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}", "    COMPREPLY=()", '    case "$before" in']
    for option in options:
        if not option.argument:
            continue
        names = "|".join(n for n in option.names if n.startswith("-"))
        if choices_of(option) and option.names[0] not in LISTED:
            lines.append(f"""        {names}) COMPREPLY=($(compgen -W '{quoted(choices_of(option))}' -- "$word")); return ;;""")
        elif option.names[0] in LISTED:
            lines.append(f"""        {names}) COMPREPLY=($(compgen -W "$("${{COMP_WORDS[0]}}" {LISTED[option.names[0]]} 2>/dev/null | cut -d' ' -f1)" -- "$word")); return ;;""")
        elif not any(part in option.argument for part in FILES):
            lines.append(f"        {names}) return ;;")
    lines += ["    esac", '    case "$word" in']
    words = quoted([w for t in (told, *parts.values()) for w in t.words])
    lines.append(f"""        -*) COMPREPLY=($(compgen -W '{words}' -- "$word")); return ;;""")
    lines.append("    esac")
    if parts:
        lines.append(f"""    [ "$COMP_CWORD" = 1 ] && {{ COMPREPLY=($(compgen -W '{quoted(parts)}' -- "$word")); return; }}""")
    lines += ['    compopt -o filenames 2>/dev/null', '    COMPREPLY=($(compgen -f -- "$word"))', "}", f"complete -F {function} {name}"]
    return "\n".join(lines) + "\n"


def main():
    bin, out, version, *names = sys.argv[1:]
    for folder in ("man1", "completions"):
        (pathlib.Path(out) / folder).mkdir(parents=True, exist_ok=True)
    for name in names:
        program = str(pathlib.Path(bin) / name)
        told = help_of(program)
        parts = {command: help_of(program, command) for command in told.commands}
        (pathlib.Path(out) / "man1" / f"{name}.1").write_text(man_page(name, told, parts, version))
        (pathlib.Path(out) / "completions" / name).write_text(completion(name, told, parts))


if __name__ == "__main__":
    main()
