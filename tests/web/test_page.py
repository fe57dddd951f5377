"""The page in headless Chromium and Firefox: frames, figures, keys, choices, hard cases, own files, a recorded session, a device, a hidden tab, a phone.
`make web` builds it."""
import contextlib
import functools
import http.server
import json
import re
import shutil
import subprocess
import sys
import threading
import time

import pytest
from paths import BUILD, LONG, ROOT

PAGE = BUILD / "web/page"
BROWSERS = {"chromium": shutil.which("chromium"), "firefox": shutil.which("firefox-esr")}

pytestmark = pytest.mark.skipif(not (PAGE / "main.js").is_file() or not shutil.which("node"), reason="the page is not built; make web")


@contextlib.contextmanager
def served():
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *arguments):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(PAGE.parent)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/page/"
    finally:
        server.shutdown()


@contextlib.contextmanager
def haply(log):
    service = subprocess.Popen([sys.executable, ROOT / "tests/devices/haply_service.py", "--port", "0", "--log", log, "--move", "0,0,-0.02"], stdout=subprocess.PIPE, text=True)
    try:
        yield f"ws://127.0.0.1:{int(service.stdout.readline())}"
    finally:
        service.terminate()
        service.wait()


@pytest.fixture(scope="module", params=BROWSERS)
def seen(request, tmp_path_factory):
    browser = BROWSERS[request.param]
    if not browser:
        pytest.skip(f"{request.param} is not installed; tools/setup.sh web")
    folder = tmp_path_factory.mktemp(request.param)
    subprocess.run([BUILD / "bin/tm-sim", "apps/scenes/block-press.yaml", "--lockstep", "--set", "rendering={}", "--duration", "1 s", "--record", folder / "press.log"],
                   check=True, capture_output=True, timeout=120, cwd=ROOT)
    for path in ("tests/web/tied.yaml", "meshes/block_1k.msh"):
        shutil.copy(ROOT / path, folder)
    subprocess.run([BUILD / "bin/tm-sim", folder / "tied.yaml", "--lockstep", "--record", folder / "tied.lcm"], check=True, capture_output=True, timeout=120)
    shutil.copy(ROOT / "examples/web/three.html", PAGE.parent)
    with served() as url, haply(folder / "haply.csv") as service:
        screen = ["xvfb-run", "-a"] if request.param == "firefox" else []  # headless, Firefox draws no WebGL
        ran = subprocess.run([*screen, "node", ROOT / "tests/web/drive.mjs", BUILD / "web/node_modules/puppeteer-core", browser, url, folder, service,
                              ROOT / "meshes/block_1k.msh", folder / "press.log", folder / "tied.yaml", folder / "tied.lcm"], capture_output=True, text=True, timeout=500)
    assert ran.returncode == 0, ran.stderr[-3000:]
    found = json.loads(ran.stdout)
    wall_less_monotonic_us = 1e6 * (time.time() - time.monotonic())
    lines = [line.split(",") for line in (folder / "haply.csv").read_text().splitlines()]
    found["commands"] = [(float(line[0]) + wall_less_monotonic_us, [float(x) for x in re.split("[ ,]", ",".join(line[1:4]))]) for line in lines]
    return found


def test_the_page_draws_and_measures(seen):
    assert seen["frames"] > 10 and seen["stages"] >= 3
    assert float(seen["factor"]) > 0
    assert seen["controller"] in ("idle", "engaged")
    assert seen["liver"]["tets"] == "10,198"
    assert not seen["console"]


def test_keys_move_the_instrument(seen):
    assert seen["moved_m"] == pytest.approx(0.015)  # ten presses of 1.5 mm


def test_a_choice_shows_its_price_and_the_studys_error(seen):
    before, after = (float(x.strip().split()[0]) for x in seen["price"].split("→"))
    assert before > 0 and after > 0
    study = json.loads((ROOT / "web/page/study.json").read_text())
    percent = float(re.search(r"error ([\d.]+) %", seen["errors"]["error-mesh"])[1])
    assert percent == pytest.approx(100 * study["scenes"]["liver-press"]["error"]["mesh"]["liver_10k.msh"], rel=0.02)


def test_every_scene_has_errors_in_the_study():
    scenes = json.loads((ROOT / "web/page/study.json").read_text())["scenes"]
    assert sorted(scenes) == ["block-press", "liver-cut", "liver-press"]
    for name, study in scenes.items():
        assert study["error"]["mesh"] and set(study["error"]["smoothing"]) == {"off", "on"} and 0 < study["uncertainty"] < 0.5, name
        assert set(study["change"]) == {"step", "law", "gravity", "friction", "viscosity"} and set(study["change"]["step"]) == {"0.45", "1"}, name
        assert set(study["samples"]) == {"25 Hz", "50 Hz", "100 Hz"} and len(study["samples"]["25 Hz"]) == 8, name


