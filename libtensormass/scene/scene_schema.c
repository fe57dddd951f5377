/* Fields of a scene, except those of effects (effect_*.c). The parser, errors, defaults and docs/scene-reference.md use
 * this table. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "choices.h"
#include "law_keys.h"
#include "scene.h"
#include "tensormass.h"

APP_CHOICE_CHECK(APP_PRECISIONS)
APP_CHOICE_CHECK(APP_FORCE_FORMS)
APP_CHOICE_CHECK(APP_TOOL_MODES)

#define LAWS NULL /* choices that follow from the library's table of laws */
#define AT(member) offsetof(app_scene, member), 0
#define MATERIAL(member) offsetof(app_material, member), 0
#define MAT(key, member, unit, fallback, min, max, doc)                                                                \
    { "tissue.materials.*." key, APP_NUMBER, unit, fallback, min, max, MATERIAL(member), doc }
#define POSE(prefix, base)                                                                                                                                                                  \
    {prefix "pitch",                                                                                                                                                                        \
     APP_NUMBER,                                                                                                                                                                            \
     "angle",                                                                                                                                                                               \
     "0 rad",                                                                                                                                                                               \
     -1.6,                                                                                                                                                                                  \
     1.6,                                                                                                                                                                                   \
     (base) + offsetof(app_pose, pitch),                                                                                                                                                    \
     0,                                                                                                                                                                                     \
     "rotation of the shaft from `axis` towards `up`"},                                                                                                                                     \
        {prefix "yaw",                                                                                                                                                                      \
         APP_NUMBER,                                                                                                                                                                        \
         "angle",                                                                                                                                                                           \
         "0 rad",                                                                                                                                                                           \
         -1.6,                                                                                                                                                                              \
         1.6,                                                                                                                                                                               \
         (base) + offsetof(app_pose, yaw),                                                                                                                                                  \
         0,                                                                                                                                                                                 \
         "rotation of the shaft about `up`"},                                                                                                                                               \
        {prefix "insertion",                                                                                                                                                                \
         APP_NUMBER,                                                                                                                                                                        \
         "length",                                                                                                                                                                          \
         "0.05 m",                                                                                                                                                                          \
         0.0,                                                                                                                                                                               \
         0.5,                                                                                                                                                                               \
         (base) + offsetof(app_pose, insertion),                                                                                                                                            \
         0,                                                                                                                                                                                 \
         "distance from trocar or origin to tip"},                                                                                                                                          \
        {prefix "above",                                                                                                                                                                    \
         APP_NUMBER,                                                                                                                                                                        \
         "length",                                                                                                                                                                          \
         NULL,                                                                                                                                                                              \
         -0.5,                                                                                                                                                                              \
         0.5,                                                                                                                                                                               \
         (base) + offsetof(app_pose, above),                                                                                                                                                \
         0,                                                                                                                                                                                 \
         "instead of `insertion`: distance of the tip, along its shaft, from first touching the undeformed tissue; negative: pressed in. With `tip`, which then gives only the direction"}, \
        {prefix "roll",                                                                                                                                                                     \
         APP_NUMBER,                                                                                                                                                                        \
         "angle",                                                                                                                                                                           \
         "0 rad",                                                                                                                                                                           \
         -100,                                                                                                                                                                              \
         100,                                                                                                                                                                               \
         (base) + offsetof(app_pose, roll),                                                                                                                                                 \
         0,                                                                                                                                                                                 \
         "rotation about the shaft"},                                                                                                                                                       \
        {prefix "grip", APP_NUMBER, "none", "0", 0, 1, (base) + offsetof(app_pose, grip), 0, "0 open, 1 closed"}, {                                                                         \
        prefix "tip", APP_VECTOR, "length", NULL, 0, 0, (base) + offsetof(app_pose, tip), 0,                                                                                                \
            "position of the tip, instead of pitch, yaw and insertion"                                                                                                                      \
    }

