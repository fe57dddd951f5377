/* tm-sim: parses the command line, builds the scene and runs one of the modes. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/program_host.h"
#include "run.h"
#include "scene/units.h"
#include "stream.h"

static const char help[] =
    "tm-sim SCENE.yaml MODE [options]: simulates soft tissue at 25 to 30 frames a second\n"
    "\n"
    "Modes\n"
    "  --lockstep            run on a virtual clock: simulation, controller and virtual device in one "
    "process, bit-identical\n"
    "  --realtime            run on the wall clock: receive TOOL_i, send FORCE_i PATCH_i TISSUE CUT "
    "SIM_STATUS over LCM\n"
    "  --settle TOL          solve for equilibrium to this relative residual; with --write\n"
    "  --explain             list the step's stages: scene line, memory, time; and the effects that are "
    "not in the scene\n"
    "  --hands PREFIX        write the scene's scripted hands to PREFIX0.csv, PREFIX1.csv, for "
    "tm-device, its settings to PREFIX.json\n"
    "  --trials FILE         answer requests of programs that fit, a line of JSON each, on stdout (docs/fitting.md)\n"
    "  --check               only read and build the scene\n"
    "  --list                list installed scenes, models, effects\n"
    "  --schema markdown     print every key of a scene (docs/scene-reference.md)\n"
    "\n"
    "Options\n"
    "  --set PATH=VALUE      override a value of the scene (--set time.frame_rate=50); may be repeated\n"
    "  --unset PATH          leave this key of the scene out (--unset gravity)\n"
    "  --force plain|best    choose the form of the force loop (tissue.force); plain is bit-identical on "
    "all machines\n"
    "  --duration TIME       simulate this time, '5 s', instead of the scene's\n"
    "  --frames N            simulate this number of frames instead\n"
    "  --record FILE         write every message to an LCM log, also in lockstep (recording.file)\n"
    "  --csv FILE            write a row a controller tick: tool, force, sample (a row a frame without "
    "haptics)\n"
    "  --samples FILE        write a row a frame and instrument: the force sample as sent\n"
    "  --write FILE          with --settle: write displacements and reactions, .vtk or .csv\n"
    "  --paraview FOLDER     write a time series for ParaView, FOLDER/run.pvd and a .vtu a frame, with "
    "the first state\n"
    "  --paraview-every N    write only every N-th frame [1]\n"
    "  --json FILE           write figures of the run\n"
    "  --lcm-url URL         LCM URL for --realtime, default udpm://239.255.76.67:7667?ttl=0\n"
    "  --key FILE            authenticate messages by this key, shared with haptic-rt, and accept no "
    "others (docs/trust.md)\n"
    "  --no-key              accept messages of every sender, even if the URL admits other machines\n"
    "  --snapshot-at TIME --snapshot FILE  save the state at this simulated time (lockstep, scenes "
    "without haptics)\n"
    "  --restore FILE        continue from a saved state\n"
    "  --strict              turn warnings about the scene into errors\n"
    "  --quiet               print results, warnings and errors only\n"
    "  -h, --help, --version\n"
    "\n"
    "Files: - is stdout; devices, pipes and links are written through.\n"
    "Exit: 0 done, 2 bad input (file:line: what; what to do), 1 anything else. Ctrl-C ends a run with "
    "its files\n"
    "written: exit 130 (SIGTERM: 143) if the run had an end. A second Ctrl-C ends the program at once.\n";

enum {
    OPT_LOCKSTEP = 256,
    OPT_REALTIME,
    OPT_SETTLE,
    OPT_EXPLAIN,
    OPT_CHECK,
    OPT_SCHEMA,
    OPT_SET,
    OPT_UNSET,
    OPT_FORCE,
    OPT_DURATION,
    OPT_FRAMES,
    OPT_RECORD,
    OPT_CSV,
    OPT_SAMPLES,
    OPT_WRITE,
    OPT_JSON,
    OPT_PARAVIEW,
    OPT_PARAVIEW_EVERY,
    OPT_URL,
    OPT_KEY,
    OPT_NO_KEY,
    OPT_HANDS,
    OPT_TRIALS,
    OPT_SNAPSHOT_AT,
    OPT_SNAPSHOT,
    OPT_RESTORE,
    OPT_STRICT,
    OPT_LIST,
    OPT_QUIET,
    OPT_VERSION,
    OPT_HELP = 'h'
};

/* "url" is the old name of "lcm-url". */
static const struct option long_options[] = {{"lockstep", no_argument, NULL, OPT_LOCKSTEP},
                                             {"realtime", no_argument, NULL, OPT_REALTIME},
                                             {"settle", required_argument, NULL, OPT_SETTLE},
                                             {"explain", no_argument, NULL, OPT_EXPLAIN},
                                             {"check", no_argument, NULL, OPT_CHECK},
                                             {"schema", required_argument, NULL, OPT_SCHEMA},
                                             {"set", required_argument, NULL, OPT_SET},
                                             {"unset", required_argument, NULL, OPT_UNSET},
                                             {"force", required_argument, NULL, OPT_FORCE},
                                             {"duration", required_argument, NULL, OPT_DURATION},
                                             {"frames", required_argument, NULL, OPT_FRAMES},
                                             {"record", required_argument, NULL, OPT_RECORD},
                                             {"csv", required_argument, NULL, OPT_CSV},
                                             {"samples", required_argument, NULL, OPT_SAMPLES},
                                             {"write", required_argument, NULL, OPT_WRITE},
                                             {"json", required_argument, NULL, OPT_JSON},
                                             {"paraview", required_argument, NULL, OPT_PARAVIEW},
                                             {"paraview-every", required_argument, NULL, OPT_PARAVIEW_EVERY},
                                             {"snapshot-at", required_argument, NULL, OPT_SNAPSHOT_AT},
                                             {"snapshot", required_argument, NULL, OPT_SNAPSHOT},
                                             {"restore", required_argument, NULL, OPT_RESTORE},
                                             {"lcm-url", required_argument, NULL, OPT_URL},
                                             {"url", required_argument, NULL, OPT_URL},
                                             {"key", required_argument, NULL, OPT_KEY},
                                             {"no-key", no_argument, NULL, OPT_NO_KEY},
                                             {"hands", required_argument, NULL, OPT_HANDS},
                                             {"trials", required_argument, NULL, OPT_TRIALS},
                                             {"help", no_argument, NULL, OPT_HELP},
                                             {"strict", no_argument, NULL, OPT_STRICT},
                                             {"list", no_argument, NULL, OPT_LIST},
                                             {"quiet", no_argument, NULL, OPT_QUIET},
                                             {"version", no_argument, NULL, OPT_VERSION},
                                             {NULL, 0, NULL, 0}};

