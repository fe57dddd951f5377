/* Prints docs/scene-reference.md, from the tables that read scenes. */
#include <math.h>
#include <string.h>

#include "scene_parts.h"

static void print_kind(FILE *out, const app_field *f) {
    switch (f->kind) {
    case APP_SECTION: fputs("section", out); return;
    case APP_NUMBER:
        for (const char *c = strcmp(f->unit, "none") ? f->unit : "number"; *c; c++)
            *c == '|' ? fputs(" or ", out) : fputc(*c, out);
        return;
    case APP_INTEGER: fputs("whole number", out); return;
    case APP_VECTOR:
        fprintf(out, "[x, y, z]%s%s", strcmp(f->unit, "none") ? " " : "", strcmp(f->unit, "none") ? f->unit : "");
        return;
    case APP_TEXT: fputs("text", out); return;
    case APP_PATH: fputs("path", out); return;
    case APP_FLAG: fputs("yes or no", out); return;
    case APP_INTEGERS: fputs("whole number(s)", out); return;
    case APP_LIST: fputs("list", out); return;
    case APP_TABLE: fputs("named entries", out); return;
    case APP_EFFECTS: fputs("effects", out); return;
    case APP_CHOICE:
        for (const char *c = f->unit; *c; c++) *c == '|' ? fputs(", ", out) : fputc(*c, out);
        return;
    }
}

static void print_field(FILE *out, const app_field *f) {
    bool ranged = f->min != f->max && !(f->kind == APP_INTEGERS);
    fprintf(out, "| `%s` | ", f->path);
    print_kind(out, f);
    fprintf(out, " | %s | ", !f->fallback ? "" : !strcmp(f->fallback, "!") ? "**required**" : f->fallback);
    if (ranged) fprintf(out, "%g to %g", f->min, f->max);
    fprintf(out, " | %s |\n", f->doc);
}

static void print_table(FILE *out, const app_schema *schema, const char *heading, const char *title, const char *doc) {
    fprintf(out, "\n%s %s\n\n", heading, title);
    if (doc) fprintf(out, "%s\n\n", doc);
    fputs("| key | value | default | range (SI) | meaning |\n|---|---|---|---|---|\n", out);
    for (int i = 0; i < schema->count; i++) print_field(out, &schema->field[i]);
}

void app_scene_reference(FILE *out, const app_schema *effect, const char *const *effect_name,
                         const char *const *effect_doc, int effect_count) {
    fputs("# Scene reference\n"
          "\n"
          "<!-- Made by `tm-sim --schema markdown`; do not edit. -->\n"
          "\n"
          "A scene is one YAML file. Numbers are SI or carry a unit (`5 kPa`, `3 mm`, `30 deg`, `25 Hz`); a "
          "unit of another dimension is an error,\n"
          "and so is an unknown key. `a[].b` is key `b` of each item of the list `a`; `a.*.b` is key `b` of "
          "each named entry of `a`.\n"
          "A section or effect that a scene does not name costs no memory, no instruction and no library.\n"
          "`tm-sim SCENE --set PATH=VALUE` replaces or adds one value (`--set tissue.force=plain`, `--set "
          "hand[0].path[1].time=2`),\n"
          "`--unset PATH` leaves one out.\n",
          out);
    print_table(out, app_scene_schema(), "##", "Scene", NULL);
    fputs("\n"
          "## Effects\n"
          "\n"
          "Each is a key at the top level; naming it, even with nothing under it, switches it on.\n",
          out);
    for (int i = 0; i < effect_count; i++) print_table(out, &effect[i], "###", effect_name[i], effect_doc[i]);
}
