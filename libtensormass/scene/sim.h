/* A scene made to run: tissue, world, stages, instruments, stepped a frame at a time. */
#ifndef TM_SIM_H
#define TM_SIM_H

#include "motion/hand.h"
#include "motion/kinematics.h"
#include "scene_parts.h"
#include "tensormass.h"

enum { SIM_JOINTS = HRT_JOINTS };

/* Samples of an instrument that touched or held tissue (releasing is neither) while its controller asked for more than
 * the force, and those of them that carried it. */
typedef struct sim_coverage {
    int64_t touched, carried;
} sim_coverage;

typedef struct sim sim;

/* A pair of effects that cannot be in one scene, and the way out ("...; what to do"). */
typedef struct sim_exclusion {
    const char *other, *why;
} sim_exclusion;

/* What an effect adds to the tissue itself when it is built, for the account of tm-sim --explain. */
typedef enum sim_part { SIM_PART_NONE, SIM_PART_FIBRES, SIM_PART_CUTTING, SIM_PART_SMOOTHING, SIM_PART_COUNT } sim_part;

/* One effect: one effect_NAME.c, one row in effects.c. `options` is the struct that its schema fills; its first member
 * is an app_section whose line is 0 when the scene does not name the effect: then none of these functions is called.
 * All return 0 or a status, having complained. */
/* What a study of a scene tries with an effect. */
typedef enum sim_trial {
    SIM_TRIAL_DROP,        /* runs without it, where the scene names it */
    SIM_TRIAL_DROP_OR_ADD, /* and with its defaults, where the scene does not */
    SIM_TRIAL_KEEP,        /* neither */
    SIM_TRIAL_LEAVE_OUT,   /* every run goes without it: it moves nothing */
} sim_trial;

typedef struct sim_effect {
    const char *name, *doc;
    const char
        *example; /* its value in a scene, as of --set; in the reference, and for tests of every effect; or null */
    sim_trial trial;
    app_schema schema;
    int model; /* app_model that stands for naming the effect; its own section then only holds options */
    sim_part part;
    const char *needs[4];
    sim_exclusion excludes[4];
    const char *of_linear_law; /* why it goes with no other law; null: it goes with all */
    tm_status (*check)(const app_scene *scene, const void *options); /* needs no mesh */
    tm_status (*prepare)(sim *s, const void *options); /* mesh is there: fills s->def, or s->damping_1_s and s->fibre */
    tm_status (*build)(sim *s, const void *options); /* s->model is there: adds stages to its world, where it has one */
    void (*frame)(sim *s);                           /* after each frame's substeps */
    void (*destroy)(sim *s);                         /* what it left in `s`, also after a build that failed half-way */
} sim_effect;

enum { SIM_MAX_EFFECTS = 24 };
extern const sim_effect *const sim_effects[];
extern const int sim_effect_count;

/* Where each effect's cost is booked. */
typedef struct sim_cost {
    int64_t bytes; /* of the library's account (tm_memory_in_use), beside its stages */
} sim_cost;

enum { SIM_OWNER_ALL = -1, SIM_OWNER_SUPPORTS = -2, SIM_OWNER_LOADS = -3 };
/* Whose stage a name is: an effect's index, or one of the above. */
typedef struct sim_owner {
    const char *stage;
    int effect;
} sim_owner;

/* What the model is made from: effects fill it in `prepare`, and s->model stays when it is made. */
typedef struct sim_definition {
    tm_model_def model; /* points to the rest */
    tm_contact_def contact;
    tm_grasp_def grasp;
    tm_friction_def friction;
    tm_cut_def cut;
    const char *invalid_member; /* tm_model_def.invalid_member */
} sim_definition;

/* What the last frame's cutting took. */
typedef struct sim_cuts {
    int32_t count, capacity, *tet;
    int8_t *instrument; /* who, -1: a detached fragment */
    int64_t total;
} sim_cuts;

struct sim_picture;

