/* What the room `tissue` gives: the inside of a tissue, its assembly, its critical step, and what removing tetrahedra
 * has touched. */
#ifndef TM_TISSUE_INTERNAL_H
#define TM_TISSUE_INTERNAL_H

#include "material/strain_smoothing.h"
#include "tensormass/tissue.h"
#include "tissue/force_graph.h"

enum { TM_COOKIE_TISSUE = 0x74697373 };

struct tm_tissue {
    tm_pool pool;
    const tm_mesh *mesh;
    tm_material *material; /* [material_count] */
    int32_t material_count;
    int32_t *region_material; /* [region_count] */
    double *fibre;            /* [3*tet_count] or null */
    tm_precision precision;
    bool cuttable, plain; /* plain: the force loop's form */
    double *stiffest_Pa;  /* [material_count] bound of d2W/dF2 of nonlinear laws; null: all are linear */
    double rotation;      /* threshold of the stage "rotation", 0: no such stage may come */
    uint8_t *alive;       /* [tet_count] */
    int32_t alive_count;
    uint8_t *condensed;             /* [tet_count] or null: there, but not ours */
    double *mass_kg, *damping_kg_s; /* [vertex_count] */
    double *physical_mass_kg;       /* [vertex_count] without what scaling adds; mass_kg itself: no scaling */
    double scaled_step_s,
        *required_mass_kg; /* [4*tet_count] in the order of mesh->vertex_tet, or null (mass_scaling.c) */
    double *extra_mass_kg, *extra_damping_kg_s; /* [vertex_count] or null */
    tm_force_graph graph;
    int32_t pair_count;
    const int32_t *pair;           /* [2*pair_count] the graph's edges k<l, ascending: the mesh's, or more (smoothed) */
    tm_smoothed *smoothed;         /* null: linear tetrahedra */
    struct tm_smoothed_rows *rows; /* of smoothed tissue (tissue/strain_smoothing_pairs.h) */
    int32_t *edge_index;  /* [pair_count] place of a living one in the graph, -1: dead; null: every one lives, in its
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
    struct tm_cut_work *cut;                  /* cuttable: marks and queues of cut*.c */
    int32_t undo_count;                       /* tetrahedra removed since a step began, and can be given back */
    int32_t saved_revision;                   /* of the surface then */
};

/* What laws read of it. */
static inline tm_material_field tm_tissue_field(const tm_tissue *tissue) {
    return (tm_material_field){.mesh = tissue->mesh,
                               .alive = tissue->alive,
                               .material = tissue->material,
                               .region_material = tissue->region_material,
                               .fibre = tissue->fibre,
                               .smoothed = tissue->smoothed,
                               .rotation = tissue->rotation,
                               .stiffest_Pa = tissue->stiffest_Pa,
                               .material_count = tissue->material_count,
                               .plain = tissue->plain};
}
/* The tissue that is left when all has relaxed: shares `shear` and `volume` of the moduli, the same living tetrahedra.
 * TM_ERR_MEMORY. */
tm_status tm_tissue_relaxed(const tm_tissue *tissue, double shear, double volume, tm_tissue **out, tm_error *error);

/* --- assembly, shared by create and cut; all sums ascending over living tetrahedra --- */
/* Keeps the blocks and shares of every tetrahedron of a cuttable tissue, so that a sum reads straight on. */
void tm_tissue_keep_blocks(tm_tissue *tissue);
/* Place of a pair (an edge, where nothing is smoothed) in the graph, -1: dead. */
static inline int32_t tm_tissue_edge_index(const tm_tissue *tissue, int32_t pair) {
    return tissue->edge_index ? tissue->edge_index[pair] : pair;
}
bool tm_tissue_edge_lives(const tm_tissue *tissue, int32_t edge);
/* Takes the slot of an edge that has died; those behind it in the room move up. */
void tm_tissue_drop_edge(tm_tissue *tissue, int32_t edge);
/* The reverse, unless it has one: those behind it make room. */
void tm_tissue_raise_edge(tm_tissue *tissue, int32_t edge);
void tm_tissue_assemble_edge(tm_tissue *tissue, int32_t edge);
/* Everything from nothing, as the tetrahedra live. False: no memory (smoothed and not cuttable only). */
bool tm_tissue_assemble(tm_tissue *tissue);
/* What these vertices and edges have after a cut, or after it was taken back. */
void tm_tissue_assemble_touched(tm_tissue *tissue, const int32_t *vertex, int32_t vertices, const int32_t *edge,
                                int32_t edges);