static const app_field fields[] = {
    {"title", APP_TEXT, NULL, NULL, 0, 0, AT(title), "title of the scene, one line"},
    {"model", APP_CHOICE, "dynamic|precomputed|hybrid", "dynamic", 0, 0, AT(model),
     "`dynamic`: tensor/mass; `precomputed`: quasi-static, no cutting; `hybrid`: dynamic in the part that `hybrid:` names, the rest condensed"},
    {"threads", APP_INTEGER, NULL, "1", 1, TM_MAX_THREADS, AT(threads),
     "threads of a step, at most as many as cores; small tissue uses fewer. Results are the same bits for any number; dynamic and hybrid models"},

    {"tissue", APP_SECTION, NULL, "!", 0, 0, AT(tissue), "the mesh and its materials"},
    {"tissue.mesh", APP_PATH, NULL, NULL, 0, 0, AT(mesh),
     "mesh file (.msh, .vtk, .mesh), relative to the scene; required, unless the scene has `bodies`"},
    {"tissue.scale", APP_NUMBER, "none", "1", 1e-9, 1e9, AT(scale), "metres per unit of the mesh file"},
    {"tissue.renumber", APP_FLAG, NULL, "yes", 0, 0, AT(renumber),
     "renumber vertices internally if that makes steps faster; files keep the mesh file's numbers"},
    {"tissue.precision", APP_CHOICE, APP_CHOICE_WORDS(APP_PRECISIONS), "double", 0, 0, AT(precision),
     "precision of the stored stiffness tensors and of the correction of `rotation`, or of the stresses of a nonlinear law; positions are always double. `single` needs supports that hold every connected piece"},
    {"tissue.force", APP_CHOICE, APP_CHOICE_WORDS(APP_FORCE_FORMS), "best", 0, 0, AT(force),
     "form of the force loop. `best`: the fastest of this processor; `plain`: the C reference, with the same bits on all machines"},
    {"tissue.materials", APP_TABLE, NULL, "!", 0, 0, offsetof(app_scene, material), sizeof(app_material),
     "one entry a region (3D physical group) of the mesh; `\"*\"`: every region not named. With `bodies`: `BODY.REGION`, or `\"BODY.*\"` for the rest of that body. Each has exactly one family of constants"},
    MAT("young", young, "pressure", NULL, 0, 1e15, "isotropic: Young's modulus, with `poisson`"),
    MAT("poisson", poisson, "none", NULL, -1, 0.5, "isotropic: Poisson's ratio, below 0.5"),
    MAT("lambda", lambda, "pressure", NULL, -1e15, 1e15, "isotropic: first Lame coefficient, with `mu`"),
    MAT("mu", mu, "pressure", NULL, 0, 1e15, "isotropic: shear modulus"),
    MAT("lambda_T", lambda_T, "pressure", NULL, -1e15, 1e15,
        "fibred: across the fibre, with `mu_T lambda_L mu_L` (the paper's four)"),
    MAT("mu_T", mu_T, "pressure", NULL, 0, 1e15, "fibred: shear modulus across the fibre"),
    MAT("lambda_L", lambda_L, "pressure", NULL, -1e15, 1e15, "fibred: along the fibre"),
    MAT("mu_L", mu_L, "pressure", NULL, 0, 1e15, "fibred: axial shear modulus"),
    MAT("beta", beta, "pressure", NULL, -1e15, 1e15,
        "fibred: the fifth constant; without it the paper's law, beta = -(dlambda + 2 dmu)"),
    MAT("E_L", E_L, "pressure", NULL, 0, 1e15,
        "fibred, engineering: Young's modulus along the fibre, with `E_T nu_LT nu_TT G_L`"),
    MAT("E_T", E_T, "pressure", NULL, 0, 1e15, "fibred, engineering: Young's modulus across"),
    MAT("nu_LT", nu_LT, "none", NULL, -10, 10, "fibred, engineering: contraction across under tension along the fibre"),
    MAT("nu_TT", nu_TT, "none", NULL, -1, 1, "fibred, engineering: Poisson's ratio in the cross plane"),
    MAT("G_L", G_L, "pressure", NULL, 0, 1e15, "fibred, engineering: axial shear modulus"),
    {"tissue.materials.*.law", APP_CHOICE, LAWS, "linear", 0, 0, MATERIAL(law),
     "law of large strains; at small strains every law follows the constants above. All but `linear` include large rotations. A linear material beside a nonlinear one must not rotate or bend far ([nonlinear laws](nonlinear-laws.md))"},
    MAT("stretch", stretch, "none", NULL, TM_STRETCH_LEAST, TM_STRETCH_MOST,
        "largest uniaxial stretch at which a nonlinear law holds, 1.6 if left out (`holzapfel`: 1.8); beyond it force grows linearly. A larger limit makes steps shorter"),
    MAT("density", density, "density", "1000 kg/m3", 1e-9, 1e9, "mass per rest volume"),
    MAT("damping", damping, "rate", NULL, 0, 1e9,
        "this region's damping rate d (force -d m v on each mass); needs the effect `damping`, whose `rate` it replaces"),

    {"bodies", APP_TABLE, NULL, NULL, 0, 0, offsetof(app_scene, body), sizeof(app_body),
     "several meshes in place of `tissue.mesh`, each under a name of its own ([bodies](bodies.md)). Regions and groups are then called `BODY.NAME`, and `BODY` alone is the group of all its vertices"},
    {"bodies.*.mesh", APP_PATH, NULL, "!", 0, 0, offsetof(app_body, mesh), 0,
     "mesh file (.msh, .vtk, .mesh), relative to the scene"},
    {"bodies.*.part", APP_TEXT, NULL, NULL, 0, 0, offsetof(app_body, part), 0,
     "of a mesh file with several separate parts: a region or group; only the parts with a vertex of it belong to the body. Left out: all"},
    {"bodies.*.scale", APP_NUMBER, "none", "1", 1e-9, 1e9, offsetof(app_body, scale), 0,
     "metres per unit of the mesh file"},
    {"bodies.*.move", APP_VECTOR, "length", "[0, 0, 0]", 0, 0, offsetof(app_body, move), 0,
     "displaces the mesh's rest position"},
    {"bodies.*.turn", APP_VECTOR, "angle", "[0, 0, 0]", 0, 0, offsetof(app_body, turn), 0,
     "rotation vector that turns the mesh about the origin of its file, before `move`"},
    {"bodies.*.rigid", APP_FLAG, NULL, "no", 0, 0, offsetof(app_body, rigid), 0,
     "the body does not deform (bone, table, stand): it is fixed or on its `path`, needs no material and is not cut"},
    {"bodies.*.path", APP_LIST, NULL, NULL, 0, 0, offsetof(app_body, path), sizeof(app_body_waypoint),
     "of a rigid body: waypoints in the order of time, between which it moves smoothly (minimum jerk); at time 0 it is at its place"},
    {"bodies.*.path[].time", APP_NUMBER, "time", "!", 0, 1e6, offsetof(app_body_waypoint, time), 0,
     "when it is reached"},
    {"bodies.*.path[].move", APP_VECTOR, "length", "!", 0, 0, offsetof(app_body_waypoint, move), 0,
     "how far the body is then from its place at the start"},

    {"bodies.*.effects", APP_EFFECTS, NULL, NULL, 0, 0, offsetof(app_body, effects), 0,
     "effects of this body alone, each with its keys as at the top level: `rotation`, `strain_smoothing`, `viscosity`"},

    {"supports", APP_LIST, NULL, NULL, 0, 0, offsetof(app_scene, support), sizeof(app_support),
     "vertices with prescribed displacement. Each item: one selector (`group box plane vertex`) and the keys below"},
    {"supports[].name", APP_TEXT, NULL, NULL, 0, 0, offsetof(app_support, name), 0, "name in reports"},
    APP_SELECT_FIELDS("supports[].", offsetof(app_support, select)),
    {"supports[].axes", APP_TEXT, NULL, "xyz", 0, 0, offsetof(app_support, axes), 0, "prescribed components"},
    {"supports[].displace", APP_VECTOR, "length", "[0, 0, 0]", 0, 0, offsetof(app_support, displace), 0,
     "the prescribed displacement; zero fixes them"},

    {"loads", APP_LIST, NULL, NULL, 0, 0, offsetof(app_scene, load), sizeof(app_load),
     "constant forces. Each item: one selector and `force`, `total`, `traction` or `pressure`"},
    {"loads[].name", APP_TEXT, NULL, NULL, 0, 0, offsetof(app_load, name), 0, "name in reports"},
    APP_SELECT_FIELDS("loads[].", offsetof(app_load, select)),
    {"loads[].force", APP_VECTOR, "force", NULL, 0, 0, offsetof(app_load, force), 0, "force on each selected vertex"},
    {"loads[].total", APP_VECTOR, "force", NULL, 0, 0, offsetof(app_load, total), 0,
     "force on all of them, as a `traction` if they have complete surface triangles, else in equal parts"},
    {"loads[].traction", APP_VECTOR, "pressure", NULL, 0, 0, offsetof(app_load, traction), 0,
     "force per undeformed area, on the surface triangles whose three vertices are selected"},
    {"loads[].pressure", APP_NUMBER, "pressure", NULL, -1e9, 1e9, offsetof(app_load, pressure), 0,
     "pressure on these triangles, along the inward normals of the deformed surface and over its area; `model: dynamic` only. Its stiffness bounds the step, and a longer step is refused"},

    {"instruments", APP_LIST, NULL, NULL, 0, 0, offsetof(app_scene, instrument), sizeof(app_instrument),
     "one or two, numbered 0 and 1"},
    {"instruments[].mode", APP_CHOICE, APP_CHOICE_WORDS(APP_TOOL_MODES), "probe", 0, 0, offsetof(app_instrument, mode),
     0, "action on tissue; a grasper needs `grasp`, a cautery `cut`"},
    {"instruments[].device", APP_TEXT, NULL, "impulse_engine", 0, 0, offsetof(app_instrument, device), 0,
     "haptic device; `haptic-rt --list` lists them"},
    {"instruments[].profile", APP_PATH, NULL, NULL, 0, 0, offsetof(app_instrument, profile), 0,
     "device profile of this instrument, in lockstep with `haptics`; left out: `haptics.profile`"},
    {"instruments[].mount", APP_CHOICE, "trocar|free", "trocar", 0, 0, offsetof(app_instrument, mount), 0,
     "`free`: no trocar; the shaft has the direction of the handle, or `axis` if the device reports none"},
    {"instruments[].trocar", APP_VECTOR, "length", NULL, 0, 0, offsetof(app_instrument, trocar), 0,
     "pivot of the instrument, in world axes; required with `mount: trocar`"},
    {"instruments[].origin", APP_VECTOR, "length", NULL, 0, 0, offsetof(app_instrument, origin), 0,
     "point where the device's positions are zero; required with `mount: free`"},
    {"instruments[].axis", APP_VECTOR, "none", "[0, 0, -1]", 0, 0, offsetof(app_instrument, axis), 0,
     "direction of the shaft at zero pitch and yaw, any length"},
    {"instruments[].up", APP_VECTOR, "none", "[0, 1, 0]", 0, 0, offsetof(app_instrument, up), 0,
     "axis of yaw; it is made perpendicular to `axis`"},
    {"instruments[].radius", APP_NUMBER, "length", "2.5 mm", 1e-4, 0.05, offsetof(app_instrument, radius), 0,
     "radius of shaft and tip"},
    {"instruments[].contact_length", APP_NUMBER, "length", "0.1 m", 0, 1, offsetof(app_instrument, contact_length), 0,
     "length of shaft behind the tip that can touch"},
    {"instruments[].friction", APP_SECTION, NULL, NULL, 0, 0, offsetof(app_instrument, friction), 0,
     "friction coefficients of this instrument; needs the effect `friction`, whose values apply to keys left out"},
    {"instruments[].friction.static", APP_NUMBER, "none", NULL, 0, 2, offsetof(app_instrument, friction_static), 0,
     "coefficient until it slips; 0: it slides freely"},
    {"instruments[].friction.kinetic", APP_NUMBER, "none", NULL, 0, 2, offsetof(app_instrument, friction_kinetic), 0,
     "coefficient while it slides, at most `static`"},
    {"instruments[].start", APP_SECTION, NULL, NULL, 0, 0, offsetof(app_instrument, start_here), 0,
     "pose at the start"},
    POSE("instruments[].start.", offsetof(app_instrument, start)),

    {"time", APP_SECTION, NULL, NULL, 0, 0, AT(time), "frames and steps"},
    {"time.frame_rate", APP_NUMBER, "rate", "25 Hz", 0.5, 2000, AT(frame_rate),
     "frames a second: force samples, pictures"},
    {"time.duration", APP_NUMBER, "time", "10 s", 0, 1e6, AT(duration),
     "simulated time, in lockstep; --duration replaces it"},
    {"time.step", APP_NUMBER, "time", NULL, 1e-12, 1, AT(step),
     "substep; left out: the guaranteed critical step times `step_fraction`. A step above the guaranteed one is refused"},
    {"time.step_fraction", APP_NUMBER, "none", "0.9", 0.01, 1, AT(step_fraction),
     "fraction of the guaranteed critical step, if `step` is left out"},
    {"time.adaptive", APP_FLAG, NULL, "no", 0, 0, AT(adaptive),
     "nonlinear laws: a substep as long as strains up to 0.1 allow, divided by powers of two while a tetrahedron is "
     "strained more. Left out, one substep holds in every state. `step` is then the long one"},
    {"time.mass_scaling", APP_FLAG, NULL, "no", 0, 0, AT(mass_scaling),
     "add mass where `step` would otherwise not be guaranteed, also during cuts; weight and equilibrium "
     "do not change. Dynamic models only; --explain shows how much and its effect"},
    {"time.mass_scaling_max", APP_NUMBER, "none", "0.2", 0, 100, AT(mass_scaling_max),
     "largest share of the physical mass that `mass_scaling` may add; more is refused"},
    {"time.average", APP_NUMBER, "none", "0.25", 0, 1, AT(average),
     "share of a frame's last substeps over which forces are averaged; 0: only the last"},

    {"hand", APP_LIST, NULL, NULL, 0, 0, offsetof(app_scene, hand), sizeof(app_hand),
     "motion of the virtual device's hand, one item an instrument"},
    {"hand[].instrument", APP_INTEGER, NULL, "0", 0, 1, offsetof(app_hand, instrument), 0, "number of the instrument"},
    {"hand[].between", APP_CHOICE, "smooth|straight", "smooth", 0, 0, offsetof(app_hand, between), 0,
     "interpolation between waypoints: minimum jerk, or constant speed"},
    {"hand[].repeat", APP_FLAG, NULL, "no", 0, 0, offsetof(app_hand, repeat), 0, "start again after the last waypoint"},
    {"hand[].tremor", APP_SECTION, NULL, NULL, 0, 0, offsetof(app_hand, tremor), 0,
     "amplitude of added tremor, the same in every run"},
    {"hand[].tremor.amplitude", APP_NUMBER, "length", "40 um", 0, 0.01, offsetof(app_hand, tremor_amplitude), 0,
     "of the tip"},
    {"hand[].tremor.frequency", APP_NUMBER, "rate", "9 Hz", 0.1, 100, offsetof(app_hand, tremor_frequency), 0,
     "mean frequency of the tremor"},
    {"hand[].path", APP_LIST, NULL, "!", 0, 0, offsetof(app_hand, path), sizeof(app_waypoint),
     "waypoints, ordered by time"},
    {"hand[].path[].time", APP_NUMBER, "time", "!", 0, 1e6, offsetof(app_waypoint, time), 0,
     "time at which it is reached"},
    POSE("hand[].path[].", offsetof(app_waypoint, pose)),
    {"hand[].path[].active", APP_FLAG, NULL, "no", 0, 0, offsetof(app_waypoint, active), 0,
     "cautery pedal, from this waypoint on"},
};

