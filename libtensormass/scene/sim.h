/* A running scene: tissue, world, stages and instruments, stepped frame by frame. */
#ifndef TM_SIM_H
#define TM_SIM_H

#include "motion/hand.h"
#include "motion/kinematics.h"
#include "scene_parts.h"
#include "tensormass.h"

enum { SIM_JOINTS = HRT_JOINTS };

/* Samples of an instrument in contact or grasping (not releasing) while its controller requested more than the force;
 * and how many carried it. */
typedef struct sim_coverage {
    int64_t touched, carried;
    double age_max; /* tm_patch.age */
} sim_coverage;

typedef struct sim sim;

/* An effect that cannot share a scene with this one, and the remedy ("...; what to do"). */
typedef struct sim_exclusion {
    const char *other, *why;
} sim_exclusion;

/* Share of the tissue's memory that an effect causes, for tm-sim --explain. */
typedef enum sim_part { SIM_PART_NONE, SIM_PART_FIBRES, SIM_PART_CUTTING, SIM_PART_SMOOTHING, SIM_PART_COUNT } sim_part;

/* One effect: one effect_NAME.c, one row in effects.c. `options` is the struct that its schema fills. Its first member
 * is an app_section; line 0 means that the scene does not name the effect, and no function here is called. Each returns
 * 0, or a status after adding a fault. */
/* How a study varies an effect. */
typedef enum sim_trial {
    SIM_TRIAL_DROP,        /* run without it, if the scene names it */
    SIM_TRIAL_DROP_OR_ADD, /* also run with its defaults, if the scene does not */
    SIM_TRIAL_KEEP,        /* no variation */
    SIM_TRIAL_LEAVE_OUT,   /* all runs omit it: it has no influence on motion */
} sim_trial;

typedef struct sim_effect {
    const char *name, *doc;
    const char *example; /* value in a scene, as for --set; for the reference and for tests of all effects; or null */
    sim_trial trial;
    app_schema schema;
    int model; /* app_model that implies the effect; its section then only holds options */
    sim_part part;
    tm_region_effect region; /* the effect as one of single bodies; 0: it applies to all of them */
    const char *needs[4];
    sim_exclusion excludes[4];
    const char *of_linear_law; /* why it requires the linear law; null: it works with all laws */
    tm_status (*check)(const app_scene *scene, const void *options); /* runs before the mesh is loaded */
    tm_status (*prepare)(sim *s, const void *options); /* mesh is loaded: fills s->def, or s->damping_1_s and
                                                        * s->fibre */
    tm_status (*build)(sim *s, const void *options);   /* s->model exists: adds stages to its world, if any */
    void (*frame)(sim *s);                             /* runs after each frame's substeps */
    void (*destroy)(sim *s);                           /* frees its data in `s`, also after a failed build */
} sim_effect;

enum { SIM_MAX_EFFECTS = 24 };
extern const sim_effect *const sim_effects[];
extern const int sim_effect_count;

/* Memory of an effect. */
typedef struct sim_cost {
    int64_t bytes; /* counted by the library (tm_memory_in_use), without its stages */
} sim_cost;

enum { SIM_OWNER_ALL = -1, SIM_OWNER_SUPPORTS = -2, SIM_OWNER_LOADS = -3 };
/* Owner of a stage by its name: an effect's index, or one of the above. */
typedef struct sim_owner {
    const char *stage;
    int effect;
} sim_owner;

/* Definition of the model. Effects fill it in `prepare`; it stays after s->model is built. */
typedef struct sim_definition {
    tm_model_def model; /* points to the other members */
    tm_contact_def contact;
    tm_grasp_def grasp;
    tm_friction_def friction;
    tm_cut_def cut;
    const char *invalid_member; /* tm_model_def.invalid_member */
} sim_definition;

/* Tetrahedra that the last frame's cuts removed. */
typedef struct sim_cuts {
    int32_t count, capacity, *tet;
    int8_t *instrument; /* instrument of each, -1: detached fragment */
    int64_t total;
} sim_cuts;

/* Ties that went in the last frame, and the instrument that cut each, or why it went (tm_ties_fetch_cut). Those beyond
 * the capacity come with the next frame. */
enum { SIM_TIES_TOLD = 256 };
typedef struct sim_ties_cut {
    int32_t count, tie[SIM_TIES_TOLD], why[SIM_TIES_TOLD];
    int64_t total, broke; /* broke: at their breaking load */
} sim_ties_cut;

/* One body of the tissue, in the numbers of s->file: [begin, end). */
typedef struct sim_body {
    const char *name;
    int32_t vertex_begin, vertex_end, tet_begin, tet_end;
    bool rigid;
} sim_body;

enum { SIM_TET_NAME = 80 };
enum { SIM_MAX_BODIES = 32, SIM_RIGID = 128 };

struct sim_picture;