/* What goes to a controller beside the force. */
typedef enum sim_sends { SIM_SENDS_FORCE, SIM_SENDS_STIFFNESS, SIM_SENDS_PATCH } sim_sends;

/* How near an instrument has come that has not touched yet. */
typedef struct sim_reach {
    bool touched, noted;
    double gap_m, at_s;
} sim_reach;

struct sim {
    app_scene *scene;
    tm_mesh_file file;     /* in its own numbering, as all that is read and written */
    tm_mesh *mesh;         /* in its own, as all else here: tm_mesh_original_vertex leads back */
    tm_material *material; /* [region_count] */
    double damping_1_s;    /* of materials that name none */
    double *fibre;         /* [3*tet_count] or null */
    sim_definition def;
    tm_model *model;
    tm_instrument_def instrument_def[TM_MAX_INSTRUMENTS];
    hrt_axes64 axes[TM_MAX_INSTRUMENTS]; /* how the device hangs in the world */
    double start_joint[TM_MAX_INSTRUMENTS][SIM_JOINTS];
    hrt_hand_script hand[TM_MAX_INSTRUMENTS]; /* the scene's; no keys: it has none and stays at the start */
    int instrument_count;

    double frame_s, dt_s;
    double sample_s;           /* from one base sample to the next (sim.h); frame_s where a frame has one */
    int32_t samples;           /* base samples of a frame, 1 without a controller */
    int32_t substeps, average; /* of a whole frame; of a sample's end */
    int32_t slice;             /* substeps of about a tenth of a second; 0: not measured yet */
    bool broken_off;           /* Ctrl-C came inside the last frame or sample */
    /* Asked before each piece of a frame; returns how many substeps there may be until it is asked again, 1 or more.
     * May cut. Null: nobody asks. */
    int32_t (*between)(void *user, sim *s);
    void *between_user;
    int64_t frames;
    sim_cuts cuts;
    struct sim_picture *picture;           /* effect rendering, else null */
    tm_tool_pose pose[TM_MAX_INSTRUMENTS]; /* at the end of the last frame */
    tm_tool_reaction reaction[TM_MAX_INSTRUMENTS];

    sim_cost cost[SIM_MAX_EFFECTS];
    sim_owner owner[TM_MAX_STAGES];
    int owner_count;
    uint8_t *support_of; /* [vertex_count] 1 + index of the scene's support, 0 free; null: no supports */
    int32_t fixed_count; /* prescribed components, ascending: the components of the stage `support` */
    int32_t *fixed_dof;  /* [fixed_count] */
    double *fixed_m;     /* [fixed_count] */
    uint8_t *fixed_by;   /* [fixed_count] 1 + index of the scene's support */
    double *load_N;      /* [3*vertex_count] or null */
    sim_sends can_send;  /* what the scene took memory for */
    sim_sends wants[TM_MAX_INSTRUMENTS];  /* what the controller's extrapolator asks for, at most can_send */
    tm_patch *patch;                      /* [instrument_count] with SIM_SENDS_PATCH, else null */
    bool patch_valid[TM_MAX_INSTRUMENTS]; /* by the last frame */
    sim_coverage coverage[TM_MAX_INSTRUMENTS];
    sim_reach reach[TM_MAX_INSTRUMENTS];
    tm_deformation worst; /* of the frames looked at: sim_shape_note */
    double worst_s;
    int32_t limited_tets; /* most that were beyond a limit of their nonlinear law in a frame looked at */
    double limited_s;
    bool shape_noted;
    double velocity_m_s[TM_MAX_INSTRUMENTS][3]; /* of the tips over the last sample */
    double last_s;                              /* length of the last sample */
    double patches_s;                           /* spent on patches and stiffness by the last sample */
};

/* Reads the scene with the fields of every effect; 0 or a status, having complained. */
tm_status sim_scene_load(const char *file, char *const *set, int set_count, const app_host *host, app_scene **scene);
/* Checks and builds. Takes the scene over, also on failure. */
tm_status sim_create(app_scene *scene, sim **out);
/* The same without a model: s->def is whole, and s->model null. */
tm_status sim_prepare(app_scene *scene, sim **out);
void sim_destroy(sim *s);

