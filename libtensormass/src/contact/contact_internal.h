/* Insides of the contact stage, shared by contact*.c, grasp*.c and patch*.c. */
#ifndef TM_CONTACT_INTERNAL_H
#define TM_CONTACT_INTERNAL_H

#include "contact/broad_phase.h"
#include "tensormass/grasp.h"
#include "world/world_internal.h"

#define TM_STAGE_CONTACT_DETECT "contact detect" /* what decides which rows there are runs before it */

enum { TM_COOKIE_CONTACT = 0x636f6e74, TM_COOKIE_GRASP = 0x67726173 };

/* Parts that a window of the account of energy is watched in (contact_passivity.c): one more than there are in it. */
enum { TM_LEDGER = 17 };

/* One row made ready for projection: J and A^-1 J^T of its three vertices. */
typedef struct tm_solver_row {
    double jacobian[3][3]; /* weight * normal */
    double response[3][3]; /* mobility * jacobian, 0 where a support holds */
    double diagonal;       /* J A^-1 J^T, m/N */
    double compliance;     /* skin / share, m/N */
    double moved_m[3];     /* by the station in this substep */
    double depth_m;        /* that its skin may have from the last substep */
    double weight2;        /* sum of weight^2 * mobility, m/N */
    double drag_N[3];      /* of the film, on the tissue */
    double gap_m; /* at the start of the substep, at the tool's new place, less what is left to later substeps */
} tm_solver_row;

/* What lasts between steps is also in contact_snapshot.c: a new field goes there too. */
typedef struct tm_tool {
    tm_instrument_def def;
    tm_tool_pose pose, from, to;
    int32_t path_step, path_steps;
    int32_t placings;                        /* times it was put somewhere at once */
    tm_capsule capsule, previous, earlier;   /* at the end of this substep, of the one before and of that before it */
    bool outside;                            /* has been seen outside the tissue since it was placed */
    bool axis_outside;                       /* not clear, but its axis is outside */
    bool placed_inside;                      /* was placed inside: clear again when nothing is within its radius */
    double station_depth_m[TM_MAX_STATIONS]; /* how far its skin was pressed in at the last substep */
    double load_N;                           /* what all its rows bore then */
    double placed_J, /* that its rows may make besides since the tool was put there, until it moves */
        reserve_J, throughput_J, stored_J, contact_stored_J[2]; /* contact_passivity.c: what its rows took; what they
                                                      gave the tissue in all; held under the tool; in its skins at the
                                                      last substep and the one before */
    double debt_J, generated_J, min_generated_J[TM_LEDGER],
        ledger_s;     /* made beyond what was allowed; out of nothing, in all; the least of that in each part of a
                 window; of the present part, which has lasted so long */
    double sliding_J; /* of this substep: what it may be given because it slides slowly */
    /* broad phase */
    tm_local_surface *surface;
    tm_capsule gathered_at;
    int32_t gathered_age; /* substeps since it last looked out, which it did at gathered_at; negative: never */
    double margin_used_m; /* of the room that it was last gathered with, by what tool and tissue have moved since */
    double longer_m;      /* than edges were then the longest is now, of what it may touch */
    bool regathered, maybe_moved; /* gathered in this substep; before this call of the step, since when anybody may have
                             moved tissue: gathered anew when it next looks out */
    /* frame */
    double sum_tip_m[3], sum_time_s, sum_force_N[3], sum_resultant_N[3];
    int32_t sum_count;
    uint32_t flags;                                    /* tm_reaction_flag */
    double substep_force_N[3], substep_resultant_N[3]; /* of the last substep */
    double stiffness_N_m[9];                           /* dF/dP by the stage "patch" */
    int32_t stiffness_kind;
} tm_tool;

/* What a block does to the vertices in the jaw of one instrument, for the account of energy. */
typedef struct tm_jaw_load {
    int32_t count;
    const int32_t *vertex;
    const double *force_N;  /* [3*count] on the tissue, of the last substep */
    const double *offset_m; /* [3*count] the other end of each spring, in the jaw's frame */
    const tm_jaw *jaw;
    double compliance_m_N;
} tm_jaw_load;

/* A block of constraints. All blocks share vertices, so all are swept by one driver, or they would fight: holds first,
 * the rows of contact last. What a block has no use for is null. */
