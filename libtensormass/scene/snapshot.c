/* Writes and reads snapshots of a simulation. */
#include "snapshot.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

static const char magic[8] = "TMSIMSN1";

/* State of the simulation outside its world. */
typedef struct header {
    char magic[8];
    int64_t world_bytes, frames;
    tm_tool_pose pose[TM_MAX_INSTRUMENTS];
    uint64_t checksum; /* of all before it */
} header;

static uint64_t checksum(const header *h) { return tm_hash(h, offsetof(header, checksum), TM_HASH_SEED); }

tm_status sim_snapshot_save(sim *s, const char *path) {
    const app_host *host = &s->scene->host;
    tm_error error = {0};
    app_output output;
    header *h = NULL;
    int64_t bytes = tm_model_snapshot_bytes(s->model);
    void *world = malloc((size_t)bytes);
    h = calloc(1, sizeof *h);
    tm_status rc = world && h ? TM_OK : TM_ERR_MEMORY;
    if (!rc && tm_model_save(s->model, world, bytes, &error)) rc = app_host_report(host, path, 0, &error);
    if (!rc && !app_output_begin(&output, path, &error)) rc = app_host_report(host, NULL, 0, &error);
    if (!rc) {
        memcpy(h->magic, magic, sizeof magic);
        h->world_bytes = bytes;
        h->frames = s->frames;
        for (int i = 0; i < TM_MAX_INSTRUMENTS; i++) memcpy(&h->pose[i], &s->pose[i], sizeof h->pose[i]);
        h->checksum = checksum(h);
        FILE *file = app_output_stream(&output);
        if (file) fwrite(h, sizeof *h, 1, file);
        if (file) fwrite(world, (size_t)bytes, 1, file);
        if (!app_output_end(&output, file, &error)) rc = app_host_report(host, NULL, 0, &error);
    }
    free(h);
    free(world);
    return rc;
}

static tm_status refuse(const app_host *host, const char *path, const char *why) {
    return app_host_tell(host, TM_FAULT, TM_ERR_FILE, path, 0, why);
}

static void *read_file(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    char *bytes = NULL;
    if (!fseek(file, 0, SEEK_END) && ftell(file) >= 0 && ftell(file) < INT64_MAX) {
        *size = (size_t)ftell(file);
        rewind(file);
        bytes = malloc(*size + 1);
        if (bytes && fread(bytes, 1, *size, file) != *size) {
            free(bytes);
            bytes = NULL;
        }
    }
    fclose(file);
    return bytes;
}

tm_status sim_snapshot_restore(sim *s, const char *path) {
    const app_host *host = &s->scene->host;
    tm_error error = {0};
    size_t size = 0;
    char *bytes = read_file(path, &size);
    if (!bytes) {
        char why[200];
        snprintf(why, sizeof why, "cannot be read: %m; give a file that --snapshot-at wrote");
        return refuse(host, path, why);
    }
    header h;
    tm_status rc = 0;
    if (size < sizeof h || memcmp(bytes, magic, sizeof magic))
        rc = refuse(host, path, "is not a snapshot of this version; give a file that --snapshot-at wrote");
    else {
        memcpy(&h, bytes, sizeof h);
        if (h.checksum != checksum(&h) || h.world_bytes < 0 || (uint64_t)h.world_bytes != size - sizeof h)
            rc = refuse(host, path, "is damaged or truncated; save it again");
    }
    if (!rc) {
        /* The library requires aligned data. */
        memmove(bytes, bytes + sizeof h, size - sizeof h);
        if (tm_model_restore(s->model, bytes, h.world_bytes, &error)) rc = app_host_report(host, path, 0, &error);
    }
    if (!rc) {
        s->frames = h.frames;
        for (int i = 0; i < TM_MAX_INSTRUMENTS; i++) s->pose[i] = h.pose[i];
    }
    free(bytes);
    return rc;
}
