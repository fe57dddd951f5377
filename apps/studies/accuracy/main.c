/* tm-accuracy: measures error and cost of every knob and writes JSON. Without --scene it measures a block with a known
 * solution (page.py draws it), with --scene a user's scene (study.c; scene_page.py draws it). */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "app.h"
#include "bandwidth.h"
#include "json_file.h"
#include "scene/units.h"
#include "study.h"

static const struct {
    const char *name, *what;
    knob_measure *measure;
} knobs[] = {
    {"mesh", "number of tetrahedra: error of displacement, reaction and energy, isotropic and fibred", knob_mesh},
    {"strain_smoothing", "strain smoothing against linear tetrahedra: pressed, and bent with nu near 0.5",
     knob_strain_smoothing},
    {"step", "time step: error of trajectory, phase, energy and settling", knob_step},
    {"mass", "mass scaling: length of the step, and error of the force at the indenter", knob_mass},
    {"precision", "single or double stored tensors: error and speed", knob_precision},
    {"model", "linear models: error at large displacements, pressed by 1 % to 40 %", knob_model},
    {"rotation", "rotation, with and without strain smoothing: error at large displacements, and cost", knob_rotation},
    {"law", "nonlinear laws: verified against an independent code, error by depth against linear tissue, and cost",
     knob_law},
    {"viscosity", "viscosity: cost, error at fast strains, and the ramp and hold of a liver", knob_viscosity},
    {"friction", "friction: cost, and the error of the force of a slide without it", knob_friction},
    {"fibre", "fibres: error if anisotropy is left out", knob_fibre},
};
enum { KNOBS = sizeof knobs / sizeof *knobs };

static void progress(const char *knob, double fraction) { app_progress(knob, fraction, false); }

static void usage(FILE *to) {
    fprintf(to, "usage: tm-accuracy [--knob NAME]... [--quick] [--reference FILE] --json FILE\n"
                "       tm-accuracy --scene SCENE.yaml [--budget CORES] [--page FOLDER] --json FILE\n"
                "Measures accuracy against computing time and writes JSON: of a pressed block with known solution "
                "(`make accuracy` draws the page),\n"
                "or of a scene along its hand's path, against its finest mesh.\n"
                "\n"
                "  --knob NAME       measure only this parameter (may be repeated):\n");
    for (int k = 0; k < KNOBS; k++) fprintf(to, "      %-10s %s\n", knobs[k].name, knobs[k].what);
    fputs(
        "  --quick           use smaller meshes, fewer repetitions; of a scene: fewer settings\n"
        "  --reference FILE  read the independent solutions [apps/studies/accuracy/reference/reference.json, or as installed]\n"
        "  --json FILE       write the figures; an interrupted study of a scene continues from this file\n"
        "  --quiet           print warnings and errors only; --list lists the parameters\n"
        "  -h, --help, --version\n\n"
        "  --scene FILE      study this scene: meshes, step, mass, precision, model, threads, effects, constants, rates, extrapolators\n"
        "  --set PATH=VALUE, --unset PATH  as in tm-sim (may be repeated)\n"
        "  --mesh FILE       add a mesh of the same organ, with the same groups and unit (at most 4)\n"
        "  --duration TIME   duration of the hand's path [the scene's]\n"
        "  --limit TIME      time of the complete study: settings that need more are left out and listed; a run gets a quarter at most [10 min]\n"
        "  --finest NUMBER   largest number of tetrahedra; with a long --limit the meshes are then the same on every machine\n"
        "  --budget CORES    recommend the most accurate setting within these processors (0.5, \"2 cores\"), write it as a scene and run it\n"
        "  --frame RATE      recommend for this frame rate (time.frame_rate)\n"
        "  --hold TIME       time for which the recommendation is run in real time [10 s]\n"
        "  --page FOLDER     draw index.html in this folder (needs python3 with matplotlib; $TM_PYTHON names another)\n",
        to);
}

static void list(void) {
    for (int k = 0; k < KNOBS; k++) printf("%-10s %s\n", knobs[k].name, knobs[k].what);
}

