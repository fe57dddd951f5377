/* Weights of the features (faces, edges, vertices) near a station of the tool's axis. They change smoothly from one
 * feature to the next (docs/contact.md, "Rows"). Lengths in m; radius_m is the tool's. */
#ifndef LAW_FEATURE_H
#define LAW_FEATURE_H

#include "libtensormass/numeric/number.h"

#define LAW_BLEND LAW(0.2)     /* half width of the transition between neighbouring features, in radii */
#define LAW_PROXIMITY LAW(0.4) /* extra distance (radii) at which a feature other than the nearest has weight 0 */
#define LAW_SHARP LAW(0.25)    /* sine of the fold angle from which an edge or a vertex has full weight */
#define LAW_SUNK LAW(0.5)      /* maximum depth of a station behind a face without history, in radii */
#define LAW_SUNK_KNOWN LAW(8)  /* the same with history (a row there before), in radii */
#define LAW_MARGIN LAW(0.2)    /* maximum gap of a patch's rows, in radii */
#define LAW_MIN_RAW LAW(1e-3)
#define LAW_MIN_SHARE LAW(1e-6)
#define LAW_SMOOTH_COSINE LAW(0.766) /* normals blend fully across undeformed folds up to 40 degrees */
#define LAW_CREASE_COSINE LAW(0.342) /* and not at all from 70 */

/* Returns the smoothness of the undeformed surface at a fold: 0 crease, 1 smooth. */
static inline law_real law_smooth(law_real cosine) {
    const law_real share = (cosine - LAW_CREASE_COSINE) / (LAW_SMOOTH_COSINE - LAW_CREASE_COSINE);
    return law_ramp(LAW(2) * share - LAW(1));
}

/* Returns the sharpness of a fold from its sine (positive if convex): 0 flat or concave, 1 from LAW_SHARP. */
static inline law_real law_sharpness(law_real sine) { return law_ramp(LAW(2) * sine / LAW_SHARP - LAW(1)); }

/* Returns the half width of the transition across an edge, m, or towards its ends, relative to its length. `room_m`:
 * the lower triangle's height over the edge, or the edge's length. */
static inline law_real law_transition(law_real radius_m, law_real room_m) {
    return law_min(LAW_BLEND * radius_m, LAW(0.25) * room_m);
}

/* Returns the factor of a feature's weight if another one is nearer. */
static inline law_real law_nearness(law_real distance_m, law_real nearest_m, law_real radius_m) {
    const law_real farther = (distance_m - nearest_m) / (LAW_PROXIMITY * radius_m);
    return law_ramp(LAW(1) - LAW(2) * farther);
}

/* Returns the share of the station's contact compliance. */
static inline law_real law_share(law_real weight, law_real total) { return weight / law_max(total, LAW_MIN_RAW); }

/* Returns whether a station this deep behind a face, or behind and outside it, requires history to be in contact. */
static inline bool law_wants_history(law_real height_m, law_real outside_m, law_real radius_m) {
    return height_m < -LAW_SUNK * radius_m || (height_m < LAW(0) && outside_m > LAW(0));
}

/* Returns whether a loaded row has begun to sink. Only then are deep positions searched: a station sinks gradually. */
static inline bool law_sinks(law_real gap_m, law_real lambda_N, law_real radius_m) {
    return lambda_N > LAW(0) && gap_m < -(LAW(0.7) + LAW_SUNK) * radius_m;
}

/* Returns whether a blended normal is usable: not if the surface is folded over itself. Arguments: its length before
 * normalisation, and its cosine with the face's own normal. */
static inline bool law_normal_stands(law_real length, law_real cosine) {
    return length > LAW(0.1) && !(cosine < LAW(0.2));
}

#endif
