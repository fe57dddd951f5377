"""Collects the results of each replay into build/firmware/report.json; as a program, prints them as a table."""
import fcntl
import json
import os
import pathlib
import sys


def collect(runs, firmware):
    """Merges the reports. `runs`: build/tests/firmware with CPU/VARIANT/report.json. Several test processes may do this concurrently."""
    with open(firmware / ".report.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        found = {}
        for path in sorted(runs.glob("m*/*/report.json")):
            found.setdefault(path.parent.parent.name, {})[path.parent.name] = json.loads(path.read_text())
        part = firmware / "report.json.part"
        part.write_text(json.dumps(found, indent=1) + "\n")
        os.replace(part, firmware / "report.json")


def table(report):
    lines = [f"{'image':16}{'core':>8}{'flash':>8}{'RAM/device':>11}{'stack':>7}  instructions per tick, worst"]
    for cpu, variants in report.items():
        for variant, r in variants.items():
            worst = "  ".join(f"{law} {cost['worst']}" for law, cost in r["instructions_per_tick"].items())
            same = "host's bits" if r["differences_from_host"] is None else f"differs: {r['differences_from_host']}"
            lines.append(f"{cpu + ' ' + variant:16}{r['flash_core_bytes']:8}{sum(r['flash_bytes'].values()):8}{r['ram_bytes_per_device']:11}"
                         f"{r['stack_bytes']:7}  {worst}; {same}")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(json.loads(pathlib.Path(sys.argv[1]).read_text())))
