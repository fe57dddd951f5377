/* tm-evaluate: errors of extrapolated forces, from logs or from its own sessions. */
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "bandwidth.h"
#include "evaluate.h"
#include "json_file.h"

static void usage(FILE *to) {
    fprintf(
        to,
        "usage: tm-evaluate LOG...            measures the errors of every extrapolator on recorded sessions (LCM logs)\n"
        "       tm-evaluate --study           runs the complete study on its own sessions; make evaluate draws it\n"
        "       tm-evaluate --generate DIR    writes the logs of those sessions, at 20 Hz\n\n"
        "  --json FILE     write the figures\n"
        "  --quick         with --study: fewer rates, speeds and depths\n"
        "  --model NAME    with --study, --generate: only this one (may be repeated):");
    for (int m = 0; m < MODEL_COUNT; m++) fprintf(to, " %s", model_name[m]);
    fprintf(to, "\n  --path NAME     with --study: rates on this path alone (may be repeated):\n                 ");
    for (int p = 0; p < PATH_NAMED; p++) fprintf(to, " %s", path_name[p]);
    fprintf(to, "\n  --part NAME     with --study: this part alone (may be repeated):\n"
                "                  operating roughness rates loop devices tissue-loop ready cutting");
    fprintf(to, "\n  --latency N     with LOG: delay samples by N more frames\n"
                "  --loss SHARE    with LOG: lose this share of the samples\n"
                "  --forces FILE   with LOG: write the force of each extrapolator, tick by tick, as CSV\n"
                "  --quiet         print warnings and errors only; --list lists models and extrapolators\n"
                "  -h, --help, --version\n\n"
                "The studies' scenes are apps/scenes/evaluate-*.yaml, here or as installed.\n");
}

static void list(void) {
    printf("models");
    for (int m = 0; m < MODEL_COUNT; m++) printf(" %s", model_name[m]);
    printf("\npaths");
    for (int p = 0; p < PATH_NAMED; p++) printf(" %s", path_name[p]);
    printf("\nextrapolators");
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) printf(" %s", hrt_extrapolator_name((hrt_extrapolator)x));
    printf("\n");
}

/* Returns what an extrapolator needs that the log lacks; the controller would then run another one. */
static const char *lacks(const recording *r, hrt_extrapolator which) {
    bool stiffness = false, patch = false;
    for (int i = 0; i < r->samples; i++) {
        stiffness = stiffness || r->sample[i].sample.stiffness_kind;
        patch = patch || r->sample[i].patch;
    }
    if (which == HRT_TANGENT && !stiffness) return "stiffness";
    return which == HRT_LOCAL_MODEL && !patch ? "patch" : NULL;
}

static void print_row(const char *name, const char *missing, const errors *e) {
    if (missing)
        printf("%-16s needs %s; not in this log\n", name, missing);
    else
        printf("%-16s %9.3f %9.2f %9.2f %9.2f\n", name, 100 * e->rms, 100 * e->peak, 100 * e->jump_p99,
               57.29578 * e->direction_rad);
}

