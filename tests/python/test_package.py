"""The Python package (docs/python.md) from the wheel: built once, installed into separate environments, never into this one."""
import json
import os
import pathlib
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile

import pytest
from paths import BUILD, LONG, ROOT

HERE = pathlib.Path(__file__).resolve().parent
TIMEOUT_S = 3600 if LONG else 900


def run(*command, **options):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=TIMEOUT_S, **options)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout[-6000:]}\n{done.stderr[-6000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(once):
    """Returns build/wheel/*.whl, made by `make wheel`."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}
    once("wheel", lambda folder: run("make", "-C", ROOT, f"BUILD={os.path.relpath(BUILD, ROOT)}", "wheel", env=clean))
    made, = (BUILD / "wheel").glob(f"*linux*_{platform.machine()}.whl")  # make wheels adds wheels of other platforms
    return made


@pytest.fixture(scope="module")
def python(wheel, once):
    """Returns an interpreter with the wheel and, for the tests, this one's packages (numpy, pytest, matplotlib)."""
    def make(folder):
        run(sys.executable, "-m", "venv", "--without-pip", folder / "venv")
        inside = folder / "venv/bin/python"
        site = pathlib.Path(run(inside, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
        (site / "tests.pth").write_text(sysconfig.get_path("purelib") + "\n")
        run(sys.executable, "-m", "pip", "--python", inside, "install", "-q", "--no-deps", "--disable-pip-version-check", wheel)

    return once("wheel-venv", make) / "venv/bin/python"


@pytest.fixture(scope="module")
def log(once):
    """A pressed liver, felt by `tangent`."""
    def make(folder):
        run(BUILD / "bin/tm-sim", ROOT / "apps/scenes/liver-press.yaml", "--lockstep", "--quiet", "--duration", "4 s", "--set",
            "haptics.extrapolator=tangent", "--record", folder / "press.log")

    return once("press-log", make) / "press.log"


@pytest.fixture
def environment(log, tmp_path):
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTEST_CURRENT_TEST", "PYTEST_XDIST_WORKER", "LD_LIBRARY_PATH")}
    own = tmp_path / "press.log"
    shutil.copy(log, own)
    return {**clean, "TM_BIN": str(BUILD / "bin"), "TM_ROOT": str(ROOT), "TM_LOG": str(own), "TM_PYTHON": sys.executable,
            "TM_LCM_TYPES": str(BUILD / "python"), "TM_CACHE_DIR": str(tmp_path / "cache")}


@pytest.mark.parametrize("part", ["core", "models", "scene", "bodies"])
def test_inside(python, environment, part, tmp_path):
    run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "error", f"--basetemp={tmp_path / 'inside'}", HERE / f"inside_{part}.py",
        env=environment, cwd=tmp_path)


@pytest.mark.parametrize("name, says", [
    ("press", r"peak 0\.3\d\d N at 6\.0 mm"), ("cut", r"1\d\d of 7680 tetrahedra removed"), ("own_mesh", r"sags 16\.\d+ mm"),
    ("fit_young", r"E = 73\d\d Pa"), ("extrapolate", r"tangent 0\.\d+ %")])
def test_examples(python, environment, name, says, tmp_path):
    import numpy as np
    from PIL import Image

    picture = tmp_path / f"{name}.png"
    given = [environment["TM_LOG"]] if name == "extrapolate" else []
    said = run(python, ROOT / f"examples/python/{name}.py", *given, picture, env=environment, cwd=tmp_path)
    assert re.search(says, said), said
    drawn = np.asarray(Image.open(picture).convert("L"))
    assert min(drawn.shape) > 300 and 0.01 < (drawn < 200).mean() < 0.7, "something is drawn"


def test_the_page(python, environment):
    """Returns the programs that docs/python.md shows."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text(), re.S)
    assert len(blocks) == 2
    run(python, "-c", "\n".join(blocks), env=environment, cwd=ROOT)


def test_layout_is_the_compilers(python, tmp_path):
    """Compares every struct and member that ctypes declares with a C program of the same headers."""
    told = json.loads(run(python, "-c", "import json, ctypes, tensormass._bind as c\n"
                          "print(json.dumps([{n: ctypes.sizeof(getattr(c, n)) for n in c.SIZES},"
                          " {o: getattr(getattr(c, o.split('.')[0]), o.split('.')[1]).offset for o in c.OFFSETS}]))"))
    sizes, offsets = told
    assert {"tm_mesh", "tm_model_def", "tm_patch", "tm_solve_def", "hrt_controller", "hrt_params", "tm_scene_info"} <= set(sizes)
    lines = [f'printf("{n} %zu\\n", sizeof({n}));' for n in sizes]
    lines += ['printf("{} %zu\\n", offsetof({}, {}));'.format(o, *o.split(".")) for o in offsets]
    source = tmp_path / "layout.c"
    headers = "".join(f'#include "{h}"\n' for h in ("tensormass.h", "tensormass_io.h", "tensormass_solve.h", "hrt.h", "tensormass_scene.h"))
    source.write_text("#include <stddef.h>\n#include <stdio.h>\n" + headers + "int main(void) {\n" + "\n".join(lines) + "\nreturn 0;\n}\n")
    include = [f"-I{ROOT / i}" for i in ("libtensormass/include", "libtensormass/io/include", "libtensormass/scene/include", "haptic_rt/core")]
    run("gcc", "-std=c11", *include, source, "-o", tmp_path / "layout")
    wanted = dict(line.split() for line in run(tmp_path / "layout").splitlines())
    assert {n: int(v) for n, v in wanted.items()} == {**sizes, **offsets}


def test_every_function_of_the_headers_is_bound(python):
    bound = set(json.loads(run(python, "-c", "import json, tensormass._bind as c; print(json.dumps(list(c.FUNCTIONS)))")))
    headers = "\n".join(h.read_text() for h in (ROOT / "libtensormass").rglob("include/**/*.h"))
    declared = set(re.findall(r"^TM_API [^;(]*?\b(tm_\w+)\(", headers, re.M))
    assert len(declared) > 100 and declared <= bound, sorted(declared - bound)
    opened = run(python, "-c", "from tensormass._core import lib, c\nfor n in c.FUNCTIONS: getattr(lib, n)\nprint(len(c.FUNCTIONS))")
    assert int(opened) == len(bound)


def test_the_wheel_is_for_every_python(wheel):
    assert re.fullmatch(r"tensormass-\d+\.\d+\.\d+-py3-none-manylinux_2_\d+_\w+\.whl", wheel.name)
    shown = run(BUILD / "wheel/venv/bin/auditwheel", "show", wheel, env={**os.environ, "PATH": f"{BUILD / 'wheel/venv/bin'}:{os.environ['PATH']}"})
    assert "manylinux_2_" in shown
    names = zipfile.ZipFile(wheel).namelist()
    assert "tensormass/py.typed" in names and any("libcholmod" in n for n in names) and not any(n.endswith((".a", ".o", ".c")) for n in names)
    assert any("LICENSE" in n for n in names)
    metadata = zipfile.ZipFile(wheel).read(next(n for n in names if n.endswith("METADATA"))).decode()
    assert re.findall(r"^Requires-Dist: (?!.*extra)(\S+)", metadata, re.M) == ["numpy>=1.21"]


def interpreters():
    """Returns one interpreter of each version from 3.9 on that this machine has."""
    found = {}
    home = pathlib.Path.home()
    for candidate in [pathlib.Path("/usr/bin/python3"), *sorted(home.glob(".pyenv/versions/*/bin/python3")), *sorted(pathlib.Path("/usr/local/bin").glob("python3.*[0-9]"))]:
        asked = subprocess.run([candidate, "-c", "import sys, venv, ensurepip; print(sys.version_info[0], sys.version_info[1])"], capture_output=True, text=True) \
            if candidate.exists() else None
        if asked and asked.returncode == 0 and tuple(map(int, asked.stdout.split())) >= (3, 9):
            found.setdefault(tuple(map(int, asked.stdout.split())), candidate)
    versions = sorted(found)
    return [found[v] for v in (versions if LONG else [*versions[:1], *versions[1:][-1:]])]


@pytest.mark.parametrize("interpreter", interpreters(), ids=str)
def test_empty_environment(wheel, interpreter, tmp_path):
    """pip install and the lines of the README, in an empty environment."""
    run(interpreter, "-m", "venv", tmp_path / "venv")
    inside = tmp_path / "venv/bin/python"
    run(inside, "-m", "pip", "install", "-q", "--no-compile", "--disable-pip-version-check", wheel)
    listed = {p["name"] for p in json.loads(run(inside, "-m", "pip", "list", "--format=json", "--disable-pip-version-check"))}
    assert listed <= {"tensormass", "numpy", "pip", "setuptools", "wheel"}
    text = re.search(r"```python\n(.*?)```", (ROOT / "python/README.md").read_text(), re.S)[1]
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    force = [float(x) for x in re.findall(r"[-\d.e]+", run(inside, "-c", text, env=clean, cwd=tmp_path))]
    assert 0.1 < force[2] < 1
    solved = run(inside, "-c", text.split("world =")[0] + "import numpy as np\nfixed = np.zeros((mesh.vertex_count, 3), bool)\n"
                 "fixed[mesh.near((0, 0, 0), (0, 0, 1))] = True\nprint(tm.solve_static(tissue, fixed)[2].free_dofs)", env=clean, cwd=tmp_path)
    assert int(solved) > 100


def test_types_are_clean(python, wheel, tmp_path):
    mypy = BUILD / "wheel/venv/bin/mypy"
    user = tmp_path / "user.py"
    user.write_text("import tensormass as tm\nmesh = tm.Mesh.block((1, 1, 1), (1, 1, 1))\nreveal_type(mesh.rest_m)\nreveal_type(mesh.vertex_count)\n"
                    "tm.World(mesh)\n")
    package = pathlib.Path(run(python, "-c", "import tensormass; print(tensormass.__path__[0])").strip())
    cache = ["--cache-dir", tmp_path / "cache", "--python-executable", python]
    run(mypy, "--config-file", ROOT / "python/pyproject.toml", *cache, package)
    said = subprocess.run([mypy, "--strict", *map(str, cache), user], capture_output=True, text=True).stdout
    assert "ndarray" in said and 'Revealed type is "int"' in said.replace("builtins.", "")
    assert re.search(r'user.py:5: error: Argument 1 to "World" has incompatible type "Mesh"', said), said


def test_sdist(wheel, once, tmp_path):
    """The source distribution contains what the wheel is built from; the long form builds it."""
    sdist, = (BUILD / "wheel").glob("*.tar.gz")
    names = [n.split("/", 1)[-1] for n in tarfile.open(sdist).getnames()]
    for needed in ("Makefile", "LICENSE", "pyproject.toml", "setup.py", "python/bind.py", "libtensormass/include/tensormass.h",
                   "haptic_rt/core/hrt.h", "libtensormass/scene/sim.c", "lcm_types/tool_state_t.lcm", "tensormass/world.py"):
        assert needed in names, needed
    # Headers of other parts that the scene library includes.
    own = [n for n in names if re.fullmatch(r"(libtensormass/(scene|platform)|haptic_rt/motion)/\w+\.[ch]", n)]
    asked = {h for n in own for h in re.findall(r'#include "(\w+/\w+\.h)"', (ROOT / n).read_text())}
    assert len(own) > 60 and asked and not {h for h in asked if not any(n.endswith("/" + h) for n in ["/" + n for n in names])}, asked
    if not LONG:
        return
    run(sys.executable, "-m", "venv", tmp_path / "venv")
    inside = tmp_path / "venv/bin/python"
    run(inside, "-m", "pip", "install", "-q", "--disable-pip-version-check", sdist)
    assert "0." in run(inside, "-c", "import tensormass; print(tensormass.__version__)", cwd=tmp_path)
