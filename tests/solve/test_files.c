/* Response files: cached, checked completely, replaced atomically; bit-identical for any number of threads; a killed
 * run leaves the old file. */
#include "../../libtensormass/solve/internal.h"
#include "kit.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

typedef struct set_up {
    tm_mesh *mesh;
    tm_tissue *tissue;
    uint8_t *fixed;
    char path[256], part[300];
    tm_precomputed_def def;
} set_up;

static set_up open_set_up(const char *name) {
    set_up s = {0};
    fix_random random = {3};
    const tm_material material = kit_material(8e3, 0.4);
    s.mesh = fix_block((int[]){6, 4, 4}, (double[]){0.06, 0.04, 0.04}, 0.2, &random);
    s.tissue = fix_tissue(s.mesh, &material, NULL, TM_DOUBLE, false);
    s.fixed = kit_clamp(s.mesh, 1e-9);
    s.def = tm_precomputed_def_default();
    s.def.problem = kit_problem(s.tissue, s.fixed);
    const char *out = getenv("TM_OUT");
    snprintf(s.path, sizeof s.path, "%s/tests/solve/%s.tmr", out ? out : "build", name);
    snprintf(s.part, sizeof s.part, "%s.part", s.path);
    unlink(s.path);
    unlink(s.part);
    return s;
}

static void close_set_up(set_up *s) {
    unlink(s->path);
    assert_int_not_equal(access(s->part, F_OK), 0);
    free(s->fixed);
    tm_tissue_destroy(s->tissue);
    tm_mesh_destroy(s->mesh);
    assert_int_equal(tm_memory_in_use(), 0);
}

static unsigned char *slurp(const char *path, size_t *size) {
    FILE *f = fopen(path, "rb");
    struct stat st;
    assert_non_null(f);
    assert_int_equal(fstat(fileno(f), &st), 0);
    unsigned char *bytes = malloc((size_t)st.st_size);
    *size = fread(bytes, 1, (size_t)st.st_size, f);
    assert_int_equal(*size, st.st_size);
    fclose(f);
    return bytes;
}

static void spit(const char *path, const unsigned char *bytes, size_t size) {
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(bytes, 1, size, f), size);
    fclose(f);
}

/* Opens a model, and returns whether it came from the file. */
static bool opens(const set_up *s, char why[160]) {
    tm_precomputed *model;
    tm_solve_report report;
    tm_error error;
    tm_precomputed_def def = s->def;
    def.file = s->path;
    fix_ok(tm_precomputed_create(&def, &model, &report, &error), &error);
    tm_precomputed_destroy(model);
    memcpy(why, report.why, 160);
    return report.from_file;
}

static void responses_are_cached(void **state) {
    (void)state;
    set_up s = open_set_up("cached");
    char why[160];
    assert_false(opens(&s, why));
    assert_string_equal(why, "no file yet");
    assert_true(opens(&s, why));
    assert_string_equal(why, "");
    /* the opened model equals the computed one */
    const int32_t vertex = s.mesh->vertex_count - 1, n = 3 * s.mesh->vertex_count;
    const double push[3] = {1e-3, -2e-3, 3e-3};
    double *shape[2];
    for (int i = 0; i < 2; i++) {
        tm_precomputed_def def = s.def;
        def.file = i ? s.path : NULL;
        tm_precomputed *model;
        tm_error error;
        fix_ok(tm_precomputed_create(&def, &model, NULL, &error), &error);
        fix_ok(tm_precomputed_impose(model, 1, &vertex, push, 0, &error), &error);
        assert_true(tm_precomputed_update(model, NULL) >= 0);
        shape[i] = malloc(8 * (size_t)n);
        memcpy(shape[i], tm_precomputed_displacement(model), 8 * (size_t)n);
        tm_precomputed_destroy(model);
    }
    assert_memory_equal(shape[0], shape[1], 8 * (size_t)n);
    assert_true(fabs(shape[0][3 * vertex + 2] - push[2]) < 1e-15);
    free(shape[0]), free(shape[1]);
    /* other materials, supports, loads and precisions are other problems */
    tm_material stiffer = kit_material(9e3, 0.4);
    tm_tissue *other = fix_tissue(s.mesh, &stiffer, NULL, TM_DOUBLE, false), *mine = s.tissue;
    double *load = calloc((size_t)n, 8);
    load[n - 1] = 1e-3;
    for (int change = 0; change < 4; change++) {
        set_up t = s;
        if (change == 0) t.def.problem.tissue = other;
        if (change == 1) t.fixed[n - 1] = 1;
        if (change == 2) t.def.problem.load_N = load;
        if (change == 3) t.def.precision = TM_SINGLE;
        assert_false(opens(&t, why));
        assert_non_null(strstr(why, "made for another mesh, material"));
        assert_true(opens(&t, why));
        t.fixed[n - 1] = 0;
    }
    s.tissue = mine;
    tm_tissue_destroy(other);
    free(load);
    close_set_up(&s);
}

