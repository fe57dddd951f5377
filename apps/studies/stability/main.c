/* tm-stability: runs the hard cases and writes their verdicts as JSON; apps/studies/stability/page.py draws them. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>

#include "app.h"
#include "json_file.h"
#include "stability.h"

static const struct {
    const hard_case *row;
    const int *count;
} groups[] = {
#define CASES_LISTED(name) {cases_##name, &cases_##name##_count},
    CASE_GROUPS(CASES_LISTED)};
enum { GROUPS = sizeof groups / sizeof *groups };

static const char *verdict_name(verdict v) {
    switch (v) {
    case ACCURATE: return "stays accurate";
    case STABLE: return "stays stable";
    case REFUSED: return "refused";
    case BROKEN: return "broken";
    }
    return "broken";
}

static bool good(const hard_case *c, const outcome *o) {
    return o->verdict == c->expected && (c->expected == REFUSED || (isfinite(o->figure) && o->figure <= c->bound));
}

static void usage(FILE *to) {
    fprintf(
        to,
        "usage: tm-stability [--case NAME]... [--quick] [--json FILE]\n"
        "Runs hard cases: each must stay accurate, stay stable with a stated loss, or be refused with a clear message. Exit 1 otherwise.\n\n"
        "  --case NAME   run only this case (may be repeated)\n"
        "  --list        list the cases\n"
        "  --quick       run the short form of each, as make check does\n"
        "  --json FILE   write verdicts, figures and curves\n"
        "  --quiet       print only cases that fail\n"
        "  -h, --help, --version\n");
}

static void list(void) {
    for (int g = 0; g < GROUPS; g++)
        for (int i = 0; i < *groups[g].count; i++) printf("%-24s %s\n", groups[g].row[i].name, groups[g].row[i].what);
}

static cJSON *as_json(const hard_case *c, const outcome *o, bool quick) {
    cJSON *row = cJSON_CreateObject();
    char command[200];
    snprintf(command, sizeof command, "tm-stability --case %s%s", c->name, quick ? " --quick" : "");
    app_json_add(row, "group %s name %s what %s verdict %s expected %s good %hhd figure_name %s", c->group, c->name,
                 c->what, verdict_name(o->verdict), verdict_name(c->expected), good(c, o), c->figure_name);
    if (c->expected != REFUSED) {
        app_json_add(row, "figure %g bound %g", isfinite(o->figure) ? o->figure : -1, c->bound);
    }
    app_json_add(row, "text %s command %s", o->text, command);
    if (o->count) {
        app_json_add(row, "x_name %s y_name %s", o->x_name, o->y_name);
        cJSON_AddItemToObject(row, "x", cJSON_CreateDoubleArray(o->x, o->count));
        cJSON_AddItemToObject(row, "y", cJSON_CreateDoubleArray(o->y, o->count));
    }
    return row;
}

static bool is_wanted(const char *name, char **wanted, int count) {
    for (int i = 0; i < count; i++)
        if (strcmp(wanted[i], name) == 0) return true;
    return count == 0;
}

static int run_all(char **wanted, int wanted_count, bool quick, const char *json) {
    static outcome o;
    cJSON *root = cJSON_CreateObject(), *rows = cJSON_AddArrayToObject(root, "cases");
    int failed = 0, ran = 0;
    app_json_add(root, "quick %hhd", quick);
    for (int g = 0; g < GROUPS; g++)
        for (int i = 0; i < *groups[g].count; i++) {
            const hard_case *c = &groups[g].row[i];
            if (!is_wanted(c->name, wanted, wanted_count)) continue;
            memset(&o, 0, sizeof o);
            o.verdict = BROKEN;
            snprintf(o.text, sizeof o.text, "the case ended without a verdict");
            c->run(quick, c->argument, &o);
            bool fine = good(c, &o);
            failed += !fine, ran++;
            if (!fine || !app_is_quiet())
                printf("%-4s %-24s %-15s %s\n", fine ? "ok" : "FAIL", c->name, verdict_name(o.verdict), o.text);
            fflush(stdout);
            cJSON_AddItemToArray(rows, as_json(c, &o, quick));
        }
    if (failed || !app_is_quiet()) printf("%d cases, %d failed\n", ran, failed);
    int exit = app_json_save(json, root);
    cJSON_Delete(root);
    return exit != APP_DONE ? exit : failed ? APP_FAILED : APP_DONE;
}

static bool exists(const char *name) {
    for (int g = 0; g < GROUPS; g++)
        for (int i = 0; i < *groups[g].count; i++)
            if (strcmp(groups[g].row[i].name, name) == 0) return true;
    return false;
}

int main(int argc, char **argv) {
    static const struct option options[] = {{"case", required_argument, NULL, 'c'}, {"quick", no_argument, NULL, 'q'},
                                            {"json", required_argument, NULL, 'j'}, {"list", no_argument, NULL, 'l'},
                                            {"help", no_argument, NULL, 'h'},       {"quiet", no_argument, NULL, 1000},
                                            {"version", no_argument, NULL, 'v'},    {0}};
    enum { MAX_COUNT = 64 };
    char *wanted[MAX_COUNT];
    const char *json = NULL;
    int count = 0;
    bool quick = false;
    app_check_stdout();
    opterr = 0; /* the program prints its own message */
    for (int c; (c = getopt_long(argc, argv, "h", options, NULL)) != -1;) switch (c) {
        case 'c':
            if (!exists(optarg))
                return app_bad_input("tm-stability", 0, "case '%s' does not exist; --list lists them", optarg);
            if (count < MAX_COUNT) wanted[count++] = optarg;
            break;
        case 'q': quick = true; break;
        case 'j': json = optarg; break;
        case 'l': list(); return APP_DONE;
        case 1000: app_be_quiet(); break;
        case 'h': usage(stdout); return APP_DONE;
        case 'v': printf("tm-stability %s\n", tm_version()); return APP_DONE;
        default:
            return app_bad_input("tm-stability", 0,
                                 "%s: unknown option, or its value is missing; see tm-stability --help",
                                 argv[optind - 1]);
        }
    if (optind < argc)
        return app_bad_input("tm-stability", 0, "unexpected argument '%s'; see tm-stability --help", argv[optind]);
    if (app_output_check(json)) return APP_BAD_INPUT;
    return run_all(wanted, count, quick, json);
}