/* --- what a scene and its simulation are asked (queries.c) --- */

bool sim_has(const sim *s, const char *effect);
/* For an effect's options: null when the scene does not name it. */
const void *sim_options(const app_scene *scene, const char *effect);
/* The line of a material that has a nonlinear law, 0: none has. */
int sim_law_line(const app_scene *scene);
/* A fault by a library's error, on the line that is to blame. */
tm_status sim_report(const app_scene *scene, int line, const tm_error *error);
/* The same for what is wrong inside a file that the scene names on `line`. */
tm_status sim_report_file(const app_scene *scene, int line, const char *file, int file_line, const tm_error *error);
/* An effect's index by its name, -1: there is none. */
int sim_effect_find(const app_scene *scene, const char *name);
/* Returns whether every study leaves out the effect of this name (SIM_TRIAL_LEAVE_OUT). */
bool sim_effect_left_out(const char *name);
/* The line that asked for an effect, 0: not named. */
int sim_effect_line(const app_scene *scene, int index);

/* --- building and stepping --- */

/* app_select_vertices for the mesh's vertices: mark[vertex_count]. */
tm_status sim_select(const sim *s, const app_select *select, int line, uint8_t *mark, int32_t *count);
/* vertex[vertex_count] := the mesh's number of each vertex of the file. */
void sim_vertices_of_file(const sim *s, int32_t *vertex);

/* Pieces of building, shared by the models. */
tm_status sim_build_supports(sim *s);
tm_status sim_build_loads(sim *s);
tm_status sim_build_instruments(sim *s);

/* One frame: every instrument goes to to[i] over `substeps` (s->substeps for a whole frame). */
tm_status sim_frame(sim *s, const tm_tool_pose *to, int32_t substeps);
/* The same in pieces: force samples of `substeps` each, with reactions and what goes with them after each, and then the
 * end of the frame: what effects do once a frame. */
tm_status sim_sample(sim *s, const tm_tool_pose *to, int32_t substeps);
void sim_frame_end(sim *s);

/* What an extrapolator (hrt_extrapolator) needs. */
sim_sends sim_sends_of(int extrapolator);

/* Joints to a pose in the world. */
tm_tool_pose sim_pose(const sim *s, int instrument, const double joint[SIM_JOINTS], bool active);
/* Instruments whose devices have other joints than the first one's have rows of another kind in its tables. */
bool sim_same_devices(const sim *s);
/* Where instrument i stands with its shaft pushed in by insertion_m, turned as at the start. */
tm_tool_pose sim_start_pose_at(const sim *s, int instrument, double insertion_m, bool active);

/* Where the scene's hand wants the instrument at a time. */
tm_tool_pose sim_hand_pose(const sim *s, int instrument, double time_s);
/* The surface, displacements [3*vertex_count] and simulated time, whatever the model. */
tm_surface_view sim_surface(const sim *s);
const double *sim_displacement(const sim *s);
double sim_time_s(const sim *s);
/* Living tetrahedra of the whole organ. */
int32_t sim_alive(const sim *s);
uint64_t sim_hash(const sim *s);

/* --- how many force samples a frame has, and what may go with one --- */

/* Who asks for forces; app_scene.pace. */
typedef enum sim_scene_pace {
    SIM_FRAMES = 0, /* the caller, once a frame */
    SIM_LOCKSTEP,   /* controllers on a virtual clock */
    SIM_REALTIME    /* controllers on the wall clock */
} sim_scene_pace;

/* Base samples of a frame that a scene asks for. */
int32_t sim_stream_per_frame(const app_scene *scene);

/* What may go with a force sample at a rate: a patch or stiffness costs more than a newer force where samples come so
 * often, unless the scene names `haptics.sends`. */
sim_sends sim_stream_sends(const sim *s, double rate_Hz);
/* The same where the scene does not name it. */
sim_sends sim_stream_sends_by_rate(double rate_Hz);

#endif
