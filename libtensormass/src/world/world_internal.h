/* Private to libtensormass: memory pools, error helper, the insides of tissue and world. */
#ifndef TM_INTERNAL_H
#define TM_INTERNAL_H

#include "base/contract.h"
#include "tensormass/tissue.h"
#include "tensormass/world.h"
#include "tissue/kernel.h"

/* Cookies of filled definition structs: an unfilled one is a broken contract. */
enum {
    TM_COOKIE_MESH = 0x6d657368,
    TM_COOKIE_TISSUE = 0x74697373,
    TM_COOKIE_WORLD = 0x776f726c,
    TM_COOKIE_SUPPORT = 0x73757070,
    TM_COOKIE_SETTLE = 0x73657474,
    TM_COOKIE_CUT = 0x63757421
};

/* Every array of an object is one block of its pool; releasing the pool frees the object. A failed take marks the pool,
 * so that builders take everything first and look once. Blocks are zeroed and aligned to 64 bytes. */
typedef struct tm_block tm_block;
typedef struct tm_pool {
    tm_block *first;
    int64_t bytes;
    bool failed;
} tm_pool;
void *tm_pool_take(tm_pool *pool, int64_t count, size_t size);
void tm_pool_release(tm_pool *pool);
#define TM_TAKE(pool, type, count) ((type *)tm_pool_take((pool), (count), sizeof(type)))

/* Fills `error` (may be null) and returns `status`. */
tm_status tm_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
tm_status tm_fail_memory(tm_error *error, const char *what);

struct tm_tissue {
    tm_pool pool;
    const tm_mesh *mesh;
    tm_material *material; /* [material_count] */
    int32_t material_count;
    int32_t *region_material; /* [region_count] */
    double *fibre;            /* [3*tet_count] or null */
    tm_precision precision;
    bool cuttable;
    uint8_t *alive; /* [tet_count] */
    int32_t alive_count;
    uint8_t *elsewhere;                         /* [tet_count] or null: there, but not ours */
    double *mass_kg, *damping_kg_s;             /* [vertex_count] */
    double *extra_mass_kg, *extra_damping_kg_s; /* [vertex_count] or null */
    tm_force_graph graph;
    int32_t *edge_slot;   /* [edge_count] place of a living edge in the graph, -1: dead; null: every edge lives, in its
                             own number's place */
    double *vertex_block; /* cuttable, double: [9*4*tet_count] blocks K_kk in the order of mesh->vertex_tet, so that a
                             sum reads straight on; else null */
    double *edge_block;   /* cuttable: [9*6*tet_count] in the order of mesh->edge_tet */
    double *vertex_share; /* cuttable: [2*4*tet_count] mass and damping that a tetrahedron gives, in the order of
                             mesh->vertex_tet */
    tm_force_kernel force;
    tm_surface_view surface;                  /* views the mesh's own arrays when nothing can differ from them */
    int32_t *surface_triangle, *surface_face; /* writable, or null when viewing the mesh's */
    int32_t *face_slot;                       /* cuttable: [4*tet_count] slot of a face in the surface, -1 */
    struct tm_cut_work *cut;                  /* cuttable: marks and queues of cut.c */
    int32_t undo_count;                       /* tetrahedra removed since a step began, and can be given back */
    int32_t kept_revision;                    /* of the surface then */
};

/* --- assembly, shared by create and cut; all sums ascending over living tetrahedra --- */
/* Gives every living edge its slot. */
void tm_tissue_place_edges(tm_tissue *tissue);
bool tm_tissue_edge_lives(const tm_tissue *tissue, int32_t edge);
/* Takes the slot of an edge that has died; those behind it in the room move up. */
void tm_tissue_drop_edge(tm_tissue *tissue, int32_t edge);
/* The reverse, unless it has one: those behind it make room. */
void tm_tissue_raise_edge(tm_tissue *tissue, int32_t edge);
void tm_tissue_assemble_edge(tm_tissue *tissue, int32_t edge);
void tm_tissue_assemble_vertex(tm_tissue *tissue, int32_t vertex); /* after its edges */
/* The surface of the living tetrahedra from nothing, slots ascending by face. */
void tm_tissue_build_surface(tm_tissue *tissue);
/* Largest eigenvalue of M_e^-1 K_e, 1/s2. */
double tm_element_eigenvalue(const tm_tissue *tissue, int32_t tet);
/* The same with any masses (or weights) > 0 on its vertices, from above: at most 0.2 % too large. */
double tm_element_eigenvalue_over(const tm_tissue *tissue, int32_t tet, const double mass_kg[4]);
/* Lowers `most`, a bound of omega^2 of the living tetrahedra, if masses shared by demand give a lower one, and names
 * the tetrahedron that sets it. Not for a tissue that will be cut. False: no memory, nothing lowered. */
