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
    uint8_t *keep;                     /* [tet_count] 1: no cautery removes it; or null */
    double credit[TM_MAX_INSTRUMENTS]; /* tetrahedra that it may still remove */
    double removal_distance_m;
    /* removed tetrahedra, for tm_cut_fetch_removed */
    int32_t log_begin, log_count;
    int32_t *log_tet; /* [tet_count] */
    int8_t *log_instrument;
    tm_fading_rows fading; /* rows on removed tetrahedra; fade_s 0: they vanish at once */
    /* the search for detached fragments */
    search state;
    bool waits;       /* "cut search" has work in this substep */
    int32_t revision; /* revision of the surface at its start */
    int32_t pause;
    bool falling; /* the last search left detached fragments */
    int32_t queue_begin, queue_end, seed_at, sweep_at;
    uint8_t *reached; /* [tet_count] */
    int32_t *queue;   /* [tet_count] reached, without the seeds */
    /* seeds of the search: tetrahedra held by supports */
    int32_t supports_set; /* count of the world's support changes when they were listed */
    bool any_support;
    int32_t seed_count, *seed;  /* [tet_count] */
    uint8_t *is_seed;           /* [tet_count] */
    uint8_t *fixed;             /* [3*vertex_count] */
    int32_t visits, max_visits; /* tetrahedra visited in this substep; maximum per substep */
    /* state at the start of the step */
    void *saved;
    int64_t saved_bytes;
    int32_t saved_log_begin, saved_log_count;
} tm_cut_stage;

/* cut_search.c. Lists the tetrahedra held by supports if supports have changed: then O(mesh), else O(1). */
void tm_cut_update_seeds(tm_cut_stage *stage, tm_world *world);
/* Begin and continue a search. Each call visits a bounded number of tetrahedra, for any mesh size. */
void tm_cut_begin_search(tm_cut_stage *stage, tm_world *world);
void tm_cut_flood(tm_cut_stage *stage, const tm_tissue *tissue);
/* Returns the maximum number of tetrahedra visited in one substep. */
int32_t tm_cut_max_visits(const tm_world *world);

#endif
