/* Weights of the features (faces, edges, vertices) that a station of the tool's axis is near: not yes or no, but smooth
 * from one to the next (docs/contact.md, "Rows"). Lengths in m, radius_m the tool's. */
#ifndef LAW_FEATURE_H
#define LAW_FEATURE_H

#include "libtensormass/numeric/number.h"

#define LAW_BLEND LAW(0.2)     /* half width of the transition between neighbouring features, in radii */
#define LAW_PROXIMITY LAW(0.4) /* a feature that much (radii) farther than the nearest has no share */
#define LAW_SHARP LAW(0.25)    /* sine of the fold from which an edge or a vertex counts fully */
#define LAW_SUNK LAW(0.5)      /* a station may be that far (radii) behind a face that it does not know from before */
#define LAW_SUNK_KNOWN LAW(8)  /* and that far behind one that it does */
#define LAW_MARGIN LAW(0.2)    /* rows of a patch: gaps up to this (radii) */
#define LAW_MIN_RAW LAW(1e-3)
#define LAW_MIN_SHARE LAW(1e-6)
#define LAW_SMOOTH_COSINE LAW(0.766) /* normals blend fully across rest folds up to 40 degrees, */
#define LAW_CREASE_COSINE LAW(0.342) /* and not at all from 70 */

/* How far the undeformed surface is smooth across a fold: 0 a crease, 1 smooth. */
static inline law_real law_smooth(law_real cosine) {
    const law_real share = (cosine - LAW_CREASE_COSINE) / (LAW_SMOOTH_COSINE - LAW_CREASE_COSINE);
    return law_ramp(LAW(2) * share - LAW(1));
}

/* Of a fold by its sine, positive where it sticks out: 0 flat or hollow, 1 LAW_SHARP or more. */
static inline law_real law_sharpness(law_real sine) { return law_ramp(LAW(2) * sine / LAW_SHARP - LAW(1)); }

/* Half width of the transition across an edge, or, of its length, towards its ends. `room_m`: the height of the lower
 * triangle over it, or the length. */
static inline law_real law_transition(law_real radius_m, law_real room_m) {
    return law_min(LAW_BLEND * radius_m, LAW(0.25) * room_m);
}

/* What is left of a feature's weight when another is nearer. */
static inline law_real law_nearness(law_real distance_m, law_real nearest_m, law_real radius_m) {
    const law_real farther = (distance_m - nearest_m) / (LAW_PROXIMITY * radius_m);
    return law_ramp(LAW(1) - LAW(2) * farther);
}

/* Of the station's one skin. */
static inline law_real law_share(law_real weight, law_real total) { return weight / law_max(total, LAW_MIN_RAW); }

/* So deep behind a face, or beside it while behind it, is a station only if it touched it before. */
static inline bool law_wants_history(law_real height_m, law_real outside_m, law_real radius_m) {
    return height_m < -LAW_SUNK * radius_m || (height_m < LAW(0) && outside_m > LAW(0));
}

/* It sinks little by little: a deep place is looked for only where a row has begun to sink. */
static inline bool law_sinks(law_real gap_m, law_real lambda_N, law_real radius_m) {
    return lambda_N > LAW(0) && gap_m < -(LAW(0.7) + LAW_SUNK) * radius_m;
}

/* A blended normal is used unless the surface is folded over itself: its length before it was made one, and its cosine
 * with the face's own. */
static inline bool law_normal_stands(law_real length, law_real cosine) {
    return length > LAW(0.1) && !(cosine < LAW(0.2));
}

#endif
