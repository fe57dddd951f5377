/* tm-mesh: examines, checks, repairs and refines meshes. */
#include <string.h>

#include "command.h"

static const struct {
    const char *name;
    command_fn *run;
    const char *what;
} commands[] = {
    {"info", command_info, "print counts, size, quality, regions, groups, the worst element and its step"},
    {"check", command_check, "check whether a mesh can be simulated; if not, exit 2 and print each defect"},
    {"fill", command_fill, "fill closed surfaces (STL, OBJ, PLY, OFF) with tetrahedra"},
    {"image", command_image, "make tetrahedra of the labels of a segmented image (NIfTI, NRRD, MetaImage)"},
    {"refine", command_refine, "refine tetrahedra in a box or a region"},
    {"repair", command_repair, "reverse inverted tetrahedra, remove flat, double and unused ones"},
    {"renumber", command_renumber, "renumber vertices by position, which makes steps faster"},
    {"convert", command_convert, "convert between .msh, .vtk, .vtu and .mesh, and scale"},
};
enum { COMMANDS = sizeof commands / sizeof *commands };

static void list(FILE *to) {
    for (int i = 0; i < COMMANDS; i++) fprintf(to, "  %-8s %s\n", commands[i].name, commands[i].what);
}

/* Removes --quiet, which every command accepts, anywhere before "--". */
static int take_quiet(int argc, char **argv) {
    int kept = 0;
    bool options = true;
    for (int i = 0; i < argc; i++)
        if (options && strcmp(argv[i], "--") == 0)
            options = false, argv[kept++] = argv[i];
        else if (options && strcmp(argv[i], "--quiet") == 0)
            app_be_quiet();
        else
            argv[kept++] = argv[i];
    argv[kept] = NULL;
    return kept;
}

static void usage(FILE *to) {
    fprintf(to, "usage: tm-mesh COMMAND ...\n\n");
    list(to);
    fprintf(to, "\n  tm-mesh COMMAND -h, --help; --list, --version; --quiet: print warnings and errors only\n");
}

int main(int argc, char **argv) {
    app_check_stdout();
    const char *name = argc > 1 ? argv[1] : "";
    if (strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0) {
        usage(stdout);
        return APP_DONE;
    }
    if (strcmp(name, "--list") == 0) {
        list(stdout);
        return APP_DONE;
    }
    if (strcmp(name, "--version") == 0) {
        printf("tm-mesh %s\n", tm_version());
        return APP_DONE;
    }
    for (int i = 0; i < COMMANDS; i++)
        if (strcmp(name, commands[i].name) == 0) argc = take_quiet(argc, argv);
    for (int i = 0; i < COMMANDS; i++)
        if (strcmp(name, commands[i].name) == 0) return commands[i].run(argc - 1, argv + 1);
    if (!*name)
        app_bad_input(NULL, 0, "tm-mesh: the command is missing; use one of these");
    else
        app_bad_input(NULL, 0, "tm-mesh: unknown command '%s'; use one of these", name);
    usage(stderr);
    return APP_BAD_INPUT;
}
