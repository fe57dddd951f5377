/* Scenes: YAML, read through one table of fields. The table also gives the defaults, the errors and
 * docs/scene-reference.md.
 *
 * Each value carries its line: 0 for a default, negative for a value from --set. */
#ifndef TM_SCENE_H
#define TM_SCENE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "host.h"
#include "tensormass/material.h"

typedef struct app_section {
    int line;
} app_section;
typedef struct app_number {
    double si;
    int line;
} app_number;
typedef struct app_integer {
    int64_t value;
    int line;
} app_integer;
typedef struct app_vector {
    double v[3];
    int line;
} app_vector;
typedef struct app_text {
    const char *s;
    int line;
} app_text; /* never null: "" */
typedef struct app_choice {
    int index;
    int line;
} app_choice; /* index into the field's a|b|c */
typedef struct app_flag {
    bool on;
    int line;
} app_flag;
/* Options of effects of one body: as app_scene.effect; null: it names none. */
typedef struct app_body_effects {
    void **options;
    int line;
} app_body_effects;
typedef struct app_integers {
    int64_t *item;
    int count;
    int line;
} app_integers;
typedef struct app_list {
    void *item;
    int count;
    int line;
} app_list; /* items of the field's item struct */

typedef enum app_kind {
    APP_SECTION, /* mapping */
    APP_NUMBER,  /* quantity in `unit`; "rate|auto": or that word, read as 0 */
    APP_INTEGER,
    APP_VECTOR, /* three quantities in `unit` */
    APP_TEXT,
    APP_PATH,     /* text, relative to the scene's folder; made absolute, or relative to the working directory */
    APP_CHOICE,   /* one of `unit`, "a|b|c" */
    APP_FLAG,     /* yes or no */
    APP_INTEGERS, /* an integer or a list of integers */
    APP_LIST,     /* sequence of mappings, fields "path[].…"; items of `size` bytes, first member app_section */
    APP_EFFECTS,  /* mapping of effects to their sections, as at the top level */
    APP_TABLE     /* mapping of names to mappings, fields "path.*.…"; first member of an item: app_text, the name */
} app_kind;

typedef struct app_field {
    const char *path;
    app_kind kind;
    const char *unit;     /* dimension, or choices */
    const char *fallback; /* text, parsed as a scene's own; null: unset; "!": required */
    double min, max;      /* SI, inclusive; min == max: unlimited */
    size_t offset;        /* in the enclosing struct: root or list item */
    size_t size;          /* size of a list item */
    const char *doc;
} app_field;

/* A table of fields and the size of its struct: one for the scene, one per effect. */
typedef struct app_schema {
    const app_field *field;
    int count;
    size_t size; /* size of the root struct */
} app_schema;

/* --- vertex selectors --- */

typedef struct app_select {
    app_text group;
    app_section box;
    app_vector box_min, box_max;
    app_section plane;
    app_vector plane_point, plane_normal;
    app_number plane_within;
    app_integers vertex;
} app_select;