static void any_number_of_threads_gives_the_same_bits(void **state) {
    (void)state;
    set_up s = open_set_up("bits");
    unsigned char *bytes[3];
    size_t size[3];
    const int32_t threads[3] = {1, 2, 5};
    tm_error error;
    for (int i = 0; i < 3; i++) {
        tm_precomputed_def def = s.def;
        def.file = s.path;
        def.problem.threads = threads[i];
        fix_ok(tm_precomputed_write(&def, NULL, &error), &error);
        bytes[i] = slurp(s.path, &size[i]);
        assert_int_equal(size[i], size[0]);
        assert_memory_equal(bytes[i], bytes[0], size[0]);
    }
    for (int i = 0; i < 3; i++) free(bytes[i]);
    close_set_up(&s);
}

static void damaged_files_are_recomputed(void **state) {
    (void)state;
    set_up s = open_set_up("damaged");
    char why[160];
    size_t size;
    assert_false(opens(&s, why));
    unsigned char *good = slurp(s.path, &size), *bad = malloc(size + 1);
    fix_random random = {11};
    for (int i = 0; i < 60;
         i += test_is_sanitized() ? 4 : 1) { /* any single bit; the first one in every part of the header */
        memcpy(bad, good, size);
        const size_t at = i < 40 ? (size_t)(i * 2) : (size_t)(fix_uniform(&random) * (double)size);
        bad[at] ^= (unsigned char)(1 << i % 8);
        spit(s.path, bad, size);
        /* padding before the columns is covered too */
        assert_false(opens(&s, why));
        assert_true(strlen(why) > 0);
        assert_true(opens(&s, why));
        size_t again;
        unsigned char *rebuilt = slurp(s.path, &again);
        assert_int_equal(again, size);
        assert_memory_equal(rebuilt, good, size);
        free(rebuilt);
    }
    const size_t lengths[] = {0, 1, 7, 63, 64, 4095, size / 2, size - 1, size + 1};
    for (size_t i = 0; i < sizeof lengths / sizeof *lengths; i++) {
        memcpy(bad, good, size);
        bad[size] = 0;
        spit(s.path, bad, lengths[i]);
        assert_false(opens(&s, why));
    }
    spit(s.path, (const unsigned char *)"not of ours, but here first\n", 28);
    assert_false(opens(&s, why));
    assert_string_equal(why, "not a response file");
    free(good), free(bad);
    close_set_up(&s);
}

/* --- interrupted --- */

static bool kill_in_the_middle(void *user, const char *what, double fraction, double left) {
    (void)user, (void)left;
    if (!strcmp(what, "responses") && fraction > 0.4) raise(SIGKILL);
    return true;
}
static bool stop_in_the_middle(void *user, const char *what, double fraction, double left) {
    int *calls = user;
    ++*calls;
    return !(!strcmp(what, "responses") && fraction > 0.4 && left >= 0);
}