/* --- constants of laws, from the library's table; laws share the keys of the same name --- */

enum { OWN = sizeof fields / sizeof *fields, MOST = APP_LAWS * TM_LAW_CONSTANTS };
typedef struct law_text {
    char path[60], doc[220];
} law_text;
static app_field all_fields[OWN + MOST];
static law_text text[MOST];
static char law_names[24 * APP_LAWS];
static app_schema scene_schema = {.field = all_fields, .size = sizeof(app_scene)};

/* Writes "`law`, `law`: text", with the names of all laws that have the constant. */
static void write_doc(const tm_law_constant *c, law_text *t) {
    size_t used = 0;
    for (int32_t law = 0; tm_law_name((tm_law_kind)law); law++)
        if (app_law_has_constant((tm_law_kind)law, c->name))
            used += (size_t)snprintf(t->doc + used, sizeof t->doc - used, "%s`%s`", used ? ", " : "",
                                     tm_law_name((tm_law_kind)law));
    snprintf(t->doc + used, sizeof t->doc - used, ": %s", c->doc);
}

static app_field field_of(int32_t law, int32_t i, const tm_law_constant *c, law_text *t) {
    snprintf(t->path, sizeof t->path, "tissue.materials.*.%s", c->name);
    write_doc(c, t);
    return (app_field){t->path,
                       APP_NUMBER,
                       c->unit,
                       c->fallback,
                       c->min,
                       c->max,
                       offsetof(app_material, constant) + sizeof(app_number) * (size_t)(law * TM_LAW_CONSTANTS + i),
                       0,
                       t->doc};
}

static void append_laws(void) {
    int32_t n = 0;
    for (int32_t law = 0; law < APP_LAWS && tm_law_name((tm_law_kind)law); law++) {
        const tm_law_constant *c;
        const size_t used = strlen(law_names);
        snprintf(law_names + used, sizeof law_names - used, "%s%s", law ? "|" : "", tm_law_name((tm_law_kind)law));
        for (int32_t i = 0; (c = tm_law_constant_at((tm_law_kind)law, i)); i++) {
            tm_law_kind first = (tm_law_kind)law;
            app_shared_constant(&first, &(int32_t){i});
            if (first == (tm_law_kind)law) all_fields[scene_schema.count++] = field_of(law, i, c, text + n++);
        }
    }
}

/* Copies the fields above; the laws' constants follow the key 'law'. */
static void make_schema(void) {
    for (int i = 0; i < OWN; i++) {
        app_field *to = all_fields + scene_schema.count++;
        *to = fields[i];
        if (to->kind != APP_CHOICE || to->unit) continue;
        append_laws();
        to->unit = law_names;
    }
}

const app_schema *app_scene_schema(void) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, make_schema);
    return &scene_schema;
}
