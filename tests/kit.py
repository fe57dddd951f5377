"""What tests of several folders start programs with; fixtures they share are in conftest.py."""
import json
import os
import subprocess

# Before a command: in a network of its own, LCM on its loopback.
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
    """Runs a program, with `env` beside the environment; checks its exit code; returns (stdout, stderr)."""
    done = subprocess.run([str(program), *map(str, arguments)], capture_output=True, text=True, timeout=timeout, cwd=cwd, env={**os.environ, **(env or {})})
    assert done.returncode == code, f"exit {done.returncode} instead of {code}\n{done.stdout[-6000:]}\n{done.stderr[-6000:]}"
    return done.stdout, done.stderr


def said(program, *arguments, **options):
    """As run(); returns stdout and stderr together."""
    return "".join(run(program, *arguments, **options))


def report(program, *args, tmp, **keys):
    """Runs with --json and returns what it says."""
    path = tmp / "report.json"
    run(program, *args, "--json", path, **keys)
    return json.loads(path.read_text())


def block_scene(tmp, root, more="", name="scene.yaml", mesh="block_1k.msh"):
    path = tmp / name
    path.write_text(BLOCK.format(mesh=root / "meshes" / mesh).lstrip() + more)
    return path
