/* Meshes from files. Gmsh reads them in a process of its own: its libraries, its exits and its crashes on damaged files
 * stay there, and a cached mesh starts none. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "app.h"
#include "mesh_parts.h"

tm_status app_mesh_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...) {
    if (error) {
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(error->message, sizeof error->message, format, arguments);
        va_end(arguments);
        error->status = status;
        error->entity = entity;
    }
    return status;
}

/* The whole file and a NUL. */
static tm_status read_whole(const char *path, char **bytes, size_t *size, tm_error *error) {
    struct stat info;
    FILE *file = fopen(path, "rb");
    if (!file || fstat(fileno(file), &info) != 0) {
        int why = errno;
        if (file) fclose(file);
        return app_mesh_fail(error, TM_ERR_FILE, -1, "cannot open: %s; check the path", strerror(why));
    }
    tm_status status = TM_OK;
    *size = (size_t)info.st_size;
    *bytes = S_ISREG(info.st_mode) ? malloc(*size + 1) : NULL;
    if (!S_ISREG(info.st_mode))
        status = app_mesh_fail(error, TM_ERR_FILE, -1, "not a file; name a .msh, .vtk or .mesh file");
    else if (!*bytes)
        status = app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory for its %zu bytes", *size);
    else if (fread(*bytes, 1, *size, file) != *size)
        status = app_mesh_fail(error, TM_ERR_FILE, -1, "cannot read: %s; check the disk", strerror(errno));
    else if (*size == 0)
        status = app_mesh_fail(error, TM_ERR_FILE, -1, "the file is empty; write the mesh anew");
    fclose(file);
    if (status) {
        free(*bytes);
        *bytes = NULL;
    } else
        (*bytes)[*size] = 0;
    return status;
}

/* The count after a keyword that begins a line, -1 if it is not there. */
static int64_t count_after(const char *text, const char *word) {
    size_t length = strlen(word);
    for (const char *p = text; (p = strstr(p, word)); p += length)
        if ((p == text || p[-1] == '\n' || p[-1] == ' ') && strchr(" \t\r\n", p[length]) && p[length])
            return strtoll(p + length, NULL, 10);
    return -1;
}

/* Gmsh takes a file that it does not know for a script and runs it: nothing passes that does not look like a mesh. */
static tm_status scan_format(const char *path, const char *text, size_t size, app_mesh_scan *scan, tm_error *error) {
    static const struct {
        const char *ending, *start, *count;
    } format[] = {{".msh", "$MeshFormat", NULL},
                  {".vtk", "# vtk DataFile", "POINTS"},
                  {".mesh", "MeshVersionFormatted", "Vertices"}};
    const char *dot = strrchr(path, '.');
    *scan = (app_mesh_scan){.vertex_count = -1, .tet_count = -1};
    for (size_t i = 0; i < sizeof format / sizeof *format; i++) {
        if (!dot || strcmp(dot, format[i].ending) != 0) continue;
        if (strncmp(text + strspn(text, " \t\r\n"), format[i].start, strlen(format[i].start)) != 0)
            return app_mesh_fail(error, TM_ERR_FILE, -1,
                                 "does not begin with '%s': not a %s file; write it anew, or give it its right ending",
                                 format[i].start, format[i].ending);
        if (i == 0) return app_mesh_scan_msh(text, size, scan, error);
        double version = 0;
        scan->vtk_5 = i == 1 && sscanf(text, " # vtk DataFile Version %lf", &version) == 1 && version >= 5;
        if (scan->vtk_5) return TM_OK;
        scan->vertex_count = count_after(text, format[i].count);
        if (i == 2) scan->tet_count = count_after(text, "Tetrahedra"); /* the reader takes a file cut short for whole */
        return TM_OK;
    }
    static const char *const surface[] = {".stl", ".obj", ".ply", ".off"};
    for (size_t i = 0; dot && i < sizeof surface / sizeof *surface; i++)
        if (strcasecmp(dot, surface[i]) == 0)
            return app_mesh_fail(error, TM_ERR_FILE, -1,
                                 "%s is a surface, not a volume; fill it with tetrahedra: tm-mesh fill --size 5mm "
                                 "SURFACE.stl -o ORGAN.msh",
                                 surface[i]);
    if (dot && strcasecmp(dot, ".vtu") == 0)
        return app_mesh_fail(error, TM_ERR_FILE, -1, ".vtu is not read; save it as .vtk (ParaView: legacy VTK)");
    return app_mesh_fail(error, TM_ERR_FILE, -1, "unknown kind of mesh file; use .msh (2.2 or 4.1), .vtk or .mesh");
}

