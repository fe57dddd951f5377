"""The tree matches the tables of walls.md: permitted includes, uses and links; no cycles of files."""
import os
import re
import shutil
import subprocess
import sys

import architecture
import pytest

@pytest.fixture(scope="module")
def page(root):
    page = architecture.Page((root / "tests/docs/walls.md").read_text())
    return page.follow(architecture.includes(root, architecture.sources(root, page)))


@pytest.fixture(scope="module")
def files(root, page):
    return architecture.sources(root, page)


@pytest.fixture(scope="module")
def arrows(build, files):
    return architecture.uses(architecture.symbols(build, files))


def test_tables_name_existing_folders(root, page, files):
    assert all((root / folder).is_dir() for folder in page.leans)
    assert not [f for f in files if page.folder_of(f) is None]
    assert set(page.gives) == {p.name for p in (root / "libtensormass/src").iterdir() if p.is_dir()}
    assert all((root / "libtensormass/src" / header).is_file() for headers in page.gives.values() for header in headers)
    code = [p for p in (root / "meshes").rglob("*") if p.suffix in (".c", ".h", ".cpp", ".py", ".mk")]
    assert not code, "meshes/ holds data"


def test_row_depends_on_rows_above_it(page):
    for names in (page.leans, page.room_leans):
        above = set()
        for name, leans in names.items():
            assert all(lean in above or os.path.splitext(lean)[1] == ".h" for lean in leans), name
            above.add(name)


def test_row_depends_on_at_most_five(page):
    assert not {name: leans for names in (page.leans, page.room_leans) for name, leans in names.items() if len(leans) > 5}


def test_includes(root, page, files):
    assert len(files) > 300
    assert not list(architecture.outside_includes(root, page, files))


def test_symbols(root, build, page, files, arrows):
    assert len(arrows) > 500
    assert not list(architecture.outside_uses(root, build, page, arrows))


def test_links(root, page):
    links = architecture.link_lines(root)
    assert {"haptic-rt", "tm-sim", "tm-device", "libtensormass.a"} <= {os.path.basename(t) for t in links}
    assert not list(architecture.outside_links(page, links))


def test_files_have_no_cyclic_dependencies(root, files, arrows):
    assert not architecture.circles(arrows)
    between = [(a, b) for a, _, b in architecture.includes(root, files) if a.endswith(".h")]
    assert len(between) > 100
    assert not architecture.circles(between)


def test_python_modules_have_no_cyclic_imports(root):
    arrows = architecture.python_imports(root / "python/tensormass")
    assert len(arrows) > 25 and ("world", "instruments") in arrows
    assert not architecture.circles(arrows)


def test_the_page_is_an_overview_with_its_picture(root, tmp_path):
    text = (root / "docs/architecture.md").read_text()
    assert len(text.split()) < 900
    assert re.search(r"^!\[[^\]]{40,}\]\(images/architecture\.svg\)$", "\n".join(text.splitlines()[:8]), re.M), "the picture and its words come first"
    subprocess.run([sys.executable, root / "tools/pictures/architecture.py", tmp_path / "drawn.svg"], check=True, timeout=60)
    assert (tmp_path / "drawn.svg").read_text() == (root / "docs/images/architecture.svg").read_text(), "draw it anew: python tools/pictures/architecture.py"
    for name in re.findall(r"`([a-z_]+(?:/[a-z_.]+)+)`", text):
        assert any((root / under / name).exists() for under in ("", "libtensormass/include")), name


# --- planted faults are found ---

@pytest.fixture
def copy(root, tmp_path, page):
    """Copies the sources and the build files."""
    for top in {folder.split("/")[0] for folder in page.leans} | {"tests", "tools"}:
        shutil.copytree(root / top, tmp_path / top, ignore=shutil.ignore_patterns("corpus", "reference", "__pycache__"))
    shutil.copy(root / "Makefile", tmp_path)
    return tmp_path


def plant(path, text, instead_of=None):
    source = path.read_text()
    assert instead_of is None or instead_of in source
    path.write_text(source.replace(instead_of, text, 1) if instead_of else text + source)


def test_a_planted_include_is_found(copy, page):
    plant(copy / "haptic_rt/io/status_log.c", '#include "scene/units.h"\n')
    plant(copy / "libtensormass/src/tissue/force.c", '#include "world/world_internal.h"\n')
    plant(copy / "libtensormass/src/world/step.c", '#include "tissue/cut_work.h"\n')
    found = list(architecture.outside_includes(copy, page, architecture.sources(copy, page)))
    assert [line.split(":")[0] for line in found] == ["haptic_rt/io/status_log.c", "libtensormass/src/tissue/force.c", "libtensormass/src/world/step.c"], found


def test_planted_cycle_of_python_modules_is_found(root, tmp_path):
    shutil.copytree(root / "python/tensormass", tmp_path / "package")
    plant(tmp_path / "package/state.py", "        from .patch import PatchBuilder\n        call(lib.tm_stage_energy, self)\n", "        call(lib.tm_stage_energy, self)\n")
    assert ["instruments", "patch", "state"] == [m for m in architecture.circles(architecture.python_imports(tmp_path / "package"))[0] if m in ("instruments", "patch", "state")]


def test_planted_use_and_cycle_are_found(root, build, files, page, tmp_path):
    shutil.copytree(build / "obj", tmp_path / "obj", ignore=lambda folder, names: [n for n in names if n.endswith(".d")] + (["tests"] if folder == str(build / "obj") else []))
    os.symlink(build / "lib", tmp_path / "lib")
    code = tmp_path / "planted.c"
    code.write_text("int app_parse_quantity(void); int app_is_quiet(void); int app_is_quiet(void) { return app_parse_quantity(); }\n")
    subprocess.run(["gcc", "-c", code, "-o", tmp_path / "obj/libtensormass/platform/progress.o"], check=True, timeout=300)
    code.write_text("int app_is_quiet(void); int app_parse_quantity(void); int app_parse_quantity(void) { return app_is_quiet(); }\n")
    subprocess.run(["gcc", "-c", code, "-o", tmp_path / "obj/libtensormass/scene/units.o"], check=True, timeout=300)
    planted = architecture.uses(architecture.symbols(tmp_path, files))
    assert "libtensormass/platform/progress.c uses app_parse_quantity of libtensormass/scene/units.c" in list(architecture.outside_uses(root, tmp_path, page, planted))
    assert ["libtensormass/platform/progress.c", "libtensormass/scene/units.c"] in architecture.circles(planted)


def test_a_planted_link_is_found(copy, page):
    plant(copy / "haptic_rt/module.mk", "settings.c) libtensormass/scene/units.c ", "settings.c) ")
    plant(copy / "libtensormass/module.mk", "libtensormass/src/*/*.c),,-lcjson)", "libtensormass/src/*/*.c))")
    found = list(architecture.outside_links(page, architecture.link_lines(copy)))
    assert found == ["build/bin/haptic-rt of haptic_rt/io links libtensormass/scene", "build/lib/libtensormass.so.0.2.0 of libtensormass/src links -lcjson"]
