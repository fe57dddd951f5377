/* Reviews a scene's sizes, constants, supports, instruments and cost per frame, as an experienced user would. */
#include "check.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "common/program_host.h"
#include "libtensormass/numeric/order.h"
#include "libtensormass/numeric/union_find.h"
#include "scene/surface_distance.h"
#include "tissues.h"

typedef struct review {
    sim *s;
    bool *held; /* [region_count] all its vertices are fixed */
    int odd;
} review;

/* Prints a remark with its line; line 0: about something missing. */
static void __attribute__((format(printf, 3, 4))) odd(review *r, int line, const char *format, ...) {
    char where[600] = "", what[900];
    va_list list;
    va_start(list, format);
    vsnprintf(what, sizeof what, format, list);
    va_end(list);
    if (line)
        app_scene_where(r->s->scene, line, where, sizeof where);
    else
        snprintf(where, sizeof where, "%s", r->s->scene->file);
    fprintf(stderr, "%s: warning: %s\n", where, what);
    r->odd++;
}

static double size_m(const tm_mesh *mesh) {
    double size = 0;
    for (int a = 0; a < 3; a++) {
        double low = INFINITY, high = -INFINITY;
        for (int32_t v = 0; v < mesh->vertex_count; v++) {
            low = fmin(low, mesh->rest_m[3 * v + a]);
            high = fmax(high, mesh->rest_m[3 * v + a]);
        }
        size = fmax(size, high - low);
    }
    return size;
}

static void check_size(review *r) {
    const app_scene *scene = r->s->scene;
    const app_body *body = r->s->body_count ? scene->body.item : NULL;
    const app_number *scale = body ? &body->scale : &scene->scale;
    const int line = scale->line ? scale->line : app_mesh_line(scene);
    const char *key = body ? "the bodies' scale" : "tissue.scale";
    const double size = size_m(r->s->mesh);
    if (size > 1)
        odd(r, line, "the organ has %.3g m; if the mesh is in millimetres, write %s: %g", size, key, 1e-3 * scale->si);
    else if (size < 5e-3)
        odd(r, line, "the organ has %.3g mm; check %s (metres per unit of the mesh)", 1e3 * size, key);
}

/* Returns the scene's entry with the constants of a region. */
static const app_material *entry_of(const app_scene *scene, const char *region) {
    const app_material *all = scene->material.item, *rest = NULL;
    for (int i = 0; i < scene->material.count; i++) {
        if (strcmp(all[i].region.s, region) == 0) return all + i;
        const size_t body = strcspn(region, ".");
        const char *name = all[i].region.s;
        if (region[body] && !strncmp(name, region, body) && !strcmp(name + body, ".*")) rest = all + i;
        if (!rest && strcmp(name, "*") == 0) rest = all + i;
    }
    return rest;
}

/* Returns whether every vertex of the region is fixed, or rigid. Its constants then have no effect. */
static bool is_held(const sim *s, int32_t region) {
    for (int32_t t = 0; t < s->mesh->tet_count; t++)
        for (int k = 0; k < 4 && s->mesh->region[t] == region; k++)
            if (!(s->rigid_tet && s->rigid_tet[t]) && (!s->support_of || !s->support_of[s->mesh->tet[4 * t + k]]))
                return false;
    return true;
}

static bool is_rigid(const sim *s, int32_t region) {
    for (int32_t t = 0; t < s->mesh->tet_count; t++)
        if (s->mesh->region[t] == region) return s->rigid_tet && s->rigid_tet[t];
    return false;
}

static void check_region(review *r, int32_t region) {
    const tm_material *m = &r->s->material[region];
    const char *name = r->s->file.region_name[region];
    const app_material *entry = entry_of(r->s->scene, name);
    const tissue_constants *t = tissue_find(name);
    if (!t) t = tissue_find(r->s->scene->title.s);
    const double poisson = m->lambda_Pa / (2 * (m->lambda_Pa + m->mu_Pa)), young = 2 * m->mu_Pa * (1 + poisson);
    const int line = entry ? entry->region.line : r->s->scene->material.line;
    const bool held = r->held[region], known = t && t->role != TISSUE_BONE;
    if (known && young > 10 * t->young_Pa)
        odd(r, line, "region '%s': %.3g kPa is far too stiff for %s (published: %.3g kPa, %s); check the unit", name,
            young / 1e3, t->name, t->young_Pa / 1e3, t->source);
    else if (known && young < 0.1 * t->young_Pa)
        odd(r, line, "region '%s': %.3g kPa is far too soft for %s (published: %.3g kPa, %s); check the unit", name,
            young / 1e3, t->name, t->young_Pa / 1e3, t->source);
    else if (!known && !held && young > 1e6)
        odd(r, line,
            "region '%s': %.3g MPa is stiffer than soft tissue and sets the time step; support it (supports: group: %s) and give it about 50 kPa",
            name, young / 1e6, name);
    if (poisson > 0.491 && !sim_has(r->s, "strain_smoothing"))
        odd(r, line,
            "region '%s': at Poisson's ratio %.4g tetrahedra lock and are too stiff; add 'strain_smoothing:', or write 0.45",
            name, poisson);
    else if (poisson < 0.3 && !held)
        odd(r, line,
            "region '%s': Poisson's ratio %.3g makes it compressible like a sponge; give 0.45 to 0.49 for tissue", name,
            poisson);
    if ((m->density_kg_m3 < 200 || m->density_kg_m3 > 2500))
        odd(r, line,
            "region '%s': no tissue has a density of %g kg/m3; give a value like fat 911, liver 1079, bone 1908", name,
            m->density_kg_m3);
}