/* The process to be killed: this program, called again. */
static void killed(void) {
    set_up s = open_set_up("killed");
    snprintf(s.path, sizeof s.path, "%s", getenv("TEST_FILES_PATH"));
    tm_error error;
    s.def.file = s.path;
    s.def.problem.threads = 1;
    s.def.problem.progress = kill_in_the_middle;
    tm_precomputed_write(&s.def, NULL, &error);
}

static void killed_run_leaves_the_old_file(void **state) {
    (void)state;
    set_up s = open_set_up("interrupted");
    char why[160];
    size_t size, again;
    int calls = 0;
    tm_error error;
    assert_false(opens(&s, why));
    unsigned char *old = slurp(s.path, &size);
    tm_precomputed_def def = s.def;
    def.file = s.path;
    def.problem.threads = 1;
    def.problem.user = &calls;
    setenv("TEST_FILES_PATH", s.path, 1);
    const pid_t child = fork();
    if (child == 0) { /* a new program: threads do not survive a fork */
        execl("/proc/self/exe", "test_files", "killed", NULL);
        _exit(0);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    unsigned char *now = slurp(s.path, &again);
    assert_int_equal(again, size);
    assert_memory_equal(now, old, size);
    free(now);
    assert_int_equal(access(s.part, F_OK), 0); /* its remains ... */
    assert_true(opens(&s, why));
    def.problem.progress = stop_in_the_middle;
    assert_int_equal(tm_precomputed_write(&def, NULL, &error), TM_ERR_CONVERGENCE);
    assert_true(calls > 3);
    assert_int_not_equal(access(s.part, F_OK), 0); /* ... are removed by the next run */
    assert_true(opens(&s, why));
    now = slurp(s.path, &again);
    assert_memory_equal(now, old, size);
    free(now), free(old);
    /* no writable folder */
    char absent[320];
    snprintf(absent, sizeof absent, "%s.folder-that-is-not-there/x.tmr", s.path);
    def.file = absent;
    def.problem.progress = NULL;
    assert_int_equal(tm_precomputed_write(&def, NULL, &error), TM_ERR_FILE);
    assert_non_null(strstr(error.message, absent));
    close_set_up(&s);
}

/* --- a cache shared by several users, or an unusable one --- */

/* Replaces the library's flock: between opening and locking, another process finishes. */
static const char *finish_from, *finish_to;
int flock(int fd, int operation) {
    if (finish_from) assert_int_equal(rename(finish_from, finish_to), 0);
    finish_from = NULL;
    return (int)syscall(SYS_flock, fd, operation);
}

static void file_finished_by_another_process_is_used(void **state) {
    (void)state;
    set_up s = open_set_up("race");
    const char text[] = "what the winner wrote";
    tms_file_write file;
    tm_error error;
    size_t size;
    spit(s.part, (const unsigned char *)text, sizeof text);
    finish_from = s.part, finish_to = s.path;
    fix_ok(tms_file_lock(&s.def.problem, s.path, 5, &file, &error), &error);
    fix_ok(tms_file_reserve(&file, 4096, &error), &error);
    unsigned char *there = slurp(s.path, &size);
    assert_int_equal(size, sizeof text); /* not emptied: another program may have it mapped */
    assert_memory_equal(there, text, sizeof text);
    tms_file_abandon(&file);
    free(there);
    close_set_up(&s);
}

static int calls_while_waiting, end_holder[2];
static bool count_waiting(void *user, const char *what, double fraction, double left) {
    (void)user, (void)fraction, (void)left;
    if (strcmp(what, "waiting for another run")) return true;
    if (++calls_while_waiting == 3) close(end_holder[1]);
    return calls_while_waiting < 2000;
}

/* Four processes at once, and one that must wait for the lock of a process that then disappears. */
static void four_processes_at_once_share_one_file(void **state) {
    (void)state;
    set_up s = open_set_up("users");
    tms_file_write file;
    tm_error error;
    int status, pipe_end[2];
    char why[160], byte;
    assert_int_equal(pipe(pipe_end), 0);
    assert_int_equal(pipe(end_holder), 0);
    const pid_t holder = fork();
    if (holder == 0) {
        tm_error lack;
        bool held = tms_file_lock(&s.def.problem, s.path, 0, &file, &lack) == TM_OK;
        close(end_holder[1]);
        if (write(pipe_end[1], &held, 1) == 1) held = read(end_holder[0], &byte, 1) == 0; /* the other has waited */
        _exit(0); /* simulates a kill: its temporary file stays */
    }
    assert_int_equal(read(pipe_end[0], &byte, 1), 1);
    assert_int_equal(byte, 1);
    assert_int_equal(tms_file_lock(&s.def.problem, s.path, 0.05, &file, &error), TM_ERR_FILE);
    s.def.problem.progress = count_waiting;
    assert_non_null(strstr(error.message, "another run"));
    assert_false(opens(&s, why));
    assert_true(calls_while_waiting > 2);
    assert_true(opens(&s, why));
    assert_int_equal(waitpid(holder, &status, 0), holder);
    close(pipe_end[0]), close(pipe_end[1]), close(end_holder[0]);
    unlink(s.path);
    setenv("TEST_FILES_PATH", s.path, 1);
    pid_t user[4];
    for (int i = 0; i < 4; i++)
        if ((user[i] = fork()) == 0) {
            execl("/proc/self/exe", "test_files", "user", NULL);
            _exit(1);
        }
    for (int i = 0; i < 4; i++) {
        assert_int_equal(waitpid(user[i], &status, 0), user[i]);
        assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    }
    assert_true(opens(&s, why));
    close_set_up(&s);
}

static int one_user(void) {
    set_up s = open_set_up("one_user");
    char why[160];
    snprintf(s.path, sizeof s.path, "%s", getenv("TEST_FILES_PATH"));
    opens(&s, why);
    free(s.fixed);
    tm_tissue_destroy(s.tissue);
    tm_mesh_destroy(s.mesh);
    return 0;
}

/* Everything works without a cache; its absence is an error only if the file itself is requested. */
static void without_a_cache_only_the_file_is_missing(void **state) {
    (void)state;
    set_up s = open_set_up("nowhere"), there = s;
    char why[160];
    tm_error error;
    tm_precomputed_def def = s.def;
    snprintf(s.path, sizeof s.path, "%s.folder-that-is-not-there/x.tmr", there.path);
    assert_false(opens(&s, why));
    assert_non_null(strstr(why, "kept in memory alone"));
    def.file = s.path;
    assert_int_equal(tm_precomputed_write(&def, NULL, &error), TM_ERR_FILE);
    s = there;
    /* disk full, simulated by a limit on file sizes */
    struct rlimit was, small = {20000, RLIM_INFINITY};
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &was), 0);
    small.rlim_max = was.rlim_max;
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &small);
    const bool from_file = opens(&s, why);
    def.file = s.path;
    const tm_status written = tm_precomputed_write(&def, NULL, &error);
    setrlimit(RLIMIT_FSIZE, &was);
    signal(SIGXFSZ, SIG_DFL);
    assert_false(from_file);
    assert_non_null(strstr(why, "kept in memory alone"));
    assert_int_equal(written, TM_ERR_FILE);
    assert_int_not_equal(access(s.path, F_OK), 0);
    /* a name that cannot be replaced: the mapped model is used all the same */
    assert_int_equal(mkdir(s.path, 0755), 0);
    assert_false(opens(&s, why));
    assert_non_null(strstr(why, "kept in memory alone"));
    assert_int_equal(rmdir(s.path), 0);
    close_set_up(&s);
}

