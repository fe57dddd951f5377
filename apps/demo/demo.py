"""make demo: runs the control loop once in real time, then in lockstep, and draws pictures, a video, a force plot and figures into one folder.

The stages run one after the other, so that drawing never takes processor time from the real-time run.
"""
import argparse
import csv
import json
import math
import os
import pathlib
import platform
import shutil
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from session import Session  # noqa: E402


def arguments():
    p = argparse.ArgumentParser(description="Runs a scene with its devices and controllers in real time, records it, draws it, and runs it again in lockstep.")
    p.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build"), help="where bin/ and python/ are [build]")
    p.add_argument("--out", type=pathlib.Path, help="results [BUILD/demo]")
    p.add_argument("--scene", type=pathlib.Path, default=HERE.parent / "scenes" / "liver-press.yaml")
    p.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help="as of tm-sim")
    p.add_argument("--duration", type=float, help="seconds of the real-time run [the scene's, and one more]")
    p.add_argument("--size", default="1280x720", help="size of video and pictures")
    p.add_argument("--camera", default="", help="options for tm-view, in one string")
    p.add_argument("--no-models", action="store_true", help="do not run the scene by each model")
    p.add_argument("--no-video", action="store_true", help="figures and pictures, no video")
    p.add_argument("--realtime-only", action="store_true", help=argparse.SUPPRESS)  # the stage inside the network namespace
    a = p.parse_args()
    a.build = a.build.resolve()
    a.out = (a.out or a.build / "demo").resolve()
    return a


def fail(message):
    print(f"demo: {message}", file=sys.stderr)
    sys.exit(1)


def say(message):
    print(f"demo: {message}", flush=True)


# --- the real-time run, inside the namespace ---


def realtime(a):
    session = Session(a.build / "bin", a.scene, a.out, sets=a.set)
    duration = a.duration or session.facts["duration_s"] + 1
    try:
        session.start_logger(a.out / "demo.lcm")
        session.start_ring(duration)
        good = session.wait(("tm-sim", "tm-device", "haptic-rt"))
    finally:
        session.end()
    return 0 if good else 1


def run_realtime(a):
    say("real time: simulation, controllers and virtual devices, each its own program (`make spy` shows their messages)")
    passed = [x for x in sys.argv[1:]]
    command = [HERE / "netns.sh", "run", a.out / "netns.pid", sys.executable, __file__, *passed, "--realtime-only"]
    code = subprocess.run([str(c) for c in command]).returncode
    (a.out / "netns.pid").unlink(missing_ok=True)
    if code:
        fail(f"the real-time run failed; the programs' messages are in {a.out}/*.txt, and docs/troubleshooting.md helps by symptom")


# --- lockstep ---


def run_lockstep(a):
    """Runs the scene twice on a virtual clock, with the plain form of the force loop: the hashes must be equal."""
    results = []
    for n in (1, 2):
        say(f"lockstep, run {n} of 2")
        figures = a.out / f"lockstep{n}.json"
        extra = ["--csv", a.out / "lockstep.csv", "--samples", a.out / "lockstep_samples.csv"] if n == 1 else []
        sets = [x for s in a.set for x in ("--set", s)]
        command = [a.build / "bin" / "tm-sim", a.scene, *sets, "--lockstep", "--force", "plain", "--json", figures, *extra]
        run = subprocess.run([str(c) for c in command], stdout=subprocess.DEVNULL)
        if run.returncode:
            fail("the lockstep run failed; its message is above")
        results.append(json.loads(figures.read_text()))
    if results[0]["state_hash"] != results[1]["state_hash"]:
        fail(f"two lockstep runs ended in different states, {results[0]['state_hash']} and {results[1]['state_hash']}; please report this with the scene")
    return results


def run_slow(a):
    """Repeats the run at 25 force samples a second, the paper's rate, to plot what the controller must extrapolate."""
    say("lockstep, 25 force samples a second")
    sets = [x for s in [*a.set, "haptics.rate=25 Hz"] for x in ("--set", s)]
    command = [a.build / "bin" / "tm-sim", a.scene, *sets, "--lockstep", "--quiet", "--csv", a.out / "slow.csv", "--samples", a.out / "slow_samples.csv"]
    if subprocess.run([str(c) for c in command], stdout=subprocess.DEVNULL).returncode:
        fail("the lockstep run at 25 force samples a second failed; its message is above")


# --- the three models ---


MODELS = ("dynamic", "precomputed", "hybrid")
SHOWN = HERE.parent / "scenes" / "liver-press.yaml"  # replaces a scene that only one model can run, such as one with a cut


def models_that_run(a, scene, sets):
    """Returns {model: None, or the reason why the scene cannot run with it}."""
    why = {}
    for model in MODELS:
        run = subprocess.run([str(c) for c in (a.build / "bin" / "tm-sim", scene, *sets, "--set", f"model={model}", "--check")], capture_output=True, text=True)
        why[model] = run.stderr.strip().splitlines()[-1] if run.returncode else None
    return why