/* In the child: everything that Gmsh says goes nowhere, the answer goes into the pipe and the child ends without
 * clean-up. */
static _Noreturn void read_in_child(const char *path, int pipe_end) {
    tm_error error = {.status = TM_OK, .entity = -1};
    app_mesh mesh = {0};
    void *block = NULL;
    size_t size = 0;
    int nowhere = open("/dev/null", O_RDWR);
    dup2(nowhere, STDIN_FILENO);
    dup2(nowhere, STDOUT_FILENO);
    dup2(nowhere, STDERR_FILENO);
    setenv("HOME", "/dev/null", 1); /* FLTK would write its preferences there */
    void *module = app_module("gmsh", &error);
    app_gmsh_read_fn *read_mesh = module ? (app_gmsh_read_fn *)app_module_symbol(module, "tm_gmsh_read", &error) : NULL;
    if (read_mesh) error.status = read_mesh(path, &mesh, &error);
    if (read_mesh && !error.status && !(block = app_mesh_encode(&mesh, &size)))
        app_mesh_fail(&error, TM_ERR_MEMORY, -1, "no memory for the mesh; use a coarser one");
    FILE *out = fdopen(pipe_end, "wb");
    bool sent = out && fwrite(&error, sizeof error, 1, out) == 1 && (!size || fwrite(block, 1, size, out) == size) &&
                fclose(out) == 0;
    _exit(sent ? 0 : 1);
}

static char *drain(int fd, size_t *size) {
    size_t room = 1 << 16;
    char *bytes = malloc(room);
    *size = 0;
    for (ssize_t got = 1; bytes && got > 0;) {
        if (*size == room) {
            char *grown = realloc(bytes, room *= 2);
            if (!grown) free(bytes);
            if (!(bytes = grown)) break;
        }
        do got = read(fd, bytes + *size, room - *size);
        while (got < 0 && errno == EINTR);
        if (got > 0) *size += (size_t)got;
    }
    return bytes;
}

static tm_status read_by_gmsh(const char *path, app_mesh *mesh, tm_error *error) {
    int ends[2], state = 0;
    if (pipe(ends) != 0) return app_mesh_fail(error, TM_ERR_FILE, -1, "no pipe: %s", strerror(errno));
    pid_t child = fork();
    if (child == 0) {
        close(ends[0]);
        read_in_child(path, ends[1]);
    }
    close(ends[1]);
    size_t size = 0;
    char *bytes = child > 0 ? drain(ends[0], &size) : NULL;
    close(ends[0]);
    if (child < 0) return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no process for the reader: %s", strerror(errno));
    while (waitpid(child, &state, 0) < 0 && errno == EINTR) {
    }
    tm_error told;
    tm_status status;
    if (!bytes || state != 0 || size < sizeof told) {
        status = app_mesh_fail(
            error, TM_ERR_FILE, -1, "Gmsh's reader broke off (%s %d); the file is damaged, write it anew",
            WIFSIGNALED(state) ? "signal" : "exit", WIFSIGNALED(state) ? WTERMSIG(state) : WEXITSTATUS(state));
    } else {
        memcpy(&told, bytes, sizeof told);
        if (told.status != TM_OK)
            status = app_mesh_fail(error, told.status, told.entity, "%s", told.message);
        else
            status = app_mesh_decode(bytes + sizeof told, size - sizeof told, 0, mesh, error);
    }
    free(bytes);
    return status;
}

