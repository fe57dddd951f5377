/* Recorded force samples instead of a simulation: CSV as `tm-sim --samples` writes it, or by hand. Needed:
 * time_s,fx_N,fy_N,fz_N. Also read: instrument, px_m,py_m,pz_m (world; else the tool's own tip), kxx..kzz (N/m). */
#ifndef HRT_SAMPLES_H
#define HRT_SAMPLES_H

#include "csv_table.h"
#include "node.h"

typedef struct hrt_samples {
    hrt_table table;
    int32_t time, instrument, force[3], tip[3], stiffness[9]; /* fields; -1: none */
    int32_t next;
    uint32_t seq;
    int64_t start_us; /* 0: not begun */
} hrt_samples;

bool hrt_samples_read(hrt_samples *samples, const char *path);
/* Posts what is due. Time begins with the first call in which `tool` says idle. False: all are given. */
bool hrt_samples_feed(hrt_samples *samples, hrt_node *node, const tensormass_tool_state_t *tool, int64_t now_us);

#endif
