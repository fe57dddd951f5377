/* tm-scene: writes a first scene for a mesh, and checks scenes for missing or unusual settings. */
#include <getopt.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "organ.h"

static const char help[] =
    "usage: tm-scene new [options] ORGAN.msh     writes ORGAN.yaml: a commented scene that can be run\n"
    "       tm-scene check [--strict] SCENE.yaml reports what is missing or unusual, and what to do\n"
    "       tm-scene tissues                     prints the table of constants that `new` uses, with "
    "sources\n"
    "\n"
    "`new` chooses materials by the names of the mesh's regions; supports bone, vessels at the surface, "
    "flat or low sides;\n"
    "and lets a probe press from above. Comments in the scene give the reasons.\n"
    "  -o, --out SCENE   file to write [the mesh's name with .yaml]\n"
    "  --unit UNIT       unit of the mesh's numbers: m, cm, mm, um [m]\n"
    "  --up AXIS         direction towards the surgeon: x y z -x -y -z [z; -y is a patient's front in "
    "DICOM's axes]\n"
    "  --title TEXT      title of the scene [the mesh's name]\n"
    "  --cut             add a cautery that cuts after the probe has left\n"
    "  --force           replace an existing scene\n"
    "check: --strict     turn warnings into errors, exit 2\n"
    "  --quiet           print warnings and errors only\n"
    "  -h, --help, --version\n";

typedef struct options {
    const char *file, *out, *title, *up;
    double scale;
    bool cut, force, strict, finished;
} options;

enum { OUT = 'o', UNIT = 256, UP, TITLE, CUT, FORCE, STRICT, QUIET, VERSION, HELP = 'h' };
static const struct option table[] = {
    {"out", 1, NULL, OUT},   {"unit", 1, NULL, UNIT},       {"up", 1, NULL, UP},         {"title", 1, NULL, TITLE},
    {"cut", 0, NULL, CUT},   {"force", 0, NULL, FORCE},     {"strict", 0, NULL, STRICT}, {"quiet", 0, NULL, QUIET},
    {"help", 0, NULL, HELP}, {"version", 0, NULL, VERSION}, {NULL, 0, NULL, 0}};

static int take_unit(const char *text, double *scale) {
    static const struct {
        const char *name;
        double m;
    } units[] = {{"m", 1}, {"cm", 1e-2}, {"mm", 1e-3}, {"um", 1e-6}};
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcmp(text, units[i].name) == 0) {
            *scale = units[i].m;
            return 0;
        }
    return app_bad_input("tm-scene", 0, "--unit %s: this is not a unit of meshes; use m, cm, mm or um", text);
}

static int take_up(const char *text, const char **up) {
    const char *axis = text + (*text == '-');
    if (strlen(axis) != 1 || !strchr("xyz", *axis))
        return app_bad_input("tm-scene", 0, "--up %s: this is not an axis; use x, y, z, -x, -y or -z", text);
    *up = text;
    return 0;
}

static int parse(int argc, char **argv, options *o) {
    *o = (options){.scale = 1, .up = "z"};
    opterr = 0;
    for (int code; (code = getopt_long(argc, argv, "ho:", table, NULL)) != -1;) {
        int wrong = 0;
        switch (code) {
        case OUT: o->out = optarg; break;
        case UNIT: wrong = take_unit(optarg, &o->scale); break;
        case UP: wrong = take_up(optarg, &o->up); break;
        case TITLE: o->title = optarg; break;
        case CUT: o->cut = true; break;
        case FORCE: o->force = true; break;
        case STRICT: o->strict = true; break;
        case QUIET: app_be_quiet(); break;
        case HELP:
        case VERSION:
            if (code == HELP)
                fputs(help, stdout);
            else
                printf("tm-scene %s\n", tm_version());
            o->finished = true;
            return 0;
        default:
            return app_bad_input("tm-scene", 0, "%s: unknown option, or its value is missing; see tm-scene --help",
                                 argv[optind - 1]);
        }
        if (wrong) return wrong;
    }
    if (optind < argc) o->file = argv[optind++];
    if (optind < argc)
        return app_bad_input("tm-scene", 0, "'%s': one file at a time; see tm-scene --help", argv[optind]);
    return 0;
}

/* Computes the mesh's path for the scene: relative if the mesh is inside the scene's folder, else absolute. */
static void name_mesh(const char *mesh, const char *scene, char *name, size_t size) {
    char whole[PATH_MAX], folder[PATH_MAX], home[PATH_MAX];
    snprintf(folder, sizeof folder, "%s", scene);
    char *slash = strrchr(folder, '/');
    if (slash)
        slash[slash == folder] = 0;
    else
        strcpy(folder, ".");
    if (!realpath(mesh, whole)) snprintf(whole, sizeof whole, "%s", mesh);
    const char *rest = whole;
    if (realpath(folder, home)) {
        const size_t n = strlen(home);
        if (strncmp(whole, home, n) == 0 && whole[n] == '/') rest = whole + n + 1;
    }
    snprintf(name, size, "%s", rest);
}