/* Data sent to a controller besides the force. */
typedef enum sim_sends { SIM_SENDS_FORCE, SIM_SENDS_STIFFNESS, SIM_SENDS_PATCH } sim_sends;

/* Smallest distance so far of an instrument that has not touched yet. */
typedef struct sim_reach {
    bool touched, noted;
    double gap_m, at_s;
} sim_reach;

struct sim {
    app_scene *scene;
    sim_body *body;        /* [body_count] */
    int32_t body_count;    /* 0: the scene has one mesh and no bodies */
    tm_mesh_file file;     /* in the file's numbering, as all input and output */
    tm_mesh *mesh;         /* in the mesh's numbering, as all else here; tm_mesh_original_vertex converts back */
    tm_material *material; /* [region_count] */
    double damping_1_s;    /* for materials without damping */
    double *fibre;         /* [3*tet_count] or null */
    sim_definition def;
    tm_model *model;
    tm_instrument_def instrument_def[TM_MAX_INSTRUMENTS];
    hrt_axes64 axes[TM_MAX_INSTRUMENTS]; /* mounting of the device in the world */
    double start_joint[TM_MAX_INSTRUMENTS][SIM_JOINTS];
    hrt_hand_script hand[TM_MAX_INSTRUMENTS]; /* hand of the scene; without keys it stays at the start */
    int instrument_count;

    double frame_s, dt_s;
    double sample_s;           /* interval of base samples (sim.h); frame_s if a frame has one */
    int32_t samples;           /* base samples per frame, 1 without a controller */
    int32_t substeps, average; /* substeps of a complete frame; substeps averaged at a sample's end */
    int32_t slice;             /* substeps in about 0.1 s; 0: not measured yet */
    bool broken_off;           /* Ctrl-C interrupted the last frame or sample */
    /* Called before each slice of a frame; returns the number of substeps until the next call, 1 or more. May cut. May
     * be null. */
    int32_t (*between)(void *user, sim *s);
    void *between_user;
    int64_t frames;
    sim_cuts cuts;
    sim_ties_cut ties_cut;
    struct sim_picture *picture;           /* of the effect rendering, else null */
    tm_tool_pose pose[TM_MAX_INSTRUMENTS]; /* at the end of the last frame */
    tm_tool_reaction reaction[TM_MAX_INSTRUMENTS];

    sim_cost cost[SIM_MAX_EFFECTS];
    sim_owner owner[TM_MAX_STAGES];
    int owner_count;
    uint8_t *support_of;     /* [vertex_count] 1 + index of the scene's support, 0 free; null: no supports */
    int32_t fixed_count;     /* prescribed components, ascending: those of the stage `support` */
    int32_t *fixed_dof;      /* [fixed_count] */
    double *fixed_m;         /* [fixed_count] */
    uint8_t *fixed_by;       /* [fixed_count] 1 + index of the scene's support; SIM_RIGID + index of a rigid body */
    uint8_t *region_effects; /* [region_count] of tm_tissue_def, or null */
    uint8_t *rigid_tet;      /* [tet_count] 1: of a rigid body; null: there is none */
    double *load_N;          /* [3*vertex_count] or null */
    sim_sends can_send;      /* largest that the scene has memory for */
    sim_sends wants[TM_MAX_INSTRUMENTS];  /* requested by the controller's extrapolator, at most can_send */
    tm_patch *patch;                      /* [instrument_count] with SIM_SENDS_PATCH, else null */
    bool patch_valid[TM_MAX_INSTRUMENTS]; /* computed by the last frame */
    bool exact_patches;                   /* their compliance comes from a factor */
    sim_coverage coverage[TM_MAX_INSTRUMENTS];
    sim_reach reach[TM_MAX_INSTRUMENTS];
    tm_deformation worst; /* over the checked frames: sim_shape_note */
    double worst_s;
    int32_t limited_tets; /* maximum number beyond a limit of their nonlinear law in a checked frame */
    double limited_s;
    bool shape_noted;
    double velocity_m_s[TM_MAX_INSTRUMENTS][3]; /* of the tips, mean over the last sample */
    double last_s;                              /* length of the last sample */
    double patches_s;                           /* run time of patches and stiffness in the last sample */
};

/* Reads the scene with the fields of all effects. Returns 0, or a status after adding a fault. */
tm_status sim_scene_load(const char *file, char *const *set, int set_count, const app_host *host, app_scene **scene);
/* Checks and builds a simulation. Takes ownership of the scene, also on failure. */
tm_status sim_create(app_scene *scene, sim **out);
/* The same without a model: s->def is complete and s->model is null. */
tm_status sim_prepare(app_scene *scene, sim **out);
void sim_destroy(sim *s);

/* --- queries (queries.c) --- */