/* Marks vertices that are fixed or rigid. Returns their number. */
static int32_t mark_held(const sim *s, uint8_t *held) {
    int32_t count = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) held[v] = s->support_of && s->support_of[v];
    for (int32_t i = 0; i < 4 * s->mesh->tet_count && s->rigid_tet; i++)
        if (s->rigid_tet[i / 4]) held[s->mesh->tet[i]] = 1;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) count += held[v];
    return count;
}

/* Returns whether a piece without support comes to lie on others: contact of tissue, and weight. */
static bool can_lie(const sim *s) { return sim_has(s, "touch") && sim_has(s, "gravity"); }

static void report_loose(review *r, const int32_t *parent, const uint8_t *hangs) {
    const sim *s = r->s;
    int32_t loose = 0, pieces = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++)
        if (parent[v] == v) pieces++, loose += !hangs[v];
    if (!loose || can_lie(s)) return;
    odd(r, s->scene->support.line,
        s->body_count
            ? "%d of the %d connected pieces of all bodies %s without support and will drift; support each, tie it (ties:), or let it lie on others (gravity: and touch:)"
            : "%d of the mesh's %d connected pieces %s without support and will drift; support each, or mesh them as one",
        loose, pieces, loose == 1 ? "is" : "are");
}

/* Finds connected components of the mesh, joined by ties too, without a fixed vertex. */
static void check_pieces(review *r, const uint8_t *held, int32_t *parent, uint8_t *hangs) {
    const tm_mesh *m = r->s->mesh;
    const tm_ties *ties = r->s->model->world ? tm_world_ties(r->s->model->world) : NULL;
    for (int32_t v = 0; v < m->vertex_count; v++) parent[v] = v;
    for (int32_t e = 0; e < m->edge_count; e++) law_join(parent, m->edge[2 * e], m->edge[2 * e + 1]);
    for (int32_t i = 0; ties && i < tm_ties_count(ties); i++)
        law_join(parent, tm_ties_get(ties, i).vertex, tm_ties_get(ties, i).other[0]);
    for (int32_t v = 0; v < m->vertex_count; v++) hangs[law_root(parent, v)] |= held[v];
    report_loose(r, parent, hangs);
}

/* Reports missing supports, and too many; `moves` and `held` [vertex_count]. */
static void check_share(review *r, uint8_t *moves, const uint8_t *held, int32_t all_held) {
    const sim *s = r->s;
    int32_t soft = 0, soft_held = 0;
    for (int32_t i = 0; i < 4 * s->mesh->tet_count; i++) moves[s->mesh->tet[i]] |= !r->held[s->mesh->region[i / 4]];
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) soft += moves[v], soft_held += moves[v] && held[v];
    if (!all_held)
        odd(r, s->scene->support.line,
            "the organ has no supports and moves away when it is pushed; add 'supports:' (tm-scene new proposes some)");
    else if (soft_held > soft / 2)
        odd(r, s->scene->support.line,
            "%.0f %% of the vertices of movable regions are fixed; make the selectors narrower",
            100.0 * soft_held / soft);
}

static void check_supports(review *r) {
    const size_t n = (size_t)r->s->mesh->vertex_count;
    int32_t *parent = malloc(sizeof *parent * n);
    uint8_t *hangs = calloc(n, 1), *moves = calloc(n, 1), *held = calloc(n, 1);
    if (parent && hangs && moves && held) {
        const int32_t all_held = mark_held(r->s, held);
        check_share(r, moves, held, all_held);
        if (all_held) check_pieces(r, held, parent, hangs);
    }
    free(parent);
    free(hangs);
    free(moves);
    free(held);
}