def test_every_choice_opens(seen):
    assert len(seen["opened"]) > 25 and "choice-law=fung" in seen["opened"]


def test_hard_cases_are_judged(seen):
    energy = seen["energy"]
    assert energy["put_in_J"] > 1e-4
    assert abs(energy["residual_J"]) < 1e-6 * energy["put_in_J"]
    assert "not finite" in seen["rejected"]  # a forged sample
    assert 0.1 < seen["largest_N"] < 5  # the others are felt


def test_a_bad_mesh_has_the_librarys_sentence_and_a_good_one_is_pressed(seen):
    assert "bad.msh" in seen["error"] and ";" in seen["error"]
    tets, force_N = seen["own"]
    assert tets == 1176 and force_N > 0.1


def test_a_recorded_session_is_shown(seen):
    frames, triangles, title = seen["played"]
    assert frames == 25 and triangles > 100 and "Recorded session" in title


def test_ties_that_hold_are_drawn_and_counted(seen):
    assert all(0 < holding < all_ == 16 for holding, all_ in (seen["tied"], seen["tiedLog"])) and not seen["console"]


def test_a_hidden_tab_has_no_force(seen):
    state, force_N = seen["hidden"]
    assert state != "engaged" and force_N == 0


def test_a_device_feels_the_tissue_and_nothing_when_the_tab_is_hidden(seen):
    assert 0.1 < seen["sent_N"] < 5
    size = [(time_us, sum(f * f for f in force) ** 0.5) for time_us, force in seen["commands"]]
    assert min(abs(s - seen["sent_N"]) for _, s in size) < 2e-5, "the page reports a force that the service did not receive"
    assert max(s for _, s in size) < 5.001
    # After the command that took the force back, none has a force; the page's order to hide precedes it.
    last = max(i for i, (_, s) in enumerate(size) if s > 0)
    assert len(size) - last > 20, "the service was not asked on"
    assert all(s == 0 for _, s in size[last + 1:])


def test_the_scripted_press_has_the_bits_of_the_native_build(seen, tmp_path):
    subprocess.run([BUILD / "bin/tm-sim", "apps/scenes/block-press.yaml", "--lockstep", "--set", "haptics.compliance=iterations", "--force", "plain", "--duration", "1 s",
                    "--json", tmp_path / "run.json"], check=True, capture_output=True, timeout=120, cwd=ROOT)
    without = subprocess.run([BUILD / "bin/tm-sim", "apps/scenes/block-press.yaml", "--lockstep", "--unset", "haptics", "--force", "plain", "--duration", "1 s",
                              "--json", tmp_path / "without.json"], capture_output=True, timeout=120, cwd=ROOT)
    assert without.returncode == 0
    assert seen["ran"]["frames"] == 25
    assert seen["ran"]["hash"] == json.loads((tmp_path / "without.json").read_text())["state_hash"]


def test_marks_show_supports_patch_and_rows(seen):
    supports, patch, rows = seen["marks"]
    assert supports > 10 and patch >= 3 and rows > 0
    found = seen["rows"]
    assert found["far"] < 0.02
    size = sum(f * f for f in found["resultant"]) ** 0.5
    assert found["sum"] == pytest.approx(found["resultant"], abs=0.3 * size)  # the last substep's against the frame's mean
    assert re.fullmatch(r"\d+; [1-9]\d* bear \d\.\d\d N", found["text"])


def test_the_three_js_example_presses_its_block(seen):
    assert 0.02 < seen["example_N"] < 5


def test_the_organ_at_rest_is_the_first_picture_and_a_still_one_is_sharp(seen):
    first_ms, moving_ms = seen["appeared"]
    assert 0 < first_ms <= moving_ms
    assert seen["still"]["scale"] >= 0.99 and seen["still"]["frames"] > 10 and seen["still"]["pictures"] <= 1


def test_the_resolution_follows_the_time_of_a_picture():
    ran = subprocess.run(["node", ROOT / "tests/web/scale.mjs", ROOT / "web/page/scale.js"], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout)
    coarsest, finest = found["scales"][0], found["scales"][-1]
    assert found["start"] == 0.5 and found["slow"] == coarsest and found["fast"] == finest and found["steady"] == 0.5
    assert found["late"] == coarsest and found["unguilty"] >= 0.5
    assert found["back"] == found["patient"] == 0.5