static int usage(const char *what, const char *argument) { return app_bad_input("tm-sim", 0, what, argument); }

static int add_set(run_options *o, const char *prefix, const char *text, bool wants_value) {
    if (o->set_count >= RUN_MAX_SETS) return usage("more than 64 --set%s; write a scene instead", "");
    if (wants_value && !*prefix && !strchr(text, '='))
        return usage("--set '%s' is not PATH=VALUE; write for example --set tissue.force=plain", text);
    if (!wants_value && strchr(text, '=')) return usage("--unset '%s' has a value; give the path alone", text);
    size_t bytes = strlen(prefix) + strlen(text) + 1;
    char *joined = malloc(bytes);
    if (!joined) return APP_FAILED;
    snprintf(joined, bytes, "%s%s", prefix, text);
    o->set[o->set_count++] = joined;
    return 0;
}

/* Appends a file to record. Quotes it: a file may have any name, even "-". */
static int add_record(run_options *o, const char *file) {
    char quoted[2 * 1024];
    if (!app_scene_quote(file, quoted, sizeof quoted))
        return usage("--record '%.60s...' is too long; give a shorter path", file);
    return add_set(o, "recording.file=", quoted, true);
}

static int take_number(const char *name, const char *text, const char *dimension, double low, double *out) {
    char why[256];
    if (!app_parse_quantity(text, dimension, out, why, sizeof why)) return app_bad_input(name, 0, "%s", why);
    if (*out < low) return app_bad_input(name, 0, "%s is below %g; give more", text, low);
    return 0;
}

static int take_whole(const char *name, const char *text, double low, int64_t *out) {
    double number;
    int rc = take_number(name, text, "none", low, &number);
    if (!rc && (number != floor(number) || number > 1e12))
        rc = app_bad_input("tm-sim", 0, "%s '%s' is not a whole number; give one", name, text);
    if (!rc) *out = (int64_t)number;
    return rc;
}

