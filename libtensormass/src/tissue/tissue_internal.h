/* Internals of tissue: its data, assembly, critical step, and removal of tetrahedra. */
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
    tm_precision precision;   /* of the tensors */
    bool has_single_law;      /* the step computes the nonlinear law, or rotation, in single precision */
    bool cuttable, plain;     /* plain: the force loop's form */
    double *stiffest_Pa;      /* [material_count] bound of d2W/dF2 of nonlinear laws; null: all are linear */
    uint8_t *effects;         /* [region_count] sums of tm_region_effect; null: all act everywhere */
    double rotation;          /* threshold of the stage "rotation", 0: the stage is not allowed */
    uint8_t *alive;           /* [tet_count] */
    int32_t alive_count;
    uint8_t *condensed;             /* [tet_count] or null: present, but in another model */
    double *mass_kg, *damping_kg_s; /* [vertex_count] */
    double *physical_mass_kg;       /* [vertex_count] without mass scaling; mass_kg itself: no scaling */
    double scaled_step_s,
        *required_mass_kg; /* [4*tet_count] in the order of mesh->vertex_tet, or null (mass_scaling.c) */
    double *extra_mass_kg, *extra_damping_kg_s; /* [vertex_count] or null */
    tm_force_graph graph;
    int32_t pair_count;
    const int32_t *pair;   /* [2*pair_count] the graph's edges k<l, ascending: the mesh's, or more (strain smoothing) */
    tm_smoothed *smoothed; /* null: linear tetrahedra */
    struct tm_smoothed_rows *rows; /* of smoothed tissue (tissue/strain_smoothing_pairs.h) */
    int32_t *edge_index;  /* [pair_count] index of an active pair in the graph, -1: removed; null: every pair is active,
                             at its own number */
    double *vertex_block; /* cuttable, double: [9*4*tet_count] blocks K_kk in the order of mesh->vertex_tet, so that
                             sums read contiguously; else null */
    double *edge_block;   /* cuttable: [9*6*tet_count] in the order of mesh->edge_tet */
    double *vertex_share; /* cuttable: [2*4*tet_count] mass and damping shares of a tetrahedron, in the order of
                             mesh->vertex_tet */
    tm_force_kernel force;
    tm_surface_view surface;                  /* views the mesh's own arrays where it cannot differ from them */
    int32_t *surface_triangle, *surface_face; /* writable, or null when viewing the mesh's */
    int32_t *face_slot;                       /* cuttable: [4*tet_count] index of a face in the surface, -1 */
    struct tm_cut_work *cut;                  /* cuttable: marks and queues of cut*.c */
    int32_t undo_count;                       /* tetrahedra removed since the checkpoint, which can be restored */
    int32_t saved_revision;                   /* revision of the surface at the checkpoint */
};

/* Returns the view that laws read. */
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
                               .effects = tissue->effects,
                               .plain = tissue->plain};
}
/* Creates the relaxed tissue: shares `shear` and `volume` of the moduli, the same active tetrahedra. TM_ERR_MEMORY. */
tm_status tm_tissue_relaxed(const tm_tissue *tissue, double shear, double volume, tm_tissue **out, tm_error *error);

/* --- assembly, shared by create and cut; all sums ascending over active tetrahedra --- */
/* Stores the blocks and shares of every tetrahedron of a cuttable tissue, so that sums read contiguously. */
void tm_tissue_keep_blocks(tm_tissue *tissue);
/* Returns the index of a pair (an edge, without smoothing) in the graph, -1: removed. */
static inline int32_t tm_tissue_edge_index(const tm_tissue *tissue, int32_t pair) {
    return tissue->edge_index ? tissue->edge_index[pair] : pair;
}
bool tm_tissue_edge_lives(const tm_tissue *tissue, int32_t edge);
/* Removes the slot of a removed edge; later ones of the same vertex move up. */
void tm_tissue_drop_edge(tm_tissue *tissue, int32_t edge);
/* Inserts the slot of an edge, unless it has one; later ones of the same vertex move back. */
void tm_tissue_raise_edge(tm_tissue *tissue, int32_t edge);
void tm_tissue_assemble_edge(tm_tissue *tissue, int32_t edge);
/* Assembles everything from the active tetrahedra. Returns false without memory (smoothed and not cuttable only). */
bool tm_tissue_assemble(tm_tissue *tissue);
/* Reassembles these vertices and edges, after a cut or its rollback. */
void tm_tissue_assemble_touched(tm_tissue *tissue, const int32_t *vertex, int32_t vertices, const int32_t *edge,
                                int32_t edges);
