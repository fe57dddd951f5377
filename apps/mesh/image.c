/* tm-mesh image: makes tetrahedra from the labels of a segmented image. */
#include "image.h"

#include <ctype.h>
#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/bandwidth.h"
#include "scene/units.h"

static void usage(void) {
    printf(
        "usage: tm-mesh image [options] SEG.nii.gz -o ORGAN.msh\n"
        "Makes tetrahedra of the labels of a segmented image (NIfTI, NRRD, MetaImage, DICOM-SEG); "
        "neighbouring labels share faces.\n"
        "Lengths are written in metres, in the image's own axes (DICOM's: left, posterior, superior).\n"
        "\n"
        "  --label N[=NAME][:SIZE]  mesh only this label, with this name and edge length; may be repeated "
        "[all but 0]\n"
        "  --label all        mesh the other labels as well\n"
        "  --budget N | realtime    largest number of tetrahedra, or as many as half a core of this machine "
        "steps in real\n"
        "                           time with cutting (realtime:0.8: 0.8 of a core) [10000, unless --size is "
        "given]\n"
        "  --size SIZE        edge length of tetrahedra; less in a thinner label\n"
        "  --distance D       largest distance of facets from the smoothed surface [an eighth of the label's "
        "size]\n"
        "  --smooth S         width of the Gaussian that removes the voxels' steps, in voxels [1, and 0.28 "
        "of a thinner\n"
        "                     label's thickness]; 0: none. Volumes are preserved\n"
        "  --specks N         merge pieces and holes of fewer voxels with their surroundings [8]; 0: keep "
        "all\n"
        "  --optimise LIST    any of lloyd, perturb, exude (CGAL's), improve (move vertices, enlarge the "
        "smallest tetrahedron),\n"
        "                     volumes (move surfaces until each label has its volume), or none\n"
        "                     [exude,improve,volumes]; perturb and lloyd take seconds to minutes\n"
        "  --sliver ANGLE     dihedral angle that perturb and exude try to reach [12 deg]\n"
        "  --strict           refuse what is otherwise a warning: a label that vanished, is in more or fewer "
        "pieces than in\n"
        "                     the image, is one voxel thick, or needs more tetrahedra than --budget\n"
        "  --allow LIST       any of vanish, apart, thin: these stay warnings with --strict\n"
        "  --space lps | ras  axes of the result [lps]\n"
        "  --unit UNIT        m, mm or um, if the file has no unit [mm]\n"
        "  --young E --poisson NU --density RHO   material for the reported steps [5 kPa, 0.45, 1060 kg/m3]\n"
        "  --json FILE        write the report as JSON\n"
        "  -o OUT             %s\n"
        "\n"
        "Needs the module 'image' (make image; CGAL's mesher is under the GPL, and so is a program that links it).\n",
        tm_mesh_file_endings(true));
}

/* --- options --- */

static int parse_label(const char *text, image_options *o) {
    char *end;
    if (strcmp(text, "all") == 0) return o->all = true, APP_DONE;
    const long value = strtol(text, &end, 10);
    if (end == text || value < 1 || value > 65535)
        return command_usage("image", "--label %s: this is not a label; give a number from 1 to 65535, or all", text);
    if (o->regions == LABEL_MAX) return command_usage("image", "--label %s: more than %d labels", text, LABEL_MAX);
    image_region *r = &o->region[o->regions + 1];
    *r = (image_region){.value = (int)value};
    for (int i = 1; i <= o->regions; i++)
        if (o->region[i].value == value)
            return command_usage("image", "--label %s: this label is given twice; give it once", text);
    const char *colon = strchr(end, ':');
    if (*end == '=') {
        const size_t length = colon ? (size_t)(colon - end - 1) : strlen(end + 1);
        if (length == 0 || length >= sizeof r->name || memchr(end, '"', length))
            return command_usage("image", "--label %s: the name is empty or too long; give 1 to 63 characters", text);
        memcpy(r->name, end + 1, length);
        for (const char *at = r->name; *at; at++)
            if (iscntrl((unsigned char)*at))
                return command_usage(
                    "image", "--label %d: its name contains a control character; use letters and digits", r->value);
        for (int i = 1; i <= o->regions; i++)
            if (strcmp(o->region[i].name, r->name) == 0)
                return command_usage("image", "--label %s: label %d has this name; give each its own", text,
                                     o->region[i].value);
    } else if (*end && *end != ':')
        return command_usage("image", "--label %s: give N, N=NAME or N=NAME:SIZE", text);
    if (colon && !command_quantity("label", colon + 1, "length", &r->size_m)) return APP_BAD_INPUT;
    if (colon && !(r->size_m > 0)) return command_usage("image", "--label %s: the size must be above 0", text);
    o->regions++;
    return APP_DONE;
}

