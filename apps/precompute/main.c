/* tm-precompute: computes the responses of a scene's tissue in advance, with all threads and ranks. */
#include <cjson/cJSON.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "app.h"
#include "common/program_host.h"
#include "json_file.h"
#include "ranks.h"
#include "scene/solve_api.h"

enum { MAX_SETS = 64 };

static const char help[] =
    "%s SCENE.yaml [options]: computes the responses of the surface for `model: precomputed` and stores "
    "them where tm-sim finds them\n"
    "\n"
    "  --out FILE            write to this file instead of the cache\n"
    "  --solver NAME         use cholesky or cg instead of the scene's (precomputed.solver)\n"
    "  --precision NAME      use double or single instead of the scene's (precomputed.precision)\n"
    "  --factor NAME         each: every rank computes a factor (default); distributed: ranks share one "
    "(MUMPS)\n"
    "  --threads N           threads of each process; default: one for each core\n"
    "  --memory MB           largest memory to use; default: what is available\n"
    "  --set PATH=VALUE      override a value of the scene; may be repeated\n"
    "  --keep                keep a file that already contains these responses\n"
    "  --json FILE           write times and sizes\n"
    "  --quiet               print warnings and errors only\n"
    "  -h, --help, --version\n"
    "\n"
    "Built with Open MPI (make MPI=1) it is tm-precompute-mpi, and `mpirun -n 4 tm-precompute-mpi "
    "SCENE.yaml` distributes the columns over the\n"
    "ranks, which write them into one file. The result is bit-identical, with --factor distributed equal "
    "within rounding. A run that is\n"
    "stopped or killed leaves the old file, and its own columns in FILE.part: the same command, with any "
    "number of ranks, continues.\n"
    "Exit: 0 done, 2 bad input (file:line: what; what to do), 1 anything else.\n";

enum { OUT = 1000, SOLVER, FACTOR, PRECISION, THREADS, MEMORY, SET, KEEP, JSON, QUIET, VERSION, HELP = 'h' };
static const struct option long_options[] = {
    {"out", required_argument, NULL, OUT},
    {"solver", required_argument, NULL, SOLVER},
    {"precision", required_argument, NULL, PRECISION},
    {"factor", required_argument, NULL, FACTOR},
    {"threads", required_argument, NULL, THREADS},
    {"memory", required_argument, NULL, MEMORY},
    {"set", required_argument, NULL, SET},
    {"keep", no_argument, NULL, KEEP},
    {"json", required_argument, NULL, JSON},
    {"help", no_argument, NULL, HELP},
    {"quiet", no_argument, NULL, QUIET},
    {"version", no_argument, NULL, VERSION},
    {NULL, 0, NULL, 0},
};

typedef struct choice {
    const char *scene, *out, *json;
    char set[MAX_SETS][512], *set_list[MAX_SETS];
    int set_count;
    int32_t threads;
    int64_t memory_bytes;
    bool keep, shared;
} choice;

static int usage(const char *what, const char *argument) {
    fprintf(stderr, "%s: ", team_name);
    fprintf(stderr, what, argument);
    fputs("\n", stderr);
    return APP_BAD_INPUT;
}

static int add_set(choice *o, const char *path, const char *value) {
    if (o->set_count == MAX_SETS) return usage("more than 64 --set%s; write a scene instead", "");
    o->set_list[o->set_count] = o->set[o->set_count];
    if (snprintf(o->set[o->set_count], sizeof o->set[0], "%s%s", path, value) >= (int)sizeof o->set[0])
        return usage("'%s' is too long", value);
    o->set_count++;
    return 0;
}

static int whole_number(const char *text, const char *name, long least, long most, long *number) {
    char *end;
    *number = strtol(text, &end, 10);
    if (*end || end == text || *number < least || *number > most) {
        fprintf(stderr, "%s: %s '%s': give a whole number from %ld to %ld\n", team_name, name, text, least, most);
        return APP_BAD_INPUT;
    }
    return 0;
}

