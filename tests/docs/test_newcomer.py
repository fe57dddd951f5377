"""Additions are one file and one row, as CONTRIBUTING.md states: tested on a copy of the sources.

Extrapolator and bus driver: tests/loop/test_rows.py."""
import json
import re
import shutil

import pytest
from kit import said as run



def insert(path, row, new):
    """Inserts `new` after `row`, which must occur once."""
    text = path.read_text()
    assert text.count(row) == 1, f"{path} holds {text.count(row)} times, not once: {row}"
    path.write_text(text.replace(row, row + new))


def compile_into(root, build, copy, program, sources, *libraries, flags=("-Wall", "-Werror")):
    """Compiles like the Makefile, with `copy`'s headers before the real ones, so that a changed row is seen."""
    names = re.search(r"^INCLUDES := (.*)$", (root / "Makefile").read_text(), re.M).group(1).replace("$(OUT)", str(build)).replace("-I", "").split()
    includes = [f"-I{folder / name}" for folder in (copy, root) for name in [*names, "haptic_rt/io", "libtensormass/scene", "apps/sim", "apps/studies/stability"]]
    run("cc", "-std=c11", "-D_GNU_SOURCE", "-O0", *flags, *includes, "-o", program, *sources, "-Wl,--start-group", *(build / "lib" / name for name in libraries), "-Wl,--end-group",
        "-lyaml", "-lcjson", "-ldl", "-lm", "-lpthread", "-rdynamic")


@pytest.fixture
def plain(build):
    """Libraries that a plain compiler can link."""
    if build.name in ("asan", "tsan"):
        pytest.skip("the objects are a sanitizer's")
    return build


# --- a mesh format ---

FORMAT = r"""
#include "mesh_format.h"

static tm_status read_mine(tm_io_text *text, tm_io_raw *raw) {
    int vertices, tets, used;
    if (sscanf(text->at, "MINE %d %d%n", &vertices, &tets, &used) != 2)
        return tm_fail(text->error, TM_ERR_FILE, -1, "counts are missing; write them");
    text->at += used;
    for (int v = 0; v < vertices; v++) {
        double p[3];
        if (sscanf(text->at, "%lf %lf %lf%n", &p[0], &p[1], &p[2], &used) != 3)
            return tm_fail(text->error, TM_ERR_FILE, -1, "vertices are missing; write them");
        text->at += used;
        tm_status status = tm_io_add_vertex(raw, v, p, text->error);
        if (status) return status;
    }
    tm_status status = tm_io_vertices_end(raw, text->error);
    for (int t = 0; t < tets && !status; t++) {
        long v[4];
        if (sscanf(text->at, "%ld %ld %ld %ld%n", &v[0], &v[1], &v[2], &v[3], &used) != 4)
            return tm_fail(text->error, TM_ERR_FILE, -1, "tetrahedra are missing; write them");
        text->at += used;
        status = tm_io_add_element(raw, t, 3, 1, (int64_t[4]){v[0], v[1], v[2], v[3]}, 4, text->error);
    }
    return status;
}

static void write_mine(const tm_mesh_file *m, FILE *file) {
    fprintf(file, "MINE %d %d\n", m->vertex_count, m->tet_count);
    for (int v = 0; v < m->vertex_count; v++)
        fprintf(file, "%.17g %.17g %.17g\n", m->vertex_m[3 * v], m->vertex_m[3 * v + 1], m->vertex_m[3 * v + 2]);
    for (int t = 0; t < m->tet_count; t++)
        fprintf(file, "%d %d %d %d\n", m->tet[4 * t], m->tet[4 * t + 1], m->tet[4 * t + 2], m->tet[4 * t + 3]);
}

const tm_io_format tm_io_format_mine = {".mine", "MINE", read_mine, write_mine};
"""


