/* Internals of the contact stage, shared by contact*.c, grasp*.c and patch*.c. */
#ifndef TM_CONTACT_INTERNAL_H
#define TM_CONTACT_INTERNAL_H

#include "contact/broad_phase.h"
#include "contact_law/ledger.h"
#include "tensormass/grasp.h"
#include "world/world_internal.h"

#define TM_STAGE_CONTACT_DETECT "contact detect" /* stages that change which rows exist run before it */

enum { TM_COOKIE_CONTACT = 0x636f6e74, TM_COOKIE_GRASP = 0x67726173 };

/* Row prepared for projection: J and A^-1 J^T of its three vertices. */
typedef struct tm_solver_row {
    double jacobian[3][3]; /* weight * normal */
    double response[3][3]; /* mobility * jacobian, 0 where a support prescribes */
    double diagonal;       /* J A^-1 J^T, m/N */
    double compliance;     /* contact compliance / share, m/N */
    double moved_m[3];     /* motion of the station in this substep */
    double depth_m;        /* maximum depth of its compliance, from the last substep */
    double weight2;        /* sum of weight^2 * mobility, m/N */
    double drag_N[3];      /* viscous contact drag on the tissue */
    /* At the start of the substep with the tool's new position, minus the part deferred to later substeps. */
    double gap_m;
} tm_solver_row;

/* State of a tool. Lasting state is also in contact_snapshot.c: add new fields there too. */
typedef struct tm_tool {
    tm_instrument_def def;
    tm_tool_pose pose, from, to;
    int32_t path_step, path_steps;
    int32_t placings;                      /* count of teleports */
    tm_capsule capsule, previous, earlier; /* at the ends of this substep, the previous one and the one before */
    bool outside;                          /* has been outside the tissue since it was placed */
    bool axis_outside;                     /* not outside, but its axis is */
    bool placed_inside; /* placed inside the tissue: outside again when nothing is within its radius */
    double station_depth_m[TM_MAX_STATIONS]; /* penetration of its compliance at the last substep */
    double load_N;                           /* sum of its row forces at the last substep, N */
    /* Passivity observer (contact_passivity.c). placed_J: energy that its rows may still generate since a teleport,
     * until it moves. Then: energy that its rows took; total given to the tissue; stored under the tool; in its contact
     * compliance at the last substep and the one before. */
    double placed_J, reserve_J, throughput_J, stored_J, contact_stored_J[2];
    /* Energy generated beyond the allowance; total generated; its minimum in each part of a window; duration of the
     * present part, s. */
    double debt_J, generated_J, min_generated_J[LAW_LEDGER], ledger_s;
    double sliding_J; /* allowance of this substep due to slow sliding */
    /* broad phase */
    tm_local_surface *surface;
    tm_capsule gathered_at;
    int32_t gathered_age; /* substeps since the last broad-phase check, which was at gathered_at; negative: never */
    double margin_used_m; /* margin used by motion of tool and tissue since the last gathering */
    double longer_m;      /* growth of the longest edge within reach since then */
    /* Gathered in this substep; gathered before this call of the step, so the caller may have moved the tissue: the
     * next check gathers again. */
    bool regathered, maybe_moved;
    /* frame */
    double sum_tip_m[3], sum_time_s, sum_force_N[3], sum_resultant_N[3];
    int32_t sum_count;
    uint32_t flags;                                    /* tm_reaction_flag */
    double substep_force_N[3], substep_resultant_N[3]; /* of the last substep */
    double stiffness_N_m[9];                           /* dF/dP from the stage "patch" */
    int32_t stiffness_kind;
} tm_tool;

/* Forces of a block on the vertices in the jaws of one instrument, for the energy account. */
typedef struct tm_jaw_load {
    int32_t count;
    const int32_t *vertex;
    const double *force_N;  /* [3*count] on the tissue, at the last substep */
    const double *offset_m; /* [3*count] other end of each spring, in the jaw's frame */
    const tm_jaw *jaw;
    double compliance_m_N;
} tm_jaw_load;

