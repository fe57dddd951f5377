#include "record.h"

#include <inttypes.h>
#include <string.h>

#include "engine.h"
#include "report.h"

int hrt_record_begin(hrt_record *r, const char *path) {
    const int bad = hrt_output_begin(&r->output, path);
    if (bad) return bad;
    r->file = app_output_stream(&r->output);
    if (!r->file) {
        app_output_abandon(&r->output);
        return app_bad_input(path, 0, "out of memory; close other programs"), APP_FAILED;
    }
    fputs("time_s,state,fault,limits," HRT_ENGINE_FIELDS
          ",fx_N,fy_N,fz_N,torque_pitch_Nm,torque_yaw_Nm,force_insertion_N,gain,sample_age_s\n",
          r->file);
    return APP_DONE;
}

void hrt_record_put(hrt_record *r, double time_s, const hrt_result *o) {
    const uint64_t put = atomic_load(&r->put);
    if (put - atomic_load(&r->written) >= HRT_RECORD_ROWS) {
        atomic_fetch_add(&r->lost, 1);
        return;
    }
    const float values[HRT_RECORD_FIELDS] = {
        (float)o->state, (float)o->fault, (float)o->limits, o->joint[0],
        o->joint[1],     o->joint[2],     o->joint[3],      o->joint[4],
        o->force_N[0],   o->force_N[1],   o->force_N[2],    o->torque[0],
        o->torque[1],    o->torque[2],    o->gain,          1.0e-6f * (float)o->sample_age_us};
    r->row[put % HRT_RECORD_ROWS].time_s = time_s;
    memcpy(r->row[put % HRT_RECORD_ROWS].value, values, sizeof values);
    atomic_store(&r->put, put + 1);
}

void hrt_record_write(hrt_record *r) {
    const uint64_t put = atomic_load(&r->put);
    for (uint64_t k = atomic_load(&r->written); k < put; k++) {
        fprintf(r->file, "%.9g", r->row[k % HRT_RECORD_ROWS].time_s);
        for (int c = 0; c < HRT_RECORD_FIELDS; c++)
            fprintf(r->file, ",%.9g", (double)r->row[k % HRT_RECORD_ROWS].value[c]);
        fputc('\n', r->file);
        atomic_store(&r->written, k + 1);
    }
}

int hrt_record_end(hrt_record *r) {
    hrt_record_write(r);
    const int code = hrt_output_end(&r->output, r->file);
    const uint64_t lost = atomic_load(&r->lost);
    if (lost == 0) return code;
    return app_bad_input(r->output.path, 0,
                         "%" PRIu64 " ticks are missing: the disk was slower than the loop; record to a faster one",
                         lost),
           APP_FAILED;
}

void hrt_record_abandon(hrt_record *r) {
    fclose(r->file);
    app_output_abandon(&r->output);
}
