/* Functions shared by the commands of tm-mesh: quantities, outputs, bad usage. */
#include "command.h"

#include <stdarg.h>
#include <string.h>

#include "scene/units.h"

bool command_quantity(const char *option, const char *text, const char *dimension, double *si) {
    char why[200];
    if (app_parse_quantity(text, dimension, si, why, sizeof why)) return true;
    app_bad_input(NULL, 0, "tm-mesh: --%s %s: %s", option, text, why);
    return false;
}

bool command_unit(const char *command, const char *text, double *scale) {
    static const struct {
        const char *name;
        double m;
    } units[] = {{"m", 1}, {"cm", 1e-2}, {"mm", 1e-3}, {"um", 1e-6}, {"inch", 0.0254}};
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcmp(text, units[i].name) == 0) {
            *scale = units[i].m;
            return true;
        }
    command_usage(command, "--unit %s: give m, cm, mm, um or inch", text);
    return false;
}

bool command_scale(const char *command, int option, const char *text, bool *sized, double *scale) {
    if (*sized) {
        command_usage(command, "--unit and --scale both set the unit; give one");
        return false;
    }
    *sized = true;
    return option == 'u' ? command_unit(command, text, scale) : command_quantity("scale", text, "none", scale);
}

int command_output(const char *path) {
    int exit = app_output_ending("-o", path, tm_mesh_file_endings(true));
    return exit ? exit : app_output_check(path);
}

int command_no_memory(const char *file) {
    app_bad_input(file, 0, "no memory; choose a larger --size, or a coarser mesh");
    return APP_FAILED;
}

int command_usage(const char *command, const char *format, ...) {
    char what[300];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    return app_bad_input(NULL, 0, "tm-mesh %s: %s; see tm-mesh %s --help", command, what, command);
}