static int parse_budget(const char *text, image_options *o) {
    char *end;
    if (strncmp(text, "realtime", 8) == 0) {
        o->budget = -1;
        o->budget_load = text[8] == ':' ? strtod(text + 9, &end) : 0.5;
        if ((text[8] && text[8] != ':') || (text[8] && (*end || !(o->budget_load > 0) || o->budget_load > 1)))
            return command_usage("image",
                                 "--budget %s: give realtime, or realtime:SHARE with a share of a core up to 1", text);
        return APP_DONE;
    }
    const long count = strtol(text, &end, 10);
    if (end == text || *end || count < 100 || count > 5000000)
        return command_usage("image", "--budget %s: give 100 to 5000000 tetrahedra, or realtime", text);
    o->budget = (int)count;
    return APP_DONE;
}

/* Reads words separated by commas; each sets a flag. */
static int parse_words(const char *option, const char *text, const char *const *word, bool *const *flag, int count) {
    char list[200], *rest = list;
    snprintf(list, sizeof list, "%s", text);
    for (char *one; (one = strsep(&rest, ","));) {
        int w = 0;
        while (w < count && strcmp(word[w], one) != 0) w++;
        if (w == count)
            return command_usage("image", "--%s %s: '%s' is not one of its values; see tm-mesh image --help", option,
                                 text, one);
        if (flag[w]) *flag[w] = true;
    }
    return APP_DONE;
}

static int parse_optimise(const char *text, image_options *o) {
    static const char *const word[] = {"lloyd", "perturb", "exude", "improve", "volumes", "none"};
    bool *const flag[] = {&o->lloyd, &o->perturb, &o->exude, &o->improve, &o->volumes, NULL};
    o->lloyd = o->perturb = o->exude = o->improve = o->volumes = false;
    return parse_words("optimise", text, word, flag, 6);
}

static int parse_allow(const char *text, image_options *o) {
    static const char *const word[] = {"vanish", "apart", "thin"};
    bool *const flag[] = {&o->allow_vanish, &o->allow_apart, &o->allow_thin};
    return parse_words("allow", text, word, flag, 3);
}

static int parse_unit(const char *text, image_options *o) {
    o->unit_m = strcmp(text, "m") == 0 ? 1 : strcmp(text, "mm") == 0 ? 1e-3 : strcmp(text, "um") == 0 ? 1e-6 : 0;
    return o->unit_m > 0 ? APP_DONE : command_usage("image", "--unit %s: give m, mm or um", text);
}

static int parse_space(const char *text, image_options *o) {
    o->ras = strcmp(text, "ras") == 0;
    return o->ras || strcmp(text, "lps") == 0 ? APP_DONE : command_usage("image", "--space %s: give lps or ras", text);
}

