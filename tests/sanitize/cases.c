/* Linked into the C tests of the sanitizers' builds and of config=coverage, in place of cmocka's function. Leaves out
 * the cases that TM_LEAVE_OUT names ("one,two"). With TM_COVERAGE=FOLDER (choose.py) each case runs in a process of its
 * own, writes its counts to FOLDER/N.profraw, and its number, exit status, processor seconds and name to FOLDER/cases.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

int __real__cmocka_run_group_tests(const char *group, const struct CMUnitTest *test, size_t count,
                                   CMFixtureFunction set_up, CMFixtureFunction tear_down);
int __wrap__cmocka_run_group_tests(const char *group, const struct CMUnitTest *test, size_t count,
                                   CMFixtureFunction set_up, CMFixtureFunction tear_down);
/* Of clang's runtime library, in config=coverage alone. */
__attribute__((weak)) void __llvm_profile_set_filename(const char *path);
__attribute__((weak)) void __llvm_profile_reset_counters(void);

static double children_s(void) {
    struct rusage used;
    getrusage(RUSAGE_CHILDREN, &used);
    return (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
           1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
}

static int each_by_itself(const char *folder, const char *group, const struct CMUnitTest *test, size_t count,
                          CMFixtureFunction set_up, CMFixtureFunction tear_down) {
    static char path[4096];
    snprintf(path, sizeof path, "%s/cases", folder);
    FILE *cases = fopen(path, "a");
    if (!cases || !__llvm_profile_set_filename || !__llvm_profile_reset_counters) return 1;
    for (size_t i = 0; i < count; i++) {
        const double before_s = children_s();
        fflush(NULL);
        const pid_t child = fork();
        if (child == 0) {
            snprintf(path, sizeof path, "%s/%zu.profraw", folder, i);
            __llvm_profile_set_filename(path);
            __llvm_profile_reset_counters();
            exit(__real__cmocka_run_group_tests(group, test + i, 1, set_up, tear_down));
        }
        int status = 0;
        if (child < 0 || waitpid(child, &status, 0) != child) return 1;
        fprintf(cases, "%zu %d %.3f %s\n", i, status, children_s() - before_s, test[i].name);
    }
    return fclose(cases) != 0;
}

static int is_listed(const char *list, const char *name) {
    const size_t length = strlen(name);
    for (const char *at = list; (at = strstr(at, name)); at += length)
        if ((at == list || at[-1] == ',') && (at[length] == ',' || !at[length])) return 1;
    return 0;
}

int __wrap__cmocka_run_group_tests(const char *group, const struct CMUnitTest *test, size_t count,
                                   CMFixtureFunction set_up, CMFixtureFunction tear_down) {
    const char *folder = getenv("TM_COVERAGE"), *list = getenv("TM_LEAVE_OUT");
    struct CMUnitTest *kept = calloc(count + 1, sizeof *kept);
    size_t n = 0;
    for (size_t i = 0; kept && i < count; i++)
        if (!list || !is_listed(list, test[i].name)) kept[n++] = test[i];
    int failed = 1;
    if (n && folder) failed = each_by_itself(folder, group, kept, n, set_up, tear_down);
    if (n && !folder) failed = __real__cmocka_run_group_tests(group, kept, n, set_up, tear_down);
    free(kept);
    return failed;
}