/* Links and FIFOs in place of the files. */
static void links_and_fifos_are_handled(void **state) {
    (void)state;
    set_up s = open_set_up("traps");
    char why[160], target[300];
    size_t size;
    const char text[] = "somebody's letters";
    snprintf(target, sizeof target, "%s.target", s.path);
    for (int hard = 0; hard < 2; hard++) {
        spit(target, (const unsigned char *)text, sizeof text);
        assert_int_equal(hard ? link(target, s.part) : symlink(target, s.part), 0);
        assert_false(opens(&s, why));
        assert_non_null(strstr(why, "kept in memory alone"));
        unsigned char *there = slurp(target, &size);
        assert_int_equal(size, sizeof text);
        assert_memory_equal(there, text, sizeof text);
        free(there);
        unlink(s.part), unlink(target);
    }
    alarm(60); /* opening a FIFO would block the program */
    assert_int_equal(mkfifo(s.part, 0644), 0);
    assert_false(opens(&s, why));
    unlink(s.part);
    assert_int_equal(mkfifo(s.path, 0644), 0);
    assert_false(opens(&s, why));
    assert_true(opens(&s, why));
    alarm(0);
    close_set_up(&s);
}

/* Counts whose sizes wrap around to the file's size. */
static void counts_that_wrap_are_refused(void **state) {
    (void)state;
    set_up s = open_set_up("crafted");
    const size_t most = (size_t)1 << 38; /* a sparse file */
    tms_file_head head = {.magic = "TMRESP\r\n", .version = 1, .byte_order = 0x01020304, .key = 7, .block = TMS_BLOCK};
    tms_layout l = {0};
    for (int32_t k = INT32_MAX; k > 0 && l.bytes == 0; k--) {
        const tms_layout here = tms_file_layout(k, INT32_MAX, TM_DOUBLE);
        if (here.bytes > sizeof head && here.bytes < most) l = here, head.kept_count = k;
    }
    assert_true(l.bytes > 0);
    head.interface_count = INT32_MAX;
    head.column_offset = (int64_t)l.column;
    head.bytes = (int64_t)l.bytes;
    void *map;
    size_t bytes;
    char why[160];
    spit(s.path, (const unsigned char *)&head, sizeof head);
    assert_int_equal(truncate(s.path, (off_t)l.bytes), 0);
    assert_false(tms_file_open(s.path, 7, 1, &map, &bytes, why));
    assert_string_equal(why, "its header is damaged");
    /* wrong lists with correct checksums */
    tms_file_write file;
    tm_error error;
    size_t size;
    assert_false(opens(&s, why));
    unsigned char *good = slurp(s.path, &size);
    for (int lie = 0; lie < 3; lie++) {
        fix_ok(tms_file_lock(&s.def.problem, s.path, 5, &file, &error), &error);
        fix_ok(tms_file_reserve(&file, size, &error), &error);
        memcpy(file.map, good, size);
        int32_t *kept = (int32_t *)(void *)((char *)file.map + sizeof(tms_file_head));
        kept[1] = lie == 0 ? 1 << 30 : lie == 1 ? -5 : kept[0];
        fix_ok(tms_file_commit(&file, ((tms_file_head *)file.map)->key, 1, &error), &error);
        assert_false(opens(&s, why));
        assert_string_equal(why, "its vertices are of another problem");
        assert_true(opens(&s, why));
    }
    free(good);
    close_set_up(&s);
}

int main(int argc, char **argv) {
    if (argc == 2 && !strcmp(argv[1], "killed")) return killed(), 0;
    if (argc == 2 && !strcmp(argv[1], "user")) return one_user();
    const struct CMUnitTest tests[] = {cmocka_unit_test(responses_are_cached),
                                       cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
                                       cmocka_unit_test(damaged_files_are_recomputed),
                                       cmocka_unit_test(killed_run_leaves_the_old_file),
                                       cmocka_unit_test(file_finished_by_another_process_is_used),
                                       cmocka_unit_test(four_processes_at_once_share_one_file),
                                       cmocka_unit_test(without_a_cache_only_the_file_is_missing),
                                       cmocka_unit_test(links_and_fifos_are_handled),
                                       cmocka_unit_test(counts_that_wrap_are_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