/* Repeats the selector's fields in another table: APP_SELECT_FIELDS("supports[].", offsetof(app_support, select)). */
#define APP_SELECT_FIELDS(prefix, at)                                                                                  \
    {prefix "group",                                                                                                   \
     APP_TEXT,                                                                                                         \
     NULL,                                                                                                             \
     NULL,                                                                                                             \
     0,                                                                                                                \
     0,                                                                                                                \
     (at) + offsetof(app_select, group),                                                                               \
     0,                                                                                                                \
     "vertices of this physical group of the mesh"},                                                                   \
        {prefix "box",                                                                                                 \
         APP_SECTION,                                                                                                  \
         NULL,                                                                                                         \
         NULL,                                                                                                         \
         0,                                                                                                            \
         0,                                                                                                            \
         (at) + offsetof(app_select, box),                                                                             \
         0,                                                                                                            \
         "vertices within an axis-aligned box"},                                                                       \
        {prefix "box.min", APP_VECTOR, "length", "!", 0, 0, (at) + offsetof(app_select, box_min), 0, "lower corner"},  \
        {prefix "box.max", APP_VECTOR, "length", "!", 0, 0, (at) + offsetof(app_select, box_max), 0, "upper corner"},  \
        {prefix "plane", APP_SECTION, NULL, NULL, 0, 0, (at) + offsetof(app_select, plane), 0, "vertices on a plane"}, \
        {prefix "plane.point",  APP_VECTOR, "length", "!", 0, 0, (at) + offsetof(app_select, plane_point), 0,          \
         "a point of the plane"},                                                                                      \
        {prefix "plane.normal",                                                                                        \
         APP_VECTOR,                                                                                                   \
         "none",                                                                                                       \
         "!",                                                                                                          \
         0,                                                                                                            \
         0,                                                                                                            \
         (at) + offsetof(app_select, plane_normal),                                                                    \
         0,                                                                                                            \
         "normal of the plane, any length"},                                                                           \
        {prefix "plane.within",                                                                                        \
         APP_NUMBER,                                                                                                   \
         "length",                                                                                                     \
         "1 um",                                                                                                       \
         0,                                                                                                            \
         1,                                                                                                            \
         (at) + offsetof(app_select, plane_within),                                                                    \
         0,                                                                                                            \
         "largest distance of a vertex from the plane"},                                                               \
    {                                                                                                                  \
        prefix "vertex", APP_INTEGERS, NULL, NULL, 0, 2147483647, (at) + offsetof(app_select, vertex), 0,              \
            "vertices by number, counted from 0 in file order; one or a list"                                          \
    }

/* --- the scene --- */

typedef enum app_model { APP_DYNAMIC = 0, APP_PRECOMPUTED = 1, APP_HYBRID = 2 } app_model;

/* Room for the library's laws, tm_law_name(0), tm_law_name(1) ...: what is linked has as many as it names. */
enum { APP_LAWS = 13 };

typedef struct app_material {
    app_text region; /* "*": each region that is not named */
    app_number young, poisson;
    app_number lambda, mu;
    app_number lambda_T, mu_T, lambda_L, mu_L, beta;
    app_number E_L, E_T, nu_LT, nu_TT, G_L;
    app_choice law;                                  /* tm_law_kind */
    app_number constant[APP_LAWS][TM_LAW_CONSTANTS]; /* of each law, read by app_material_constant (law_keys.h) */
    app_number stretch;
    app_number density, damping;
} app_material;

typedef struct app_body {
    app_text name;
    app_text mesh;
    app_text part; /* group; line 0: the complete mesh */
    app_number scale;
    app_vector move, turn;
    app_flag rigid;
    app_list path; /* app_body_waypoint */
    app_body_effects effects;
} app_body;

typedef struct app_body_waypoint {
    app_section here;
    app_number time;
    app_vector move;
} app_body_waypoint;

typedef struct app_support {
    app_section here;
    app_text name;
    app_select select;
    app_text axes; /* a subset of xyz */
    app_vector displace;
} app_support;

typedef struct app_load {
    app_section here;
    app_text name;
    app_select select;
    app_vector force, total, traction;
    app_number pressure;
} app_load;

/* Either joint values or a tip position. The surface may set the insertion of a tip position. Either may give the other
 * joints. */
typedef struct app_pose {
    app_number pitch, yaw, insertion, above, roll, grip;
    app_vector tip;
} app_pose;

typedef enum app_mount { APP_IN_TROCAR, APP_FREE } app_mount;

typedef struct app_instrument {
    app_section here;
    app_choice mode; /* tm_tool_mode */
    app_text device; /* name from hrt_device_types */
    app_text profile;
    app_choice mount; /* app_mount */
    app_vector trocar, origin, axis, up;
    app_number radius, contact_length;
    app_section friction; /* this instrument's options of the effect with this name; null default: the effect's value */
    app_number friction_static, friction_kinetic;
    app_section start_here;
    app_pose start;
} app_instrument;

