/* Quantiles told: as JSON and as a line. */
#include "histogram.h"

#include <cjson/cJSON.h>
#include <stdio.h>

static const char *const quantile_name[4] = {"p50", "p99", "p999", "max"};

void hrt_report_quantiles(cJSON *json, const char *name, const hrt_histogram *h) {
    double us[4];
    hrt_histogram_quantiles(h, us);
    cJSON *row = cJSON_AddObjectToObject(json, name);
    for (int q = 0; q < 4; q++) cJSON_AddNumberToObject(row, quantile_name[q], us[q]);
}

void hrt_print_quantiles(const char *name, const hrt_histogram *h) {
    double us[4];
    hrt_histogram_quantiles(h, us);
    printf("  %-10s p50 %8.1f  p99 %8.1f  p99.9 %8.1f  max %8.1f us\n", name, us[0], us[1], us[2], us[3]);
}