/* Constraint block. Blocks share vertices, so one driver sweeps them all, or they would counteract each other: grasps
 * first, contact rows last. Unused members are null. */
typedef struct tm_constraint_block {
    void *self;
    void *owner; /* self of the stage under which its time is recorded; null: contact's own */
    /* Finds and starts its constraints of this substep; null: the stage of the block does it, before "contact
     * detect". */
    void (*find)(void *self, tm_world *world);
    void (*sweep)(void *self, tm_world *world, int32_t sweep);
    /* After the sweeps: for a block that solves all its constraints at once. */
    void (*finish)(void *self, tm_world *world);
    /* Adds its force of this substep to the tool's tip force and to the resultant, N. */
    void (*react)(void *self, int32_t instrument, double force_N[3], double resultant_N[3]);
    /* Returns whether the block holds the vertex, which is then no obstacle to that tool. */
    bool (*is_grasped)(void *self, int32_t instrument, int32_t vertex);
    /* Moves a held vertex by a force on it, and updates the block. After the sweeps. null or false: it is not held. */
    bool (*push)(void *self, tm_world *world, int32_t vertex, const double force_N[3]);
    /* Reduces its forces on an instrument's vertices if they give the tissue more than stored energy and tool work.
     * Returns whether it did. */
    bool (*hold_back)(void *self, tm_world *world, int32_t instrument);
    /* Returns the energy dissipated by its constraints, J, >= 0. */
    double (*lost)(void *self, const tm_world *world, int32_t instrument);
    /* Returns the number of held vertices (-1 while releasing), their targets in the jaws [3*count], and the compliance
     * of each spring. */
    int32_t (*grasped)(void *self, int32_t instrument, const int32_t **vertex, const double **target_m,
                       double *compliance_m_N);
    void (*load)(void *self, int32_t instrument, tm_jaw_load *load);
    /* Drops or weakens those of an instrument's rows that belong to it; returns how many are left. */
    int32_t (*admit)(void *self, int32_t instrument, tm_contact_row *row, int32_t count);
} tm_constraint_block;

enum { TM_MAX_BLOCKS = 7 };

/* contact_fade.c: a row whose tetrahedron was removed, and whose force fades. */
typedef struct tm_fading_row {
    int32_t instrument, station, vertex[3], unused;
    double weight[3], normal[3]; /* of the original row */
    double bore_N;               /* force when its tetrahedron was removed */
    double age_s;                /* since the removal */
    double compliance_m_N;       /* of its contact compliance */
    double stretch_m;            /* compression of its compliance at the end of the last substep; below 0: separated */
    double lambda_N;
    /* Of this substep: as in tm_solver_row; depth with the tool moved and the tissue not yet. */
    double diagonal_m_N, pressed_m;
} tm_fading_row;

enum { TM_FADING_MAX = 256 }; /* rows; further ones are dropped at once */
typedef struct tm_fading_rows {
    tm_contact *contact;
    double fade_s;
    int32_t count;
    tm_fading_row *row; /* [TM_FADING_MAX] */
} tm_fading_rows;

/* Contact query of a substep: rows of each tool, in its part of previous_row, [max_rows] each, until that becomes
 * `row`. */
typedef struct tm_contact_query {
    tm_contact *contact;
    int32_t history[TM_MAX_INSTRUMENTS + 1]; /* index of a tool's first row of the previous substep */
    int32_t count[TM_MAX_INSTRUMENTS];
    /* Tools with surface near them first, so that no thread gets two before another has one. */
    int32_t tool[TM_MAX_INSTRUMENTS], busy;
} tm_contact_query;

