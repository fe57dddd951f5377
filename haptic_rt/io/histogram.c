/* Reports quantiles as JSON and as text. */
#include "histogram.h"

#include <stdio.h>

#include "json_file.h"

void hrt_report_quantiles(cJSON *json, const char *name, const hrt_histogram *h) {
    double us[4];
    hrt_histogram_quantiles(h, us);
    app_json_add(cJSON_AddObjectToObject(json, name), "p50 %g p99 %g p999 %g max %g", us[0], us[1], us[2], us[3]);
}

void hrt_print_quantiles(const char *name, const hrt_histogram *h) {
    double us[4];
    hrt_histogram_quantiles(h, us);
    printf("  %-10s p50 %8.1f  p99 %8.1f  p99.9 %8.1f  max %8.1f us\n", name, us[0], us[1], us[2], us[3]);
}
