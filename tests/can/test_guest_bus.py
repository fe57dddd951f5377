"""The guests themselves: a bus comes up in each, stock tools talk over it, and a job's failure or hang is the runner's failure."""
import guest_run
import pytest
from paths import BUILD, ROOT

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


def test_one_controller_and_one_device_an_interface():
    """A second one is refused with its reason, of the other instrument not; after a kill the place is free."""
    controller, device = (f"{BUILD}/bin/{p} --bus socketcan:$CAN_A --priority 0 --duration" for p in ("haptic-rt", "tm-device"))
    job = f"""
cd {ROOT}
{controller} 20 --samples $TMPDIR/none.csv --trocar 0,0,0 2> $OUT/first.txt; echo first $? > $OUT/codes
printf 'time_s,fx_N,fy_N,fz_N\\n0,0,0,0\\n' > $TMPDIR/s.csv
{controller} 20 --samples $TMPDIR/s.csv --trocar 0,0,0 2> $OUT/c.txt & c=$!
{device} 20 2> $OUT/d.txt & d=$!
until grep -q 'waiting for fresh' $OUT/c.txt; do sleep 0.05; done
{controller} 1 --samples $TMPDIR/s.csv 2> $OUT/c2.txt; echo controller $? >> $OUT/codes
{device} 1 2> $OUT/d2.txt; echo device $? >> $OUT/codes
{controller} 0.5 --instrument 1 --samples $TMPDIR/s.csv 2> $OUT/other.txt; echo other $? >> $OUT/codes
grep -q fault $OUT/c.txt; echo fault $? >> $OUT/codes
kill -9 $c $d; wait $c $d
{controller} 0.5 --samples $TMPDIR/s.csv 2> $OUT/again.txt; echo again $? >> $OUT/codes
true
"""
    done, out = guest_run.run(guest_run.vcan_guest(), "vcan", "bus_places", job, 300)
    assert done.returncode == 0, done.stderr
    codes = dict(line.split() for line in (out / "codes").read_text().splitlines())
    assert codes == {"first": "2", "controller": "2", "device": "2", "other": "0", "fault": "1", "again": "0"}, codes
    assert "another haptic-rt is already controller 0 on this bus; end it" in (out / "c2.txt").read_text()
    assert "another tm-device is already device 0 on this bus; end it" in (out / "d2.txt").read_text()
