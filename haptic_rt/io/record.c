/* Records ticks as CSV, through a ring buffer. */
#include "record.h"

#include <inttypes.h>

#include "report.h"

static void write_header(FILE *file, const hrt_device_type *device) {
    fputs("time_s,state,fault,limits", file);
    for (int j = 0; j < device->joints; j++) fprintf(file, ",%s", device->joint[j].name);
    fputs(",fx_N,fy_N,fz_N", file);
    for (int j = 0; j < device->motors; j++) fprintf(file, ",%s", device->torque_name[j]);
    if (device->handle_torque_max_Nm > 0.0f) fputs(",torque_x_Nm,torque_y_Nm,torque_z_Nm", file);
    fputs(",gain,sample_age_s\n", file);
}

int hrt_record_begin(hrt_record *r, const hrt_device_type *device, const char *path) {
    const int bad = hrt_output_begin(&r->output, path);
    if (bad) return bad;
    r->device = device;
    r->file = app_output_stream(&r->output);
    if (!r->file) {
        app_output_abandon(&r->output);
        return app_bad_input(path, 0, "out of memory; close other programs"), APP_FAILED;
    }
    write_header(r->file, device);
    return APP_DONE;
}

/* Fills a row in the order of the device's header; returns its number of values. */
static int fill_row(const hrt_device_type *device, const hrt_result *o, float value[HRT_RECORD_FIELDS]) {
    int count = 0;
    value[count++] = (float)o->state;
    value[count++] = (float)o->fault;
    value[count++] = (float)o->limits;
    for (int j = 0; j < device->joints; j++) value[count++] = o->joint[j];
    for (int i = 0; i < 3; i++) value[count++] = o->force_N[i];
    for (int j = 0; j < device->motors; j++) value[count++] = o->torque[j];
    for (int i = 0; i < 3 && device->handle_torque_max_Nm > 0.0f; i++) value[count++] = o->handle_torque_Nm[i];
    value[count++] = o->gain;
    value[count++] = 1.0e-6f * (float)o->sample_age_us;
    return count;
}

void hrt_record_put(hrt_record *r, double time_s, const hrt_result *o) {
    const uint64_t put = atomic_load(&r->put);
    if (put - atomic_load(&r->written) >= HRT_RECORD_ROWS) {
        atomic_fetch_add(&r->lost, 1);
        return;
    }
    r->row[put % HRT_RECORD_ROWS].time_s = time_s;
    r->row[put % HRT_RECORD_ROWS].count = fill_row(r->device, o, r->row[put % HRT_RECORD_ROWS].value);
    atomic_store(&r->put, put + 1);
}

void hrt_record_write(hrt_record *r) {
    const uint64_t put = atomic_load(&r->put);
    for (uint64_t k = atomic_load(&r->written); k < put; k++) {
        fprintf(r->file, "%.9g", r->row[k % HRT_RECORD_ROWS].time_s);
        for (int c = 0; c < r->row[k % HRT_RECORD_ROWS].count; c++)
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
                         "%" PRIu64 " ticks are missing, as the disk was slower than the loop; record to a faster disk",
                         lost),
           APP_FAILED;
}

void hrt_record_abandon(hrt_record *r) {
    fclose(r->file);
    app_output_abandon(&r->output);
}