struct tm_contact {
    tm_pool pool;
    tm_world *world;
    tm_contact_def def;
    int32_t tool_count;
    tm_tool tool[TM_MAX_INSTRUMENTS];
    tm_contact_row *row, *previous_row; /* [max_rows * tool_count] of this and the last substep */
    int32_t row_count, previous_row_count;
    tm_contact_query query;
    double way_m;          /* motion of the fastest vertex in the last substep that used margins */
    bool detected;         /* rows of this substep were detected during the force pass (contact_detection.c) */
    tm_solver_row *solver; /* [max_rows] */
    tm_hits *hits;         /* [tool_count] */
    uint8_t *fixed;        /* [3*vertex_count] components that a support prescribes */
    const void *fixed_by;  /* support stage that `fixed` was computed from */
    int32_t revision;      /* revision of the surface at the last gathering */
    int32_t frame_step, frame_steps, frame_average;
    int32_t block_count;
    tm_constraint_block block[TM_MAX_BLOCKS]; /* the last, except for friction: contact rows, its own or `others` */
    struct tm_friction *friction;             /* null: there is none */
    tm_fading_rows *fading;                   /* null: forces on removed tetrahedra vanish at once */
    tm_contact_block others;                  /* block that supplies the rows; solve null: the stage's own */
    double all_stored_J;                      /* in the complete tissue, at this substep; negative: not computed yet */
    bool unstable;                            /* a row had a number that is not finite, in this substep */
    void *saved;                              /* snapshot at the start of the step, of maximum capacity */
    int64_t saved_bytes;
};

/* contact_detection.c: detects the rows of this substep, unless that was done during the force pass. */
const tm_contact_query *tm_contact_detect(tm_contact *contact);
/* Detection during the force pass; of the stage "contact detect". */
extern const tm_overlap tm_contact_overlap;
/* Returns whether a stage with this self is contact's own, or that of one of its blocks; contact may be null. */
bool tm_contact_owns(const tm_contact *contact, const void *self);
/* Displacements that rows and jaws change. */
extern const tm_few tm_contact_few;
/* Returns the first of contact's stages that uses new displacements. */
const char *tm_contact_first_stage(const tm_contact *contact);

/* contact_tool.c */
void tm_tool_set_pose(tm_tool *tool, const tm_tool_pose *at);
void tm_tool_move(tm_tool *tool, const tm_tool_pose *to, int32_t substeps);
/* By one of `parts` equal substeps of a step of its path. */
void tm_tool_advance(tm_tool *tool, int32_t part, int32_t parts);
/* Returns whether the tool is in the body; a cautery always is. */
bool tm_tool_is_present(const tm_tool *tool);
/* Returns whether the axis is outside: beyond the tip it meets no triangle where it can touch, and an even number in
 * total. O(surface). */
bool tm_tool_is_outside(const tm_tool *tool, const double *rest_m, const double *u_m, const tm_surface_view *surface);

/* Map from a force on a tool's point to the equivalent force at its tip. length_m is infinite for a free tool. */
typedef struct tm_lever {
    double trocar_m[3], direction[3], length_m;
} tm_lever;
tm_lever tm_lever_at(const double trocar_m[3], const double tip_m[3]);
tm_lever tm_tool_lever(const tm_instrument_def *def, const tm_tool_pose *pose);
void tm_lever_force(const tm_lever *lever, const double point_m[3], const double force_N[3], double tip_force_N[3]);

/* Returns the travel of the axis: the larger of its two ends', m. */
double tm_capsule_travel(const tm_capsule *a, const tm_capsule *b);

/* contact_passivity.c */
/* Reduces a tool's forces if they give more energy than allowed. After the sweeps. */
void tm_contact_limit_energy(tm_contact *contact);
void tm_contact_observe(tm_contact *contact); /* at the end of the substep */
/* Energy of one row over the two steps around its force, as the scheme counts work; `earlier`: the tool's position
 * then. */
