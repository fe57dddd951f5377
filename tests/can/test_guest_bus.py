"""The guest itself: its buses start, stock tools communicate, and a failing or hanging job fails the runner."""
import guest_run
import pytest
from guest_scenes import LIMIT_S, part

@pytest.mark.parametrize("bus", ["vcan", "controllers"])
def test_every_frame_crosses(bus):
    frames = guest_run.candump(part("traffic", bus) / "a.log")
    assert [int.from_bytes(data, "little") for _, _, _, data in frames] == list(range(500))
    assert {identifier for _, _, identifier, _ in frames} == {0x123}


def test_failure_and_hang_are_told():
    done, _ = guest_run.run("bus_fails", "echo a word on the console; exit 7\n", LIMIT_S)
    assert done.returncode == 7 and "a word on the console" in done.stderr
    done, _ = guest_run.run("bus_hangs", "mkfifo $TMPDIR/never; read word < $TMPDIR/never\n", 2)
    assert done.returncode == 124


def test_one_controller_and_one_device_an_interface():
    """A second program on an interface is refused with its reason; one on the other interface is not. After a kill the interface is free."""
    out = part("places")
    codes = dict(line.split() for line in (out / "codes").read_text().splitlines())
    assert codes == {"first": "2", "controller": "2", "device": "2", "other": "0", "fault": "1", "again": "0"}, codes
    assert "another haptic-rt is already controller 0 on this bus; end it" in (out / "c2.txt").read_text()
    assert "another tm-device is already device 0 on this bus; end it" in (out / "d2.txt").read_text()
