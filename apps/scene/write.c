/* Writes a scene's text with a comment on every line, for a first-time reader. */
#include <ctype.h>
#include <math.h>
#include <string.h>

#include "organ.h"
#include "scene/sim.h"

static double mm(double m) {
    const double v = round(1e4 * m) / 10;
    return v == 0 ? 0 : v; /* no -0 */
}

/* Writes text in double quotes, as in YAML. */
static void put_quoted(FILE *out, const char *text) {
    fputc('"', out);
    for (; *text; text++) {
        if (*text == '"' || *text == '\\') fputc('\\', out);
        if ((unsigned char)*text >= ' ') fputc(*text, out);
    }
    fputc('"', out);
}

static void put_point(FILE *out, const double m[3]) {
    fprintf(out, "[%g mm, %g mm, %g mm]", mm(m[0]), mm(m[1]), mm(m[2]));
}

static void put_direction(FILE *out, const double v[3]) {
    fprintf(out, "[%.3g, %.3g, %.3g]", v[0] + 0.0, v[1] + 0.0, v[2] + 0.0);
}

static void put_pressure(FILE *out, double Pa) {
    fprintf(out, Pa < 1e6 ? "%g kPa" : "%g MPa", Pa < 1e6 ? Pa / 1e3 : Pa / 1e6);
}

static void put_materials(const organ *o, FILE *out) {
    fprintf(
        out,
        "  # One entry a region of the mesh. young: how stiff; poisson: how little its volume gives (tissue hardly gives: 0.45 to 0.49);\n"
        "  # density: %s.\n"
        "  materials:\n",
        tissue_density_source);
    for (int32_t r = 0; r < o->file.region_count; r++) {
        const tissue_constants *t = o->tissue[r];
        const bool sole = o->file.region_count == 1;
        fputs("    ", out);
        put_quoted(out, sole ? "*" : o->file.region_name[r]);
        fputs(": {young: ", out);
        put_pressure(out, t->young_Pa);
        fprintf(out, ", poisson: %g, density: %g kg/m3} # %s%s: %s\n", t->poisson, t->density_kg_m3,
                sole ? "all of it; " : "", o->known[r] ? t->name : "NOT IN THE TABLE", t->source);
    }
}

static void put_support(const organ_support *s, FILE *out) {
    fputs("  - {name: ", out);
    put_quoted(out, s->name);
    switch (s->kind) {
    case SUPPORT_GROUP:
        fputs(", group: ", out);
        put_quoted(out, s->name);
        fprintf(out, "} # the mesh's own group, %d vertices\n", s->count);
        return;
    case SUPPORT_VERTICES:
        fputs(",\n     vertex: [", out);
        for (int32_t i = 0; i < s->count; i++)
            fprintf(out, "%s%d", i == 0 ? "" : i % 20 ? ", " : ",\n              ", s->vertex[i]);
        fputs("]} # where it comes out of the surface\n", out);
        return;
    case SUPPORT_PLANE:
        fputs(", plane: {point: ", out);
        put_point(out, s->point_m);
        fputs(", normal: ", out);
        put_direction(out, s->normal);
        fprintf(out, ", within: %.2g mm}} # the largest flat side that does not look up: %.0f %% of the surface\n",
                1e3 * s->within_m, 100 * s->share);
        return;
    case SUPPORT_BOX:
        fputs(", box: {min: ", out);
        put_point(out, s->low_m);
        fputs(", max: ", out);
        put_point(out, s->high_m);
        if (s->added)
            fprintf(out, "}} # %d vertices: without it, this sagged too far\n", s->count);
        else
            fprintf(out, "}} # what lies lowest, %d vertices: no label of bone or vessel, no flat side was found\n",
                    s->count);
        return;
    }
}

static void put_supports(const organ *o, FILE *out) {
    fputs(
        "\n# What holds it: these vertices do not move. A guess from labels and shape; look at it with tm-view SCENE --png, and put what is so.\n"
        "# Each item has one of: group: NAME (of the mesh; tm-mesh info lists them), box, plane, vertex.\n",
        out);
    if (o->hangs)
        fprintf(out, "# So held, it sags by %.2g of %.3g mm under its own weight (without rotation, a first guess).\n",
                mm(o->sag_m), mm(o->size_m));
    else
        fputs("# IT HANGS BY TOO LITTLE: under its own weight it sags by more than a fifth of its size.\n", out);
    fputs("supports:\n", out);
    for (int i = 0; i < o->supports; i++) put_support(&o->support[i], out);
}

static void put_trocar(const double trocar[3], const double axis[3], const double up[3], const double tip[3],
                       FILE *out) {
    fputs("    trocar: ", out);
    put_point(out, trocar);
    fputs("\n    axis: ", out);
    put_direction(out, axis);
    fputs(" # where its shaft points when the device stands straight\n    up: ", out);
    put_direction(out, up);
    fputs(" # left and right turn about this\n    start: {tip: ", out);
    put_point(out, tip);
    fputs(", above: 15 mm}\n", out);
}

