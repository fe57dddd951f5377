/* The force itself, before any extrapolation: its second difference from tick to tick at 500 frames a second, from
 * shallow to deep. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "evaluate.h"
#include "json_file.h"

static int one(model m, double depth_m, cJSON *rows) {
    path p = path_make(PATH_TOUR, 0.01, 0);
    p.depth_m = depth_m;
    recording r = {0};
    if (record_truth(m, &p, false, &r)) return APP_FAILED;
    double *second = malloc(sizeof *second * (size_t)r.ticks), most = 0;
    int count = 0;
    if (!second) abort();
    for (int k = 1; k + 1 < r.ticks; k++) {
        const float *a = r.truth_N + 3 * (k - 1), *b = a + 3, *c = b + 3;
        double d2 = 0, na = 0, nb = 0, nc = 0;
        for (int i = 0; i < 3; i++) {
            double d = (double)c[i] - 2 * (double)b[i] + (double)a[i];
            d2 += d * d, na += fabs((double)a[i]), nb += fabs((double)b[i]), nc += fabs((double)c[i]);
        }
        if (na == 0 || nb == 0 || nc == 0) continue; /* contact made or lost */
        second[count++] = sqrt(d2) / r.peak_N;
        most = fmax(most, second[count - 1]);
    }
    app_json_add(rows, "model %s depth_m %g largest %g p99 %g peak_N %g ticks %d", model_name[m], depth_m, most,
                 app_percentile(second, count, 0.99), r.peak_N, count);
    free(second);
    recording_free(&r);
    return 0;
}

int study_roughness(const study_run *run, cJSON *rows) {
    static const double depths_m[] = {0.001, 0.002, 0.003, 0.005, 0.008};
    int count = (int)(sizeof depths_m / sizeof *depths_m);
    for (int m = 0; m < MODEL_COUNT; m++)
        for (int d = 0; d < count; d++) {
            if (!run->model[m] || ((run->quick || m == MODEL_HYBRID) && d != 2)) continue;
            progress("roughness", (m * count + d + 1.0) / (MODEL_COUNT * count));
            const int rc = one((model)m, depths_m[d], rows);
            if (rc) return rc;
        }
    return 0;
}
