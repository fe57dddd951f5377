"""What a newcomer adds is one file and one row, as CONTRIBUTING.md says: shown on a copy of the sources, which the real one never sees.

Extrapolator and bus driver: tests/loop/test_rows.py."""
import json
import re
import shutil

import pytest
from kit import said as run



def insert(path, row, new):
    """`new` after `row`, which must be there once."""
    text = path.read_text()
    assert text.count(row) == 1, f"{path} holds {text.count(row)} times, not once: {row}"
    path.write_text(text.replace(row, row + new))


def compile_into(root, build, copy, program, sources, *libraries, flags=("-Wall", "-Werror")):
    """As the Makefile does, `copy`'s headers before the real ones, so that a changed row is seen."""
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
/* Three slides, each along an axis of the trocar's frame. */
#ifndef HRT_ENGINE_SLIDES_H
#define HRT_ENGINE_SLIDES_H
#define HRT_ENGINE_JOINTS "x_m", "y_m", "z_m", "roll_rad", "grip"
#define HRT_ENGINE_FIELDS "x_m,y_m,z_m,roll_rad,grip"
#define HRT_ENGINE_COUNTS_PER_UNIT 40000.0f, 40000.0f, 40000.0f, 700.0f, 250.0f
#define HRT_ENGINE_JOINT_MIN -0.2f, -0.2f, -0.2f, -10.0f, 0.0f
#define HRT_ENGINE_JOINT_MAX 0.2f, 0.2f, 0.2f, 10.0f, 1.0f
#define HRT_ENGINE_SPEED_MAX 3.0f, 3.0f, 3.0f, 100.0f, 50.0f
#define HRT_ENGINE_TORQUE_MAX 8.9f, 8.9f, 8.9f
#define HRT_ENGINE_FORCE_MAX_N 8.9f
#define HRT_ENGINE_REACH_MIN -0.6, -0.6, -0.6, -1e3, -0.1
#define HRT_ENGINE_REACH_MAX 0.6, 0.6, 0.6, 1e3, 1.1
#define HRT_ENGINE_ROUNDING_M 1e-6
#endif
#ifdef HRT_REAL
void HRT_KINEMATICS(tip)(const HRT_AXES *frame, const HRT_REAL joint[HRT_JOINTS], HRT_REAL tip_m[3]) {
    turn(frame->r, 1, joint, tip_m);
}
void HRT_KINEMATICS(jacobian)(const HRT_AXES *frame, const HRT_REAL joint[HRT_JOINTS], HRT_REAL jacobian[9]) {
    (void)joint;
    for (int i = 0; i < 9; i++) jacobian[i] = frame->r[i];
}
bool HRT_KINEMATICS(inverse)(const HRT_AXES *frame, const HRT_REAL tip_m[3], HRT_REAL joint3[3]) {
    for (int i = 0; i < 3; i++)
        joint3[i] = frame->r[i] * tip_m[0] + frame->r[3 + i] * tip_m[1] + frame->r[6 + i] * tip_m[2];
    return true;
}
#endif
"""
DRIVES = r"""
#include "device/device.h"
#include "motion/kinematics.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

/* The tick turns a force at the tip into torques by the device's own Jacobian, and both precisions agree. */
int main(void) {
    hrt_params params;
    hrt_params_default(&params);
    const double axis[3] = {0.3, -0.2, -1}, up[3] = {0, 1, 0}, joint[HRT_JOINTS] = {0.05, -0.03, 0.11};
    const float axis_f[3] = {0.3f, -0.2f, -1}, up_f[3] = {0, 1, 0}, joint_f[HRT_JOINTS] = {0.05f, -0.03f, 0.11f};
    hrt_axes64 frame;
    hrt_axes frame_f;
    double tip[3], back[3];
    float tip_f[3];
    if (!hrt_axes_along64(&frame, axis, up) || !hrt_axes_along(&frame_f, axis_f, up_f)) return 1;
    hrt_tip64(&frame, joint, tip);
    hrt_tip(&frame_f, joint_f, tip_f);
    if (!hrt_inverse64(&frame, tip, back)) return 2;
    for (int i = 0; i < 3; i++)
        if (fabs(back[i] - joint[i]) > 1e-12 || fabs(tip[i] - (double)tip_f[i]) > HRT_ENGINE_ROUNDING_M) return 3;
    static const char *const name[] = {HRT_ENGINE_JOINTS};
    printf("%s %g %.6f\n", name[0], (double)params.torque_max[0],
           sqrt(tip[0] * tip[0] + tip[1] * tip[1] + tip[2] * tip[2]));
    return 0;
}
"""


def test_a_device_is_a_file_and_a_row(root, plain, tmp_path):
    copy = tmp_path / "haptic_rt"
    for folder in ("core", "device", "motion", "can"):
        shutil.copytree(root / "haptic_rt" / folder, copy / folder)
    (copy / "core/engine_slides.h").write_text(DEVICE)
    engine = copy / "core/engine.h"
    assert engine.read_text().count('"engine_impulse.h"') == 1
    engine.write_text(engine.read_text().replace('"engine_impulse.h"', '"engine_slides.h"'))
    (tmp_path / "main.c").write_text(DRIVES)
    compile_into(root, plain, tmp_path, tmp_path / "main", [tmp_path / "main.c", *sorted((copy / "core").glob("*.c")), copy / "motion/kinematics.c"], flags=[])
    name, torque, reach = run(tmp_path / "main").split()
    assert name == "x_m" and float(torque) == pytest.approx(8.9) and float(reach) == pytest.approx((0.05**2 + 0.03**2 + 0.11**2) ** 0.5, rel=1e-5)


def test_nobody_else_knows_the_device(root):
    """Its numbers and its geometry stand in its own file: nothing else includes that, or spells its joints in a string."""
    for folder in ("haptic_rt", "apps", "libtensormass/scene"):
        for path in sorted((root / folder).rglob("*.[ch]")):
            text = path.read_text()
            assert path.name in ("engine.h", "engine_impulse.h") or not re.search(r'"engine_impulse\.h"|"[^"\n]*pitch_rad,', text), path


def test_contributing_says_so(root):
    page = (root / "CONTRIBUTING.md").read_text()
    for file, row in (("libtensormass/io/mesh_NAME.c", "TM_IO_FORMATS"), ("libtensormass/scene/effect_NAME.c", "EFFECTS"), ("haptic_rt/core/engine_NAME.h", "HRT_ENGINE"),
                      ("haptic_rt/io/bus_KIND.c", "HRT_BUSES"), ("haptic_rt/core/extrapolate.c", "HRT_EXTRAPOLATORS"), ("apps/studies/stability/", "cases_")):
        assert f"`{file}" in page and f"`{row}" in page, (file, row)
        holders = [p for folder in ("apps", "haptic_rt", "libtensormass") for p in (root / folder).rglob("*.[ch]") if re.search(rf"\b{row}", p.read_text())]
        assert holders, row