/* Evaluates an instrument, or writes the reason in `why` why it cannot be judged. */
static bool evaluate_instrument(const char *file, const recording *r, int instrument, const conditions *c, cJSON *logs,
                                char why[160]) {
    if (r->ticks < 2 || r->samples < 2) {
        snprintf(why, 160, "%d ticks of TOOL_%d and %d FORCE_%d messages with its controller's time", r->ticks,
                 instrument, r->samples, instrument);
        return false;
    }
    errors first = replay(r, HRT_HOLD, c, NULL);
    if (!first.judged || !(r->peak_N > 0)) {
        snprintf(why, 160,
                 first.judged ? "instrument %d: no force, its tool never touched"
                              : "instrument %d: no tick of TOOL between its samples",
                 instrument);
        return false;
    }
    cJSON *one = app_json_add(
        logs, "log %s instrument %d device %s controller_sessions %d truth %s ticks %d samples %d peak_N %g", file,
        instrument, r->params.device->name, r->sessions, r->interpolated ? "interpolated" : "recorded", r->ticks,
        r->samples, r->peak_N);
    cJSON *rows = cJSON_AddArrayToObject(one, "rows");
    printf("%s: instrument %d: %d samples over %.1f s, %d ticks judged, peak %.3g N, truth %s\n", file, instrument,
           r->samples, 1e-6 * TICK_US * r->ticks, first.judged, r->peak_N,
           r->interpolated ? "interpolated afterwards" : "recorded at 500 Hz");
    if (r->sessions > 1) printf("(the longest of its controller's %d sessions)\n", r->sessions);
    printf("%-16s %9s %9s %9s %9s\n", "extrapolator", "RMS %", "peak %", "jump %", "angle deg");
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
        const char *name = hrt_extrapolator_name((hrt_extrapolator)x), *missing = lacks(r, (hrt_extrapolator)x);
        errors e = replay(r, (hrt_extrapolator)x, c, NULL);
        if (missing)
            app_json_add(rows, "extrapolator %s needs %s", name, missing);
        else
            app_json_add(errors_add(rows, &e), "extrapolator %s", name);
        print_row(name, missing, &e);
    }
    return true;
}

/* Writes each extrapolator's force, tick by tick, on the controller's clock; `to` null: not requested. */
static void write_forces(FILE *to, const recording *r, int instrument, const conditions *c) {
    float *force[HRT_EXTRAPOLATOR_COUNT];
    for (int x = 0; to && x < HRT_EXTRAPOLATOR_COUNT; x++) {
        force[x] = app_zeroed(3 * (size_t)r->ticks, sizeof *force[x]);
        replay(r, (hrt_extrapolator)x, c, force[x]);
    }
    for (int k = 0; to && k < r->ticks; k++) {
        fprintf(to, "%d,%lld", instrument, (long long)(r->first_us + (int64_t)k * TICK_US));
        for (int x = 0; x < 3 * HRT_EXTRAPOLATOR_COUNT; x++) fprintf(to, ",%.6g", (double)force[x / 3][3 * k + x % 3]);
        fputc('\n', to);
    }
    for (int x = 0; to && x < HRT_EXTRAPOLATOR_COUNT; x++) free(force[x]);
}

static int evaluate_log(const char *file, const conditions *c, FILE *forces, cJSON *logs) {
    char why[LOG_INSTRUMENTS][160];
    bool judged = false, there[LOG_INSTRUMENTS] = {0};
    for (int i = 0; i < LOG_INSTRUMENTS; i++) {
        recording r;
        int rc = log_read(file, i, &r);
        if (rc) return rc;
        there[i] = r.ticks > 0 || i == 0;
        bool good = evaluate_instrument(file, &r, i, c, logs, why[i]);
        judged = judged || good;
        if (good) write_forces(forces, &r, i, c);
        if (good) why[i][0] = 0;
        recording_free(&r);
    }
    for (int i = 0; judged && i < LOG_INSTRUMENTS; i++)
        if (there[i] && why[i][0]) printf("%s: not judged: %s\n", file, why[i]);
    if (judged) return 0;
    return app_bad_input(file, 0,
                         "no tick can be judged: %s%s%s; record a session with contact, its controller included",
                         why[0], there[1] ? "; " : "", there[1] ? why[1] : "");
}

static int evaluate_logs(char **log, int count, const conditions *c, const char *forces, const char *json) {
    cJSON *root = cJSON_CreateObject(), *logs = cJSON_AddArrayToObject(root, "logs");
    app_output output = {0};
    tm_error error = {0};
    int rc = forces && !app_output_begin(&output, forces, &error) ? app_report(NULL, 0, &error) : 0;
    FILE *to = forces && !rc ? app_output_stream(&output) : NULL;
    if (to) fputs("instrument,tool_us", to);
    for (int x = 0; to && x < 3 * HRT_EXTRAPOLATOR_COUNT; x++)
        fprintf(to, ",%s_f%c_N", hrt_extrapolator_name((hrt_extrapolator)(x / 3)), 'x' + x % 3);
    if (to) fputc('\n', to);
    for (int i = 0; i < count && !rc; i++) rc = evaluate_log(log[i], c, to, logs);
    if (rc && to) fclose(to);
    if (rc) app_output_abandon(&output);
    if (output.begun && !app_output_end(&output, to, &error)) rc = app_report(NULL, 0, &error);
    if (!rc) rc = app_json_save(json, root);
    cJSON_Delete(root);
    return rc;
}