static void default_names(const options *o, char *scene, char *title, size_t size) {
    const char *base = strrchr(o->file, '/');
    base = base ? base + 1 : o->file;
    const char *dot = strrchr(base, '.');
    const size_t stem = dot && dot > base ? (size_t)(dot - o->file) : strlen(o->file);
    snprintf(scene, size, "%.*s.yaml", (int)stem, o->file);
    snprintf(title, size, "%.*s, pressed by a probe", (int)(stem - (size_t)(base - o->file)), base);
}

static int write_scene(const organ *made, const options *o, const char *path, const char *title) {
    char mesh[PATH_MAX];
    app_output output;
    tm_error error = {0};
    name_mesh(o->file, path, mesh, sizeof mesh);
    if (!app_output_begin(&output, path, &error)) return app_report(NULL, 0, &error);
    FILE *file = app_output_stream(&output);
    if (file) organ_write(made, file, mesh, o->scale, title);
    return app_output_end(&output, file, &error) ? 0 : app_report(NULL, 0, &error);
}

static int make_new(const options *o) {
    char path[PATH_MAX], title[PATH_MAX];
    organ made;
    default_names(o, path, title, sizeof path);
    if (o->out) snprintf(path, sizeof path, "%s", o->out);
    if (o->title) snprintf(title, sizeof title, "%s", o->title);
    int rc = app_output_check(path);
    if (!rc && !o->force && strcmp(path, "-") != 0 && access(path, F_OK) == 0)
        rc = app_bad_input(path, 0, "exists already; give another name with -o, or add --force");
    if (rc) return rc;
    rc = organ_load(o->file, o->scale, o->up, title, o->cut, &made);
    if (!rc && !organ_find_supports(&made)) rc = app_bad_input(o->file, 0, "no memory; use a coarser mesh") - 1;
    if (!rc) rc = organ_hang(o->file, &made);
    if (!rc && !organ_find_trocar(&made)) rc = app_bad_input(o->file, 0, "no memory; use a coarser mesh") - 1;
    if (!rc && o->cut && !organ_find_cut(&made)) rc = app_bad_input(o->file, 0, "no memory; use a coarser mesh") - 1;
    if (!rc && o->cut && !made.cut)
        rc = app_bad_input(
            o->file, 0, "there is no space for a cut next to the press; leave --cut out, and write the cut yourself");
    if (!rc) rc = write_scene(&made, o, path, title);
    for (int32_t r = 0; !rc && r < made.file.region_count; r++)
        if (!made.known[r])
            fprintf(
                stderr,
                "tm-scene: warning: the name of region '%s' is not in the table of tissues, so its constants are a guess; write your own\n",
                made.file.region_name[r]);
    if (!rc && !made.hangs)
        fprintf(stderr, "tm-scene: warning: %d supports do not hold the organ firmly enough; support more vertices\n",
                made.supports);
    if (!rc)
        app_remark("%s: %d tetrahedra, %d region%s, %d support%s, %d substeps a frame; tm-scene check %s", path,
                   made.mesh->tet_count, made.file.region_count, made.file.region_count == 1 ? "" : "s", made.supports,
                   made.supports == 1 ? "" : "s", made.substeps, path);
    organ_free(&made);
    return rc;
}

static int list_tissues(void) {
    printf("%-15s %10s %8s %8s  source\n", "tissue", "E kPa", "poisson", "kg/m3");
    for (int i = 0; tissue_row(i); i++) {
        const tissue_constants *t = tissue_row(i);
        printf("%-15s %10.4g %8.4g %8.4g  %s\n", t->name, t->young_Pa / 1e3, t->poisson, t->density_kg_m3, t->source);
    }
    printf("densities: %s\n", tissue_density_source);
    printf("\nlarge strains (docs/nonlinear-laws.md): material of a scene; up to this stretch; source\n");
    for (int i = 0; tissue_large_row(i); i++) {
        const tissue_large *t = tissue_large_row(i);
        printf("%s: %s\n    %s, stretch %g; %s\n", t->name, t->material, t->species, t->stretch, t->source);
    }
    return 0;
}

int main(int argc, char **argv) {
    app_check_stdout();
    app_catch_signals();
    options o;
    const char *command = argc > 1 ? argv[1] : "";
    const bool named = *command && *command != '-';
    int rc = parse(argc - named, argv + named, &o);
    if (rc || o.finished) return rc;
    if (!named)
        return app_bad_input("tm-scene", 0, "the command is missing; use new, check or tissues, or tm-scene --help");
    if (strcmp(command, "tissues") == 0) return list_tissues();
    const bool is_new = strcmp(command, "new") == 0;
    if (!is_new && strcmp(command, "check") != 0)
        return app_bad_input("tm-scene", 0, "unknown command '%s'; use new, check or tissues", command);
    if (!o.file)
        return app_bad_input("tm-scene", 0, "the file for '%s' is missing; name one %s", command,
                             is_new ? "mesh" : "scene");
    return app_ended("tm-scene", is_new ? make_new(&o) : check_scene(o.file, o.strict));
}
