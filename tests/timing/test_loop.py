"""The running loop observed from outside: it allocates nothing, frees nothing and makes system calls only to sleep and to send."""
import contextlib
import json
import os
import subprocess
import tempfile
import time

import pytest
from kit import NETWORK
from paths import BUILD, ROOT

WITH_SIMULATION = f"""
{BUILD}/bin/tm-sim {ROOT}/apps/scenes/block-press.yaml --realtime --duration '7 s' > sim.log 2>&1 & sim=$!
{BUILD}/bin/tm-device --bus virtual:loop --hand hand0.csv --repeat --duration 7 2> device.log & device=$!
"$@"
status=$?
kill $sim $device 2>/dev/null
wait
exit $status
"""


def run(tmp_path, extrapolator, *wrapper, **environment):
    """haptic-rt for 4 s against tm-sim over LCM and tm-device on a virtual bus, started through `wrapper`."""
    subprocess.run([BUILD / "bin/tm-sim", ROOT / "apps/scenes/block-press.yaml", "--hands", tmp_path / "hand"], check=True, timeout=300, stdout=subprocess.DEVNULL)
    with tempfile.TemporaryDirectory(prefix="tm-test-", dir="/dev/shm") as bus:
        done = subprocess.run([*NETWORK, "timeout", "60", "sh", "-c", WITH_SIMULATION, "sh", *wrapper, BUILD / "bin/haptic-rt", "--bus", "virtual:loop", "--duration", "4",
                               "--extrapolator", extrapolator, "--json", tmp_path / "c.json"], cwd=tmp_path, capture_output=True, text=True, timeout=400,
                              env=dict(os.environ, TM_BUS_DIR=bus, PATH=os.environ["PATH"] + ":/usr/sbin:/sbin", **environment))
    assert done.returncode == 0, done.stderr
    assert "engaged" in done.stderr, done.stderr


@pytest.mark.parametrize("extrapolator", ["tangent", "local_model"])
def test_no_allocation(tmp_path, extrapolator):
    """Returns COUNT_MALLOC's lines: sleeps, allocations and frees after the 500th sleep, for each thread that sleeps by the clock."""
    run(tmp_path, extrapolator, "env", f"LD_PRELOAD={BUILD}/tests/timing/count_malloc.so", f"COUNT_MALLOC={tmp_path}/count")
    threads = [tuple(map(int, line.split())) for line in (tmp_path / "count").read_text().splitlines()]
    assert len(threads) == 1 and threads[0][0] >= 1990, threads
    assert threads[0][1:] == (0, 0), f"{threads[0][1]} allocations, {threads[0][2]} frees in the loop"


def test_counter_counts(tmp_path):
    """The counter detects a loop that allocates once per tick."""
    source = tmp_path / "loop.c"
    source.write_text("""
#include <pthread.h>
#include <stdlib.h>
#include <time.h>
static void *volatile kept;
static void *loop(void *unused) {
    const struct timespec t = {0, 1000};
    for (int i = 0; i < 600; i++) { clock_nanosleep(CLOCK_MONOTONIC, 0, &t, 0); kept = malloc(10); free(kept); }
    return unused;
}
int main(void) { pthread_t thread; return pthread_create(&thread, 0, loop, 0) || pthread_join(thread, 0); }
""")
    subprocess.run(["gcc", "-o", tmp_path / "loop", source, "-lpthread"], check=True)
    subprocess.run([tmp_path / "loop"], check=True, timeout=120,
                   env=dict(os.environ, LD_PRELOAD=f"{BUILD}/tests/timing/count_malloc.so", COUNT_MALLOC=str(tmp_path / "count")))
    assert (tmp_path / "count").read_text().split() == ["600", "100", "100"]


def test_system_calls_with_lcm(tmp_path):
    run(tmp_path, "local_model", "strace", "-f", "-o", "trace")
    calls = {}
    for line in open(tmp_path / "trace", errors="replace"):
        thread, _, rest = line.partition(" ")
        calls.setdefault(thread, []).append(rest.strip().split("(")[0])
    loop = max(calls.values(), key=lambda names: names.count("clock_nanosleep"))
    first, last = loop.index("clock_nanosleep"), len(loop) - 1 - loop[::-1].index("clock_nanosleep")
    under_way = [name for name in loop[first:last] if name.isidentifier()]
    # Another thread sends: a full socket does not delay the loop.
    assert under_way.count("clock_nanosleep") > 1500 and under_way.count("futex") > 100
    assert set(under_way) <= {"clock_nanosleep", "futex", "getrusage"}, set(under_way)
    assert max(names.count("sendmsg") for names in calls.values()) > 1000


@pytest.mark.parametrize("options, held", [([], True), (["--idle-states"], False), (["--priority", "0"], False)])
def test_idle_states_are_held_off_while_it_runs(tmp_path, options, held):
    """The file is open while the loop runs, or the program says why it could not be opened."""
    latency = "/dev/cpu_dma_latency"
    (tmp_path / "samples.csv").write_text("time_s,fx_N,fy_N,fz_N\n0,0,0,0\n")
    process = subprocess.Popen([BUILD / "bin/haptic-rt", "--bus", "virtual:idle", "--trocar", "0,0,0", "--samples", tmp_path / "samples.csv", "--duration", "0.5",
                                "--json", tmp_path / "c.json", *options], env=dict(os.environ, TM_BUS_DIR=str(tmp_path)), stderr=subprocess.PIPE, text=True)
    opened = set()
    while process.poll() is None:
        with contextlib.suppress(OSError):  # it may end while we look
            opened.update(os.readlink(fd.path) for fd in os.scandir(f"/proc/{process.pid}/fd"))
        time.sleep(0.01)
    assert process.returncode == 0
    said, report = process.stderr.read(), json.loads((tmp_path / "c.json").read_text())
    held = held and os.path.exists(latency)
    if held and not os.access(latency, os.W_OK):
        assert latency in said and not report["idle_states_held_off"]
    else:
        assert report["idle_states_held_off"] == held == (latency in opened), said
