"""Measures how late haptic-rt's ticks are, in alternation with cyclictest on the same machine: the same period and priority, with idle and with busy
processors. Asserts nothing: lateness depends on the machine and its other users.

    timing.py [--quick] --bin build/bin --json build/bench/timing.json"""
import argparse
import json
import os
import pathlib
import platform
import shutil
import statistics
import subprocess
import tempfile

PERIOD_US = 2000
PRIORITY = 80
QUANTILES = {"p50": 0.5, "p99": 0.99, "p999": 0.999}


def cyclictest(seconds, directory):
    """Returns quantiles of its lateness, us."""
    hist = directory / "cyclictest.hist"
    subprocess.run(["cyclictest", "-q", "-m", "-t1", "-p", str(PRIORITY), "-i", str(PERIOD_US), "-l", str(int(seconds * 1e6 / PERIOD_US)), "-h", "100000",
                    f"--histfile={hist}"], check=True, timeout=seconds * 3 + 60, stdout=subprocess.DEVNULL)
    counts = {int(bin_us): int(count) for bin_us, count in (line.split() for line in hist.read_text().splitlines() if line and line[0].isdigit())}
    overflow = [line for line in hist.read_text().splitlines() if "Overflows" in line]
    total, result = sum(counts.values()), {}
    for name, q in QUANTILES.items():
        seen = 0
        for bin_us in sorted(counts):
            seen += counts[bin_us]
            if seen >= q * total:
                result[name] = bin_us
                break
    result["max"] = max(bin_us for bin_us, count in counts.items() if count)
    return {"lateness_us": result, "overflow": overflow[:1], "ticks": total}


def haptic_rt(seconds, directory, bin_directory):
    """The controller with a device and recorded samples on a virtual bus."""
    bus = tempfile.mkdtemp(prefix="tm-timing-", dir="/dev/shm")
    environment = dict(os.environ, TM_BUS_DIR=bus)
    samples = directory / "samples.csv"
    samples.write_text("time_s,fx_N,fy_N,fz_N\n" + "".join(f"{i / 30:.4f},0,0,{-1 - 0.1 * (i % 2)}\n" for i in range(int(seconds * 30))))
    device = subprocess.Popen([bin_directory / "tm-device", "--bus", "virtual:timing", "--duration", str(seconds + 2), "--priority", str(PRIORITY - 10)], env=environment,
                              stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        subprocess.run([bin_directory / "haptic-rt", "--bus", "virtual:timing", "--trocar", "0,0,0", "--samples", samples, "--duration", str(seconds), "--priority",
                        str(PRIORITY), "--json", directory / "haptic_rt.json"], env=environment, check=True, timeout=seconds * 3 + 60, stderr=subprocess.DEVNULL)
    finally:
        device.kill()
        device.wait()
        shutil.rmtree(bus)
    figures = json.loads((directory / "haptic_rt.json").read_text())
    return {k: figures[k] for k in ("lateness_us", "duration_us", "stage_us", "ticks", "missed_ticks", "real_time", "idle_states_held_off", "page_faults_minor", "page_faults_major")}


def measure(load, rounds, seconds, directory, bin_directory):
    busy = [subprocess.Popen(["sh", "-c", "while :; do :; done"]) for _ in range(os.cpu_count() if load == "busy" else 0)]
    try:
        turns = []
        for turn in range(rounds):  # each program is first equally often
            who = {"cyclictest": lambda: cyclictest(seconds, directory), "haptic_rt": lambda: haptic_rt(seconds, directory, bin_directory)}
            turns.append({name: who[name]() for name in sorted(who, reverse=turn % 2 == 1)})
    finally:
        for process in busy:
            process.kill()
            process.wait()
    for turn in turns:
        turn["ratio_p999"] = turn["haptic_rt"]["lateness_us"]["p999"] / max(1, turn["cyclictest"]["lateness_us"]["p999"])
    late = {who: statistics.median(turn[who]["lateness_us"]["p999"] for turn in turns) for who in ("cyclictest", "haptic_rt")}
    return {"turns": turns, "ratio_p999_median": statistics.median(turn["ratio_p999"] for turn in turns), "ratio_of_medians_p999": late["haptic_rt"] / late["cyclictest"]}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--bin", type=pathlib.Path, required=True)
    parser.add_argument("--json", type=pathlib.Path, required=True)
    options = parser.parse_args()
    rounds, seconds = (2, 4) if options.quick else (12, 10)
    model = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "")
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    report = {"machine": {"processor": model, "processors": os.cpu_count(), "kernel": platform.release(), "commit": commit, "load_before": os.getloadavg()[0]},
              "period_us": PERIOD_US, "priority": PRIORITY, "seconds_per_turn": seconds}
    with tempfile.TemporaryDirectory() as directory:
        for load in ("idle", "busy"):
            report[load] = measure(load, rounds, seconds, pathlib.Path(directory), options.bin)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    part = options.json.with_suffix(".part")
    part.write_text(json.dumps(report, indent=1) + "\n")
    part.replace(options.json)
    print(f"{'':6}{'':13}{'p50':>8}{'p99':>8}{'p99.9':>8}{'max':>9}  us late, medians of {rounds} turns of {seconds} s")
    for load in ("idle", "busy"):
        for who in ("cyclictest", "haptic_rt"):
            row = [statistics.median(turn[who]["lateness_us"][q] for turn in report[load]["turns"]) for q in ("p50", "p99", "p999", "max")]
            print(f"{load:6}{who:13}" + "".join(f"{v:8.0f}" for v in row[:3]) + f"{row[3]:9.0f}")
        print(f"{load:6}ratio of p99.9: {report[load]['ratio_of_medians_p999']:.2f} of the medians, {report[load]['ratio_p999_median']:.2f} median of turns (aim: 1.2)")


if __name__ == "__main__":
    main()