static int parse_number(int c, const char *text, image_options *o) {
    double count = 0;
    bool good = true;
    switch (c) {
    case 'z': good = command_quantity("size", text, "length", &o->size_m); break;
    case 'd': good = command_quantity("distance", text, "length", &o->distance_m); break;
    case 'm': good = command_quantity("smooth", text, "none", &o->smooth), o->even = true; break;
    case 'v': good = command_quantity("sliver", text, "angle", &o->sliver_deg); break;
    case 'y': good = command_quantity("young", text, "pressure", &o->young_Pa); break;
    case 'p': good = command_quantity("poisson", text, "none", &o->poisson); break;
    case 'r': good = command_quantity("density", text, "density", &o->density_kg_m3); break;
    default: good = command_quantity("specks", text, "none", &count); o->specks = (int64_t)count;
    }
    if (c == 'v') o->sliver_deg *= 180 / M_PI;
    if (!good) return APP_BAD_INPUT;
    if (!(o->smooth >= 0) || o->smooth > 5) return command_usage("image", "--smooth must be 0 to 5 voxels");
    if (!(o->sliver_deg > 0) || o->sliver_deg > 40)
        return command_usage("image", "--sliver must be above 0 and up to 40 deg");
    if (o->specks < 0 || count > 1e9) return command_usage("image", "--specks must be 0 or more");
    if ((c == 'z' && !(o->size_m > 0)) || (c == 'd' && !(o->distance_m > 0)))
        return command_usage("image", "--size and --distance must be above 0");
    return APP_DONE;
}

static int parse(int argc, char **argv, image_options *o) {
    static const struct option names[] = {{"label", required_argument, NULL, 'l'},
                                          {"budget", required_argument, NULL, 'b'},
                                          {"size", required_argument, NULL, 'z'},
                                          {"distance", required_argument, NULL, 'd'},
                                          {"smooth", required_argument, NULL, 'm'},
                                          {"specks", required_argument, NULL, 'k'},
                                          {"optimise", required_argument, NULL, 'i'},
                                          {"sliver", required_argument, NULL, 'v'},
                                          {"allow", required_argument, NULL, 'a'},
                                          {"space", required_argument, NULL, 's'},
                                          {"unit", required_argument, NULL, 'u'},
                                          {"young", required_argument, NULL, 'y'},
                                          {"poisson", required_argument, NULL, 'p'},
                                          {"density", required_argument, NULL, 'r'},
                                          {"json", required_argument, NULL, 'j'},
                                          {"output", required_argument, NULL, 'o'},
                                          {"help", no_argument, NULL, 'h'},
                                          {"strict", no_argument, NULL, 't'},
                                          {0}};
    *o = (image_options){.smooth = 1,
                         .specks = 8,
                         .sliver_deg = 12,
                         .exude = true,
                         .improve = true,
                         .volumes = true,
                         .young_Pa = 5000,
                         .poisson = 0.45,
                         .density_kg_m3 = 1060};
    optind = 1;
    opterr = 0;
    for (int c, end; (c = getopt_long(argc, argv, "ho:", names, NULL)) != -1;) {
        switch (c) {
        case 'l': end = parse_label(optarg, o); break;
        case 'b': end = parse_budget(optarg, o); break;
        case 'i': end = parse_optimise(optarg, o); break;
        case 'a': end = parse_allow(optarg, o); break;
        case 's': end = parse_space(optarg, o); break;
        case 'u': end = parse_unit(optarg, o); break;
        case 'j': end = APP_DONE, o->json = optarg; break;
        case 'o': end = APP_DONE, o->out = optarg; break;
        case 'h': usage(); exit(APP_DONE);
        case 't': end = APP_DONE, o->strict = true; break;
        case '?': return command_usage("image", "unknown option, or its value is missing: '%s'", argv[optind - 1]);
        default: end = parse_number(c, optarg, o);
        }
        if (end) return end;
    }
    if (optind + 1 != argc) return command_usage("image", "name one image");
    if (!o->out) return command_usage("image", "no output; give -o OUT");
    if (o->budget && o->size_m > 0)
        return command_usage("image", "--size and --budget both set the fineness; give one");
    o->budget_said = o->budget != 0;
    if (!o->budget && !(o->size_m > 0)) o->budget = 10000;
    o->in = argv[optind];
    const int bad = command_output(o->out);
    return bad ? bad : app_output_check(o->json);
}

/* --- labels --- */

static bool chooses(const image_options *o) { return o->regions && !o->all; }

