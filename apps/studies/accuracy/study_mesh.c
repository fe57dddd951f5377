/* Other meshes of the study. Coarser ones: tm-mesh fill fills the scene's surface again, which rounds boundaries;
 * regions, groups and fibres come from the nearest elements. Finer ones are made by tm-mesh refine, and --mesh adds
 * others. Also writes files of fibres. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bandwidth.h"
#include "study.h"

/* --- tm-mesh, and files of fibres --- */

/* Waits for a child at most as long as a run may take. */
static int wait_for(const study *t, pid_t child) {
    const double began_s = app_seconds(), allowed_s = fmin(study_run_limit_s(t), study_left_s(t));
    int status = -1;
    for (pid_t ended = 0; child > 0 && ended != child;) {
        const struct timespec nap = {0, 5000000};
        ended = waitpid(child, &status, WNOHANG);
        if (ended < 0 && errno != EINTR) return -1;
        if (ended == child) break;
        study_doing(t, "making a mesh", -1);
        if (app_interrupted() || app_seconds() - began_s > allowed_s) kill(child, SIGKILL);
        nanosleep(&nap, NULL);
    }
    return status;
}

/* Runs the tm-mesh next to this program, with its output discarded. A failure shows in the missing file. */
static bool study_run_mesh(const study *t, char *const *argument) {
    char path[1100];
    const ssize_t length = readlink("/proc/self/exe", path, 1000);
    if (length < 0) return false;
    path[length] = 0;
    snprintf(strrchr(path, '/') + 1, 20, "tm-mesh");
    const pid_t child = fork();
    if (child == 0) {
        const int nowhere = open("/dev/null", O_WRONLY);
        dup2(nowhere, STDOUT_FILENO);
        dup2(nowhere, STDERR_FILENO);
        execv(path, argument);
        _exit(127);
    }
    const int status = wait_for(t, child);
    return child > 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static bool study_write_fibres(const double *fibre, int32_t tet_count, const char *path) {
    tm_error error = {0};
    app_output output;
    if (!app_output_begin(&output, path, &error)) return false;
    FILE *file = app_output_stream(&output);
    if (file) fprintf(file, "tet,ax,ay,az\n");
    for (int32_t t = 0; file && t < tet_count; t++) {
        const double *a = fibre + 3 * (size_t)t;
        fprintf(file, "%d,%.9g,%.9g,%.9g\n", t, a[0], a[1], a[2]);
    }
    return app_output_end(&output, file, &error);
}

/* --- coarser --- */

static bool write_surface(const tm_mesh *mesh, const char *path) {
    tm_error error = {0};
    app_output output;
    if (!app_output_begin(&output, path, &error)) return false;
    FILE *file = app_output_stream(&output);
    if (file) fputs("solid organ\n", file);
    for (int32_t i = 0; file && i < mesh->surface_count; i++) {
        fputs("facet normal 0 0 0\nouter loop\n", file);
        for (int k = 0; k < 3; k++) {
            const double *p = mesh->rest_m + 3 * (size_t)mesh->surface[3 * (size_t)i + (size_t)k];
            fprintf(file, "vertex %.9g %.9g %.9g\n", p[0], p[1], p[2]);
        }
        fputs("endloop\nendfacet\n", file);
    }
    if (file) fputs("endsolid organ\n", file);
    return app_output_end(&output, file, &error);
}

/* Returns the lattice's edge: it has twelve tetrahedra in the cube of its longest edge. */
static double edge_m(const tm_mesh *mesh, double tets) {
    double volume_m3 = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++) volume_m3 += mesh->volume_m3[t];
    return cbrt(12 * volume_m3 / tets);
}

static bool fill(const study *t, const sim *own, double factor, const char *surface, const char *path) {
    char size[40];
    snprintf(size, sizeof size, "%.9g", edge_m(own->mesh, own->mesh->tet_count / factor));
    const char *const argument[] = {"tm-mesh", "fill", "--size", size, "--unit", "m", surface, "-o", path, NULL};
    char *copy[sizeof argument / sizeof *argument];
    for (size_t i = 0; i < sizeof argument / sizeof *argument; i++) copy[i] = (char *)(uintptr_t)argument[i];
    return write_surface(own->mesh, surface) && study_run_mesh(t, copy);
}