typedef struct tm_row_energy {
    double force_N[3];   /* on the tissue, drag included */
    double travel_m[3];  /* motion of the tool */
    double tool_work_J;  /* by the hand */
    double compliance_J; /* stored in the contact compliance */
} tm_row_energy;
tm_row_energy tm_contact_row_energy(const tm_contact *contact, int32_t row, const tm_capsule *earlier);
/* Returns the energy that a tool may give without limitation if its station moved this far in this substep, J. */
double tm_contact_spare_J(const tm_contact *contact, int32_t tool, double way_m);

/* contact_forces.c */
void tm_contact_sum(tm_contact *contact);

/* contact_solve.c */
void tm_contact_prepare(tm_contact *contact);
void tm_contact_sweep(tm_contact *contact, int32_t sweep); /* its own rows, once */

/* constraint_blocks.c: list of the blocks, and calls to all of them */
/* Adds a block before the rows. At most TM_MAX_BLOCKS - 1, which the caller ensures. */
void tm_contact_add_block(tm_contact *contact, const tm_constraint_block *block);
/* Adds a block after the rows, for constraints that use the row forces of the same sweep. */
void tm_contact_add_block_behind(tm_contact *contact, const tm_constraint_block *block);
tm_constraint_block *tm_contact_rows_block(tm_contact *contact);
void tm_contact_remove_block(tm_contact *contact, const void *self);
/* Sweeps all blocks in turn, then runs those that solve at once. */
void tm_contact_constrain(tm_contact *contact, tm_world *world);
void tm_contact_push_vertex(tm_contact *contact, int32_t vertex, const double force_N[3]);
bool tm_contact_hold_back_blocks(tm_contact *contact, int32_t instrument);
double tm_contact_lost_J(const tm_contact *contact); /* sum over blocks and instruments */
/* Returns whether all loaded vertices of the row are held: it is no obstacle to the tool that holds them. */
bool tm_row_is_grasped(const tm_contact *contact, const tm_contact_row *row);
/* Call the hooks of the same names; without a grasp they do nothing. */
int32_t tm_contact_grasped(const tm_contact *contact, int32_t instrument, const int32_t **vertex,
                           const double **target_m, double *compliance_m_N);
tm_jaw_load tm_contact_load(const tm_contact *contact, int32_t instrument);
int32_t tm_contact_admit(const tm_contact *contact, int32_t instrument, tm_contact_row *row, int32_t count);

/* contact_fade.c: add the block, with its time recorded for `owner`, and remove it. */
void tm_fading_add(tm_fading_rows *fading, const void *owner);
void tm_fading_remove(tm_fading_rows *fading);
/* Starts fading the last substep's rows on these tetrahedra, which have just been removed. */
void tm_fading_begin(tm_fading_rows *fading, const int32_t *tet, int32_t count);
void tm_fading_age(tm_fading_rows *fading, double dt_s);
/* Drops the rows of an instrument that was teleported. */
void tm_fading_drop(tm_fading_rows *fading, int32_t instrument);
/* Returns whether rows of the instrument fade; fading may be null. */
bool tm_fading_has(const tm_fading_rows *fading, int32_t instrument);
/* Returns whether a snapshot may hold the row. */
bool tm_fading_fits(const tm_fading_rows *fading, const tm_fading_row *row);

/* friction.c: returns whether this instrument has friction. */
bool tm_contact_has_friction(const tm_contact *contact, int32_t instrument);
/* Returns the friction forces on the tissue, one per contact row (zero without friction), and the static and kinetic
 * coefficients. For an instrument with friction. */
const double (*tm_contact_friction_forces(const tm_contact *contact, int32_t instrument, double *at_rest,
                                          double *sliding))[3];

/* contact_snapshot.c: hooks of the stage */
int64_t tm_contact_snapshot(void *self, void *buffer);
bool tm_contact_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
int64_t tm_contact_snapshot_max(const tm_contact_def *def);
void tm_contact_checkpoint(void *self);
void tm_contact_rollback(void *self, tm_world *world);

/* Returns the contact stage of a world, found by name; null if there is none. */
tm_contact *tm_world_contact(tm_world *world);

#endif