typedef enum study_part {
    PART_OPERATING,
    PART_ROUGHNESS,
    PART_RATES,
    PART_LOOP,
    PART_DEVICES,
    PART_TISSUE_LOOP,
    PART_READY,
    PART_CUTTING,
    PART_COUNT
} study_part;
static const char *const part_name[PART_COUNT] = {"operating", "roughness",   "rates", "loop",
                                                  "devices",   "tissue-loop", "ready", "cutting"};

static int study(const study_run *run, const bool wanted[PART_COUNT], const char *json) {
    static study_part_maker *const make[PART_COUNT] = {study_operating, study_roughness,   study_rates, study_loop,
                                                       study_devices,   study_tissue_loop, study_ready, study_cutting};
    cJSON *root = cJSON_CreateObject();
    int rc = 0;
    app_json_add(root, "quick %hhd", run->quick);
    for (int i = 0; i < PART_COUNT && !rc; i++) {
        if (!wanted[i]) continue;
        cJSON *part =
            i == PART_RATES || i == PART_LOOP || i == PART_DEVICES ? cJSON_CreateObject() : cJSON_CreateArray();
        cJSON_AddItemToObject(root, part_name[i], part);
        rc = make[i](run, part);
    }
    app_json_add(root, "bandwidth_B_s %g", rc ? 0 : app_bandwidth_B_s(4 << 20, 15));
    if (!rc) rc = app_json_save(json, root);
    app_progress("", 1, true);
    cJSON_Delete(root);
    return rc;
}

static int generate_one(const char *folder, model m, path_kind kind) {
    path p = kind == PATH_REVERSALS ? path_make(kind, 0.05, 0) : path_make(kind, 0.01, 40e-6);
    recording r = {0};
    char file[1024];
    int rc = record_truth(m, &p, true, &r);
    if (!rc) rc = record(m, &p, 20, true, true, &r);
    sim *s = rc ? NULL : model_open(m, 20, NULL);
    snprintf(file, sizeof file, "%s/%s-%s.lcm", folder, model_name[m], path_name[kind]);
    if (!rc) rc = s ? log_write(file, &r, s->instrument_def[0].trocar_m) : APP_FAILED;
    if (!rc && !app_is_quiet()) printf("%s\n", file);
    sim_destroy(s);
    recording_free(&r);
    return rc;
}

static int generate(const char *folder, const study_run *run) {
    int rc = 0;
    for (int m = 0; m < MODEL_COUNT && !rc; m++)
        for (int kind = PATH_TOUR; kind <= PATH_REVERSALS && run->model[m] && !rc; kind++)
            rc = generate_one(folder, (model)m, (path_kind)kind);
    return rc;
}

typedef struct job {
    const char *json, *folder, *forces;
    study_run run;
    conditions conditions;
    bool all, whole, every_path, studying, part[PART_COUNT];
} job;

/* Returns the index among an option's names; -1 after an error message. */
static int find(const char *what, const char *const *name, int count) {
    for (int i = 0; i < count; i++)
        if (strcmp(name[i], optarg) == 0) return i;
    app_bad_input("tm-evaluate", 0, "no %s '%s'; --help lists them", what, optarg);
    return -1;
}