/* Transfers regions, groups and fibres to the mesh of `path`. Returns its number of tetrahedra; 0: impossible. */
static int dress(const sim *own, study_mesh *m) {
    tm_mesh_file file = {0};
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    int tets = 0;
    if (!tm_mesh_file_load(m->path, 1, &file, &error) && !tm_mesh_file_build(&file, &mesh, &error)) {
        double *fibre = app_zeroed(3 * (size_t)mesh->tet_count, sizeof *fibre);
        const bool good = study_transfer(own, mesh, m->path, fibre) &&
                          (!own->fibre || study_write_fibres(fibre, mesh->tet_count, m->fibres));
        tets = good ? mesh->tet_count : 0;
        free(fibre);
    }
    tm_mesh_destroy(mesh);
    tm_mesh_file_free(&file);
    return tets;
}

/* Makes a mesh with about `factor` times fewer tetrahedra inside the scene's surface. */
static bool study_coarsen(study *t, const sim *own, double factor, const char *name) {
    study_mesh *m = &t->mesh[t->mesh_count];
    char surface[1024];
    *m = (study_mesh){.made = true, .foreign = true};
    snprintf(m->path, sizeof m->path, "%.990s/%.8s.msh", t->folder, name);
    snprintf(surface, sizeof surface, "%.990s/surface.stl", t->folder);
    if (own->fibre) snprintf(m->fibres, sizeof m->fibres, "%.990s/%.8s.fibres.csv", t->folder, name);
    if (fill(t, own, factor, surface, m->path)) m->tets = dress(own, m);
    unlink(surface);
    if (!m->tets || m->tets > own->mesh->tet_count) {
        unlink(m->path);
        app_remark("tm-accuracy: no mesh of %.3g times fewer tetrahedra holds this organ's surface, regions and groups",
                   factor);
        return false;
    }
    snprintf(m->name, sizeof m->name, "%s mesh, %d tetrahedra", name, m->tets);
    t->mesh_count++;
    return true;
}

/* --- finer, and others --- */

static double longest_edge_m(const tm_mesh *mesh) {
    double sum = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double longest = 0;
        for (int a = 0; a < 4; a++)
            for (int b = a + 1; b < 4; b++) {
                const double *p = mesh->rest_m + 3 * (size_t)mesh->tet[4 * (size_t)t + (size_t)a],
                             *q = mesh->rest_m + 3 * (size_t)mesh->tet[4 * (size_t)t + (size_t)b];
                longest = fmax(longest, hypot(hypot(p[0] - q[0], p[1] - q[1]), p[2] - q[2]));
            }
        sum += longest;
    }
    return sum / mesh->tet_count;
}

/* Returns the smallest height of a tetrahedron, which determines the step; `vertex` and `tet` as in tm_mesh. */
static double smallest_height_m(const double *vertex, const int32_t *tet, int32_t tet_count) {
    double smallest = INFINITY;
    for (int32_t t = 0; t < tet_count; t++) {
        const double *p[4];
        double six_volumes = 0, largest = 0;
        for (int a = 0; a < 4; a++) p[a] = vertex + 3 * (size_t)tet[4 * (size_t)t + (size_t)a];
        for (int a = 0; a < 4; a++) { /* the face opposite a */
            const double *o = p[(a + 1) % 4], *q = p[(a + 2) % 4], *r = p[(a + 3) % 4];
            double cross[3], volume = 0;
            for (int k = 0; k < 3; k++) {
                const int i = (k + 1) % 3, j = (k + 2) % 3;
                cross[k] = (q[i] - o[i]) * (r[j] - o[j]) - (q[j] - o[j]) * (r[i] - o[i]);
                volume += cross[k] * (p[a][k] - o[k]);
            }
            largest = fmax(largest, sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]));
            six_volumes = fabs(volume);
        }
        smallest = fmin(smallest, six_volumes / largest);
    }
    return smallest;
}

static int count_tets(const char *path, double *height_m) {
    tm_mesh_file file = {0};
    tm_error error = {0};
    const int count = tm_mesh_file_load(path, 1, &file, &error) ? 0 : file.tet_count;
    *height_m = smallest_height_m(file.vertex_m, file.tet, count);
    tm_mesh_file_free(&file);
    return count;
}

/* Finds the mesh to refine: the scene's, or, if supports name vertices, a copy that has them as groups. */
static bool source_of(const study *t, const sim *own, uint64_t hash, char path[1024], double *scale) {
    const bool carries = study_carried(own) > 0;
    *scale = carries ? 1 : own->scene->scale.si;
    snprintf(path, 1024, "%.1020s", own->scene->mesh.s);
    if (!carries) return true;
    snprintf(path, 1024, "%.990s/own-%08x.msh", t->folder, (unsigned)hash);
    return !access(path, R_OK) || study_write_carried(own, path);
}

