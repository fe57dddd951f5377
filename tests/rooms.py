"""Assigns tests to components and tells tests/run.py how to run them. Keys are prefixes of FOLDER/FILE::TEST (Python) and FOLDER/PROGRAM (C); the longest
match counts."""

# `long` is independent of these: tests of minutes, marked in their files, run only by `make check-long`.
ROOMS = {
    "unit": "one part by itself, within two seconds of processor, and what is read of the sources: `make test`",
    "physics": "forces, energies, steps, contact, models and what they promise, on tissue",
    "system": "programs as users drive them; builds, packages, pages; all that watches the clock",
}

IN = {
    "test_": "system",  # tests of the test tools
    "accuracy/test_": "system", "accuracy/test_limit": "unit", "accuracy/test_pace": "unit", "accuracy/test_accuracy": "physics", "accuracy/test_promises": "physics",
    "apps/": "unit", "apps/test_programs_alike": "system",
    "bench/": "system", "compare/": "system", "cross/": "system", "evaluate/": "physics", "firmware/": "system", "fuzz/": "system", "install/": "system",
    "can/": "system", "can/test_dbc": "unit",
    "cut/": "unit",
    "devices/": "system",
    "docs/": "unit", "docs/test_adding": "system", "docs/test_commands": "system", "docs/test_library_guide": "system", "docs/test_newcomer": "system", "docs/test_page_lengths": "system", "docs/test_tutorial": "system",
    "reality/": "physics", "fit/": "system",
    "effects/": "physics", "hash/": "system", "organ/": "system", "organ/test_pressing": "physics", "stability/": "physics",
    "loop/": "unit", "loop/test_messages": "system", "loop/test_processes": "system", "loop/test_release.py": "physics", "loop/test_rows": "system", "loop/test_soak": "system",
    "loop/test_two_hosts": "system",
    "mesh/": "system", "mesh/test_mesh_io": "unit", "mesh/test_image_volumes": "unit", "mesh/test_bad_meshes": "unit", "mesh/test_mesh_files": "unit",
    "pages/": "system", "plugins/": "system", "python/": "system", "sanitize/": "system", "scene/": "system", "study/": "system", "timing/": "system",
    # Within two seconds; slower tests are listed below.
    "physics/": "unit", "solve/": "unit", "unit/": "unit",
    "physics/test_contact": "physics", "physics/test_gather": "physics", "physics/test_patch": "physics", "physics/test_release": "physics", "physics/test_sessions": "physics",
    "physics/test_settle": "physics", "physics/test_step_threads": "physics", "physics/test_windows": "physics",
    "solve/test_factored": "physics", "solve/test_files": "physics", "solve/test_hybrid": "physics", "solve/test_model": "physics", "solve/test_online": "physics",
    "solve/test_precompute": "physics", "solve/test_sent": "physics",
    "sim/": "physics", "sim/test_diagnostics": "unit", "sim/test_input": "unit", "sim/test_interrupt": "unit", "sim/test_quote": "unit", "sim/test_stream": "unit", "sim/test_unstable": "unit",
    "sim/test_builds": "system", "sim/test_lockstep": "system", "sim/test_memory": "system", "sim/test_realtime": "system", "sim/test_series": "system",
    "trust/": "unit", "trust/test_trust": "system", "trust/test_flags": "system",
    "web/": "system",
    "view/": "system", "view/test_controls": "unit", "view/test_fairing": "unit", "view/test_marks": "unit", "view/test_skin": "unit",
}

# Depend on the wall clock: run after those that compute, concurrently, as they mostly wait.
CLOCK = (
    "devices/", "trust/test_trust", "trust/test_flags", "loop/test_messages", "loop/test_processes", "loop/test_two_hosts", "loop/test_soak", "install/test_live", "sanitize/test_sanitize.py::test_the_ring",
    "sim/test_lockstep.py::test_a_scene_without_solver", "sim/test_lockstep.py::test_realtime", "sim/test_realtime", "timing/test_loop",
    "view/test_session", "view/test_display", "view/test_play", "view/test_view.py::test_memory_of_a_large_tissue", "view/test_view.py::test_live",
)

# Of those: tests that share the set-up of one pytest process run one after the other; the others run concurrently with them.
TOGETHER = ("devices/test_motors", "trust/test_trust.py::test_attacks", "trust/test_trust.py::test_effects_of_attacks", "trust/test_trust.py::test_listening_attacker", "trust/test_flags", "install/test_live", "loop/test_messages", "sim/test_realtime")

# Tests of the sanitizers' builds, without clock: they run throughout with the remaining processor time. Elsewhere they would wait for those builds.
LEFTOVER = ("sanitize/test_sanitize.py::test_short_form", "fuzz/test_fuzz.py::test_no_input", "hash/test_hash.py::test_compilers_agree")

# Examine the plain build itself (instructions, memory, system calls, libraries, speed) or make builds of their own: tests/sanitize/run.py skips them.
# (test_ranks: OpenMPI leaks from modules that it has already closed; no suppression can name them.)
PLAIN = ("accuracy/", "bench/", "can/test_guest", "devices/", "docs/", "effects/", "evaluate/", "firmware/", "fuzz/", "hash/", "install/", "loop/test_lint",
         "loop/test_processes.py::test_report_has", "loop/test_processes.py::test_no_page_fault", "loop/test_processes.py::test_system_calls",
         "loop/test_soak", "pages/", "plugins/", "python/", "sanitize/", "sim/test_builds", "sim/test_lockstep.py::test_a_scene_without_solver", "solve/test_precompute.py::test_a_rank",
         "solve/test_precompute.py::test_ranks", "stability/test_planted", "timing/", "trust/", "web/", "view/test_display", "view/test_play.py::test_the_displays_opengl", "view/test_session.py::test_spy")
# Moves a hand in a window for two seconds; ThreadSanitizer makes the simulation ten times slower.
PLAIN_OF_TSAN = ("view/test_play.py::test_mouse_and_keys",)


def name_of(item, tests):
    """Returns FOLDER/FILE::TEST, or FOLDER/PROGRAM."""
    if item.path == tests / "test_programs.py" and hasattr(item, "callspec"):
        return "/".join(item.callspec.params["program"].parts[-2:])
    return f"{item.path.relative_to(tests).as_posix()}::{item.name}"


def room_of(name):
    """Returns the component, None if no row matches."""
    fits = [begin for begin in IN if name.startswith(begin)]
    return IN[max(fits, key=len)] if fits else None