/* Returns the pair k<l, or -1. */
int32_t tm_tissue_find_pair(const tm_tissue *tissue, int32_t k, int32_t l);
/* Counts every face of the mesh once: no subset of its tetrahedra has a larger surface. */
static inline int32_t tm_tissue_faces_max(const tm_mesh *mesh) {
    return (int32_t)((4 * (int64_t)mesh->tet_count + mesh->surface_count) / 2);
}
/* Builds the surface of the active tetrahedra anew, slots ascending by face. */
void tm_tissue_build_surface(tm_tissue *tissue);
/* Returns the largest eigenvalue of M_e^-1 K_e, 1/s2. */
double tm_element_eigenvalue(const tm_tissue *tissue, int32_t tet);
/* The same; returns 0 without computing it if even the trace is below `floor`. */
double tm_element_eigenvalue_above(const tm_tissue *tissue, int32_t tet, double floor);
/* The same with any masses (or weights) > 0 on its vertices, as an upper bound: at most 0.2 % too large. */
double tm_element_eigenvalue_over(const tm_tissue *tissue, int32_t tet, const double mass_kg[4]);
/* Lowers `most`, a bound of omega^2 of the active tetrahedra, if masses shared by demand give a lower one; writes the
 * tetrahedron that sets it. Not for a tissue that will be cut. Returns false without memory, `most` unchanged. */
bool tm_shared_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet);
/* Returns the relative error that rounding may add to the largest eigenvalue. */
double tm_critical_margin(const tm_tissue *tissue);
/* As tm_critical_step_guaranteed; returns false if memory sufficed for a part of it only. */
bool tm_critical_step_find(const tm_tissue *tissue, double *step_s, int32_t *tet);

/* --- removal of tetrahedra (tm_cut_remove) --- */
/* Returns how many the last call removed, repair included. */
int32_t tm_cut_removed(const tm_tissue *tissue, const int32_t **tet);
/* Returns the vertices that the last call touched. */
int32_t tm_cut_touched(const tm_tissue *tissue, const int32_t **vertex);
/* Begins a checkpoint: later removals can be rolled back. */
static inline void tm_cut_begin(tm_tissue *tissue) {
    tissue->undo_count = 0;
    tissue->saved_revision = tissue->surface.revision;
}
/* Restores the tetrahedra removed since tm_cut_begin. Tensors, masses, surface and its slots are bit-identical to
 * before. Returns false if there were none. tm_cut_touched lists the vertices. */
bool tm_cut_rollback(tm_tissue *tissue);

/* --- snapshots --- */
/* Returns whether the slots hold exactly the outer faces of the active tetrahedra, each once. A tissue that cannot be
 * cut has one surface only. */
bool tm_tissue_surface_fits(const tm_tissue *tissue, const uint8_t *alive, const int32_t *face, int32_t count);
/* Restores these active tetrahedra, with the surface in these slots, as if the tissue had been cut so far. */
void tm_tissue_restore(tm_tissue *tissue, const uint8_t *alive, const int32_t *face, int32_t count);

/* --- selective mass scaling: mass that a step requires at vertices --- */

/* Fills tissue->required_mass_kg for tissue->scaled_step_s, before assembly, for any active set. Returns false without
 * memory. */
bool tm_scaled_demand(tm_tissue *tissue);
/* After assembly: TM_ERR_LIMIT where added mass exceeds `most_share`, with the vertex that got most. */
tm_status tm_scaled_check(const tm_tissue *tissue, double most_share, tm_error *error);

#endif
