"""Prints the table of docs/devices.md: how long the force lasts in each trouble of each driver. Run it with the tests' Python."""
import pathlib
import sys
import tempfile

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1]), str(pathlib.Path(__file__).resolve().parent)]
import motorkit  # noqa: E402
import test_crtk_master  # noqa: E402
import test_haply  # noqa: E402
import test_libraries  # noqa: E402

SAYS = {"killed": "killed", "frozen": "freezes for 0.4 s", "flood": "sends far too many states", "late:50": "answers 50 ms late", "late": "answers 50 ms late", "nonsense": "sends invalid values",
        "silent": "sends nothing", "close": "closes the connection", "unpowered": "loses its power supply", "position": "fails to read", "force": "fails to take a force", "error": "a motor reports an error", "short": "frames cut short",
        "master": "its master is killed", "unready": "its master is not ready"}


def row(device, trouble, result):
    controller_ms, device_ms, report, _, _ = result
    print(f"| {device} | {SAYS[trouble]} | {controller_ms:.1f} | {device_ms:.1f} | {report['state'] if report['fault'] == 'none' else report['fault']} |", flush=True)


def main(top):
    """Plays each failure of each device; `top` holds the stub libraries."""
    print("| device | failure | controller, ms | at the device, ms | afterwards |\n|---|---|---|---|---|")
    for k, trouble in enumerate(test_haply.TROUBLES if test_haply.built_in() else ()):
        (top / f"h{k}").mkdir()
        row("haply", trouble, test_haply.in_trouble(top / f"h{k}", trouble))
    for device in ("touch:0", "omega:0"):
        for trouble in test_libraries.TROUBLES:
            tmp = top / (device[:-2] + trouble)
            tmp.mkdir()
            row(device[:-2], trouble, test_libraries.in_trouble(tmp, top, device, trouble))
    for trouble in test_crtk_master.TROUBLES:
        if trouble == "controller":
            continue  # not the device's
        tmp = top / ("crtk" + trouble)
        tmp.mkdir()
        row("crtk", trouble, test_crtk_master.in_trouble(tmp, trouble))
    for kind in motorkit.KINDS:
        for trouble in motorkit.TROUBLES:
            if trouble == "flood":
                continue  # valid frames, fifty times as many: no trouble
            tmp = top / (kind + trouble)
            tmp.mkdir()
            bench = motorkit.Axes(tmp, kind, "--trouble", trouble, "--after", "0.3")
            row(kind, trouble, motorkit.in_trouble(bench, trouble))
            bench.end()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        test_libraries.build_stubs(folder)
        main(folder)