/* Adds supports by vertex number to the hash of a mesh's sources. */
static uint64_t hash_supports(const sim *own, uint64_t hash) {
    for (int i = 0; i < own->scene->support.count; i++) {
        const app_integers *v = &((const app_support *)own->scene->support.item + i)->select.vertex;
        if (v->line) hash = sim_hash_bytes(hash, v->item, sizeof *v->item * (size_t)v->count);
    }
    return hash;
}

/* Makes a mesh with longest edges of `factor` times the scene's mean one, if its runs keep the limits. The file is
 * named by the hash of its sources. */
static bool refine(study *t, const sim *own, double factor, const char *name) {
    study_mesh *m = &t->mesh[t->mesh_count];
    char size[40], scale[40], source[1024], from[1024], *argument[20], in[] = "--fibres", out[] = "--write-fibres";
    double metres;
    uint64_t hash = sim_hash_file(sim_hash_bytes(0, &factor, sizeof factor), own->scene->mesh.s);
    if (own->fibre) hash = sim_hash_bytes(hash, own->fibre, 3 * sizeof *own->fibre * (size_t)own->mesh->tet_count);
    hash = hash_supports(own, hash);
    if (!source_of(t, own, hash, source, &metres)) return false;
    *m = (study_mesh){.made = true};
    snprintf(m->path, sizeof m->path, "%.990s/%.8s-%08x.msh", t->folder, name, (unsigned)hash);
    snprintf(size, sizeof size, "%.9g", factor * longest_edge_m(own->mesh));
    snprintf(scale, sizeof scale, "%.17g", metres);
    int n = 0;
    const char *const fixed[] = {"tm-mesh", "refine", "--box",   "-1e9,-1e9,-1e9,1e9,1e9,1e9",
                                 "--size",  size,     "--scale", scale,
                                 source,    "-o",     m->path};
    for (size_t i = 0; i < sizeof fixed / sizeof *fixed; i++) argument[n++] = (char *)(uintptr_t)fixed[i];
    bool good = true;
    if (own->fibre) {
        snprintf(from, sizeof from, "%.990s/own-%08x.fibres.csv", t->folder, (unsigned)hash);
        snprintf(m->fibres, sizeof m->fibres, "%.990s/%.8s-%08x.fibres.csv", t->folder, name, (unsigned)hash);
        good = study_write_fibres(own->fibre, own->mesh->tet_count, from);
        argument[n++] = in, argument[n++] = from;
        argument[n++] = out, argument[n++] = m->fibres;
    }
    argument[n] = NULL;
    if (access(m->path, R_OK)) good = good && study_run_mesh(t, argument);
    double height_m = 0;
    m->tets = good ? count_tets(m->path, &height_m) : 0;
    if (m->tets <= own->mesh->tet_count) {
        app_remark("tm-accuracy: tm-mesh refine --size %s made no finer mesh of %s", size, own->scene->mesh.s);
        return false;
    }
    for (int i = 0; i < t->mesh_count; i++) /* bisection may give the same mesh again, which determines no order */
        if (t->mesh[i].tets >= m->tets && t->mesh[i].tets < 1.2 * m->tets) return false;
    if (m->tets > t->finest) return false;
    m->step = height_m / smallest_height_m(own->mesh->rest_m, own->mesh->tet, own->mesh->tet_count);
    /* Cost: tetrahedra, steps, and half as much again for cache misses. */
    const double price_s = 1.5 * t->run[0].wall_s * t->run[0].frames * m->tets / own->mesh->tet_count / m->step;
    if (price_s > study_run_limit_s(t)) {
        char would[24], may[24];
        app_remark("tm-accuracy: a run of %d tetrahedra would take about %s, and a quarter of --limit is %s", m->tets,
                   study_span(price_s, would), study_span(study_run_limit_s(t), may));
        return false;
    }
    snprintf(m->name, sizeof m->name, "%s mesh, %d tetrahedra", name, m->tets);
    t->mesh_count++;
    return true;
}

/* Returns the setting that prevents other meshes: vertices fixed or loaded one by one. */
static const char *bound_to_vertices(const app_scene *scene) {
    int by_number = 0;
    if (scene->body.count) return "each of its bodies has a mesh of its own (vary them by --set bodies.NAME.mesh)";
    for (int i = 0; i < scene->support.count; i++)
        if (((const app_support *)scene->support.item + i)->select.vertex.line && ++by_number > STUDY_CARRIED)
            return "many supports by vertex number (give them groups)";
    for (int i = 0; i < scene->load.count; i++)
        if (((const app_load *)scene->load.item + i)->force.line ||
            ((const app_load *)scene->load.item + i)->select.vertex.line)
            return "loads by vertex";
    return NULL;
}