/* Returns the point that the device's joints are relative to. */
static inline const app_vector *app_instrument_origin(const app_instrument *t) {
    return t->mount.index == APP_FREE ? &t->origin : &t->trocar;
}

typedef struct app_waypoint {
    app_section here;
    app_number time;
    app_pose pose;
    app_flag active;
} app_waypoint;

typedef struct app_hand {
    app_section here;
    app_integer instrument;
    app_choice between; /* 0 smooth (minimum jerk), 1 straight */
    app_flag repeat;
    app_section tremor;
    app_number tremor_amplitude, tremor_frequency;
    app_list path; /* app_waypoint */
} app_hand;

/* How a scene names an effect: by its key or by a model. */
typedef struct app_effect_key {
    const char *name;
    int model; /* app_model that implies the effect; 0: named by its section */
} app_effect_key;

typedef struct app_scene {
    app_host host;
    const char *file;
    app_text title;
    app_choice model;
    app_integer threads;
    app_section tissue;
    app_text mesh;
    app_number scale;
    app_choice precision; /* 0 double, 1 single: tm_precision */
    app_flag renumber;    /* renumber vertices internally if the file's bandwidth is large */
    app_choice force;     /* 0 best, 1 plain: tm_force_form */
    app_list material;    /* app_material */
    app_list body;        /* app_body; empty: the tissue is the mesh `mesh` */
    app_list support;     /* app_support */
    app_list load;        /* app_load */
    app_list instrument;  /* app_instrument */
    app_list hand;        /* app_hand */
    app_section time;
    app_number frame_rate, duration, step, step_fraction, average, mass_scaling_max;
    app_flag mass_scaling, adaptive;

    int effect_count;
    void *
        *effect; /* the options of each schema passed to app_scene_load; first member app_section, line 0: not named */
    uint32_t of_bodies; /* a bit for each effect that bodies name, not the top level (sim_merge_body_effects) */
    const app_effect_key *effect_key; /* [effect_count] of the caller; null: schemas have no names */

    bool strict; /* treat warnings as errors */
    int pace;    /* sim_scene_pace: who requests forces; set between loading and building */

    /* private */
    void *arena;
    void *no_memory; /* jmp_buf while the file is read: target of app_scene_alloc when memory is exhausted */
    char **set;
    int set_count;
} app_scene;

/* Returns the line that names the mesh: tissue.mesh, or the bodies. */
static inline int app_mesh_line(const app_scene *scene) {
    return scene->body.count ? scene->body.line : scene->mesh.line;
}

/* Reads `file` with the changes in `set`: "path=value" replaces a value, "path" removes a key. */
tm_status app_scene_load(const char *file, char *const *set, int set_count, const app_schema *effect, int effect_count,
                         const app_host *host, app_scene **scene);
void app_scene_free(app_scene *scene);
/* Adds the fault "scene.yaml: out of memory; close other programs". Returns TM_ERR_MEMORY. */
tm_status app_scene_no_memory(const app_host *host, const char *file);
/* Allocates zeroed memory that the scene owns; returns null if memory is exhausted. */
void *app_scene_alloc(app_scene *scene, size_t bytes);

/* Writes `text` as a YAML scalar with exactly these characters, for --set. Returns false if `size` is too small; `out`
 * is then undefined. */
bool app_scene_quote(const char *text, char *out, size_t size);

/* Adds a fault at this line. Returns `status`, which is not TM_OK. */
tm_status app_scene_fail(const app_scene *scene, int line, tm_status status, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* Adds a fault about a value, at its line. Returns TM_ERR_ARGUMENT. */
tm_status app_scene_bad(const app_scene *scene, int line, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* Adds "scene.yaml:12: warning: what; what to do". Returns 0, or TM_ERR_ARGUMENT if the scene is strict. */
tm_status app_scene_warn(const app_scene *scene, int line, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* Writes "scene.yaml:12", or "--set path=value". */
void app_scene_where(const app_scene *scene, int line, char *text, size_t size);

/* Returns the table of a scene. */
const app_schema *app_scene_schema(void);

#endif
