"""Shared by every Python test: where the build is, the last line `N passed, N failed, N skipped`, and the names of what failed for tests/run.py."""
import fcntl
import json
import os
import subprocess

import pytest
from paths import BUILD, LONG, ROOT
from patience import pytest_runtest_protocol  # noqa: F401 (a hook)

FAILED_JSON = os.environ.pop("TM_FAILED", os.devnull)  # not for a pytest that a test starts


@pytest.fixture(scope="session")
def root():
    return ROOT


@pytest.fixture(scope="session")
def build():
    return BUILD


@pytest.fixture(scope="session")
def bin():
    return BUILD / "bin"


@pytest.fixture(scope="session")
def long_run():
    return LONG


def pytest_unconfigure(config):
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or hasattr(config, "workerinput"):
        return
    count = {k: len(reporter.stats.get(k, [])) for k in ("passed", "failed", "error", "skipped")}
    print(f"{count['passed']} passed, {count['failed'] + count['error']} failed, {count['skipped']} skipped", flush=True)
    with open(FAILED_JSON, "w") as names:
        json.dump([report.nodeid for kind in ("failed", "error") for report in reporter.stats.get(kind, [])], names)


@pytest.fixture(scope="session")
def once(tmp_path_factory, pytestconfig):
    """once(NAME, MAKE): the folder that MAKE(folder) filled, made by whichever worker comes first and shared by all, but for tests that are played again (patience.py)."""
    def made(name, make):
        base = tmp_path_factory.getbasetemp()
        base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
        if getattr(pytestconfig, "played_again", 0):
            name = f"{name}-{os.environ.get('PYTEST_XDIST_WORKER', 'here')}-{pytestconfig.played_again}"
        folder = base / f"once-{name}"
        with open(base / f"once-{name}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (folder / ".done").exists():
                folder.mkdir(exist_ok=True)
                make(folder)
                (folder / ".done").touch()
        return folder

    return made


def make(root, *words):
    """`make WORDS`, as from a shell of its own: nothing of a make that runs the tests."""
    env = {k: v for k, v in os.environ.items() if not k.startswith("MAKE") and k not in ("MFLAGS", "TM_OUT")}
    done = subprocess.run(["make", "-C", str(root), "--no-print-directory", *words], env=env, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]


@pytest.fixture(scope="session")
def make_once(root, once):
    """make_once(TARGET): `make TARGET` in the sources' own build folder, once a run, whichever worker needs it."""
    return lambda target: once(f"make-{target}", lambda _: make(root, target))


@pytest.fixture(scope="session")
def make_config(root, build):
    """make_config(CONFIG, TARGET...): `make config=CONFIG TARGET...` beside the build under test, one at a time in one folder. Returns that folder, build/CONFIG."""
    base = build.parent if build.name in ("debug", "asan", "tsan", "fuzz", "clang") else build

    def made(config, *targets):
        paths = [str(base / config / target) if "/" in target else target for target in targets]
        with open(base / f"{config}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            make(root, f"config={config}", f"BUILD={base}", f"VENV={base / 'venv'}", "-j2", *paths)
        return base / config

    return made


# Watch the wall clock: tests/run.py runs them by themselves.
ALONE = ("trust/test_trust", "trust/test_flags", "loop/test_processes", "loop/test_two_hosts", "loop/test_soak", "install/test_live", "view/test_session", "view/test_display", "view/test_play", "sanitize/test_sanitize.py::test_the_ring")

# Of those that watch the clock: tests that share what one process of pytest set up, one after the other; all others run side by side with them.
TOGETHER = ("trust/test_trust.py::test_with", "trust/test_flags", "install/test_live")

# Long, on the processors alone and by no clock: tests/run.py gives them what those leave.
LEFTOVER = ("sanitize/test_sanitize.py::test_short_form",)

# Look at the plain build itself, its instructions, memory, system calls, libraries and speed, or make builds of their own: not run by tests/sanitize/run.py.
# (test_ranks: OpenMPI leaks from modules that it has closed by then, which no suppression can name.)
PLAIN = ("accuracy/", "bench/", "can/test_guest", "docs/", "effects/", "evaluate/", "firmware/", "fuzz/", "hash/", "install/", "loop/test_lint",
         "loop/test_processes.py::test_figures", "loop/test_processes.py::test_no_page_fault", "loop/test_processes.py::test_system_calls",
         "loop/test_soak", "pages/", "plugins/", "python/", "sanitize/", "sim/test_builds", "sim/test_lockstep.py::test_a_scene_without_solver", "solve/test_precompute.py::test_a_rank",
         "solve/test_precompute.py::test_ranks", "stability/test_planted", "timing/", "trust/", "view/test_display", "view/test_play.py::test_the_displays_opengl", "view/test_session.py::test_spy")
# A hand in a window for two seconds, against a simulation that ThreadSanitizer makes ten times slower.
if os.environ.get("TM_SANITIZER") == "tsan":
    PLAIN += ("view/test_play.py::test_mouse_and_keys",)


def pytest_configure(config):
    config.addinivalue_line("markers", "alone: watches the wall clock, runs beside others that do so, with none that computes")
    config.addinivalue_line("markers", "leftover: long, runs on the processor time that `alone` ones leave")
    config.addinivalue_line("markers", "long: minutes, in `make check-long` alone")
    config.addinivalue_line("markers", "plain: about the plain build, not for a sanitizer's")


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items):
    if not LONG:
        items[:] = [item for item in items if not item.get_closest_marker("long")]
    for item in items:
        path = item.path.relative_to(ROOT / "tests").as_posix()
        if f"{path}::{item.name}".startswith(ALONE):
            item.add_marker(pytest.mark.alone)
        if item.get_closest_marker("alone"):
            for group in TOGETHER:
                if f"{path}::{item.name}".startswith(group):
                    item.add_marker(pytest.mark.xdist_group(group))
        if f"{path}::{item.name}".startswith(LEFTOVER):
            item.add_marker(pytest.mark.leftover)
        if f"{path}::{item.name}".startswith(PLAIN):
            item.add_marker(pytest.mark.plain)
    items.sort(key=lambda item: item.name.startswith("test_the_ring_finds_nothing"))  # waits for builds that the leftover tests make