static int choose_mode(run_options *o, run_mode mode) {
    if (o->mode != RUN_NONE && o->mode != mode)
        return usage(
            "two modes are given; choose one of --lockstep --realtime --settle --explain --hands --trials --check%s",
            "");
    o->mode = mode;
    return 0;
}

static int take_option(run_options *o, int option, char **all) {
    int rc;
    switch (option) {
    case OPT_LOCKSTEP: return choose_mode(o, RUN_LOCKSTEP);
    case OPT_REALTIME: return choose_mode(o, RUN_REALTIME);
    case OPT_EXPLAIN: return choose_mode(o, RUN_EXPLAIN);
    case OPT_CHECK: return choose_mode(o, RUN_CHECK);
    case OPT_TRIALS: o->trials = optarg; return choose_mode(o, RUN_TRIALS);
    case OPT_HANDS: o->hands = optarg; return choose_mode(o, RUN_HANDS);
    case OPT_SETTLE:
        rc = take_number("--settle", optarg, "none", 1e-15, &o->tolerance);
        return rc ? rc : choose_mode(o, RUN_SETTLE);
    case OPT_SCHEMA: o->schema = optarg; return 0;
    case OPT_SET: return add_set(o, "", optarg, true);
    case OPT_UNSET: return add_set(o, "", optarg, false);
    case OPT_FORCE: return add_set(o, "tissue.force=", optarg, true);
    case OPT_DURATION: return take_number("--duration", optarg, "time", 0, &o->duration_s);
    case OPT_FRAMES: return take_whole("--frames", optarg, 0, &o->frames);
    case OPT_RECORD: return add_record(o, optarg);
    case OPT_CSV: o->csv = optarg; return 0;
    case OPT_SAMPLES: o->samples = optarg; return 0;
    case OPT_WRITE: o->write = optarg; return 0;
    case OPT_JSON: o->json = optarg; return 0;
    case OPT_PARAVIEW: o->paraview = optarg; return 0;
    case OPT_PARAVIEW_EVERY: return take_whole("--paraview-every", optarg, 1, &o->paraview_every);
    case OPT_LIST: o->list = true; return 0;
    case OPT_STRICT: o->strict = true; return 0;
    case OPT_QUIET: app_be_quiet(); return 0;
    case OPT_URL: o->url = optarg; return 0;
    case OPT_KEY: o->key = optarg; return 0;
    case OPT_NO_KEY: o->no_key = true; return 0;
    case OPT_RESTORE: o->restore = optarg; return 0;
    case OPT_SNAPSHOT: o->snapshot = optarg; return 0;
    case OPT_SNAPSHOT_AT: return take_number("--snapshot-at", optarg, "time", 0, &o->snapshot_s);
    default: return usage("unknown option, or its value is missing: '%s'; tm-sim --help lists them", all[optind - 1]);
    }
}

static int parse(run_options *o, int count, char **all) {
    opterr = 0;
    for (;;) {
        int option = getopt_long(count, all, "-h", long_options, NULL);
        if (option == -1) break;
        if (option == OPT_HELP || option == OPT_VERSION) {
            if (option == OPT_HELP)
                fputs(help, stdout);
            else
                printf("tm-sim %s\n", tm_version());
            exit(0);
        }
        if (option == 1) {
            if (o->scene) return usage("'%s' is a second scene; give one", optarg);
            o->scene = optarg;
            continue;
        }
        int rc = take_option(o, option, all);
        if (rc) return rc;
    }
    if (optind < count) return usage("'%s' comes after '--'; give options and scene before", all[optind]);
    if (o->schema)
        return strcmp(o->schema, "markdown") ? usage("--schema '%s' is not known; use markdown", o->schema) : 0;
    if (o->list) return 0;
    if (!o->scene) return usage("the scene is missing%s; give tm-sim SCENE.yaml --lockstep, or tm-sim --help", "");
    if (o->mode == RUN_NONE)
        return usage("the mode is missing%s; add one of --lockstep --realtime --settle TOL --explain --check", "");
    if (o->write && o->mode != RUN_SETTLE)
        return usage("--write %s goes with --settle; add it, or use --csv", o->write);
    if ((o->csv || o->samples) && o->mode != RUN_LOCKSTEP && o->mode != RUN_REALTIME)
        return usage("--csv and --samples%s go with --lockstep or --realtime; use --write with --settle", "");
    if (o->paraview && o->mode != RUN_LOCKSTEP && o->mode != RUN_REALTIME)
        return usage("--paraview %s goes with --lockstep or --realtime; with --settle use --write FILE.vtk",
                     o->paraview);
    if ((o->snapshot != NULL) != (o->snapshot_s >= 0))
        return usage("--snapshot-at TIME and --snapshot FILE%s go together; give both", "");
    if (o->snapshot && o->mode != RUN_LOCKSTEP) return usage("--snapshot %s goes with --lockstep; add it", o->snapshot);
    if ((o->key || o->no_key) && o->mode != RUN_REALTIME) return usage("--key and --no-key%s go with --realtime", "");
    if (o->restore && o->mode != RUN_LOCKSTEP && o->mode != RUN_REALTIME)
        return usage("--restore %s goes with --lockstep or --realtime; add one", o->restore);
    return app_output_check(o->snapshot);
}

