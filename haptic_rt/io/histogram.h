/* Quantiles from a histogram of fixed size: 16 cells per octave (relative error below 1/16), 1 ns to 17 s, no
 * allocation. */
#ifndef HRT_HISTOGRAM_H
#define HRT_HISTOGRAM_H

#include <stdint.h>

enum { HRT_HISTOGRAM_CELLS = 34 * 16 };
typedef struct hrt_histogram {
    uint64_t count;
    int64_t max_ns;
    uint32_t cell[HRT_HISTOGRAM_CELLS];
} hrt_histogram;

static inline int hrt_histogram_cell(int64_t ns) {
    if (ns < 16) return ns < 0 ? 0 : (int)ns;
    const int octave = 63 - __builtin_clzll((unsigned long long)ns);
    const int cell = (octave - 3) * 16 + (int)((ns >> (octave - 4)) & 15);
    return cell < HRT_HISTOGRAM_CELLS ? cell : HRT_HISTOGRAM_CELLS - 1;
}
static inline void hrt_histogram_add(hrt_histogram *h, int64_t ns) {
    h->cell[hrt_histogram_cell(ns)]++;
    h->count++;
    if (ns > h->max_ns) h->max_ns = ns;
}
/* Returns the upper edge of the cell that holds the quantile, at most the maximum, us; 0 if empty. */
static inline double hrt_histogram_us(const hrt_histogram *h, double quantile) {
    const double wanted = quantile * (double)h->count;
    uint64_t seen = 0;
    for (int c = 0; c < HRT_HISTOGRAM_CELLS; c++) {
        seen += h->cell[c];
        if (seen == 0 || (double)seen < wanted) continue;
        const int octave = c / 16 + 3;
        const int64_t edge = c < 16 ? c + 1 : ((int64_t)(16 + c % 16 + 1)) << (octave - 4);
        return 1.0e-3 * (double)(edge < h->max_ns ? edge : h->max_ns);
    }
    return 1.0e-3 * (double)h->max_ns;
}
static inline void hrt_histogram_quantiles(const hrt_histogram *h, double us[4]) {
    us[0] = hrt_histogram_us(h, 0.5);
    us[1] = hrt_histogram_us(h, 0.99);
    us[2] = hrt_histogram_us(h, 0.999);
    us[3] = 1.0e-3 * (double)h->max_ns;
}

struct cJSON;
/* Adds {"p50": ..., "p99": ..., "p999": ..., "max": ...} to the report, in microseconds. */
void hrt_report_quantiles(struct cJSON *json, const char *name, const hrt_histogram *h);
void hrt_print_quantiles(const char *name, const hrt_histogram *h);

#endif
