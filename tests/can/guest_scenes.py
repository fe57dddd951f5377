"""Scenes that the guest runs on its two buses, all in one boot, started by the first test process."""
import fcntl
import os

import guest_run
from paths import BUILD, LONG, ROOT

STEADY_S = 60 if LONG else 3
# Limit for a hang, long enough for a busy host.
LIMIT_S = 1500 + (600 if LONG else 0)

# Force steps of 0.1 N every 40 ms, so that each sample is visible in the torques: along the shaft, out of the body.
FORCE_N = (1.5, 1.6)

# scene NAME SECONDS SAMPLE_SECONDS BODY: runs both devices and both controllers for SECONDS, samples for the first SAMPLE_SECONDS, and BODY meanwhile, with their
# process ids in d0 d1 c0 c1. All must end in time.
SCENE = f"""
cd {ROOT}
scene() {{
    out=$OUT/$1 seconds=$2
    mkdir -p $out
    {{ echo time_s,fx_N,fy_N,fz_N; awk -v n=$3 'BEGIN {{ for (i = 0; i < n / 0.04; i++) printf "%.3f,0,0,%s\\n", 0.04 * i, i % 2 ? -{FORCE_N[1]} : -{FORCE_N[0]} }}'; }} > $TMPDIR/samples.csv
    candump -L $CAN_A,0:0,#FFFFFFFF > $out/a.log & listeners=$!
    if [ $CAN_A != $CAN_B ]; then candump -L $CAN_B,0:0,#FFFFFFFF > $out/b.log & listeners="$listeners $!"; listening $out/b.log; fi
    listening $out/a.log
    for i in 0 1; do
        {BUILD}/bin/tm-device --bus socketcan:$CAN_B --instrument $i --duration $(echo "$seconds 0.6" | awk '{{ print $1 + $2 }}') --json $out/d$i.json 2> $out/d$i.txt & eval d$i=$!
    done
    sleep 0.2
    for i in 0 1; do
        {BUILD}/bin/haptic-rt --bus socketcan:$CAN_A --instrument $i --samples $TMPDIR/samples.csv --extrapolator hold --trocar 0,0,0 --duration $seconds \\
            --json $out/c$i.json --stats 2> $out/c$i.txt > $out/c$i.stats & eval c$i=$!
    done
    eval "$4"
    wait $d0 $d1 $c0 $c1
    for log in $out/[a-c].log; do heard $log; done
    kill $listeners
    wait
    grep . $out/*.txt
}}
"""
SCENES = {
    "steady": (STEADY_S, 2 * STEADY_S, ""), # missed ticks prolong it
    "silent": (2.5, 1.6, ""),
    "unplugged": (2.4, 4, "sleep 1.6; kill -9 $d0"),
    "orphaned": (2.4, 4, "sleep 1.6; kill -9 $c0"),
}
ONLY = {
    "vcan": {"bus_off": (2.4, 4, "sleep 1.6; cansend $CAN_A 20000040#0000000000000000")},
    "controllers": {"down": (3, 5, "sleep 1.6; /bin/ip link set $CAN_A down; sleep 0.5; /bin/ip link set $CAN_A up; sleep 0.1; "
                                   "candump -L $CAN_A,0:0,#FFFFFFFF > $out/c.log & listeners=\\\"$listeners $!\\\"")},
}
# Stock tools communicate with each other.
TRAFFIC = """
candump -L $CAN_A > $OUT/a.log &
listener=$!
listening $OUT/a.log
cangen $CAN_B -g 2 -I 123 -L 8 -D i -n 500
heard $OUT/a.log
kill $listener
"""
# Starts a second controller or device on an interface.
CONTROLLER, DEVICE = (f"{BUILD}/bin/{p} --bus socketcan:$CAN_A --priority 0 --duration" for p in ("haptic-rt", "tm-device"))
PLACES = f"""
cd {ROOT}
{CONTROLLER} 60 --samples $TMPDIR/none.csv --trocar 0,0,0 2> $OUT/first.txt; echo first $? > $OUT/codes
printf 'time_s,fx_N,fy_N,fz_N\\n0,0,0,0\\n' > $TMPDIR/s.csv
{CONTROLLER} 60 --samples $TMPDIR/s.csv --trocar 0,0,0 2> $OUT/c.txt & c=$!
{DEVICE} 60 2> $OUT/d.txt & d=$!
until grep -q 'waiting for new' $OUT/c.txt; do sleep 0.05; done
{CONTROLLER} 1 --samples $TMPDIR/s.csv 2> $OUT/c2.txt; echo controller $? >> $OUT/codes
{DEVICE} 1 2> $OUT/d2.txt; echo device $? >> $OUT/codes
{CONTROLLER} 0.5 --instrument 1 --samples $TMPDIR/s.csv 2> $OUT/other.txt; echo other $? >> $OUT/codes
grep -q fault $OUT/c.txt; echo fault $? >> $OUT/codes
kill -9 $c $d; wait $c $d
{CONTROLLER} 0.5 --samples $TMPDIR/s.csv 2> $OUT/again.txt; echo again $? >> $OUT/codes
true
"""
# System calls of the loop's thread.
CALLS = f"""
cd {ROOT}
printf 'time_s,fx_N,fy_N,fz_N\\n0,0,0,-1\\n0.1,0,0,-1\\n' > $TMPDIR/samples.csv
{BUILD}/bin/tm-device --bus socketcan:$CAN_B --duration 3 &
strace -f -o $OUT/trace {BUILD}/bin/haptic-rt --bus socketcan:$CAN_A --trocar 0,0,0 --samples $TMPDIR/samples.csv --duration 2.2 || exit 1
wait
"""
# Commands to moteus, which no motor answers; an interface that carries classical frames only.
FD = f"""
cd {ROOT}
printf 'time_s,fx_N,fy_N,fz_N\\n0,0,0,0\\n' > $TMPDIR/s.csv
candump -L $CAN_A > $OUT/a.log & listener=$!
listening $OUT/a.log
{BUILD}/bin/haptic-rt --device moteus:socketcan:$CAN_A/1:20,2:20,3:20 --device-type desk --trocar 0,0,0 --samples $TMPDIR/s.csv --priority 0 --duration 0.3 || exit 1
heard $OUT/a.log
kill $listener
{BUILD}/bin/haptic-rt --device moteus:socketcan:can0/1:20,2:20,3:20 --device-type desk --samples $TMPDIR/s.csv --duration 0.3 2> $OUT/refused.txt; echo $? > $OUT/code
true
"""
# Scenes judged by what the programs do, not by the bus: on emulated controllers only in the long form.
PLAYED = {"vcan": SCENES, "controllers": SCENES if LONG else {"steady": SCENES["steady"]}}
# Per bus: jobs, each with a folder as OUT that also receives its status; then the scenes.
PARTS = {"vcan": {"traffic": TRAFFIC, "places": PLACES, "calls": CALLS, "fd": FD}, "controllers": {"traffic": TRAFFIC}}
INTERFACES = {"vcan": "CAN_A=vcan0 CAN_B=vcan0", "controllers": "CAN_A=can0 CAN_B=can1"}