enum { DESCRIPTION = 2000 };

/* Writes the reference's text on an effect before its keys: purpose, dependencies, how to request it. */
static void describe_effect(const sim_effect *e, char text[DESCRIPTION]) {
    size_t used = (size_t)snprintf(text, DESCRIPTION, "%s", e->doc);
    for (int i = 0; i < 4 && e->needs[i] && used < DESCRIPTION; i++)
        used += (size_t)snprintf(text + used, DESCRIPTION - used, " Needs `%s`.", e->needs[i]);
    for (int i = 0; i < 4 && e->excludes[i].other && used < DESCRIPTION; i++)
        used += (size_t)snprintf(text + used, DESCRIPTION - used, " Excludes `%s`.", e->excludes[i].other);
    if (e->example && used < DESCRIPTION)
        snprintf(text + used, DESCRIPTION - used, "\n\nExample: `%s:%s%s`", e->name, *e->example ? " " : "",
                 e->example);
}

static int print_schema(void) {
    const char *name[SIM_MAX_EFFECTS], *doc[SIM_MAX_EFFECTS];
    char text[SIM_MAX_EFFECTS][DESCRIPTION];
    app_schema schema[SIM_MAX_EFFECTS];
    for (int i = 0; i < sim_effect_count; i++) {
        describe_effect(sim_effects[i], text[i]);
        name[i] = sim_effects[i]->name;
        doc[i] = text[i];
        schema[i] = sim_effects[i]->schema;
    }
    app_scene_reference(stdout, schema, name, doc, sim_effect_count);
    return APP_DONE;
}

static int run(run_options *o) {
    app_scene *scene;
    sim *s;
    if (o->schema) return print_schema();
    if (o->list) return run_list();
    if (o->mode == RUN_TRIALS) return run_trials(o);
    int rc = app_exit_code(sim_scene_load(o->scene, o->set, o->set_count, app_program_host(), &scene));
    if (rc) return rc;
    scene->strict = o->strict;
    scene->pace = o->mode == RUN_LOCKSTEP ? SIM_LOCKSTEP
                  : o->mode == RUN_SETTLE ? SIM_FRAMES
                                          : SIM_REALTIME; /* also to explain and check a session */
    rc = app_exit_code(sim_create(scene, &s));
    if (rc) return rc;
    switch (o->mode) {
    case RUN_LOCKSTEP: rc = run_lockstep(s, o); break;
    case RUN_REALTIME: rc = run_realtime(s, o); break;
    case RUN_SETTLE: rc = run_settle(s, o); break;
    case RUN_EXPLAIN: rc = run_explain(s, o); break;
    case RUN_HANDS: rc = run_hands(s, o); break;
    case RUN_CHECK:
        printf("%s: %d tetrahedra, %d substep%s of %.3g s a frame\n", o->scene, s->mesh->tet_count, s->substeps,
               s->substeps == 1 ? "" : "s", s->dt_s);
        break;
    case RUN_TRIALS:
    case RUN_NONE: break;
    }
    sim_destroy(s);
    return rc;
}

int main(int count, char **all) {
    run_options o = {.duration_s = -1, .frames = -1, .snapshot_s = -1, .paraview_every = 1};
    app_check_stdout();
    app_catch_signals();
    int rc = parse(&o, count, all);
    if (!rc) rc = app_ended("tm-sim", run(&o));
    for (int i = 0; i < o.set_count; i++) free(o.set[i]);
    return rc;
}
