/* Output files and the JSON that every mode reports. */
#include <cjson/cJSON.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "run.h"

int run_file_begin(run_file *file, const char *path) {
    tm_error error = {0};
    if (!path) return 0;
    if (!app_output_begin(&file->output, path, &error)) return app_report(NULL, 0, &error);
    file->stream = app_output_stream(&file->output);
    if (!file->stream) {
        app_output_abandon(&file->output);
        return app_bad_input(path, 0, "cannot be written: %s; choose another place", strerror(errno));
    }
    file->begun = true;
    return 0;
}

int run_file_end(run_file *file, bool good) {
    tm_error error = {0};
    if (!file->begun) return 0;
    file->begun = false;
    bool written = !ferror((FILE *)file->stream);
    written = !fclose(file->stream) && written;
    if (!good || !written) {
        app_output_abandon(&file->output);
        if (!good) return 0;
        fprintf(stderr, "%s: cannot be written: the disk may be full; free some space and run again\n",
                file->output.path);
        return APP_FAILED;
    }
    return app_output_commit(&file->output, &error) ? 0 : app_report(NULL, 0, &error);
}

int run_say_interrupted(int64_t frame, int64_t total) {
    if (!app_interrupted() || frame >= total) return APP_DONE;
    if (total == INT64_MAX) return APP_DONE; /* that is how it ends */
    fprintf(stderr, "tm-sim: interrupted after frame %" PRId64 " of %" PRId64 "; the files hold what was done\n", frame,
            total);
    return app_interrupted_exit();
}

cJSON *run_report_begin(const sim *s, const char *mode) {
    static const char *const models[] = {"dynamic", "precomputed", "hybrid"};
    cJSON *r = cJSON_CreateObject();
    cJSON_AddStringToObject(r, "scene", s->scene->file);
    cJSON_AddStringToObject(r, "title", s->scene->title.s);
    cJSON_AddStringToObject(r, "mode", mode);
    cJSON_AddStringToObject(r, "version", tm_version());
    cJSON_AddStringToObject(r, "model", models[s->scene->model.index]);
    cJSON_AddNumberToObject(r, "vertices", s->mesh->vertex_count);
    cJSON_AddNumberToObject(r, "tets", s->mesh->tet_count);
    cJSON_AddStringToObject(r, "precision", s->scene->precision.index ? "single" : "double");
    cJSON_AddStringToObject(r, "force", s->scene->force.index ? "plain" : "best");
    cJSON_AddNumberToObject(r, "frame_s", s->frame_s);
    cJSON_AddNumberToObject(r, "dt_s", s->dt_s);
    cJSON_AddNumberToObject(r, "substeps_per_frame", s->substeps);
    cJSON *critical = cJSON_AddObjectToObject(r, "critical_step");
    cJSON_AddNumberToObject(critical, "guaranteed_s", s->critical_s);
    cJSON_AddNumberToObject(critical, "tet", s->critical_tet);
    cJSON_AddNumberToObject(critical, "tet_tag", (double)s->file.tet_tag[s->critical_tet]);
    cJSON_AddNumberToObject(r, "memory_bytes", (double)tm_memory_in_use());
    return r;
}

int run_report_end(cJSON *report, run_file *file) {
    int rc = 0;
    if (file->begun) {
        char *text = cJSON_Print(report);
        if (text) fprintf(file->stream, "%s\n", text);
        free(text);
        rc = text ? run_file_end(file, true) : APP_FAILED;
    }
    cJSON_Delete(report);
    return rc;
}