/* Moves the options of named labels to their indices among all labels, if all are meshed. */
static int spread_regions(const label_field *field, image_options *o) {
    static image_region asked[LABEL_MAX + 1];
    const int count = o->regions;
    memcpy(asked, o->region, sizeof asked);
    memset(o->region, 0, sizeof o->region);
    for (int r = 1; r <= count; r++) {
        int l = 1;
        while (l <= field->labels && field->value[l] != asked[r].value) l++;
        if (l > field->labels)
            return app_bad_input(o->in, 0, "label %d is not in the image; leave it out of --label", asked[r].value);
        o->region[l] = asked[r];
    }
    return APP_DONE;
}

/* Names the regions of all labels, from the file or as label_N, each name once. */
static void name_regions(const image_volume *volume, const label_field *field, image_options *o) {
    for (int l = 1; l <= field->labels; l++) {
        image_region *r = &o->region[l];
        r->value = field->value[l];
        for (int n = 0; !r->name[0] && n < volume->names; n++)
            if (volume->name[n].label == r->value) snprintf(r->name, sizeof r->name, "%s", volume->name[n].name);
        for (char *at = r->name; *at; at++)
            if (*at == '"' || iscntrl((unsigned char)*at)) *at = '_';
        for (int k = 1; k < l; k++)
            if (strcmp(o->region[k].name, r->name) == 0) r->name[0] = 0;
        if (!r->name[0]) snprintf(r->name, sizeof r->name, "label_%d", r->value);
    }
}

static int check_labels(const image_options *o, const image_volume *volume, const label_field *f) {
    if (f->labels == 0) return app_bad_input(o->in, 0, "no voxel has a label; choose another image");
    const size_t voxels = (size_t)volume->size[0] * (size_t)volume->size[1] * (size_t)volume->size[2];
    bool most[65536] = {false};
    int values = 0;
    for (size_t i = 0; i < voxels; i++)
        if (!most[volume->label[i]]) most[volume->label[i]] = true, values += volume->label[i] != 0;
    if (!chooses(o) && values > LABEL_MAX)
        return app_bad_input(
            o->in, 0,
            "it has %d labels, which may mean that it is not a segmentation; choose up to %d of them with --label",
            values, LABEL_MAX);
    for (int l = 1; l <= f->labels; l++) {
        const image_region *r = &o->region[l];
        if (f->voxels[l] == 0)
            return app_bad_input(o->in, 0, "label %d ('%s') is empty; leave it out of --label", r->value, r->name);
        if (f->thin[l] < 2 && o->strict && !o->allow_thin)
            return app_bad_input(o->in, 0,
                                 "label %d ('%s') is one voxel thick; leave it out with --label, or --allow thin",
                                 r->value, r->name);
        if (f->thin[l] < 2 && !o->trial)
            app_remark("%s: warning: label %d ('%s') is one voxel thick; parts of it may be lost\n", o->in, r->value,
                       r->name);
    }
    if (o->trial) return APP_DONE;
    if (f->specks)
        app_remark(
            "%s: %lld specks and holes (%lld voxels) were merged with their surroundings; --specks 0 keeps them\n",
            o->in, (long long)f->specks, (long long)f->speck_voxels);
    if (f->at_border) app_remark("%s: a label extends to the edge of the image and ends there in a flat face\n", o->in);
    return APP_DONE;
}

