/* Snapshot form of a contact row, without padding: equal rows have equal bytes, and no stack contents leak. Shared with
 * libtensormass_solve. */
#ifndef TM_ROW_SNAPSHOT_H
#define TM_ROW_SNAPSHOT_H

#include <string.h>

#include "tensormass/contact.h"

typedef struct tm_packed_row {
    double share, weight[3], normal[3], point_m[3], gap_m, lambda_N;
    int32_t face, vertex[3], instrument, station, feature, reserved;
} tm_packed_row;

static inline tm_packed_row tm_row_pack(const tm_contact_row *row) {
    tm_packed_row p = {.share = row->share,
                       .gap_m = row->gap_m,
                       .lambda_N = row->lambda_N,
                       .face = row->face,
                       .instrument = row->instrument,
                       .station = row->station,
                       .feature = row->feature};
    memcpy(p.weight, row->weight, sizeof p.weight);
    memcpy(p.normal, row->normal, sizeof p.normal);
    memcpy(p.point_m, row->point_m, sizeof p.point_m);
    memcpy(p.vertex, row->vertex, sizeof p.vertex);
    return p;
}

static inline tm_contact_row tm_row_unpack(const tm_packed_row *p) {
    tm_contact_row row = {.share = p->share,
                          .gap_m = p->gap_m,
                          .lambda_N = p->lambda_N,
                          .face = p->face,
                          .instrument = p->instrument,
                          .station = p->station,
                          .feature = p->feature};
    memcpy(row.weight, p->weight, sizeof row.weight);
    memcpy(row.normal, p->normal, sizeof row.normal);
    memcpy(row.point_m, p->point_m, sizeof row.point_m);
    memcpy(row.vertex, p->vertex, sizeof row.vertex);
    return row;
}

#endif