static int take_option(choice *o, int option, char **all) {
    long number = 0;
    int rc = 0;
    switch (option) {
    case OUT: o->out = optarg; return 0;
    case SOLVER: return add_set(o, "precomputed.solver=", optarg);
    case FACTOR:
        o->shared = !strcmp(optarg, "distributed");
        return o->shared || !strcmp(optarg, "each") ? 0 : usage("--factor '%s': give each or distributed", optarg);
    case PRECISION: return add_set(o, "precomputed.precision=", optarg);
    case THREADS:
        rc = whole_number(optarg, "--threads", 1, 1024, &number);
        o->threads = (int32_t)number;
        return rc;
    case MEMORY:
        rc = whole_number(optarg, "--memory", 1, 1L << 40, &number);
        o->memory_bytes = (int64_t)number * 1000000;
        return rc;
    case SET:
        if (!strchr(optarg, '='))
            return usage("--set '%s' is not PATH=VALUE; write for example --set tissue.scale=0.5", optarg);
        return add_set(o, "", optarg);
    case QUIET: app_be_quiet(); return 0;
    case KEEP: o->keep = true; return 0;
    case JSON: o->json = optarg; return 0;
    case 1:
        if (o->scene) return usage("'%s' is a second scene; give one", optarg);
        o->scene = optarg;
        return 0;
    default: return usage("unknown option, or its value is missing: '%s'; --help lists them", all[optind - 1]);
    }
}

static int parse(choice *o, int count, char **all) {
    opterr = 0;
    for (;;) {
        const int option = getopt_long(count, all, "-h", long_options, NULL);
        if (option == -1) break;
        if (option == HELP || option == VERSION) {
            if (option == HELP)
                printf(help, team_name);
            else
                printf("%s %s\n", team_name, tm_version());
            exit(team_end(0));
        }
        const int rc = take_option(o, option, all);
        if (rc) return rc;
    }
    if (!o->scene) return usage("the scene is missing%s; give one, or --help", "");
    return 0;
}

/* Prints the maximum memory of each rank, and its factor's. */
static void tell_ranks(const tm_solve_ranks *team, int64_t factor_bytes, cJSON *json) {
    const int32_t count = team ? team->count : 1;
    struct rusage used;
    getrusage(RUSAGE_SELF, &used);
    double *factor = calloc((size_t)count, sizeof *factor), *peak = calloc((size_t)count, sizeof *peak);
    if (factor && peak) {
        team_gather((double)factor_bytes, factor);
        team_gather(1024.0 * (double)used.ru_maxrss, peak);
        for (int32_t i = 0; json && i < count; i++) {
            if (count > 1 && !app_is_quiet())
                printf("rank %d: factor %.1f MB, %.1f MB at most in all\n", (int)i, 1e-6 * factor[i], 1e-6 * peak[i]);
            cJSON *row = cJSON_CreateObject();
            cJSON_AddItemToArray(json, row);
            cJSON_AddNumberToObject(row, "factor_bytes", factor[i]);
            cJSON_AddNumberToObject(row, "peak_bytes", peak[i]);
        }
    }
    free(factor);
    free(peak);
}

static int report(const choice *o, const tm_solve_ranks *team, const tm_solve_report *r, const char *file,
                  app_file *json) {
    if (team && team->rank > 0) {
        tell_ranks(team, r->factor_bytes, NULL);
        return 0;
    }
    cJSON *j = cJSON_CreateObject();
    cJSON_AddStringToObject(j, "scene", o->scene);
    cJSON_AddStringToObject(j, "file", file);
    cJSON_AddBoolToObject(j, "from_file", r->from_file);
    cJSON_AddNumberToObject(j, "columns", r->columns);
    cJSON_AddNumberToObject(j, "columns_found", r->columns_found);
    cJSON_AddNumberToObject(j, "free_dofs", r->free_dofs);
    cJSON_AddNumberToObject(j, "factor_bytes", (double)r->factor_bytes);
    cJSON_AddNumberToObject(j, "responses_bytes", (double)r->responses_bytes);
    cJSON_AddNumberToObject(j, "work_bytes", (double)r->work_bytes);
    cJSON_AddNumberToObject(j, "order_s", r->order_s);
    cJSON_AddNumberToObject(j, "factor_s", r->factor_s);
    cJSON_AddNumberToObject(j, "seconds", r->seconds);
    if (!app_is_quiet())
        printf("%s: %d columns%s, %.1f MB, %.2f s (factor %.1f MB)\n", file, r->columns,
               r->from_file ? " already there" : "", (double)r->responses_bytes * 1e-6, r->seconds,
               (double)r->factor_bytes * 1e-6);
    if (r->columns_found && !app_is_quiet())
        printf("%d of them were computed by an earlier run that did not finish\n", r->columns_found);
    tell_ranks(team, r->factor_bytes, cJSON_AddArrayToObject(j, "ranks"));
    return app_file_end_json(json, j);
}

