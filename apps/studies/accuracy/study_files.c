/* What makes and holds other meshes of a study: tm-mesh, and files of fibres. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bandwidth.h"
#include "study.h"

/* Waits for it as long as a run may take. */
static int wait_for(const study *t, pid_t child) {
    const double began_s = app_seconds(), allowed_s = fmin(study_run_limit_s(t), study_left_s(t));
    int status = -1;
    for (pid_t ended = 0; child > 0 && ended != child;) {
        const struct timespec nap = {0, 5000000};
        ended = waitpid(child, &status, WNOHANG);
        if (ended < 0 && errno != EINTR) return -1;
        if (ended == child) break;
        study_doing(t, "making a mesh", -1);
        if (app_interrupted() || app_seconds() - began_s > allowed_s) kill(child, SIGKILL);
        nanosleep(&nap, NULL);
    }
    return status;
}

/* tm-mesh beside this program, its words into the void: what it cannot do shows in the file that is not there. */
bool study_run_mesh(const study *t, char *const *argument) {
    char path[1100];
    const ssize_t length = readlink("/proc/self/exe", path, 1000);
    if (length < 0) return false;
    path[length] = 0;
    snprintf(strrchr(path, '/') + 1, 20, "tm-mesh");
    const pid_t child = fork();
    if (child == 0) {
        const int nowhere = open("/dev/null", O_WRONLY);
        dup2(nowhere, STDOUT_FILENO);
        dup2(nowhere, STDERR_FILENO);
        execv(path, argument);
        _exit(127);
    }
    const int status = wait_for(t, child);
    return child > 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

bool study_write_fibres(const double *fibre, int32_t tet_count, const char *path) {
    tm_error error = {0};
    app_output output;
    if (!app_output_begin(&output, path, &error)) return false;
    FILE *file = app_output_stream(&output);
    if (file) fprintf(file, "tet,ax,ay,az\n");
    for (int32_t t = 0; file && t < tet_count; t++) {
        const double *a = fibre + 3 * (size_t)t;
        fprintf(file, "%d,%.9g,%.9g,%.9g\n", t, a[0], a[1], a[2]);
    }
    return app_output_end(&output, file, &error);
}
