"""Makes the tables of docs/devices.md and docs/device-failures.md by runs: the demo's scene with each device, and how long a force lasts when something fails. Run it with the
tests' Python.

    device_table.py [--write]   prints them, or puts them into the pages"""
import contextlib
import io
import pathlib
import sys
import tempfile

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1]), str(pathlib.Path(__file__).resolve().parent)]
import scenekit  # noqa: E402
import stop_times  # noqa: E402
import test_libraries  # noqa: E402
from paths import ROOT  # noqa: E402


def scenes(top):
    lines, peaks = [scenekit.HEAD, "|" + "---|" * 8], {}
    for name in scenekit.NAMES:
        twin, tmp = scenekit.type_of(name), top / ("scene-" + name)
        tmp.mkdir()
        if twin not in peaks:
            peaks[twin] = scenekit.lockstep(tmp, twin)["force_N"]["peak"]
        _, compared, worst = scenekit.real_time(tmp, name, top)
        lines.append(f"| {name} | {twin} | {peaks[twin]:.2f} | {scenekit.EMULATORS[name]} | {compared:,} | {1e3 * worst:.2g} | {1e3 * scenekit.quantum_N(name):.2g} | not tested |")
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def stops(top):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        stop_times.main(top)
    return said.getvalue().splitlines()


def put(text, lines):
    at = text.index(lines[0])
    end = text.index("\n\n", at)
    return text[:at] + "\n".join(lines) + text[end:]


with tempfile.TemporaryDirectory() as top:
    top = pathlib.Path(top)
    test_libraries.build_stubs(top)
    tables = [scenes(top), stops(top)]
PAGES = (ROOT / "docs/devices.md", ROOT / "docs/device-failures.md")
if "--write" in sys.argv[1:]:
    for page, lines in zip(PAGES, tables):
        page.write_text(put(page.read_text(), lines))
else:
    print("\n\n".join("\n".join(lines) for lines in tables))