/* Reports labels that vanished or fell apart, with figures; rejects them with --strict. */
static int check_mesh(const image_options *o, const label_field *f, const image_mesh *m) {
    int exit = APP_DONE;
    for (int l = 1; l <= f->labels; l++) {
        const image_region *r = &o->region[l];
        const image_result *got = &m->of[l];
        if (got->pieces == f->pieces[l]) continue;
        const bool allowed = !o->strict || (got->pieces < f->pieces[l] ? o->allow_vanish : o->allow_apart);
        char text[300];
        if (got->pieces == 0)
            snprintf(text, sizeof text, "label %d ('%s') vanished: %.3g cm3 in the image", r->value, r->name,
                     1e6 * got->image_m3);
        else
            snprintf(text, sizeof text, "label %d ('%s') is in %d piece%s, in the image in %d; the largest has %.3g %%",
                     r->value, r->name, got->pieces, got->pieces == 1 ? "" : "s", f->pieces[l],
                     100 * got->largest_m3 / got->volume_m3);
        if (allowed)
            app_remark("%s: warning: %s\n", o->in, text);
        else
            exit = app_bad_input(o->in, 0, "%s; mesh it finer, smooth less, or leave out --strict", text);
    }
    if (m->loose)
        app_remark("%s: %d detached piece%s of the mesh (%.2g %% of its volume) removed\n", o->in, m->loose,
                   m->loose == 1 ? " was" : "s were", 100 * m->loose_m3 / m->of[0].volume_m3);
    return exit;
}

/* --- the command --- */

const image_api *image_open_module(tm_error *error) {
    void *module = app_module("image", error);
    const image_api *api = module ? app_module_symbol(module, IMAGE_API_SYMBOL, error) : NULL;
    if (module && !api)
        tm_fail(error, TM_ERR_FILE, -1,
                "module 'image' has another version than this program; build both again: make, make image");
    return api;
}

static int attempt(const image_api *api, image_options *o, const image_volume *volume, label_field *field,
                   image_mesh *mesh) {
    int wanted[LABEL_MAX];
    for (int r = 0; r < o->regions; r++) wanted[r] = o->region[r + 1].value;
    if (!label_field_build(volume, chooses(o) ? wanted : NULL, o->regions, o->specks, o->smooth, o->even, field))
        return command_no_memory(o->in);
    int exit = chooses(o) ? APP_DONE : spread_regions(field, o);
    name_regions(volume, field, o);
    if (exit == APP_DONE) exit = check_labels(o, volume, field);
    if (exit == APP_DONE) exit = image_build(api, o, field, mesh);
    return exit;
}

static int make_mesh(const image_api *api, image_options *o, const image_volume *volume) {
    label_field field = {0};
    image_mesh mesh = {0};
    tm_mesh_file file = {0};
    tm_error error = {0};
    const image_options asked = *o;
    char words[IMAGE_WHY] = "";
    const double from_s = app_seconds();
    int exit = attempt(api, o, volume, &field, &mesh);
    if (exit == APP_DONE) exit = check_mesh(o, &field, &mesh);
    if (exit == APP_DONE && image_distances(&field, &mesh, &error)) exit = app_report(o->in, 0, &error);
    if (exit == APP_DONE) image_propose(api, attempt, &asked, volume, &field, &mesh, app_seconds() - from_s, words);
    if (exit == APP_DONE && !image_to_file(o, volume, &field, &mesh, &file)) exit = command_no_memory(o->in);
    if (exit == APP_DONE) exit = image_report(o, volume, &field, &mesh, &file);
    if (exit == APP_DONE && words[0]) app_remark("%s: %s\n", o->in, words);
    tm_mesh_file_free(&file);
    image_mesh_free(&mesh);
    label_field_free(&field);
    return exit;
}

int command_image(int argc, char **argv) {
    static image_options o;
    image_volume volume = {0};
    tm_error error = {0};
    char why[IMAGE_WHY] = "";
    int exit = parse(argc, argv, &o);
    if (exit) return exit;
    const image_api *api = image_open_module(&error);
    if (!api) return app_report(NULL, 0, &error);
    app_catch_signals();
    const image_end end = api->read(o.in, o.unit_m, &volume, why);
    if (end == IMAGE_STOPPED) return app_interrupted_exit();
    if (end) {
        app_bad_input(o.in, 0, "%s", why);
        return end == IMAGE_BAD_INPUT ? APP_BAD_INPUT : APP_FAILED;
    }
    if (!volume.unit[0] && !(o.unit_m > 0))
        app_remark("%s: it has no unit of length; millimetres are assumed (--unit)\n", o.in);
    exit = make_mesh(api, &o, &volume);
    free(volume.label);
    return exit;
}