typedef struct rank {
    int64_t tag;
    int32_t place;
} rank;

static int by_tag(const void *a, const void *b) {
    const rank *x = a, *y = b;
    return x->tag != y->tag ? (x->tag < y->tag ? -1 : 1) : (x->place < y->place ? -1 : x->place > y->place);
}

/* Where each of the file's tags sits in the mesh's ascending list: old_of_new[new]. Refuses tags that the mesh has not.
 */
static tm_status order_of_file(const char *what, const int64_t *file_tag, int64_t file_count, const int64_t *mesh_tag,
                               int32_t mesh_count, bool lenient, int32_t *old_of_new, tm_error *error) {
    rank *sorted = malloc(((size_t)file_count + 1) * sizeof *sorted);
    if (!sorted) return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory");
    for (int64_t i = 0; i < file_count; i++) sorted[i] = (rank){file_tag[i], (int32_t)i};
    qsort(sorted, (size_t)file_count, sizeof *sorted, by_tag);
    tm_status status = TM_OK;
    int32_t *old_of_place = malloc(((size_t)file_count + 1) * sizeof *old_of_place), m = 0;
    for (int64_t i = 0; i < file_count && old_of_place && !status; i++) {
        if (m < mesh_count && mesh_tag[m] == sorted[i].tag)
            old_of_place[sorted[i].place] = m++;
        else if (lenient)
            old_of_place[sorted[i].place] = -1;
        else
            status = app_mesh_fail(error, TM_ERR_MESH, sorted[i].tag,
                                   "%s %lld is in no tetrahedron; remove it, or run tm-mesh repair", what,
                                   (long long)sorted[i].tag);
    }
    if (!old_of_place) status = app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory");
    if (!status && m != mesh_count)
        status = app_mesh_fail(error, TM_ERR_FILE, -1, "its %ss were not all understood; write it anew", what);
    for (int64_t i = 0, n = 0; i < file_count && !status; i++)
        if (old_of_place[i] >= 0) old_of_new[n++] = old_of_place[i];
    free(sorted);
    free(old_of_place);
    return status;
}

/* The same mesh with vertices and tetrahedra in the order given. */
static bool permute(app_mesh *mesh, const int32_t *vertex, const int32_t *tet) {
    int32_t groups = mesh->group_begin[mesh->group_count];
    app_mesh out = *mesh;
    if (!app_mesh_allocate(&out, groups)) return false;
    int32_t *new_of_old = malloc(((size_t)mesh->vertex_count + 1) * sizeof *new_of_old);
    if (!new_of_old) {
        app_mesh_free(&out);
        return false;
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        new_of_old[vertex[v]] = v;
        memcpy(out.vertex_m + 3 * (size_t)v, mesh->vertex_m + 3 * (size_t)vertex[v], 3 * sizeof(double));
        out.vertex_tag[v] = mesh->vertex_tag[vertex[v]];
    }
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        for (int k = 0; k < 4; k++) out.tet[4 * t + k] = new_of_old[mesh->tet[4 * tet[t] + k]];
        out.tet_tag[t] = mesh->tet_tag[tet[t]];
        out.region[t] = mesh->region[tet[t]];
    }
    memcpy(out.region_name, mesh->region_name, (size_t)mesh->region_count * sizeof *out.region_name);
    memcpy(out.group_name, mesh->group_name, (size_t)mesh->group_count * sizeof *out.group_name);
    memcpy(out.group_begin, mesh->group_begin, ((size_t)mesh->group_count + 1) * sizeof(int32_t));
    for (int32_t i = 0; i < groups; i++) out.group_vertex[i] = new_of_old[mesh->group_vertex[i]];
    free(new_of_old);
    app_mesh_free(mesh);
    *mesh = out;
    return true;
}