def test_a_mesh_format_is_a_file_and_a_row(root, plain, tmp_path):
    io = tmp_path / "libtensormass/io"
    shutil.copytree(root / "libtensormass/io", io)
    (io / "mesh_mine.c").write_text(FORMAT)
    insert(io / "mesh_format.h", "#define TM_IO_FORMATS(ROW) ROW(msh)", " ROW(mine)")
    program = tmp_path / "tm-mesh"
    sources = [*sorted(io.glob("*.c")), *sorted((root / "apps/mesh").glob("*.c"))]
    compile_into(root, plain, tmp_path, program, sources, "libtensormass_scene.a", "libapp.a", "libplatform.a", "libtensormass.a")
    run(program, "convert", root / "meshes/liver_1k.msh", "-o", tmp_path / "liver.mine")
    run(program, "convert", tmp_path / "liver.mine", "-o", tmp_path / "back.vtk")
    run(program, "convert", root / "meshes/liver_1k.msh", "-o", tmp_path / "direct.vtk")
    geometry = ["POINTS" + p.read_text().split("POINTS")[1].split("CELL_DATA")[0] for p in (tmp_path / "back.vtk", tmp_path / "direct.vtk")]
    assert geometry[0] == geometry[1] and "POINTS 303" in geometry[0]
    (tmp_path / "short.mine").write_text("MINE 4 1\n0 0 0")
    assert "short.mine: vertices are missing; write them" in run(program, "check", tmp_path / "short.mine", code=2)
    assert ".msh .mine .vtk .mesh" in run(program, "check", root / "README.md", code=2)


# --- an effect ---

EFFECT = r"""
#include "sim.h"

typedef struct options {
    app_section here;
    app_number pull;
} options;

static const app_field fields[] = {
    {"sideways", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "a weight to the side"},
    {"sideways.pull", APP_NUMBER, "acceleration", "!", -100, 100, offsetof(options, pull), 0, "along x"},
};

static void run(void *self, tm_world *world) {
    const tm_state *state = tm_world_state(world);
    const tm_tissue *tissue = tm_world_tissue(world);
    const double *mass = tm_tissue_mass_kg(tissue);
    for (int32_t v = 0; v < tm_tissue_mesh(tissue)->vertex_count; v++) state->force_N[3 * v] += mass[v] * ((const app_number *)self)->si;
}

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    return o->pull.si < 0 ? app_scene_bad(scene, o->pull.line, "it pulls to the other side; write a positive one") : 0;
}

static tm_status build(sim *s, const void *own) {
    tm_stage stage = {.size = sizeof stage, .name = "sideways", .phase = TM_PHASE_LOAD, .run = run, .self = (void *)&((const options *)own)->pull};
    return tm_world_add_stage(s->model->world, &stage, 0, NULL);
}

const sim_effect sim_effect_sideways = {
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)}, .name = "sideways", .doc = "A weight to the side.", .check = check, .build = build};
"""


def test_an_effect_is_a_file_and_a_row(root, plain, tmp_path):
    sim = tmp_path / "libtensormass/scene"
    sim.mkdir(parents=True)
    (sim / "effect_sideways.c").write_text(EFFECT)
    shutil.copy(root / "libtensormass/scene/effects.c", sim)
    insert(sim / "effects.c", "    ROW(gravity)", " ROW(sideways)")
    library = tmp_path / "libtensormass_scene.a"
    shutil.copy(plain / "lib/libtensormass_scene.a", library)
    run("ar", "d", library, "effects.o")
    program = tmp_path / "tm-sim"
    compile_into(root, plain, tmp_path, program, [sim / "effects.c", sim / "effect_sideways.c", root / "apps/sim/main.c"], "libsim.a", "libapp.a", library, "libhrt_device.a", "libhrt_motion.a", "libhrt_io.a", "libplatform.a", "libtensormass_io.a",
                 "libhrt.a", "libtensormass.a", "liblcm_types.a")
    assert "| `sideways.pull` |" in run(program, "--schema", "markdown")
    (tmp_path / "lib").symlink_to(plain / "lib")
    scene = root / "apps/scenes/block-gravity.yaml"
    assert "key 'pull' is missing" in run(program, scene, "--explain", "--set", "sideways={}", code=2)
    assert "did you mean 'sideways'?" in run(program, scene, "--explain", "--set", "sidewise={pull: 1}", code=2)
    assert "it pulls to the other side; write a positive one" in run(program, scene, "--explain", "--set", "sideways={pull: -1}", code=2)
    assert re.search(r"^ *sideways .*--set", run(program, scene, "--explain", "--set", "sideways={pull: 1}"), re.M)