def run_models(a):
    """Runs one scene with the dynamic, the precomputed and the hybrid model: one line of the scene differs, the rendered force must not."""
    scene, sets = a.scene, [x for s in a.set for x in ("--set", s)]
    why = models_that_run(a, scene, sets)
    stands_in = sum(w is None for w in why.values()) < 2 and scene.resolve().parent == SHOWN.parent
    if stands_in:
        scene, sets, why = SHOWN, [], models_that_run(a, SHOWN, [])
    duration = ["--duration", "3.4 s"] if stands_in else ["--duration", f"{a.duration:g} s"] if a.duration else []
    results = {}
    for model in (m for m in MODELS if why[m] is None):
        say(f"lockstep, model {model}{f' of {SHOWN.name}' if stands_in else ''}")
        figures = a.out / f"model_{model}.json"
        command = [a.build / "bin" / "tm-sim", scene, *sets, "--set", f"model={model}", "--lockstep", *duration, "--json", figures]
        if subprocess.run([str(c) for c in command], stdout=subprocess.DEVNULL).returncode:
            fail(f"the lockstep run of the model {model} failed; its message is above")
        r = load(figures)
        results[model] = {"force_N": r["force_N"], "sim_seconds_per_compute_second": r["sim_seconds_per_wall_second"]}
    return {"models": results, "models_scene": os.path.relpath(scene), "models_refused": {m: w for m, w in why.items() if w}}


# --- figures ---


def load(path):
    return json.loads(path.read_text())


