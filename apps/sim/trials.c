/* tm-sim --trials: many short computations of one scene in one process, for programs that fit or compare. A request is
 * a line of JSON, and so is its answer; docs/fitting.md describes both.
 *
 * A settled trial starts from the rest of the trial before it: where a constant or a support changed little, Newton's
 * method then needs one or two solutions. */
#include <cjson/cJSON.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/program_host.h"
#include "run.h"
#include "trials.h"

enum { TEXT = 1000 };

typedef struct trials {
    const run_options *o;
    app_host host;
    tm_diagnostics said;
    double *rest_m; /* [3*vertices] of the last settled trial */
    int32_t vertices;
    trial_shifts shifts;
} trials;

/* --- requests --- */

typedef struct request {
    char *set[RUN_MAX_SETS];
    int set_count;
    double tolerance, duration_s; /* one of them is above 0 */
    const cJSON *points, *slopes; /* slopes may be null */
    bool cold;
} request;

static const char *read_sets(const trials *t, const cJSON *line, request *r) {
    const cJSON *list = cJSON_GetObjectItem(line, "set"), *one;
    for (; r->set_count < t->o->set_count; r->set_count++) r->set[r->set_count] = t->o->set[r->set_count];
    cJSON_ArrayForEach(one, list) {
        if (!cJSON_IsString(one)) return "'set' is not a list of texts; write \"set\": [\"PATH=VALUE\"]";
        if (r->set_count >= RUN_MAX_SETS) return "more than 64 settings; write a scene instead";
        r->set[r->set_count++] = one->valuestring;
    }
    return NULL;
}

/* Reads a request. Returns null, or what is wrong and what to do. */
static const char *read_request(const trials *t, const cJSON *line, request *r) {
    const cJSON *settle = cJSON_GetObjectItem(line, "settle"), *duration = cJSON_GetObjectItem(line, "duration");
    const cJSON *one, *axis;
    if (!cJSON_IsObject(line)) return "the line is no JSON object; write {\"settle\": 1e-8}";
    const char *wrong = read_sets(t, line, r);
    if (wrong) return wrong;
    r->tolerance = cJSON_IsNumber(settle) ? settle->valuedouble : 0;
    r->duration_s = cJSON_IsNumber(duration) ? duration->valuedouble : 0;
    if ((r->tolerance > 0) == (r->duration_s > 0))
        return "neither or both of 'settle' and 'duration'; give one, above 0: {\"settle\": 1e-8}";
    r->cold = cJSON_IsTrue(cJSON_GetObjectItem(line, "cold"));
    r->points = cJSON_GetObjectItem(line, "points");
    r->slopes = cJSON_GetObjectItem(line, "slopes");
    if (r->slopes && !(r->tolerance > 0)) return "'slopes' are those of a rest; give 'settle' with them";
    if (cJSON_GetArraySize(r->points) > POINTS_MAX) return "more than 256 points; give fewer";
    cJSON_ArrayForEach(one, r->points) {
        if (cJSON_GetArraySize(one) != 3) return "a point has not three numbers; write \"points\": [[0.1, 0, 0]]";
        cJSON_ArrayForEach(axis, one) if (!cJSON_IsNumber(axis)) return "a point's coordinate is no number; give m";
    }
    return NULL;
}

/* --- points --- */

/* Finds the tetrahedron that holds x, or the one that it lies outside of the least (by its smallest coordinate). */
static trial_point find_point(const tm_mesh *mesh, const double x[3]) {
    trial_point best = {.tet = -1};
    double best_least = -HUGE_VAL;
    for (int32_t tet = 0; tet < mesh->tet_count; tet++) {
        double weight[4], least = HUGE_VAL;
        for (int k = 0; k < 4; k++) {
            /* The coordinate of vertex k is 1 there, and falls along its shape vector. */
            const double *at = mesh->rest_m + 3 * (int64_t)mesh->tet[4 * (int64_t)tet + k];
            const double *shape = mesh->shape_1_m + 12 * (int64_t)tet + 3 * k;
            weight[k] = 1;
            for (int a = 0; a < 3; a++) weight[k] += shape[a] * (x[a] - at[a]);
            least = fmin(least, weight[k]);
        }
        if (least <= best_least) continue;
        best_least = least;
        best.tet = tet;
        memcpy(best.weight, weight, sizeof weight);
    }
    return best;
}

static int find_points(const tm_mesh *mesh, const cJSON *list, trial_point found[POINTS_MAX]) {
    int count = 0;
    const cJSON *one;
    cJSON_ArrayForEach(one, list) {
        double x[3];
        for (int a = 0; a < 3; a++) x[a] = cJSON_GetArrayItem(one, a)->valuedouble;
        found[count++] = find_point(mesh, x);
    }
    return count;
}

/* --- answers --- */

static void add_vectors(cJSON *to, const double (*v)[3], int count) {
    cJSON *list = cJSON_CreateArray();
    for (int i = 0; i < count; i++) cJSON_AddItemToArray(list, cJSON_CreateDoubleArray(v[i], 3));
    cJSON_AddItemToArray(to, list);
}

