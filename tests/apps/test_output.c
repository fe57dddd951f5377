/* Output files are complete or absent, also if the file system has no unnamed files; and paths that are no regular
 * file. */
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "app.h"

static bool no_unnamed_files;

/* Replaces libc's open in this program: simulates a file system without O_TMPFILE. */
int open(const char *path, int flags, ...) {
    va_list list;
    va_start(list, flags);
    mode_t mode = (flags & O_CREAT) || (flags & O_TMPFILE) == O_TMPFILE ? va_arg(list, mode_t) : 0;
    va_end(list);
    if (no_unnamed_files && (flags & O_TMPFILE) == O_TMPFILE) {
        errno = EOPNOTSUPP;
        return -1;
    }
    return (int)syscall(SYS_openat, AT_FDCWD, path, flags, mode);
}

static char folder[] = "/tmp/test_output.XXXXXX";

static int enter(void **state) {
    (void)state;
    if (!mkdtemp(folder) || chdir(folder)) return 1;
    return 0;
}

static int leave(void **state) {
    (void)state;
    return chdir("/") || system("rm -r /tmp/test_output.??????") ? 1 : 0;
}

static int files(void) {
    FILE *list = popen("ls -A | wc -l", "r");
    int count = -1;
    assert_int_equal(fscanf(list, "%d", &count), 1);
    pclose(list);
    return count;
}

static void put(const char *path, const char *text) {
    FILE *file = fopen(path, "w");
    fputs(text, file);
    fclose(file);
}

static const char *get(const char *path) {
    static char text[100];
    FILE *file = fopen(path, "r");
    if (!file) return "(none)";
    text[fread(text, 1, sizeof text - 1, file)] = 0;
    fclose(file);
    return text;
}

static void write_out(const char *path, const char *text, bool commit) {
    app_output output;
    tm_error error;
    assert_true(app_output_begin(&output, path, &error));
    FILE *file = app_output_stream(&output);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
    if (commit)
        assert_true(app_output_commit(&output, &error));
    else
        app_output_abandon(&output);
    app_output_abandon(&output); /* does nothing */
}

static void output_is_complete_or_absent(void **state) {
    (void)state;
    put("a.json", "old");
    chmod("a.json", 0640);
    write_out("a.json", "half", false);
    assert_string_equal(get("a.json"), "old");
    write_out("a.json", "new", true);
    assert_string_equal(get("a.json"), "new");
    struct stat info;
    stat("a.json", &info);
    assert_int_equal(info.st_mode & 0777, 0640);
    assert_int_equal(files(), 1);
    unlink("a.json");
}

/* Killed by SIGKILL while writing: the next run removes the remains, but not a file that another process is still
 * writing. */
static void killed_writer_leaves_remains_that_the_next_removes(void **state) {
    (void)state;
    pid_t child = fork();
    if (!child) {
        app_output output;
        app_output_begin(&output, "k.json", NULL);
        put(output.temporary, "half");
        raise(SIGKILL);
    }
    waitpid(child, NULL, 0);
    assert_int_equal(files(), no_unnamed_files);
    put("k.json.99~.txt", "of somebody else");
    app_output other;
    assert_true(app_output_begin(&other, "k.json", NULL));
    write_out("k.json", "new", true);
    assert_int_equal(files(), 2 + no_unnamed_files);
    assert_true(app_output_commit(&other, NULL));
    assert_int_equal(files(), 2);
    unlink("k.json");
    unlink("k.json.99~.txt");
}

static void links_are_followed_and_kept(void **state) {
    (void)state;
    mkdir("sub", 0777);
    put("sub/target", "old");
    assert_int_equal(symlink("sub/link", "link"), 0);
    assert_int_equal(symlink("target", "sub/link"), 0);
    write_out("link", "new", true);
    struct stat info;
    lstat("link", &info);
    assert_true(S_ISLNK(info.st_mode));
    assert_string_equal(get("sub/target"), "new");
    unlink("sub/target"); /* the link's target is created */
    write_out("link", "again", true);
    assert_string_equal(get("sub/target"), "again");
    assert_int_equal(system("rm -r sub link"), 0);
}

static void paths_that_are_no_regular_file_are_handled(void **state) {
    (void)state;
    mkfifo("pipe", 0666);
    pid_t reader = fork();
    if (!reader) _exit(strcmp(get("pipe"), "through") ? 1 : 0);
    write_out("pipe", "through", true);
    int left = 1;
    waitpid(reader, &left, 0);
    assert_int_equal(left, 0);
    struct stat info;
    stat("pipe", &info);
    assert_true(S_ISFIFO(info.st_mode));
    unlink("pipe");
    write_out("/dev/null", "nowhere", true);
    stat("/dev/null", &info);
    assert_true(S_ISCHR(info.st_mode));
    /* A path that names an open file descriptor: writing continues at its position. */
    char name[40];
    int fd = open("open", O_CREAT | O_WRONLY | O_TRUNC, 0666);
    assert_int_equal(write(fd, "one ", 4), 4);
    snprintf(name, sizeof name, "/dev/fd/%d", fd);
    write_out(name, "two", true);
    close(fd);
    assert_string_equal(get("open"), "one two");
    unlink("open");
    app_output output;
    tm_error error;
    assert_false(app_output_begin(&output, folder, &error));
    assert_non_null(strstr(error.message, "is a folder; give a file name in that folder"));
    assert_false(app_output_begin(&output, "nowhere/a", &error));
    assert_non_null(strstr(error.message, "No such file"));
    assert_int_equal(files(), 0);
}

static void wrong_file_endings_are_rejected(void **state) {
    (void)state;
    assert_int_equal(app_output_ending("--png", "a.png", ".png .ppm"), 0);
    assert_int_equal(app_output_ending("--png", "a.b/c.PPM", ".png .ppm"), 0);
    assert_int_equal(app_output_ending("--png", "-", ".png"), 0);
    assert_int_equal(app_output_ending("--png", "/dev/null", ".png"), 0);
    assert_int_equal(app_output_ending("--png", "a.jpg", ".png"), APP_BAD_INPUT);
    assert_int_equal(app_output_ending("--png", "a.png/c", ".png"), APP_BAD_INPUT);
    assert_int_equal(app_output_ending("--png", "a.pn", ".png"), APP_BAD_INPUT);
}

/* Also with an empty description of the error: the step fails without a message. */
static void failing_step_reports_its_error(void **state) {
    (void)state;
    assert_int_equal(app_report(NULL, 0, &(tm_error){0}), APP_FAILED);
    assert_int_equal(app_report(NULL, 0, &(tm_error){.status = TM_ERR_MEMORY}), APP_FAILED);
    assert_int_equal(app_report("a.yaml", 3, &(tm_error){.status = TM_ERR_MESH}), APP_BAD_INPUT);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(output_is_complete_or_absent),
                                       cmocka_unit_test(killed_writer_leaves_remains_that_the_next_removes),
                                       cmocka_unit_test(links_are_followed_and_kept),
                                       cmocka_unit_test(paths_that_are_no_regular_file_are_handled),
                                       cmocka_unit_test(wrong_file_endings_are_rejected),
                                       cmocka_unit_test(failing_step_reports_its_error)};
    int failed = cmocka_run_group_tests(tests, enter, NULL);
    no_unnamed_files = true;
    return failed + cmocka_run_group_tests(tests, NULL, leave);
}