/* The pair k<l, or -1. */
int32_t tm_tissue_find_pair(const tm_tissue *tissue, int32_t k, int32_t l);
/* Every face of the mesh, once: no subset of its tetrahedra has a larger surface. */
static inline int32_t tm_tissue_faces_max(const tm_mesh *mesh) {
    return (int32_t)((4 * (int64_t)mesh->tet_count + mesh->surface_count) / 2);
}
/* The surface of the living tetrahedra from nothing, slots ascending by face. */
void tm_tissue_build_surface(tm_tissue *tissue);
/* Largest eigenvalue of M_e^-1 K_e, 1/s2. */
double tm_element_eigenvalue(const tm_tissue *tissue, int32_t tet);
/* The same; not computed, and 0 returned, when even the trace stays under `floor`. */
double tm_element_eigenvalue_above(const tm_tissue *tissue, int32_t tet, double floor);
/* The same with any masses (or weights) > 0 on its vertices, from above: at most 0.2 % too large. */
double tm_element_eigenvalue_over(const tm_tissue *tissue, int32_t tet, const double mass_kg[4]);
/* Lowers `most`, a bound of omega^2 of the living tetrahedra, if masses shared by demand give a lower one, and names
 * the tetrahedron that sets it. Not for a tissue that will be cut. False: no memory, nothing lowered. */
bool tm_shared_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet);
/* What rounding may add to the largest eigenvalue, relative. */
double tm_critical_margin(const tm_tissue *tissue);
/* tm_critical_step_guaranteed, saying whether there was memory for all of it. */
bool tm_critical_step_find(const tm_tissue *tissue, double *step_s, int32_t *tet);

/* --- removal of tetrahedra (tm_cut_remove) --- */
/* Removed by the last call, repairing included; returns how many. */
int32_t tm_cut_removed(const tm_tissue *tissue, const int32_t **tet);
/* Vertices that the last call touched. */
int32_t tm_cut_touched(const tm_tissue *tissue, const int32_t **vertex);
/* From here on what is removed can be given back. */
static inline void tm_cut_begin(tm_tissue *tissue) {
    tissue->undo_count = 0;
    tissue->saved_revision = tissue->surface.revision;
}
/* Gives back what was removed since tm_cut_begin: tensors, masses, surface and its slots have the bits they had. False:
 * nothing was. tm_cut_touched names the vertices. */
bool tm_cut_rollback(tm_tissue *tissue);

/* --- as a snapshot has it --- */
/* Slots name exactly the outer faces of the living tetrahedra, each once. A tissue that cannot be cut has one surface
 * only. */
bool tm_tissue_surface_fits(const tm_tissue *tissue, const uint8_t *alive, const int32_t *face, int32_t count);
/* Takes them: as if it had been cut until just these live, with the surface in these slots. */
void tm_tissue_restore(tm_tissue *tissue, const uint8_t *alive, const int32_t *face, int32_t count);

/* --- selective mass scaling: what a step asks vertices to weigh --- */

/* Fills tissue->required_mass_kg for tissue->scaled_step_s; before assembly, whatever lives. False: no memory. */
bool tm_scaled_demand(tm_tissue *tissue);
/* After assembly: TM_ERR_LIMIT, naming the vertex that was added most to, above `most_share`. */
tm_status tm_scaled_check(const tm_tissue *tissue, double most_share, tm_error *error);

#endif