static int measure(const char *json, const char *reference_path, bool quick, const bool *wanted) {
    tm_error error = {0};
    cJSON *truth = app_json_read(reference_path);
    if (!truth)
        return app_bad_input(
            reference_path, 0,
            "it is not the JSON of the references; make it with make_inp.py --gather, or give another with --reference");
    char file[2048];
    app_shared_file("apps/studies/accuracy/reference/laws.json", file, sizeof file);
    cJSON *laws = app_json_read(file);
    run r = {.quick = quick, .rounds = quick ? 5 : 15, .truth = truth, .laws = laws, .progress = progress};
    cJSON *root = cJSON_CreateObject();
    app_json_add(root, "quick %hhd", quick);
    int exit = APP_DONE;
    for (int k = 0; k < KNOBS && exit == APP_DONE; k++) {
        if (!wanted[k]) continue;
        cJSON *figures = cJSON_AddObjectToObject(root, knobs[k].name);
        if (knobs[k].measure(&r, figures, cJSON_AddArrayToObject(figures, "rows"), &error))
            exit = app_report(knobs[k].name, 0, &error);
        app_progress(knobs[k].name, 1, true);
    }
    /* Measured together with the figures that are compared with it: arrays as large as the tensors of 10,000
     * tetrahedra. */
    app_json_add(root, "bandwidth_B_s %g", app_bandwidth_B_s(4 << 20, 15));
    if (exit == APP_DONE) exit = app_json_save(json, root);
    cJSON_Delete(root);
    cJSON_Delete(truth);
    cJSON_Delete(laws);
    return exit;
}

typedef struct options {
    const char *json, *reference;
    bool wanted[KNOBS], some;
    study study;
} options;

static int add_set(study *t, const char *text) {
    if (t->set_count >= STUDY_SETS / 2 - 4) /* the study adds its own settings */
        return app_bad_input("tm-accuracy", 0, "there are more than %d --set and --unset; write them into the scene",
                             STUDY_SETS / 2 - 4);
    t->set[t->set_count++] = (char *)(uintptr_t)text;
    return 0;
}

static int read_quantity(const char *option, const char *text, const char *dimension, double *si) {
    char why[200];
    if (app_parse_quantity(text, dimension, si, why, sizeof why) && *si > 0) return 0;
    return app_bad_input("tm-accuracy", 0, "%s %s: this is not valid; give a %s above 0", option, text,
                         strcmp(dimension, "none") ? dimension : "number");
}

/* Reads "0.5", "0.5 core", "2 cores". */
static int read_budget(study *t, const char *text) {
    char number[60];
    size_t length = strcspn(text, " c");
    const char *unit = text + length + strspn(text + length, " ");
    t->choice.wanted = true;
    if (length >= sizeof number || (*unit && strcmp(unit, "core") && strcmp(unit, "cores"))) length = 0;
    snprintf(number, sizeof number, "%.*s", (int)length, text);
    return *number ? read_quantity("--budget", number, "none", &t->budget)
                   : app_bad_input("tm-accuracy", 0,
                                   "--budget %s: this is not a number of processors; give 0.5 or 2 cores", text);
}

static int read_knob(options *o, const char *name) {
    int k = 0;
    while (k < KNOBS && strcmp(knobs[k].name, name) != 0) k++;
    if (k == KNOBS) return app_bad_input("tm-accuracy", 0, "parameter '%s' does not exist; --help lists them", name);
    o->wanted[k] = o->some = true;
    return 0;
}

static int read_mesh(study *t, const char *file) {
    if (t->other_count == 4) return app_bad_input("tm-accuracy", 0, "there are more than 4 --mesh; leave some out");
    t->other_mesh[t->other_count++] = file;
    return 0;
}

enum {
    OPT_SET = 1000,
    OPT_MESH,
    OPT_DURATION,
    OPT_LIMIT,
    OPT_FINEST,
    OPT_BUDGET,
    OPT_FRAME,
    OPT_HOLD,
    OPT_PAGE,
    OPT_SCENE
};

/* Reads an option of a scene's study. */
static int read_scene_option(study *t, int option) {
    switch (option) {
    case OPT_SCENE: t->file = optarg; return 0;
    case OPT_SET: return add_set(t, optarg);
    case OPT_MESH: return read_mesh(t, optarg);
    case OPT_DURATION: return read_quantity("--duration", optarg, "time", &t->duration_s);
    case OPT_LIMIT: return read_quantity("--limit", optarg, "time", &t->limit_s);
    case OPT_FINEST: return read_quantity("--finest", optarg, "none", &t->finest);
    case OPT_BUDGET: return read_budget(t, optarg);
    case OPT_FRAME: return read_quantity("--frame", optarg, "rate", &t->frame_Hz);
    case OPT_HOLD: return read_quantity("--hold", optarg, "time", &t->hold_s);
    default: t->page = optarg; return 0;
    }
}