static int by_value(const void *a, const void *b) {
    int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* File order, scale, and the vertices that the reader left behind. */
static tm_status finish(const app_mesh_scan *scan, double scale, app_mesh_lenient *lenient, app_mesh *mesh,
                        tm_error *error) {
    int64_t dropped = scan->vertex_count >= 0 ? scan->vertex_count - mesh->vertex_count : 0;
    if (lenient) lenient->dropped_vertices = dropped;
    tm_status status = TM_OK;
    if (!scan->tet_tag && scan->tet_count >= 0 && scan->tet_count != mesh->tet_count)
        return app_mesh_fail(error, TM_ERR_FILE, -1,
                             "has %d of the %lld tetrahedra that it announces; the file is cut short, write it anew",
                             mesh->tet_count, (long long)scan->tet_count);
    if (scan->vertex_tag && scan->tet_tag) {
        int32_t *vertex = calloc((size_t)mesh->vertex_count + 1, sizeof *vertex),
                *tet = calloc((size_t)mesh->tet_count + 1, sizeof *tet);
        status = !vertex || !tet ? app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory") : TM_OK;
        if (!status)
            status = order_of_file("vertex", scan->vertex_tag, scan->vertex_count, mesh->vertex_tag, mesh->vertex_count,
                                   lenient != NULL, vertex, error);
        if (!status)
            status = order_of_file("tetrahedron", scan->tet_tag, scan->tet_count, mesh->tet_tag, mesh->tet_count, false,
                                   tet, error);
        if (!status && !permute(mesh, vertex, tet)) status = app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory");
        free(vertex);
        free(tet);
    } else if (dropped > 0 && !lenient) {
        int64_t tag = 1;
        while (tag <= mesh->vertex_count && mesh->vertex_tag[tag - 1] == tag) tag++;
        status = app_mesh_fail(error, TM_ERR_MESH, tag,
                               "vertex %lld (counted from 1)%s is in no tetrahedron; remove it, or run tm-mesh repair",
                               (long long)tag, dropped > 1 ? " and others" : "");
    }
    if (status) return status;
    for (int64_t i = 0; i < 3 * (int64_t)mesh->vertex_count; i++) mesh->vertex_m[i] *= scale;
    for (int32_t g = 0; g < mesh->group_count; g++)
        qsort(mesh->group_vertex + mesh->group_begin[g], (size_t)(mesh->group_begin[g + 1] - mesh->group_begin[g]),
              sizeof(int32_t), by_value);
    return TM_OK;
}

tm_status app_mesh_load_lenient(const char *path, double scale, app_mesh_lenient *lenient, app_mesh *mesh,
                                tm_error *error) {
    memset(mesh, 0, sizeof *mesh);
    if (!(scale > 0) || !isfinite(scale))
        return app_mesh_fail(error, TM_ERR_ARGUMENT, -1, "scale %g; it must be above 0", scale);
    char *text = NULL;
    size_t size = 0;
    tm_status status = read_whole(path, &text, &size, error);
    if (status) return status;
    const char *dot = strrchr(path, '.');
    uint64_t hash = tm_hash(&scale, sizeof scale, tm_hash(text, size, TM_HASH_SEED));
    if (dot) hash = tm_hash(dot, strlen(dot), hash);
    if (!lenient && app_mesh_cache_load(hash, mesh)) {
        free(text);
        return TM_OK;
    }
    app_mesh_scan scan;
    app_mesh read = {0};
    status = scan_format(path, text, size, &scan, error);
    if (!status)
        status = scan.vtk_5 ? app_mesh_read_vtk(text, size, &scan, &read, error) : read_by_gmsh(path, &read, error);
    free(text);
    if (!status) status = finish(&scan, scale, lenient, &read, error);
    app_mesh_scan_free(&scan);
    if (status) {
        app_mesh_free(&read);
        return status;
    }
    read.hash = hash;
    if (!lenient) app_mesh_cache_store(&read);
    *mesh = read;
    return TM_OK;
}

tm_status app_mesh_load(const char *path, double scale, app_mesh *mesh, tm_error *error) {
    return app_mesh_load_lenient(path, scale, NULL, mesh, error);
}
