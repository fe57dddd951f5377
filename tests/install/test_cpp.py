"""tensormass.hpp: the page's example, compile errors of wrong use, and the same instructions as in C for a frame."""
import re
import subprocess

import pytest

CHECK = r"""
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include "tensormass_io.hpp"
static_assert(sizeof(tensormass::world_ref) == sizeof(void *) && std::is_trivially_copyable_v<tensormass::world_ref>);
static_assert(!std::is_copy_constructible_v<tensormass::world> && std::is_nothrow_move_constructible_v<tensormass::world>);
static_assert(!std::is_convertible_v<std::vector<char> &, tensormass::span<double>>);
static_assert(!std::is_convertible_v<const std::vector<double> &, tensormass::span<double>>); // not writable
int main(int, char **word) {
    {
        const tensormass::mesh_file file(word[1]);
        tensormass::mesh built = file.build(), mesh = std::move(built);
        assert(!built && mesh && mesh.tet().size() == 4 * std::size_t(file->tet_count));
        const tensormass::span<const std::int32_t> held = file.group(word[2]);
        assert(!held.empty() && file.group("nobody").empty());
        const std::size_t n = std::size_t(mesh->vertex_count);
        std::vector<double> x(3 * n);
        std::vector<std::int32_t> tet(mesh.tet().begin(), mesh.tet().end());
        for (std::size_t i = 0; i < 3 * n; i++) x[3 * (i / 3 * 611 % n) + i % 3] = mesh.rest_m()[i];
        for (std::int32_t &v : tet) v = std::int32_t(std::size_t(v) * 611 % n);
        const tensormass::mesh inside(x, tet, {}, TM_NUMBERING_IMPROVED);
        assert(mesh.original_vertex().empty() && file.build(TM_NUMBERING_IMPROVED).original_vertex().empty());
        assert(inside.original_vertex().size() == n);
        for (std::size_t v = 0; v < n; v++) assert(inside.rest_m()[3 * v] == x[3 * std::size_t(inside.original_vertex()[v])]);
        std::vector<std::int32_t> dof;
        for (std::int32_t v : held)
            for (int a = 0; a < 3; a++) dof.push_back(3 * v + a);
        tensormass::tissue tissue(mesh, tensormass::young(5e3, 0.45, 1060, 40));
        tensormass::world world(tissue);
        world.add_support(dof);
        world.add_gravity({0, 0, -9.81});
        std::vector<double> pressure_Pa(std::size_t(mesh->surface_count), 0.0);
        pressure_Pa[0] = 50;
        const double unpressed = (assert(world.step() == TM_OK), world.force_N()[3 * std::size_t(mesh->surface[0]) + 2]);
        world.add_pressure(pressure_Pa);
        assert(world.step() == TM_OK && world.force_N()[3 * std::size_t(mesh->surface[0]) + 2] != unpressed);
        try {
            world.add_pressure(tensormass::span<const double>(pressure_Pa.data(), 1));
            assert(!"too short an array");
        } catch (const std::invalid_argument &) {
        }
        int runs = 0;
        world.add_stage("counter", TM_PHASE_LOAD, [&runs](tensormass::world_ref w) noexcept { runs += w.force_N().size() > 0; });
        const std::vector<double> before = world.snapshot();
        assert(world.step(5) == TM_OK && runs == 5);
        const std::uint64_t after = world.hash();
        world.restore(before);
        assert(world.step(5) == TM_OK && world.hash() == after && runs == 10);
        try {
            world.add_stage("counter", TM_PHASE_LOAD, [big = std::vector<int>(1000)](tensormass::world_ref) noexcept {});
            assert(!"added twice");
        } catch (const tensormass::error &e) {
            assert(e.status() == TM_ERR_ARGUMENT && e.what()[0]);
        }
        world.remove_stage("counter");
        assert(world.step() == TM_OK && runs == 10);
        /* Back to before the touch: by then the world needs more bytes than the snapshot has, and it still fits. */
        const tm_tool_pose above{{0, 0, 1}, 0, 0, true, {}};
        tm_contact_def contact = tm_contact_def_default();
        tm_instrument_def tool{};
        tool.mode = TM_TOOL_PROBE, tool.radius_m = 0.004, tool.contact_length_m = 0.1, tool.pose = above;
        tool.trocar_m[2] = 2;
        contact.instrument_count = 1, contact.instrument = &tool;
        const tensormass::contact_ref touch = world.add_contact(contact);
        const std::vector<double> free_again = world.snapshot();
        const std::int64_t most = world.snapshot_bytes_max();
        const std::uint64_t free_hash = world.hash();
        double middle[3] = {0, 0, 0}, top = -1;
        for (std::size_t i = 0; i < 3 * n; i++) middle[i % 3] += mesh.rest_m()[i] / double(n);
        for (std::size_t v = 0; v < n; v++) top = std::max(top, mesh.rest_m()[3 * v + 2]);
        const tm_tool_pose down{{middle[0], middle[1], top - 0.004}, 0, 0, true, {}};
        for (int i = 0; i < 40 && touch.reaction(0).row_count == 0; i++) {
            touch.begin_frame(10, 10);
            touch.set_target(0, down, 10);
            assert(world.step(10) == TM_OK);
        }
        assert(touch.reaction(0).row_count > 0);
        assert(world.snapshot().size() > free_again.size() && std::int64_t(8 * world.snapshot().size()) <= most);
        world.restore(free_again);
        assert(world.hash() == free_hash && world.snapshot() == free_again);
        assert(!world.touch() && !world.ties());
        const tensormass::touching_ref touching = world.add_touch();
        tm_tie tie{};
        tie.stiffness_N_m = 10;
        assert(tm_tie_lead(mesh.get(), mesh->surface[0], mesh->surface, mesh->surface_count, &tie));
        const tensormass::ties_ref ties = world.add_ties(tensormass::span<const tm_tie>(&tie, 1));
        assert(world.step() == TM_OK && touching.rows().empty() && touching.report().rows == 0 && world.touch().get() == touching.get());
        assert(ties.count() == 1 && ties.is_whole(0) && ties.force_N(0) >= 0 && world.ties().get() == ties.get());
        const auto ends = ties.ends_m(0);
        const tm_tie added = ties.tie(0);
        for (int c = 0; c < 3; c++) {
            const auto at = [&](std::int32_t v) { return mesh.rest_m()[3 * std::size_t(v) + std::size_t(c)] + world.u_m()[3 * std::size_t(v) + std::size_t(c)]; };
            double to = 0;
            for (int j = 0; j < 3; j++) to += added.weight[j] * at(added.other[j]);
            assert(std::abs(ends[0][std::size_t(c)] - at(added.vertex)) < 1e-15 && std::abs(ends[1][std::size_t(c)] - to) < 1e-12);
        }
        std::array<std::int32_t, 4> gone{}, why{};
        assert(ties.fetch_cut(gone, why) == 0 && ties.fetch_cut(gone) == 0);
        try {
            ties.fetch_cut(gone, tensormass::span<std::int32_t>(why.data(), 2));
            assert(!"too short an array");
        } catch (const std::invalid_argument &) {
        }
        world.remove_stage("ties");
        world.remove_stage("touch");
        assert(!world.touch() && !world.ties());
        tensormass::world other = std::move(world);
        assert(!world && other.u_m().size() == mesh.rest_m().size());
        try {
            tensormass::world_ref(other).add_support(dof, {});
        } catch (const tensormass::error &) {
        }
        tm_model_def def = tm_model_def_default();
        const tm_material liver = tensormass::young(5e3, 0.45, 1060, 100);
        std::vector<double> zero(dof.size());
        def.tissue.mesh = mesh.get(), def.tissue.material_count = 1, def.tissue.material = &liver;
        def.support_count = int(dof.size()), def.support_dof = dof.data(), def.support_m = zero.data();
        tensormass::model model([&](auto... at) { return tm_model_dynamic(&def, at...); });
        assert(model.frame() == TM_OK && model.world() && model.u_m().size() == mesh.rest_m().size());
    }
    assert(tm_memory_in_use() == 0);
    try {
        const double flat[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
        const std::int32_t tet[4] = {0, 1, 2, 3};
        tensormass::mesh bad(flat, tet);
        return 1;
    } catch (const tensormass::error &e) {
        assert(e.status() == TM_ERR_MESH && e.entity() == 0);
    }
    try {
        tensormass::mesh_file nowhere("nowhere.msh");
        return 1;
    } catch (const std::runtime_error &e) {
        std::puts(e.what());
    }
    return tm_memory_in_use() != 0;
}
"""