# --- a hard case ---

def test_a_hard_case_is_a_row(root, plain, tmp_path):
    cases = (root / "apps/studies/stability/cases_tissue.c").read_text()
    row = '    {TISSUE, "poisson-0.3", "nu = 0.3", STABLE, 1e-9, "energy drift", poisson, 0.3},\n'
    assert cases.count(row) == 1
    changed = tmp_path / "cases_tissue.c"
    changed.write_text(cases.replace(row, row.replace("0.3", "0.37")))
    objects = sorted(p for p in (plain / "obj/apps/studies/stability").glob("*.o") if p.stem != "cases_tissue")
    assert len(objects) >= 6
    program = tmp_path / "tm-stability"
    compile_into(root, plain, tmp_path, program, [changed, *objects], "libapp.a", "libhrt_device.a", "libhrt_motion.a", "libhrt_io.a", "libplatform.a", "libtensormass_io.a", "libhrt.a", "libtensormass.a")
    run(program, "--quick", "--case", "poisson-0.37", "--json", tmp_path / "v.json")
    (case,) = json.loads((tmp_path / "v.json").read_text())["cases"]
    assert case["name"] == "poisson-0.37" and case["verdict"] == "stays stable"


# --- a device ---

DEVICE = r"""
/* A polar arm: a turn about the frame's z, a reach, a lift. */
static void arm_tip(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL tip_m[3]) {
    HRT_REAL s, c;
    HRT_SINE_COSINE(joint[0], &s, &c);
    const HRT_REAL p[3] = {joint[1] * c, joint[1] * s, joint[2]};
    turn(axes->r, 1, p, tip_m);
}
static void arm_jacobian(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL jacobian[9]) {
    HRT_REAL s, c;
    HRT_SINE_COSINE(joint[0], &s, &c);
    const HRT_REAL column[3][3] = {{-joint[1] * s, joint[1] * c, 0}, {c, s, 0}, {0, 0, 1}};
    for (int j = 0; j < 3; j++) {
        HRT_REAL world[3];
        turn(axes->r, 1, column[j], world);
        for (int i = 0; i < 3; i++) jacobian[3 * i + j] = world[i];
    }
}
static bool arm_inverse(const HRT_AXES *axes, const HRT_REAL tip_m[3], HRT_REAL joint3[3]) {
    HRT_REAL p[3];
    turn_back(axes->r, tip_m, p);
    joint3[0] = HRT_ATAN2(p[1], p[0]);
    joint3[1] = HRT_SQRT(p[0] * p[0] + p[1] * p[1]);
    joint3[2] = p[2];
    return true;
}
#ifdef HRT_DESCRIBE
static const hrt_device_type arm_type = {
    NAMED("arm", "a polar arm", "torque_turn_Nm", "force_reach_N", "force_lift_N")
    .joints = 4, .motors = 3,
    .joint = {JOINT("turn_rad", 8000.0f, -1.0f, 1.0f, 20.0f, -3.0f, 3.0f), JOINT("reach_m", 40000.0f, 0.02f, 0.3f, 3.0f, 0.01f, 0.6f),
              JOINT("lift_m", 40000.0f, -0.1f, 0.2f, 3.0f, -0.6f, 0.6f), JOINT("roll_rad", 700.0f, -10.0f, 10.0f, 100.0f, -1.0e3f, 1.0e3f)},
    .torque_max = {1.4f, 3.2f, 3.2f}, .force_max_N = 3.2f,
    .rounding_m = 1.0e-6f, .insertion = -1, .roll = 3, .grip = -1, GEOMETRY(arm)
};
#endif
#ifdef HRT_TWIN
static HRT_REAL arm_lever(const HRT_REAL joint[HRT_JOINTS], int j) { return j ? 1.0 : fmax(joint[1], 0.02); }
static const hrt_twin arm_twin = {
    .inertia = {0.0045, 0.2, 0.2}, .viscous = {0.01, 0.5, 0.5}, .coulomb = {0.008, 0.06, 0.06}, .hand_stiffness = {7.0, 300.0, 300.0},
    .hand_damping = {0.25, 11.0, 11.0}, .rest = {0.0, 0.1, 0.0}, .lever = arm_lever, GEOMETRY(arm)
};
#endif
"""


