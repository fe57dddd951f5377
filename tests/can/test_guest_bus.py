"""The guests themselves: a bus comes up in each, stock tools talk over it, and a job's failure or hang is the runner's failure."""
import guest_run
import pytest

TRAFFIC = """
timeout 20 candump -L $CAN_A > $OUT/a.log &
listener=$!
listening $OUT/a.log
cangen $CAN_B -g 2 -I 123 -L 8 -D i -n 500
heard $OUT/a.log
kill $listener
"""


@pytest.mark.parametrize("bus", ["vcan", "controllers"])
def test_every_frame_crosses(bus):
    done, out = guest_run.run(guest_run.on(bus), bus, f"bus_{bus}", TRAFFIC, 300)
    assert done.returncode == 0, done.stderr
    frames = guest_run.candump(out / "a.log")
    assert [int.from_bytes(data, "little") for _, _, _, data in frames] == list(range(500))
    assert {identifier for _, _, identifier, _ in frames} == {0x123}


def test_failure_and_hang_are_told():
    kind = guest_run.vcan_guest()
    done, _ = guest_run.run(kind, "vcan", "bus_fails", "echo a word on the console; exit 7\n", 300)
    assert done.returncode == 7 and "a word on the console" in done.stderr
    done, _ = guest_run.run(kind, "vcan", "bus_hangs", "mkfifo $TMPDIR/never; read word < $TMPDIR/never\n", 8 if kind == "uml" else 25)
    assert done.returncode == 124