def commit(root):
    run = subprocess.run(["git", "-C", str(root), "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    return run.stdout.strip() or "unknown"


def processor():
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def summary(a, lockstep, models):
    sim, facts = load(a.out / "sim.json"), load(a.out / "hand.json")
    controllers = [load(a.out / f"controller{i}.json") for i in range(len(facts["instruments"]))]
    worst = {k: max(c["lateness_us"][k] for c in controllers) for k in ("p50", "p99", "max")}
    square = sum(c["force_N"]["rms"] ** 2 for c in controllers) / len(controllers)
    return {
        "scene": os.path.relpath(a.scene), "title": facts["title"], "model": sim["model"],
        "tets": sim["tets"], "vertices": sim["vertices"], "tets_alive_at_end": sim["tets_alive"],
        "frames": sim["frames"], "frame_s": sim["frame_s"], "substeps_per_frame": sim["substeps_per_frame"], "dt_s": sim["dt_s"],
        "sim_seconds_per_wall_second": sim["sim_seconds_per_wall_second"],
        "sim_seconds_per_compute_second": sim["sim_seconds_per_compute_second"],
        "force_samples": sim["force_samples"], "overruns": sim["overruns"], "dropped_s": sim["dropped_s"], "frame_compute_us": sim["frame_compute_us"],
        "ticks": sum(c["ticks"] for c in controllers), "missed_ticks": sum(c["missed_ticks"] for c in controllers),
        "lateness_us": worst,
        "force_N": {"rms": math.sqrt(square), "peak": max(c["force_N"]["peak"] for c in controllers)},
        "instruments": [{"mode": t["mode"], "ticks": c["ticks"], "missed_ticks": c["missed_ticks"], "lateness_us": c["lateness_us"],
                         "force_N": c["force_N"], "samples": c["samples"], "extrapolator": c["extrapolator"], "real_time": c["real_time"],
                         "fault": c["fault"]} for t, c in zip(facts["instruments"], controllers)],
        "state_hash": lockstep[0]["state_hash"],
        "lockstep": {"runs": len(lockstep), "force_form": lockstep[0]["force"], "frames": lockstep[0]["frames"], "force_N": lockstep[0]["force_N"],
                     "sim_seconds_per_compute_second": lockstep[0]["sim_seconds_per_wall_second"]},
        **models,
        "machine": {"processor": processor(), "cores": os.cpu_count(), "kernel": platform.release()},
        "commit": commit(HERE),
    }


def near(path):
    relative = os.path.relpath(path)
    return path if relative.startswith("..") else relative


def table(s, a):
    late = s["lateness_us"]
    rows = [
        ("organ", f"{s['tets']:,} tetrahedra, {s['tets_alive_at_end']:,} at the end; {s['frames']} frames of {s['substeps_per_frame']} substeps"),
        ("simulation", f"{s['sim_seconds_per_wall_second']:.3f} s per s of wall clock ({s['sim_seconds_per_compute_second']:.1f} per s of computing), {s['overruns']} overruns"),
        ("force samples", f"{s['force_samples']['mean_rate_Hz']:.0f} a second, {s['force_samples']['changes']} changes of rate, {s['force_samples']['merged']} merged"),
        ("controllers", f"{s['ticks']} ticks, {s['missed_ticks']} missed; late by p50 {late['p50']:.0f}, p99 {late['p99']:.0f}, max {late['max']:.0f} us"),
        ("forces", f"{s['force_N']['rms']:.3f} N RMS, {s['force_N']['peak']:.3f} N peak"),
        ("lockstep", f"state {s['state_hash']}, the same twice"),
        *([("models", f"{s['models_scene']}, peak force: " + "; ".join(f"{m} {r['force_N']['peak']:.3f} N" for m, r in s["models"].items()))] if s["models"] else []),
        *[("", f"not {m}: {why}") for m, why in s["models_refused"].items()],
        ("results", f"{near(a.out)}: summary.json {'' if a.no_video else 'video.mp4 '}picture.png frames/ force.png demo.lcm"),
    ]
    print()
    for name, text in rows:
        print(f"  {name:<13} {text}")
    print()
    if not all(i["real_time"] for i in s["instruments"]):
        print("  The controllers ran with normal scheduling: SCHED_FIFO was not permitted (docs/troubleshooting.md, 'missed ticks').\n")


# --- pictures ---


def view(a, *args):
    command = [a.build / "bin" / "tm-view", a.out / "demo.lcm", "--scene", a.scene, "--size", a.size, *a.camera.split(), *args]
    if subprocess.run([str(c) for c in command]).returncode:
        fail("tm-view failed; its message is above")


def strongest_moment(a):
    """Returns the time of the largest simulated force, s after the log's first tissue message, and the log's duration."""
    import lcm

    sys.path.insert(0, str(a.build / "python"))
    import tensormass_lcm

    begin, best, at, last = None, -1.0, 0.0, 0.0
    for event in lcm.EventLog(str(a.out / "demo.lcm"), "r"):
        if event.channel == "TISSUE":
            begin = begin or event.timestamp
            last = event.timestamp
        elif event.channel == "SIM_STATUS" and begin:
            m = tensormass_lcm.sim_status_t.decode(event.data)
            force = max(math.hypot(*m.force_N[i]) for i in range(m.instrument_count))
            if force > best:
                best, at = force, (event.timestamp - begin) * 1e-6
    return at, (last - begin) * 1e-6


def draw(a):
    at, length = strongest_moment(a)
    say("pictures")
    view(a, "--png", a.out / "picture.png", "--at", f"{min(at, length):.3f}")
    view(a, "--frames", a.out / "frames", "--fps", "2", "--quality", "2")
    if not a.no_video:
        say("video")
        view(a, "--video", a.out / "video.mp4", "--fps", "30", "--json", a.out / "video.json")


def ticks(path, instrument=None):
    with open(path) as file:
        rows = [r for r in csv.DictReader(file) if instrument is None or r["instrument"] == str(instrument)]
    return [float(r["time_s"]) for r in rows], [math.sqrt(sum(float(r[k]) ** 2 for k in ("fx_N", "fy_N", "fz_N"))) for r in rows]


def samples(a, instrument, begin_us):
    import lcm

    sys.path.insert(0, str(a.build / "python"))
    import tensormass_lcm

    time_s, force = [], []
    for event in lcm.EventLog(str(a.out / "demo.lcm"), "r"):
        if event.channel == f"FORCE_{instrument}":
            m = tensormass_lcm.force_sample_t.decode(event.data)
            time_s.append((m.utime - begin_us) * 1e-6)
            force.append(math.hypot(*m.force_N))
    return time_s, force


def record_begin_us(a, instrument):
    """Returns when the controller's record began, on the log's clock. TOOL messages also carry the controller's clock; the one with the least delay is
    used. The first TOOL is skipped: it waits until device and trocar are known."""
    import lcm

    sys.path.insert(0, str(a.build / "python"))
    import tensormass_lcm

    lead = [e.timestamp - tensormass_lcm.tool_state_t.decode(e.data).utime for e in lcm.EventLog(str(a.out / "demo.lcm"), "r") if e.channel == f"TOOL_{instrument}"]
    if not lead:
        fail(f"the log holds no TOOL_{instrument}; haptic-rt's messages are in {a.out}/haptic-rt{instrument}.txt")
    return min(lead) + load(a.out / f"controller{instrument}.json")["start_us"]


def replayed(a, instrument, law):
    """Returns the force that another extrapolator would have rendered from the same samples: seconds on the controller's clock, and newtons. Empty if the
    log cannot be evaluated."""
    path = a.out / "forces.csv"
    if not path.exists():
        command = [str(a.build / "bin" / "tm-evaluate"), str(a.out / "demo.lcm"), "--forces", str(path)]
        with open(a.out / "evaluate.txt", "w") as words:
            if subprocess.run(command, stdout=words, stderr=subprocess.STDOUT).returncode:
                return [], []
    begin_us = load(a.out / f"controller{instrument}.json")["start_us"]
    with open(path) as file:
        rows = [r for r in csv.DictReader(file) if r["instrument"] == str(instrument)]
    return ([(int(r["tool_us"]) - begin_us) * 1e-6 for r in rows], [math.hypot(*(float(r[f"{law}_f{axis}_N"]) for axis in "xyz")) for r in rows])


def zoom(axis, t, f, title):
    """Plots half a second around the steepest rise."""
    middle = rise(t, f, max(range(len(f)), key=f.__getitem__))
    inside = [v for x, v in zip(t, f) if abs(x - middle) < 0.25]
    axis.set_xlim(middle - 0.25, middle + 0.25)
    axis.set_ylim(min(inside) - 0.08 * max(inside) - 0.01, 1.1 * max(inside) + 0.01)
    axis.set_title(title, fontsize=9)


def plot(a, s):
    """Plots one row an instrument: the session, half a second of it, and half a second of the same scene at 25 force samples a second."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    felt, computed, grey = dict(color="#c05a1c", linewidth=1.1), dict(color="#245d80", marker="o", linestyle=""), dict(color="#a0a0a0", linewidth=0.8)
    count = len(s["instruments"])
    figure, axes = plt.subplots(count, 3, figsize=(14, 3.2 * count + 0.4), width_ratios=(3, 2, 2), squeeze=False)
    for i, (whole, near, slow) in enumerate(axes):
        t, f = ticks(a.out / f"ticks{i}.csv")
        ts, fs = samples(a, i, record_begin_us(a, i))
        rate = (len(ts) - 1) / max(ts[-1] - ts[0], 1e-9)
        other = "hold" if s["instruments"][i]["extrapolator"] == "position" else "position"
        to, fo = replayed(a, i, other)
        for axis in (whole, near):
            axis.plot(to, fo, **grey, label=f"`{other}` on the same samples")
            axis.plot(t, f, **felt, label=f"controller, {(len(t) - 1) / max(t[-1] - t[0], 1e-9):.0f} Hz")
            axis.plot(ts, fs, **computed, markersize=1.2 if axis is whole else 3, label=f"simulation, {rate:.0f} Hz")
        tl, fl = ticks(a.out / "slow.csv", i)
        tn, fn = ticks(a.out / "slow_samples.csv", i)
        slow.plot(tl, fl, **felt)
        slow.plot(tn, fn, **computed, markersize=5)
        whole.set_ylabel(f"{s['instruments'][i]['mode']}: force, N")
        whole.legend(loc="upper left", fontsize=8)
        zoom(near, t, f, "half a second of it")
        zoom(slow, tl, fl, "the same scene at 25 samples a second (lockstep)")
        for axis in (whole, near, slow):
            axis.set_xlabel("time, s")
            axis.grid(alpha=0.25)
    figure.suptitle(f"{s['title']}: {s['instruments'][0]['extrapolator']} between samples", fontsize=11)
    figure.tight_layout()
    figure.savefig(a.out / "force.png", dpi=110, metadata={"Software": None})


def rise(t, f, peak):
    """Returns the middle of the steepest half second before the peak, where extrapolation is visible."""
    step = 250
    best = max(range(step, max(peak + 1, step + 1)), key=lambda k: f[min(k, len(f) - 1)] - f[min(k, len(f) - 1) - step], default=peak)
    best = min(best, len(t) - 1)
    return (t[best] + t[max(0, best - step)]) / 2


def main():
    a = arguments()
    if a.realtime_only:
        sys.exit(realtime(a))
    for program in ("lcm-logger", "ip", "unshare", *([] if a.no_video else ["ffmpeg"])):
        if not shutil.which(program):
            print(f"demo: {program} is not installed; run `make demo`, which installs what is missing, or tools/setup.sh build demo", file=sys.stderr)
            sys.exit(2)
    if not a.scene.exists():
        print(f"{a.scene}: this scene does not exist; the scenes are in apps/scenes", file=sys.stderr)
        sys.exit(2)
    shutil.rmtree(a.out, ignore_errors=True)
    a.out.mkdir(parents=True)
    began = time.monotonic()
    run_realtime(a)
    lockstep = run_lockstep(a)
    run_slow(a)
    s = summary(a, lockstep, {"models": {}, "models_scene": None, "models_refused": {}} if a.no_models else run_models(a))
    draw(a)
    plot(a, s)
    s["demo_seconds"] = round(time.monotonic() - began, 1)
    temporary = a.out / "summary.json~"
    temporary.write_text(json.dumps(s, indent=1) + "\n")
    temporary.rename(a.out / "summary.json")
    table(s, a)


if __name__ == "__main__":
    main()