bool tm_shared_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet);
/* tm_critical_step_guaranteed, saying whether there was memory for all of it. */
bool tm_critical_step_find(const tm_tissue *tissue, double *step_s, int32_t *tet);
/* Leaves the eigenvalues of a symmetric 6x6 matrix on its diagonal: Jacobi rotations, accurate however far apart they
 * lie. */
void tm_diagonalise6(double A[36]);

struct tm_world {
    tm_pool pool;
    tm_state state;
    tm_tissue *tissue;
    bool damped, timing;
    int32_t revision;         /* of the tissue's surface that masses and stages know */
    double guaranteed_step_s; /* of the tissue at creation: cutting never lowers it */
    int32_t guaranteed_tet;
    double *mobility_s2_kg; /* [vertex_count] 1/(m/dt2 + gamma/2dt), 0 without mass: move per newton in a step */
    double *carry;          /* damped: [vertex_count] (m/dt2 - gamma/2dt) * mobility; else null */
    uint8_t *held_scratch;  /* [3*vertex_count] of tm_world_set_step */
    double *internal_N;     /* [3*vertex_count] where the stage "energy" wants the tissue's own force; else null */
    /* as they were when tm_world_step was called */
    double *keep_u_m, *keep_u_prev_m, *keep_force_N;
    int64_t keep_step;
    double keep_time_s;
    bool unsound;    /* a stage met a number that is not finite: the step fails */
    int32_t charged; /* slot on which time is booked at present, or TM_NO_SLOT */
    double charged_since_s;
    int32_t stage_count, step_count; /* step_count: those before TM_PHASE_BETWEEN */
    struct tm_stage_slot {
        tm_stage stage;
        int64_t bytes, runs;
        double seconds;
    } slot[TM_MAX_STAGES];
    void *support; /* self of the support stage, or null */
};

/* Stages that come and go together, all of one phase and one self; the memory is the first one's. All or none. */
tm_status tm_world_add_stages(tm_world *world, const tm_stage *stage, int32_t count, tm_phase phase, void *self,
                              int64_t bytes, tm_error *error);

/* --- whose time it is, when timing is on --- */
enum { TM_NO_SLOT = -1 };
/* From here on time is booked on this slot. */
void tm_world_charge(tm_world *world, int32_t slot);
/* Of the whole stage with this self, not of a part; TM_NO_SLOT: none. */
int32_t tm_world_slot_of(const tm_world *world, const void *self);

/* TM_ERR_STEP: not positive, above the guaranteed step or above what a stage allows. */
tm_status tm_world_check_step(const tm_world *world, double dt_s, tm_error *error);
/* Calls every stage's step_changed: dt changed or the tissue was cut. The integrator comes first, whatever its slot:
 * what others derive from mobilities they derive from the new ones. */
void tm_world_changed(tm_world *world);
/* The same after tm_cut_remove, at a cost that does not grow with the mesh: masses are looked at where it cut only. */
void tm_world_cut(tm_world *world);

/* Every world's own stages. */
void tm_stage_force_run(void *self, tm_world *world);
void tm_stage_integrate_run(void *self, tm_world *world);
void tm_stage_integrate_damped_run(void *self, tm_world *world);
/* Refreshes mobility and carry from masses, damping and dt; stops vertices that have lost their last tetrahedron. */
void tm_stage_integrate_changed(void *self, tm_world *world);
void tm_stage_integrate_refresh(tm_world *world, const int32_t *vertex, int32_t count);
/* Dead vertices are passed over by every stage: all three of u hold what u holds now. */
void tm_stage_integrate_still(tm_world *world);
/* The stages settle knows: with these alone the rest state is a linear system. */
void tm_stage_gravity_run(void *self, tm_world *world);
const double *tm_stage_gravity_m_s2(const void *self); /* [3] */
void tm_stage_load_run(void *self, tm_world *world);
void tm_stage_support_run(void *self, tm_world *world);
/* Writes the prescribed values into u. */
void tm_support_impose(const tm_world *world, double *u_m);

/* held.c: TM_ERR_SUPPORT if the supports leave a piece a rigid motion; with `load_N` [3*vertex_count], a loaded one. */
tm_status tm_check_held(const tm_world *world, const double *load_N, tm_error *error);

double tm_clock_s(void);

/* --- small vectors --- */
static inline double tm_dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static inline void tm_sub3(const double *a, const double *b, double *c) {
    for (int i = 0; i < 3; i++) c[i] = a[i] - b[i];
}
static inline void tm_cross3(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

#endif
