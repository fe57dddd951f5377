"""Makes the tables of docs/devices.md and docs/device-failures.md by runs: the demo's scene with each device, and how long a force lasts when something fails. Run it with the
tests' Python.

    device_table.py [--write]           prints them, or puts them into the pages
    device_table.py --twins [--write]   the table of the twins' stiffness and errors, by tm-evaluate, instead"""
import contextlib
import io
import json
import pathlib
import subprocess
import sys
import tempfile

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1]), str(pathlib.Path(__file__).resolve().parent)]
import scenekit  # noqa: E402
import stop_times  # noqa: E402
import test_libraries  # noqa: E402
from paths import BUILD, ROOT  # noqa: E402


def scenes(top):
    lines, peaks = [scenekit.HEAD, "|" + "---|" * 8], {}
    for name in scenekit.NAMES:
        twin, tmp = scenekit.type_of(name), top / ("scene-" + name)
        tmp.mkdir()
        if twin not in peaks:
            peaks[twin] = scenekit.lockstep(tmp, twin)["force_N"]["peak"]
        _, compared, worst = scenekit.real_time(tmp, name, top, 8)
        assert compared > 200, f"{name}: {compared} forces compared; run it again on a quieter machine"
        lines.append(f"| {name} | {twin} | {peaks[twin]:.2f} | {scenekit.EMULATORS[name]} | {compared:,} | {1e3 * worst:.2g} | {1e3 * scenekit.quantum_N(name):.2g} | not tested |")
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def stops(top):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        stop_times.main(top)
    return said.getvalue().splitlines()


RATES = (500, 1000, 2000, 4000)
TWINS = "| twin | stiffest wall at 500 Hz, N/m | 1000 Hz | 2000 Hz | 4000 Hz | error of the force at 500 Hz, mN | 1000 Hz | 2000 Hz | 4000 Hz | at 4000 Hz, 2 ms late |"


def twins(top):
    """The rows of a run of tm-evaluate: largest stable stiffness, and error of the force at the hand."""
    subprocess.run([BUILD / "bin/tm-evaluate", "--study", "--part", "devices", "--json", top / "d.json"], check=True)
    data = json.loads((top / "d.json").read_text())["devices"]
    wall = {(r["device"], r["rate_Hz"]): f"{r['stiffness_N_m']:,.0f}" for r in data["z_width"]}
    error = {(r["device"], r["rate_Hz"], r["late_ms"]): f"{r['error_mN']:.1f}" for r in data["errors"]}
    names = list(dict.fromkeys(r["device"] for r in data["z_width"]))
    cells = lambda n: [n, *(wall[n, rate] for rate in RATES), *(error[n, rate, 0] for rate in RATES), error[n, 4000, 2]]
    return [TWINS, "|" + "---|" * 10, *("| " + " | ".join(cells(n)) + " |" for n in names)]


def put(text, lines):
    at = text.index(lines[0])
    end = text.index("\n\n", at)
    return text[:at] + "\n".join(lines) + text[end:]


PAGES = (ROOT / "docs/devices.md", ROOT / "docs/device-failures.md")


def main(words):
    with tempfile.TemporaryDirectory() as top:
        top = pathlib.Path(top)
        test_libraries.build_stubs(top)
        tables = [twins(top)] if "--twins" in words else [scenes(top), stops(top)]
    if "--write" not in words:
        print("\n\n".join("\n".join(lines) for lines in tables))
        return
    for page, lines in zip(PAGES, tables):
        page.write_text(put(page.read_text(), lines))


if __name__ == "__main__":
    main(sys.argv[1:])
