"""Starts programs for tests of several folders. Shared fixtures are in conftest.py."""
import json
import os
import pathlib
import re
import subprocess
from typing import NamedTuple, Optional

ROOT = pathlib.Path(__file__).resolve().parents[1]

# Prefix of a command that runs it in a network namespace, with LCM on its loopback.
UNSHARE = ["unshare", "-n" if os.geteuid() == 0 else "-rn"]
LOOPBACK = ["sh", "-c", 'ip link set lo up; ip route add 224.0.0.0/4 dev lo; exec "$@"', "sh"]
NETWORK = [*UNSHARE, *LOOPBACK]
BLOCK = """
tissue:
  mesh: {mesh}
  force: plain
  materials:
    "*": {{young: 10 kPa, poisson: 0.4}}
supports:
  - {{name: bottom, group: z_min}}
"""


def run(program, *arguments, code=0, env=None, timeout=600, cwd=None):
    """Runs a program with `env` added to the environment; checks its exit code; returns (stdout, stderr)."""
    done = subprocess.run([str(program), *map(str, arguments)], capture_output=True, text=True, timeout=timeout, cwd=cwd, env={**os.environ, **(env or {})})
    assert done.returncode == code, f"exit {done.returncode} instead of {code}\n{done.stdout[-6000:]}\n{done.stderr[-6000:]}"
    return done.stdout, done.stderr


def said(program, *arguments, **options):
    """Like run(); returns stdout and stderr joined."""
    return "".join(run(program, *arguments, **options))


def report(program, *args, tmp, **keys):
    """Runs with --json and returns the report."""
    path = tmp / "report.json"
    run(program, *args, "--json", path, **keys)
    return json.loads(path.read_text())


def block_scene(tmp, root, more="", name="scene.yaml", mesh="block_1k.msh"):
    path = tmp / name
    path.write_text(BLOCK.format(mesh=root / "meshes" / mesh).lstrip() + more)
    return path


class Effect(NamedTuple):
    """One effect of scenes, from the generated reference."""
    name: str
    needs: tuple
    excludes: tuple
    example: Optional[str]  #: example value of --set NAME=, or None


def effects():
    """Returns every effect, in the order of the library's table (docs/scene-reference.md; a test compares both)."""
    text = (ROOT / "docs/scene-reference.md").read_text().split("\n## Effects\n")[1]
    found = []
    for part in text.split("\n### ")[1:]:
        head = part.split("\n| key |")[0]
        example = re.search(r"^Example: `\w+:(.*)`$", head, re.M)
        found.append(Effect(part.split("\n")[0], tuple(re.findall(r" Needs `(\w+)`", head)), tuple(re.findall(r" Excludes `(\w+)`", head)), example and example[1].strip()))
    return found
