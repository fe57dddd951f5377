"""The short form of `make sanitize` in every check: the C programs and a ring of programs, built by clang with its sanitizers. Planted errors show that
the sanitizers detect them."""
import json
import os
import shutil
import subprocess
import sys

import pytest

PLANTED = {
    "asan": ("heap-buffer-overflow", "int *a = malloc(4 * sizeof *a); a[argc + 3] = 1; printf(\"%d\\n\", a[argc + 3]); free(a);"),
    "asan-leak": ("LeakSanitizer", "void *volatile p = malloc(10); p = 0; printf(\"%p\\n\", p);"),
    "asan-undefined": ("runtime error", "volatile int x = 2147483647; x += argc; printf(\"%d\\n\", x);"),
    "tsan": ("data race", "pthread_t t; pthread_create(&t, 0, other, 0); for (int i = 0; i < MANY; i++) shared[i] += argc; pthread_join(t, 0); printf(\"%d\\n\", shared[0]);"),
}


@pytest.mark.parametrize("name", PLANTED)
def test_it_sees_what_it_is_for(name, root, tmp_path):
    """A planted fault, built with the flags of the Makefile, is reported where run.py looks."""
    sys.path.insert(0, str(root / "tests/sanitize"))
    import run
    said, body = PLANTED[name]
    config = name.split("-")[0]
    flags = subprocess.run(["make", "-C", root, "--no-print-directory", "-s", f"config={config}", "print-flags"], capture_output=True, text=True, check=True).stdout.split()
    (tmp_path / "fault.c").write_text(f"""
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
/* Many places: ThreadSanitizer misses a race of two accesses that are checked at the same moment. */
enum {{ MANY = 1000 }};
static int shared[MANY];
static void *other(void *unused) {{ for (int i = 0; i < MANY; i++) shared[i]++; return unused; }}
int main(int argc, char **argv) {{ (void)argv; (void)other; (void)shared; {body} return 0; }}
""")
    subprocess.run([*flags, "-o", tmp_path / "fault", tmp_path / "fault.c", "-lpthread"], check=True)
    (tmp_path / "reports").mkdir()
    subprocess.run([*run.wrapper(config), tmp_path / "fault"], env=dict(os.environ, **run.options(tmp_path / "reports")), capture_output=True, timeout=300)
    reports = list((tmp_path / "reports").iterdir())
    assert len(reports) == 1 and said in reports[0].read_text(errors="replace"), f"{said} was not reported"


def chosen(root):
    sys.path.insert(0, str(root / "tests/sanitize"))
    import choose
    return choose


@pytest.mark.parametrize("listed", ["left_out.txt", "left_out_tsan.txt"])
def test_what_is_left_out_exists(root, listed):
    """A case that is renamed runs again until the list is made anew: the list must name it no more."""
    for program, cases in chosen(root).left_out(root / "tests/sanitize" / listed).items():
        source = root / f"tests/{program}.c"
        assert source.exists(), f"{program}: make sanitize-choice"
        for case in cases:
            assert f"static void {case}(void **" in source.read_text(), f"{program} {case}: make sanitize-choice"


def test_the_choice_reaches_its_share_of_regions(root):
    """By regions gained per second; a case that became superfluous and a program without a kept case are left out."""
    choose = chosen(root)
    cases = {("a/slow", "all"): (9, {1, 2, 3, 4}), ("a/fast", "first"): (1, {1, 2}), ("a/fast", "second"): (1, {2}), ("a/fast", "third"): (1, {3, 4}),
             ("a/other", "only"): (2, {5, 6}), ("a/other", "fails by itself"): (5, None)}
    cases = {name: (seconds, regions and frozenset(regions)) for name, (seconds, regions) in cases.items()}
    kept = choose.choose(cases, share=1)
    assert kept == {("a/fast", "first"), ("a/fast", "third"), ("a/other", "only"), ("a/other", "fails by itself")}
    assert list(choose.rows_of(cases, kept)) == ["a/fast second", "a/slow"]
    assert ("a/other", "only") not in choose.choose(cases, share=0.66)


CASES = """
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>
static void one(void **state) { (void)state; puts("ran: one"); }
static void one_more(void **state) { (void)state; puts("ran: one_more"); }
static void fails(void **state) { (void)state; puts("ran: fails"); assert_true(0); }
int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(one), cmocka_unit_test(one_more), cmocka_unit_test(fails)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
"""


@pytest.mark.parametrize("left_out, ran, code", [(None, "one one_more fails", 1), ("fails,one", "one_more", 0), ("one,one_more", "fails", 1), ("one,one_more,fails", "", 1)])
def test_cases_are_left_out_by_name(root, tmp_path, once, left_out, ran, code):
    """A program of which nothing is left fails: it must not be built."""
    def compiled(folder):
        (folder / "cases.c").write_text(CASES)
        subprocess.run(["gcc", "-o", folder / "cases", folder / "cases.c", root / "tests/sanitize/cases.c", "-Wl,--wrap=_cmocka_run_group_tests", "-lcmocka"], check=True)

    run = subprocess.run([once("sanitize-cases", compiled) / "cases"], env={**os.environ, **({"TM_LEAVE_OUT": left_out} if left_out else {})}, capture_output=True, text=True, timeout=60)
    assert " ".join(line[5:] for line in run.stdout.splitlines() if line.startswith("ran: ")) == ran and run.returncode == code, run


@pytest.mark.long
def test_the_short_form_still_reaches_what_all_cases_reach(root, make_config):
    """Of the code as it is now; the list was made of an earlier state."""
    made = make_config("coverage", "tests-short")
    done = subprocess.run([sys.executable, root / "tests/sanitize/choose.py", "--build", made, "--check"], capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture
def find_nothing(root, make_config, tmp_path):
    """find_nothing(PART, NAME): builds the short form's programs and runs this part of it. Returns its figures."""
    return lambda part, name: run_short(part, name, root, make_config, tmp_path)


def run_short(part, name, root, make_config, tmp_path):
    assert shutil.which("clang"), "clang is not installed; make check installs it"
    made = make_config(name, "tests-short")
    (tmp_path / "build").mkdir()
    for at in (made, made.parent / "venv"):
        (tmp_path / "build" / at.name).symlink_to(at)
    done = subprocess.run([sys.executable, root / "tests/sanitize/run.py", "--build", tmp_path / "build", "--short", part, name], capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stdout + done.stderr[-8000:]
    figures = json.loads((tmp_path / "build" / "sanitize.json").read_text())[name]
    assert not figures["failed"], figures
    return figures


@pytest.mark.parametrize("name", ["asan", "tsan"])
def test_short_form_finds_nothing(name, find_nothing):
    assert find_nothing("programs", name)["passed"] > {"asan": 100, "tsan": 7}[name]


@pytest.mark.parametrize("name", ["asan", "tsan"])
def test_the_ring_finds_nothing(name, find_nothing):
    """Depends on the clock, so it runs neither concurrently with others nor on idle time: last of those that run alone, when the build exists."""
    assert find_nothing("ring", name)["passed"] > 5