typedef struct tm_constraint_block {
    void *self;
    void *owner; /* self of the stage that its time is booked on; null: contact's own */
    /* Finds its constraints of this substep and starts them; null: the stage of the block does, before "contact
     * detect".
     */
    void (*find)(void *self, tm_world *world);
    void (*sweep)(void *self, tm_world *world, int32_t sweep);
    void (*finish)(void *self,
                   tm_world *world); /* after the sweeps: of a block that solves all its constraints at once */
    /* Adds to the tool's force at its tip and to the plain sum, N, of this substep. */
    void (*react)(void *self, int32_t instrument, double force_N[3], double resultant_N[3]);
    bool (*is_grasped)(void *self, int32_t instrument,
                       int32_t vertex); /* a vertex it holds is no obstacle to that tool */
    /* After the sweeps: moves a vertex that it holds by a force on it, its own following; null, false: it is not held.
     */
    bool (*push)(void *self, tm_world *world, int32_t vertex, const double force_N[3]);
    /* Where its forces on an instrument's vertices give tissue more than they held and the hand put in: reduces them.
     * Returns whether it did. */
    bool (*hold_back)(void *self, tm_world *world, int32_t instrument);
    double (*lost)(void *self, const tm_world *world, int32_t instrument); /* what they took, J, not below 0 */
    /* Vertices held (-1 while releasing), where the jaw has them [3*count], and the compliance of the hold on each. */
    int32_t (*grasped)(void *self, int32_t instrument, const int32_t **vertex, const double **target_m,
                       double *compliance_m_N);
    void (*load)(void *self, int32_t instrument, tm_jaw_load *load);
    /* Drops, or eases, those of an instrument's rows that are its own; returns how many are left. */
    int32_t (*admit)(void *self, int32_t instrument, tm_contact_row *row, int32_t count);
} tm_constraint_block;

enum { TM_MAX_BLOCKS = 4 };

/* contact_fade.c: a row whose tetrahedron was cut away, and whose force fades. */
typedef struct tm_fading_row {
    int32_t instrument, station, vertex[3], unused;
    double weight[3], normal[3]; /* as the row had them */
    double bore_N;               /* when its tetrahedron went */
    double age_s;                /* since then */
    double compliance_m_N;       /* of its skin */
    double stretch_m;            /* of its skin at the last substep's end; below 0: come off by so much */
    double lambda_N;
    double diagonal_m_N, pressed_m; /* of this substep: as of a solver row; with the tool moved and tissue not yet */
} tm_fading_row;

enum { TM_FADING_MAX = 256 }; /* rows; more go at once */
typedef struct tm_fading_rows {
    tm_contact *contact;
    double fade_s;
    int32_t count;
    tm_fading_row *row; /* [TM_FADING_MAX] */
} tm_fading_rows;

/* Of a substep: what each tool finds, in its own part of row_before, [max_rows] each, until that becomes `row`. */
typedef struct tm_contact_query {
    tm_contact *contact;
    int32_t history[TM_MAX_INSTRUMENTS + 1]; /* where a tool's rows of the substep before begin */
    int32_t count[TM_MAX_INSTRUMENTS];
    int32_t tool[TM_MAX_INSTRUMENTS], busy; /* those with surface near them first, so that no thread gets two before
                                               another has one */
} tm_contact_query;

struct tm_contact {
    tm_pool pool;
    tm_world *world;
    tm_contact_def def;
    int32_t tool_count;
    tm_tool tool[TM_MAX_INSTRUMENTS];
    tm_contact_row *row, *previous_row; /* [max_rows * tool_count] of this substep and the last */
    int32_t row_count, previous_row_count;
    tm_contact_query query;
    bool detected;         /* of the substep under way, already while force was computed (contact_detection.c) */
    tm_solver_row *solver; /* [max_rows] */
    tm_hits *hits;         /* [tool_count] */
    uint8_t *fixed;        /* [3*vertex_count] components that a support prescribes */
    const void *fixed_by;  /* the support stage that `fixed` was made from */
    int32_t revision;      /* of the surface at the last gathering */
    int32_t frame_step, frame_steps, frame_average;
    int32_t block_count;
    tm_constraint_block block[TM_MAX_BLOCKS]; /* the last, but for friction: the rows, the stage's own or another's */
    struct tm_friction *friction;             /* null: there is none */
    tm_fading_rows *fading;                   /* null: what is cut away bears nothing any more */
    tm_contact_block others;                  /* whose rows these are; solve null: the stage's own */
    double all_stored_J;                      /* in all tissue, in this substep; negative: not looked yet */
    bool unstable;                            /* a row met a number that is not finite, in this substep */
    void *saved;                              /* the snapshot at the start of the step, room for the largest */
    int64_t saved_bytes;
};

/* contact_detection.c: finds what rows there are in this substep, unless that has been done ahead. */
const tm_contact_query *tm_contact_detect(tm_contact *contact);
/* Looks, while the force is computed; of the stage "contact detect". */
extern const tm_overlap tm_contact_overlap;
/* Of the displacements that rows and jaws change. */
extern const tm_few tm_contact_few;
/* The first of contact's stages that works on new displacements. */
const char *tm_contact_first_stage(const tm_contact *contact);