def test_a_tissue_that_does_not_keep_up_is_told():
    ran = subprocess.run(["node", ROOT / "tests/web/pace.mjs", ROOT / "web/page/pace.js"], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout)
    assert found["keeps"] == found["starts"] == found["forgot"] == ""
    assert found["slow"].startswith("Too slow for real time: 0.50 s are simulated in a second") and "become about 160 ms old; beyond 100 ms it fades to zero" in found["slow"]
    assert "0.83 s" in found["little"] and "about 94 ms old" in found["little"]


def test_a_gallbladder_is_drawn_off_its_bed(seen):
    tets, holding, all_, rotation = seen["gallbladder"]
    assert tets == "11,198" and 0 < holding <= all_ and all_ > 10
    assert rotation == "{rotation: }"  # of it alone


def test_the_page_says_that_it_does_not_keep_up(seen):
    assert seen["slow"].startswith("Too slow for real time: 0.") and "slow motion" in seen["slow"]


def test_a_part_of_the_study_can_be_made(tmp_path):
    """`make web-study` for one scene, with coarse meshes and a short path: scenes that are not studied keep their figures."""
    subprocess.run(["make", "web-study", "WEB_STUDIES=block", f"WEB_STUDY_DIR={tmp_path}", f"WEB_STUDY_TO={tmp_path}/page.json", "WEB_STUDY_MORE=--finest 3000 --duration 1.2s"],
                   check=True, capture_output=True, timeout=400, cwd=ROOT)
    made, before = (json.loads(p.read_text())["scenes"] for p in (tmp_path / "page.json", ROOT / "web/page/study.json"))
    assert made["liver-press"] == before["liver-press"]
    assert set(made["block-press"]["change"]) == set(before["block-press"]["change"]) and made["block-press"]["samples"]["25 Hz"]


def test_it_fits_a_phone(seen):
    assert seen["overflow"] <= 0


def test_nothing_is_loaded_from_elsewhere():
    size = sum(p.stat().st_size for p in PAGE.rglob("*") if p.is_file())
    assert size < 5_000_000
    assert "http" not in "".join((PAGE / n).read_text() for n in ("index.html", "page.css", "tissue.worker.js", "law.worker.js", "haply.worker.js", "own_mesh.js", "pauses.js"))


@pytest.mark.skipif(not BROWSERS["chromium"], reason="chromium is not installed; tools/setup.sh web")
def test_a_frozen_thread_page_or_process_leaves_no_force(tmp_path):
    """A worker that owns the socket judges law and page; Chromium runs it in another process than the page."""
    with served() as url, haply(tmp_path / "haply.csv") as service:
        ran = subprocess.run(["node", ROOT / "tests/web/frozen.mjs", BUILD / "web/node_modules/puppeteer-core", BROWSERS["chromium"], url, service], capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr[-3000:]
    found, commands = json.loads(ran.stdout), []
    for line in (tmp_path / "haply.csv").read_text().splitlines():
        time_us, *force = line.split(",")[:4]
        commands.append((int(time_us), any(float(f) for f in force)))
    # Limits of web/page/haply.worker.js, and what a busy machine adds.
    for name, limit_ms in {"law": 12, "page": 12, "hidden": 0, "process": 12, "frozen": 12, "closed": 0}.items():
        case = found[name]
        assert any(force for time_us, force in commands if case["before"] - 3e6 < time_us < case["before"]), f"{name}: nothing was felt"
        late = [time_us for time_us, force in commands if force and case["after"] + 1e3 * limit_ms + 1e5 < time_us < case["end"]]
        assert not late, f"{name}: {(late[-1] - case['after']) / 1e3} ms"


@pytest.mark.skipif(not BROWSERS["chromium"], reason="chromium is not installed; tools/setup.sh web")
def test_memory_is_steady():
    """A minute; with TM_LONG=1 ten. Compares samples of the same scene."""
    seconds = 600 if LONG else 60
    with served() as url:
        ran = subprocess.run(["node", ROOT / "tests/web/memory.mjs", BUILD / "web/node_modules/puppeteer-core", BROWSERS["chromium"], url, str(seconds)],
                             capture_output=True, text=True, timeout=seconds + 200)
    assert ran.returncode == 0, ran.stderr[-2000:]
    samples = [s for s in json.loads(ran.stdout) if s["scene"] == "block-press"]
    quarter = max(2, len(samples) // 4)
    # WebAssembly's memory itself only grows, with the largest scene so far: `used` is what is allocated in it.
    for what, factor in {"page": 1.3, "painter": 1.3, "tissue": 1.3, "law": 1.3, "used": 1.01, "lawUsed": 1.01, "buffers": 1, "geometries": 1}.items():
        early, late = max(s[what] for s in samples[:quarter]), min(s[what] for s in samples[-quarter:])
        assert late <= factor * early, (what, [s[what] for s in samples])
