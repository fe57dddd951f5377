/* State of the stage "cut", shared by its two files. */
#ifndef TM_CUT_INTERNAL_H
#define TM_CUT_INTERNAL_H

#include "contact/contact_internal.h"
#include "tensormass/cut.h"

typedef enum search { SEARCH_IDLE, SEARCH_REACH, SEARCH_SWEEP } search;

typedef struct tm_cut_stage {
    tm_pool pool;
    tm_contact *contact;
    double rate_1_s;
    tm_cut_loose loose;
    double credit[TM_MAX_INSTRUMENTS]; /* tetrahedra it may still take */
    double removal_distance_m;
    /* what was removed, for tm_cut_fetch_removed */
    int32_t log_begin, log_count;
    int32_t *log_tet; /* [tet_count] */
    int8_t *log_instrument;
    tm_fading_rows fading; /* rows on what was removed; fade_s 0: they go at once */
    /* the search for detached fragments */
    search state;
    bool waits;       /* for "cut search" to go on, in this substep */
    int32_t revision; /* of the surface when it began */
    int32_t pause;
    bool falling; /* the last search left detached fragments */
    int32_t queue_begin, queue_end, seed_at, sweep_at;
    uint8_t *reached; /* [tet_count] */
    int32_t *queue;   /* [tet_count] reached; seeds are not among them */
    /* tetrahedra that supports hold: where it begins */
    int32_t supports_set; /* of the world when they were listed */
    bool any_support;
    int32_t seed_count, *seed;  /* [tet_count] */
    uint8_t *is_seed;           /* [tet_count] */
    uint8_t *fixed;             /* [3*vertex_count] */
    int32_t visits, max_visits; /* looks at a tetrahedron in this substep; the most in one */
    /* when the step began */
    void *saved;
    int64_t saved_bytes;
    int32_t saved_log_begin, saved_log_count;
} tm_cut_stage;

/* cut_search.c. Lists the tetrahedra that supports hold, if supports were set since; O(mesh) then, else O(1). */
void tm_cut_update_seeds(tm_cut_stage *stage, tm_world *world);
/* Begins a search, and goes on with it: each visits a bounded number of tetrahedra, whatever the size of the mesh. */
void tm_cut_begin_search(tm_cut_stage *stage, tm_world *world);
void tm_cut_flood(tm_cut_stage *stage, const tm_tissue *tissue);
/* The most tetrahedra that the search has looked at in one substep. */
int32_t tm_cut_max_visits(const tm_world *world);

#endif