/* Returns the smallest distance of the scripted tip from the surface at rest, measured from the tip's centre. */
static double nearest_way_m(const sim *s, int i) {
    enum { TIMES = 200 };
    const hrt_hand_script *hand = &s->hand[i];
    const double end_s = hand->key_count ? hand->key[hand->key_count - 1].time_s : 0;
    double best = INFINITY;
    for (int k = 0; k <= TIMES && best > 0; k++) {
        const tm_tool_pose pose = sim_hand_pose(s, i, end_s * k / TIMES);
        best = fmin(best, sim_is_inside(s->mesh, pose.tip_m)
                              ? 0
                              : sim_surface_distance(s, pose.tip_m) - s->instrument_def[i].radius_m);
    }
    return fmax(best, 0);
}

/* Computes how deep a waypoint leads the tip into the tissue at rest along the shaft, and the thickness there. Returns
 * false if the tip stays outside. */
static bool depth_m(const sim *s, int i, double time_s, double *depth, double *thickness) {
    const tm_instrument_def *tool = &s->instrument_def[i];
    const tm_tool_pose pose = sim_hand_pose(s, i, time_s);
    double from[3], along[3], back[3], beyond[3];
    const double reach = sim_shaft_start(s, i, &pose, from, along),
                 way = sim_way_to_touch(s->mesh, from, along, tool->radius_m), far = way + 4 * size_m(s->mesh);
    for (int a = 0; a < 3; a++) back[a] = -along[a], beyond[a] = from[a] + far * along[a];
    const double behind = way < 0 ? -1 : sim_way_to_touch(s->mesh, beyond, back, tool->radius_m);
    if (way < 0 || behind < 0) return false;
    *depth = reach - way, *thickness = far - behind - way;
    return *depth > 0 && *thickness > 0;
}

static void check_depth(review *r, int i) {
    const double deep = 0.4; /* of the thickness: the rest bears 1.5 times a linear law's force */
    const sim *s = r->s;
    double worst = 0, depth, thickness, worst_m = 0, of_m = 0;
    if (sim_has(s, "rotation") || sim_law_line(s->scene)) return;
    for (int k = 0; k < s->hand[i].key_count; k++)
        if (depth_m(s, i, s->hand[i].key[k].time_s, &depth, &thickness) && depth / thickness > worst)
            worst = depth / thickness, worst_m = depth, of_m = thickness;
    if (worst > deep)
        odd(r, s->scene->hand.line,
            "the hand of instrument %d presses %.3g mm into %.3g mm of linear tissue, which is far outside its range; press less, or add 'rotation:' or a nonlinear 'law:'",
            i, 1e3 * worst_m, 1e3 * of_m);
}

static void check_hands(review *r) {
    const sim *s = r->s;
    const app_instrument *all = s->scene->instrument.item;
    if (!s->instrument_count) odd(r, 0, "the scene has no instruments; add 'instruments:' (tm-scene new proposes one)");
    for (int i = 0; i < s->instrument_count; i++) {
        if (!s->instrument_def[i].is_free && sim_is_inside(s->mesh, all[i].trocar.v))
            odd(r, all[i].trocar.line,
                "the trocar of instrument %d is inside the tissue; move it outside, into the body wall", i);
        if (!s->hand[i].key_count) {
            odd(r, all[i].here.line, "instrument %d does not move: no 'hand:' and no device; add one", i);
            continue;
        }
        const double gap_m = sim_has(s, "contact") ? nearest_way_m(s, i) : 0;
        if (gap_m > 0)
            odd(r, s->scene->hand.line,
                "the hand of instrument %d stays at least %.3g mm from the tissue; move it nearer ('above: -3 mm')", i,
                1e3 * gap_m);
        if (sim_has(s, "contact")) check_depth(r, i);
        const double end_s = s->hand[i].key[s->hand[i].key_count - 1].time_s;
        if (s->scene->duration.si < 0.9 * end_s)
            odd(r, s->scene->duration.line,
                "the run ends at %g s, before the hand of instrument %d at %g s; write time.duration: %g s",
                s->scene->duration.si, i, end_s, end_s);
    }
    if (!sim_has(s, "haptics")) odd(r, 0, "no 'haptics:': forces reach no device; add it");
    if (!sim_has(s, "rendering")) odd(r, 0, "no 'rendering:': sessions and logs have no pictures; add it");
    if (!sim_has(s, "damping") && !sim_has(s, "viscosity"))
        odd(r, 0, "no 'damping:': touched tissue oscillates for a long time; add 'damping: {rate: 40 /s}'");
}