def job():
    lines = ["all=$OUT", SCENE]
    for bus, parts in PARTS.items():
        lines += [f"export {INTERFACES[bus]} OUT=$all/{bus}"]
        lines += [f"mkdir -p $OUT/{name}\n(OUT=$OUT/{name}\n{text})\necho $? > $OUT/{name}/status" for name, text in parts.items()]
        for name, (seconds, samples, body) in {**PLAYED[bus], **ONLY[bus]}.items():
            lines += [f'scene {name} {seconds} {samples} "{body.replace("$", chr(92) + "$")}"']
    return "\n".join([*lines, "true", ""])


def scene(bus, name):
    """Returns the directory with the files of the scene or part."""
    this_run = os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid()))
    guest_run.RUNS.mkdir(parents=True, exist_ok=True)
    stamp = guest_run.RUNS / "loop.run"
    with open(guest_run.RUNS / "loop.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not stamp.exists() or stamp.read_text() != this_run:
            stamp.unlink(missing_ok=True)
            done, _ = guest_run.run("loop", job(), LIMIT_S)
            assert done.returncode == 0, done.stderr
            stamp.write_text(this_run)
    return guest_run.RUNS / "loop" / "out" / bus / name


def part(name, bus="vcan"):
    """Returns the directory of a part that ended successfully."""
    out = scene(bus, name)
    assert (out / "status").read_text() == "0\n"
    return out
