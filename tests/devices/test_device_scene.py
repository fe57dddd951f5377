"""The demo's scene with each device: in lockstep with its virtual form, in real time with its emulator; and the table of docs/devices.md that
device_table.py makes of these runs."""
import re

import motorkit
import pytest
import scenekit
import test_libraries
from paths import LONG, ROOT
from test_haply import built_in

TWINS = sorted({scenekit.type_of(name) for name in scenekit.NAMES} | {"minverse"})


@pytest.fixture(scope="module")
def stubs(once):
    return once("stub-libraries", test_libraries.build_stubs)


def table():
    """{device: cells} of the page's table of devices."""
    text = (ROOT / "docs/devices.md").read_text()
    lines = text[text.index(scenekit.HEAD):].split("\n\n")[0].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0]: row[1:] for row in rows}


@pytest.mark.parametrize("device", TWINS)
def test_lockstep_with_the_virtual_device_gives_the_force_of_the_page(tmp_path, device):
    seen = scenekit.lockstep(tmp_path, device)
    assert seen["controllers"][0]["state"] == "engaged" and not seen["controllers"][0]["fault"]
    assert 0.1 < seen["force_N"]["peak"] < 2.0
    for name, cells in table().items():
        if cells[0] == device:
            assert cells[1] == f"{seen['force_N']['peak']:.2f}", f"{name}: run build/venv/bin/python tests/devices/device_table.py --write"


# The short form runs one of each way in: service, library, bus with steps of its own.
@pytest.mark.parametrize("name", scenekit.NAMES if LONG else ("haply", "touch", "cia402"))
def test_real_time_with_the_emulator(tmp_path, stubs, name):
    """The force at the emulator is that of the controller's ticks, one after the other, within half its last step."""
    if name == "haply" and not built_in():
        pytest.skip("haptic-rt was built without libwebsockets (libwebsockets-dev)")
    told, compared, worst = scenekit.real_time(tmp_path, name, stubs)
    print(name, told["force_N"], compared, worst)
    assert told["force_N"]["peak"] > 0.1 and compared > 200
    assert worst <= scenekit.quantum_N(name) + 4 * motorkit.FLOAT


def test_the_page_holds_every_device_and_what_was_found():
    page, text = table(), (ROOT / "docs/devices.md").read_text()
    assert set(page) == set(scenekit.NAMES)
    for name, (twin, _, emulator, compared, worst, quantum, hardware) in page.items():
        assert twin == scenekit.type_of(name) and emulator == scenekit.EMULATORS[name] and hardware == "not tested"
        assert int(compared.replace(",", "")) > 200 and float(worst) <= float(quantum) * 1.05 + 4e3 * motorkit.FLOAT and float(quantum) == float(f"{1e3 * scenekit.quantum_N(name):.2g}")
    drivers = re.findall(r"ROW\((\w+)\)", (ROOT / "haptic_rt/io/drive_table.h").read_text().split("#define HRT_DRIVES")[1])
    assert set(drivers) == set(page), "each driver has a row"