/* Appends displacements of the points and forces of supports and instruments on the tissue, as they are now. */
static void add_state(const sim *s, const trial_point *at, int count, const double *reaction, cJSON *answer) {
    const double *u = sim_displacement(s);
    double moved[POINTS_MAX][3] = {{0}}, touch[TM_MAX_INSTRUMENTS][3];
    for (int i = 0; i < count; i++)
        for (int k = 0; k < 4; k++)
            for (int a = 0; a < 3; a++)
                moved[i][a] += at[i].weight[k] * u[3 * (int64_t)s->mesh->tet[4 * (int64_t)at[i].tet + k] + a];
    add_vectors(cJSON_GetObjectItem(answer, "points_m"), (const double(*)[3])moved, count);
    cJSON *forces = cJSON_CreateArray();
    for (int i = 0; i < s->scene->support.count; i++) {
        double sum[3];
        run_support_force(s, i, reaction, sum);
        cJSON_AddItemToArray(forces, cJSON_CreateDoubleArray(sum, 3));
    }
    cJSON_AddItemToArray(cJSON_GetObjectItem(answer, "supports_N"), forces);
    for (int i = 0; i < s->instrument_count; i++)
        memcpy(touch[i], tm_model_reaction(s->model, i).force_N, sizeof touch[i]);
    add_vectors(cJSON_GetObjectItem(answer, "instruments_N"), (const double(*)[3])touch, s->instrument_count);
    cJSON_AddItemToArray(cJSON_GetObjectItem(answer, "time_s"), cJSON_CreateNumber(sim_time_s(s)));
}

static cJSON *begin_answer(const sim *s) {
    cJSON *answer = cJSON_CreateObject(), *names = cJSON_AddArrayToObject(answer, "supports");
    for (int i = 0; i < s->scene->support.count; i++) {
        const app_support *support = (const app_support *)s->scene->support.item + i;
        cJSON_AddItemToArray(names, cJSON_CreateString(support->name.s));
    }
    static const char *const list[] = {"time_s", "points_m", "supports_N", "instruments_N"};
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) cJSON_AddArrayToObject(answer, list[i]);
    return answer;
}

static cJSON *refuse(const char *text) {
    cJSON *answer = cJSON_CreateObject();
    cJSON_AddStringToObject(answer, "error", text);
    return answer;
}

/* Returns the first fault that reading or running the scene told. */
static cJSON *refuse_told(const trials *t, const char *otherwise) {
    char text[TEXT];
    for (int32_t i = 0; i < t->said.count; i++)
        if (t->said.item[i].severity == TM_FAULT) {
            tm_diagnostic_format(t->said.item + i, text, sizeof text);
            return refuse(text);
        }
    return refuse(otherwise);
}

/* --- trials --- */

static bool on_progress(void *user, int64_t step, double residual) {
    (void)user, (void)step, (void)residual;
    return !app_interrupted();
}

/* Puts the last trial's rest into a world of the same vertices. Returns whether it did. */
static bool warm(const trials *t, const sim *s, const request *r) {
    if (r->cold || !t->rest_m || !s->model->world || s->instrument_count || t->vertices != s->mesh->vertex_count)
        return false;
    const size_t bytes = 3 * (size_t)t->vertices * sizeof *t->rest_m;
    tm_state *state = tm_world_state(s->model->world);
    memcpy(state->u_m, t->rest_m, bytes);
    memcpy(state->u_prev_m, t->rest_m, bytes);
    return true;
}

/* Adds what is doubtful about an equilibrium, as a sentence. */
static void add_doubt(const sim *s, const tm_deformation *shape, cJSON *answer) {
    static const double TOLD_SHARE = 0.01;
    char sentence[TM_ERROR_MESSAGE_MAX] = "";
    const int32_t limited = s->model->world ? tm_world_limited_tets(s->model->world) : 0;
    if (!tm_tissue_check_deformation(s->model->tissue, shape, sentence) && limited > TOLD_SHARE * sim_alive(s))
        snprintf(sentence, sizeof sentence,
                 "%d of %d tetrahedra are beyond the limit of their law; allow a larger 'stretch:', or leave it out",
                 (int)limited, (int)sim_alive(s));
    if (sentence[0]) cJSON_AddStringToObject(answer, "doubt", sentence);
}

static tm_status settle(const trials *t, sim *s, const request *r, double *u, double *reaction,
                        tm_settle_result *result, tm_error *error) {
    tm_settle_def def = tm_settle_def_default();
    def.tolerance = r->tolerance;
    def.progress = on_progress;
    const bool warmed = warm(t, s, r);
    tm_status status = run_insert_tools(s);
    if (status) {
        snprintf(error->message, sizeof error->message, "the instruments' way in blew up; lower time.step_fraction");
        return status;
    }
    status = tm_model_settle(s->model, &def, u, reaction, result, error);
    if (!status || !warmed || app_interrupted()) return status;
    tm_state *state = tm_world_state(s->model->world); /* from the beginning, in load steps */
    memset(state->u_m, 0, 3 * (size_t)s->mesh->vertex_count * sizeof *u);
    memset(state->u_prev_m, 0, 3 * (size_t)s->mesh->vertex_count * sizeof *u);
    return tm_model_settle(s->model, &def, u, reaction, result, error);
}

