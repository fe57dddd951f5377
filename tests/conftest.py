"""Fixtures and hooks of all Python tests: the build, components of tests (rooms.py), the last line `N passed, N failed, N skipped, N retried`, and
the names of failed tests for tests/run.py."""
import fcntl
import json
import os
import subprocess
import sys

import pytest
import rooms
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
def types(build):
    """The LCM messages, as lcm-gen makes them for Python."""
    sys.path.insert(0, str(build / "python"))
    import tensormass_lcm
    return tensormass_lcm


@pytest.fixture(scope="session")
def long_run():
    return LONG


def processor_s():
    """Returns the processor time of this process and its ended children, s."""
    return sum(os.times()[:4])


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logstart():
    processor_s.before = processor_s()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item, call):
    if call.when == "teardown":
        item.user_properties.append(("processor_s", round(processor_s() - processor_s.before, 1)))


def pytest_unconfigure(config):
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or hasattr(config, "workerinput"):
        return
    count = {k: len(reporter.stats.get(k, [])) for k in ("passed", "failed", "error", "skipped")}
    retried = {report.nodeid for reports in reporter.stats.values() for report in reports if getattr(report, "retried", False)}
    print(f"{count['passed']} passed, {count['failed'] + count['error']} failed, {count['skipped']} skipped, {len(retried)} retried", flush=True)
    with open(FAILED_JSON, "w") as names:
        json.dump([report.nodeid for kind in ("failed", "error") for report in reporter.stats.get(kind, [])], names)


@pytest.fixture(scope="session")
def once(tmp_path_factory, pytestconfig):
    """once(NAME, MAKE): returns the folder that MAKE(folder) filled. The first worker fills it, all share it; repeated tests (patience.py) get a new
    one."""
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
    """Runs `make WORDS` as from a separate shell, without the environment of a make that runs the tests."""
    env = {k: v for k, v in os.environ.items() if not k.startswith("MAKE") and k not in ("MFLAGS", "TM_OUT")}
    done = subprocess.run(["make", "-C", str(root), "--no-print-directory", *words], env=env, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]


@pytest.fixture(scope="session")
def image_module(build):
    """Skips the test if the optional module is not built; `make tests` keeps an existing one up to date (apps/module.mk)."""
    if not (build / "lib/tensormass/image.so").exists():
        pytest.skip("module image is not built (make image)")


@pytest.fixture(scope="session")
def make_once(root, once):
    """make_once(TARGET): runs `make TARGET` in the sources' build folder, once a run, in the first worker that needs it."""
    return lambda target: once(f"make-{target}", lambda _: make(root, target))


@pytest.fixture(scope="session")
def make_config(root, build):
    """make_config(CONFIG, TARGET...): runs `make config=CONFIG TARGET...`, one at a time per folder. Returns that folder, build/CONFIG."""
    base = build.parent if build.name in ("debug", "asan", "tsan", "fuzz", "clang", "coverage") else build

    def made(config, *targets):
        paths = [str(base / config / target) if "/" in target else target for target in targets]
        with open(base / f"{config}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            make(root, f"config={config}", f"BUILD={base}", f"VENV={base / 'venv'}", "-j2", *paths)
        return base / config

    return made


def pytest_addoption(parser):
    parser.addoption("--room", choices=sorted(rooms.ROOMS), help="of this room alone (tests/rooms.py)")


def pytest_configure(config):
    config.addinivalue_line("markers", "clock: watches the wall clock, runs beside others that do so, with none that computes")
    config.addinivalue_line("markers", "leftover: long, runs on the processor time that others leave")
    config.addinivalue_line("markers", "long: minutes, in `make check-long` alone")
    config.addinivalue_line("markers", "plain: about the plain build, not for a sanitizer's")


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(config, items):
    if not LONG:
        items[:] = [item for item in items if not item.get_closest_marker("long")]
    plain = rooms.PLAIN + (rooms.PLAIN_OF_TSAN if os.environ.get("TM_SANITIZER") == "tsan" else ())
    here = config.getoption("--room")
    chosen = []
    for item in items:
        name = rooms.name_of(item, ROOT / "tests")
        room = rooms.room_of(name)
        if name.startswith(rooms.CLOCK):
            item.add_marker(pytest.mark.clock)
        if item.get_closest_marker("clock"):
            for group in rooms.TOGETHER:
                if name.startswith(group):
                    item.add_marker(pytest.mark.xdist_group(group))
        if name.startswith(rooms.LEFTOVER):
            item.add_marker(pytest.mark.leftover)
        if name.startswith(plain):
            item.add_marker(pytest.mark.plain)
        by_clock = item.get_closest_marker("clock") or item.get_closest_marker("leftover")
        if room is None or (by_clock and room != "system"):
            raise pytest.UsageError(f"{name} is in {'no room' if room is None else room + ', and watches the clock'}; tests/rooms.py names rooms")
        if here in (None, room):
            chosen.append(item)
    items[:] = sorted(chosen, key=lambda item: item.name.startswith("test_the_ring_finds_nothing"))  # waits for builds that the leftover tests make
