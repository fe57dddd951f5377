/* Gmsh as this project wants it: silent, without the user's settings, its errors kept for a message. */
#include <gmshc.h>
#include <stdio.h>
#include <string.h>

#include "gmsh_module.h"

tm_status tm_gmsh_failed(tm_error *error, const char *what) {
    char **line = NULL, said[300] = "";
    size_t lines = 0;
    int wrong = 0;
    gmshLoggerGet(&line, &lines, &wrong);
    for (size_t i = 0; !wrong && i < lines && !said[0]; i++)
        if (strncmp(line[i], "Error: ", 7) == 0) snprintf(said, sizeof said, "%s", line[i] + 7);
    return app_mesh_fail(error, TM_ERR_FILE, -1, "%s%s%s; write the mesh anew", what, said[0] ? ": Gmsh says: " : "",
                         said);
}

tm_status tm_gmsh_open(const char *path, tm_error *error) {
    int wrong = 0;
#if GMSH_API_VERSION_MAJOR > 4 || GMSH_API_VERSION_MINOR >= 9
    gmshInitialize(0, NULL, 0, 0, &wrong);
#else
    gmshInitialize(0, NULL, 0, &wrong);
#endif
    if (wrong) return app_mesh_fail(error, TM_ERR_FILE, -1, "Gmsh does not start; check that libgmsh is whole");
    gmshOptionSetNumber("General.Terminal", 0, &wrong);
    gmshLoggerStart(&wrong);
    gmshMerge(path, &wrong);
    return wrong ? tm_gmsh_failed(error, "cannot be read") : TM_OK;
}