def test_a_device_is_a_file_and_a_row(root, plain, tmp_path):
    """A third device in a copy with no other change: its description and geometry pass the other devices' tests, and the tick keeps every guarantee
    on it for random input."""
    for folder in ("haptic_rt", "contact_law", "tests", "libtensormass/numeric"):
        shutil.copytree(root / folder, tmp_path / folder)
    (tmp_path / "haptic_rt/core/device_arm.h").write_text(DEVICE)
    table = tmp_path / "haptic_rt/core/device_types.h"
    text = table.read_text()
    assert text.count('#include "device_desk.h"\n') == 1 and text.count("ROW(desk)") == 1
    table.write_text(text.replace('#include "device_desk.h"\n', '#include "device_desk.h"\n#include "device_arm.h"\n').replace("ROW(desk)", "ROW(desk) ROW(arm)"))
    core = [*sorted((tmp_path / "haptic_rt/core").glob("*.c")), *sorted((tmp_path / "haptic_rt/can").glob("*.c")), tmp_path / "haptic_rt/motion/kinematics.c"]
    objects = []
    for source in core:
        objects.append(tmp_path / f"{source.parent.name}_{source.stem}.o")
        run("gcc", "-std=gnu11", "-O2", "-w", "-D_GNU_SOURCE", f"-I{tmp_path}", f"-I{tmp_path / 'haptic_rt'}", f"-I{tmp_path / 'haptic_rt/core'}", f"-I{root / 'libtensormass/include'}",
            "-c", source, "-o", objects[-1])
    for test in ("test_kinematics", "test_random"):
        run("gcc", "-std=gnu11", "-O2", "-w", "-D_GNU_SOURCE", f"-I{tmp_path}", f"-I{tmp_path / 'haptic_rt'}", f"-I{tmp_path / 'haptic_rt/core'}", f"-I{root / 'libtensormass/include'}",
            tmp_path / f"tests/loop/{test}.c", *objects, "-lcmocka", "-lm", "-o", tmp_path / test)
        said = run(tmp_path / test, env={"TM_DEVICE": "arm"})  # of test_random, which runs the others elsewhere
        assert "arm," in said and ("desk," in said and "impulse_engine," in said or test == "test_random")


def test_no_other_file_names_the_device(root):
    """A device's numbers and geometry are in its own file: nothing else includes that file or names its joints in a string."""
    for folder in ("haptic_rt", "apps", "libtensormass/scene"):
        for path in sorted((root / folder).rglob("*.[ch]")):
            text = path.read_text()
            assert path.name in ("device_types.h", "device_impulse_engine.h") or not re.search(r'"device_impulse_engine\.h"|"[^"\n]*pitch_rad', text), path


def test_contributing_describes_each_addition(root):
    page = (root / "CONTRIBUTING.md").read_text()
    for file, row in (("libtensormass/io/mesh_NAME.c", "TM_IO_FORMATS"), ("libtensormass/scene/effect_NAME.c", "EFFECTS"), ("haptic_rt/core/device_NAME.h", "HRT_DEVICE_TYPES"),
                      ("haptic_rt/io/bus_KIND.c", "HRT_BUSES"), ("haptic_rt/core/extrapolate.c", "HRT_EXTRAPOLATORS"), ("apps/studies/stability/", "cases_")):
        assert f"`{file}" in page and f"`{row}" in page, (file, row)
        holders = [p for folder in ("apps", "haptic_rt", "libtensormass") for p in (root / folder).rglob("*.[ch]") if re.search(rf"\b{row}", p.read_text())]
        assert holders, row