static cJSON *settled(trials *t, sim *s, const request *r, const trial_point *at, int count) {
    const size_t n = 3 * (size_t)s->mesh->vertex_count;
    tm_settle_result result = {0};
    tm_error error = {0};
    double *u = calloc(2 * n, sizeof *u);
    if (!u) return refuse("out of memory; use a smaller mesh");
    if (settle(t, s, r, u, u + n, &result, &error)) {
        free(u);
        return refuse(error.message);
    }
    cJSON *answer = begin_answer(s);
    add_state(s, at, count, u + n, answer);
    add_doubt(s, &result.deformation, answer);
    if (r->slopes) trial_add_slopes(&t->shifts, t->o, &t->host, s, at, count, r->slopes, answer);
    free(t->rest_m);
    t->rest_m = u;
    t->vertices = s->mesh->vertex_count;
    return answer;
}

static cJSON *moved(sim *s, const request *r, const trial_point *at, int count) {
    const int64_t frames = llround(r->duration_s / s->frame_s);
    double *reaction = calloc(3 * (size_t)s->mesh->vertex_count, sizeof *reaction);
    if (!reaction) return refuse("out of memory; use a smaller mesh");
    cJSON *answer = begin_answer(s);
    for (int64_t f = 0; f <= frames; f++) {
        if (s->model->world && f) {
            memset(reaction, 0, 3 * (size_t)s->mesh->vertex_count * sizeof *reaction);
            tm_support_reaction(s->model->world, reaction);
        }
        add_state(s, at, count, reaction, answer);
        if (f == frames) break;
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        for (int i = 0; i < s->instrument_count; i++) to[i] = sim_hand_pose(s, i, (double)(f + 1) * s->frame_s);
        const tm_status status = sim_frame(s, to, s->substeps);
        if (!status && !app_interrupted()) continue;
        cJSON_Delete(answer);
        answer = refuse(status ? "a displacement stopped being finite; lower time.step_fraction" : "interrupted");
        break;
    }
    free(reaction);
    return answer;
}

static cJSON *one_trial(trials *t, const cJSON *line) {
    request r = {0};
    app_scene *scene;
    sim *s;
    const char *wrong = read_request(t, line, &r);
    if (wrong) return refuse(wrong);
    tm_diagnostics_clear(&t->said);
    if (sim_scene_load(t->o->scene, r.set, r.set_count, &t->host, &scene))
        return refuse_told(t, "the scene cannot be read; tm-sim SCENE --check says why");
    scene->strict = t->o->strict;
    scene->pace = SIM_FRAMES;
    if (sim_create(scene, &s)) return refuse_told(t, "the scene cannot be built; tm-sim SCENE --check says why");
    trial_point *at = malloc(POINTS_MAX * sizeof *at);
    const int count = at ? find_points(s->mesh, r.points, at) : 0;
    cJSON *answer = !at               ? refuse("out of memory; use a smaller mesh")
                    : r.tolerance > 0 ? settled(t, s, &r, at, count)
                                      : moved(s, &r, at, count);
    free(at);
    sim_destroy(s);
    return answer;
}

/* Answers one line. Returns false if stdout does not take the answer. */
static bool answer_line(trials *t, const char *text) {
    cJSON *line = cJSON_Parse(text);
    cJSON *answer = line ? one_trial(t, line) : refuse("the line is not JSON; write {\"settle\": 1e-8}");
    char *out = cJSON_PrintUnformatted(answer);
    const bool good = out && puts(out) >= 0 && fflush(stdout) == 0;
    free(out);
    cJSON_Delete(answer);
    cJSON_Delete(line);
    return good;
}

int run_trials(const run_options *o) {
    trials t = {.o = o, .host = *app_program_host()};
    const bool from_stdin = !strcmp(o->trials, "-");
    FILE *in = from_stdin ? stdin : fopen(o->trials, "r");
    char *text = NULL;
    size_t room = 0;
    int rc = APP_DONE;
    if (!in)
        return app_bad_input(o->trials, 0, "cannot be read: %s; give a file of requests, or - for stdin",
                             strerror(errno));
    t.host.diagnostics = &t.said;
    app_be_quiet();
    while (!rc && !app_interrupted() && getline(&text, &room, in) > 0)
        if (text[strspn(text, " \t\r\n")] && !answer_line(&t, text)) rc = APP_FAILED;
    if (!from_stdin) fclose(in);
    free(text);
    free(t.rest_m);
    trial_shifts_free(&t.shifts);
    tm_diagnostics_clear(&t.said);
    return app_interrupted() ? app_interrupted_exit() : rc;
}