/* Parses the options. Returns APP_DONE, or an exit code after an error message. Options that only print end here. */
static int parse(int argc, char **argv, job *j) {
    static const struct option options[] = {{"study", no_argument, NULL, 's'},
                                            {"generate", required_argument, NULL, 'g'},
                                            {"json", required_argument, NULL, 'j'},
                                            {"quick", no_argument, NULL, 'q'},
                                            {"model", required_argument, NULL, 'm'},
                                            {"path", required_argument, NULL, 'p'},
                                            {"part", required_argument, NULL, 1003},
                                            {"latency", required_argument, NULL, 'l'},
                                            {"loss", required_argument, NULL, 'o'},
                                            {"help", no_argument, NULL, 'h'},
                                            {"quiet", no_argument, NULL, 1000},
                                            {"forces", required_argument, NULL, 1002},
                                            {"list", no_argument, NULL, 1001},
                                            {"version", no_argument, NULL, 'v'},
                                            {0}};
    char *rest;
    opterr = 0; /* the program prints its own message */
    for (int o; (o = getopt_long(argc, argv, "h", options, NULL)) != -1;) {
        int m = 0;
        switch (o) {
        case 's': j->studying = true; break;
        case 'g': j->folder = optarg; break;
        case 1002: j->forces = optarg; break;
        case 'j': j->json = optarg; break;
        case 'q': j->run.quick = true; break;
        case 'm':
            if ((m = find("model", model_name, MODEL_COUNT)) < 0) return APP_BAD_INPUT;
            j->run.model[m] = true, j->all = false;
            break;
        case 'p':
            if ((m = find("path", path_name, PATH_NAMED)) < 0) return APP_BAD_INPUT;
            j->run.path[m] = j->part[PART_RATES] = true, j->every_path = j->whole = false;
            break;
        case 1003:
            if ((m = find("part", part_name, PART_COUNT)) < 0) return APP_BAD_INPUT;
            j->part[m] = true, j->whole = false;
            break;
        case 'l':
            j->conditions.latency_frames = (int)strtol(optarg, &rest, 10);
            if (*rest || rest == optarg || j->conditions.latency_frames < 0 || j->conditions.latency_frames > 100)
                return app_bad_input("tm-evaluate", 0, "--latency %s: give a whole number of frames from 0 to 100",
                                     optarg);
            break;
        case 'o':
            j->conditions.loss = strtod(optarg, &rest);
            if (*rest || rest == optarg || !(j->conditions.loss >= 0 && j->conditions.loss < 1))
                return app_bad_input("tm-evaluate", 0, "--loss %s: give a share from 0 to below 1", optarg);
            break;
        case 1000: app_be_quiet(); break;
        case 1001: list(); exit(APP_DONE);
        case 'h': usage(stdout); exit(APP_DONE);
        case 'v': printf("tm-evaluate %s\n", tm_version()); exit(APP_DONE);
        default:
            return app_bad_input("tm-evaluate", 0, "%s: unknown option, or its value is missing; see --help",
                                 argv[optind - 1]);
        }
    }
    return APP_DONE;
}

int main(int argc, char **argv) {
    job asked = {.conditions.seed = 1, .all = true, .whole = true, .every_path = true};
    app_check_stdout();
    int rc = parse(argc, argv, &asked);
    if (rc) return rc;
    for (int m = 0; m < MODEL_COUNT; m++) asked.run.model[m] = asked.run.model[m] || asked.all;
    for (int p = 0; p < PATH_NAMED; p++) asked.run.path[p] = asked.run.path[p] || asked.every_path;
    for (int i = 0; i < PART_COUNT; i++) asked.part[i] = asked.part[i] || asked.whole;
    if (asked.studying + (asked.folder != NULL) + (optind < argc) != 1)
        return app_bad_input("tm-evaluate", 0,
                             "the logs are missing; give logs, --study, or --generate DIR (tm-evaluate --help)");
    if (asked.studying && !asked.json)
        return app_bad_input("tm-evaluate", 0, "--study needs --json FILE; give a file for the figures");
    if (app_output_check(asked.json) || app_output_check(asked.forces)) return APP_BAD_INPUT;
    if (asked.studying) return study(&asked.run, asked.part, asked.json);
    if (asked.folder) return generate(asked.folder, &asked.run);
    return evaluate_logs(argv + optind, argc - optind, &asked.conditions, asked.forces, asked.json);
}