/* Returns the options of `precomputed`, even if the scene has another model. */
static const sim_solve_options *options_of(const sim *s) {
    return s->scene->effect[sim_effect_find(s->scene, "precomputed")];
}

static int compute(sim *s, const choice *o, const tm_solve_ranks *team, app_file *json) {
    const sim_solve_options *options = options_of(s);
    char path[SIM_SOLVE_PATH];
    tm_error error = {0};
    tm_solve_report r = {0};
    sim_solve_api api;
    if (!sim_solve_open(&s->scene->host, &api, &error))
        return app_exit_code(sim_report(s->scene, s->scene->model.line, &error));
    int rc = 0;
    tm_precomputed_def def = api.tm_precomputed_def_default_();
    s->def.model.cut = NULL; /* responses of uncut tissue */
    sim_solve_set(s, options, "precomputed", path,
                  &(sim_solve_members){&def.problem, &def.precision, &def.max_contact_vertices, &def.file});
    if (o->out) def.file = o->out;
    if (!def.file) rc = usage("the scene has no cache (precomputed.cache)%s; add --out FILE", "");
    const bool first = !team || team->rank == 0;
    def.problem.threads = o->threads;
    def.problem.memory_limit_bytes = o->memory_bytes;
    if (!first) def.problem.progress = NULL;
    def.ranks = team;
    def.resume = true;
    const bool alone = !team || team->count == 1;
    if (!rc && o->keep && !alone) rc = usage("--keep%s works only with one process; leave it out under mpirun", "");
    const tm_status status = rc        ? TM_OK
                             : o->keep ? api.tm_model_precomputed_(&s->def.model, &def, &s->model, &r, &error)
                                       : api.tm_model_precompute_(&s->def.model, &def, &r, &error);
    if (!rc && status)
        rc = app_report(status == TM_ERR_FILE ? NULL : o->scene, status == TM_ERR_FILE ? 0 : s->scene->tissue.line,
                        &error);
    return rc ? rc : report(o, team, &r, def.file, json);
}

static int run(const choice *o, const tm_solve_ranks *team) {
    app_scene *scene;
    sim *s;
    app_file json = {0};
    const bool first = !team || team->rank == 0;
    int rc = app_exit_code(sim_scene_load(o->scene, o->set_list, o->set_count, app_program_host(), &scene));
    if (rc) return rc;
    rc = app_exit_code(sim_prepare(scene, &s));
    if (rc) return rc;
    if (first) rc = app_file_begin(&json, o->json);
    if (!rc) rc = compute(s, o, team, &json);
    app_file_end(&json, false);
    sim_destroy(s);
    return rc;
}

int main(int count, char **all) {
    static choice o;
    const tm_solve_ranks *team = team_begin(&count, &all);
    app_check_stdout();
    app_catch_signals();
    int rc = parse(&o, count, all);
    /* Checks the scene like any other, whatever its model. */
    if (!rc) rc = add_set(&o, "model=", "dynamic");
    if (!rc && o.shared && !team_share_factor(o.threads))
        rc = usage("--factor distributed%s: this program was built without MUMPS or without ranks; make MPI=1 MUMPS=1 "
                   "(libmumps-dev), or leave it out",
                   "");
    if (!rc) rc = app_ended(team_name, run(&o, team));
    return team_end(rc);
}