bool sim_has(const sim *s, const char *effect);
/* Returns an effect's options; null if the scene does not name it. */
const void *sim_options(const app_scene *scene, const char *effect);
/* Return whether a body has an effect, by its number; whether all bodies that deform have it; whether the scene, or one
 * of its bodies, has both effects. */
bool sim_body_has_effect(const app_scene *scene, int body, int effect);
bool sim_effect_everywhere(const app_scene *scene, int effect);
bool sim_effects_meet(const app_scene *scene, const char *a, const char *b);
/* Returns the line of a material with a nonlinear law; 0: there is none. */
int sim_law_line(const app_scene *scene);
/* Adds a fault for a library's error, at this line. */
tm_status sim_report(const app_scene *scene, int line, const tm_error *error);
/* The same for an error inside a file that the scene names on `line`. */
tm_status sim_report_file(const app_scene *scene, int line, const char *file, int file_line, const tm_error *error);
/* Returns an effect's index by its name, -1 if there is none. */
int sim_effect_find(const app_scene *scene, const char *name);
/* Returns whether all studies omit the effect with this name (SIM_TRIAL_LEAVE_OUT). */
bool sim_effect_left_out(const char *name);
/* Returns the line that names an effect, 0: not named. */
int sim_effect_line(const app_scene *scene, int index);

/* --- building and stepping --- */

/* Runs app_select_vertices for the mesh's numbering: mark[vertex_count]. */
tm_status sim_select(const sim *s, const app_select *select, int line, uint8_t *mark, int32_t *count);
/* Sets vertex[vertex_count] to the mesh's number of each vertex of the file. */
void sim_vertices_of_file(const sim *s, int32_t *vertex);

/* Steps of the build that models share. */
tm_status sim_build_supports(sim *s);
/* Adds the stage "pressure" to the model's world, if a load has one. */
tm_status sim_add_pressures(sim *s);
tm_status sim_build_loads(sim *s);
tm_status sim_build_instruments(sim *s);

/* Computes one frame: each instrument moves to to[i] over `substeps` (s->substeps for a complete frame). */
tm_status sim_frame(sim *s, const tm_tool_pose *to, int32_t substeps);
/* The same in parts: force samples of `substeps` each, with reactions and their additions after each. The end of the
 * frame then runs the effects' frame hooks. */
tm_status sim_sample(sim *s, const tm_tool_pose *to, int32_t substeps);
void sim_frame_end(sim *s);

/* Returns the data that an extrapolator (hrt_extrapolator) needs. */
sim_sends sim_sends_of(int extrapolator);

/* Converts joints to a pose in the world. */
tm_tool_pose sim_pose(const sim *s, int instrument, const double joint[SIM_JOINTS], bool active);
/* Computes where the shaft's line begins (the trocar, or outside the tissue behind a free tip) and its unit direction.
 * Returns the tip's distance from there. */
double sim_shaft_start(const sim *s, int instrument, const tm_tool_pose *pose, double from_m[3], double along[3]);
/* Returns whether all devices have the joints of the first one; others have rows of another kind in its tables. */
bool sim_same_devices(const sim *s);
/* Returns the pose of instrument i at this insertion, with its start rotation; a free one's, drawn back along its
 * shaft. */
tm_tool_pose sim_start_pose_at(const sim *s, int instrument, double insertion_m, bool active);

/* Returns the instrument's pose on the scene's hand at a time. */
tm_tool_pose sim_hand_pose(const sim *s, int instrument, double time_s);
/* Return surface, displacements [3*vertex_count] and simulated time, for all models. */
tm_surface_view sim_surface(const sim *s);
const double *sim_displacement(const sim *s);
double sim_time_s(const sim *s);
/* Returns the number of active tetrahedra of the complete organ. */
int32_t sim_alive(const sim *s);
/* Writes a tetrahedron's number in its mesh file, and the body's name if there are bodies: "590 of body liver". Returns
 * `name`. */
const char *sim_tet_name(const sim *s, int32_t tet, char name[SIM_TET_NAME]);
uint64_t sim_hash(const sim *s);

/* --- force samples per frame, and their additions --- */

/* Who requests forces; app_scene.pace. */
typedef enum sim_scene_pace {
    SIM_FRAMES = 0, /* the caller, once a frame */
    SIM_LOCKSTEP,   /* controllers on a virtual clock */
    SIM_REALTIME    /* controllers on the wall clock */
} sim_scene_pace;

/* Returns the base samples per frame that a scene requests. */
int32_t sim_stream_per_frame(const app_scene *scene);

/* Returns the additions that a force sample may carry at a rate. A patch or stiffness delays the newer force too much
 * at high rates, unless the scene names `haptics.sends`. */
sim_sends sim_stream_sends(const sim *s, double rate_Hz);
/* The same if the scene does not name it. */
sim_sends sim_stream_sends_by_rate(double rate_Hz);

#endif
