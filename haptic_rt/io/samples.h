/* Force samples from a file instead of a simulation: CSV from `tm-sim --samples` or by hand. Required:
 * time_s,fx_N,fy_N,fz_N. Optional: instrument; px_m,py_m,pz_m (world; default: the tool's own tip); kxx..kzz (N/m). */
#ifndef HRT_SAMPLES_H
#define HRT_SAMPLES_H

#include "csv_table.h"
#include "node.h"

typedef struct hrt_samples {
    hrt_table table;
    int32_t time, instrument, force[3], tip[3], stiffness[9]; /* columns; -1: none */
    int32_t next;
    uint32_t seq;
    int64_t start_us; /* 0: not started */
} hrt_samples;

bool hrt_samples_read(hrt_samples *samples, const char *path);
/* Posts the samples that are due. Time starts at the first call in which `tool` reports idle. Returns false if none is
 * left. */
bool hrt_samples_feed(hrt_samples *samples, hrt_node *node, const tensormass_tool_state_t *tool, int64_t now_us);

#endif
