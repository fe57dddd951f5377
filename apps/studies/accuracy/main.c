/* tm-accuracy: measures every knob for its error and its price, as JSON. apps/studies/accuracy/page.py draws it. */
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "app.h"
#include "bandwidth.h"
#include "json_file.h"

static const struct {
    const char *name, *what;
    cJSON *(*measure)(const run *r, tm_error *error);
} knobs[] = {
    {"mesh", "tetrahedra against displacement, reaction and energy, isotropic and fibred", knob_mesh},
    {"volume", "tissue that does not lock against linear tetrahedra, pressed, and bent towards nu = 0.5", knob_volume},
    {"step", "time step against trajectory, phase, energy and settling", knob_step},
    {"precision", "single against double stored tensors", knob_precision},
    {"model", "linear models against large displacements, pressed from 1 % to 40 %", knob_model},
    {"rotation", "tissue that turns against large displacements, and its price", knob_rotation},
    {"fibre", "leaving anisotropy out of fibred tissue", knob_fibre},
};
enum { KNOBS = sizeof knobs / sizeof *knobs };

static void progress(const char *knob, double fraction) { app_progress(knob, fraction, false); }

static void usage(FILE *to) {
    fprintf(to, "usage: tm-accuracy [--knob NAME]... [--quick] [--reference FILE] --json FILE\n"
                "Measures what accuracy costs in time and writes it as JSON; `make accuracy` draws the page.\n\n"
                "  --knob NAME       only this one (may be repeated):\n");
    for (int k = 0; k < KNOBS; k++) fprintf(to, "      %-10s %s\n", knobs[k].name, knobs[k].what);
    fprintf(
        to,
        "  --quick           smaller meshes, fewer rounds\n"
        "  --reference FILE  the independent solutions [apps/studies/accuracy/reference/reference.json, here or as installed]\n"
        "  --json FILE       where the figures go\n"
        "  --quiet           no progress; --list names the knobs\n"
        "  -h, --help, --version\n");
}

static void list(void) {
    for (int k = 0; k < KNOBS; k++) printf("%-10s %s\n", knobs[k].name, knobs[k].what);
}

static int write_json(const char *path, cJSON *root) {
    tm_error error = {0};
    return app_json_write(path, root, &error) ? app_report(NULL, 0, &error) : APP_DONE;
}

static int measure(const char *json, const char *reference_path, bool quick, const bool *wanted) {
    tm_error error = {0};
    reference *truth = reference_open(reference_path, &error);
    if (!truth) return app_report(NULL, 0, &error);
    run r = {.quick = quick, .rounds = quick ? 5 : 15, .truth = truth, .progress = progress};
    cJSON *root = cJSON_CreateObject();
    cJSON_AddBoolToObject(root, "quick", quick);
    int exit = APP_DONE;
    for (int k = 0; k < KNOBS && exit == APP_DONE; k++) {
        if (!wanted[k]) continue;
        cJSON *figures = knobs[k].measure(&r, &error);
        app_progress(knobs[k].name, 1, true);
        if (figures)
            cJSON_AddItemToObject(root, knobs[k].name, figures);
        else
            exit = app_report(knobs[k].name, 0, &error);
    }
    /* Measured beside what it is held against: arrays as large as the tensors of 10,000 tetrahedra. */
    cJSON_AddNumberToObject(root, "bandwidth_B_s", app_bandwidth_B_s(4 << 20, 15));
    if (exit == APP_DONE) exit = write_json(json, root);
    cJSON_Delete(root);
    reference_close(truth);
    return exit;
}

int main(int argc, char **argv) {
    static const struct option options[] = {{"knob", required_argument, NULL, 'k'},
                                            {"quick", no_argument, NULL, 'q'},
                                            {"reference", required_argument, NULL, 'r'},
                                            {"json", required_argument, NULL, 'j'},
                                            {"help", no_argument, NULL, 'h'},
                                            {"quiet", no_argument, NULL, 1000},
                                            {"list", no_argument, NULL, 1001},
                                            {"version", no_argument, NULL, 'v'},
                                            {0}};
    char found[2048];
    const char *json = NULL, *reference_path = found;
    bool wanted[KNOBS] = {false}, quick = false, some = false;
    app_check_stdout();
    app_shared_file("apps/studies/accuracy/reference/reference.json", found, sizeof found);
    opterr = 0; /* the message is ours */
    for (int c; (c = getopt_long(argc, argv, "h", options, NULL)) != -1;) {
        int k = 0;
        switch (c) {
        case 'k':
            while (k < KNOBS && strcmp(knobs[k].name, optarg) != 0) k++;
            if (k == KNOBS) return app_bad_input("tm-accuracy", 0, "no knob '%s'; --help lists them", optarg);
            wanted[k] = some = true;
            break;
        case 'q': quick = true; break;
        case 'r': reference_path = optarg; break;
        case 'j': json = optarg; break;
        case 1000: app_be_quiet(); break;
        case 1001: list(); return APP_DONE;
        case 'h': usage(stdout); return APP_DONE;
        case 'v': printf("tm-accuracy %s\n", tm_version()); return APP_DONE;
        default:
            return app_bad_input("tm-accuracy", 0, "%s: unknown or incomplete option; see tm-accuracy --help",
                                 argv[optind - 1]);
        }
    }
    if (optind < argc)
        return app_bad_input("tm-accuracy", 0, "stray argument '%s'; see tm-accuracy --help", argv[optind]);
    if (!json) return app_bad_input("tm-accuracy", 0, "--json FILE is missing; say where the figures go");
    if (app_output_check(json)) return APP_BAD_INPUT;
    for (int k = 0; k < KNOBS; k++) wanted[k] = wanted[k] || !some;
    return measure(json, reference_path, quick, wanted);
}
