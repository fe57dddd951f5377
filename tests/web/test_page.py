"""The page in headless Chromium: frames, figures, keys, choices, errors, a hidden tab, a phone. `make web` builds it."""
import functools
import http.server
import json
import shutil
import subprocess
import threading

import pytest
from paths import BUILD, ROOT

PAGE = BUILD / "web/page"
BROWSER = shutil.which("chromium")

pytestmark = pytest.mark.skipif(not (PAGE / "main.js").is_file() or not BROWSER or not shutil.which("node"),
                                reason="the page is not built, or Chromium is not installed; make web, apt-get install chromium")


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *arguments):
            pass

    folder = tmp_path_factory.mktemp("page")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(PAGE)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        ran = subprocess.run(["node", ROOT / "tests/web/drive.mjs", BUILD / "web/node_modules/playwright-core", BROWSER,
                              f"http://127.0.0.1:{server.server_address[1]}/", folder], capture_output=True, text=True, timeout=400)
    finally:
        server.shutdown()
    assert ran.returncode == 0, ran.stderr[-2000:]
    return json.loads(ran.stdout)


def test_the_page_draws_and_measures(seen):
    assert seen["frames"] > 20 and seen["stages"] >= 3
    assert float(seen["figures"]["factor"]) > 0
    assert seen["controller"] in ("idle", "engaged")


def test_keys_move_the_instrument(seen):
    assert 0.010 < seen["moved_m"] < 0.020  # ten presses of 1.5 mm


def test_a_choice_shows_its_price(seen):
    before, after = (float(x.strip().split()[0]) for x in seen["price"].split("→"))
    assert before > 0 and after > 0


def test_a_bad_mesh_has_the_librarys_sentence_and_nothing_is_lost(seen):
    assert "bad.msh" in seen["error"] and ";" in seen["error"]
    assert seen["ran"]["frames"] == 25  # the page continues with other scenes


def test_a_hidden_tab_has_no_force(seen):
    state, force_N = seen["hidden"]
    assert state != "engaged" and force_N == 0


def test_the_press_is_that_of_the_library_under_node(seen):
    ran = subprocess.run(["node", ROOT / "tests/web/scene_hash.mjs", BUILD / "web/npm", "simd", "apps/scenes/block-press.yaml", "1", "haptics.compliance=iterations", "rendering"],
                         capture_output=True, text=True, timeout=300, cwd=ROOT, check=True)
    under_node = json.loads(ran.stdout)
    assert seen["ran"]["hash"] == under_node["hash"] and seen["ran"]["force"] == under_node["force"]


def test_it_fits_a_phone(seen):
    assert seen["overflow"] <= 0


def test_nothing_is_loaded_from_elsewhere():
    size = sum(p.stat().st_size for p in PAGE.rglob("*") if p.is_file())
    assert size < 5_000_000
    assert "http" not in "".join((PAGE / n).read_text() for n in ("index.html", "page.css", "tissue.worker.js", "law.worker.js"))