/* Reports the region that requires the most substeps, and whether one tetrahedron or all of them cause it. */
static void check_timing(review *r) {
    const sim *s = r->s;
    const int32_t n = s->mesh->tet_count, regions = s->file.region_count;
    double *step = malloc(sizeof *step * (size_t)n), *least = malloc(sizeof *least * (size_t)regions);
    int32_t worst = 0;
    for (int32_t g = 0; least && g < regions; g++) least[g] = INFINITY;
    for (int32_t t = 0; step && least && t < n; t++) {
        step[t] = tm_critical_step_element(s->model->tissue, t);
        least[s->mesh->region[t]] = fmin(least[s->mesh->region[t]], step[t]);
        if (step[t] < step[worst]) worst = t;
    }
    if (step && least) {
        const int32_t g = s->mesh->region[worst];
        const double worst_s = step[worst];
        double others = INFINITY;
        for (int32_t k = 0; k < regions; k++)
            if (k != g) others = fmin(others, least[k]);
        if (isfinite(others) && worst_s < 0.4 * others) {
            const app_material *entry = entry_of(s->scene, s->file.region_name[g]);
            odd(r, entry ? entry->region.line : 0,
                "region '%s' makes a frame take %d substeps, about %d too many: the others need %.1f times fewer; make it softer, support it, or mesh it coarser",
                s->file.region_name[g], s->substeps, (int)(s->substeps * (1 - worst_s / others)), others / worst_s);
        }
        char name[SIM_TET_NAME];
        num_sort(step, n);
        if (worst_s < 0.2 * step[n / 100])
            odd(r, app_mesh_line(s->scene),
                "tetrahedron %s makes the step %.1f times shorter than 99 of 100 need, about %d substeps too many; see tm-mesh info, mesh again or repair",
                sim_tet_name(s, worst, name), step[n / 100] / worst_s,
                (int)(s->substeps * (1 - worst_s / step[n / 100])));
    }
    free(step);
    free(least);
}

/* Returns whether the precomputed model takes the scene's effects. */
static bool can_be_precomputed(const sim *s) {
    static const char model[] = "precomputed";
    bool can = !sim_law_line(s->scene);
    for (int e = 0; e < sim_effect_count; e++)
        for (int i = 0; i < 4 && sim_effects[e]->excludes[i].other; i++) {
            const char *other = sim_effects[e]->excludes[i].other;
            if (!strcmp(other, model) && sim_effect_line(s->scene, e)) can = false;
            if (!strcmp(sim_effects[e]->name, model) && sim_has(s, other)) can = false;
        }
    for (int32_t i = 0; i < s->body_count; i++) can = can && !((const app_body *)s->scene->body.item)[i].path.count;
    return can;
}

/* Returns the time to compute one frame at rest, best of three, over the frame's duration. */
static double frame_share(sim *s) {
    double best = INFINITY;
    for (int i = 0; i < 4; i++) {
        const int64_t begin = app_monotonic_us();
        if (sim_frame(s, s->pose, s->substeps)) return INFINITY;
        if (i) best = fmin(best, 1e-6 * (double)(app_monotonic_us() - begin) / s->frame_s);
    }
    return best;
}

int check_scene(const char *path, bool strict) {
    app_scene *scene;
    review r = {0};
    int rc = app_exit_code(sim_scene_load(path, NULL, 0, app_program_host(), &scene));
    if (rc) return rc;
    rc = app_exit_code(sim_create(scene, &r.s));
    if (rc) return rc;
    r.held = calloc((size_t)r.s->file.region_count, sizeof *r.held);
    if (!r.held) {
        sim_destroy(r.s);
        return app_bad_input(path, 0, "no memory; use a coarser mesh") - 1;
    }
    for (int32_t g = 0; g < r.s->file.region_count; g++) r.held[g] = is_held(r.s, g);
    check_size(&r);
    for (int32_t g = 0; g < r.s->file.region_count; g++)
        if (!is_rigid(r.s, g)) check_region(&r, g);
    check_supports(&r);
    check_hands(&r);
    if (r.s->model->tissue && r.s->scene->model.index == APP_DYNAMIC) check_timing(&r);
    const double share = frame_share(r.s);
    if (share > 0.9)
        odd(&r, r.s->scene->time.line,
            "a frame takes %.2g times its real time on this machine now: %d tetrahedra, %d substeps; %s", share,
            r.s->mesh->tet_count, r.s->substeps,
            can_be_precomputed(r.s) ? "mesh it coarser, or write model: precomputed"
                                    : "mesh it coarser, or set 'threads:'");
    if (!app_is_quiet() || r.odd)
        printf("%s: %d tetrahedra, %.3g mm, %d substeps a frame, %.2g of its time; %s\n", path, r.s->mesh->tet_count,
               1e3 * size_m(r.s->mesh), r.s->substeps, share, r.odd ? "see the warnings above" : "no warnings");
    free(r.held);
    sim_destroy(r.s);
    return r.odd && strict ? APP_BAD_INPUT : 0;
}