/* contact_tool.c */
void tm_tool_set_pose(tm_tool *tool, const tm_tool_pose *at);
void tm_tool_move(tm_tool *tool, const tm_tool_pose *to, int32_t substeps);
void tm_tool_advance(tm_tool *tool);
/* In the body at all; a cautery always is. */
bool tm_tool_is_present(const tm_tool *tool);
/* The axis beyond the tip meets no triangle where it can touch, and an even number in all. O(surface). */
bool tm_tool_is_outside(const tm_tool *tool, const double *rest_m, const double *u_m, const tm_surface_view *surface);

/* How far the axis' ends moved, the farther of them. */
double tm_capsule_travel(const tm_capsule *a, const tm_capsule *b);

/* contact_passivity.c */
/* After the sweeps: reduces a tool's forces where they give more than they may. */
void tm_contact_limit_energy(tm_contact *contact);
void tm_contact_observe(tm_contact *contact); /* when all is done */
/* Of one row, over the two steps around its force as the scheme does its work; `earlier`: where the tool was then. */
typedef struct tm_row_energy {
    double force_N[3];   /* on the tissue, drag included */
    double travel_m[3];  /* that the tool went */
    double tool_work_J;  /* the hand's */
    double compliance_J; /* held in the skin */
} tm_row_energy;
tm_row_energy tm_contact_row_energy(const tm_contact *contact, int32_t row, const tm_capsule *earlier);
/* What a tool whose station went so far in this substep may give, J, before it is held back. */
double tm_contact_spare_J(const tm_tool *tool, double way_m, double dt_s);

/* contact_forces.c */
void tm_contact_sum(tm_contact *contact);

/* contact_solve.c */
void tm_contact_prepare(tm_contact *contact);
void tm_contact_sweep(tm_contact *contact, int32_t sweep); /* of its own rows, once */

/* constraint_blocks.c: the list of blocks, and what is asked of all of them */
/* In front of the rows. Not more than TM_MAX_BLOCKS - 1: who adds one sees to that. */
void tm_contact_add_block(tm_contact *contact, const tm_constraint_block *block);
/* Behind the rows: what needs what they press with in the same sweep. */
void tm_contact_add_block_behind(tm_contact *contact, const tm_constraint_block *block);
tm_constraint_block *tm_contact_rows_block(tm_contact *contact);
void tm_contact_remove_block(tm_contact *contact, const void *self);
/* The one driver: every block in every sweep, then what solves at once. */
void tm_contact_constrain(tm_contact *contact, tm_world *world);
void tm_contact_push_vertex(tm_contact *contact, int32_t vertex, const double force_N[3]);
bool tm_contact_hold_back_blocks(tm_contact *contact, int32_t instrument);
double tm_contact_lost_J(const tm_contact *contact); /* of all blocks and instruments */
/* All vertices that bear the row are held: it is no obstacle to the tool that holds them. */
bool tm_row_is_grasped(const tm_contact *contact, const tm_contact_row *row);
/* As the block's hooks of the same name; nobody holds: nothing. */
int32_t tm_contact_grasped(const tm_contact *contact, int32_t instrument, const int32_t **vertex,
                           const double **target_m, double *compliance_m_N);
tm_jaw_load tm_contact_load(const tm_contact *contact, int32_t instrument);
int32_t tm_contact_admit(const tm_contact *contact, int32_t instrument, tm_contact_row *row, int32_t count);

/* contact_fade.c. Adds the block, its time booked on `owner`, and removes it. */
void tm_fading_add(tm_fading_rows *fading, const void *owner);
void tm_fading_remove(tm_fading_rows *fading);
/* Lets the rows of the last substep on these tetrahedra fade, which have just gone. */
void tm_fading_begin(tm_fading_rows *fading, const int32_t *tet, int32_t count);
void tm_fading_age(tm_fading_rows *fading, double dt_s);
/* Of an instrument that was put elsewhere. */
void tm_fading_drop(tm_fading_rows *fading, int32_t instrument);
/* Returns whether rows of the instrument fade; fading may be null. */
bool tm_fading_has(const tm_fading_rows *fading, int32_t instrument);
/* Returns whether a snapshot may hold the row. */
bool tm_fading_fits(const tm_fading_rows *fading, const tm_fading_row *row);

/* friction.c: this instrument has friction. */
bool tm_contact_has_friction(const tm_contact *contact, int32_t instrument);
/* Its coefficients, at rest and sliding, and the forces of friction on the tissue, one a row of contact (zero where
 * none is): of an instrument that rubs. */
const double (*tm_contact_friction_forces(const tm_contact *contact, int32_t instrument, double *at_rest,
                                          double *sliding))[3];

/* contact_snapshot.c: the stage's hooks */
int64_t tm_contact_snapshot(void *self, void *buffer);
bool tm_contact_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
int64_t tm_contact_snapshot_max(const tm_contact_def *def);
void tm_contact_checkpoint(void *self);
void tm_contact_rollback(void *self, tm_world *world);

/* The stage of a world, by name; null if it has none. */
tm_contact *tm_world_contact(tm_world *world);

#endif