def compiled(root, build, compiler, standard, source, program, io=True):
    libraries = [build / "lib" / name for name in (["libtensormass_io.a"] if io else []) + ["libtensormass.a"]]
    subprocess.run([compiler, f"-std={standard}", "-UNDEBUG", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror", f"-I{root}/libtensormass/include", f"-I{root}/libtensormass/io/include",
                    source, *libraries, "-lm", "-o", program], check=True, timeout=600)
    return program


@pytest.mark.parametrize("compiler, standard", [("g++", "c++17"), ("clang++", "c++20")])
def test_the_pages_example(root, build, tmp_path, compiler, standard):
    text = re.findall(r"^```cpp\n(.*?)^```", (root / "docs/library-guide.md").read_text(), re.M | re.S)[0]
    (tmp_path / "press.cpp").write_text(text)
    program = compiled(root, build, compiler, standard, tmp_path / "press.cpp", tmp_path / "press")
    run = subprocess.run([program, root / "meshes/liver_1k.msh"], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert float(re.match(r"([0-9.]+) mm down", run.stdout)[1]) > 0.1
    run = subprocess.run([program, "nowhere.msh"], capture_output=True, text=True, timeout=300)
    assert run.returncode == 1 and run.stderr == "nowhere.msh: cannot open: No such file or directory; check the path\n"


@pytest.mark.parametrize("compiler, standard", [("g++", "c++17"), ("clang++", "c++17")])
def test_owners_references_spans_and_errors(root, build, tmp_path, compiler, standard):
    (tmp_path / "check.cpp").write_text(CHECK)
    program = compiled(root, build, compiler, standard, tmp_path / "check.cpp", tmp_path / "check")
    run = subprocess.run([program, root / "meshes/cylinder_1k.msh", "end_0"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0 and run.stdout.startswith("nowhere.msh: cannot open: "), run.stderr


def instructions(root, folder, compiler, source):
    subprocess.run([*compiler, "-O2", f"-I{root}/libtensormass/include", "-c", root / "tests/install" / source, "-o", folder / "frame.o"], check=True, timeout=400)
    text = subprocess.run(["objdump", "-dr", "--no-show-raw-insn", "--disassemble=frame", folder / "frame.o"], capture_output=True, text=True, check=True).stdout
    lines = re.findall(r"^\s*[0-9a-f]+:\s*(.*?)\s*$", text, re.M)
    assert len(lines) > 20
    return lines


@pytest.mark.parametrize("c, cpp", [("gcc", "g++"), ("clang", "clang++")])
def test_a_frame_is_the_same_instructions_as_in_c(root, tmp_path, c, cpp):
    assert instructions(root, tmp_path, [c, "-std=c11"], "codegen.c") == instructions(root, tmp_path, [cpp, "-std=c++17"], "codegen.cpp")