static int parse(options *o, int argc, char **argv) {
    static const struct option names[] = {{"knob", required_argument, NULL, 'k'},
                                          {"quick", no_argument, NULL, 'q'},
                                          {"reference", required_argument, NULL, 'r'},
                                          {"json", required_argument, NULL, 'j'},
                                          {"help", no_argument, NULL, 'h'},
                                          {"quiet", no_argument, NULL, 'Q'},
                                          {"list", no_argument, NULL, 'l'},
                                          {"version", no_argument, NULL, 'v'},
                                          {"scene", required_argument, NULL, OPT_SCENE},
                                          {"set", required_argument, NULL, OPT_SET},
                                          {"unset", required_argument, NULL, OPT_SET},
                                          {"mesh", required_argument, NULL, OPT_MESH},
                                          {"duration", required_argument, NULL, OPT_DURATION},
                                          {"limit", required_argument, NULL, OPT_LIMIT},
                                          {"finest", required_argument, NULL, OPT_FINEST},
                                          {"budget", required_argument, NULL, OPT_BUDGET},
                                          {"frame", required_argument, NULL, OPT_FRAME},
                                          {"hold", required_argument, NULL, OPT_HOLD},
                                          {"page", required_argument, NULL, OPT_PAGE},
                                          {0}};
    opterr = 0; /* the program prints its own message */
    for (int c, rc; (c = getopt_long(argc, argv, "h", names, NULL)) != -1;) {
        rc = 0;
        switch (c) {
        case 'k': rc = read_knob(o, optarg); break;
        case 'q': o->study.quick = true; break;
        case 'r': o->reference = optarg; break;
        case 'j': o->json = optarg; break;
        case 'Q': app_be_quiet(); break;
        case 'l': list(); exit(APP_DONE);
        case 'h': usage(stdout); exit(APP_DONE);
        case 'v': printf("tm-accuracy %s\n", tm_version()); exit(APP_DONE);
        case '?':
        case ':':
            return app_bad_input("tm-accuracy", 0,
                                 "%s: unknown option, or its value is missing; see tm-accuracy --help",
                                 argv[optind - 1]);
        default: rc = read_scene_option(&o->study, c);
        }
        if (rc) return rc;
    }
    if (optind < argc)
        return app_bad_input("tm-accuracy", 0, "unexpected argument '%s'; see tm-accuracy --help", argv[optind]);
    if (!o->json) return app_bad_input("tm-accuracy", 0, "--json FILE is missing; give a file for the figures");
    return app_output_check(o->json) ? APP_BAD_INPUT : 0;
}

/* Refuses options of the other kind of study. */
static int check_kind(const options *o) {
    const study *t = &o->study;
    if (t->file && o->some)
        return app_bad_input("tm-accuracy", 0,
                             "--knob applies only to the block; leave it out, as a scene's study measures all");
    if (!t->file && (t->set_count || t->other_count || t->page || t->choice.wanted || t->frame_Hz > 0 ||
                     t->duration_s > 0 || isfinite(t->finest)))
        return app_bad_input(
            "tm-accuracy", 0,
            "--set, --mesh, --page, --budget, --frame, --finest and --duration apply to a scene; add --scene FILE");
    return 0;
}

int main(int argc, char **argv) {
    char found[2048];
    static options o; /* too large for a stack */
    o.reference = found;
    o.study = (study){.duration_s = -1, .frame_Hz = -1, .limit_s = 600, .finest = INFINITY, .hold_s = 10, .slower = 1};
    app_check_stdout();
    app_shared_file("apps/studies/accuracy/reference/reference.json", found, sizeof found);
    int rc = parse(&o, argc, argv);
    if (!rc) rc = check_kind(&o);
    if (rc) return rc;
    if (o.study.file) {
        app_catch_signals();
        o.study.json = o.json;
        return app_ended("tm-accuracy", study_whole(&o.study));
    }
    for (int k = 0; k < KNOBS; k++) o.wanted[k] = o.wanted[k] || !o.some;
    return measure(o.json, o.reference, o.study.quick, o.wanted);
}