int study_make_meshes(study *t, const sim *own) {
    t->mesh[t->mesh_count++] = (study_mesh){.tets = own->mesh->tet_count};
    snprintf(t->mesh[0].name, sizeof t->mesh[0].name, "as it is, %d tetrahedra", own->mesh->tet_count);
    const char *bound = bound_to_vertices(own->scene);
    const double run_s = t->run[0].wall_s * t->run[0].frames;
    if (mkdir(t->folder, 0777) && errno != EEXIST)
        return app_bad_input(t->folder, 0, "cannot be made: %s; name a --json in a folder that can be written",
                             strerror(errno));
    if (bound) app_remark("%s: %s: no other mesh of it is the same problem", t->file, bound);
    for (int i = 0; i < (t->quick ? 1 : 2) && !bound; i++) study_coarsen(t, own, i ? 4 : 2, i ? "coarsest" : "coarser");
    for (int i = 0; i < 3 && !bound; i++) {
        static const double factor[] = {0.5, 0.63, 0.8};
        const double tets = own->mesh->tet_count * pow(factor[i], -3); /* a lower bound; 1/f times the steps */
        if (!(run_s * pow(factor[i], -4) <= study_run_limit_s(t)) || tets > t->finest) continue;
        if (!refine(t, own, factor[i], "finest")) continue;
        if (factor[i] < 0.7 && !t->quick) refine(t, own, factor[i] < 0.6 ? 0.71 : 0.8, "finer");
        break;
    }
    if (t->other_count && own->scene->body.count)
        return app_bad_input(t->file, 0, "--mesh replaces tissue.mesh, and the scene has bodies; leave it out");
    for (int i = 0; i < t->other_count; i++) {
        study_mesh *m = &t->mesh[t->mesh_count++];
        char whole[4096];
        double height_m;
        *m = (study_mesh){.foreign = true, .tets = count_tets(t->other_mesh[i], &height_m)};
        if (!m->tets || !realpath(t->other_mesh[i], whole))
            return app_bad_input(t->other_mesh[i], 0, "--mesh is not a mesh that can be read; see tm-mesh info");
        snprintf(m->path, sizeof m->path, "%.1020s", whole);
        snprintf(m->name, sizeof m->name, "%.40s, %d tetrahedra", strrchr(whole, '/') + 1, m->tets);
    }
    return 0;
}

bool study_turn_fibres(study *t, const sim *own, double angle_rad, char path[1024]) {
    const int32_t count = own->mesh->tet_count;
    double *turned = malloc(3 * sizeof *turned * (size_t)count), mean[3] = {0}, axis[3];
    if (!turned) return false;
    for (int32_t i = 0; i < 3 * count; i++) mean[i % 3] += own->fibre[i] * (own->fibre[i - i % 3] < 0 ? -1 : 1);
    const double *hand = ((const app_instrument *)own->scene->instrument.item)->axis.v;
    for (int a = 0; a < 3; a++) axis[a] = mean[(a + 1) % 3] * hand[(a + 2) % 3] - mean[(a + 2) % 3] * hand[(a + 1) % 3];
    double norm = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    if (!(norm > 1e-6 * count)) { /* fibres along the hand: any perpendicular axis */
        const int least = fabs(hand[0]) < fabs(hand[1]) ? (fabs(hand[0]) < fabs(hand[2]) ? 0 : 2)
                                                        : (fabs(hand[1]) < fabs(hand[2]) ? 1 : 2);
        double e[3] = {0};
        e[least] = 1;
        for (int a = 0; a < 3; a++) axis[a] = hand[(a + 1) % 3] * e[(a + 2) % 3] - hand[(a + 2) % 3] * e[(a + 1) % 3];
        norm = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    }
    for (int a = 0; a < 3; a++) axis[a] /= norm;
    const double c = cos(angle_rad), s = sin(angle_rad); /* Rodrigues */
    for (int32_t i = 0; i < count; i++) {
        const double *f = own->fibre + 3 * (size_t)i, along = axis[0] * f[0] + axis[1] * f[1] + axis[2] * f[2];
        for (int a = 0; a < 3; a++)
            turned[3 * (size_t)i + (size_t)a] =
                c * f[a] + s * (axis[(a + 1) % 3] * f[(a + 2) % 3] - axis[(a + 2) % 3] * f[(a + 1) % 3]) +
                (1 - c) * along * axis[a];
    }
    snprintf(path, 1024, "%.990s/turned%+.0fdeg.fibres.csv", t->folder, angle_rad * 180 / 3.14159265358979);
    const bool good = study_write_fibres(turned, count, path);
    free(turned);
    return good;
}