static void put_instruments(const organ *o, FILE *out) {
    fprintf(
        out,
        "\n# The instrument%s: through a trocar (a hole in the wall that it turns about) 120 mm away, from above, pointing at the upper surface%s%s.\n"
        "instruments:\n"
        "  - mode: probe # or grasper (add 'grasp:'), or cautery (add 'cut:')\n",
        o->cut ? "s" : "", o->aim ? " over " : "", o->aim ? o->aim : "");
    put_trocar(o->trocar_m, o->axis, o->tool_up, o->target_m, out);
    if (!o->cut) return;
    fputs("  - mode: cautery # cuts while its pedal is down (active: yes)\n", out);
    put_trocar(o->cut_trocar_m, o->cut_axis, o->cut_up, o->cut_from_m, out);
}

static void put_waypoint(double time_s, const double tip[3], double depth_m, const char *more, FILE *out) {
    fprintf(out, "      - {time: %g s, tip: ", time_s);
    put_point(out, tip);
    fprintf(out, ", above: %g mm%s}\n", depth_m > 0 ? -mm(depth_m) : 15.0, more);
}

static void put_hand(const organ *o, FILE *out) {
    fputs(
        "\n# The hand, where nobody holds the device: towards a point of the surface, pressed in, held, deeper, out again.\n"
        "# tip gives the direction; above is how far from the first touch, negative: pressed in.\n"
        "hand:\n  - instrument: 0\n    path:\n",
        out);
    static const struct { double time_s, depth; } way[] = {{0, 0}, {1, 0.5}, {1.8, 0.5}, {2.6, 1}, {3.4, 1}, {4.4, 0}};
    for (size_t i = 0; i < sizeof way / sizeof *way; i++)
        put_waypoint(way[i].time_s, o->target_m, way[i].depth * o->depth_m, "", out);
    if (!o->cut) return;
    fputs("  - instrument: 1 # comes when the other goes, cuts along the surface, and goes\n    path:\n", out);
    put_waypoint(0, o->cut_from_m, 0, "", out);
    put_waypoint(3.2, o->cut_from_m, 0, "", out);
    put_waypoint(4.0, o->cut_from_m, o->cut_depth_m, ", active: yes", out);
    put_waypoint(5.4, o->cut_to_m, o->cut_depth_m, ", active: no", out);
    put_waypoint(6.0, o->cut_to_m, 0, "", out);
}

/* Writes every effect that this scene does not have, as a comment. */
static void put_other_effects(const organ *o, FILE *out) {
    static const char here[] = " contact damping haptics rendering cut ";
    fputs("\n# More, when you want it (docs/scene-reference.md):\n", out);
    for (int e = 0; e < sim_effect_count; e++) {
        char name[40];
        snprintf(name, sizeof name, " %s ", sim_effects[e]->name);
        if (!sim_effects[e]->model && !strstr(here, name))
            fprintf(out, "#   %s: %s\n", sim_effects[e]->name, sim_effects[e]->schema.field[0].doc);
    }
    if (!o->cut) fputs("#   cut: with an instrument of mode cautery (tm-scene new --cut)\n", out);
}

static void put_rest(const organ *o, FILE *out) {
    fprintf(out,
            "\ncontact: # instruments push the surface\n"
            "damping: {rate: 40 /s} # what moves comes to rest in some 25 ms, as in a body full of liquid\n"
            "%s"
            "haptics: {extrapolator: adaptive} # a 500 Hz controller feels it; leave out to only look\n"
            "rendering: # pictures and films\n"
            "time: {frame_rate: 25 Hz, duration: %g s} # with these constants %d substeps of %.3g ms a frame\n",
            o->cut ? "cut: {rate: 100 /s} # the cautery takes so many tetrahedra a second at most\n" : "",
            o->cut ? 6.4 : 4.6, o->substeps, 1e3 * (1.0 / 25) / o->substeps);
    put_other_effects(o, out);
}

void organ_write(const organ *o, FILE *out, const char *mesh_path, double scale, const char *title) {
    fprintf(
        out,
        "# A first scene, made by tm-scene: it runs as it is. Read it from top to bottom once, and put right what you know better.\n"
        "# Numbers carry their unit (5 kPa, 3 mm, 25 Hz); without one they are SI. Every key: docs/scene-reference.md.\n"
        "#   tm-scene check SCENE                 what is missing or odd\n"
        "#   tm-sim SCENE --lockstep --csv force.csv   runs it\n"
        "#   tm-view SCENE --png organ.png        shows it\n"
        "#   tm-session SCENE --duration 5        feels it, with a virtual device\n"
        "title: ");
    put_quoted(out, title);
    fprintf(out, "\ntissue:\n  mesh: ");
    put_quoted(out, mesh_path);
    fprintf(out, " # %d tetrahedra, %.3g x %.3g x %.3g mm\n", o->mesh->tet_count, 1e3 * (o->high_m[0] - o->low_m[0]),
            1e3 * (o->high_m[1] - o->low_m[1]), 1e3 * (o->high_m[2] - o->low_m[2]));
    if (scale != 1) fprintf(out, "  scale: %g # metres per unit of the mesh file\n", scale);
    put_materials(o, out);
    put_supports(o, out);
    put_instruments(o, out);
    put_hand(o, out);
    put_rest(o, out);
}
